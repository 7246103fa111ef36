"""What is guaranteed about every consistent plant: weights for robust control, and the margin of a controller."""

from robustid.certify.bilinear import ControlPair
from robustid.certify.small_gain import GuaranteedMargin, MarginStatus, guaranteed_margin
from robustid.certify.weight import UncertaintyWeight, entry_weights, magnitude_weight, uncertainty_weight

__all__ = [
    "ControlPair",
    "GuaranteedMargin",
    "MarginStatus",
    "UncertaintyWeight",
    "entry_weights",
    "guaranteed_margin",
    "magnitude_weight",
    "uncertainty_weight",
]

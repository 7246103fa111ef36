"""What is guaranteed about every consistent plant: worst-case errors with certificates, weights, margins of controllers."""

from robustid.certify.bilinear import ControlPair
from robustid.certify.circle import CircleBound
from robustid.certify.parameters import ParameterIntervals
from robustid.certify.small_gain import GuaranteedMargin, MarginStatus, guaranteed_margin
from robustid.certify.value_set import ValueSet
from robustid.certify.weight import UncertaintyWeight, entry_weights, magnitude_weight, uncertainty_weight
from robustid.certify.worst_case import WorstCaseError, worst_case_error

__all__ = [
    "CircleBound",
    "ControlPair",
    "GuaranteedMargin",
    "MarginStatus",
    "ParameterIntervals",
    "UncertaintyWeight",
    "ValueSet",
    "WorstCaseError",
    "entry_weights",
    "guaranteed_margin",
    "magnitude_weight",
    "uncertainty_weight",
    "worst_case_error",
]

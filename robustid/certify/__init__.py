"""What is guaranteed about every consistent plant: worst-case errors and responses with certificates, weights, margins."""

from robustid.certify.bilinear import ControlPair
from robustid.certify.circle import CircleBound
from robustid.certify.diameter import Diameter, diameter
from robustid.certify.parameters import ParameterIntervals
from robustid.certify.pole_band import PoleBand, worst_case_over_poles
from robustid.certify.pole_cells import PoleCell
from robustid.certify.refute import Refutation, refute
from robustid.certify.small_gain import GuaranteedMargin, MarginStatus, guaranteed_margin
from robustid.certify.storage import load_pole_band, load_worst_case_error
from robustid.certify.tubes import ResponseTube, response_tube
from robustid.certify.value_set import ValueSet
from robustid.certify.weight import UncertaintyWeight, entry_weights, magnitude_weight, uncertainty_weight
from robustid.certify.worst_case import WorstCaseError, worst_case_error

__all__ = [
    "CircleBound",
    "ControlPair",
    "Diameter",
    "GuaranteedMargin",
    "MarginStatus",
    "ParameterIntervals",
    "PoleBand",
    "PoleCell",
    "Refutation",
    "ResponseTube",
    "UncertaintyWeight",
    "ValueSet",
    "WorstCaseError",
    "diameter",
    "entry_weights",
    "guaranteed_margin",
    "load_pole_band",
    "load_worst_case_error",
    "magnitude_weight",
    "refute",
    "response_tube",
    "uncertainty_weight",
    "worst_case_error",
    "worst_case_over_poles",
]

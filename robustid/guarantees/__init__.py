"""Guarantees about every consistent plant: worst-case errors and responses with certificates, weights, margins."""

from robustid.guarantees import storage  # noqa: F401 - registers the results that can be saved
from robustid.guarantees.bilinear import ControlPair
from robustid.guarantees.circle import CircleBound
from robustid.guarantees.consistent_set import check_one_channel
from robustid.guarantees.diameter import Diameter, diameter
from robustid.guarantees.nominal import as_frequencies, default_grid
from robustid.guarantees.parameters import ParameterIntervals
from robustid.guarantees.pole_band import PoleBand, worst_case_over_poles
from robustid.guarantees.pole_cells import AMPLITUDE, PoleCell, box_of
from robustid.guarantees.refute import Refutation, refute
from robustid.guarantees.small_gain import GuaranteedMargin, MarginStatus, guaranteed_margin
from robustid.guarantees.tubes import ResponseTube, response_tube
from robustid.guarantees.value_set import ValueSet, norm_of_bounds
from robustid.guarantees.weight import UncertaintyWeight, entry_weights, magnitude_weight, uncertainty_weight
from robustid.guarantees.worst_case import LEAST, MOST, WorstCaseError, worst_case_error

__all__ = [
    "AMPLITUDE",
    "LEAST",
    "MOST",
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
    "as_frequencies",
    "box_of",
    "check_one_channel",
    "default_grid",
    "diameter",
    "entry_weights",
    "guaranteed_margin",
    "magnitude_weight",
    "norm_of_bounds",
    "refute",
    "response_tube",
    "uncertainty_weight",
    "worst_case_error",
    "worst_case_over_poles",
]

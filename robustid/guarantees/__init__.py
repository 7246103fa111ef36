"""Guarantees about every consistent plant: worst-case errors and responses with certificates, weights, margins."""

from robustid.guarantees import storage as storage  # registers the results that can be saved
from robustid.guarantees.bilinear import ControlPair
from robustid.guarantees.circle import CircleBound
from robustid.guarantees.diameter import Diameter, diameter
from robustid.guarantees.nominal import as_frequencies, check_siso, default_grid
from robustid.guarantees.over_poles import WorstCaseOverPoles, worst_case_over_poles
from robustid.guarantees.parameters import ParameterIntervals
from robustid.guarantees.pole_cells import AMPLITUDE, PoleCell, box_of
from robustid.guarantees.refute import Refutation, refute
from robustid.guarantees.stability_margin import MarginStatus, RobustStabilityMargin, robust_stability_margin
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
    "MarginStatus",
    "ParameterIntervals",
    "PoleCell",
    "Refutation",
    "ResponseTube",
    "RobustStabilityMargin",
    "UncertaintyWeight",
    "ValueSet",
    "WorstCaseError",
    "WorstCaseOverPoles",
    "as_frequencies",
    "box_of",
    "check_siso",
    "default_grid",
    "diameter",
    "entry_weights",
    "magnitude_weight",
    "norm_of_bounds",
    "refute",
    "response_tube",
    "robust_stability_margin",
    "uncertainty_weight",
    "worst_case_error",
    "worst_case_over_poles",
]

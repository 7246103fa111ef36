"""What is guaranteed: worst-case errors and responses with certificates, before and after the values are known."""

from robustid.certify.circle import CircleBound
from robustid.certify.diameter import Diameter, diameter
from robustid.certify.parameters import ParameterIntervals
from robustid.certify.refute import Refutation, refute
from robustid.certify.tubes import ResponseTube, response_tube
from robustid.certify.value_set import ValueSet
from robustid.certify.worst_case import WorstCaseError, worst_case_error

__all__ = [
    "CircleBound",
    "Diameter",
    "ParameterIntervals",
    "Refutation",
    "ResponseTube",
    "ValueSet",
    "WorstCaseError",
    "diameter",
    "refute",
    "response_tube",
    "worst_case_error",
]

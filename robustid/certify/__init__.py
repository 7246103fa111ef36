"""What is guaranteed: worst-case errors with certificates."""

from robustid.certify.circle import CircleBound
from robustid.certify.parameters import ParameterIntervals
from robustid.certify.storage import load_worst_case_error
from robustid.certify.value_set import ValueSet
from robustid.certify.worst_case import WorstCaseError, worst_case_error

__all__ = [
    "CircleBound",
    "ParameterIntervals",
    "ValueSet",
    "WorstCaseError",
    "load_worst_case_error",
    "worst_case_error",
]

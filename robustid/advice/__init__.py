"""What to choose: modes and prior from the data, and what to change where the data contradict the class."""

from robustid.advice.diagnosis import Diagnosis, Trial, diagnose
from robustid.advice.kautz import KautzSuggestion, suggest_kautz
from robustid.advice.prior import PriorSuggestion, suggest_prior

__all__ = [
    "Diagnosis",
    "KautzSuggestion",
    "PriorSuggestion",
    "Trial",
    "diagnose",
    "suggest_kautz",
    "suggest_prior",
]

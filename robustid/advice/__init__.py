"""What to choose: modes and prior from the data, what to change where the data contradict the class, what to measure next."""

from robustid.advice.diagnosis import Diagnosis, Trial, diagnose
from robustid.advice.kautz import KautzSuggestion, suggest_kautz
from robustid.advice.next_experiment import NextMeasurement, suggest_next
from robustid.advice.prior import PriorSuggestion, suggest_prior
from robustid.advice.sensitivity import Sensitivity, Variation, sensitivity

__all__ = [
    "Diagnosis",
    "KautzSuggestion",
    "NextMeasurement",
    "PriorSuggestion",
    "Sensitivity",
    "Trial",
    "Variation",
    "diagnose",
    "sensitivity",
    "suggest_kautz",
    "suggest_next",
    "suggest_prior",
]

"""Advice: modes and prior from the data, remedies where the data contradict the class, the next measurement."""

from robustid.advice.causes import SLIGHTLY, Cause
from robustid.advice.class_changes import missing_integrators
from robustid.advice.class_table import ClassCandidate, ClassSuggestion
from robustid.advice.content import Content, content
from robustid.advice.diagnosis import Diagnosis, diagnose
from robustid.advice.every_mode import every_mode
from robustid.advice.experiment_corrections import Experiment, experiments, without_experiments
from robustid.advice.gain_curve import SAFETY, computable_step, possible_rates
from robustid.advice.kautz import KautzSuggestion, suggest_kautz
from robustid.advice.kept_gains import KeptGains
from robustid.advice.model_class import suggest_class
from robustid.advice.moved_modes import moved_modes
from robustid.advice.next_experiment import NextMeasurement, suggest_next
from robustid.advice.pole_fit import tells_modes
from robustid.advice.pole_search import KautzImprovement, PoleTrial, improve_kautz
from robustid.advice.prior import PriorSuggestion, says_something, suggest_prior, useful_prior
from robustid.advice.prior_weight import prior_weight, suggest_roll_off
from robustid.advice.real_poles import HEAVY, RealPoles, slow_poles
from robustid.advice.scaling import suggest_scaling
from robustid.advice.sensitivity import Sensitivity, Variation, sensitivity
from robustid.advice.setups import common_modes
from robustid.advice.setups_result import CommonModes, Disagreement, Moved, disagreement_words, ends_words
from robustid.advice.smallest_gain import entry_sizes, response_sizes, typical_bound
from robustid.advice.suspect_experiments import Posed, contradiction_faults, suspect_experiments
from robustid.advice.suspect_modes import suspect_modes

__all__ = [
    "HEAVY",
    "SAFETY",
    "SLIGHTLY",
    "Cause",
    "ClassCandidate",
    "ClassSuggestion",
    "CommonModes",
    "Content",
    "Diagnosis",
    "Disagreement",
    "Experiment",
    "KautzImprovement",
    "KautzSuggestion",
    "KeptGains",
    "Moved",
    "NextMeasurement",
    "PoleTrial",
    "Posed",
    "PriorSuggestion",
    "RealPoles",
    "Sensitivity",
    "Variation",
    "common_modes",
    "computable_step",
    "content",
    "contradiction_faults",
    "diagnose",
    "disagreement_words",
    "ends_words",
    "entry_sizes",
    "every_mode",
    "experiments",
    "improve_kautz",
    "missing_integrators",
    "moved_modes",
    "possible_rates",
    "prior_weight",
    "response_sizes",
    "says_something",
    "sensitivity",
    "slow_poles",
    "suggest_class",
    "suggest_kautz",
    "suggest_next",
    "suggest_prior",
    "suggest_roll_off",
    "suggest_scaling",
    "suspect_experiments",
    "suspect_modes",
    "tells_modes",
    "typical_bound",
    "useful_prior",
    "without_experiments",
]

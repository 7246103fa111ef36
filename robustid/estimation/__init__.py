"""From records to responses, delays, noise levels and bounds; faults of data and their corrections."""

from robustid.estimation.corrections import correct
from robustid.estimation.default_bound import BOUND_SOURCES, default_bound, estimate_bound
from robustid.estimation.delay import Delay, DelayedModel, estimate_delay, with_delay
from robustid.estimation.faults import Fault, response_faults, response_problems
from robustid.estimation.frf import estimate_frf
from robustid.estimation.noise_floor import NoiseFloor, bounds_from_noise_floor
from robustid.estimation.pole_fit import PoleFit
from robustid.estimation.problems import REMOVED, found_period, record_problems

__all__ = [
    "BOUND_SOURCES",
    "REMOVED",
    "Delay",
    "DelayedModel",
    "Fault",
    "NoiseFloor",
    "PoleFit",
    "bounds_from_noise_floor",
    "correct",
    "default_bound",
    "estimate_bound",
    "estimate_delay",
    "estimate_frf",
    "found_period",
    "record_problems",
    "response_faults",
    "response_problems",
    "with_delay",
]

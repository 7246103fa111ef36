"""From records to responses, delays, noise levels and bounds; faults of data and their corrections."""

from robustid.estimation.corrections import MISTAKES, correct, leaving_out
from robustid.estimation.dead_time import delay_fault, most_delay
from robustid.estimation.default_bound import BOUND_SOURCES, default_bound, estimate_bound
from robustid.estimation.delay import Delay, DelayedModel, estimate_delay, with_delay
from robustid.estimation.experiment_faults import experiment_faults
from robustid.estimation.frf import estimate_frf, response_alone
from robustid.estimation.noise_floor import NoiseFloor, bounds_from_noise_floor
from robustid.estimation.pole_fit import PoleFit
from robustid.estimation.record_faults import operating_point, record_faults
from robustid.estimation.response_faults import all_faults, response_faults

__all__ = [
    "BOUND_SOURCES",
    "MISTAKES",
    "Delay",
    "DelayedModel",
    "NoiseFloor",
    "PoleFit",
    "all_faults",
    "bounds_from_noise_floor",
    "correct",
    "default_bound",
    "delay_fault",
    "estimate_bound",
    "estimate_delay",
    "estimate_frf",
    "experiment_faults",
    "leaving_out",
    "most_delay",
    "operating_point",
    "record_faults",
    "response_alone",
    "response_faults",
    "with_delay",
]

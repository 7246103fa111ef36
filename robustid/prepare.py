"""Records and responses before they are used: excitations, faults and corrections, delays, drifts, noise floors."""

from robustid.core import Signal, explain
from robustid.data import Fault, decimate, detrend, inverse_response, multisine, nonlinear_records, sample_time
from robustid.estimation import (
    bounds_from_noise_floor,
    correct,
    estimate_delay,
    experiment_faults,
    record_faults,
    response_faults,
    with_delay,
)
from robustid.identification import loop_response
from robustid.reduction import controller_model, loop_from_data

__all__ = [
    "Fault",
    "Signal",
    "bounds_from_noise_floor",
    "controller_model",
    "correct",
    "decimate",
    "detrend",
    "estimate_delay",
    "experiment_faults",
    "inverse_response",
    "loop_from_data",
    "loop_response",
    "multisine",
    "nonlinear_records",
    "record_faults",
    "response_faults",
    "sample_time",
    "with_delay",
]

explain(__name__, __all__)

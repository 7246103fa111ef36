"""Measurements: records and responses with bounds on their errors; files, data sets, estimation."""

from robustid.core import save
from robustid.data.bound import Bound, Caveat
from robustid.data.corrections import correct
from robustid.data.error_sets import bound_ratio, stacked, tilted
from robustid.data.estimate.default_bound import BOUND_SOURCES, default_bound, estimate_bound
from robustid.data.estimate.delay import Delay, DelayedModel, estimate_delay, with_delay
from robustid.data.estimate.frf import estimate_frf, first_response
from robustid.data.estimate.noise_floor import NoiseFloor, bounds_from_noise_floor
from robustid.data.estimate.pole_fit import PoleFit
from robustid.data.excitation import Excitation, multisine
from robustid.data.faults import Fault, response_faults, response_problems
from robustid.data.frequency_points import signal_index
from robustid.data.frequency_response import FrequencyResponse, as_frequency_response
from robustid.data.io import datasets
from robustid.data.io.excitation_files import load_excitation
from robustid.data.nonlinear import NONLINEAR, nonlinear_records
from robustid.data.prepare import decimate, detrend, sample_time
from robustid.data.problems import REMOVED, found_period, record_problems
from robustid.data.simulated import SimulatedExperiment, flexible_structure
from robustid.data.tangential import TangentialResponse
from robustid.data.time_record import INITIAL, PAST, TimeRecord, as_records

__all__ = [
    "BOUND_SOURCES",
    "INITIAL",
    "NONLINEAR",
    "PAST",
    "REMOVED",
    "Bound",
    "Caveat",
    "Delay",
    "DelayedModel",
    "Excitation",
    "Fault",
    "FrequencyResponse",
    "NoiseFloor",
    "PoleFit",
    "SimulatedExperiment",
    "TangentialResponse",
    "TimeRecord",
    "as_frequency_response",
    "as_records",
    "bound_ratio",
    "bounds_from_noise_floor",
    "correct",
    "datasets",
    "decimate",
    "default_bound",
    "detrend",
    "estimate_bound",
    "estimate_delay",
    "estimate_frf",
    "first_response",
    "flexible_structure",
    "found_period",
    "load_excitation",
    "multisine",
    "nonlinear_records",
    "record_problems",
    "response_faults",
    "response_problems",
    "sample_time",
    "save",
    "signal_index",
    "stacked",
    "tilted",
    "with_delay",
]

"""What was measured: records and responses with bounds on their errors; files, data sets, estimation."""

from robustid.data import datasets
from robustid.data.conditioning import decimate, detrend, record_problems, sample_time
from robustid.data.delay import Delay, DelayedModel, estimate_delay, with_delay
from robustid.data.excitation import Excitation, multisine
from robustid.data.excitation_files import load_excitation
from robustid.data.files import load, save
from robustid.data.frequency_response import FrequencyResponse
from robustid.data.frf import estimate_frf
from robustid.data.rest import RestNoise, bounds_from_rest
from robustid.data.simulated import SimulatedExperiment, flexible_structure
from robustid.data.tangential import TangentialResponse
from robustid.data.time_record import TimeRecord

__all__ = [
    "Delay",
    "DelayedModel",
    "Excitation",
    "FrequencyResponse",
    "RestNoise",
    "SimulatedExperiment",
    "TangentialResponse",
    "TimeRecord",
    "bounds_from_rest",
    "datasets",
    "decimate",
    "detrend",
    "estimate_delay",
    "estimate_frf",
    "flexible_structure",
    "load",
    "load_excitation",
    "multisine",
    "record_problems",
    "sample_time",
    "save",
    "with_delay",
]

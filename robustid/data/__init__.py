"""What was measured: records and responses with bounds on their errors; files, data sets, estimation."""

from robustid.data import datasets
from robustid.data.conditioning import decimate, detrend, record_problems, sample_time
from robustid.data.files import load, save
from robustid.data.frequency_response import FrequencyResponse
from robustid.data.periodic import estimate_frf
from robustid.data.rest import RestNoise, bounds_from_rest
from robustid.data.simulated import SimulatedExperiment, flexible_structure
from robustid.data.time_record import TimeRecord

__all__ = [
    "FrequencyResponse",
    "RestNoise",
    "SimulatedExperiment",
    "TimeRecord",
    "bounds_from_rest",
    "datasets",
    "decimate",
    "detrend",
    "estimate_frf",
    "flexible_structure",
    "load",
    "record_problems",
    "sample_time",
    "save",
]

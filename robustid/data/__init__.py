"""What was measured: records and responses with bounds on their errors; files, data sets, estimation."""

from robustid.data import datasets
from robustid.data.excitation import Excitation, multisine
from robustid.data.excitation_files import load_excitation
from robustid.data.files import load, save
from robustid.data.frequency_response import FrequencyResponse
from robustid.data.frf import estimate_frf
from robustid.data.simulated import SimulatedExperiment, flexible_structure
from robustid.data.time_record import TimeRecord

__all__ = [
    "Excitation",
    "FrequencyResponse",
    "SimulatedExperiment",
    "TimeRecord",
    "datasets",
    "estimate_frf",
    "flexible_structure",
    "load",
    "load_excitation",
    "multisine",
    "save",
]

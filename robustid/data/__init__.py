"""Measurements: records and responses with bounds on their errors; excitations and preparation."""

from robustid.core import save, stored
from robustid.data.bound import PROBABLE, Bound, Caveat
from robustid.data.bound_checks import as_probability
from robustid.data.error_sets import bound_ratio, chance_beyond, joint_radius, stacked, tilted, variances
from robustid.data.excitation import Excitation, multisine
from robustid.data.faults import Fault, FaultKind, PlacedFault, Undoing, as_faults
from robustid.data.feedthrough import FeedThrough, expected_feedthrough
from robustid.data.frequency_points import NYQUIST_SLACK, SAME_FREQUENCY, FrequencyPoints, points_at, signal_index
from robustid.data.frequency_response import FrequencyResponse, as_frequency_response
from robustid.data.inverse_response import inverse_response
from robustid.data.nonlinear import NONLINEAR, nonlinear_records
from robustid.data.prepare import (
    FEW,
    clock_scatter,
    decimate,
    detrend,
    longest_part,
    named_part,
    sample_time,
    uniform_step,
)
from robustid.data.response_parts import ENTRIES, LEVELS
from robustid.data.simulated import SimulatedExperiment, flexible_structure
from robustid.data.tangential import TangentialResponse
from robustid.data.time_record import INITIAL, PAST, TimeRecord, as_records

stored(Bound, Caveat, Fault, FaultKind, FrequencyResponse, TangentialResponse, TimeRecord)

__all__ = [
    "ENTRIES",
    "FEW",
    "INITIAL",
    "LEVELS",
    "NONLINEAR",
    "NYQUIST_SLACK",
    "PAST",
    "PROBABLE",
    "SAME_FREQUENCY",
    "Bound",
    "Caveat",
    "Excitation",
    "Fault",
    "FaultKind",
    "FeedThrough",
    "FrequencyPoints",
    "FrequencyResponse",
    "PlacedFault",
    "SimulatedExperiment",
    "TangentialResponse",
    "TimeRecord",
    "Undoing",
    "as_faults",
    "as_frequency_response",
    "as_probability",
    "as_records",
    "bound_ratio",
    "chance_beyond",
    "clock_scatter",
    "decimate",
    "detrend",
    "expected_feedthrough",
    "flexible_structure",
    "inverse_response",
    "joint_radius",
    "longest_part",
    "multisine",
    "named_part",
    "nonlinear_records",
    "points_at",
    "sample_time",
    "save",
    "signal_index",
    "stacked",
    "tilted",
    "uniform_step",
    "variances",
]

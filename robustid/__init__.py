"""Models with a proof: robust identification of lightly damped machines from time and frequency data."""

from robustid._arrays import Channel
from robustid._version import __version__
from robustid.advice import diagnose, suggest_kautz, suggest_prior
from robustid.bases import ParametricBasis, kautz
from robustid.certify import WorstCaseError, load_worst_case_error, worst_case_error
from robustid.data import (
    FrequencyResponse,
    TimeRecord,
    datasets,
    estimate_frf,
    flexible_structure,
    load,
    save,
)
from robustid.errors import (
    DatasetNotFoundError,
    FileFormatError,
    InconsistentDataError,
    InputError,
    InputTypeError,
    RobustIdError,
    SizeError,
    SolverError,
    Status,
)
from robustid.identification import Identification, identify, load_identification, validate
from robustid.interpolation import MixedProblem, Prior
from robustid.mfd import (
    MatrixFraction,
    OrderSweep,
    RigidBody,
    RollOff,
    StaticGain,
    Weight,
    Zero,
    ZeroEntries,
    fit_covariance,
    fit_mfd,
    modal_form,
    mode_table,
    suggest_order,
)
from robustid.reduction import balanced_truncation, reduce_within_bounds, to_continuous
from robustid.report import write_report

__all__ = [
    "Channel",
    "DatasetNotFoundError",
    "FileFormatError",
    "FrequencyResponse",
    "Identification",
    "InconsistentDataError",
    "InputError",
    "InputTypeError",
    "MatrixFraction",
    "MixedProblem",
    "OrderSweep",
    "ParametricBasis",
    "Prior",
    "RigidBody",
    "RobustIdError",
    "RollOff",
    "SizeError",
    "SolverError",
    "StaticGain",
    "Status",
    "TimeRecord",
    "Weight",
    "WorstCaseError",
    "Zero",
    "ZeroEntries",
    "__version__",
    "balanced_truncation",
    "datasets",
    "diagnose",
    "estimate_frf",
    "fit_covariance",
    "fit_mfd",
    "flexible_structure",
    "identify",
    "kautz",
    "load",
    "load_identification",
    "load_worst_case_error",
    "modal_form",
    "mode_table",
    "reduce_within_bounds",
    "save",
    "suggest_kautz",
    "suggest_order",
    "suggest_prior",
    "to_continuous",
    "validate",
    "worst_case_error",
    "write_report",
]

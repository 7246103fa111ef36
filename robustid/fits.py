"""Structure and results of fits: exact conditions, weights, modes, orders, covariances."""

from robustid.core import explain
from robustid.fitting import (
    MatrixFraction,
    Modal,
    RecordFit,
    RollOff,
    StaticGain,
    Weight,
    Zero,
    ZeroEntries,
    fit_covariance,
    modal_form,
    mode_table,
    suggest_order,
)

__all__ = [
    "MatrixFraction",
    "Modal",
    "RecordFit",
    "RollOff",
    "StaticGain",
    "Weight",
    "Zero",
    "ZeroEntries",
    "fit_covariance",
    "modal_form",
    "mode_table",
    "suggest_order",
]

explain(__name__, __all__)

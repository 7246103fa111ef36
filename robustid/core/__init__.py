"""What every room needs: validation, frozen values, files, workers, threads, simulation."""

from robustid.core.files import atomic_write
from robustid.core.simulation import response, responses, simulate, transfer
from robustid.core.threads import threads_for
from robustid.core.validation import (
    Frozen,
    Signal,
    as_array,
    as_bound,
    as_count,
    as_float,
    as_positive,
    as_signals,
    freeze,
)
from robustid.core.workers import Workers, worker_pool

__all__ = [
    "Frozen",
    "Signal",
    "Workers",
    "as_array",
    "as_bound",
    "as_count",
    "as_float",
    "as_positive",
    "as_signals",
    "atomic_write",
    "freeze",
    "response",
    "responses",
    "simulate",
    "threads_for",
    "transfer",
    "worker_pool",
]

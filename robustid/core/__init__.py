"""What every room needs: validation, frozen values, files, workers, threads, simulation."""

from robustid.core.files import atomic_write
from robustid.core.simulation import response, responses, simulate, transfer
from robustid.core.threads import threads_for
from robustid.core.validation import (
    Channel,
    Frozen,
    as_array,
    as_bound,
    as_channels,
    as_count,
    as_float,
    as_positive,
    freeze,
)
from robustid.core.workers import Workers, worker_pool

__all__ = [
    "Channel",
    "Frozen",
    "Workers",
    "as_array",
    "as_bound",
    "as_channels",
    "as_count",
    "as_float",
    "as_positive",
    "atomic_write",
    "freeze",
    "response",
    "responses",
    "simulate",
    "threads_for",
    "transfer",
    "worker_pool",
]

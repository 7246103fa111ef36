"""Tools of every room: validation, frozen values, files, saving, workers, threads, simulation."""

from robustid.core.files import atomic_write
from robustid.core.simulation import response, responses, simulate, transfer
from robustid.core.storage import (
    Arrays,
    Record,
    describe,
    digest,
    keep,
    load_saved,
    part,
    paths,
    read_arrays,
    rebuild,
    save,
    saved_kind,
    text_array,
    under,
    written_by,
)
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
    "Arrays",
    "Frozen",
    "Record",
    "Signal",
    "Workers",
    "as_array",
    "as_bound",
    "as_count",
    "as_float",
    "as_positive",
    "as_signals",
    "atomic_write",
    "describe",
    "digest",
    "freeze",
    "keep",
    "load_saved",
    "part",
    "paths",
    "read_arrays",
    "rebuild",
    "response",
    "responses",
    "save",
    "saved_kind",
    "simulate",
    "text_array",
    "threads_for",
    "transfer",
    "under",
    "worker_pool",
    "written_by",
]

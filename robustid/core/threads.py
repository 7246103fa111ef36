"""Number of threads that the linear algebra library may use."""

from __future__ import annotations

import contextlib
import functools
import importlib
from collections.abc import Generator
from typing import Any

_SMALL = 400  # below, threads of OpenBLAS wait for one another longer than they work: 2 to 5 times slower than one
_LIMITS: list[Any] = []  # of those `one_thread` that are open; as the number of threads, they are the process's


@contextlib.contextmanager
def one_thread() -> Generator[None, None, None]:
    """One thread, also as a decorator: for work on many small blocks, which never wait for a pool then."""
    with _one() as limits:
        _LIMITS.append(limits)
        try:
            yield
        finally:
            _LIMITS.pop()


@contextlib.contextmanager
def threads_for(size: int) -> Generator[None, None, None]:
    """One thread for matrices of a small size, as many as are set for large ones, also where `one_thread` is open around them."""
    if size < _SMALL:
        with one_thread():
            yield
    elif _LIMITS:
        _LIMITS[0].restore_original_limits()
        try:
            yield
        finally:
            _one()
    else:
        yield


def _one() -> Any:
    """The limit, from now on."""
    return _libraries().limit(limits=1)


@functools.cache
def _libraries() -> Any:
    """The linear algebra libraries of NumPy and of SciPy, found once: to look through all that is loaded takes milliseconds."""
    import threadpoolctl  # type: ignore[reportMissingTypeStubs]

    importlib.import_module("scipy.linalg")  # loads its own
    everything: Any = threadpoolctl.ThreadpoolController()
    return everything.select(user_api="blas")

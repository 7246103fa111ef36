"""Number of threads that the linear algebra library may use."""

from __future__ import annotations

import contextlib
from collections.abc import Generator

_SMALL = 400  # below, threads of OpenBLAS wait for one another longer than they work: 2 to 5 times slower than one


@contextlib.contextmanager
def one_thread() -> Generator[None, None, None]:
    """One thread, also as a decorator: for work on many small blocks, which never wait for a pool then."""
    import threadpoolctl  # type: ignore[reportMissingTypeStubs]

    with threadpoolctl.threadpool_limits(limits=1, user_api="blas"):
        yield


@contextlib.contextmanager
def threads_for(size: int) -> Generator[None, None, None]:
    """One thread for matrices of a small size, as many as are set for large ones."""
    with contextlib.nullcontext() if size >= _SMALL else one_thread():
        yield

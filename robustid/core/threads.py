"""Number of threads that the linear algebra library may use: one, unless cores are idle that large matrices can use."""

from __future__ import annotations

import contextlib
import functools
import importlib
import os
import pathlib
import time
from collections.abc import Generator
from typing import Any, ClassVar

_SMALL = 400  # below, threads of OpenBLAS wait for one another longer than they work: 2 to 5 times slower than one
_LOOK, _KNOWN = 0.1, 10.0  # seconds that a look at the cores takes, and for which it counts
_NEARLY = 0.25  # of a core: a core that is busy so much is idle; the look itself counts in hundredths of a second
_COUNTS, _IDLE = pathlib.Path("/proc/stat"), slice(3, 5)  # of Linux; columns of the time without work
_QUOTA = pathlib.Path("/sys/fs/cgroup/cpu.max")


class _State:
    """The threads of the process: those of the open limits, the number that was set outside of them, the last look."""

    open: ClassVar[list[int]] = []
    most = 1
    idle, seen = 1, -_KNOWN


@contextlib.contextmanager
def one_thread() -> Generator[None, None, None]:
    """One thread, also as a decorator: for work on many small blocks, which never wait for a pool then."""
    with _limited(1):
        yield


@contextlib.contextmanager
def threads_for(size: int) -> Generator[None, None, None]:
    """One thread; for matrices of a large size as many as cores are idle, at most those that are set, also inside `one_thread`.

    Threads that share a core wait for each other, for longer than they work: beside busy processes a call took six times the time.
    """
    with _limited(1 if size < _SMALL else None):
        yield


@contextlib.contextmanager
def _limited(count: int | None) -> Generator[None, None, None]:
    """So many threads; None: as many as cores are idle, of those that were set outside of all limits."""
    libraries = _libraries()
    if not _State.open:
        _State.most = max((one.num_threads for one in libraries.lib_controllers), default=1)
    wanted = count or (min(_State.most, idle_cores()) if _State.most > 1 else 1)
    # To set them takes a tenth of a millisecond: as long as a small system of equations.
    limit = None if _State.open and _State.open[-1] == wanted else libraries.limit(limits=wanted)
    _State.open.append(wanted)
    try:
        yield
    finally:
        _State.open.pop()
        if limit is not None:
            limit.restore_original_limits()


def idle_cores() -> int:
    """Number of cores that nobody uses, one at least, from a look at them that counts for ten seconds.

    While this process waits: on Linux from the counters of the cores that it may use, elsewhere from the mean load of the last
    minute (its own work counts there too). One where the platform tells neither.
    """
    now = time.monotonic()
    if now - _State.seen >= _KNOWN:
        _State.idle = max(1, int(_look()))
        _State.seen = time.monotonic()
    return _State.idle


def _look() -> float:
    """Number of idle cores, as they are seen now."""
    before = _counters()
    if before is None:
        try:
            return (os.cpu_count() or 1) - os.getloadavg()[0] + _NEARLY
        except (AttributeError, OSError):
            return 1.0
    time.sleep(_LOOK)
    after = _counters() or {}
    parts = [_idle_part(counts, after[core]) for core, counts in before.items() if core in after]
    return min(sum(parts), _quota()) + _NEARLY


def _idle_part(before: list[int], after: list[int]) -> float:
    """Part of the time between two readings of a core in which it had nothing to do; 0 where nothing was counted."""
    spent = [b - a for a, b in zip(before, after, strict=False)]
    return sum(spent[_IDLE]) / sum(spent) if sum(spent) > 0 else 0.0


def _counters() -> dict[str, list[int]] | None:
    """Times that the cores which this process may use have spent in every way, since the start; None where they aren't told."""
    try:
        mine = {f"cpu{core}" for core in os.sched_getaffinity(0)}
        lines = [line.split() for line in _COUNTS.read_text().splitlines()]
        return {name: [int(one) for one in counts[:8]] for name, *counts in lines if name in mine} or None
    except (AttributeError, OSError, ValueError):
        return None


def _quota() -> float:
    """Cores that a container may use in all; inf without a limit."""
    try:
        quota, period = _QUOTA.read_text().split()
        return int(quota) / int(period)
    except (OSError, ValueError):
        return float("inf")


@functools.cache
def _libraries() -> Any:
    """The linear algebra libraries of NumPy and of SciPy, found once: to look through all that is loaded takes milliseconds."""
    import threadpoolctl  # type: ignore[reportMissingTypeStubs]

    importlib.import_module("scipy.linalg")  # loads its own
    everything: Any = threadpoolctl.ThreadpoolController()
    return everything.select(user_api="blas")

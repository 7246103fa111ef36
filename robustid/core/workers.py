"""Processes that work on items, and what happens to the items of those that die."""

from __future__ import annotations

import concurrent.futures
import logging
import multiprocessing
import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from multiprocessing.process import BaseProcess
from types import TracebackType
from typing import TypeVar

from robustid.errors import InputTypeError, RobustIdError, SolverError

_log = logging.getLogger("robustid")

Item = TypeVar("Item")
Result = TypeVar("Result")

_ATTEMPTS = 3
_KEPT: list[object] = []  # limits of threads end when their object does


class _Pool(ProcessPoolExecutor):
    """Ended at once by an exception in its `with` block, Ctrl-C for instance."""

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is not None:
            self.end()
        super().__exit__(kind, value, trace)

    def end(self) -> None:
        """Whatever the processes are doing, they end."""
        processes: dict[int, BaseProcess] = getattr(self, "_processes", None) or {}
        for process in list(processes.values()):
            process.terminate()
        self.shutdown(cancel_futures=True)


def worker_pool(count: int | None = None) -> _Pool:
    """So many processes (default: a process for every core) that share the cores, and leave Ctrl-C to this one."""
    cores = os.cpu_count() or 1
    count = count or cores
    # Not forked: a process with threads, such as that of a progress display, must not be.
    context = multiprocessing.get_context("spawn")
    return _Pool(count, context, _start, (max(1, cores // count),))


def _start(threads: int) -> None:
    import threadpoolctl  # type: ignore[reportMissingTypeStubs]

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    _KEPT.append(threadpoolctl.threadpool_limits(limits=threads))
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """End a worker whose parent was killed: it would wait for items for ever."""
    if (parent := multiprocessing.parent_process()) is not None:
        parent.join()
        os._exit(1)


class Workers:
    """An executor, or a pool of one's own, replaced when it breaks; used in a `with` block.

    Parameters
    ----------
    executor : Executor or int
        A number: so many processes of our own.
    """

    def __init__(self, executor: Executor | int):
        self._own: _Pool | None = None
        if not isinstance(executor, Executor):
            executor = self._own = worker_pool(_count(executor))
        self._executor = executor
        count = getattr(self._executor, "_max_workers", None)
        # Those in flight are lost with a pool that breaks: no more of them than keep its workers busy.
        self._most = 2 * count if isinstance(count, int) else float("inf")

    def __enter__(self) -> Workers:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._own is not None:
            self._own.__exit__(kind, value, trace)

    def run(
        self,
        function: Callable[..., Result],
        shared: tuple[object, ...],
        items: Sequence[Item],
        name: Callable[[Item], str],
    ) -> Iterator[tuple[Item, Result]]:
        """(item, function(*shared, item)) as they end; one whose worker fails is tried again, three times in all.

        `name` says in messages which one it is.

        One that failed runs alone when it is tried again, so that none is blamed for what another one does to a pool.

        Raises
        ------
        SolverError
            An item failed every time.
        """
        waiting = deque((item, 0) for item in items)
        running: dict[Future[Result], tuple[Item, int]] = {}
        try:
            while waiting or running:
                while waiting and self._room(waiting[0][1], running):
                    item, failures = waiting.popleft()
                    running[self._submit(function, *shared, item)] = item, failures
                done, _ = concurrent.futures.wait(running, return_when=concurrent.futures.FIRST_COMPLETED)
                failed: list[tuple[Item, int, BaseException]] = []
                for future in done:
                    item, failures = running.pop(future)
                    error = _error(future)
                    if error is None:
                        yield item, future.result()
                    else:
                        failed.append((item, failures + 1, error))
                waiting += [_again(*entry, name(entry[0])) for entry in failed]
                # Those that failed come last: alone, they keep the others waiting.
                waiting = deque(sorted(waiting, key=lambda entry: entry[1]))
        finally:
            for future in running:
                future.cancel()

    def _room(self, failures: int, running: dict[Future[Result], tuple[Item, int]]) -> bool:
        alone = failures or any(f for _, f in running.values())
        return len(running) < (1 if alone else self._most)

    def _submit(self, function: Callable[..., Result], *arguments: object) -> Future[Result]:
        try:
            return self._executor.submit(function, *arguments)
        except concurrent.futures.BrokenExecutor:
            if not isinstance(self._executor, ProcessPoolExecutor):
                raise
        count = getattr(self._executor, "_max_workers", None)
        if self._own is not None:
            self._own.end()
        self._executor = self._own = worker_pool(count)
        return self._executor.submit(function, *arguments)


def _count(processes: object) -> int:
    if isinstance(processes, bool) or not isinstance(processes, int) or processes < 1:
        raise InputTypeError(
            f"`executor` must be a concurrent.futures.Executor, or a number of processes of at least 1; got {processes!r}"
        )
    return processes


def _error(future: Future[Result]) -> BaseException | None:
    try:
        return future.exception()
    except concurrent.futures.CancelledError as error:  # by a cluster that is gone
        return error


def _again(item: Item, failures: int, error: BaseException, name: str) -> tuple[Item, int]:
    """An item that failed, with the number of its failures, where one more may follow."""
    if isinstance(error, RobustIdError) or not isinstance(error, Exception):
        raise error
    what = f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
    if failures >= _ATTEMPTS:
        raise SolverError(f"{name} failed {_ATTEMPTS} times; at last: {what}") from error
    _log.warning("%s failed and is tried again (%s)", name, what)
    return item, failures

"""Processes that work on items, and what happens to the items of those that die."""

from __future__ import annotations

import concurrent.futures
import itertools
import logging
import multiprocessing
import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from multiprocessing.process import BaseProcess
from types import TracebackType
from typing import Any, TypeVar

from robustid.core.cluster_calls import is_dask, with_every_end
from robustid.errors import InputTypeError, RobustIdError, SolverError

_log = logging.getLogger("robustid")

Item = TypeVar("Item")
Result = TypeVar("Result")

_ATTEMPTS = 3
_KEPT: list[object] = []  # limits of threads end when their object does


class _Process(ProcessPoolExecutor):
    """One process; not forked, since a process with threads, such as that of a progress display, must not be."""

    def __init__(self, threads: int) -> None:
        super().__init__(1, multiprocessing.get_context("spawn"), _start, (threads,))

    def end(self) -> None:
        """Whatever the process is doing, it ends."""
        processes: dict[int, BaseProcess] = getattr(self, "_processes", None) or {}
        for process in list(processes.values()):
            process.terminate()
        self.shutdown(cancel_futures=True)


class WorkerPool(Executor):
    """So many processes that share the cores: one that dies takes its own items with it, no others, and is replaced.

    Ended at once by an exception in its `with` block, Ctrl-C for instance.
    """

    def __init__(self, count: int) -> None:
        self._max_workers = count
        self._threads = max(1, (os.cpu_count() or 1) // count)
        self._processes = [_Process(self._threads) for _ in range(count)]
        self._given: list[list[Future[Any]]] = [[] for _ in range(count)]

    def submit(self, function: Callable[..., Result], /, *arguments: Any, **named: Any) -> Future[Result]:
        """Give a call to the process with the fewest."""
        self._given = [[one for one in given if not one.done()] for given in self._given]
        k = min(range(self._max_workers), key=lambda number: len(self._given[number]))
        try:
            future = self._processes[k].submit(function, *arguments, **named)
        except concurrent.futures.BrokenExecutor:
            self._processes[k].end()
            self._processes[k] = _Process(self._threads)
            future = self._processes[k].submit(function, *arguments, **named)
        self._given[k].append(future)
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Let every process end."""
        for process in self._processes:
            process.shutdown(wait, cancel_futures=cancel_futures)

    def end(self) -> None:
        """Whatever its processes are doing, they end: nobody waits for what is left."""
        for process in self._processes:
            process.end()

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> bool | None:
        if kind is not None:
            self.end()
        return super().__exit__(kind, value, trace)


def worker_pool(count: int | None = None) -> WorkerPool:
    """So many processes (default: a process for every core) that share the cores, and leave Ctrl-C to this one."""
    return WorkerPool(count or os.cpu_count() or 1)


def _start(threads: int) -> None:
    import threadpoolctl  # type: ignore[reportMissingTypeStubs]

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    _KEPT.append(threadpoolctl.threadpool_limits(limits=threads))


def _end_with_parent() -> None:
    """End this process at once when the one that started it is gone: nobody would take its results."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


class Workers:
    """An executor, or a pool of one's own; used in a `with` block.

    Parameters
    ----------
    executor : Executor or int
        A number: so many processes of our own.
    most : int, optional
        Items that are given to it at a time; default: what keeps its workers busy, where it says how many it has.
    """

    def __init__(self, executor: Executor | int, most: int | None = None):
        self._own: WorkerPool | None = None
        if not isinstance(executor, Executor):
            executor = self._own = worker_pool(_count(executor))
        self._executor = with_every_end(executor)
        count = getattr(executor, "_max_workers", None)
        if isinstance(count, int):
            # Those in flight are lost with a pool that breaks: no more of them than keep its workers busy.
            most = most or (count if isinstance(executor, WorkerPool) else 2 * count)
        self._most = most or float("inf")
        # Of Dask, too, a worker that dies takes no items of others with it.
        self._apart = isinstance(executor, WorkerPool) or is_dask(executor)

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
        items: Iterable[Item],
        name: Callable[[Item], str],
        lost: Callable[[Item, SolverError], Result] | None = None,
    ) -> Iterator[tuple[Item, Result]]:
        """(item, function(*shared, item)) as they end; one whose worker fails is tried again, three times in all.

        `name` says in messages which one it is; `lost` is what stands for an item that failed every time.

        One that failed comes last when it is tried again, and runs alone where a worker that dies takes the items of others with
        it: so none is blamed for what another one does to a pool.
        SolverError: an item failed every time, and there is no `lost`.
        """
        fresh, again = iter(items), deque[tuple[Item, int]]()
        running: dict[Future[Result], tuple[Item, int]] = {}
        try:
            while True:
                for entry in self._next(fresh, again, running):
                    running[self._submit(function, *shared, entry[0])] = entry
                if not running:
                    return
                done, _ = concurrent.futures.wait(running, return_when=concurrent.futures.FIRST_COMPLETED)
                failed: list[tuple[Item, int, BaseException]] = []
                for future in done:
                    item, failures = running.pop(future)
                    error = _error(future)
                    if error is None:
                        yield item, future.result()
                    else:
                        failed.append((item, failures + 1, error))
                for item, failures, error in failed:
                    try:
                        again.append(_again(item, failures, error, name(item)))
                    except SolverError as given_up:
                        if lost is None or isinstance(error, RobustIdError):
                            raise
                        yield item, lost(item, given_up)
        finally:
            for future in running:
                future.cancel()

    def _next(
        self, fresh: Iterator[Item], again: deque[tuple[Item, int]], running: dict[Future[Result], tuple[Item, int]]
    ) -> Iterator[tuple[Item, int]]:
        """Items that there is room for: fresh ones, then those that failed."""
        while len(running) < self._most and (self._apart or not any(failures for _, failures in running.values())):
            for item in itertools.islice(fresh, 1):
                yield item, 0
                break
            else:
                if not again or (running and not self._apart):
                    return
                yield again.popleft()

    def _submit(self, function: Callable[..., Result], *arguments: object) -> Future[Result]:
        try:
            return self._executor.submit(function, *arguments)
        except concurrent.futures.BrokenExecutor:
            if not isinstance(self._executor, ProcessPoolExecutor):
                raise
        # One that was given to us is replaced by our own.
        self._executor = self._own = worker_pool(getattr(self._executor, "_max_workers", None))
        self._apart = True
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

"""Value sets at many frequencies, spread over any executor."""

from __future__ import annotations

import concurrent.futures
import logging
from collections.abc import Callable, Iterator

import numpy as np

from robustid.certify.consistent_set import ConsistentSet
from robustid.certify.value_set import ValueSet, value_set
from robustid.solve import threads_for

_log = logging.getLogger("robustid")

Progress = Callable[[int, int], None]


def value_sets(
    consistent: ConsistentSet,
    omega: np.ndarray,
    directions: int,
    gap: float,
    executor: concurrent.futures.Executor | None = None,
    progress: Progress | None = None,
) -> list[ValueSet]:
    """The value set at each frequency, in their order; `progress` is called with (done, all)."""
    done = []
    for count, found in enumerate(_each(consistent, omega, directions, gap, executor), start=1):
        done.append(found)
        if progress is not None:
            progress(count, omega.size)
    return done


def _each(
    consistent: ConsistentSet,
    omega: np.ndarray,
    directions: int,
    gap: float,
    executor: concurrent.futures.Executor | None,
) -> Iterator[ValueSet]:
    if executor is None:
        for w in omega:
            yield _one(consistent, float(w), directions, gap)
        return
    futures = [executor.submit(_one, consistent, float(w), directions, gap) for w in omega]
    for future in futures:
        yield future.result()


def _one(consistent: ConsistentSet, omega: float, directions: int, gap: float) -> ValueSet:
    with threads_for(consistent.data.sarason.pair.order):
        return value_set(consistent, omega, directions, gap)

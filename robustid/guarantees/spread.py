"""Many questions about one consistent set: in this process, or over any executor."""

from __future__ import annotations

import functools
import pickle
from collections.abc import Callable, Generator, Hashable, Iterable
from concurrent.futures import Executor
from typing import TypeVar

from robustid.core import Workers, threads_for
from robustid.guarantees.consistent_set import ConsistentSet

Spread = Executor | int | None  # over any executor, over so many processes of our own, or in this process

Asked = TypeVar("Asked", bound=Hashable)
Found = TypeVar("Found")


def spread(
    ask: Callable[[ConsistentSet, Asked], Found],
    consistent: ConsistentSet,
    wanted: Iterable[Asked],
    executor: Spread,
    name: Callable[[Asked], str],
) -> Generator[tuple[Asked, Found]]:
    """(question, answer) as they are found; `ask` is a function of a module, or a partial of one, `name` a question in words."""
    wanted = list(wanted)
    if executor is None or not wanted:
        for one in wanted:
            yield one, _limited(ask, consistent, one)
        return
    # Packed once, and unpacked once by every worker: what it derives from the arrays serves all its questions.
    packed = pickle.dumps(consistent)
    with Workers(executor) as workers:
        yield from workers.run(_packed, (ask, packed), wanted, name)


def _limited(ask: Callable[[ConsistentSet, Asked], Found], consistent: ConsistentSet, one: Asked) -> Found:
    with threads_for(consistent.data.sarason.pair.order):
        return ask(consistent, one)


def _packed(ask: Callable[[ConsistentSet, Asked], Found], packed: bytes, one: Asked) -> Found:
    return _limited(ask, _unpacked(packed), one)


@functools.lru_cache(maxsize=2)
def _unpacked(packed: bytes) -> ConsistentSet:
    return pickle.loads(packed)

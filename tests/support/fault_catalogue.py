"""Catalogue of faults of measurements in three strengths: what makes each from clean data, and which kinds name it.

`CATALOGUE` maps a name to a `Fault`; `Fault.of(clean, strength, rng)` gives the measurements with the fault, None where the plant
has nothing of the kind. Strengths: "clear", "limit" (of what can be seen), "harmless" (below every bound, or no fault).
"""

import dataclasses
from collections.abc import Callable
from typing import Any, NamedTuple

import robustid as rid
from support.fault_plants import Clean

STRENGTHS = ("clear", "limit", "harmless")


class Faulty(NamedTuple):
    """What a user has: records (with their period, if stated), a response, or a response and a record of a step."""

    records: tuple[rid.TimeRecord, ...] = ()
    period: int | None = None
    response: rid.FrequencyResponse | None = None
    step: rid.TimeRecord | None = None


@dataclasses.dataclass(frozen=True)
class Fault:
    """A fault: kinds of `FaultKind` that name it, the corrections that undo it, and its sizes.

    Attributes
    ----------
    corrections : tuple of str
        Beginnings of corrections one of which the finding has to give; () where only words say what to measure.
    """

    name: str
    on: str
    kinds: tuple[str, ...]
    corrections: tuple[str, ...]
    sizes: tuple[Any, ...]
    make: Callable[..., Any]

    def of(self, clean: Clean, strength: str, rng):
        size = self.sizes[STRENGTHS.index(strength)]
        if size is None:
            return None
        match self.on:
            case "periodic" | "random":
                given = clean.periodic if self.on == "periodic" else clean.random
                made = self.make(clean, given, size, rng) if given else None
                period = clean.period if self.on == "periodic" else None
                return made if made is None or isinstance(made, Faulty) else Faulty(tuple(made), period)
            case "response":
                made = self.make(clean, clean.response, size, rng)
                return None if made is None else Faulty(response=made)
            case _:
                made = None if clean.step is None else self.make(clean, clean.step, size, rng)
                return None if made is None else Faulty(response=clean.response, step=made)


CATALOGUE: dict[str, Fault] = {}


def fault(name, on, kinds, sizes, corrections=()):
    """Enter a fault into the catalogue; `on` names what it is in: periodic, random, response, step; several share what makes it."""

    def enter(make):
        for one in on.split():
            full = name if len(on.split()) == 1 else f"{name} ({one})"
            CATALOGUE[full] = Fault(full, one, tuple(kinds.split(", ")), tuple(corrections), tuple(sizes), make)
        return make

    return enter


def changed(one, **signals):
    return dataclasses.replace(one, **signals)


def first(given, change):
    """The records, the first of them changed."""
    return [change(given[0]), *given[1:]]


def output(one, change, channel=0):
    """The record with one output changed."""
    y = one.y.copy()
    y[:, channel] = change(y[:, channel])
    return changed(one, y=y)

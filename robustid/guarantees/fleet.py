"""Fleet: the runs of many machines as rows, and which of them stand out."""

from __future__ import annotations

import dataclasses
import enum
import heapq
import math
from collections.abc import Collection, Iterator
from typing import NamedTuple

import numpy as np

from robustid.core import Frozen, Real, freeze

NAMED = 50  # rows of a kind that are named; the others are counted
FAR = 3.5  # robust standard deviations
_FEWEST = 8  # values that a median and a spread are taken from
_NORMAL = 1.4826  # standard deviation of a normal distribution over the median of its absolute deviations
_NORMAL_MEAN = 1.2533  # over their mean
_SEVERAL = {"machine": "machines", "entry": "entries", "column": "columns"}
_LEFT = 10  # names of those that have not been run yet
_SAME = 1e-9  # of the logarithm: values that are one


class FleetState(enum.Enum):
    """Outcome of the run of one machine; the value is what stands in tables."""

    CONSISTENT = "consistent"
    INCONSISTENT = "inconsistent"
    CONTRADICTED = "contradicted"
    UNDECIDED = "undecided"
    WAITING = "waiting"
    FAILED = "failed"


class FleetRow(NamedTuple):
    """One machine of a fleet.

    `sentence`: the verdict, or why there is none; `margin`, `order`; `error`: largest guaranteed error and `error_hz` where,
    `relative`: its median, per cent of the response; `peak`: largest gain of the model at these frequencies and `peak_hz` where;
    `seconds` that it took; `faults` of its data that nothing has undone; `waits`: for which data, "" for none; `unfinished`: what
    its time left out. Numbers are NaN where there are none.
    """

    name: str
    state: FleetState
    sentence: str
    margin: float = math.nan
    order: int = 0
    error: float = math.nan
    error_hz: float = math.nan
    relative: float = math.nan
    peak: float = math.nan
    peak_hz: float = math.nan
    seconds: float = math.nan
    faults: int = 0
    waits: str = ""
    unfinished: str = ""


QUANTITIES = {
    "relative": "guaranteed error [% of the response]",
    "error": "largest guaranteed error",
    "peak": "largest gain",
    "peak_hz": "frequency of the largest gain [Hz]",
}


class Outlier(NamedTuple):
    """A machine that is unlike the others in one quantity of `QUANTITIES`: its value, the median of all, and the robust score."""

    name: str
    quantity: str
    value: float
    median: float
    score: float


class Spread(NamedTuple):
    """Median of a positive quantity, and the robust standard deviation of its logarithm."""

    median: float
    deviation: float

    def score(self, value: float) -> float:
        """Distance of a value from the median in robust standard deviations; 0 of one that says nothing."""
        if not (math.isfinite(value) and value > 0):
            return 0.0
        distance = math.log(value / self.median)
        return 0.0 if abs(distance) <= _SAME else distance / max(self.deviation, _SAME)


@dataclasses.dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Fleet(Frozen):
    """Many machines, or entries of a matrix: their verdicts, the worst cases, those that stand out, and who waits for data.

    Attributes
    ----------
    asked : int
        Number of run files.
    states : dict of FleetState to int
        Number of rows of every state.
    faulty : int
        Rows of data with a fault that nothing has undone.
    refuted, failed, waiting, unfinished : tuple of FleetRow
        Those whose data contradict their class or their band; without a verdict; that wait for data; whose time was over. At most
        fifty are named of each.
    worst : tuple of FleetRow
        The largest guaranteed errors, as shares of the response.
    outliers : tuple of Outlier
        The farthest first.
    relative : array
        Guaranteed errors as shares of the response, per cent, in ascending order.
    seconds : float
        Of all runs together.
    thing : str
        "machine", "entry" or "column".
    left : tuple of str
        Names of those that have not been run yet.
    """

    asked: int
    states: dict[FleetState, int]
    faulty: int
    refuted: tuple[FleetRow, ...]
    failed: tuple[FleetRow, ...]
    waiting: tuple[FleetRow, ...]
    unfinished: tuple[FleetRow, ...]
    worst: tuple[FleetRow, ...]
    outliers: tuple[Outlier, ...]
    relative: Real
    seconds: float
    thing: str = "machine"
    left: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        self._set(relative=freeze(self.relative))

    @property
    def rows(self) -> int:
        """Number of machines that there is a row of."""
        return sum(self.states.values())

    @property
    def open(self) -> int:
        """Number of run files that have not been run yet."""
        return self.asked - self.rows

    @property
    def things(self) -> str:
        """The word for several of them."""
        return _SEVERAL[self.thing]

    @property
    def left_words(self) -> str:
        """Names of those that have not been run yet, the first of many; empty where all have been."""
        more = len(self.left) - _LEFT
        names = ", ".join(self.left[:_LEFT]) + f" and {more} more" * (more > 0)
        return f"Not run yet: {names}." if names else ""

    @property
    def verdict(self) -> str:
        """The states in one sentence."""
        parts = [f"{count} {state.value}" for state in FleetState if (count := self.states.get(state, 0))]
        parts += [f"{self.open} not run yet"] * bool(self.open)
        return f"Of {self.asked} {self.things} {', '.join(parts) or 'none'}."

    def __repr__(self) -> str:
        return f"<Fleet: {self.verdict}>"

    def summary(self) -> str:
        """Every row that is named, in plain text."""
        lines = [self.verdict, *[self.left_words] * bool(self.left)]
        lines += [f"{row.name}: {row.state.value}. {row.sentence}" for row in (*self.failed, *self.refuted)]
        lines += [f"{row.name} waits for data: {row.waits}" for row in self.waiting]
        lines += [f"{row.name}: {row.unfinished}" for row in self.unfinished]
        lines += [f"{row.name}: guaranteed error {row.relative:.4g} % of the response" for row in self.worst]
        lines += [
            f"{one.name}: {QUANTITIES[one.quantity]} {one.value:.4g}, the median is {one.median:.4g}"
            for one in self.outliers
        ]
        return "\n".join(lines)


def fleet_of(rows: Collection[FleetRow], asked: int) -> Fleet:
    """The fleet that rows tell of, which are gone through twice, one after the other: only a few numbers of each are kept.

    Outliers: the logarithm of a quantity is more than 3.5 robust standard deviations (1.4826 times the median of the absolute
    deviations) from its median, of at least eight values. Source: `iglewicz1993`.

    Examples
    --------
    >>> from robustid.guarantees import FleetRow, FleetState, fleet_of
    >>> rows = [FleetRow(f"m{k}", FleetState.CONSISTENT, "", peak=1 + 0.01 * k) for k in range(9)]
    >>> found = fleet_of([*rows, FleetRow("odd", FleetState.CONSISTENT, "", peak=3.0)], 12)
    >>> found.verdict, [one.name for one in found.outliers]
    ('Of 12 machines 10 consistent, 2 not run yet.', ['odd'])
    """
    numbers = np.array([[getattr(row, name) for name in (*QUANTITIES, "seconds")] for row in rows]).reshape(-1, 5)
    spreads = {name: one for k, name in enumerate(QUANTITIES) if (one := _spread(numbers[:, k])) is not None}
    states, faulty, relative = dict[FleetState, int](), 0, numbers[:, 0]
    kept = {name: list[FleetRow]() for name in ("refuted", "failed", "waiting", "unfinished")}
    worst, outliers = list[FleetRow](), list[Outlier]()
    for row in rows:
        states[row.state] = states.get(row.state, 0) + 1
        faulty += row.faults > 0
        for kind in _kinds(row):
            if len(kept[kind]) < NAMED:
                kept[kind].append(row)
        if math.isfinite(row.relative):
            worst = heapq.nlargest(NAMED, [*worst, row], key=lambda one: one.relative)
        if found := list(_outliers(row, spreads)):
            outliers = heapq.nlargest(NAMED, [*outliers, *found], key=lambda one: abs(one.score))
    return Fleet(
        asked=asked,
        states=states,
        faulty=faulty,
        refuted=tuple(kept["refuted"]),
        failed=tuple(kept["failed"]),
        waiting=tuple(kept["waiting"]),
        unfinished=tuple(kept["unfinished"]),
        worst=tuple(worst),
        outliers=tuple(outliers),
        relative=np.sort(relative[np.isfinite(relative)]),
        seconds=float(np.nansum(numbers[:, 4])),
    )


def _kinds(row: FleetRow) -> list[str]:
    """Lists of the fleet in which a row is named."""
    kinds = {
        "refuted": row.state in (FleetState.INCONSISTENT, FleetState.CONTRADICTED),
        "failed": row.state in (FleetState.FAILED, FleetState.UNDECIDED),
        "waiting": bool(row.waits),
        "unfinished": bool(row.unfinished),
    }
    return [kind for kind, there in kinds.items() if there]


def _spread(values: Real) -> Spread | None:
    """The spread of the values that are known; None of few, or where all are one."""
    known = np.log(values[np.isfinite(values) & (values > 0)])
    if known.size < _FEWEST:
        return None
    away = np.abs(known - np.median(known))
    deviation = _NORMAL * float(np.median(away)) or _NORMAL_MEAN * float(away.mean())
    return Spread(float(np.exp(np.median(known))), deviation) if deviation > _SAME else None


def _outliers(row: FleetRow, spreads: dict[str, Spread]) -> Iterator[Outlier]:
    """Quantities in which a machine is unlike the others."""
    for name, spread in spreads.items():
        score = spread.score(getattr(row, name))
        if abs(score) > FAR:
            yield Outlier(row.name, name, getattr(row, name), spread.median, score)

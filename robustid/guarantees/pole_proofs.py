"""Cells of poles: the values of the systems with poles in one, proofs of them, refutations of others, and the union of all."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Iterator, Sequence
from typing import Self

import numpy as np

from robustid.core import Complex, Frozen, Real, freeze
from robustid.guarantees.consistent_set import ConsistentSet, Entry, independent_entries
from robustid.guarantees.pole_cells import PoleCell
from robustid.guarantees.value_set import (
    RefutationClaim,
    RelaxedClaim,
    SupportClaim,
    ValueSet,
    by_frequency,
    closes,
    value_set_claims,
)
from robustid.identification import MarginCertificate, MixedProblem
from robustid.identification.formulation import Candidate, Formulation, formulate

# To which the form of a relaxed problem is chosen: its tails are a tenth of that part of every bound, far below what the
# remainders of a cell add, and the work is a fifth of that at 1e-4.
_ACCURACY = 1e-2
_AROUND = np.exp(2j * np.pi * np.arange(16) / 16) / np.cos(np.pi / 16)  # a polygon around the unit disc


@dataclasses.dataclass(frozen=True, eq=False)
class Cell(Frozen):
    """The values of the systems of one cell at every frequency; of a cell by itself, of poles exactly as they are stated.

    MIMO: entry after entry, of symmetric matrices the upper triangle.
    """

    values: tuple[ValueSet, ...]

    @functools.cached_property
    def omega(self) -> Real:
        """Frequencies of the values, rad/s."""
        return freeze(np.array(list(by_frequency(self.values))))

    def of_entry(self, output: int, input: int) -> tuple[ValueSet, ...]:
        """The values of an entry at every frequency; of symmetric matrices those of either one."""
        places = (output, input), (input, output)
        found = [tuple(one for one in self.values if one.entry == place) for place in places]
        return found[0] or found[1]

    def at(self, omega: Real) -> Self:
        """The cell at some of its frequencies."""
        return dataclasses.replace(self, values=tuple(one for one in self.values if one.omega in omega))

    def slack(self, omega: Real) -> Real:
        """Distance of the systems of the cell from the values, at frequencies in rad/s, (F, ny, nu)."""
        return np.zeros((omega.size, *self.values[0].matrices.shape[1:]))

    def is_about(self, problem: MixedProblem, omega: Real) -> bool:
        """Return whether the polygons are closed, and of all entries at these frequencies."""
        found, wanted = by_frequency(self.values), independent_entries(problem.entries)
        closed = all(closes(v.directions, v.omega, problem.dt) for v in self.values)
        complete = all([v.entry for v in sets] == wanted for sets in found.values())
        return closed and complete and np.array_equal(list(found), omega)


@dataclasses.dataclass(frozen=True, eq=False)
class KeptCell(Cell):
    """A cell of a pole-uncertainty box that may contain the poles: the values are those of its relaxed problem.

    At some frequencies other cells, which cover the same poles, may stand in place of it: it has no values there. None at all where
    the cell is so wide that no sample says anything.
    """

    cell: PoleCell

    def slack(self, omega: Real) -> Real:
        """Remainder of the expansion behind the relaxed problem."""
        return self.cell.slack(omega)

    def claims(self, problem: MixedProblem, name: str) -> Iterator[SupportClaim]:
        """Claims of the polygons about the relaxed problem, which is made anew from the original one."""
        posed = posed_relaxation(self.cell, problem)
        if posed is None:
            return
        none = np.zeros(0)
        # A centre is where solvers start: no certificate needs it.
        consistent = ConsistentSet(posed, Candidate(none, none, none, none, ""), 1.0)
        for sets in by_frequency(self.values).values():
            for one in value_set_claims(consistent, *sets):
                parts = one.functional, one.stated, one.certificate, one.rows, one.sarason
                yield RelaxedClaim(f"{name}, {one.name}", *parts)

    def is_about(self, problem: MixedProblem, omega: Real) -> bool:
        """Return whether there are no polygons, or such as of any cell, at some of the frequencies, of a relaxed problem."""
        here = omega[np.isin(omega, self.omega)]
        return not self.values or (super().is_about(problem, here) and self.cell.relaxed(problem) is not None)


@dataclasses.dataclass(frozen=True, eq=False)
class RefutedCell(Frozen):
    """A cell that is proved not to contain the poles: its relaxed problem has a margin above 1."""

    cell: PoleCell
    certificate: MarginCertificate

    def is_about(self, problem: MixedProblem, _: Real) -> bool:
        """Return whether there is a relaxed problem that can be refuted."""
        return self.cell.relaxed(problem) is not None

    def claims(self, problem: MixedProblem, name: str) -> Iterator[RefutationClaim]:
        """The one that it makes; the relaxed problem is made anew."""
        posed = posed_relaxation(self.cell, problem)
        if posed is not None:
            yield RefutationClaim(f"{name}, refuted", self.certificate, posed.data.rows, posed.data.sarason)


def posed_relaxation(cell: PoleCell, problem: MixedProblem) -> Formulation | None:
    """Arrays of the problem that every consistent system with poles in the cell solves; None if no data are left."""
    relaxed = cell.relaxed(problem)
    return None if relaxed is None else formulate(relaxed, accuracy=_ACCURACY)


def union_of(cells: Sequence[Cell], nominal: Complex, omega: Real) -> tuple[Real, Real]:
    """Bound of |F - nominal|, (F, ny, nu), and range of |F|, (F, ny, nu, 2), over all systems of any cell."""
    shape = nominal.shape
    upper, low, high = np.zeros(shape), np.full(shape, np.inf), np.zeros(shape)
    if not all(item.values for item in cells):
        return np.full(shape, np.inf), np.stack([np.zeros(shape), np.full(shape, np.inf)], axis=-1)
    for item in cells:
        here = np.isin(omega, item.omega)
        slack, about = item.slack(omega[here]), nominal[here]
        for entry in np.ndindex(*shape[1:]):
            sets, at, extra = item.of_entry(*entry), (here, *entry), slack[:, *entry]
            far = [one.farthest(m)[0] for one, m in zip(sets, about[:, *entry].tolist(), strict=True)]
            least, most = np.array([one.magnitude for one in sets]).T
            upper[at], high[at] = np.maximum(upper[at], far + extra), np.maximum(high[at], most + extra)
            low[at] = np.minimum(low[at], np.maximum(0.0, least - extra))
    return upper, np.stack([low, high], axis=-1)


def corners_of(cells: Sequence[Cell], omega: Real, entry: Entry) -> list[Complex | None]:
    """At every frequency, points whose convex hull holds an entry of every system of any cell; None where one is too wide."""
    if not all(item.values for item in cells):
        return [None] * omega.size
    found: list[list[Complex]] = [[] for _ in omega]
    for item in cells:
        here = np.flatnonzero(np.isin(omega, item.omega))
        slack = item.slack(omega[here])[:, *entry]
        for k, one, extra in zip(here.tolist(), item.of_entry(*entry), slack.tolist(), strict=True):
            found[k].append((one.vertices[:, None] + extra * _AROUND).ravel())
    return [np.concatenate(each) if np.all(np.isfinite(np.concatenate(each))) else None for each in found]


def hulls_of(cells: Sequence[Cell], omega: Real, entry: Entry) -> list[Complex] | None:
    """The same at all frequencies; None where a cell is too wide at one."""
    found = corners_of(cells, omega, entry)
    known = [one for one in found if one is not None]
    return known if len(known) == len(found) else None

"""Cells of poles: the values of the systems with poles in one, proofs of them, refutations of others, and the union of all."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Iterator, Sequence
from typing import Self

import numpy as np

from robustid.core import Complex, Frozen, Real, freeze
from robustid.guarantees.consistent_set import ConsistentSet, Entry, independent_entries, which
from robustid.guarantees.linear.amplitudes import Extraction
from robustid.guarantees.linear.directed import DirectedBand, Sides, directed_fit
from robustid.guarantees.linear.directed_verification import sides_hold_exactly
from robustid.guarantees.linear.entry_band import extraction_fits
from robustid.guarantees.linear.polygon_discs import tightened
from robustid.guarantees.linear.solved_nodes import NO_NODES
from robustid.guarantees.pole_cells import PoleCell
from robustid.guarantees.value_set import (
    RefutationClaim,
    RelaxedClaim,
    SupportClaim,
    ValueSet,
    by_frequency,
    closes,
    directions_at,
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

    @property
    def claim_count(self) -> int:
        """Number of `claims`."""
        return sum(len(one.certificates) for one in self.values)

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

    claim_count = 1

    def is_about(self, problem: MixedProblem, _: Real) -> bool:
        """Return whether there is a relaxed problem that can be refuted."""
        return self.cell.relaxed(problem) is not None

    def claims(self, problem: MixedProblem, name: str) -> Iterator[RefutationClaim]:
        """The one that it makes; the relaxed problem is made anew."""
        posed = posed_relaxation(self.cell, problem)
        if posed is not None:
            yield RefutationClaim(f"{name}, refuted", self.certificate, posed.data.rows, posed.data.sarason)


@dataclasses.dataclass(frozen=True, eq=False)
class SumsClaim(Frozen):
    """Sums of one direction each over the samples of an entry bound its values at frequencies by what is stated of each.

    No `band` where the sums of a cell prove none of its amplitudes, or larger ones than are stated.
    """

    name: str
    band: DirectedBand | None
    omega: Real
    stated: tuple[Real, ...]

    def verify(self, exact: bool = False) -> bool:
        """Evaluate them again; `exact` in ball arithmetic (`robustid[exact]`), by code of its own."""
        if self.band is None:
            return False
        again = dataclasses.replace(self.band)  # nothing that was computed before is taken over
        fits = directed_fit(again.sides, again.points, again.multipliers, again.angles.size)
        if not (fits and extraction_fits(again.extraction) and len(self.stated) == again.angles.size):
            return False
        dt = again.samples.problem.dt
        proved = [sides_at(*each, dt)[1] for each in zip(self.omega.tolist(), again.knot_supports, strict=True)]
        holds = all(one.shape == own.shape and np.all(one <= own) for one, own in zip(proved, self.stated, strict=True))
        return holds and (not exact or sides_hold_exactly(again))


Claim = SupportClaim | RefutationClaim | SumsClaim


@dataclasses.dataclass(frozen=True, eq=False)
class SummedCell(Cell):
    """A cell whose values sums over the samples prove, of one direction each: no program is solved, nothing is relaxed."""

    cell: PoleCell
    bands: tuple[DirectedBand, ...]  # of every independent entry, with the frequencies of the values as their knots

    @classmethod
    def of(cls, problem: MixedProblem, cell: PoleCell, omega: Real, bands: tuple[DirectedBand, ...]) -> SummedCell:
        """The cell with the values that its sums prove at frequencies."""
        values: list[ValueSet] = []
        for k, w in enumerate(omega.tolist()):
            for one in bands:
                theta, support = sides_at(w, one.knot_supports[k], problem.dt)
                nothing = np.full((support.size, *problem.entries.shape), np.nan, complex)
                parts = theta, support, nothing[:, 0, 0], 0.0, (), one.samples.entry, nothing
                values.append(ValueSet(w, *parts))
        return cls(tuple(values), cell, bands)

    @property
    def claim_count(self) -> int:
        """Number of `claims`."""
        return len(self.bands)

    def claims(self, problem: MixedProblem, name: str) -> Iterator[SumsClaim]:
        """Claims of the polygons of every entry."""
        again = _made_anew(self.cell, problem, self.bands)
        for band, entry in zip(again, [one.samples.entry for one in self.bands], strict=True):
            stated = tuple(one.support for one in self.of_entry(*entry))
            yield SumsClaim(f"{name}{which(problem, entry)}", band, self.omega, stated)

    def is_about(self, problem: MixedProblem, omega: Real) -> bool:
        """Return whether there are closed polygons of all entries at some of the frequencies, from sums over this cell."""
        here = omega[np.isin(omega, self.omega)]
        angles = problem.plane.angles(here)
        own = all(_of_cell(one, self.cell) and np.array_equal(one.angles, angles) for one in self.bands)
        return own and len(self.bands) == len(independent_entries(problem.entries)) and super().is_about(problem, here)


@dataclasses.dataclass(frozen=True, eq=False)
class RefutedBySums(Frozen):
    """A cell that is proved not to contain the poles: sums of opposite directions leave no value of an entry at a frequency."""

    cell: PoleCell
    band: DirectedBand  # one knot

    claim_count = 1

    def is_about(self, problem: MixedProblem, _: Real) -> bool:
        """Return whether the sums are over this cell, and contradict each other."""
        return _of_cell(self.band, self.cell) and bool(is_empty(self.band.knot_supports[0]))

    def claims(self, problem: MixedProblem, name: str) -> Iterator[SumsClaim]:
        """The one that it makes."""
        omega = problem.plane.omega(self.band.angles)
        stated = sides_at(float(omega[0]), self.band.knot_supports[0], problem.dt)[1]
        for band in _made_anew(self.cell, problem, (self.band,)):
            yield SumsClaim(f"{name}, refuted", band, omega, (stated,))


def _of_cell(band: DirectedBand, cell: PoleCell) -> bool:
    """Return whether sums are over the samples with their poles in a cell, and over nothing else."""
    own = [one for one in cell.proofs if one is band.extraction and one.samples is band.samples]
    return bool(own) and not len(band.sides.corners)


def sides_of(proof: Extraction) -> Sides:
    """The samples of an entry with the amplitudes of a cell."""
    return Sides(proof.samples, proof, NO_NODES.corners)


def _made_anew(cell: PoleCell, problem: MixedProblem, bands: Sequence[DirectedBand]) -> list[DirectedBand | None]:
    """Sums over a cell, over samples and proofs that follow from the problem and its ends alone; None where these do not fit."""
    again = cell.proved_again(problem)
    if again is None:
        return [None] * len(bands)
    of_entry = {one.samples.entry: one for one in again.proofs}
    return [dataclasses.replace(one, sides=sides_of(of_entry[one.samples.entry])) for one in bands]


def sides_at(omega: float, bounds: Real, dt: float) -> tuple[Real, Real]:
    """Directions and sides of a polygon, of bounds (M,) of equally spaced ones: both ends where the response is real."""
    bounds = tightened(bounds)
    theta: Real = directions_at(omega, dt, int(bounds.size))
    return theta, bounds if theta.size == bounds.size else bounds[[0, bounds.size // 2]]


def is_empty(bounds: Real) -> bool:
    """Return whether bounds (M,) of equally spaced directions leave nothing between two that are opposite."""
    bounds, half = tightened(bounds), bounds.size // 2
    return bool(np.any(bounds[:half] + bounds[half:] < 0))


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
            found[k].append((one.vertices[:, None] + extra * _AROUND).ravel() if extra else one.vertices)
    return [np.concatenate(each) if np.all(np.isfinite(np.concatenate(each))) else None for each in found]


def hulls_of(cells: Sequence[Cell], omega: Real, entry: Entry) -> list[Complex] | None:
    """The same at all frequencies; None where a cell is too wide at one."""
    found = corners_of(cells, omega, entry)
    known = [one for one in found if one is not None]
    return known if len(known) == len(found) else None

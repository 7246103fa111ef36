"""Cells of a pole-uncertainty box as trees: halved at a frequency where their systems are farthest from the model."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from robustid.core import Budget, Pieces, Real
from robustid.errors import InconsistentDataError
from robustid.guarantees.consistent_set import ConsistentSet
from robustid.guarantees.pole_cells import PoleCell
from robustid.guarantees.pole_proofs import KeptCell, RefutedCell, union_of
from robustid.guarantees.pole_sweep import looked_at
from robustid.guarantees.polygons import Earlier
from robustid.guarantees.sweep import Means, value_sets
from robustid.guarantees.value_set import ValueSet
from robustid.identification import MixedProblem

if TYPE_CHECKING:
    import control

_LITTLE = 1e-3  # of the error: the remainder of a cell that is left as it is
_LESS = 0.97  # times the largest error of a cell: what that of its quarters has to be for more of them
_SMALL = 0.2  # hyperbolic radius of a mode near a frequency: larger cells are halved before anything is solved
_ENOUGH = 0.97  # times the largest error that the relaxed problems of cells reach: what a polygon need not be below


class Branch:
    """A cell, what is known of it, and its halves by the mode that was halved.

    Attributes
    ----------
    values : dict
        Polygons by frequency, rad/s.
    """

    def __init__(
        self,
        cell: PoleCell,
        name: str,
        look: Callable[[PoleCell], RefutedCell | ConsistentSet | None],
        above: Branch | None = None,
    ) -> None:
        self.cell, self.name, self._look, self._above = cell, name, look, above
        self.values: dict[float, tuple[ValueSet, ...]] = {}
        self.halves: dict[int, tuple[Branch, ...]] = {}

    @functools.cached_property
    def found(self) -> RefutedCell | ConsistentSet | None:
        """Refutation of the cell, or the set of its relaxed problem; None: no sample says anything of all its poles at once."""
        return self._look(self.cell)

    def before(self, omega: float) -> Earlier | None:
        """Polygon of the cell whose half it is at a frequency, with its samples, for plants with one entry."""
        above = self._above
        if above is None or not isinstance(above.found, ConsistentSet) or len(above.values.get(omega, ())) != 1:
            return None
        return above.found.posed_at(omega).data.rows, above.values[omega][0]

    def kept(self, omega: float) -> KeptCell:
        """The cell with its values at a frequency; without any of one that is too wide."""
        return KeptCell(self.values.get(omega, ()), self.cell)


class PoleTree:
    """Cells of a box, of which those that hold the largest error at a frequency are halved; what they share is computed once.

    Raises
    ------
    InconsistentDataError
        The whole box is refuted.
    """

    def __init__(
        self,
        problem: MixedProblem,
        model: control.StateSpace,
        whole: PoleCell,
        sides: tuple[int, float],
        budget: Budget | None = None,
    ) -> None:
        self.problem, self.model, self._sides, self._budget = problem, model, sides, budget
        self.refuted: list[RefutedCell] = []
        self._roots: dict[tuple[bool, ...], Branch] = {}
        self.root = self._root(whole)
        if isinstance(self.root.found, RefutedCell):
            raise self._refusal

    def root_at(self, omega: float) -> Branch:
        """The whole box, every mode expanded as its remainder at a frequency is smaller."""
        return self._root(self.root.cell.about(self.problem, omega))

    def _root(self, cell: PoleCell) -> Branch:
        ways = tuple(cell.near.tolist())
        if ways not in self._roots:
            self._roots[ways] = self._branch(cell, "cell-" + "".join("in"[way] for way in ways) + "-")
        return self._roots[ways]

    def cover(
        self,
        omega: float,
        scale: Real,
        most: int,
        means: Means,
        told: Callable[[int], None] | None = None,
        start: Sequence[Branch] = (),
    ) -> list[Branch] | None:
        """So many branches at most that cover the box, without those that are refuted, with their values at a frequency.

        The one whose systems are farthest from the model, in units of `scale` (1, ny, nu), is halved next, for as long as that
        makes it smaller and there is time; None where there is none for the first ones, `start` or the whole box.
        """
        pieces, parents = Pieces(means.budget), dict[Branch, Branch]()
        leaves, sizes = list(start) or self._small(omega, most), dict[Branch, float]()
        for leaf in leaves:
            if not (pieces.begins() and self._valued(leaf, omega, means, self._enough(leaves, omega))):
                return None
        leaves = self._left(leaves)
        sizes |= {leaf: self._size(leaf, omega, scale) for leaf in leaves}
        while len(leaves) < most and pieces.begins():
            worst = max(leaves, key=sizes.__getitem__)
            above = parents.get(worst)
            mode = worst.cell.widest_at(omega)
            slack = float((worst.cell.slack(np.array([omega])) / scale).max())
            # Near a mode the last term of the series, whose phase is free, is all that matters of a small cell.
            slack /= worst.cell.radius[mode] if worst.cell.near[mode] else 1.0
            if slack < _LITTLE * sizes[worst] or (above in parents and sizes[worst] > _LESS * sizes[parents[above]]):
                break
            halves, enough = self._halves(worst, omega), self._enough(leaves, omega)
            over = (
                means.budget is not None and means.budget.over
            )  # then one that is too wide may be one without a margin
            if over or not halves or not all(self._valued(half, omega, means, enough) for half in halves):
                break
            leaves = self._left([*(leaf for leaf in leaves if leaf is not worst), *halves])
            sizes |= {half: self._size(half, omega, scale) for half in halves if half in leaves}
            parents |= dict.fromkeys(halves, worst)
            if told is not None:
                told(len(leaves))
        return leaves

    def _small(self, omega: float, most: int) -> list[Branch]:
        """So many parts of the box at most, as small as cells have to be near a frequency; nothing is solved."""
        leaves = [self.root_at(omega)]
        mode = self.root.cell.widest_at(omega)
        while len(leaves) < most and leaves[0].cell.near[mode]:
            widest = max(leaves, key=lambda leaf: leaf.cell.radius[mode])
            halves = self._parts(widest, mode) if widest.cell.radius[mode] > _SMALL else ()
            if not halves:
                break
            leaves = [*(leaf for leaf in leaves if leaf is not widest), *halves]
        return leaves

    def _left(self, leaves: Sequence[Branch]) -> list[Branch]:
        """Leave out those that are refuted."""
        left = [leaf for leaf in leaves if not isinstance(leaf.found, RefutedCell)]
        if not left:
            raise self._refusal
        return left

    def _enough(self, leaves: Sequence[Branch], omega: float) -> float:
        """About the largest distance from the model that cells reach."""
        nominal = complex(self.problem.plane.values_at(self.model, np.array([omega]))[0].flat[0])
        reached = [one.farthest(nominal)[1] for leaf in leaves for one in leaf.values.get(omega, ())]
        return _ENOUGH * max(reached, default=0.0)

    @property
    def _refusal(self) -> InconsistentDataError:
        return InconsistentDataError(
            "no system with poles in the pole-uncertainty box fits the data: cells that cover it are refuted; loosen the bounds,"
            " the prior or the box"
        )

    def _branch(self, cell: PoleCell, name: str, above: Branch | None = None) -> Branch:
        return Branch(cell, name, self._looked_at, above)

    def _looked_at(self, cell: PoleCell) -> RefutedCell | ConsistentSet | None:
        found = looked_at(cell, self.problem, self._budget)
        if isinstance(found, RefutedCell):
            self.refuted.append(found)
        return found

    def _halves(self, branch: Branch, omega: float) -> tuple[Branch, ...]:
        """Halves of the mode that matters at a frequency; none where their amplitudes have no bound."""
        wide = branch.found is None
        return self._parts(
            branch, branch.cell.widest(self.problem, np.array([omega])) if wide else branch.cell.widest_at(omega)
        )

    def _parts(self, branch: Branch, mode: int) -> tuple[Branch, ...]:
        """Halves of a mode."""
        if mode not in branch.halves:
            cells = branch.cell.split(self.problem, mode) or ()
            branch.halves[mode] = tuple(
                self._branch(cell, f"{branch.name}{mode}{'ab'[k]}", branch) for k, cell in enumerate(cells)
            )
        return branch.halves[mode]

    def _valued(self, branch: Branch, omega: float, means: Means, enough: float) -> bool:
        """Find the values at a frequency, and say whether there was time for it; of cells without a set there are none.

        `enough` is a distance from the model within which no more has to be known.
        """
        if isinstance(branch.found, ConsistentSet) and omega not in branch.values:
            how = means.part(branch.name), self.model
            known = branch.before(omega)
            found = value_sets(
                branch.found, np.array([omega]), *self._sides, *how, least=0, enough=enough, before=known
            )
            if not found:
                return False
            branch.values[omega] = tuple(found)
        return True

    def _size(self, branch: Branch, omega: float, scale: Real) -> float:
        at = np.array([omega])
        nominal = self.problem.plane.values_at(self.model, at)
        return float((union_of((branch.kept(omega),), nominal, at)[0] / scale).max())

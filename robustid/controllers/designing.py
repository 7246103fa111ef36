"""Search of the best controller of a structure: levels of a goal, cones at frequencies, cuts where a proof fails."""

from __future__ import annotations

import copy
import dataclasses
import math
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from robustid.controllers.conditions import conditions_of, integrators_of
from robustid.controllers.discs import Discs
from robustid.controllers.factors import Factor
from robustid.controllers.goals import Goal
from robustid.controllers.limits import Limits
from robustid.controllers.plants import Plants
from robustid.controllers.program import Functions
from robustid.controllers.proving import Proof, proof_of
from robustid.controllers.search import Question, found_for
from robustid.controllers.structure import Basis, Matrix, basis_of, entries_of, free_of
from robustid.core import Budget, Complex, Progress, Real, StateMatrices, points_of, response_at

if TYPE_CHECKING:
    import control

_FINE = 1.005  # of the goal: two levels that are as good as equal
_STEPS = 10  # levels over the axis that are tried from above
SPARE = 0.995  # of every limit: what the proof on arcs takes
_BETWEEN = 8  # parts of the way from one frequency to the next that are looked at before a proof
_CLOSE = 0.02  # left to a limit between frequencies: where there is less, every arc of the band is looked at
_ON_ARCS = np.array([1e-6, 0.5, 1 - 1e-6])  # parts of an arc: the bounds are the same on all of it
_LOWER = (1.0, 0.998, 0.995, 0.99, 0.97)  # of a level that failed its proof
_PART = 0.25  # of the corner of a loop that is wanted, up to which it has a second integrator
_BACK = (0.7,)  # of a level that was reached, from which the search begins once more
_AHEAD = (1.25, 1.05)  # of a level that was reached, up to which a controller for the models alone leads
_SEARCH = (1.5, 1.2, 1.07)  # factors that searched numbers are moved by
_NEAR = "near"  # name of the start that is a known controller


@dataclasses.dataclass(frozen=True)
class Found:
    """A controller, the numbers of its structure that were searched, and the level that it reaches."""

    at: list[float]
    level: float
    controller: control.StateSpace


class TimeIsOver(Exception):
    """End of a search whose time is over; what was found stays with whom it was told to."""


def _everywhere(omega: Real) -> Real:
    return np.ones(omega.shape)


def _nowhere(omega: Real) -> Real:
    return np.zeros(omega.shape)


def unheard(found: Found) -> None:
    """Nobody hears of a controller that was found."""
    del found


@dataclasses.dataclass
class Task:
    """A design: its plants, and the frequencies of each that are asked about."""

    plants: list[Plants]
    structure: tuple[Factor, ...] | Matrix
    limits: Limits
    goal: Goal
    grids: list[Real]
    relaxed: float = 1.0  # factor by which all limits are relaxed, those of the goal too
    smaller: Callable[[Real], Real] = _everywhere  # factors of the radii of all discs, by frequency
    budget: Budget = dataclasses.field(default_factory=Budget)  # time of the search: TimeIsOver is raised after it
    heard: Callable[[Found], None] = unheard  # receiver of every controller that keeps the limits
    spare: float = SPARE  # of every limit: what is asked for at frequencies

    @classmethod
    def of(cls, plants: list[Plants], structure: tuple[Factor, ...] | Matrix, limits: Limits, goal: Goal) -> Task:
        """The design with frequencies to begin with: those of the plants, and the ends of the limits."""
        ends = goal.asked(limits, 1.0).frequencies
        grids = [one.grid() for one in plants]
        return cls(
            plants, structure, limits, goal, [np.unique([*grid, *(e for e in ends if e < grid[-1])]) for grid in grids]
        )

    @property
    def dt(self) -> float:
        """Sample time in s; 0 in continuous time."""
        return self.plants[0].dt

    @property
    def shape(self) -> tuple[int, int]:
        """Outputs and inputs of the plant."""
        nu, ny = self.plants[0].loop.shape
        return ny, nu

    @property
    def intervals(self) -> list[tuple[float, float]]:
        """Intervals of the numbers that are searched."""
        return free_of(entries_of(self.structure, self.shape))

    @property
    def middle(self) -> list[float]:
        """Geometric means of them."""
        return [math.sqrt(low * high) for low, high in self.intervals]

    @property
    def starts(self) -> list[list[float]]:
        """Numbers of the structure to begin with: the middle of the intervals, and their ends."""
        if all(low == high for low, high in self.intervals):
            return [self.middle]
        return [self.middle, *([low ** (1 - part) * high**part for low, high in self.intervals] for part in (0.0, 1.0))]

    def asked(self, level: float) -> Limits:
        """The limits at a level of the goal."""
        limits = self.goal.asked(self.limits, level)
        return limits if self.relaxed == 1 else limits.relaxed(self.relaxed)

    def discs(self, omegas: Sequence[Real]) -> Discs:
        """Discs of all plants, each at its frequencies, one after the other."""
        found = [one.discs(omega, self.smaller(omega)) for one, omega in zip(self.plants, omegas, strict=True)]
        return Discs.together(found)

    def values(self, controller: StateMatrices, omega: Real) -> Complex:
        """Values of a controller, of transposed plants transposed too."""
        found = response_at(controller, points_of(omega, self.dt))
        return found.swapaxes(1, 2) if self.plants[0].turned else found

    def with_frequencies(self, where: Sequence[float]) -> None:
        """Ask about further frequencies."""
        self.grids = [np.unique(np.concatenate([grid, where])) for grid in self.grids]

    def broken(self, found: Found) -> list[float]:
        """Frequencies between those asked about at which a controller breaks a limit most, one to each stretch where it does."""
        where: list[float] = []
        parts = np.arange(1, _BETWEEN) / _BETWEEN
        for plants, grid in zip(self.plants, self.grids, strict=True):
            omega: Real = (grid[:-1, None] ** (1 - parts) * grid[1:, None] ** parts).ravel()
            worst = self._left(found, plants, omega)
            if np.all(worst >= 0):  # closer, as the proof takes the bounds: arc by arc
                ends = plants.band.circle.edges[np.isfinite(plants.band.circle.edges)]
                arcs: Real = (ends[:-1, None] * (1 - _ON_ARCS) + ends[1:, None] * _ON_ARCS).ravel()
                after = np.searchsorted(omega, arcs).clip(1, omega.size - 1)
                close = np.minimum(worst[after], worst[after - 1]) < _CLOSE
                omega = arcs[close & (arcs > grid[0]) & (arcs < grid[-1])]
                worst = self._left(found, plants, omega)
            over = np.flatnonzero(worst < 0)
            stretches = np.split(over, np.flatnonzero(np.diff(over) > 1) + 1)
            where += [float(omega[one[np.argmin(worst[one])]]) for one in stretches if one.size]
        return where

    def _left(self, found: Found, plants: Plants, omega: Real) -> Real:
        """The least distance to a limit at every frequency, at most 1."""
        values, worst = self.values(StateMatrices.of(found.controller), omega), np.ones(omega.size)
        for one in conditions_of(self.asked(found.level), plants.discs(omega, self.smaller(omega))):
            np.minimum.at(worst, one.place, one.excess(values))
        return worst

    def go_on(self) -> None:
        """Raise TimeIsOver where it is."""
        if self.budget.over:
            raise TimeIsOver

    def proof(self, found: Found, progress: Progress | None = None) -> Proof:
        """Worst cases of a controller, and what it takes of the limits at its level."""
        return proof_of(self.plants, found.controller, self.goal.asked(self.limits, found.level), progress)

    def searched(self, best: Found) -> Found:
        """A better controller with other numbers in their intervals, one after the other, in smaller steps."""
        for factor in _SEARCH:
            moved = True
            while moved:
                moved = False
                for k, (low, high) in enumerate(self.intervals):
                    for step in (factor, 1 / factor) if low < high else ():
                        at = list(best.at)
                        at[k] = min(max(at[k] * step, low), high)
                        if at[k] == best.at[k]:
                            continue
                        other = At(self, at).best(best.level * _FINE, best)
                        if other is not None and other.level > best.level * _FINE:
                            best, moved = other, True
                            break
        return At(self, best.at).raised(best) if any(low < high for low, high in self.intervals) else best


class At:
    """The search with given numbers of the structure."""

    def __init__(self, task: Task, at: Sequence[float]) -> None:
        self.task, self.at = task, list(at)
        self.basis: Basis = basis_of(task.structure, at, task.dt, task.shape)
        self.discs = task.discs(task.grids)
        self.owners = [k for k, grid in enumerate(task.grids) for _ in grid]
        omega = self.discs.omega
        self.into, self.out_of, self.held = self.basis.into, self.basis.out_of, self.basis.held
        if task.plants[0].turned:
            self.into, self.out_of, self.held = self.out_of.T, self.into.T, self.held.T
        axes = self._axes(omega)
        plain = self.into @ axes @ self.out_of
        falling = np.minimum(1.0, omega / np.exp(np.mean(np.log(omega))))  # an integrator is large where omega is small
        weighed = (falling[:, None] * self.discs.columns)[:, None, :, None] * plain
        flat = weighed.swapaxes(0, 1).reshape(self.basis.count, -1).T
        stacked = np.concatenate([flat.real, flat.imag])
        self.back = np.linalg.inv(np.linalg.qr(stacked, mode="r")) * math.sqrt(2 * omega.size)
        self.axes = self._in_basis(axes)
        self.lost: dict[str, float] = {}  # levels from which on nothing is found from a start that is always the same

    def _axes(self, omega: Real) -> Complex:
        """Values of the functions between axes, (F, m, ...), of transposed plants transposed too."""
        found = self.basis.axes(omega)
        return found.swapaxes(2, 3) if self.task.plants[0].turned else found

    def _in_basis(self, values: Complex) -> Complex:
        """Values of the orthonormal combinations, (F, m, ...)."""
        return np.einsum("fmij,mk->fkij", values, self.back)

    @property
    def ends(self) -> tuple[float, float]:
        """Levels of the goal between which it is searched."""
        return self.task.goal.ends(self.discs)

    def first(self) -> Found | None:
        """A controller of a level from the highest down; None where none is found."""
        low, high = self.ends
        levels = np.geomspace(low, high, _STEPS)[::-1].tolist()
        return next((found for level in levels if (found := self.found(level)) is not None), None)

    def best(self, least: float, near: Found) -> Found | None:
        """The controller of the highest level; None where none is found above `least`."""
        found = self.found(least, near)
        return None if found is None else self._climbed(found, self.ends[1], 1.5)

    def near(self, best: Found) -> Found | None:
        """The controller of about the level of another one, with these frequencies."""
        for part in _LOWER:
            if (found := self.found(best.level * part, best)) is not None:
                return self._climbed(found, best.level, 1.5)
        return None

    def raised(self, found: Found, high: float | None = None) -> Found:
        """A controller of a higher level: other directions open from the middle of what a lower level leaves, or for the models."""
        high = self.ends[1] if high is None else high
        best = self._climbed(found, high, 1.5)
        for part in _BACK:
            lower = self.found(best.level * part, best, centred=True)
            other = None if lower is None else self._climbed(lower, high, 1 / part)
            if other is not None and other.level > best.level * _FINE:
                best = other
        alone = self._alone()
        for step in _AHEAD:
            level = best.level * step
            lead = alone.found(level, best) if level <= high else None
            other = None if lead is None else self.found(level, lead)
            best = best if other is None else self._climbed(other, high, step)
        return best

    def _alone(self) -> At:
        """The same search for the models alone."""
        alone = copy.copy(self)
        alone.task = dataclasses.replace(self.task, smaller=_nowhere, heard=unheard)
        alone.discs, alone.lost = alone.task.discs(alone.task.grids), {}
        return alone

    def _climbed(self, found: Found, high: float, step: float) -> Found:
        """A controller of a higher level, in ever smaller steps."""
        centre, asked = found, None
        while step > _FINE:
            other = self.found(found.level * step, centre) if found.level * step <= high else None
            if other is not None:
                found = centre = other
                continue
            inner = None
            if centre is found is not asked:  # directions from the middle of what is possible lead further
                asked = found
                inner = self.found(found.level, found, centred=True)
            if inner is not None:
                centre = inner
            else:
                step = math.sqrt(step)
        return found

    def found(self, level: float, near: Found | None = None, *, centred: bool = False) -> Found | None:
        """A controller that keeps all limits at a level, from a few directions to begin with."""
        limits = self.task.asked(level)
        question, discs = self.question(limits)

        def accepted(factors: Real) -> bool:
            controller = self.basis.controller(self.back @ factors)
            return all(one.is_stable_with(controller) for one in self.task.plants)

        for name, values in self._starts(discs, limits, near):
            if level >= self.lost.get(name, math.inf):
                continue
            factors = found_for(question, values, accepted, centred=centred, go_on=self.task.go_on)
            if factors is not None:
                found = Found(self.at, level, self.basis.controller(self.back @ factors))
                self.task.heard(found)
                return found
            if name != _NEAR:
                self.lost[name] = level
        return None

    def _starts(self, discs: Discs, limits: Limits, near: Found | None) -> Iterator[tuple[str, Complex]]:
        """Values of controllers to begin with: one that is known, those that run, an integrator as loop, none."""
        if near is not None:
            yield _NEAR, self.task.values(StateMatrices.of(near.controller), discs.omega)
        running = self._running(discs)
        if running.any():
            yield "running", running
        corner = self._corner(discs, limits)
        wanted = (corner / (1j * discs.omega))[:, None, None]
        yield "wanted", wanted * np.linalg.pinv(discs.plant)
        if self.basis.integral.any() and discs.shape == (1, 1):  # with its integrator up to a part of the corner
            yield "integral", wanted * (1 + _PART * corner / (1j * discs.omega))[:, None, None] / discs.plant
        if discs.shape != (1, 1):  # the same of every loop by itself
            alone = np.where(self.held, (self.out_of @ discs.plant @ self.into).swapaxes(1, 2), 1.0)
            yield "alone", (self.into @ np.where(self.held, wanted / alone, 0.0) @ self.out_of).astype(complex)
        if near is None and not running.any():
            yield "none", running

    def _corner(self, discs: Discs, limits: Limits) -> float:
        """Bandwidth of the loop that is wanted: where limits say one, else by the integral gain, else in the middle."""
        if limits.bandwidth is not None:
            return limits.bandwidth
        if limits.integral_gain is not None:
            return limits.integral_gain / discs.typical
        ends = [high / max(value, 1e-3) for _, high, value in limits.attenuation]
        ends += [high for _, high, _ in limits.tracking]
        return min(max(ends), discs.omega.max()) if ends else math.sqrt(discs.omega.min() * discs.omega.max())

    def _running(self, discs: Discs) -> Complex:
        """Values of the controllers that run, each with its plants."""
        owners = [*self.owners, *range(len(self.task.plants))][: discs.omega.size]
        running = np.zeros((discs.omega.size, *discs.shape[::-1]), complex)
        for k, plants in enumerate(self.task.plants):
            own = np.equal(owners, k)
            ran = plants.running(discs.omega[own])
            running[own] = ran.swapaxes(1, 2) if plants.turned else ran
        return running

    def question(self, limits: Limits) -> tuple[Question, Discs]:
        """Conditions on a controller, and the discs they are about: where the bandwidth ends, too."""
        discs, axes = self.discs, self.axes
        if limits.bandwidth is not None:
            end = np.array([limits.bandwidth])
            discs = Discs.together([discs, self.task.discs([end] * len(self.task.plants))])
            last = self._in_basis(self._axes(end))
            axes = np.concatenate([axes, np.repeat(last, len(self.task.plants), axis=0)])
        conditions = conditions_of(limits.closer(self.task.spare), discs)
        if discs.shape[0] > 1 and limits.integral_gain is not None:
            conditions.append(integrators_of(limits.integral_gain, discs))
        return Question(Functions(axes, self.into, self.out_of), conditions, self._integrators(discs, limits)), discs

    def _integrators(self, discs: Discs, limits: Limits) -> tuple[Real, Real] | None:
        """Each integrator is to lower what the loop that runs leaves at the lowest frequency: ``G x >= h``.

        Of stable matrices the limits tell it, whose loops are large there; a plant that is large itself hides an integrator. One
        input or one output has one integrator.
        """
        running = self._running(discs)
        single = discs.shape[0] == 1
        if not (self.basis.integral.any() and (single or running.any())):
            return None
        lowest = int(np.argmin(discs.omega))
        P = discs.plant[lowest]
        L: Complex = P @ running[lowest]
        closed: Complex = np.asarray(np.linalg.solve(np.eye(len(P)) + L, P), dtype=complex)
        left: Real = np.real(self.out_of @ closed @ self.into)
        signs = np.sign(left if self.task.plants[0].turned else left.T)
        rows = [signs[i, j] * (own @ self.back) for i, j, own in self.basis.integrators]
        least = limits.integral_gain if single else None  # of matrices it is a singular value of all of them
        return np.array(rows), np.full(len(rows), least or 0.0)

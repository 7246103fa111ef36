"""Search of the best controller of a structure: levels of a goal, cones at frequencies, cuts where a proof fails."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from robustid.controllers.conditions import Discs, conditions_of
from robustid.controllers.factors import Factor
from robustid.controllers.goals import Goal
from robustid.controllers.limits import Limits
from robustid.controllers.plants import Plants
from robustid.controllers.proving import Proof, proof_of
from robustid.controllers.search import Question, found_for
from robustid.controllers.structure import Basis, Matrix, basis_of, entries_of, free_of
from robustid.core import Budget, Complex, Real, StateMatrices, points_of, response_at

if TYPE_CHECKING:
    import control

_FINE = 1.005  # of the goal: two levels that are as good as equal
_STEPS = 10  # levels over the axis that are tried from above
_SPARE = 0.995  # of every limit: what the proof on arcs takes
_CUTS = 6  # rounds of frequencies at which a proof failed
_LOWER = (1.0, 0.998, 0.995, 0.99, 0.97)  # of a level that failed its proof
_SEARCH = (1.5, 1.2, 1.07)  # factors that searched numbers are moved by


@dataclasses.dataclass(frozen=True)
class Found:
    """A controller, the numbers of its structure that were searched, and the level that it reaches."""

    at: list[float]
    level: float
    controller: control.StateSpace


@dataclasses.dataclass
class Task:
    """A design: its plants, and the frequencies of each that are asked about."""

    plants: list[Plants]
    structure: tuple[Factor, ...] | Matrix
    limits: Limits
    goal: Goal
    grids: list[Real]

    @classmethod
    def of(cls, plants: list[Plants], structure: tuple[Factor, ...] | Matrix, limits: Limits, goal: Goal) -> Task:
        """The design with frequencies to begin with: those of the plants, and the ends of the limits."""
        top = math.pi / plants[0].dt if plants[0].dt else math.inf
        ends = [one for one in goal.asked(limits, 1.0).frequencies if one < top]
        grids = [one.grid() for one in plants]
        inside = [[end for end in ends if grid[0] < end < grid[-1]] for grid in grids]
        return cls(
            plants, structure, limits, goal, [np.unique([*grid, *own]) for grid, own in zip(grids, inside, strict=True)]
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

    def designed(self, budget: Budget) -> tuple[Found, Proof] | None:
        """The best controller with its proof; None where none is found that keeps the limits at the frequencies."""
        best = None
        for at in (self.middle, *self._others()):
            if (best := _At(self, at).best()) is not None:
                break
        if best is None:
            return None
        best = self._searched(best, budget)
        proof = self._proof(best)
        for _ in range(_CUTS):
            where = [omega for share, omega in proof.shares.values() if share > 1 and omega > 0]
            if proof.kept or not where:
                break
            self.grids = [np.unique(np.concatenate([grid, where])) for grid in self.grids]
            here = _At(self, best.at)
            again = here.near(best) or here.best()
            if again is None:
                break
            best, proof = again, self._proof(again)
        return best, proof

    def _proof(self, found: Found) -> Proof:
        return proof_of(self.plants, found.controller, self.goal.asked(self.limits, found.level))

    def _others(self) -> Iterator[list[float]]:
        """Ends of the intervals, for a start."""
        for part in (0.0, 1.0):
            yield [low ** (1 - part) * high**part for low, high in self.intervals]

    def _searched(self, best: Found, budget: Budget) -> Found:
        """A better controller with other numbers in their intervals, one after the other, in smaller steps."""
        intervals = self.intervals
        for factor in _SEARCH:
            moved = True
            while moved and not budget.over:
                moved = False
                for k, (low, high) in enumerate(intervals):
                    if low == high:
                        continue
                    for step in (factor, 1 / factor):
                        at = list(best.at)
                        at[k] = min(max(at[k] * step, low), high)
                        if at[k] == best.at[k] or budget.over:
                            continue
                        other = _At(self, at).best(best.level * _FINE, best)
                        if other is not None and other.level > best.level * _FINE:
                            best, moved = other, True
                            break
        return best


class _At:
    """The search with given numbers of the structure."""

    def __init__(self, task: Task, at: Sequence[float]) -> None:
        self.task, self.at = task, list(at)
        self.basis: Basis = basis_of(task.structure, at, task.dt, task.shape)
        discs = [plants.discs(grid) for plants, grid in zip(task.plants, task.grids, strict=True)]
        self.discs = Discs(*(np.concatenate(parts) for parts in zip(*discs, strict=True)))
        self.owners = [k for k, grid in enumerate(task.grids) for _ in grid]
        plain = self.basis.response(self.discs.omega)
        omega = self.discs.omega
        falling = np.minimum(1.0, omega / np.exp(np.mean(np.log(omega))))  # an integrator is large where omega is small
        weighed = (falling[:, None] * self.discs.columns)[:, None, :, None] * plain
        flat = weighed.swapaxes(0, 1).reshape(self.basis.count, -1).T
        stacked = np.concatenate([flat.real, flat.imag])
        self.back = np.linalg.inv(np.linalg.qr(stacked, mode="r")) * math.sqrt(2 * omega.size)
        self.values = self._in_basis(plain)

    def _in_basis(self, values: Complex) -> Complex:
        """Values of the orthonormal combinations, (F, m, nu, ny)."""
        return np.einsum("fmij,mk->fkij", values, self.back)

    def best(self, least: float | None = None, near: Found | None = None) -> Found | None:
        """The controller of the highest level; None where none is found, or none above `least`."""
        low, high = self.task.goal.ends(self.discs)
        levels = np.geomspace(low, high, _STEPS)[::-1].tolist() if least is None else [least]
        for level in levels:
            if (found := self._found(level, near)) is not None:
                return self._raised(found, high)
        return None

    def near(self, best: Found) -> Found | None:
        """The controller of about the level of another one, with these frequencies."""
        for part in _LOWER:
            if (found := self._found(best.level * part, best)) is not None:
                return self._raised(found, best.level)
        return None

    def _raised(self, found: Found, high: float) -> Found:
        """A controller of a higher level, in ever smaller steps."""
        step, centre = 1.5, found
        while step > _FINE:
            other = self._found(found.level * step, centre) if found.level * step <= high else None
            if other is not None:
                found = centre = other
            elif centre is found and (inner := self._found(found.level, found, centred=True)) is not None:
                centre = inner  # directions from the middle of what is possible lead further
            else:
                step = math.sqrt(step)
        return found

    def _found(self, level: float, near: Found | None, *, centred: bool = False) -> Found | None:
        """A controller that keeps all limits at a level, from a few directions to begin with."""
        limits = self.task.goal.asked(self.task.limits, level)
        question, discs = self._question(limits)

        def accepted(factors: Real) -> bool:
            controller = self.basis.controller(self.back @ factors)
            return all(one.is_stable_with(controller) for one in self.task.plants)

        for values in self._starts(discs, limits, near):
            factors = found_for(question, question.directions(values), accepted, centred=centred)
            if factors is not None:
                return Found(self.at, level, self.basis.controller(self.back @ factors))
        return None

    def _starts(self, discs: Discs, limits: Limits, near: Found | None) -> Iterator[Complex]:
        """Values of controllers to begin with: one that is known, those that run, an integrator as loop, none."""
        if near is not None:
            yield response_at(StateMatrices.of(near.controller), points_of(discs.omega, self.task.dt))
        running = self._running(discs)
        if running.any():
            yield running
        wanted = (self._corner(discs, limits) / (1j * discs.omega))[:, None, None]
        yield wanted * np.linalg.pinv(discs.centre)
        if discs.shape != (1, 1):  # the same of every loop by itself
            basis, held = self.basis, self.basis.held
            alone = np.where(held, (basis.out_of @ discs.centre @ basis.into).swapaxes(1, 2), 1.0)
            yield (basis.into @ np.where(held, wanted / alone, 0.0) @ basis.out_of).astype(complex)
        if near is None and not running.any():
            yield running

    def _corner(self, discs: Discs, limits: Limits) -> float:
        """Bandwidth of the loop that is wanted: where limits say one, else by the integral gain, else in the middle."""
        if limits.bandwidth is not None:
            return limits.bandwidth
        if limits.integral_gain is not None:
            return limits.integral_gain / discs.typical
        ends = [high / max(value, 1e-3) for _, high, value in limits.attenuation]
        return min(max(ends), discs.omega.max()) if ends else math.sqrt(discs.omega.min() * discs.omega.max())

    def _running(self, discs: Discs) -> Complex:
        """Values of the controllers that run, each with its plants."""
        owners = [*self.owners, *range(len(self.task.plants))][: discs.omega.size]
        running = np.zeros((discs.omega.size, *discs.shape[::-1]), complex)
        for k, plants in enumerate(self.task.plants):
            own = np.equal(owners, k)
            running[own] = plants.running(discs.omega[own])
        return running

    def _question(self, limits: Limits) -> tuple[Question, Discs]:
        """Conditions on a controller, and the discs they are about: where the bandwidth ends, too."""
        discs, values = self.discs, self.values
        if limits.bandwidth is not None:
            end = np.array([limits.bandwidth])
            ends = [plants.discs(end) for plants in self.task.plants]
            discs = Discs(*(np.concatenate(parts) for parts in zip(discs, *ends, strict=True)))
            last = self._in_basis(self.basis.response(end))
            values = np.concatenate([values, np.repeat(last, len(ends), axis=0)])
        linear = None
        if limits.integral_gain is not None:
            gain = (self.basis.integral @ self.back)[None]
            lowest = int(np.argmin(discs.omega))  # an integrator is to lower what the loop that runs leaves there
            centre = discs.centre[lowest, 0, 0]
            left = 1 + centre * self._running(discs)[lowest, 0, 0]
            sign = np.sign(np.real(centre / left))
            linear = sign * gain, np.array([limits.integral_gain])
        return Question(values, conditions_of(limits.closer(_SPARE), discs), linear), discs

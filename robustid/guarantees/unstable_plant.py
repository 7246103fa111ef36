"""A consistent plant that a controller does not stabilise, found along the directions in which its loops come nearest to it."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

import numpy as np

from robustid.core import Budget, Complex, Frozen, Real, StateMatrices, closed_loop, decay_of, poles_of, response_at
from robustid.guarantees.consistent_set import ConsistentSet, consistent_set
from robustid.guarantees.value_set import along
from robustid.identification import Identification, Loop, MixedProblem, describe_poles, largest_ratio, nominal_model
from robustid.identification.formulation import Candidate
from robustid.reduction import plant_of

if TYPE_CHECKING:
    import control

_GAP = 0.02  # of the distance to the border of the set
_TRIED = 6  # frequencies
_APART = 1.3  # of the frequencies that are tried, one over the one before
_ROUNDED = 1e-6  # of a bound: what a model of a member may miss it by more


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class UnstablePlant(Frozen):
    """A plant that the data allow, and that a controller does not stabilise.

    Attributes
    ----------
    plant : control.StateSpace
        P(R).
    residual : control.StateSpace
        Its R, stable and consistent: every sample is within its bound.
    margin : float
        Largest part of a bound that a sample of R takes: at most 1.
    loop_poles : (n,) complex array
        Of the controller and the plant; some are not stable.
    omega : float, rad/s
        Where the loop encircles -1 otherwise than that of the nominal model; nan if that is not stable either.
    """

    plant: control.StateSpace
    residual: control.StateSpace
    margin: float
    loop_poles: Complex
    omega: float

    @property
    def unstable_poles(self) -> Complex:
        """Poles of the loop that are not stable, the fastest growing first."""
        growth = np.abs(self.loop_poles) - 1 if self.plant.dt else np.real(self.loop_poles)
        order = np.argsort(-growth)
        return self.loop_poles[order][growth[order] > 0]

    @property
    def pole_words(self) -> str:
        """Words on the fastest growing pole of the loop."""
        return describe_poles(self.unstable_poles[:1].real + 1j * np.abs(self.unstable_poles[:1].imag), self.plant.dt)

    def __repr__(self) -> str:
        return f"<UnstablePlant: order {self.plant.nstates}, closed-loop pole at {self.unstable_poles[0]:.5g}>"


def unstable_plant(
    identification: Identification, loop: Loop, controller: StateMatrices, frequencies: Real, budget: Budget
) -> UnstablePlant | None:
    """A consistent plant whose loop with the controller is not stable; None where none was found, which proves nothing.

    The model, and at each frequency, while there is time, the consistent R that goes farthest towards a singular loop are tried.
    """
    nominal, problem = identification.model, identification.problem
    if (found := judged_plant(problem, loop, controller, nominal, np.nan)) is not None:
        return found
    if budget.over:
        return None
    every, around = consistent_set(identification), loop.about(StateMatrices.of(nominal), controller)
    nu, ny = loop.shape
    for omega in _apart(frequencies):
        if budget.over:
            return None
        point = np.exp(1j * omega * loop.dt) if loop.dt else 1j * omega
        inner = response_at(around, np.array([point]))[0, nu + ny :, nu : nu + ny]  # x of e: I - inner E singular
        left, _, right = np.linalg.svd(inner)
        # E = v u* / sigma makes it singular.
        towards = np.outer(right[0].conj(), left[:, 0].conj())
        residual = _farthest(every.with_node(float(omega)), float(omega), towards, budget)
        if residual is None:
            continue
        if (found := judged_plant(problem, loop, controller, residual, float(omega))) is not None:
            return found
    return None


def _apart(frequencies: Real) -> list[float]:
    """The first few that are not near to one before."""
    kept: list[float] = []
    for omega in frequencies.tolist():
        if all(not 1 / _APART < omega / other < _APART for other in kept if other) and omega not in kept:
            kept.append(omega)
    return kept[:_TRIED]


def _farthest(every: ConsistentSet, omega: float, towards: Complex, budget: Budget) -> control.StateSpace | None:
    """A consistent R that goes about as far as any along a matrix (ny, nu): Re <towards, R> is largest."""
    x, p, tail = 0.0, 0.0, 0.0
    for entry in np.ndindex(*towards.shape):
        one = every.value_weights(omega, (entry[0], entry[1]))
        weight = np.conj(towards[entry])
        x, p, tail = x + weight * one[0], p + weight * one[1], tail + abs(weight) * one[2]
    point = every.member(along(0.0, np.asarray(x), np.asarray(p), float(tail)), _GAP, budget)
    if point is None:
        return None
    none = np.zeros(0)
    return nominal_model(every.posed, Candidate(*point, none, none, ""), every.level).model


def judged_plant(
    problem: MixedProblem, loop: Loop, controller: StateMatrices, residual: control.StateSpace, omega: float
) -> UnstablePlant | None:
    """The plant of R, if R is stable and inside the bounds, and the loop with the controller is not stable."""
    margin = largest_ratio(problem, residual)
    if margin > 1 + _ROUNDED or decay_of(residual.poles(), loop.dt) <= 0:
        return None
    plant = plant_of(loop, residual)
    poles = poles_of(closed_loop(StateMatrices.of(plant), controller).A)
    if decay_of(poles, loop.dt) >= 0:
        return None
    return UnstablePlant(plant, residual, margin, poles, omega)

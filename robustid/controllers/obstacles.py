r"""Proofs that no controller at all keeps some limits, with the number that stands in the way.

The sensitivity of a stable loop is 1 at infinity, to as many terms of 1/z as the loop has samples of delay, and at every zero of
the plant outside the stable region; T is 1 at its unstable poles. For weights :math:`\mu \ge 0` of the mean 1 that gives

.. math:: \int \operatorname{Re} S \, d\mu = 1, \qquad
          \int \log |S| \, d\mu \ge \sum_p \log \left|\frac{1 - \bar p \zeta}{\zeta - p}\right|,

with Poisson's kernel of a zero :math:`\zeta`, or with Fejér's kernel about any frequency for a delay (of log |S| where nothing in
the loop is unstable). Limits that leave less contradict it. All of it is about the plant of the model. Of matrices the mean of
:math:`\log |\det S|` over frequency is at least that of the unstable poles, and at most that of the largest singular value of S
times the number of outputs; zeros and delays have directions there, about which nothing is said.
"""

# pyright: reportConstantRedefinition=false
# Matrices have capital letters.
from __future__ import annotations

import dataclasses
import enum
import math
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
import scipy.linalg

from robustid.controllers.factors import Factor
from robustid.controllers.limits import Limits
from robustid.controllers.plants import Plants
from robustid.controllers.structure import Matrix, basis_of, entries_of, free_of
from robustid.core import Complex, Real, StateMatrices, norms, poles_of, response_at

_ROUNDING = 1e-9  # of poles and zeros on the edge of the stable region, and of what contradicts
_NOTHING = 1e-12  # of the states and the outputs: a sample of an impulse response that is rounding
_CANCELLED = 1e-3  # of a pole: a zero that is nearer
_SAMPLES = 200  # of it
_FAR = 1e4  # zeros that are farther are at infinity
_KERNELS = 65  # frequencies about which a delay is weighted
_HALF = 0.5  # the real part of S at most, and the size of T at least, where |P C| is at least 1


class Law(enum.Enum):
    """Law that limits contradict; the value is the user's sentence."""

    BOUNDS = "near {hz:.4g} Hz the bounds are {have:.4g} of the plant's least gain: it may be 0 there, and the loop is to be large"
    ACTION = "near {hz:.4g} Hz |C S| must be at least {need:.4g} for what is asked there; the limits allow {have:.4g}"
    BODE = (
        "the mean of log |S| over frequency is at least {need:.4g} in every loop; the limits allow at most {have:.4g}"
    )
    DELAY = (
        "with the delay of the loop the mean of log |S|, weighted about {hz:.4g} Hz, is at least {need:.4g} in every loop;"
        " the limits allow at most {have:.4g}"
    )
    DELAY_REAL = (
        "with the delay of the loop the mean of Re S, weighted about {hz:.4g} Hz, is {need:.4g} in every loop; the limits"
        " allow at most {have:.4g}"
    )
    ZERO = (
        "with an unstable zero of the plant near {hz:.4g} Hz the weighted mean of log |S| is at least {need:.4g} in every"
        " loop; the limits allow at most {have:.4g}"
    )
    ZERO_REAL = (
        "with an unstable zero of the plant near {hz:.4g} Hz the weighted mean of Re S is {need:.4g} in every loop; the"
        " limits allow at most {have:.4g}"
    )
    POLE = (
        "with an unstable pole of the plant near {hz:.4g} Hz the weighted mean of log |T| is at least {need:.4g} in every"
        " loop; the limits allow at most {have:.4g}"
    )
    POLE_REAL = (
        "with an unstable pole of the plant near {hz:.4g} Hz the weighted mean of Re T is {need:.4g} in every loop; the"
        " limits allow at most {have:.4g}"
    )


@dataclasses.dataclass(frozen=True)
class Obstacle:
    """Law that limits contradict, whatever the controller.

    Attributes
    ----------
    law : Law
    need : float
        What every loop has at least, or needs.
    have : float
        What the limits allow at most; of the bounds their ratio to the size of the plant.
    omega : float
        Where it is, rad/s.
    """

    law: Law
    need: float
    have: float
    omega: float

    @property
    def sentence(self) -> str:
        """The law with its numbers."""
        return self.law.value.format(need=self.need, have=self.have, hz=self.omega / (2 * math.pi))


def obstacle_of(plants: Sequence[Plants], structure: tuple[Factor, ...] | Matrix, limits: Limits) -> Obstacle | None:
    """Law that no stabilising controller keeps the limits by, with all plants; None where none is known."""
    for one in plants:
        if (found := _at_frequencies(one, limits)) is not None:
            return found
    means = [found for one in plants for found in means_of(one, structure, limits)]
    over = [one for one in means if one.need - one.have > _ROUNDING * (1 + abs(one.need))]
    return max(over, key=lambda one: one.need - one.have, default=None)


def _at_frequencies(plants: Plants, limits: Limits) -> Obstacle | None:
    r"""Frequencies at which the plant may be 0 where the loop is to be large, or where more action is needed than allowed.

    With :math:`T = P\, C S` the least singular value of T is at most that of P times the largest one of C S. Of the plants
    :math:`(c D^{-1} + \Delta) D` one has a row :math:`(\sigma - r) v^* D`, along the last singular vectors of :math:`c D^{-1}`.
    """
    ends = [one for one in limits.frequencies if not plants.dt or one < math.pi / plants.dt]
    discs = plants.discs(np.unique([*plants.grid(), *ends]))
    needed = np.zeros(discs.omega.size)  # |T| at least
    for low, high, value in limits.attenuation:
        here = (discs.omega >= low) & (discs.omega <= high)
        needed = np.where(here, np.maximum(needed, 1 - value), needed)
    for low, high, value in limits.tracking:
        here = (discs.omega >= low) & (discs.omega <= high)
        needed = np.where(here, np.maximum(needed, value), needed)
    if limits.bandwidth is not None:
        needed = np.where(discs.omega <= limits.bandwidth, np.maximum(needed, _HALF), needed)
    ny = discs.shape[0]
    if ny == 1:
        size, unit, least = norms(discs.centre), np.ones(discs.omega.size), discs.least
    else:
        _, sizes, right = np.linalg.svd(discs.centre / discs.units[:, None, :])
        size, unit = sizes[:, -1], np.linalg.norm(right[:, ny - 1] * discs.units, axis=1)
        least = size - discs.radius
    share = np.where(needed > 0, (size - least) / np.maximum(size, np.finfo(float).tiny), 0.0)
    k = int(np.argmax(share))
    if share[k] >= 1 + _ROUNDING:
        return Obstacle(Law.BOUNDS, 1.0, float(share[k]), float(discs.omega[k]))
    allowed = np.full(discs.omega.size, limits.control_peak or math.inf)
    for low, high, value in limits.action:
        here = (discs.omega >= low) & (discs.omega <= high)
        allowed = np.where(here, np.minimum(allowed, value), allowed)
    action = np.where(needed > 0, needed / np.maximum(least * unit, np.finfo(float).tiny), 0.0)
    k = int(np.argmax(action / allowed))
    if action[k] > allowed[k] * (1 + _ROUNDING):
        return Obstacle(Law.ACTION, float(action[k]), float(allowed[k]), float(discs.omega[k]))
    return None


class _Steps(NamedTuple):
    """Upper bounds that are constant between edges, from frequency 0 to the end of the axis."""

    edges: Real
    S: Real  # |S|
    real_S: Real
    T: Real  # |T|, and Re T

    @classmethod
    def of(cls, limits: Limits, top: float) -> _Steps:
        edges = np.unique([0.0, top, *(one for one in limits.frequencies if one < top)])
        middle = np.minimum((edges[:-1] + edges[1:]) / 2, 2 * edges[:-1] + 1)
        S = np.full(middle.size, limits.sensitivity_peak or np.inf)
        T = np.full(middle.size, limits.complementary_peak or np.inf)
        for rows, of in ((limits.attenuation, S), (limits.roll_off, T)):
            for low, high, value in rows:
                here = (middle > low) & (middle < high)
                of[here] = np.minimum(of[here], value)
        S, T = np.minimum(S, 1 + T), np.minimum(T, 1 + S)
        real = np.where(middle < (limits.bandwidth or 0.0), np.minimum(S, _HALF), S)
        return cls(edges, S, real, T)

    def mean(self, bounds: Real, mass: Callable[[Real], Real]) -> float:
        """The mean of bounds with a weight, whose mass up to frequencies is given."""
        part = np.maximum(np.diff(mass(self.edges)), 0.0)
        return float(np.sum(np.where(part > 0, part * np.where(part > 0, bounds, 0.0), 0.0)))


def means_of(plants: Plants, structure: tuple[Factor, ...] | Matrix, limits: Limits) -> Iterator[Obstacle]:
    """All means: those of every loop, and the largest that the limits allow."""
    dt, model = plants.dt, plants.model
    steps = _Steps.of(limits, math.pi / dt if dt else math.inf)
    if model.D.shape != (1, 1):
        if dt and _delay(model):
            need = float(np.sum(np.log(np.abs(unstable_of(poles_of(model.A), dt))))) / min(model.D.shape)
            yield Obstacle(Law.BODE, need, steps.mean(np.log(steps.S), partial(_fejer, dt=dt, about=0.0, delay=1)), 0.0)
        return
    middle = [math.sqrt(low * high) for low, high in free_of(entries_of(structure, (1, 1)))]
    ((*_, fixed),) = basis_of(structure, middle, dt).parts
    poles, zeros = unstable_of(poles_of(model.A), dt), unstable_of(zeros_of(model), dt)
    calm = not poles.size and not unstable_of(poles_of(fixed.A), dt).size
    poles, zeros = _apart(poles, zeros), _apart(zeros, poles)
    delay = _delay(model) + _delay(fixed) if dt else 0
    if delay:
        need = float(np.sum(np.log(np.abs(poles))))
        yield Obstacle(Law.BODE, need, steps.mean(np.log(steps.S), partial(_fejer, dt=dt, about=0.0, delay=1)), 0.0)
    for about in np.linspace(0.0, math.pi, _KERNELS if delay > 1 else 1).tolist() if delay else ():
        mass = partial(_fejer, dt=dt, about=about, delay=delay)
        yield Obstacle(Law.DELAY_REAL, 1.0, steps.mean(steps.real_S, mass), about / dt)
        if calm:
            yield Obstacle(Law.DELAY, 0.0, steps.mean(np.log(steps.S), mass), about / dt)
    for zero in zeros.tolist():
        mass, where = partial(_poisson, point=zero, dt=dt), _frequency(zero, dt)
        yield Obstacle(Law.ZERO, _blaschke(zero, poles, dt), steps.mean(np.log(steps.S), mass), where)
        yield Obstacle(Law.ZERO_REAL, 1.0, steps.mean(steps.real_S, mass), where)
    for pole in poles.tolist():
        mass, where = partial(_poisson, point=pole, dt=dt), _frequency(pole, dt)
        need = _blaschke(pole, zeros, dt) + delay * math.log(abs(pole))
        yield Obstacle(Law.POLE, need, steps.mean(np.log(steps.T), mass), where)
        yield Obstacle(Law.POLE_REAL, 1.0, steps.mean(steps.T, mass), where)


def unstable_of(points: Complex, dt: float) -> Complex:
    """Points outside the stable region, by more than rounding."""
    if dt:
        return points[(np.abs(points) > 1 + _ROUNDING) & (np.abs(points) < _FAR)]
    size = np.abs(points).max(initial=0.0)
    return points[points.real > _ROUNDING * size]


def _apart(points: Complex, others: Complex) -> Complex:
    """Points that no other one is near: a pole and a zero that cancel but for rounding are none."""
    if not others.size:
        return points
    return points[np.min(np.abs(points[:, None] - others), axis=1, initial=np.inf) > _CANCELLED * np.abs(points)]


def zeros_of(system: StateMatrices) -> Complex:
    """Finite zeros of one input and one output, as far as they are zeros of its values."""
    A, B, C, D = system
    if not len(A):
        return np.zeros(0, complex)
    pencil, unit = np.block([[A, B], [C, D]]), scipy.linalg.block_diag(np.eye(len(A)), np.zeros((1, 1)))
    found = np.asarray(scipy.linalg.eigvals(pencil, unit), dtype=complex)
    size = np.abs(poles_of(A)).max()
    found = found[np.isfinite(found) & (np.abs(found) < _FAR * max(size, _NOTHING))]
    if not found.size:
        return found
    around = response_at(system, found * (1 + 1e-3) + 1e-3 * size)[:, 0, 0]
    return found[np.abs(response_at(system, found)[:, 0, 0]) < 1e-6 * np.abs(around)]


def _delay(system: StateMatrices) -> int:
    """Samples of delay that all outputs have: what is rounding of the impulse response counts as none."""
    A, B, C, D = system
    if np.abs(D).max() > _NOTHING * np.abs(C).max(initial=0.0) * np.abs(B).max(initial=0.0):
        return 0
    state = B
    for k in range(1, _SAMPLES):
        if np.abs(C @ state).max() > _NOTHING * np.abs(C).max() * np.abs(state).max():
            return k
        state = A @ state
    return 0


def _fejer(omega: Real, *, dt: float, about: float, delay: int) -> Real:
    """Mass up to frequencies of Fejér's kernel about an angle and its mirror image, of as many terms as a delay allows."""
    theta, k = omega * dt, np.arange(1, delay)
    factors = (1 - k / delay) * np.cos(k * about) / k
    return (theta + 2 * np.sin(np.multiply.outer(theta, k)) @ factors) / math.pi


def _poisson(omega: Real, *, point: complex, dt: float) -> Real:
    """Mass up to frequencies of Poisson's kernel of a point outside the stable region, and of its mirror image."""
    if not dt:
        return (np.arctan((omega - point.imag) / point.real) + np.arctan((omega + point.imag) / point.real)) / math.pi
    r, at = abs(point), math.atan2(point.imag, point.real)

    def mass(x: Real) -> Real:
        turns = np.round(x / (2 * math.pi))
        return turns + np.arctan((r + 1) / (r - 1) * np.tan((x - 2 * math.pi * turns) / 2)) / math.pi

    return mass(omega * dt - at) + mass(omega * dt + at)


def _blaschke(point: complex, others: Complex, dt: float) -> float:
    """Sum of ``log |1 - conj(p) z| / |z - p|`` over other points outside the stable region."""
    if not others.size:
        return 0.0
    away = np.abs(1 - others.conj() * point) if dt else np.abs(point + others.conj())
    near = np.abs(point - others)
    return float(np.sum(np.log(away / np.maximum(near, np.finfo(float).tiny))))


def _frequency(point: complex, dt: float) -> float:
    """Frequency of a point in rad/s: of a real one its distance from the edge."""
    if not dt:
        return abs(point)
    return float(abs(np.log(point))) / dt

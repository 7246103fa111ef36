"""Weights of a class: known functions that say how large the non-parametric part may be, frequency by frequency."""

# pyright: reportConstantRedefinition=false
# Matrices have capital letters.
from __future__ import annotations

import dataclasses
import functools
from collections.abc import Iterable
from typing import Any, cast

import numpy as np

from robustid.core import (
    Complex,
    Frozen,
    Numbers,
    Plane,
    Real,
    Record,
    StateMatrices,
    as_state_space,
    points_of,
    scaled_states,
    simulate,
)
from robustid.errors import InputError, InputTypeError

_SAME = 1e-6  # relative: a weight whose zeros and poles do not give its values again is not known well enough
_REAL = 1e-9  # imaginary parts this small, relatively, are rounding; so are distances from the axis or the circle
_CLOSE = 1e-3  # of the largest value on a circle: by how much its bound may exceed it
_ROUNDS = 60  # halvings of its arcs

Roots = tuple[complex, ...]


@dataclasses.dataclass(frozen=True)
class PriorWeight(Frozen):
    r"""A weight W of one input and one output by its zeros and poles, and its factor.

    .. math:: W = c \frac{\prod_i (z - z_i)}{\prod_i (z - p_i)}, \qquad \text{or with } s \text{ in the place of } z

    Parameters
    ----------
    zeros, poles : tuple of complex
        In conjugate pairs; at most as many zeros as poles.
    gain : float
        c.
    dt : float, s
        Sample time; 0 for a function of s.
    """

    zeros: Roots
    poles: Roots
    gain: float
    dt: float

    def __repr__(self) -> str:
        zeros, poles = (", ".join(f"{root:.6g}" for root in side) or "none" for side in (self.zeros, self.poles))
        return f"<weight of {'z' if self.dt else 's'}: zeros {zeros}; poles {poles}; factor {self.gain:.6g}>"

    def at(self, points: Complex) -> Complex:
        """Values at points s or z, factor by factor: products of all poles would overflow."""
        value = np.full(np.shape(points), complex(self.gain))
        for k, pole in enumerate(self.poles):
            value = value * ((points - self.zeros[k] if k < len(self.zeros) else 1.0) / (points - pole))
        return value

    @functools.cached_property
    def states(self) -> StateMatrices:
        """A chain of real sections of one or two states; no direct term at all where there are fewer zeros than poles."""
        chain = StateMatrices(np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), np.ones((1, 1)))
        rest = float(self.gain)
        # Roots that are alike in one section, and sections of about unit size, whatever the unit of time.
        sides = (sorted(side, key=lambda root: abs(root - (self.dt > 0))) for side in (self.zeros, self.poles))
        for zeros, poles in _pairs(*map(tuple, sides)):
            A, B, C, D = in_series(chain, _section(zeros, poles))
            chain = StateMatrices(*scaled_states(A, B, C), D)
            rest /= _size(zeros, poles)
        return _times(chain, rest)

    def moved(self, *, times: float = 1.0, plus: float = 0.0) -> PriorWeight:
        """The weight with zeros and poles elsewhere, and the same factor."""
        zeros, poles = (tuple(times * root + plus for root in side) for side in (self.zeros, self.poles))
        return dataclasses.replace(self, zeros=zeros, poles=poles)

    def peak(self, radius: float) -> float:
        """A bound of the largest size on the circle |z| = radius, at most 0.1 % above it.

        On an arc of half-width h every factor changes by at most h; arcs that may hold the largest size are halved.
        """
        if not self.poles:
            return abs(self.gain)
        centre, half, found = np.full(1, np.pi / 2), np.pi / 2, 0.0
        for _ in range(_ROUNDS):
            z = np.asarray(radius * np.exp(1j * centre), dtype=complex)
            above, below = np.full(z.size, abs(self.gain)), np.ones(z.size)
            found = max(found, float(np.abs(self.at(z)).max()))
            for root in self.zeros:
                above = above * (np.abs(z - root) + radius * half)
            for root in self.poles:
                below = below * np.maximum(np.abs(z - root) - radius * half, 0.0)
            with np.errstate(divide="ignore"):  # a pole too near for the arc
                upper = above / below
            if upper.max() <= found * (1 + _CLOSE):
                return float(upper.max()) * (1 + _REAL)
            half /= 2
            centre = (centre[upper > found, None] + [-half, half]).ravel()
        return np.inf

    @property
    def fields(self) -> Record:
        """Numbers from which it can be made again, as they are stored (`as_weight`)."""
        zeros, poles = ([[float(a.real), float(a.imag)] for a in side] for side in (self.zeros, self.poles))
        return {"zeros": zeros, "poles": poles, "gain": float(self.gain), "dt": float(self.dt)}


ONE = PriorWeight((), (), 1.0, 0.0)


@dataclasses.dataclass(frozen=True)
class Weighting(Frozen):
    """The weight of a problem, on the circle of its plane: G = W phi, phi in the ball of the prior."""

    own: PriorWeight  # `ONE` where the prior has none
    plane: Plane

    @property
    def trivial(self) -> bool:
        """Say whether W is 1."""
        return self.own == ONE

    def values(self, angles: Real) -> Complex:
        """W at exp(j angle), (F,)."""
        angles = np.asarray(angles, dtype=float)
        return np.ones(angles.shape, complex) if self.trivial else self.own.at(self._points(angles))

    def _points(self, angles: Real) -> Complex:
        return points_of(self.plane.omega(angles), self.plane.dt or None)

    def sizes(self, angles: Real) -> Real:
        """|W| at exp(j angle), (F,)."""
        return np.abs(self.values(angles))

    def times(self, functions: Any, angles: Real) -> Any:
        """W times the values (F, ...) of functions at exp(j angle)."""
        return functions if self.trivial else functions * _along(self.values(angles), functions)

    def filtered(self, u: Real) -> Real:
        """The response of W to each of some inputs (T,) or (T, nu), from zero initial conditions."""
        if self.trivial or not u.size:
            return u
        one = [simulate(self.own.states, column[:, None])[0][:, 0] for column in u.reshape(len(u), -1).T]
        return np.stack(one, axis=1).reshape(u.shape)

    @functools.cached_property
    def states(self) -> StateMatrices:
        """A state space of W in z."""
        return self.plane.in_z(self.own.states)

    @property
    def order(self) -> int:
        """Number of its states."""
        return len(self.own.poles)

    def joined(self, system: StateMatrices, plane: Plane) -> StateMatrices:
        """W times a system of (ny, nu) in the variable of its own plane, or in z; W stands on the side with fewer signals."""
        weight, copies = self.own.states if plane == self.plane else self.states, min(system.D.shape)
        whole = StateMatrices(*(np.asarray(np.kron(part, np.eye(copies)), dtype=float) for part in weight))
        return in_series(whole, system) if copies == system.D.shape[1] else in_series(system, whole)

    def peak(self, rate: float) -> float:
        """Bound of |W| where the class is bounded, on |z| = 1/rho: impulse responses of the class stay below K peak rho^-k."""
        return self.own.peak(1 / rate)


def _along(values: Complex, functions: Numbers) -> Complex:
    """Values (F,) in the shape that multiplies (F, ...)."""
    return values.reshape(-1, *(1,) * (np.ndim(functions) - 1))


def in_series(first: StateMatrices, second: StateMatrices) -> StateMatrices:
    """The system that sends what the first one puts out through the second one: their product, second times first."""
    (a, b, c, d), (A, B, C, D) = first, second
    return StateMatrices(
        np.block([[A, B @ c], [np.zeros((a.shape[0], A.shape[0])), a]]),
        np.vstack([B @ d, b]),
        np.hstack([C, D @ c]),
        D @ d,
    )


def _pairs(zeros: Roots, poles: Roots) -> list[tuple[Roots, Roots]]:
    """Zeros and poles in sections of at most two: conjugate pairs stay together."""
    (pairs, reals), (upper, real) = _sorted(poles), _sorted(zeros)
    sections: list[tuple[Roots, Roots]] = []
    while pairs or upper:
        below = pairs.pop() if pairs else (reals.pop(), reals.pop())
        above = upper.pop() if upper else tuple(real.pop() for _ in range(min(2, len(real))))
        sections.append((above, below))
    sections += [((real.pop(),) if real else (), (pole,)) for pole in reals]
    return sections


def _sorted(roots: Roots) -> tuple[list[Roots], list[complex]]:
    """Conjugate pairs, and real roots."""
    return [(root, root.conjugate()) for root in roots if root.imag > 0], [root for root in roots if root.imag == 0]


def _section(zeros: Roots, poles: Roots) -> StateMatrices:
    """One or two states, in u = z - the mean of the poles: poles and zeros that are near to each other and to 1 keep their digits.

    Two poles are u^2 + w = 0, two zeros u^2 + b u + q = 0.
    """
    centre = sum(poles).real / len(poles)
    away = [centre - zero for zero in zeros]
    through = np.full((1, 1), float(len(zeros) == len(poles)))
    if len(poles) == 1:
        row = [away[0].real if away else 1.0]
        return _times(
            StateMatrices(np.full((1, 1), centre), np.ones((1, 1)), np.array([row]), through), _size(zeros, poles)
        )
    w = -((poles[0] - poles[1]) ** 2).real / 4
    row = [1.0, 0.0] if not away else [away[0].real, 1.0]
    if len(away) == 2:
        row = [(away[0] * away[1]).real - w, sum(away).real]
    A = np.array([[centre, 1.0], [-w, centre]])
    return _times(StateMatrices(A, np.eye(2, 1, -1), np.array([row]), through), _size(zeros, poles))


def _size(zeros: Roots, poles: Roots) -> float:
    """The factor that makes a section about as large as 1: product of its poles over that of its zeros, those at 0 left out."""
    below, above = (float(np.prod([abs(root) for root in roots if root])) for roots in (poles, zeros))
    return below / above


def _times(system: StateMatrices, gain: float) -> StateMatrices:
    """A system times a number, half of it on either side of its states."""
    root = float(np.sqrt(abs(gain)))
    return StateMatrices(system.A, system.B * root, system.C * (root if gain > 0 else -root), system.D * gain)


def as_weight(value: object) -> PriorWeight:
    """The weight that a `control` system of one input and one output is, or what was stored of one.

    InputTypeError, InputError: several inputs or outputs, no time base, a zero system, an unstable one or one that is not
    of minimum phase, a delay, zeros or poles that cannot be computed.
    """
    import control

    if isinstance(value, PriorWeight):
        return value
    if isinstance(value, dict):
        stored = cast("Record", value)
        zeros, poles = (tuple(complex(*root) for root in stored[name]) for name in ("zeros", "poles"))
        return PriorWeight(zeros, poles, float(stored["gain"]), float(stored["dt"]))
    value = value if isinstance(value, control.TransferFunction) else as_state_space("weight", value)
    if not isinstance(value, control.StateSpace | control.TransferFunction):
        raise InputTypeError(
            f"`weight` must be a control.StateSpace or control.TransferFunction; got {type(value).__name__}"
        )
    system: Any = value
    if (system.ninputs, system.noutputs) != (1, 1):
        raise InputError(
            "`weight` must have one input and one output: it multiplies the whole non-parametric part; got"
            f" {system.noutputs} outputs and {system.ninputs} inputs. Sizes of the entries go to `scaling`"
        )
    if system.dt is None or system.dt is True:
        raise InputError(f"`weight` has dt = {system.dt}; give it its sample time in s, or dt = 0 for continuous time")
    return _of_control(system)


def _of_control(system: Any) -> PriorWeight:
    """Zeros, poles and factor of a system, held against its own values."""
    zeros, poles = (_conjugate(np.asarray(part, complex)) for part in (system.zeros(), system.poles()))
    size = 1 + 2 * max(map(abs, (*zeros, *poles)), default=0.0)

    def values(points: Iterable[complex]) -> Complex:
        return np.asarray([complex(np.squeeze(system(point))) for point in points])

    factor = PriorWeight(zeros, poles, 1.0, float(system.dt)).at(np.array([size + 0j]))[0]
    found = dataclasses.replace(
        ONE, zeros=zeros, poles=poles, gain=float((values([size])[0] / factor).real), dt=float(system.dt)
    )
    some = np.exp(1j * np.array([0.4, 1.3, 2.6])) if system.dt else 1j * size * np.array([0.01, 0.1, 0.5])
    known = values(some)
    if len(zeros) > len(poles) or not np.all(np.abs(known) > 0) or not np.isfinite(found.gain):
        raise InputError("`weight` must be a proper function that is not zero; got one whose zeros and poles are not")
    if not np.allclose(found.at(some), known, rtol=_SAME, atol=0):
        raise InputError(
            f"`weight`: its {len(zeros)} zeros and {len(poles)} poles, as computed, do not give its values again; give one of"
            " lower order, as a control.TransferFunction by its zeros and poles (control.zpk)"
        )
    _check_outer(found)
    return found


def _check_outer(weight: PriorWeight) -> None:
    """Refuse what is not stable, or not of minimum phase: zeros may lie on the axis or circle itself."""
    where = "|z| < 1" if weight.dt else "Re s < 0"
    for name, roots, border in (("pole", weight.poles, -_REAL), ("zero", weight.zeros, _REAL)):
        for root in roots:
            beyond = abs(root) - 1 if weight.dt else root.real / max(abs(root), np.finfo(float).tiny)
            if beyond > border:
                raise InputError(
                    f"`weight` has a {name} at {'z' if weight.dt else 's'} = {root:.6g}; it must be stable and of minimum phase,"
                    f" with poles and zeros in {where}: only its size matters, so mirror what lies outside"
                )
    if weight.dt and len(weight.zeros) < len(weight.poles):
        raise InputError(
            f"`weight` has {len(weight.zeros)} zeros and {len(weight.poles)} poles: in discrete time that is a delay, and not of"
            " minimum phase. Multiply it by z to the difference"
        )


def _conjugate(roots: Complex) -> Roots:
    """Roots of a real polynomial, pairs exactly conjugate, real ones without an imaginary part."""
    above = [complex(root) for root in roots if root.imag > _REAL * abs(root)]
    real = [complex(root.real) for root in roots if abs(root.imag) <= _REAL * abs(root)]
    return (*(one for root in above for one in (root, root.conjugate())), *real)

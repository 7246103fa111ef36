"""Modes with real shapes (proportional damping): their states, their tangent space, their steps.

A mode moves with one function of frequency, ``s^q/(s^2 + 2 zeta omega s + omega^2)`` or its samples behind a zero-order hold, times
a real matrix of rank one. So one state function a mode takes the place of two, and what is left is refined as `BlockModel`.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from robustid.core import Complex, Frozen, Real, StateMatrices, freeze
from robustid.fitting.state_space.block_model import tied_gains, with_transposes
from robustid.fitting.state_space.given_poles import diagonal_blocks
from robustid.fitting.state_space.integrator_chains import chain
from robustid.fitting.state_space.pole_distances import EDGE, RESOLVED, least_distances, line_spacing

_FAR = 100.0  # poles in s, in the unit of the nodes
_NYQUIST = 0.999 * math.pi  # rad/sample: a mode between the samples has no real shape
_DOUBLE = 1e-2  # the square of a mode's frequency moves in units of at least this part of its damping
_EQUAL = 1e-10  # poles whose half difference has a smaller square are taken apart by that: (rad/sample)^2
_PER_MODE = ("centre", "square", "inputs")


class _Curve(NamedTuple):
    """``h = numerator/denominator`` of every mode, in the variable of the nodes: what there is of it, and its derivatives."""

    poles: Complex  # (m, 2)
    numerator: Real  # (m, 2): highest power first
    constant: float  # h at infinity
    turns: Real  # (2, m, 2) of the numerator, by centre and square
    falls: Real  # (2, m, 2) of the denominator, highest power first


@dataclasses.dataclass(frozen=True, eq=False)
class RealModes(Frozen):
    """Modes of real shape ``h_k(xi) c_k b_k'`` and rigid-body modes ``g(xi) C_r B_r``, with g the samples of 1/s^2. With poles
    ``a ± sqrt(-w)`` in s, h and its samples are smooth in (a, w), also where the two poles become real. Modulo scalings that C
    takes up, a mode has two coordinates for its poles and nu - 1 for its direction; with C, 1 + nu + ny in all.
    """

    centre: Real  # a and w (m,): decay and square of the damped frequency, in the unit of the nodes or rad/sample
    square: Real
    inputs: Real  # b (m, nu), of norm one
    directions: Real  # B_r (count, nu); count may be 0
    free: NDArray[np.bool_]  # entries of the directions that are refined
    discrete: bool
    power: int  # q: 0 for positions, 1 for velocities, 2 for accelerations

    width = 1  # columns of C that a mode has

    def __post_init__(self) -> None:
        names = (*_PER_MODE, "directions", "free")
        self._set(**{name: freeze(getattr(self, name)) for name in names})

    @property
    def order(self) -> int:
        """Number of columns of C: one for every mode."""
        return self.centre.size + len(self.directions)

    @property
    def decays(self) -> Complex:
        """Poles in s, each pair together, (m, 2): in the unit of the nodes or rad/sample."""
        swing = np.sqrt((-self._apart).astype(complex))
        return np.stack([self.centre + swing, self.centre - swing], axis=1).astype(np.complex128)

    @property
    def poles(self) -> Complex:
        """Poles in the variable of the nodes, each pair together; without rigid-body modes."""
        return (np.exp(self.decays) if self.discrete else self.decays).ravel().astype(np.complex128)

    @property
    def distances(self) -> Real:
        """Distance of the modes from the stability boundary in s, negative outside."""
        return -(self.centre + np.sqrt(np.maximum(-self.square, 0.0)))

    @property
    def _apart(self) -> Real:
        """The squares, without double poles."""
        return np.where(np.abs(self.square) < _EQUAL, np.where(self.square < 0, -_EQUAL, _EQUAL), self.square)

    @property
    def _unit(self) -> Real:
        """Unit in which the squares move: the frequency, as (a, w/s) move poles as far as they move themselves."""
        return np.maximum(np.sqrt(np.abs(self.square)), np.maximum(_DOUBLE * np.abs(self.centre), EDGE))

    def normalised(self) -> RealModes:
        """The same modes with directions of norm one."""
        size = np.linalg.norm(self.inputs, axis=1, keepdims=True)
        return dataclasses.replace(self, inputs=self.inputs / np.where(size > 0, size, 1.0))

    def states(self, xi: Complex) -> Complex:
        """``h_k b_k'`` and ``g B_r``, (F, m + count, nu)."""
        flexible = self._values(xi)[0][..., None] * self.inputs
        return np.concatenate([flexible, self._rigid(xi)[:, None, None] * self.directions], axis=1)

    def tangent(self, xi: Complex, states: Complex, C: Real, directions: Complex | None = None) -> Complex:
        """Derivatives (F, ny, nu, T) of the response ``C states`` in the coordinates of `moved`, those of the poles first."""
        del states, directions
        values, slopes = self._values(xi)
        m = self.centre.size
        shapes = np.einsum("om,mu->oum", C[:, :m], self.inputs)
        parts = [slope[:, None, None] * shapes for slope in (slopes[0], self._unit * slopes[1])]
        turned = np.einsum("om,muq->oumq", C[:, :m], self.input_moves())
        parts.append((values[:, None, None, :, None] * turned).reshape(*parts[0].shape[:3], m * turned.shape[3]))
        for i, j in np.argwhere(self.free):
            change = np.zeros((xi.size, len(C), self.inputs.shape[1], 1), dtype=complex)
            change[:, :, j, 0] = self._rigid(xi)[:, None] * C[:, m + i]
            parts.append(change)
        return np.concatenate(parts, axis=3)

    @property
    def pole_coordinates(self) -> int:
        """Number of the coordinates that move poles, the first of `tangent`."""
        return 2 * self.centre.size

    def reach(self, xi: Complex) -> Real:
        """Scale of every coordinate (T,): distance of a pole from the nearest frequency point, size of the inputs."""
        near = np.array([np.abs(xi - pole).min() for pole in self.poles]).reshape(-1, 2).min(axis=1)
        nu = self.inputs.shape[1]
        sizes = np.abs(self.directions).max(axis=1, initial=0.0)[:, None] * np.ones(nu)
        return np.concatenate([near, near, np.ones(self.centre.size * (nu - 1)), sizes[self.free]])

    def normals(self) -> Real:
        """Gradients (m, 2 m) of the `distances` in the coordinates of the poles."""
        real = self.square < 0
        along = np.where(real, -self._unit / (2 * np.sqrt(np.where(real, -self.square, 1.0))), 0.0)
        return -np.hstack([np.eye(self.centre.size), np.diag(along)])

    def least_distances(self, xi: Complex, resolved: float) -> Real:
        """Least distance of the poles from the stability boundary after a step."""
        return least_distances(self.distances, self.spacing(xi), resolved)

    def spacing(self, xi: Complex) -> Real:
        """Distance between the frequency points where the modes are; beyond the last, that from it."""
        return line_spacing(xi, self.poles[::2], self.discrete)

    def moved(self, step: Real, least: Real | None = None) -> RealModes:
        """The model after a step in the coordinates of `tangent`, poles kept at least so far inside."""
        m, nu = self.inputs.shape
        centre, square, turn, rest = np.split(step, np.cumsum([m, m, m * (nu - 1)]))
        directions = self.directions.copy()
        directions[self.free] += rest
        trial = dataclasses.replace(
            self,
            centre=self.centre + centre,
            square=self.square + self._unit * square,
            inputs=self.inputs + np.einsum("muq,mq->mu", self.input_moves(), turn.reshape(m, nu - 1)),
            directions=directions,
        )._near()
        return (trial if least is None else trial._inside(least)).normalised()

    def without(self, mode: int) -> RealModes:
        """The model without a mode."""
        return dataclasses.replace(self, **{name: np.delete(getattr(self, name), mode, axis=0) for name in _PER_MODE})

    def joined(self, other: RealModes) -> RealModes:
        """The model with the modes of another one."""
        parts = {name: np.concatenate([getattr(self, name), getattr(other, name)]) for name in _PER_MODE}
        return dataclasses.replace(self, **parts)

    def reflected(self) -> RealModes:
        """The model with unstable modes reflected."""
        outside = self.distances < EDGE
        distance = self.distances
        shift = np.where(outside, distance - np.maximum(np.abs(distance), EDGE), 0.0)
        return dataclasses.replace(self, centre=self.centre + shift)

    def resolved(self, xi: Complex, part: float = RESOLVED) -> RealModes:
        """The model with unstable modes reflected and at least the damping that the frequency points resolve."""
        inside = self.reflected()
        return inside._inside(part * inside.spacing(xi))

    def tied_outputs(self) -> Real:
        """Matrices C (T, nu, order) for which the response is symmetric: b for every mode, ``B_r' (symmetric)``."""
        m, nu = self.inputs.shape
        modes = np.zeros((m, nu, self.order))
        modes[np.arange(m), :, np.arange(m)] = self.inputs
        return np.concatenate([modes, tied_gains(self.directions, m, self.order)])

    def tied_changes(self, states: Complex, C: Real, tangent: Complex) -> Complex:
        """The tangent where C is tied to the inputs: what moves the inputs moves the outputs as well."""
        del states, C
        return with_transposes(tangent, self.pole_coordinates)

    def realised(self, C: Real, D: Real) -> StateMatrices:
        """State space in the unit of the nodes: two states a mode, ``B = [0; b']``, chains of integrators at the end."""
        curve, m, count = self._curve(), self.centre.size, len(self.directions)
        a = curve.poles.mean(axis=1).real
        product = -(((curve.poles[:, 0] - curve.poles[:, 1]) / 2) ** 2).real
        s = np.sqrt(np.abs(product))
        gains = np.stack([(curve.numerator[:, 1] + curve.numerator[:, 0] * a) / s, curve.numerator[:, 0]], axis=1)
        blocks = [np.array([[a[k], s[k]], [-product[k] / s[k], a[k]]]) for k in range(m)]
        A = diagonal_blocks(*blocks, chain(count, float(self.discrete)))
        B = np.zeros((2 * (m + count), self.inputs.shape[1]))
        B[1 : 2 * m : 2], B[2 * m + count :] = self.inputs, self.directions
        flexible = (C[:, :m, None] * gains).reshape(len(C), 2 * m)
        velocity = C[:, m:] * (0.5 if self.discrete else 0.0)  # samples of 1/s^2: (z + 1)/(2 (z - 1)^2)
        through = curve.constant * C[:, :m] @ self.inputs
        return StateMatrices(A, B, np.hstack([flexible, C[:, m:], velocity]), D + through)

    def _near(self) -> RealModes:
        """Poles in s at most `_FAR` away, those of samples below the Nyquist frequency."""
        most = _NYQUIST if self.discrete else _FAR
        return dataclasses.replace(
            self, centre=np.maximum(self.centre, -_FAR), square=np.clip(self.square, -(_FAR**2), most**2)
        )

    def _inside(self, least: Real) -> RealModes:
        """Modes at least so far from the boundary: pulled in."""
        return dataclasses.replace(self, centre=self.centre + np.minimum(self.distances - np.maximum(least, EDGE), 0.0))

    def input_moves(self) -> Real:
        """Orthonormal moves (m, nu, nu - 1) of the directions that are no scalings."""
        return np.linalg.svd(self.inputs[:, :, None])[0][:, :, 1:]

    def _rigid(self, xi: Complex) -> Complex:
        """g, (F,); 1 where there is no rigid-body mode."""
        if not len(self.directions):
            return np.ones(xi.size, dtype=complex)
        return (xi + 1) / (2 * (xi - 1) ** 2) if self.discrete else 1 / xi**2

    def _values(self, xi: Complex) -> tuple[Complex, list[Complex]]:
        """Values of h (F, m) and its derivatives by centre and square."""
        curve = self._curve()
        inverse = 1 / ((xi[:, None] - curve.poles[:, 0]) * (xi[:, None] - curve.poles[:, 1]))
        values = _line(curve.numerator, xi) * inverse
        slopes = [
            (_line(turn, xi) - values * _line(fall, xi)) * inverse
            for turn, fall in zip(curve.turns, curve.falls, strict=True)
        ]
        return values + curve.constant, slopes

    def _curve(self) -> _Curve:
        """The functions h: ``s^q/((s - p)(s - p'))``, or the divided difference of ``k(p)/(z - e^p)``, k = p^q (e^p - 1)/p."""
        a, w = self.centre, self._apart
        zero, one, constant = np.zeros(a.size), np.ones(a.size), float(self.power == 2)
        if not self.discrete:
            numerators = {0: (zero, one), 1: (one, zero), 2: (2 * a, -(a**2 + w))}
            turns = {2: [(2 * one, -2 * a), (zero, -one)]}.get(self.power, [(zero, zero), (zero, zero)])
            falls = [(-2 * one, 2 * a), (zero, one)]
            return _Curve(self.decays, _pairs(numerators[self.power]), constant, _stacked(turns), _stacked(falls))
        p, other = self.decays.T
        half = (p - other) / 2  # j times the damped frequency
        (k, k_slope), (n, n_slope) = zero_order_held(p, self.power), zero_order_held(other, self.power)
        e, f = np.exp(p), np.exp(other)
        numerator = (k - n) / (2 * half), (n * e - k * f) / (2 * half)
        by_centre = (k_slope - n_slope) / (2 * half), ((n_slope + n) * e - (k_slope + k) * f) / (2 * half)
        turn = -1 / (2 * half)  # of p by the square; that of the other pole is the opposite
        by_square = (
            turn * (k_slope + n_slope) / (2 * half) - numerator[0] / (2 * w),
            turn * ((n - n_slope) * e + (k - k_slope) * f) / (2 * half) - numerator[1] / (2 * w),
        )
        falls = [(-(e + f), 2 * e * f), ((e - f) / (2 * half), zero)]
        turns = _stacked([by_centre, by_square])
        return _Curve(np.stack([e, f], axis=1), _pairs(numerator), constant, turns, _stacked(falls))


def _line(coefficients: Real, xi: Complex) -> Complex:
    """Linear polynomials (m, 2) at the points, (F, m)."""
    return xi[:, None] * coefficients[:, 0] + coefficients[:, 1]


def _pairs(parts: tuple[NDArray[np.generic], NDArray[np.generic]]) -> Real:
    """Real parts of two coefficients, (m, 2)."""
    return np.stack([np.real(part) for part in parts], axis=1)


def _stacked(items: Sequence[tuple[NDArray[np.generic], NDArray[np.generic]]]) -> Real:
    """Real coefficients of several polynomials, (2, m, 2)."""
    return np.stack([_pairs(item) for item in items])


def mode_gains(upper: Complex, discrete: bool, power: int) -> Complex:
    """Residue of ``s^q/((s - p)(s - p*))``, or of its samples behind a zero-order hold, at the upper pole p in s."""
    held = zero_order_held(upper, power)[0] if discrete else upper**power
    return held / (2j * upper.imag)


def zero_order_held(p: Complex, power: int) -> tuple[Complex, Complex]:
    """Residue ``k = p^q (e^p - 1)/p`` of ``p^q/(s - p)`` behind a zero-order hold, ``k/(z - e^p)``, and its slope; for q = 2
    there is a constant 1 beside it.
    """
    first = np.expm1(p) / p
    slope = (np.exp(p) - first) / p
    if power == 0:
        return first, slope
    if power == 1:
        return np.expm1(p), np.exp(p)
    return p * np.expm1(p), np.expm1(p) + p * np.exp(p)

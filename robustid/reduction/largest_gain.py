"""Largest singular value of a response over the frequency axis: peaks by evaluation, proof of the level by eigenvalues."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from robustid.core import Complex, Numbers, Real, StateMatrices, norms, points_of, poles_of

_RTOL = 1e-9
_ROUNDS = 30
# Eigenvalues this near the axis, relative to themselves or to the largest, may be on it: two that meet there have half of the
# digits. What is on it by mistake costs one more frequency.
_NEAR, _NEAR_ZERO = 1e-3, 1e-7
_SHARP = 0.99  # of the level: a feedthrough so large makes the Hamiltonian matrix ill-conditioned
_REFINED, _LOW = 4, 0.9  # peaks that are refined, if they aren't much lower than the best
_BESIDE = np.array([-1, 0, 1])
_CLOSER = 0.1 ** np.arange(
    1, 4
)  # parts of the way to a neighbour that are looked at: a peak may be much narrower than that
_ZOOMS = 20
_DAMPED = 0.3  # damping below which |pole| and its imaginary part are nearer to each other than the resonance is wide
_CURVED = 3e-6  # relative: a parabola of so little height is right to its square
_TURNED, _SAME = (
    1e6,
    1e-10,
)  # condition of eigenvectors that serve, relative error of the peak that shows that they do not


class Modes(NamedTuple):
    """A response as a sum over its poles: one product of two matrices for all points."""

    poles: Complex
    left: Complex
    right: Complex
    direct: Real

    def at(self, points: Complex) -> Complex:
        """Values at points s or z, (F, ny, nu)."""
        with np.errstate(divide="ignore", invalid="ignore"):
            terms = self.left / (points[:, None, None] - self.poles)
        rows = terms.reshape(points.size * len(self.left), self.poles.size)
        return self.direct + (rows @ self.right).reshape(points.size, *self.direct.shape)


def modes_of(system: StateMatrices) -> Modes | None:
    """The poles and their parts; None where eigenvectors almost depend on each other, as at a double pole."""
    A, B, C, D = system
    try:
        poles, vectors = np.linalg.eig(A)
        back = np.linalg.inv(vectors)
    except np.linalg.LinAlgError:
        return None
    if np.linalg.norm(vectors) * np.linalg.norm(back) > _TURNED * poles.size:
        return None
    left, right = np.asarray(C @ vectors, dtype=complex), np.asarray(back @ B, dtype=complex)
    return Modes(np.asarray(poles, dtype=complex), left, right, D)


class Values(Protocol):
    """A response at any points s or z."""

    @property
    def poles(self) -> Complex:
        """Poles, near which peaks are looked for."""
        ...

    def at(self, points: Complex, /) -> Complex:
        """Values, (F, ny, nu)."""
        ...


class LargestGain(ABC):
    """Largest singular value of a response over the axis: lower bound by evaluation, proof of the level by eigenvalues.

    Resonances first, refined between their neighbours; then the level just above is tested: it is crossed where a Hamiltonian
    matrix has eigenvalues on the axis (`bruinsma1990`).

    Parameters
    ----------
    sums : Values or None
        The response as a sum over its poles, where that serves.
    direct : (ny, nu) array
        Its value at infinity; of discrete systems, whose frequencies are angles, at z = -1, which the bilinear transformation
        takes there.
    """

    def __init__(self, sums: Values | None, direct: Real, *, discrete: bool):
        self.discrete, self.direct, self.summed = discrete, direct, sums is not None
        self.response = sums or self.factorised()
        self.value, self.omega, self.lowest = 0.0, np.inf, 0.0
        self.low = _LOW  # of the best: what is lower is no peak worth refining

    @abstractmethod
    def factorised(self) -> Values:
        """The response without sums over poles."""

    @abstractmethod
    def exact(self, point: Complex) -> float:
        """The largest singular value at one point by a factorisation of its own."""

    @abstractmethod
    def level_matrix(self, level: float, pivot: float | None) -> Numbers:
        """A matrix with eigenvalues j omega where a singular value is `level`; j/(pivot - omega) with a pivot.

        In continuous time, or in that of the bilinear transformation.
        """

    def search(self) -> tuple[float, float]:
        """The largest singular value, at most 1e-9 too small, and where it is."""
        poles = self.response.poles
        if self.discrete:
            marks = np.unique(np.concatenate([[0.0, np.pi], np.abs(np.angle(poles))]))
        else:  # resonances lie near |pole|, which is the imaginary part of what is lightly damped, or at its imaginary part
            damped = poles[np.abs(poles.real) > _DAMPED * np.abs(poles)]
            marks = np.unique(np.concatenate([[0.0], np.abs(poles), np.abs(damped.imag)]))
        marks = np.unique(np.concatenate([marks, (marks[:-1] + marks[1:]) / 2]))
        values = self._look(marks)
        end = float(np.linalg.norm(self.direct, 2))
        if end > self.value and not self.discrete:
            self.value, self.omega = end, np.inf
        if values[0] > _SHARP * self.value:  # else 0 serves, and with it real matrices
            lowest = marks[np.argmin(values)]
            self.lowest = float(np.tan(lowest / 2) if self.discrete else lowest)
        self._zoom(marks, values, np.argsort(values)[::-1][:_REFINED])
        for _ in range(_ROUNDS):
            self._settle()
            crossings = self._crossings(self.value * (1 + _RTOL))
            before = self.value
            if not crossings.size:
                break
            # An interval above the level may go over decades, and its ends are good to rounding only: means of both kinds.
            marks = np.concatenate([[0.0], crossings, 2 * crossings[-1:]])
            low, high = marks[:-1], marks[1:]
            marks = np.unique(np.concatenate([marks, (low + high) / 2, np.sqrt(low * high)]))
            marks = np.append(2 * np.arctan(marks), np.pi) if self.discrete else marks
            values = self._look(marks)
            if self.value <= before * (1 + _RTOL):
                break
            self._zoom(marks, values, np.argsort(values)[::-1][:_REFINED])
        return self.value, self.omega

    def _settle(self) -> None:
        """The best value by a factorisation of its own where it is a sum over poles; no such sums from here on if that was off."""
        if not self.summed or not np.isfinite(self.omega):
            return
        place = points_of(np.array([self.omega]), 1.0 if self.discrete else None)
        before, self.value = self.value, self.exact(place)
        if abs(before - self.value) > _SAME * self.value:
            self.response, self.summed = self.factorised(), False

    def _look(self, frequencies: ArrayLike) -> Real:
        """Largest singular values at the frequencies, where they are not much lower than the largest of all, which is kept.

        Elsewhere what is surely reached, from the sum of squares.
        """
        omega = np.asarray(frequencies, dtype=float)
        found = self._at(omega)
        if found.size and np.max(found) > self.value:
            self.value, self.omega = float(np.max(found)), float(omega[np.argmax(found)])
        return found

    def _at(self, omega: Real) -> Real:
        values = self.response.at(points_of(omega, 1.0 if self.discrete else None))
        if 1 in self.direct.shape:
            return norms(values)
        squares: Real = np.linalg.norm(values, axis=(1, 2))
        found = squares / np.sqrt(min(self.direct.shape))
        high = squares >= self.low * max(self.value, float(np.max(found, initial=0.0)))
        # Gram matrices hold the largest singular value to rounding, for half of the time.
        best = values[high]
        adjoint = best.conj().swapaxes(1, 2)
        wide = self.direct.shape[0] < self.direct.shape[1]
        found[high] = np.sqrt(np.linalg.eigvalsh(best @ adjoint if wide else adjoint @ best)[:, -1])
        return found

    def _zoom(self, marks: Real, values: Real, best: NDArray[np.intp]) -> None:
        """Peaks at the best of some frequencies, refined between their neighbours: all of them in each round."""
        sides = np.clip(best[:, None] + _BESIDE, 0, marks.size - 1)
        omega, found = marks[sides], values[sides]
        for count in range(_ZOOMS):
            self.low = 1 - (1 - _LOW) * _CLOSER[0] ** count  # what a parabola may still rise by shrinks with its square
            rows = found[:, 1] >= self.low * self.value
            if not rows.any():  # the peak is elsewhere
                break
            omega, found = omega[rows], found[rows]
            way = (omega[:, [0, 2]] - omega[:, [1]])[..., None] * _CLOSER
            points = np.hstack([_vertices(omega, found)[:, None], omega[:, [1]] + way.reshape(len(omega), -1)])
            seen = self._look(points.ravel()).reshape(points.shape)
            if np.all(found[:, 1:2] - found <= _CURVED * self.value):
                break
            omega, found = _best_three(np.hstack([omega, points]), np.hstack([found, seen]))
        self.low = _LOW

    def _crossings(self, level: float) -> Real:
        """Frequencies in continuous time where a singular value may be `level`, none of them missing; ascending."""
        if level == 0 or not self.response.poles.size:
            return np.zeros(0)
        pivot = self.lowest if np.linalg.norm(self.direct, 2) > _SHARP * level else None
        values = poles_of(self.level_matrix(level, pivot))
        sizes = np.abs(values)
        near = np.abs(np.real(values)) <= np.maximum(_NEAR * sizes, _NEAR_ZERO * np.max(sizes))
        omega = np.imag(values[near])
        if pivot is not None:
            omega = pivot - 1 / omega[omega != 0]
        return np.unique(np.abs(omega))


def turned(system: StateMatrices, pivot: float | None) -> tuple[Numbers, Numbers, Numbers, Numbers]:
    """The matrices with 1/(s - j pivot) in the place of s, so that what is at the pivot goes to infinity; as they are for None."""
    if pivot is None:
        return system
    a, b, c, d = system
    back = np.linalg.inv(a - 1j * pivot * np.eye(len(a)) if pivot else a)
    return back, back @ b, -c @ back, d - c @ back @ b


def _best_three(omega: Real, found: Real) -> tuple[Real, Real]:
    """In each row the frequency with the largest value, between its neighbours."""
    order = np.argsort(omega, axis=1)
    middle = np.argmax(np.take_along_axis(found, order, 1), axis=1)[:, None]
    kept = np.take_along_axis(order, np.clip(middle + _BESIDE, 0, omega.shape[1] - 1), 1)
    return np.take_along_axis(omega, kept, 1), np.take_along_axis(found, kept, 1)


def _vertices(omega: Real, values: Real) -> Real:
    """Vertex of the parabola through each row of three frequencies, of which the middle one is the best."""
    low, high = omega[:, 1] - omega[:, 0], omega[:, 2] - omega[:, 1]
    left, right = values[:, 1] - values[:, 0], values[:, 1] - values[:, 2]
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        step = (left * high**2 - right * low**2) / (2 * (left * high + right * low))
    return omega[:, 1] + np.where(np.isfinite(step), np.clip(step, -low, high), 0.0)

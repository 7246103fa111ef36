"""Largest singular value of a response over the frequency axis: peaks by evaluation, proof of the level by eigenvalues."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike

from robustid.core import Complex, Numbers, Real, StateMatrices, norms, points_of, poles_of

_RTOL = 1e-9
_ROUNDS = 30
# Eigenvalues this near the axis, relative to themselves or to the largest, may be on it: two that meet there have half of the
# digits. What is on it by mistake costs one more frequency.
_NEAR, _NEAR_ZERO = 1e-3, 1e-7
_SHARP = 0.99  # of the level: a feedthrough so large makes the Hamiltonian matrix ill-conditioned
_REFINED, _LOW = 4, 0.9  # peaks that are refined, if they aren't much lower than the best
_WINDOW = np.arange(-2, 3)  # the frequencies through which a polynomial goes, about the best one
# Parts of the way to a neighbour that are looked at: a peak may be much narrower than that.
_CLOSER = np.concatenate([-(0.1 ** np.arange(1, 4)), 0.1 ** np.arange(1, 4)])
_ZOOMS, _STEPS, _POWERS = 20, 4, np.arange(5)
_ASIDE, _GOLDEN = (
    1e-6,
    0.38,
)  # parts of the way at which a new frequency stands: from the best one, and without a polynomial
_DAMPED = 0.3  # damping below which |pole| and its imaginary part are nearer to each other than the resonance is wide
_MET = 1e-10  # relative: a value that a polynomial foretold so well is that of the peak
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

    `sums` is the response as a sum over its poles, where that serves; `direct` its value at infinity, of discrete systems,
    whose frequencies are angles, at z = -1, which the bilinear transformation takes there.
    """

    def __init__(self, sums: Values | None, direct: Real, *, discrete: bool):
        self.discrete, self.direct, self.summed = discrete, direct, sums is not None
        self.response = sums or self.factorised()
        self.value, self.omega, self.lowest = 0.0, np.inf, 0.0

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
        self._zoom(marks, values)
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
            self._zoom(marks, values)
        return self.value, self.omega

    def _settle(self) -> None:
        """The best value by a factorisation of its own where it is a sum over poles; no such sums from here on if that was off."""
        if not self.summed or not np.isfinite(self.omega):
            return
        place = points_of(np.array([self.omega]), 1.0 if self.discrete else None)
        before, self.value = self.value, self.exact(place)
        if abs(before - self.value) > _SAME * self.value:
            self.response, self.summed = self.factorised(), False

    def _look(self, frequencies: ArrayLike, low: float = _LOW) -> Real:
        """Largest singular values at the frequencies, where they are not much lower than the largest of all, which is kept.

        Elsewhere what is surely reached, from the sum of squares.
        """
        omega = np.asarray(frequencies, dtype=float)
        found = self._at(omega, low)
        best = np.argmax(found)
        if found[best] > self.value:
            place = abs(float(omega[best]))
            self.value, self.omega = float(found[best]), min(place, 2 * np.pi - place) if self.discrete else place
        return found

    def _at(self, omega: Real, low: float) -> Real:
        values = self.response.at(points_of(omega, 1.0 if self.discrete else None))
        if 1 in self.direct.shape:
            return norms(values)
        squares: Real = np.linalg.norm(values, axis=(1, 2))
        found = squares / np.sqrt(min(self.direct.shape))
        high = squares >= low * max(self.value, float(np.max(found)))
        # Gram matrices hold the largest singular value to rounding, for half of the time.
        best = values[high]
        adjoint = best.conj().swapaxes(1, 2)
        wide = self.direct.shape[0] < self.direct.shape[1]
        found[high] = np.sqrt(np.linalg.eigvalsh(best @ adjoint if wide else adjoint @ best)[:, -1])
        return found

    def _zoom(self, marks: Real, values: Real) -> None:
        """Peaks at the best of some ascending frequencies, refined between their neighbours: all of them in each round.

        The response is that of a real system, the same at both sides of 0, and of pi in discrete time.
        """
        if marks.size < 3:  # 0 alone: there is no other pole
            return
        top = 2 * np.pi - marks[-2:-4:-1] if self.discrete else marks[-1:] * [2, 3]
        beyond = values[-2:-4:-1] if self.discrete else np.zeros(2)
        omega = np.concatenate([-marks[2:0:-1], marks, top])
        found = np.concatenate([values[2:0:-1], values, beyond])
        peaks = 1 + np.flatnonzero((found[1:-1] >= found[:-2]) & (found[1:-1] > found[2:]))
        peaks = peaks[np.argsort(found[peaks])[: -_REFINED - 1 : -1]]
        rows = np.clip(peaks[:, None], 2, omega.size - 3) + _WINDOW
        omega, found = omega[rows], found[rows]
        for count in range(_ZOOMS):
            low = 1 - (1 - _LOW) * 0.1**count  # what a polynomial may still rise by shrinks
            high = found.max(axis=1) >= low * self.value
            omega, found = omega[high], found[high]
            if not found.size:  # the peak is elsewhere
                break
            points, foretold = _next_points(omega, found)
            seen = self._look(points.ravel(), 0.0).reshape(points.shape)
            if np.all(np.abs(seen[:, 0] - foretold) <= _MET * self.value):
                break
            omega, found = _about_the_best(np.hstack([omega, points]), np.hstack([found, seen]))

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


def _about_the_best(omega: Real, found: Real) -> tuple[Real, Real]:
    """In each row the frequency with the largest value, and two at each side of it."""
    order = np.argsort(omega, axis=1)
    best = np.argmax(np.take_along_axis(found, order, 1), axis=1)[:, None]
    kept = np.take_along_axis(order, np.clip(best, 2, omega.shape[1] - 3) + _WINDOW, 1)
    return np.take_along_axis(omega, kept, 1), np.take_along_axis(found, kept, 1)


def _next_points(omega: Real, found: Real) -> tuple[Real, Real]:
    """In each row of five frequencies the peak of the polynomial through them, then points beside the best; and what it foretells.

    nan where there is no such peak between the neighbours of the best, unless all are as high.
    """
    rows, best = np.arange(len(omega)), np.clip(np.argmax(found, axis=1), 1, 3)
    middle, height = omega[rows, best], found[rows, best]
    low, high = middle - omega[rows, best - 1], omega[rows, best + 1] - middle
    way = np.maximum(low, high)
    with np.errstate(all="ignore"):
        powers = ((omega - middle[:, None]) / way[:, None])[:, :, None] ** _POWERS
        try:
            c = np.linalg.solve(powers, (found - height[:, None])[:, :, None])[:, :, 0].T
        except np.linalg.LinAlgError:  # two frequencies are the same to rounding
            c = np.full(omega.shape[::-1], np.nan)
        x = np.zeros(len(omega))
        for _ in range(_STEPS):
            x = x - (c[1] + x * (2 * c[2] + x * (3 * c[3] + x * 4 * c[4]))) / (
                2 * c[2] + x * (6 * c[3] + x * 12 * c[4])
            )
        x = x + _ASIDE * (np.abs(x) < _ASIDE)  # not the best one again
        foretold = height + x * (c[1] + x * (c[2] + x * (c[3] + x * c[4])))
        inside = (-low < x * way) & (x * way < high) & (foretold >= height * (1 - _MET))
    flat = height - np.minimum(found[rows, best - 1], found[rows, best + 1]) <= _MET * height
    peak = middle + np.where(inside, x * way, _GOLDEN * high)
    beside = np.hstack([low[:, None] * _CLOSER[:3], high[:, None] * _CLOSER[3:]])
    points = np.hstack([peak[:, None], middle[:, None] + beside])
    return points, np.where(inside, foretold, np.where(flat, height, np.nan))

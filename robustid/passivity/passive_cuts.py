"""Passive models beside fits that are almost passive, by cutting planes, to rounding: the nearest C and D, then all matrices."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Protocol

import numpy as np
import scipy.linalg
import scipy.optimize

from robustid.core import Complex, Real, StateMatrices, input_states
from robustid.passivity.passivity_search import Popov

if TYPE_CHECKING:
    import control

_STRICT = 3e-11  # relative distance from the limit
_SMALL = 1e-2  # relative violation up to which cuts are tried: beyond, a semidefinite program does better
_ROUNDS = 40
_NEAR = 3.0  # violations below the limit: cuts there too, so that few rounds are needed
_BEYOND = 1e3  # times the highest frequency, on the way to infinity
_GRID = 400
_SEEN = 1e-9  # of the largest: changes of the matrices that the data see less are left alone


def cut(
    model: control.StateSpace, kind: str, omega: Real, triangles: list[Real], into: tuple[Real, Real]
) -> StateMatrices | None:
    """A, B, C and D with the least squares of C and D that keep a passive model, in the time units of `into`; None where far.
    ``Re u'S v <= 1`` for all unit vectors u and v, at every frequency, infinity included ("positive real": ``Re u'S u >= 0``),
    is linear in C and D. Cuts at the singular vectors of what violates it most are added until nothing does.
    """
    # That is the nearest passive model, whose violation a semidefinite program could not resolve. `triangles` are [R, r] (n +
    # m, n + m + 1) of every row of [C, D]: its squares are |R g - r|^2; `into` is (A, B) of the model in units of its `Popov`.
    A, B = into
    popov = Popov(kind, StateMatrices.of(model))
    violation = popov.peak()[0] - popov.limit
    n, m = B.shape
    if not 0 < violation <= _SMALL * popov.size or any(len(t) < n + m for t in triangles):
        return None
    grid = _grid(omega, popov.marks)
    family = _Gains.of(triangles, _states(A, B, grid / popov.unit))
    found = _inside(family, popov)
    if found is None:
        return None
    gains = family.gains(found)
    return StateMatrices(A, B, gains[:, :n], gains[:, n:])


def step(system: StateMatrices, popov: Popov, omega: Real, residual: Complex, weight: Real) -> StateMatrices | None:
    """Change of A, B, C and D to the least squares among passive models, to first order; None where cuts find none.
    ``dS = [C (sI - A)^{-1}, I] [dA, dB; dC, dD] [(sI - A)^{-1} B; I]`` is linear in the changes, and so are the cuts. Changes
    that the data do not see, of the coordinates of the states above all, are left out.
    """
    # The system is in the time units of `popov` and in coordinates in which its states are about as large as the inputs.
    n = len(system.A)
    reduced = linearised(system, omega / popov.unit, residual, weight)
    U, sizes, V = np.linalg.svd(reduced[:, :-1], full_matrices=False)
    seen = int(np.sum(sizes > _SEEN * sizes[0]))
    changes = V[:seen].reshape(seen, *2 * (n + system.B.shape[1],)) / sizes[:seen, None, None]
    grid = _grid(omega, popov.marks)
    family = _Changes(U[:, :seen].T @ reduced[:, -1], popov.values(grid), changes, _sides(system, grid / popov.unit))
    found = _inside(family, popov)
    if found is None:
        return None
    change = np.tensordot(found, changes, 1)
    return StateMatrices(change[:n, :n], change[:n, n:], change[n:, :n], change[n:, n:])


def linearised(system: StateMatrices, omega: Real, residual: Complex, weight: Real) -> Real:
    """A small problem [R, r] of the squares of residuals (F, m, m) after changes ``[dA, dB; dC, dD]``, row by row, to first
    order. Frequencies (F,) are in the units of the system.
    """
    left, right = _sides(system, omega)
    terms = np.einsum("fij,fik,flj->fijkl", weight, left, right).reshape(-1, left.shape[2] ** 2)
    return triangle(np.asarray(terms, dtype=complex), np.ravel(weight * residual))


def triangle(regressors: Complex, wanted: Complex) -> Real:
    """A small real problem [R, r] of the same squares: of a sum of squares of complex residuals."""
    stacked: Real = np.vstack([np.column_stack([part(regressors), part(wanted)]) for part in (np.real, np.imag)])
    return np.asarray(scipy.linalg.qr(stacked, mode="r", check_finite=False)[0], dtype=float)[: stacked.shape[1]]


def changed(system: StateMatrices, change: StateMatrices, part: float = 1.0) -> StateMatrices:
    """The matrices after a part of a change."""
    A, B, C, D = (old + part * new for old, new in zip(system, change, strict=True))
    return StateMatrices(A, B, C, D)


class _Family(Protocol):
    """Responses that are linear in coordinates y, whose cost is their squared distance from `free`."""

    @property
    def free(self) -> Real:
        """The coordinates of least cost."""
        ...

    def values(self, y: Real) -> Complex:
        """The responses at all frequencies where cuts are looked for."""
        ...

    def row(self, k: int, left: Complex, right: Complex) -> Real:
        """The derivative of ``Re left' S right`` at frequency k by y."""
        ...


@dataclasses.dataclass(frozen=True)
class _Gains:
    """All C and D, with coordinates row by row: responses ``[C, D] basis``."""

    free: Real
    inverses: list[Real]
    basis: Complex

    @classmethod
    def of(cls, triangles: list[Real], basis: Complex) -> _Gains:
        size = basis.shape[1]
        free = np.concatenate([t[:size, -1] for t in triangles])
        return cls(free, [np.asarray(np.linalg.inv(t[:size, :-1]), dtype=float) for t in triangles], basis)

    def gains(self, y: Real) -> Real:
        """C and D beside each other."""
        return np.stack([R @ part for R, part in zip(self.inverses, np.split(y, len(self.inverses)), strict=True)])

    def values(self, y: Real) -> Complex:
        return np.asarray(self.gains(y) @ self.basis, dtype=complex)

    def row(self, k: int, left: Complex, right: Complex) -> Real:
        part = np.real(np.outer(left.conj(), self.basis[k] @ right))
        return np.concatenate([each @ R for each, R in zip(part, self.inverses, strict=True)])


@dataclasses.dataclass(frozen=True)
class _Changes:
    """Changes of all matrices to first order: responses ``start + left (sum of y_i changes_i) right``."""

    free: Real
    start: Complex
    changes: Real
    sides: tuple[Complex, Complex]

    def values(self, y: Real) -> Complex:
        left, right = self.sides
        return np.asarray(self.start + left @ np.tensordot(y, self.changes, 1) @ right, dtype=complex)

    def row(self, k: int, left: Complex, right: Complex) -> Real:
        one, other = self.sides
        part = np.real(np.outer(left.conj() @ one[k], other[k] @ right))
        return np.asarray(np.sum(self.changes * part, axis=(1, 2)), dtype=float)


def _inside(family: _Family, popov: Popov) -> Real | None:
    """Coordinates of the response nearest to `free` that is passive at all frequencies of the family; None where not found."""
    limit = (1 - _STRICT) * popov.limit if popov.bounded else -_STRICT * popov.size
    rows: list[Real] = []
    room: list[float] = []
    y = family.free
    for _ in range(_ROUNDS):
        values = family.values(y)
        excess, left, right = _worst(values, popov.bounded)
        over = float(excess.max()) - limit
        if over <= 0.3 * _STRICT * popov.size:
            return y
        for k in np.flatnonzero(excess > limit - _NEAR * over).tolist():
            row = family.row(k, left[k], right[k])
            rows.append(row)
            room.append(limit - float(excess[k]) + float(row @ (y - family.free)))
        change = _least(np.array(rows), np.array(room))
        if change is None:
            return None
        y = family.free + change
    return None


def _sides(system: StateMatrices, omega: Real) -> tuple[Complex, Complex]:
    """``[C (sI - A)^{-1}, I]`` and ``[(sI - A)^{-1} B; I]`` at frequencies in the units of the system, infinity included."""
    left = _states(system.A.T, system.C.T, omega)
    return left.transpose(0, 2, 1), _states(system.A, system.B, omega)


def _states(A: Real, B: Real, omega: Real) -> Complex:
    """``[(sI - A)^{-1} B; I]``, (F, n + m, m)."""
    n, m = B.shape
    near = np.isfinite(omega)
    states = np.zeros((omega.size, n + m, m), dtype=complex)
    states[near, :n], states[:, n:] = input_states(A, B, 1j * omega[near]), np.eye(m)
    return states


def _grid(omega: Real, marks: Real) -> Real:
    """Frequencies in rad/s where cuts are looked for: those of the data, at the poles, and beyond; infinity last."""
    top = max(float(omega.max()), float(marks.max()))
    low = min(float(omega[omega > 0].min()), float(marks[marks > 0].min(initial=np.inf)))
    wide = np.geomspace(low / _BEYOND, top * _BEYOND, _GRID)
    middle = (omega[1:] + omega[:-1]) / 2
    return np.append(np.unique(np.concatenate([[0.0], omega, middle, marks, wide])), np.inf)


def _worst(values: Complex, bounded: bool) -> tuple[Real, Complex, Complex]:
    """The excess of every value, and the vectors along which it is reached: ``Re left' S right`` is the excess."""
    if bounded:
        left, sizes, right = np.linalg.svd(values)
        return sizes[:, 0], left[:, :, 0], right[:, 0].conj()
    lowest, vectors = np.linalg.eigh((values + values.conj().transpose(0, 2, 1)) / 2)
    return -lowest[:, 0], -vectors[:, :, 0], vectors[:, :, 0]


def _least(rows: Real, room: Real) -> Real | None:
    """The shortest y with ``rows y <= room``; None where there is none: least distance programming by non-negative least
    squares, `lawson1974` chapter 23.
    """
    sizes = np.linalg.norm(rows, axis=1)
    rows, room = rows / sizes[:, None], room / sizes
    scale = float(np.abs(room).max()) or 1.0
    wanted = np.zeros(rows.shape[1] + 1)
    wanted[-1] = 1.0
    both = np.vstack([-rows.T, -room / scale])
    try:
        weights = scipy.optimize.nnls(both, wanted, maxiter=50 * len(rows) + 1000)[0]
    except RuntimeError:
        return None
    left = both @ weights - wanted
    return None if abs(left[-1]) < 1e-12 else -scale * left[:-1] / left[-1]

"""A discrete controller as rows of small sections whose numbers keep their digits in single precision.

A pole near z = 1 leaves few digits of a coefficient, and large terms that cancel leave few of a sum. So a section holds
A - I in place of A, and the output is made of what its states lag behind their values at standstill: a constant input
passes by the constant D alone.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy.linalg
import scipy.sparse.csgraph

from robustid.app.exports.roots import spread_over
from robustid.core import Complex, Real, StateMatrices, series
from robustid.errors import InputError

_EDGE = 1e-12  # 1 - |p|^2 from which down a pole is on the unit circle
FLOOR = 0.01  # of the median of the response: what lies below is fitted and compared in part of that
_BESIDE = 1e-3  # of 1 - p: the distance that points keep to a pole on the circle
_EQUAL = 1e-11  # of 1 - p: poles of two entries that are one
_NOTHING = 1e-10  # of the response: what an integrator adds that is not there
_ROUNDING = 4 * float(np.finfo(float).eps)
_RANK = 1e-9  # of the residues of integrators of several inputs


class Sections(NamedTuple):
    r"""States that lag: :math:`v = x - T e`, :math:`x^+ = x + F v + H e`, :math:`u = C v + D e`.

    Rows of T hold the states at standstill for a constant input; integrators, which have none, and slow states that work as
    such have rows in H in their place.
    """

    F: Real
    T: Real
    H: Real
    C: Real
    D: Real

    @property
    def matrices(self) -> StateMatrices:
        """A, B, C, D of the same system."""
        A = np.eye(len(self.F)) + self.F
        return StateMatrices(A, self.H - self.F @ self.T, self.C, self.D - self.C @ self.T)

    def values(self, steps: Complex) -> Complex:
        """Response at points z, given as z - 1, (F, ny, nu)."""
        return self.D + self.C @ _lags(self.F, self.T, self.H, steps)


class Comparison(NamedTuple):
    """Response of a controller (F, ny, nu), the size that errors of it are measured in, and where: omega, and z - 1."""

    values: Complex
    size: Real
    omega: Real
    steps: Complex

    def lost(self, found: Sections) -> float:
        """Largest difference of sections, in part of the response, or of a small part of its median where it is below."""
        return float(np.max(np.abs(found.values(self.steps) - self.values) / self.size))


def sections(system: StateMatrices, dt: float) -> tuple[Sections, Comparison]:
    """Return the sections of a discrete controller: integrators, then a row driven through all-passes for every input.

    The states of a row are orthonormal functions of its input, so that close or repeated poles cost no digits. Their poles
    are those of the controller, their numerators the least squares of its response, relative at every frequency.
    """
    count = system.D.shape[1]
    lacks = [_united([_lacks(_between(system, i, j)) for i in range(len(system.D))]) for j in range(count)]
    omega, steps = _points(np.concatenate(lacks), dt)
    values = _response(system, steps)
    size = np.abs(values)
    size = np.maximum(size, FLOOR * np.median(size, axis=0))
    size[:, size.max(axis=0) == 0] = 1.0  # entries that are zero
    inputs = [_sections_of(one, steps, values[:, :, j], size[:, :, j]) for j, one in enumerate(lacks)]
    chains = [chain for chain, _ in inputs]
    if count > 1 and max(len(one.F) for one in chains) > 1:
        raise InputError(
            "`controller` has several inputs and integrators in a row behind one of them, which C of several inputs does"
            " not hold; write its entries one by one"
        )
    integrators = chains[0] if count == 1 else _shared(chains)
    rows = [row for _, row in inputs]
    F = scipy.linalg.block_diag(integrators.F, *(one.F for one in rows))
    T = np.vstack([integrators.T, scipy.linalg.block_diag(*(one.T for one in rows))])
    H = np.vstack([integrators.H, scipy.linalg.block_diag(*(one.H for one in rows))])
    C = np.hstack([integrators.C, *(one.C for one in rows)])
    return Sections(F, T, H, C, np.hstack([one.D for one in rows])), Comparison(values, size, omega, steps)


def _points(lacks: Complex, dt: float) -> tuple[Real, Complex]:
    """Frequencies in rad/s that a controller is compared at, and z - 1 with all digits near 0; none at a pole on the circle."""
    omega = spread_over(1 - lacks, dt)
    steps: Complex = np.asarray(np.expm1(1j * omega * dt), dtype=complex)
    lasting = lacks[_damping(lacks) <= _EDGE]
    kept = np.all(np.abs(steps[:, None] + lasting) >= _BESIDE * np.abs(lasting), axis=1)
    return omega[kept], steps[kept]


def _damping(lacks: Complex) -> Real:
    """1 - abs(p)**2 of poles p, of which 1 - p is given."""
    return 2 * lacks.real - np.abs(lacks) ** 2


def _sections_of(lacks: Complex, steps: Complex, wanted: Complex, size: Real) -> tuple[Sections, Sections]:
    """Integrators and the row of one input, with the numerators of all outputs; 1 - p of every pole is given.

    A slow pole below a zero works as an integrator: its value at standstill is large and cancels above. From which state of the
    row on they are such is where the terms of the output are smallest, in part of it.
    """
    count = int(np.sum(lacks == 0))
    chain = (
        np.eye(count, k=-1),
        np.zeros((count, 1)),
        np.eye(count, 1),
    )  # the first sums its input, each other one the last
    summed = _lags(*chain, steps)[:, :, 0]
    F, B = _all_passes(lacks[lacks != 0])
    still: Real = np.asarray(-np.linalg.solve(F, B), dtype=float)
    zero = np.zeros((wanted.shape[1], 1))
    best, least = Sections(F, still, np.zeros_like(B), np.zeros((0, 0)), zero), np.inf
    for first in range(len(F), -1, -1):
        if 0 < first < len(F) and F[first - 1, first]:  # between the states of a pair
            continue
        slow = np.arange(len(F))[:, None] >= first
        T = np.where(slow, 0.0, still)
        H = np.where(slow, B + F @ T, 0.0)
        own = np.ones((steps.size, 1), complex)
        columns: Complex = np.concatenate([summed, _lags(F, T, H, steps)[:, :, 0], own], axis=1)
        numbers = _numerators(columns, wanted, size)
        terms = float(np.max(np.abs(columns) @ np.abs(numbers).T / size))
        if terms < least:
            best, least = Sections(F, T, H, numbers[:, :-1], numbers[:, -1:]), terms
    if not least < np.inf:
        raise InputError("`controller` has a response that is not finite")
    sums, row = best.C[:, :count], best._replace(C=best.C[:, count:])
    if count and np.max(np.abs(sums[:, -1] * summed[:, -1, None]) / size) < _NOTHING:  # no output shows it
        return _sections_of(np.delete(lacks, np.flatnonzero(lacks == 0)[0]), steps, wanted, size)
    return Sections(*chain, sums, zero), row


def _numerators(columns: Complex, wanted: Complex, size: Real) -> Real:
    """Real factors of columns whose sums are nearest to the outputs, (ny, m), in part of their size."""
    numbers = np.zeros((wanted.shape[1], columns.shape[1]))
    for i in range(len(numbers)):
        rows, goal = columns / size[:, i, None], wanted[:, i] / size[:, i]
        scale = np.linalg.norm(rows, axis=0)
        rows = rows / scale
        left, right = np.concatenate([rows.real, rows.imag]), np.concatenate([goal.real, goal.imag])
        numbers[i] = np.linalg.lstsq(left, right, rcond=1e-14)[0] / scale
    return numbers


def _shared(chains: list[Sections]) -> Sections:
    """Integrators of several inputs, as few as their residues have directions."""
    residues = np.hstack([one.C if len(one.F) else one.D for one in chains])
    U, s, V = np.linalg.svd(residues)
    rank = int(np.sum(s > _RANK * s.max(initial=0.0)))
    zero = np.zeros((rank, len(chains)))
    return Sections(np.zeros((rank, rank)), zero, V[:rank], U[:, :rank] * s[:rank], np.zeros(residues.shape))


def _between(system: StateMatrices, i: int, j: int) -> Real:
    """A of the states that an input reaches and that an output is made of."""
    links = (system.A != 0) | np.eye(len(system.A), dtype=bool)
    moved, seen = system.B[:, j] != 0, system.C[i] != 0
    for _ in range(len(links)):
        moved, seen = links @ moved, seen @ links
    return system.A[np.ix_(moved & seen, moved & seen)]


def _united(lists: list[Complex]) -> Complex:
    """Poles of several entries, each as often as the entry has it that has it most often; 1 - p is given."""
    found: list[complex] = []
    for one in lists:
        free = np.array(found, dtype=complex)
        for lack in one:
            apart = np.abs(free - lack)
            if apart.size and (k := int(np.argmin(apart))) >= 0 and apart[k] <= _EQUAL * abs(lack):
                free[k] = np.inf
            else:
                found.append(lack)
    return np.array(found, dtype=complex)


def _lacks(A: Real) -> Complex:
    """1 - p of the poles of A; 0 of those that rounding of A does not tell from 1.

    Every block of states that depend on each other is taken by itself: rounding of one does not move the poles of others.
    """
    found = [np.zeros(0, complex)]
    label = scipy.sparse.csgraph.connected_components(A != 0, connection="strong")[1] if len(A) else np.zeros(0)
    for k in np.unique(label):
        own = label == k
        block = A[np.ix_(own, own)]
        rest, near = np.eye(len(block)) - block, _ROUNDING * max(1.0, float(np.linalg.norm(block, 2)))
        if len(block) == 1:
            values = rest[0].astype(complex)
            values[np.abs(values) <= near] = 0
        elif len(block) == 2:
            values = _pair(rest, near)
        else:
            values, left, right = scipy.linalg.eig(rest, left=True)
            angle = np.abs(np.sum(left.conj() * right, axis=0))  # its inverse is the condition of the pole
            values = np.where(np.abs(values) * angle <= near, 0, values)
        found.append(values)
    return np.concatenate(found)


def _pair(rest: Real, near: float) -> Complex:
    """Eigenvalues of two rows, from trace and determinant: near 0 they keep the digits that a decomposition loses."""
    half = np.trace(rest) / 2
    det = rest[0, 0] * rest[1, 1] - rest[0, 1] * rest[1, 0]
    root = np.sqrt(complex(half**2 - det))
    first = half + (root if half >= 0 else -root)
    second = det / first if root.imag == 0 and first else np.conj(first)
    if abs(det) <= near * max(1.0, float(np.abs(rest).max())):
        second, first = 0j, first if abs(first) ** 2 > near else 0j
    return np.array([first, second], dtype=complex)


def _all_passes(lacks: Complex) -> tuple[Real, Real]:
    """A - I and B of a row of sections with orthonormal states, each driven by the all-pass of those before.

    Poles on or outside the unit circle have no such states: each is a section by itself. The fastest comes first.
    """
    row = StateMatrices(np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), np.ones((1, 1)))
    kept = lacks[lacks.imag >= 0]
    kept = kept[np.argsort(-np.abs(kept))]
    for one, lost in zip(kept, _damping(kept), strict=True):
        if lost > _EDGE:
            row = series(row, _section(one, lost))
            continue
        own = np.array([[-one.real, one.imag], [-one.imag, -one.real]]) if one.imag else np.array([[-one.real]])
        n = len(own)
        alone = scipy.linalg.block_diag(row.A, own)
        row = StateMatrices(alone, np.vstack([row.B, np.eye(n, 1)]), np.hstack([row.C, np.zeros((1, n))]), row.D)
    return row.A, row.B


def _section(lack: complex, lost: float) -> StateMatrices:
    """A - I, B, C, D of an all-pass of one pole, or of a pair as a lattice: [A B; C D] is orthogonal.

    Of the pole p, 1 - p and 1 - abs(p)**2 are given.
    """
    if lack.imag == 0:
        root = np.array([[np.sqrt(lost)]])
        return StateMatrices(np.array([[-lack.real]]), root, root, np.array([[lack.real - 1]]))
    q = 1 - lost  # |p|^2
    less = abs(lack) ** 2 / (1 + q)  # 1 - b, b = 2 Re p / (1 + |p|^2)
    b, s, r = 1 - less, np.sqrt(less * (2 - less)), np.sqrt(lost * (1 + q))
    own = np.array([[-less, s], [-q * s, q * b - 1]])
    return StateMatrices(own, np.array([[0.0], [r]]), np.array([[r * s, -r * b]]), np.array([[q]]))


def _lags(F: Real, T: Real, H: Real, steps: Complex) -> Complex:
    """Values of v at points z, given as z - 1, (F, n, nu): (z - 1) v = F v + H e - (z - 1) T e; nothing cancels near z = 1."""
    step = steps[:, None, None]
    return np.asarray(np.linalg.solve(step * np.eye(len(F)) - F, H - step * T), dtype=complex)


def _response(system: StateMatrices, steps: Complex) -> Complex:
    """Response at points z, given as z - 1, (F, ny, nu), corrected twice by residuals in extended precision.

    Of slow states in coordinates of any scale double precision alone loses up to ten digits.
    """
    A, B, C, D = (part.astype(np.longdouble) for part in system)
    unit = np.eye(len(A), dtype=np.longdouble)
    left = steps.astype(np.clongdouble)[:, None, None] * unit - (A - unit)
    rough, states = left.astype(complex), np.zeros((steps.size, *B.shape), np.clongdouble)
    for _ in range(3):
        states = states + np.linalg.solve(rough, (B - left @ states).astype(complex))
    return np.asarray(D + C @ states, dtype=complex)

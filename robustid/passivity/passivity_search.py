"""Popov functions of passive responses: the largest excess on the axis, bands of violation, and matrices that prove a bound."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import scipy.linalg
import scipy.optimize
from numpy.typing import ArrayLike

from robustid.core import Complex, Real, Response, StateMatrices, balancing, scaled_states
from robustid.passivity.passivity_certificate import BOUNDED, NEGATIVE
from robustid.reduction import Parts, gramian_factors

_ROUNDS = 30
_NEWTON = 2
_RTOL = 1e-10
_NEAR = (
    1e-8  # an eigenvalue this near the axis, relative to its size, may be on it; by mistake it costs one more frequency
)
_REFINED = 6
_FLAT = 1e-7  # relative to the size of the response: below, the value at infinity is divided by in a pencil, not in a matrix
_AUGMENTED = 1e-5  # inputs and outputs, relative, that every state gets for coordinates: none is out of reach
_SLACKS = (0.3, 1e-2, 1e-4, 1e-6)  # of the gap, given to the first block of the inequality


_PARTS = (1e-2, 1e-4, 1e-6, 1e-8)  # the same, of the rates of the states, where the limit itself is to be proved


class Band(NamedTuple):
    """Frequencies from `low` to `high` in rad/s (infinity included) between which passivity is violated, most at `omega`."""

    low: float
    high: float
    omega: float
    amount: float


class Popov:
    """A square continuous response and the excess of its kind, at most `limit` where the model is passive: the largest singular
    value ("bounded real", limit 1) or minus the smallest eigenvalue of the Hermitian part of the response ("positive real",
    limit 0), of s (F - D) for "negative imaginary".
    """

    def __init__(self, kind: str, given: StateMatrices) -> None:
        A, B, C, D = given if kind != NEGATIVE else StateMatrices(*given[:2], given.C @ given.A, given.C @ given.B)
        self.kind, self.bounded = kind, kind == BOUNDED
        self.limit = 1.0 if self.bounded else 0.0
        self.response = Response((*scaled_states(A, B, C), D))
        self.poles = self.response.poles
        self.unit = float(np.exp(np.mean(np.log(np.abs(self.poles))))) if len(A) else 1.0
        # in balanced coordinates z = S x, with frequencies in units of `unit` (rad/s)
        self.system, self.S = self._balanced(A / self.unit, B / np.sqrt(self.unit), C / np.sqrt(self.unit), D)
        marks = np.concatenate([[0.0], np.abs(self.poles), np.abs(np.imag(self.poles))])
        self.marks: Real = np.unique(np.concatenate([marks, marks * 1.05, marks / 1.05]))
        largest = np.linalg.norm(self.values(np.append(self.marks, np.inf)), 2, axis=(1, 2))
        # of the response, where "negligible" is meant
        self.size = 1.0 if self.bounded else float(np.max(largest)) or 1.0

    def _balanced(self, A: Real, B: Real, C: Real, D: Real) -> tuple[StateMatrices, Real]:
        """The system in balanced coordinates, states that are out of reach included, and the coordinates; sets `slack`."""
        n = len(A)
        if n == 0:
            return StateMatrices(A, B, C, D), np.zeros((0, 0))
        _, (scale, _) = scipy.linalg.matrix_balance(A, permute=False, separate=True)
        a, b, c = A * scale / scale[:, None], B / scale[:, None], C * scale
        drive, sense = np.linalg.norm(b) or 1.0, np.linalg.norm(c) or 1.0
        little = _AUGMENTED * np.eye(n)
        wide = Parts(a, np.hstack([b / drive, little]), np.vstack([c / sense, little]))
        both = balancing(*gramian_factors(wide, discrete=False))
        into = both.projections(n)[0] * scale[:, None]
        into *= np.sqrt(drive / sense)  # B and C of one size: so are P and the identity
        S: Real = np.asarray(np.linalg.inv(into), dtype=float)
        system = StateMatrices(S @ A @ into, S @ B, C @ into, D)
        self.slack: Real = np.diag(np.abs(np.diagonal(system.A))) / (2 * np.sum(both.hankel) * drive * sense)
        return system, S

    def values(self, omega: ArrayLike) -> Complex:
        """The response at frequencies in rad/s, infinity included."""
        omega = np.asarray(omega, dtype=float)
        values = np.repeat(self.system.D[None].astype(complex), omega.size, axis=0)
        near = np.isfinite(omega)
        values[near] = self.response.at(1j * omega[near])
        return values

    def excess(self, omega: ArrayLike) -> Real:
        """The excess at frequencies in rad/s."""
        values = self.values(omega)
        if self.bounded:
            return np.asarray(np.linalg.norm(values, 2, axis=(1, 2)), dtype=float)
        lowest = np.linalg.eigvalsh((values + values.conj().transpose(0, 2, 1)) / 2)[:, 0]
        return -np.asarray(lowest, dtype=float)

    def form(self, bound: float) -> tuple[Real, Real, Real]:
        """Q, S and R of the inequality for a bound of the excess."""
        return inequality(self.system, bound, bounded=self.bounded)

    def gramians(self, bound: float) -> tuple[Real, Real] | None:
        """Least P of the inequality for a bound of the excess, and that of the transposed response."""
        found: list[Real] = []
        for system in (self.system, self.system.transposed()):
            P = riccati(system.A, system.B, *inequality(system, bound, bounded=self.bounded))
            if P is None:
                return None
            found.append(P)
        return found[0], found[1]

    def crossings(self, bound: float) -> Real:
        """Frequencies in rad/s where the excess may be `bound`, none of them missing; ascending."""
        A, B = self.system.A, self.system.B
        Q, S, R = self.form(bound)
        n, m = B.shape
        if n == 0:
            return np.zeros(0)
        if np.min(np.abs(np.linalg.eigvalsh(R))) > _FLAT * self.size:
            values: Complex = scipy.linalg.eigvals(hamiltonian(A, B, Q, S, R))
        else:
            pencil = np.block([[A, np.zeros((n, n)), B], [-Q, -A.T, -S], [S.T, B.T, R]])
            values = scipy.linalg.eigvals(pencil, scipy.linalg.block_diag(np.eye(2 * n), np.zeros((m, m))))
            values = values[np.isfinite(values)]
        near = np.abs(np.real(values)) <= _NEAR * np.abs(values)
        return np.unique(np.abs(np.imag(values[near]))) * self.unit

    def peak(self) -> tuple[float, float]:
        """The largest excess, and its frequency in rad/s."""
        best = _Best(self)
        found = best.look(self.marks)
        best.look([np.inf])
        for k in np.argsort(found)[::-1][:_REFINED]:
            best.refine(self.marks[max(0, k - 1)], self.marks[min(self.marks.size - 1, k + 1)])
        for _ in range(_ROUNDS):
            before = best.value
            crossings = self.crossings(before + _RTOL * self.size)
            best.look(np.concatenate([crossings, (crossings[:-1] + crossings[1:]) / 2, 2 * crossings[-1:]]))
            if best.value <= before + _RTOL * self.size:
                break
            k = int(np.searchsorted(crossings, best.omega))
            best.refine(crossings[max(0, k - 1)], crossings[min(crossings.size - 1, k)])
        return best.value, best.omega

    def bands(self, least: float) -> tuple[Band, ...]:
        """Bands of an excess above `limit` by more than `least`: ends from eigenvalues, the largest inside each refined."""
        level = self.limit + least
        ends: Real = np.unique(np.concatenate([[0.0], self.crossings(level), [np.inf]]))
        middle = np.append((ends[:-2] + ends[1:-1]) / 2, 2 * ends[-2] if ends.size > 2 else self.unit)
        above = self.excess(middle) > level
        bands: list[Band] = []
        for low, high, mid, violated in zip(ends[:-1], ends[1:], middle, above, strict=True):
            if not violated:
                continue
            best = _Best(self)
            inside: Real = self.marks[(self.marks > low) & (self.marks < high)]
            best.look(np.concatenate([[low, high, mid], inside]))
            top = high if np.isfinite(high) else max(4 * mid, best.omega if np.isfinite(best.omega) else 0.0)
            steps: Real = np.concatenate([np.linspace(float(low), float(top), 9), inside])
            best.look(steps)
            steps = np.sort(steps)
            k = int(np.searchsorted(steps, min(best.omega, top)))
            best.refine(steps[max(0, k - 1)], steps[min(steps.size - 1, k + 1)])
            if bands and bands[-1].high == low:
                last = bands.pop()
                low, best = last.low, best if best.value - self.limit > last.amount else _at(best, last, self.limit)
            bands.append(Band(float(low), float(high), best.omega, best.value - self.limit))
        return tuple(bands)

    def proofs(self, bound: float, gap: float) -> Iterator[Real]:
        """Matrices P that may prove a bound of the excess, which is by `gap` above it, in the coordinates `S`."""
        A, B, _, _ = self.system
        Q, S, R = self.form(bound)
        for part in _SLACKS:
            P = riccati(A, B, Q + part * gap * self.slack, S, R)
            if P is not None and _is_negative(np.block([[A.T @ P + P @ A + Q, P @ B + S], [(P @ B + S).T, R]])):
                yield P

    def proofs_in_the_limit(self, F: Real, K: Real, vanishing: int) -> Iterator[Real]:
        """Matrices P with P F = K, but for rounding, that may prove the bound 0; A'P + PA vanishes in the last columns of F. In
        coordinates ``z = [F, N] (f, g)`` with K'N = 0, P is diag(F'K, p), and p solves the inequality of a smaller system.
        """
        A, n, k = self.system.A, *F.shape
        size = np.linalg.norm(self.S @ F, axis=0)
        if not np.all(size > 0):  # a port that reaches no state
            return
        f: Real = self.S @ F / size
        g = _solve(self.S.T, K) / size
        across = f.T @ g
        T: Real = np.hstack([f, scipy.linalg.null_space(g.T)])
        if T.shape != (n, n) or np.linalg.cond(T) > 1 / np.finfo(float).eps:
            return
        a = _solve(T, A @ T)
        kept = slice(0, k - vanishing)
        a22, a21, a12 = a[k:, k:], a[k:, :k][:, kept], a[:k, k:]
        S, half = (a12.T @ across)[:, kept], (across @ a[:k, :k])[kept, kept]
        weight = np.diag(np.abs(np.diagonal(a22)))
        for part in _PARTS:
            p = riccati(a22, a21, part * weight, S, half + half.T) if n > k else a22
            if p is None:
                continue
            inverse = _solve(T, np.eye(n))
            blocks: Real = scipy.linalg.block_diag((across + across.T) / 2, p)
            yield inverse.T @ blocks @ inverse


class _Best:
    """The largest excess seen so far."""

    def __init__(self, popov: Popov) -> None:
        self.popov, self.value, self.omega = popov, -np.inf, 0.0

    def look(self, omega: ArrayLike) -> Real:
        omega = np.asarray(omega, dtype=float)
        found = self.popov.excess(omega)
        if found.size and np.max(found) > self.value:
            self.value, self.omega = float(np.max(found)), float(omega[np.argmax(found)])
        return found

    def refine(self, low: float, high: float) -> None:
        if high > low:

            def lowered(omega: float) -> float:
                return -float(self.popov.excess([omega])[0])

            options = {"xatol": 1e-10 * high}
            self.look(
                [scipy.optimize.minimize_scalar(lowered, bounds=(low, high), method="bounded", options=options).x]
            )


def _at(best: _Best, band: Band, limit: float) -> _Best:
    best.value, best.omega = band.amount + limit, band.omega
    return best


def _is_negative(matrix: Real) -> bool:
    """Say whether it looks negative definite: a look before the proof."""
    diagonal = -np.diagonal(matrix)
    if np.any(diagonal <= 0):
        return False
    scale = 1 / np.sqrt(diagonal)
    try:
        np.linalg.cholesky(-(matrix * scale) * scale[:, None])
    except np.linalg.LinAlgError:
        return False
    return True


def _solve(matrix: Real, right: Real) -> Real:
    return np.asarray(np.linalg.solve(matrix, right), dtype=float)


def inequality(system: StateMatrices, bound: float, *, bounded: bool) -> tuple[Real, Real, Real]:
    """Q, S and R of ``[[A'P + PA + Q, PB + S], [., R]] < 0``: bounded real, or positive real."""
    _, _, C, D = system
    eye = np.eye(len(D))
    if bounded:
        return C.T @ C, C.T @ D, D.T @ D - bound**2 * eye
    return np.zeros((C.shape[1],) * 2), -C.T, -(D + D.T) - 2 * bound * eye


def hamiltonian(A: Real, B: Real, Q: Real, S: Real, R: Real) -> Real:
    """The matrix with eigenvalues on the axis where the Popov function is singular."""
    solved = _solve(R, np.hstack([S.T, B.T]))
    state, costate = np.hsplit(solved, [len(A)])
    return np.block([[A - B @ state, -B @ costate], [S @ state - Q, S @ costate - A.T]])


def riccati(A: Real, B: Real, Q: Real, S: Real, R: Real) -> Real | None:
    """The stabilising P of ``A'P + PA + Q = (PB + S) R^{-1} (B'P + S')``, symmetric; None where there is none."""
    n = len(A)
    try:
        found_basis = scipy.linalg.schur(hamiltonian(A, B, Q, S, R), output="real", sort="lhp")
        basis: Real = found_basis[1]
        stable = int(found_basis[2])
        if stable != n:
            return None
        found = _solve(basis[:n, :n].T, basis[n:, :n].T)
        for _ in range(_NEWTON):  # what rounding of the subspace left
            found = (found + found.T) / 2
            gain = _solve(R, B.T @ found + S.T)
            residual = found @ A + A.T @ found + Q - (found @ B + S) @ gain
            with warnings.catch_warnings():  # of eigenvalues at the axis: a step of no use is seen in the inequality
                warnings.simplefilter("ignore", RuntimeWarning)
                step: Real = scipy.linalg.solve_continuous_lyapunov((A - B @ gain).T, -(residual + residual.T) / 2)
            found = found + step
    except (np.linalg.LinAlgError, scipy.linalg.LinAlgError):
        return None
    return (found + found.T) / 2 if np.all(np.isfinite(found)) else None

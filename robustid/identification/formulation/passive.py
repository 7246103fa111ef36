r"""Positive-real functions: a function has the data x iff X(x) + X(x)' >= -2 I, X(x) = g(A).

F = (K - slack) I + K g with 1 + g positive real. The condition is linear in x, a single block of the size of one signal, where a
ball needs two. With a further value in the place of K the class is the same one.
"""

# pyright: reportConstantRedefinition=false
# Matrices have capital letters.
from __future__ import annotations

import dataclasses
import functools
from typing import ClassVar

import numpy as np

from robustid.bases import InputNormalPair
from robustid.core import Complex, Frozen, Numbers, Real, freeze, series_at
from robustid.errors import InputError, Remedy, SizeError
from robustid.identification.entries import SINGLE, Entries
from robustid.identification.formulation.ball import Axes, Ball
from robustid.identification.formulation.exact import MOST_PRODUCTS, ExactFormulation
from robustid.identification.formulation.passive_blocks import DenseRealPart, QuadratureRealPart, QuadratureRealParts
from robustid.identification.formulation.quadrature import quadrature
from robustid.identification.formulation.sarason import SarasonMap
from robustid.identification.interpolant import FreeParameter, Interpolants, from_factors
from robustid.identification.passive import error_sizes, modes_reach, positive_values
from robustid.identification.problem import MixedProblem

_ENOUGH = 1e-3  # norm of a power at which the geometric series ends
_ROUNDED = 1e-9  # what rounding may add to the norms of powers, relatively


@dataclasses.dataclass(frozen=True, eq=False)
class PassiveMap(SarasonMap):
    """The map x -> X(x) with the condition X + X' >= -2 I."""

    pair: InputNormalPair
    entries: Entries = SINGLE
    # a and b: ||X|| <= a + b s for all functions that keep every residual within s bounds (`harnack_bound`)
    growth: tuple[float, float] = (np.inf, 0.0)

    entrywise: ClassVar[bool] = False
    inside: ClassVar[str] = "-smallest eigenvalue of (X + X')/2: the non-parametric part is positive real"

    @property
    def blocks(self) -> tuple[int, ...]:
        """Size of the one block."""
        return (self.shape[0],)

    def norm(self, x: Real) -> float:
        """The smallest k for which k + g is positive real: 1 at the border of the class."""
        if not self.pair.order:
            return 0.0
        X = self.matrix(x)
        return max(0.0, -float(np.linalg.eigvalsh((X + X.T) / 2)[0]))

    def largest(self, level: float) -> float:
        """Bound of ||X|| of the functions that keep every residual within `level` bounds."""
        return self.growth[0] + self.growth[1] * level

    def product(self, Y: Real, level: float) -> float:
        """Bound of <Y, X>: the trace of the negative part of the symmetric Y, the rest of Y times the bound of ||X||."""
        values = np.linalg.eigvalsh((Y + Y.T) / 2)
        rest = float(np.maximum(values, 0.0).sum() + np.linalg.svd((Y - Y.T) / 2, compute_uv=False).sum())
        rest += 10 * values.size * np.finfo(float).eps * float(np.abs(values).sum())
        return float(-np.minimum(values, 0.0).sum()) + rest * self.largest(level)

    def ball(self, axes: Axes | None = None, quick: bool = False) -> Ball:
        """The block, by quadrature where the nodes allow it."""
        if (found := quadrature(self.pair)) is None:
            return DenseRealPart(self._symmetric_matrices)
        return QuadratureRealPart(*found) if self.entries.single else QuadratureRealParts(*found, self.entries)

    def interpolants(self, x: Real) -> PassiveInterpolants:
        """The functions of the class with the data x, by phi = g (2 + g)^-1 of the unit ball; needs I + (X + X')/2 > 0."""
        # I - X_phi' X_phi = 4 (2 + X)^-T (I + (X + X')/2) (2 + X)^-1: the factors of `from_factors`, times 2 + X.
        X = self.matrix(x)
        values, vectors = np.linalg.eigh(np.eye(X.shape[0]) + (X + X.T) / 2)
        if values.size and values[0] <= 0:
            raise InputError(
                f"`x` must lie inside the class: the smallest eigenvalue of I + (X + X')/2 is {values[0]:.3g}"
            )
        root = np.asarray(np.linalg.qr(2 * np.sqrt(values)[:, None] * vectors.T, mode="r"))
        row = np.kron(self.pair.c, np.eye(self.entries.outputs))
        return PassiveInterpolants(
            from_factors(self.pair, root, 2 * row + row @ X, row @ X, float(values.min(initial=1.0)))
        )

    @functools.cached_property
    def _symmetric_matrices(self) -> Real:
        X = self.unit_matrices
        return freeze((X + X.transpose(0, 2, 1)) / 2)

    def _turned(self, M: Real) -> Real:
        """M: the condition is one on X itself."""
        return M


@dataclasses.dataclass(frozen=True, eq=False)
class PassiveInterpolants(Frozen):
    """Functions g with 1 + g positive real and given data: g = 2 phi (1 - phi)^-1, phi in the unit ball."""

    contractive: Interpolants  # every phi

    def realise(self, E: FreeParameter = 0.0) -> tuple[Real, Real, Real, Real]:
        """State space (alpha, beta, gamma, delta) of g, with the free parameter E of phi."""
        alpha, beta, gamma, delta = self.contractive.realise(E)
        root = np.sqrt(2)
        before = np.eye(delta.shape[0]) - delta
        output: Real = np.asarray(np.linalg.solve(before, gamma), dtype=float)
        through: Real = np.asarray(np.linalg.solve(before, delta), dtype=float)
        inputs: Real = np.asarray(np.linalg.solve(before.T, beta.T).T, dtype=float)
        return alpha + beta @ output, root * inputs, root * output, 2 * through

    def evaluate(self, zeta: Numbers, E: FreeParameter = 0.0) -> Complex:
        """The values g(zeta), |zeta| < 1, (F,); for MIMO (F, p, p)."""
        values = series_at(self.realise(E), zeta)
        return values[:, 0, 0] if values.shape[1:] == (1, 1) else values

    def weyl_ball(self, zeta: Numbers) -> tuple[Complex, Complex, Complex]:
        """Refused: values of positive-real functions with the data of a model fill no ball around one in closed form here."""
        raise InputError(
            "`identification` is of a PositiveReal class, for which the values between the frequency points are not given in"
            " closed form; take worst_case_error(identification, omega=...), which covers all consistent systems"
        )


@dataclasses.dataclass(frozen=True, eq=False)
class PassiveFormulation(ExactFormulation):
    """The exact form of a PositiveReal class."""

    def _sarason(self) -> PassiveMap:
        return PassiveMap(self.pair, self.problem.entries, harnack_bound(self.problem, self.pair))

    @property
    def description(self) -> str:
        """The number of coefficients, and the condition."""
        return f"{self.count} coefficients{self.problem.entries.each}, exact, positive real"

    @property
    def quick(self) -> bool:
        """No other form is."""
        return True

    def check_size(self, accuracy: float) -> None:
        """Refuse what memory does not hold: the matrices A_j of all unknowns."""
        p = self.problem.entries.outputs
        limit = int((MOST_PRODUCTS / p**4) ** (1 / 3))
        if self.count > limit:
            raise SizeError(
                f"`problem` has {self.count} coefficients an entry (2 per frequency point); for a PositiveReal class of {p} port"
                f"{'s' * (p > 1)} up to {limit} are possible. ",
                Remedy({}, "Thin the data: frf.select(slice(None, None, step)), or identify the band in pieces"),
            )


def harnack_bound(problem: MixedProblem, pair: InputNormalPair) -> tuple[float, float]:
    """Two numbers a and b with ||X|| <= a + b s for every function of the class that keeps the residuals within s bounds."""
    # At a frequency point where the whole matrix was measured, W = F(zeta_1) is known within the bounds; for H = F + slack
    #     F(A) = I (x) W + 2 sum_{k>=1} b(A)^k (x) H_1^(1/2) m_k H_1^(1/2),   |m_k| <= 1,   H_1 = Re W + slack,
    #     b(A) = (A - zeta_1) (1 - conj(zeta_1) A)^-1.
    best = (np.inf, 0j, 0.0, 0.0, 0.0)
    nodes = problem.region.points(problem.angles)
    prior, ends = problem.prior, np.concatenate([nodes, nodes.conj()])
    for frf in problem.frequency:
        whole = frf.bound.used.all(axis=(1, 2))
        values, errors = positive_values(frf, problem)[whole], error_sizes(frf, problem)[whole]
        points = problem.region.points(problem.plane.angles(frf.omega[whole]))
        reach = modes_reach(frf, problem)[whole].tolist()
        for W, error, point, modes in zip(values, errors, points, reach, strict=True):
            size = float(np.linalg.norm(W, 2)) + modes
            real = float(np.linalg.norm((W + W.conj().T) / 2, 2)) - prior.least
            real += 0.0 if problem.entries.single else modes  # that of the modes of one port is not negative
            far = float(np.abs((ends - point) / (1 - np.conj(point) * ends)).max())
            guess = size + error + 2 * (real + error) / max(1 - far, 1e-300)
            if guess < best[0]:
                best = (guess, point, size, real, float(error))
    _, point, size, real, error = best
    total, K = _powers(pair, point), prior.gain_bound
    constant = size + abs(K + prior.least) + 2 * real * total
    return (1 + _ROUNDED) * constant / K, (1 + _ROUNDED) * error * (1 + 2 * total) / K


def _powers(pair: InputNormalPair, point: complex) -> float:
    """Above sum_{k >= 1} ||b(A)^k||, by squares: S_2m <= (1 + ||b^m||) S_m."""
    identity = np.eye(pair.order)
    power = np.linalg.solve((identity - np.conj(point) * pair.A).T, (pair.A - point * identity).T).T
    norm = float(np.linalg.norm(power, 2)) + _ROUNDED
    total = norm
    while norm > _ENOUGH:
        total *= 1 + norm
        power = power @ power
        norm = float(np.linalg.norm(power, 2)) + _ROUNDED * norm
        if not np.isfinite(total):
            break
    return total / (1 - norm)

"""The set of all consistent systems, and the extremes of linear functionals over it, each with its certificate."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Sequence

import numpy as np

from robustid._arrays import Frozen
from robustid.bases import input_normal_pair, solve_stein
from robustid.errors import InconsistentDataError
from robustid.identification import Identification
from robustid.identification.forms import Posed, pose
from robustid.interpolation import (
    Functional,
    SarasonMap,
    SupportCertificate,
    certify_support,
    line_tails,
    measurement_rows,
)
from robustid.solve import Candidate, ConvexData, analytic_center, support_path

_BARELY = (
    1e-6  # sets thinner than this have no inside to work from: their outer neighbour of this width is bounded instead
)


@dataclasses.dataclass(frozen=True, eq=False)
class Extreme(Frozen):
    """The largest value of a functional: `attained` by a system of the set, at most `upper` by the certificate.

    Attributes
    ----------
    upper, attained : float
        `attained` is -inf where the set is too thin for a verified member.
    x, p : (n,), (m,) arrays
        Coefficients and scaled parameters of the system that attains it.
    certificate : SupportCertificate
    """

    upper: float
    attained: float
    x: np.ndarray
    p: np.ndarray
    certificate: SupportCertificate


@dataclasses.dataclass(frozen=True, eq=False)
class ConsistentSet:
    """All (x, p) with ||X(x)|| <= 1 and every |residual| <= level * bound, and a point well inside.

    Attributes
    ----------
    posed : Posed
    center : Candidate
        Analytic centre.
    level : float
        1; barely more where the data are barely consistent, so that the set has an inside (bounds over it hold all the more).
    """

    posed: Posed
    center: Candidate
    level: float

    @property
    def data(self) -> ConvexData:
        """Its arrays."""
        return self.posed.data

    def extreme(self, functional: Functional, gap: float) -> Extreme:
        """Largest value, to a part `gap` of how far it is from the value at the centre."""
        data, inside = self.data, functional(self.center.x, self.center.p)
        best, reached = None, (-np.inf, self.center)
        direction = np.array(functional.x), np.array(functional.p)
        for point, value, estimate in support_path(data, self.center, self.level, direction):
            allowed = gap * max(value - inside, 0.0) + functional.tail
            if value > reached[0]:
                reached = value, point
            if estimate > 0.9 * allowed:
                continue
            certificate = certify_support(functional, point.samples, point.ball, self.level, data.rows, data.sarason)
            best = certificate if best is None or certificate.value < best.value else best
            if best.value - functional.tail - reached[0] <= allowed:
                break
        if best is None:  # the path ended early, or the functional is zero
            point = reached[1]
            if point is self.center:
                point = dataclasses.replace(
                    point, samples=np.zeros(data.rows.y.size, complex), ball=np.zeros((data.sarason.pair.order,) * 2)
                )
            best = certify_support(functional, point.samples, point.ball, self.level, data.rows, data.sarason)
        x, p = reached[1].x, reached[1].p
        attained = functional(x, p) - functional.tail if self.contains(x, p) else -np.inf
        return Extreme(best.value, attained, x, p, best)

    def contains(self, x: np.ndarray, p: np.ndarray) -> bool:
        """Whether some system with these coefficients keeps every sample within its bound: evaluated from the numbers."""
        return self.data.margin(x, p) <= 1 + 1e-12 and self.data.sarason.norm(x) <= 1 + 1e-12

    def value_weights(self, omega: float) -> tuple[np.ndarray, np.ndarray, float]:
        """Weights of (x, p) in F(exp(j omega T)), complex, and what the other coefficients can add."""
        problem, rows = self.posed.problem, self.data.rows
        prior, angle = problem.prior, omega * problem.dt
        here, sections = np.array([angle]), self.posed.sections
        basis = self.data.sarason.pair if sections is None else sections
        phi = prior.gain_bound * basis.evaluate(np.exp(-1j * here) / prior.decay_rate)[0]
        tail = 0.0 if sections is None else float(line_tails(problem, sections, here)[0])
        return phi, self._parameter_weights(lambda basis: basis.response(np.array([angle]))[0], rows), tail

    def parameter_weights(self, index: int) -> np.ndarray:
        """Weights of the scaled parameters in parameter number `index`."""
        weights = np.zeros(self.data.rows.P.shape[1])
        weights[index] = 1 / self.data.rows.column_scale[index]
        return weights

    def _parameter_weights(self, values, rows) -> np.ndarray:
        weights = np.zeros(rows.P.shape[1], complex)
        if rows.parameters:
            weights[: rows.parameters] = values(self.posed.problem.parametric) / rows.column_scale[: rows.parameters]
        return weights

    def with_node(self, omega: float) -> ConsistentSet:
        """The same set with coefficients that determine the value at `omega` too.

        The form of a repeated section stays as it is (its tail bounds the value); so does a pair that has the node.
        """
        posed = self.posed_at(omega)
        if posed is self.posed:
            return self
        pair = posed.data.sarason.pair
        alpha, beta, gamma, delta = self._interpolant
        # x = c g(A) of the central interpolant g(zeta) = delta + zeta gamma (I - zeta alpha)^-1 beta.
        x = (delta * pair.c + gamma @ solve_stein(alpha, pair.A, beta @ pair.c @ pair.A))[0]
        start = dataclasses.replace(self.center, x=x)
        return ConsistentSet(posed, analytic_center(posed.data, self.level, [start]), self.level)

    def posed_at(self, omega: float) -> Posed:
        """The arrays of `with_node`, for which nothing is solved; those of the set itself where it has no new node."""
        problem = self.posed.problem
        angle = omega * problem.dt
        if self.posed.sections or np.any(np.abs(problem.angles - angle) <= 1e-12 * max(angle, 1e-300)):
            return self.posed
        # At the head of the cascade: tight samples then say nothing about the new coefficients.
        head = [min(angle, np.pi)]
        pair = input_normal_pair(problem.angles, 1 / problem.prior.decay_rate, problem.taylor, first=head)
        return dataclasses.replace(self.posed, data=ConvexData(measurement_rows(problem, pair), SarasonMap(pair)))

    @functools.cached_property
    def _interpolant(self) -> tuple[np.ndarray, ...]:
        from robustid.interpolation import interpolants

        return interpolants(self.data.sarason, self.center.x).realise()


def consistent_set(identification: Identification) -> ConsistentSet:
    """The set of an identification; raises for data that are not consistent.

    Raises
    ------
    InconsistentDataError
        There is nothing to bound: no system fits, or none was found.
    """
    if not identification.consistent:
        raise InconsistentDataError(
            f"`identification` is {identification.status.name.lower()} (margin {identification.margin:.6g}): there is no consistent"
            " system whose error could be bounded; loosen the bounds or the prior first"
        )
    problem = identification.problem
    posed = pose(problem, identification.sections)
    level = 1.0 if identification.margin < 1 - _BARELY else 1 + _BARELY
    claim = identification.claim
    shrink = identification.prior.gain_bound / problem.prior.gain_bound
    none = np.zeros(0)
    starts = [
        Candidate(shrink * identification.coefficients, identification.scaled_parameters, none, none, ""),
        Candidate(claim.x, claim.p, none, none, ""),
    ]
    if identification.prior.decay_rate != problem.prior.decay_rate:
        starts = starts[1:]
    return set_of(posed, level, starts)


def set_of(posed: Posed, level: float, starts: Sequence[Candidate]) -> ConsistentSet:
    """The set at a level above the smallest margin; `starts` are points that may be inside."""
    return ConsistentSet(posed, analytic_center(posed.data, level, starts), level)

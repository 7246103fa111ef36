"""Proofs about the cells of a pole-uncertainty box: bounds of those that are kept, refutations of the others."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence

import numpy as np

from robustid.core import Complex, Frozen, Real
from robustid.guarantees.consistent_set import ConsistentSet, SupportClaim
from robustid.guarantees.pole_cells import PoleCell
from robustid.guarantees.value_set import ValueSet, directions_at, value_set_claims
from robustid.identification import MarginCertificate, MixedProblem, verify_margin_exactly
from robustid.identification.formulation import Candidate, Formulation, Rows, SarasonMap, formulate

_ACCURACY = 1e-4  # to which the form of a relaxed problem is chosen


@dataclasses.dataclass(frozen=True, eq=False)
class KeptCell(Frozen):
    """A cell that may contain the poles, and the values of the systems with poles inside.

    Attributes
    ----------
    cell : PoleCell
    values : tuple of ValueSet
        Of its relaxed problem, at every frequency; empty where the cell is so wide that no sample says anything.
    """

    cell: PoleCell
    values: tuple[ValueSet, ...]

    def claims(self, problem: MixedProblem, name: str) -> Iterator[SupportClaim]:
        """Claims of the polygons about the relaxed problem, which is made anew from the original one."""
        posed = posed_relaxation(self.cell, problem)
        if posed is None:
            return
        none = np.zeros(0)
        # A centre is where solvers start: no certificate needs it.
        consistent = ConsistentSet(posed, Candidate(none, none, none, none, ""), 1.0)
        for value in self.values:
            for claim in value_set_claims(consistent, value):
                yield dataclasses.replace(claim, name=f"{name}, {claim.name}")

    def is_about(self, problem: MixedProblem, omega: Real) -> bool:
        """Return whether the polygons are closed, at these frequencies, and those of a relaxed problem; or there are none."""
        if not self.values:
            return True
        closed = all(v.directions.size >= directions_at(v.omega, problem.dt, 3).size for v in self.values)
        return (
            closed and np.array_equal([v.omega for v in self.values], omega) and self.cell.relaxed(problem) is not None
        )


@dataclasses.dataclass(frozen=True, eq=False)
class RefutedCell(Frozen):
    """A cell that is proved not to contain the poles: its relaxed problem has a margin above 1."""

    cell: PoleCell
    certificate: MarginCertificate

    def is_about(self, problem: MixedProblem, _: Real) -> bool:
        """Return whether there is a relaxed problem that can be refuted."""
        return self.cell.relaxed(problem) is not None

    def claims(self, problem: MixedProblem, name: str) -> Iterator[RefutationClaim]:
        """The one that it makes; the relaxed problem is made anew."""
        posed = posed_relaxation(self.cell, problem)
        if posed is not None:
            yield RefutationClaim(f"{name}, refuted", self.certificate, posed.data.rows, posed.data.sarason)


@dataclasses.dataclass(frozen=True, eq=False)
class RefutationClaim(Frozen):
    """The margin of a problem exceeds 1, by a certificate.

    Attributes
    ----------
    name : str
        Where in the result this is said.
    certificate : MarginCertificate
    rows : Rows
    sarason : SarasonMap
        The problem in the form in which the certificate is about it.
    """

    name: str
    certificate: MarginCertificate
    rows: Rows
    sarason: SarasonMap

    def verify(self, exact: bool = False) -> bool:
        """Return whether the certificate is about the problem, says more than 1, and holds evaluated anew; see `SupportClaim`."""
        proof, n = self.certificate, self.sarason.pair.order
        fits = proof.samples.shape == self.rows.y.shape and proof.ball.shape == (n, n)
        numbers = all(np.all(np.isfinite(a)) for a in (proof.samples, proof.ball, proof.upper))
        if not (fits and numbers and proof.value > 1):
            return False
        arguments = self.rows, self.sarason
        return proof.verify(*arguments) and (not exact or verify_margin_exactly(proof, *arguments))


def posed_relaxation(cell: PoleCell, problem: MixedProblem) -> Formulation | None:
    """Arrays of the problem that every consistent system with poles in the cell solves; None if no data are left."""
    relaxed = cell.relaxed(problem)
    return None if relaxed is None else formulate(relaxed, accuracy=_ACCURACY)


def union_of(kept: Sequence[KeptCell], nominal: Complex, angles: Real) -> tuple[Real, Real]:
    """Bound of |F - nominal|, (F,), and range of |F|, (F, 2), over all systems with poles in a cell that is kept."""
    upper, low, high = np.zeros(angles.size), np.full(angles.size, np.inf), np.zeros(angles.size)
    for item in kept:
        slack = item.cell.remainder(angles).sum(axis=1)
        far, least, most = np.inf, 0.0, np.inf
        if item.values:
            far = np.array([v.farthest(m)[0] for v, m in zip(item.values, nominal, strict=True)])
            least, most = np.array([v.magnitude for v in item.values]).T
        upper, high = np.maximum(upper, far + slack), np.maximum(high, most + slack)
        low = np.minimum(low, np.maximum(0.0, least - slack))
    return upper, np.stack([low, high], axis=1)

"""What a result says about every consistent system, one sentence of it at a time, with its proof."""

from __future__ import annotations

import dataclasses

import numpy as np

from robustid.core import Frozen
from robustid.identification import Functional, MixedProblem, SupportCertificate, entry_name, verify_support_exactly
from robustid.identification.formulation import Rows, SarasonMap


@dataclasses.dataclass(frozen=True, eq=False)
class SupportClaim(Frozen):
    """`functional` is at most `stated` for every consistent system, by a certificate.

    Attributes
    ----------
    name : str
        Where in the result this is said.
    functional : Functional
    stated : float
    certificate : SupportCertificate
    rows : Rows
    sarason : SarasonMap
        The problem in the form in which the certificate is about it.
    """

    name: str
    functional: Functional
    stated: float
    certificate: SupportCertificate
    rows: Rows
    sarason: SarasonMap

    def verify(self, exact: bool = False) -> bool:
        """Whether the certificate is about all consistent systems, says no less than is stated, and holds when evaluated anew.

        `exact` evaluates it in ball arithmetic too, which needs the extra `robustid[exact]`.
        """
        proof = self.certificate
        if not (self._fits and proof.level >= 1 and proof.value <= self.stated):
            return False
        arguments = self.functional, self.rows, self.sarason
        return proof.verify(*arguments) and (not exact or verify_support_exactly(proof, *arguments))

    @property
    def _fits(self) -> bool:
        """Whether the multipliers are numbers, as many as the problem asks for."""
        proof, (high, wide) = self.certificate, self.sarason.shape
        rank = proof.left.shape[1:]
        shapes = (proof.samples.shape, proof.left.shape, proof.right.shape) == (
            self.rows.y.shape,
            (high, *rank),
            (wide, *rank),
        )
        return shapes and all(np.all(np.isfinite(a)) for a in (proof.samples, proof.left, proof.right))


def which(problem: MixedProblem, entry: tuple[int | None, int | None]) -> str:
    """An entry in words that follow others; none of one channel."""
    name = entry_name(problem, entry)
    return f" ({name})" if name else ""

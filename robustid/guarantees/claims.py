"""Claims about all consistent systems, each with the certificate that proves it when it is evaluated anew."""

from __future__ import annotations

import dataclasses

import numpy as np

from robustid.core import Frozen
from robustid.identification import (
    Functional,
    MarginCertificate,
    SupportCertificate,
    verify_margin_exactly,
    verify_support_exactly,
)
from robustid.identification.formulation import Rows, SarasonMap

SUMS = 1 + 2.0**-51  # most that a bound can be above a sum of two doubles that stands for it


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
        """Return whether the certificate is about all consistent systems, proves what is stated, and holds when evaluated anew.

        `exact` evaluates it in ball arithmetic too, which needs the extra `robustid[exact]`.
        """
        proof = self.certificate
        if not (self._fits and proof.level >= 1 and proof.value <= self.stated):
            return False
        arguments = self.functional, self.rows, self.sarason
        return proof.verify(*arguments) and (not exact or verify_support_exactly(proof, *arguments))

    @property
    def _fits(self) -> bool:
        """Return whether the multipliers are numbers, as many as the problem asks for."""
        proof, (high, wide) = self.certificate, self.sarason.shape
        rank = proof.left.shape[1:]
        shapes = (proof.samples.shape, proof.left.shape, proof.right.shape) == (
            self.rows.y.shape,
            (high, *rank),
            (wide, *rank),
        )
        return shapes and all(np.all(np.isfinite(a)) for a in (proof.samples, proof.left, proof.right))


class RelaxedClaim(SupportClaim):
    """A `SupportClaim` about a relaxed problem, whose bounds are sums that may be too small by one rounding."""

    def verify(self, exact: bool = False) -> bool:
        """As of any claim; in ball arithmetic for bounds that are larger by so much."""
        if not super().verify():
            return False
        proof = dataclasses.replace(self.certificate, level=self.certificate.level * SUMS)
        return not exact or verify_support_exactly(proof, self.functional, self.rows, self.sarason)


@dataclasses.dataclass(frozen=True, eq=False)
class RefutationClaim(Frozen):
    """The margin of a relaxed problem exceeds 1, by a certificate.

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
        proof = self.certificate
        fits = proof.samples.shape == self.rows.y.shape and proof.ball.shape == self.sarason.shape
        numbers = all(np.all(np.isfinite(a)) for a in (proof.samples, proof.ball, proof.upper))
        if not (fits and numbers and proof.value > SUMS):
            return False
        arguments = self.rows, self.sarason
        return proof.verify(*arguments) and (not exact or verify_margin_exactly(proof, *arguments))

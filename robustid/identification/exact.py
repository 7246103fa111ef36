"""The exact form of a problem: one coefficient per datum of the non-parametric part."""

from __future__ import annotations

import dataclasses

import numpy as np

from robustid.bases import input_normal_pair
from robustid.errors import SizeError, Status
from robustid.interpolation import MarginCertificate, MixedProblem, SarasonMap, measurement_rows
from robustid.solve import ConvexData

# The exact form is dense: n^4 work per Newton step of the central path. Minutes begin here.
LARGEST_EXACT = 200
_EDGE = 1e-6  # how far outside the smallest margin the model is centred


def exact_data(problem: MixedProblem) -> ConvexData:
    """The arrays of the exact form, refused where they would be too large."""
    n = problem.coefficients
    if n > LARGEST_EXACT:
        raise SizeError(
            f"`problem` has {n} coefficients in the exact form (2 per frequency line, 1 per time sample); it takes up to"
            f" {LARGEST_EXACT}. Thin the data: frf.select(slice(None, None, step)), a shorter record, or fewer lines"
            " off resonance"
        )
    pair = input_normal_pair(problem.angles, 1 / problem.prior.decay_rate, problem.taylor)
    return ConvexData(measurement_rows(problem, pair), SarasonMap(pair))


@dataclasses.dataclass(frozen=True, eq=False)
class Claim:
    """The margin as it is claimed: reached by the point (x, p), proved from below by the certificate, to an accuracy."""

    margin: float
    accuracy: float
    x: np.ndarray
    p: np.ndarray
    certificate: MarginCertificate
    solver: str

    @property
    def width(self) -> float:
        """Of the proven interval, relative where the margin exceeds 1; infinite where its ends are the wrong way round."""
        difference = self.margin - self.certificate.value
        return difference / max(1.0, self.margin) if difference >= 0 else np.inf

    @property
    def status(self) -> Status:
        """What the interval says."""
        if self.margin <= 1:
            return Status.CONSISTENT
        if self.certificate.value > 1:
            return Status.INCONSISTENT
        return Status.UNDECIDED if self.width <= self.accuracy else Status.FAILED


def level_of(objective: str, margin: float, accuracy: float) -> float:
    """The multiple of the bounds that defines the set from which the model is taken."""
    widest = max(1.0, margin * (1 + _EDGE))
    return min(margin * (1 + _EDGE) + accuracy, widest) if objective == "margin" else widest

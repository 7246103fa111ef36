"""Extremes of linear functionals over a set of coefficients: proved from above, attained from below."""

from __future__ import annotations

import dataclasses

import numpy as np

from robustid.core import Frozen, Real
from robustid.identification import Functional, SupportCertificate, certify_support
from robustid.identification.formulation import Candidate, ConvexData
from robustid.identification.solver import Place, Supports, analytic_center

_SAFE, _SHARPER = 0.9, 5.0  # estimated gaps over those that are asked for: where they are met, and where that may be
_EARLY = 0.1  # of the distance from the centre: estimated gap of a place from which others may start


@dataclasses.dataclass(frozen=True, eq=False)
class Extreme(Frozen):
    """The largest value of a functional: `attained` by a system of the set, at most `upper` by the certificate."""

    upper: float
    attained: float  # -inf where the set is too thin for a verified member
    x: Real  # coefficients of the system that attains it
    p: Real  # its scaled parameters
    certificate: SupportCertificate
    place: Place | None = None  # on its path, from which those to functionals near to it may start

    def proved_by(self, other: Extreme) -> Extreme:
        """The same attained value with the bound of another extreme of the same functional."""
        return dataclasses.replace(self, upper=other.upper, certificate=other.certificate)


@dataclasses.dataclass(frozen=True, eq=False)
class PartSet:
    """Arrays and a centre from which extremes over the set of a part are found."""

    data: ConvexData
    center: Candidate
    level: float
    supports: Supports


def part_set(data: ConvexData, level: float, x: Real, p: Real) -> PartSet:
    """The set of a part, from a point inside."""
    none = np.zeros(0)
    center = analytic_center(data, level, [Candidate(x, p, none, none, "")], quick=True)
    return PartSet(data, center, level, Supports(data, center, level))


def largest(
    data: ConvexData,
    supports: Supports,
    center: Candidate,
    level: float,
    functional: Functional,
    gap: float,
    near: Place | None = None,
    early: bool = False,
) -> Extreme:
    """Largest value of a functional over the set of some data; `attained` is not verified to be that of a member.

    From a place on the way to it, and from the centre where that way ends too soon. `early` ones leave most of the gap open.
    """
    inside, met = functional(center.x, center.p), False
    best, reached = None, (-np.inf, center)
    place: Place | None = None
    for step in supports.path((np.array(functional.x), np.array(functional.p)), near):
        point, value, estimate = step.candidate, step.value, step.gap
        far = max(value - inside, 0.0)
        allowed = gap * far + functional.tail
        if value > reached[0]:
            reached = value, point
        # Near to the border sums of places are of no use: the last one before the gap is small.
        place = step.place if place is None or far == 0 or estimate > _EARLY * far else place
        if estimate > _SAFE * allowed and not (
            early and estimate <= _SHARPER * allowed and _bound(point, level, data) - reached[0] <= allowed
        ):
            continue
        certificate = certify_support(functional, point.samples, point.ball, level, data.rows, data.sarason)
        best = certificate if best is None or certificate.value < best.value else best
        met = best.value - functional.tail - reached[0] <= allowed
        if met:
            break
    if near is not None and not met:
        return largest(data, supports, center, level, functional, gap, early=early)
    if best is None:  # the path ended early, or the functional is zero
        point = reached[1]
        if point is center:
            point = dataclasses.replace(
                point, samples=np.zeros(data.rows.y.size, complex), ball=np.zeros(data.sarason.shape)
            )
        best = certify_support(functional, point.samples, point.ball, level, data.rows, data.sarason)
    x, p = reached[1].x, reached[1].p
    return Extreme(best.value, functional(x, p) - functional.tail, x, p, best, place)


def _bound(point: Candidate, level: float, data: ConvexData) -> float:
    """About what the multipliers of a point in the ball prove, but for the tail, at a half to a quarter of the estimated gap."""
    rows, size = data.rows, data.rows.sizes(point.samples)
    fit = float(np.real(point.samples.conj() @ rows.y)) + float(size @ (level + rows.tail))
    return fit + data.sarason.product(point.ball, level)

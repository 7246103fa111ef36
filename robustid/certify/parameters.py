"""Guaranteed intervals of the parametric coefficients."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

import numpy as np

from robustid._arrays import Frozen, freeze
from robustid.certify.claims import SupportClaim
from robustid.certify.consistent_set import ConsistentSet
from robustid.interpolation import Functional, SupportCertificate


@dataclasses.dataclass(frozen=True, eq=False)
class ParameterIntervals(Frozen):
    """For every parametric coefficient p_i, the interval that contains it in every consistent system.

    Attributes
    ----------
    lower, upper : (m,) arrays
        Proved, in the units of `Identification.parameters`.
    attained : (m, 2) array
        Lowest and highest values of systems that were found; the truth of the interval lies between these and the ends.
    certificates : tuple of SupportCertificate
        Of -p_i and of p_i, in turn.
    """

    lower: np.ndarray
    upper: np.ndarray
    attained: np.ndarray
    certificates: tuple[SupportCertificate, ...]

    def __post_init__(self) -> None:
        self._set(**{name: freeze(getattr(self, name)) for name in ("lower", "upper", "attained")})


def parameter_intervals(consistent: ConsistentSet, gap: float = 1e-3) -> ParameterIntervals:
    """Smallest and largest value of every parametric coefficient over the set, to a part `gap`."""
    n, count = consistent.data.sarason.pair.order, consistent.data.rows.parameters
    ends, attained, certificates = np.zeros((count, 2)), np.zeros((count, 2)), []
    for index in range(count):
        weights = consistent.parameter_weights(index)
        for column, sign in enumerate((-1.0, 1.0)):
            found = consistent.extreme(Functional(np.zeros(n), sign * weights), gap)
            ends[index, column] = sign * found.upper
            attained[index, column] = sign * found.attained
            certificates.append(found.certificate)
    return ParameterIntervals(ends[:, 0], ends[:, 1], attained, tuple(certificates))


def parameter_claims(consistent: ConsistentSet, found: ParameterIntervals) -> Iterator[SupportClaim]:
    """What the intervals say, end by end."""
    data, basis = consistent.data, consistent.posed.problem.parametric
    nothing = np.zeros(data.sarason.pair.order)
    stated = np.stack([-found.lower, found.upper], axis=1).ravel()
    for number, (value, proof) in enumerate(zip(stated, found.certificates, strict=True)):
        index, upper = divmod(number, 2)
        functional = Functional(nothing, (1.0 if upper else -1.0) * consistent.parameter_weights(index))
        name = f"{'upper' if upper else 'lower'} end of the coefficient of {basis.labels[index]}"
        yield SupportClaim(name, functional, float(value), proof, data.rows, data.sarason)

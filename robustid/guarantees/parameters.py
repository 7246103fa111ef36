"""Guaranteed intervals of the parametric coefficients."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

import numpy as np

from robustid.core import Frozen, Real, freeze
from robustid.guarantees.consistent_set import ConsistentSet, Entry, Extreme, SupportClaim, independent_entries, which
from robustid.guarantees.spread import Spread, spread
from robustid.identification import Functional, SupportCertificate

_GAP, _LOOSE = 1e-3, 0.02  # of an interval of a SISO plant, and of one of many of a matrix


@dataclasses.dataclass(frozen=True, eq=False)
class ParameterIntervals(Frozen):
    """For every parametric coefficient p_i, the interval that contains it in every consistent system.

    Attributes
    ----------
    lower, upper : (m,) arrays; MIMO: (m, ny, nu), every entry of the residue matrices
        Proved, in the units of `Identification.parameters`.
    attained : (m, 2) array; (m, ny, nu, 2)
        Lowest and highest values of systems that were found; the truth of the interval lies between these and the ends.
    certificates : tuple of SupportCertificate
        Of -p_i and of p_i, in turn; entry after entry, of symmetric matrices those of the upper triangle.
    """

    lower: Real
    upper: Real
    attained: Real
    certificates: tuple[SupportCertificate, ...]

    def __post_init__(self) -> None:
        self._set(**{name: freeze(getattr(self, name)) for name in ("lower", "upper", "attained")})

    def reach(self, parameters: Real) -> Real:
        """Largest distance of each coefficient from given ones, in the shape of `lower`."""
        return np.maximum(np.abs(self.lower - parameters), np.abs(self.upper - parameters))


def parameter_intervals(consistent: ConsistentSet, executor: Spread = None) -> ParameterIntervals:
    """Smallest and largest value of every parametric coefficient over the set, to a thousandth; of matrices to a fiftieth."""
    problem = consistent.posed.problem
    size = 0 if problem.parametric is None else problem.parametric.size
    # Lower and upper ends, then what is attained of them.
    ends = np.zeros((size, problem.entries.outputs, problem.entries.inputs, 4))
    wanted = [(entry, index) for entry in independent_entries(problem.entries) for index in range(size)]
    found = dict(spread(_both_ends, consistent, wanted, executor, "parameter {0[1]} of entry {0[0]}".format))
    for entry, index in wanted:
        for side, sign in enumerate((-1.0, 1.0)):
            one = found[entry, index][side]
            ends[index, *entry, [side, 2 + side]] = sign * one.upper, sign * one.attained
        if problem.entries.symmetric:
            ends[index, *entry[::-1]] = ends[index, *entry]
    certificates = [one.certificate for each in wanted for one in found[each]]
    if problem.entries.single:
        ends = ends[:, 0, 0]
    return ParameterIntervals(ends[..., 0], ends[..., 1], ends[..., 2:], tuple(certificates))


def _both_ends(consistent: ConsistentSet, which: tuple[Entry, int]) -> tuple[Extreme, Extreme]:
    """The extremes of minus a coefficient of an entry, and of the coefficient."""
    (entry, index), nothing = which, np.zeros(consistent.data.sarason.size)
    weights, gap = (
        consistent.parameter_weights(index, entry),
        _GAP if consistent.posed.problem.entries.single else _LOOSE,
    )
    low, high = (consistent.extreme(Functional(nothing, s * weights), gap, reached=gap == _GAP) for s in (-1.0, 1.0))
    return low, high


def parameter_claims(consistent: ConsistentSet, found: ParameterIntervals) -> Iterator[SupportClaim]:
    """Claims of the intervals, end by end."""
    data, problem = consistent.data, consistent.posed.problem
    labels = () if problem.parametric is None else problem.parametric.labels
    size, entries, nothing = len(labels), problem.entries, np.zeros(data.sarason.size)
    proofs = iter(found.certificates)
    if len(found.certificates) != 2 * size * entries.count:
        raise ValueError("its intervals and their certificates differ in number")
    stated = np.stack([-found.lower, found.upper], axis=-1).reshape(size, entries.outputs, entries.inputs, 2)
    for entry in independent_entries(entries):
        both = (entry, entry[::-1]) if entries.symmetric else (entry,)
        for index, side in np.ndindex(size, 2):
            functional = Functional(nothing, (2.0 * side - 1) * consistent.parameter_weights(index, entry))
            name = f"{'upper' if side else 'lower'} end of the coefficient of {labels[index]}{which(problem, entry)}"
            value = min(float(stated[index, *place, side]) for place in both)
            yield SupportClaim(name, functional, value, next(proofs), data.rows, data.sarason)

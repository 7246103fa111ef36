"""Guaranteed intervals of the parametric coefficients."""

from __future__ import annotations

import contextlib
import dataclasses
from collections.abc import Iterator

import numpy as np

from robustid.core import Budget, Frozen, Pieces, Real, freeze
from robustid.guarantees.consistent_set import ConsistentSet, Entry, Extreme, independent_entries, which
from robustid.guarantees.sweep import Processes, answers
from robustid.guarantees.value_set import SupportClaim
from robustid.identification import Functional, SupportCertificate

_GAP, _LOOSE = 1e-3, 0.02  # of an interval of a SISO plant, and of one of many of a matrix


@dataclasses.dataclass(frozen=True, eq=False)
class ParameterIntervals(Frozen):
    """For every parametric coefficient p_i, the interval that contains it in every consistent system.

    Attributes
    ----------
    lower, upper : (m,) arrays; MIMO: (m, ny, nu), every entry of the residue matrices
        Proved, in the units of `Identification.parameters`; infinite where the time was over.
    attained : (m, 2) array; (m, ny, nu, 2)
        Lowest and highest values of systems that were found; the truth of the interval lies between these and the ends. NaN
        where the time was over.
    certificates : tuple of SupportCertificate
        Of -p_i and of p_i, in turn; entry after entry, of symmetric matrices those of the upper triangle.
    """

    lower: Real
    upper: Real
    attained: Real
    certificates: tuple[SupportCertificate, ...]

    def __post_init__(self) -> None:
        self._set(**{name: freeze(getattr(self, name)) for name in ("lower", "upper", "attained")})

    @property
    def complete(self) -> bool:
        """Return whether every coefficient has its interval: the time did for all."""
        return bool(np.all(np.isfinite(self.lower)))

    def reach(self, parameters: Real) -> Real:
        """Largest distance of each coefficient from given ones, in the shape of `lower`."""
        return np.maximum(np.abs(self.lower - parameters), np.abs(self.upper - parameters))


def parameter_intervals(
    consistent: ConsistentSet, executor: Processes = None, budget: Budget | None = None
) -> ParameterIntervals:
    """Smallest and largest value of every parametric coefficient over the set, to a thousandth; of matrices to a fiftieth.

    Those of which the budget leaves nothing are infinite.
    """
    problem = consistent.posed.problem
    size = 0 if problem.parametric is None else problem.parametric.size
    # Lower and upper ends, then what is attained of them.
    ends = np.full((size, problem.entries.outputs, problem.entries.inputs, 4), [-np.inf, np.inf, np.nan, np.nan])
    wanted = [(entry, index) for entry in independent_entries(problem.entries) for index in range(size)]
    found: dict[tuple[Entry, int], tuple[Extreme, Extreme]] = {}
    if budget is None or not budget.over:
        name, pieces = "parameter {0[1]} of entry {0[0]}".format, Pieces(budget if executor is None else None)
        with contextlib.closing(answers(_both_ends, consistent, wanted, executor, name)) as each:
            for one, both in each:
                found[one] = both
                if budget is not None and (budget.over or not pieces.begins()):
                    break
    wanted = [one for one in wanted if one in found]
    for entry, index in wanted:
        for side, sign in enumerate((-1.0, 1.0)):
            one = found[entry, index][side]
            ends[index, *entry, [side, 2 + side]] = sign * one.upper, sign * one.attained
        if problem.entries.symmetric:
            ends[index, *entry[::-1]] = ends[index, *entry]
    certificates = [one.certificate for each in wanted for one in found[each]]
    ends = problem.entries.as_given(ends)
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
    stated = np.stack([-found.lower, found.upper], axis=-1).reshape(size, entries.outputs, entries.inputs, 2)
    if entries.symmetric:
        stated = np.minimum(stated, stated.swapaxes(1, 2))
    ends = [
        (entry, index, side)
        for entry in independent_entries(entries)
        for index in range(size)
        for side in range(2)
        if np.isfinite(stated[index, *entry]).any()
    ]
    if len(found.certificates) != len(ends):
        raise ValueError("its intervals and their certificates differ in number")
    for entry, index, side in ends:
        functional = Functional(nothing, (2.0 * side - 1) * consistent.parameter_weights(index, entry))
        name = f"{'upper' if side else 'lower'} end of the coefficient of {labels[index]}{which(problem, entry)}"
        yield SupportClaim(name, functional, float(stated[index, *entry, side]), next(proofs), data.rows, data.sarason)

"""Samples as all others predict them, and the quick check of a problem of one entry that follows."""

# pyright: reportConstantRedefinition=false
# Matrices have capital letters.
from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from robustid.core import Budget, Complex, Frozen, Real, Record, counted, freeze, one_thread
from robustid.errors import InputError
from robustid.guarantees.linear.amplitudes import Extraction, extract
from robustid.guarantees.linear.certificate import Chosen, Targets, choose, discs
from robustid.guarantees.linear.functions import fixed_functions
from robustid.guarantees.linear.samples import Samples, samples_of
from robustid.guarantees.linear.search import FEW, POINTS, nearest_points, reweighted
from robustid.identification import MixedProblem

_STACK = 4e5  # complex numbers in the matrices of a stack: what a cache holds
_ROWS = 24  # samples of the records of an entry that are predicted by the others
_CHECKED = 200  # samples that a check looks at


@dataclasses.dataclass(frozen=True, eq=False)
class Predictions(Frozen):
    """Samples as all others predict them, each with multipliers of its own: -1 for the sample."""

    base: Complex  # (B,)
    points: NDArray[np.intp]  # (B, n)
    multipliers: Complex  # (B, n + T)
    own: NDArray[np.intp]  # (B,), number of the sample among the multipliers
    values: Complex  # (B,), the samples
    bound: Real  # (B,), their bounds, with what the series leave out
    centre: Complex  # (B,), of the disc that the others leave to the sample
    radius: Real  # (B,)

    @property
    def ratio(self) -> Real:
        """|value - centre| over bound + radius, (B,): above 1 no system keeps the bounds."""
        return np.abs(self.values - self.centre) / (self.bound + self.radius)

    def proof(self, k: int) -> Record:
        """Base, points, multipliers and the number of the sample of one of them."""
        parts = {"points": self.points[k], "multipliers": self.multipliers[k]}
        return {"base": complex(self.base[k]), "sample": int(self.own[k]), **parts}


def nothing(samples: Samples, base: Complex) -> Targets:
    """The functional that is zero, seen from some zeta, (B,)."""
    zero = np.zeros((base.size, samples.amplitude_of.size), complex)
    return Targets(base, np.zeros(base.size, complex), zero, np.zeros((base.size, samples.amplitudes)))


def lines_of(samples: Samples) -> NDArray[np.intp]:
    """The lines that see the entry before all others, of positive angles."""
    half = samples.angles.size // 2
    return np.flatnonzero(np.argmax(samples.v[:half] != 0, axis=1) == samples.target)


def predicted_lines(
    extraction: Extraction, lines: NDArray[np.intp], points: int | None = None, budget: Budget | None = None
) -> list[Predictions]:
    """Lines as so many points of all others predict them; within a budget the first of them."""
    samples = extraction.samples
    half = samples.angles.size // 2
    points = POINTS + min(int(samples.first.sum()), POINTS) if points is None else points
    real = np.abs(samples.nodes[lines] - samples.nodes[lines + half]) == 0  # they see the same as their conjugates
    groups = [(lines[real == twins], twins) for twins in (False, True) if np.any(real == twins)]
    return [_near(extraction, group, twins, points, budget) for group, twins in groups]


def _near(
    extraction: Extraction, lines: NDArray[np.intp], twins: bool, count: int, budget: Budget | None
) -> Predictions:
    samples = extraction.samples
    total, base = samples.angles.size, samples.nodes[lines]
    count = min(count, total - 1 - twins)
    near = nearest_points(samples, base, count + 1 + twins)
    points = np.empty((lines.size, count + 1), int)
    points[:, 0] = lines
    for row, (k, every) in enumerate(zip(lines.tolist(), near, strict=True)):
        out = (k, k + total // 2) if twins else (k,)
        points[row, 1:] = every[~np.isin(every, out)][:count]
    return _found(extraction, base, points, np.zeros(lines.size, int), budget)


def predicted_rows(extraction: Extraction, budget: Budget | None = None) -> list[Predictions]:
    """Some samples of the records as all others predict them; within a budget the first of these."""
    samples = extraction.samples
    if not samples.rows:
        return []
    rows = np.unique(np.linspace(0, samples.rows - 1, _ROWS).round().astype(int))
    base = np.zeros(rows.size, complex)
    points = nearest_points(samples, base, POINTS)
    return [_found(extraction, base, points, points.shape[1] + rows, budget)]


def _found(
    extraction: Extraction, base: Complex, points: NDArray[np.intp], own: NDArray[np.intp], budget: Budget | None
) -> Predictions:
    """Search what predicts the samples number `own` (B,) among the points (B, n) and the rows, stack by stack.

    Within a budget: the first stacks, one at least.
    """
    samples, known = extraction.samples, extraction.known
    size = points.shape[1] + samples.rows
    stack = max(int(_STACK / (size * (3 * size + 2 * samples.amplitude_of.size + 1))), 1)
    multipliers: Complex = np.full((base.size, size), -1, complex)
    numbers: list[tuple[Complex, Real, Complex, Real]] = []
    for first in range(0, base.size, stack):
        if first and budget is not None and budget.over:
            base, points, own, multipliers = base[:first], points[:first], own[:first], multipliers[:first]
            break
        part = slice(first, first + stack)
        targets, at = nothing(samples, base[part]), own[part, None]
        chosen = choose(samples, targets, points[part])
        rest, predicted, others = without(chosen, base[part], own[part])
        d = multipliers[part]
        np.put_along_axis(d, others, reweighted(samples, rest, predicted, known, budget=budget), axis=1)
        bound = chosen.bound + chosen.left_out @ known.largest
        y, own_bound = (np.take_along_axis(one, at, axis=1)[:, 0] for one in (chosen.y, bound.astype(complex)))
        numbers.append((y, own_bound.real, *discs(samples, chosen, targets, d, known)))
    y, bound, centre, radius = (np.concatenate(one) for one in zip(*numbers, strict=True))
    # Zero is in the disc about `centre` if any system keeps all bounds.
    return Predictions(base, points, multipliers, own, y.astype(complex), bound, centre + y, radius - bound)


def without(chosen: Chosen, base: Complex, own: NDArray[np.intp]) -> tuple[Chosen, Targets, NDArray[np.intp]]:
    """The arrays without one sample of every target, that sample as the target, and the numbers (B, S - 1) of the others."""
    count, size = len(chosen.bound), int(chosen.bound.shape[1])
    number, row = np.arange(size - 1), np.arange(count)
    others = number + (number >= own[:, None])
    weight = np.sqrt(chosen.gram[row, own, own].real).astype(complex)
    targets = Targets(base, weight, chosen.values[row, own], chosen.left_out[row, own])
    rows = row[:, None]
    gram = chosen.gram[rows[:, :, None], others[:, :, None], others[:, None, :]]
    rest = [getattr(chosen, name)[rows, others] for name in ("values", "y", "bound", "left_out")]
    return Chosen(chosen.points, gram, chosen.gram[rows, others, own[:, None]], *rest), targets, others


@dataclasses.dataclass(frozen=True, eq=False)
class SampleCheck(Frozen):
    """Discs that hold the response of every consistent system at samples, each proved from the other samples alone.

    Attributes
    ----------
    problem : MixedProblem
    omega : (F,) array, rad/s
        Of the samples, ascending.
    values : (F,) complex array
    bound : (F,) array
    centre : (F,) complex array
    radius : (F,) array
    """

    problem: MixedProblem
    omega: Real
    values: Complex
    bound: Real
    centre: Complex
    radius: Real

    def __post_init__(self) -> None:
        names = ("omega", "values", "bound", "centre", "radius")
        self._set(**{name: freeze(np.asarray(getattr(self, name))) for name in names})

    @property
    def ratio(self) -> Real:
        """|value - centre| over bound + radius, (F,): above 1 the discs have no common point, and no system is consistent."""
        return np.abs(self.values - self.centre) / (self.bound + self.radius)

    @property
    def margin(self) -> float:
        """The largest ratio: where it is above 1, a proved lower bound of the consistency margin.

        With all bounds times s >= 1 every radius grows at most by s.
        """
        return float(self.ratio.max(initial=0.0))

    @property
    def worst(self) -> float:
        """Frequency of the sample with the largest ratio, rad/s."""
        return float(self.omega[np.argmax(self.ratio)])

    @property
    def contradicts(self) -> bool:
        """True where no system of the class keeps all samples within their bounds; False says nothing."""
        return self.margin > 1


def check_samples(problem: MixedProblem) -> SampleCheck:
    """Check samples of a problem of one entry, poles as stated: all of them, or 200 of many.

    At its own sample a band is never farther away than the bound; a disc from the other samples may be.
    InputError: a problem of several entries.
    """
    outputs, inputs = problem.entries.shape
    if outputs * inputs > 1:
        raise InputError(
            f"`problem` must have one input and one output; got {counted(outputs, 'output')} and"
            f" {counted(inputs, 'input')}: choose an entry"
        )
    samples = samples_of(problem, fixed_functions(problem.parametric), (0, 0))
    with one_thread():
        own = _checked(samples)
        each = predicted_lines(extract(samples), own, FEW)
    none = np.zeros(0)
    parts = ([none, *(getattr(one, name) for one in each)] for name in ("values", "bound", "centre", "radius"))
    values, bound, centre, radius = (np.concatenate(one) for one in parts)
    angles = np.concatenate([none, *(samples.angles[one.points[:, 0]] for one in each)])
    order = np.argsort(angles, kind="stable")
    sample = values[order].astype(complex), bound[order], centre[order].astype(complex), radius[order]
    return SampleCheck(problem, problem.plane.omega(angles[order]), *sample)


def _checked(samples: Samples) -> NDArray[np.intp]:
    """Numbers of the samples to be checked: those of the response itself."""
    own = lines_of(samples)
    own = own[samples.v[own, 0] == 1]
    own = own[np.argsort(samples.angles[own], kind="stable")]
    return own[np.unique(np.linspace(0, own.size - 1, min(_CHECKED, own.size)).round().astype(int))]

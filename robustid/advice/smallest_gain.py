"""Smallest gain bound with which data are consistent, and the frequency points that stand for all of them."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from robustid.core import Budget, Complex, Real, StateSpace, threads_for
from robustid.data import PROBABLE, FrequencyResponse, TangentialResponse, variances
from robustid.errors import SolverError
from robustid.identification import MixedProblem, model_residuals
from robustid.identification.formulation import bounded_points, formulate
from robustid.identification.solver import analytic_center, gain_path

Mask = NDArray[np.bool_]

DIGITS = 1e-3  # relative, of the smallest gain
TAILS = (
    0.1  # accuracy that sets the number of Taylor coefficients: tails up to 1 % of a bound only make K a little larger
)
CEILINGS = (
    8.0,
    8e3,
)  # gain bounds tried, in units of the largest response in the data; above the last one is as good as none
_MODE = 6.0  # points that a mode gets beside those in equal steps
_SPARE = 1.5  # times its bound: what a point that was left out may miss the model of the others by
# A point that is barely outside says something about noise; the noise of two points, of model and data, is 2 bounds.
_ADDED = 8  # points that join the others at a time
_SURE = 1e-3  # of a bound is left at least without what is in doubt: what is below is next to no noise
_NEGLIGIBLE = 0.01  # a non-parametric part below this part of the smallest bound can't be told from none


def smallest_gain(
    problem: MixedProblem,
    decay_rate: float,
    whole: MixedProblem | None = None,
    ceilings: tuple[float, ...] = CEILINGS,
    budget: Budget | None = None,
) -> float:
    """Smallest K, to 0.1 % from above, with which the data are consistent at one decay rate; inf where there is none.

    Gain bounds up to the `ceilings`, in units of the largest response (of a `whole` that the data are a part of), are tried.
    Where the time is over: the smallest so far.
    """
    above = np.inf
    for _, above, _ in gain_bounds(problem, decay_rate, whole, ceilings, budget):
        if budget is not None and budget.over:
            return above
    return above


def gain_bounds(
    problem: MixedProblem,
    decay_rate: float,
    whole: MixedProblem | None = None,
    ceilings: tuple[float, ...] = CEILINGS,
    budget: Budget | None = None,
) -> Iterator[tuple[float, float, Real]]:
    """Ever closer bounds of the `smallest_gain`, from below (as the path estimates it) and from above; the last two are equal.

    Third come the multipliers of the bounds of the samples, (M,): which of them ask for the gain.
    """
    largest, smallest = response_sizes(problem if whole is None else whole)
    for ceiling in ceilings:
        K = ceiling * largest
        trial = problem.with_prior(gain_bound=K, rate=decay_rate)
        form = formulate(trial, accuracy=TAILS)
        kappa, multipliers = 1.0, np.zeros(0)
        try:
            with threads_for(form.count):
                center = analytic_center(form.data, 1.0, budget=budget)
        except SolverError:
            continue
        path = gain_path(form.data, center, 1.0)
        while True:
            with threads_for(form.count):
                step = next(path, None)
            if step is None:
                break
            at, kappa, gap = step
            multipliers = form.data.rows.sizes(at.samples)
            if gap <= DIGITS * kappa or kappa * K <= _NEGLIGIBLE * smallest:
                break
            yield max(kappa - gap, 0.0) * K, kappa * K, multipliers
        gain = kappa * K if kappa * K > _NEGLIGIBLE * smallest else 0.0
        yield gain, gain, multipliers
        return
    yield np.inf, np.inf, np.zeros(0)


def response_sizes(problem: MixedProblem) -> tuple[float, float]:
    """Largest response in the data and smallest bound, both as a gain (output per input), over scaling and weight of the prior."""
    values: list[float] = []
    bounds: list[float] = []
    scales = problem.prior.scales(len(problem.outputs), len(problem.inputs))
    for f in problem.frequency:
        values.append(float(entry_sizes(problem, f).max()))
        weights = _largest_weights(f, scales) * _weight(problem, f)
        bounds.append(float((f.bound.inner_radius / weights)[f.bound.used].min()))
    for record in problem.time:
        drive = np.linalg.norm(problem.weighting.filtered(record.u)[:, None] * scales, axis=2).max(axis=0)
        drive = np.where(drive > 0, drive, 1.0)
        values.append(float(np.where(record.bound.used, np.abs(record.y) / drive, 0.0).max()))
        bounds.append(float((record.bound.radius / drive).min()))
    return max(*values, *bounds), min(bounds)


def typical_bound(problem: MixedProblem) -> float:
    """Median of the bounds of the responses as a gain, over scaling and weight of the prior; 0 without responses."""
    scales, found = problem.prior.scales(len(problem.outputs), len(problem.inputs)), [np.zeros(0)]
    for f in problem.frequency:
        weights = _largest_weights(f, scales) * _weight(problem, f)
        found.append((f.bound.inner_radius / weights)[f.bound.used].ravel())
    every = np.concatenate(found)
    return float(np.median(every)) if every.size else 0.0


def without_doubt(problem: MixedProblem) -> MixedProblem:
    """The problem with the bounds without what is no noise in them: modes in doubt, and halves that differ; the same one without.

    Inside bounds that are wider for either a smaller non-parametric part holds the data, though nothing shows that it is smaller.
    """
    found = tuple(_without_doubt(f) for f in problem.frequency)
    same = all(one is other for one, other in zip(found, problem.frequency, strict=True))
    return problem if same else dataclasses.replace(problem, frequency=found)


def _without_doubt(f: FrequencyResponse | TangentialResponse) -> FrequencyResponse | TangentialResponse:
    if isinstance(f, TangentialResponse) or f.covariance is None or (f.doubt is None and f.changed is None):
        return f
    if f.bound.kind not in PROBABLE or f.bound.joint != "entry":  # it isn't that of the estimate
        return f
    variance = variances(f.covariance, f.values.shape)
    unsure = 0.0 if f.doubt is None else np.abs(f.doubt) ** 2 / 2
    added = unsure + (0.0 if f.changed is None else f.changed**2)
    part = np.divide(added, variance, out=np.zeros(variance.shape), where=variance > 0)
    left = np.sqrt(np.maximum(1 - part, _SURE**2))
    bound = dataclasses.replace(f.bound, radius=left * f.bound.radius)
    return dataclasses.replace(f, bound=bound, doubt=None, changed=None)


def entry_sizes(problem: MixedProblem, f: FrequencyResponse | TangentialResponse) -> Real:
    """Absolute values of the measured samples of a frequency response, over scaling and weight of the prior."""
    scales = problem.prior.scales(len(problem.outputs), len(problem.inputs))
    return (np.abs(f.values) / (_largest_weights(f, scales) * _weight(problem, f)))[f.bound.used]


def _weight(problem: MixedProblem, f: FrequencyResponse | TangentialResponse) -> Real:
    """The weight of the class at the points of a frequency response, (F, 1, 1)."""
    return problem.weighting.sizes(problem.plane.angles(f.omega))[:, None, None]


def _largest_weights(f: FrequencyResponse | TangentialResponse, scales: Real) -> Real:
    """Factor of the scaling for every sample; of one in directions, of the largest gain in them."""
    if isinstance(f, TangentialResponse):
        return np.linalg.svd(f.weights * scales, compute_uv=False).max(axis=-1)
    return scales


def thinned(problem: MixedProblem, most: int) -> tuple[Mask, ...]:
    """Mask of the points of every response that stand for all, about `most` together.

    Equal steps of ``t(omega) = omega/width + (6/most) sum_i phase_i(omega)/pi``, phase_i that of an all-pass with the pole of
    mode i: half the points of a resonance lie within its half-width.
    """
    sizes = np.array([f.omega.size for f in problem.frequency])
    shares = np.maximum(2, np.round(np.asarray(most * sizes / sizes.sum(), dtype=float))).astype(int)
    return tuple(
        _of_response(problem.plane.angles(f.omega), _poles(problem), int(share))
        for f, share in zip(problem.frequency, shares, strict=True)
    )


def selected(problem: MixedProblem, masks: tuple[Mask, ...]) -> MixedProblem:
    """The problem with these points of its responses."""
    parts = tuple(f.select(mask) for f, mask in zip(problem.frequency, masks, strict=True))
    return dataclasses.replace(problem, frequency=parts)


def pressing(problem: MixedProblem, multipliers: Real, most: int) -> tuple[Mask, ...] | None:
    """Masks of the points, `most` of them, that ask for the gain: with the largest multipliers of their bounds, (M,).

    None where a response has none of them, or the multipliers are none.
    """
    places = [bounded_points(f) for f in problem.frequency]
    ends = np.cumsum([one.size for one in places])
    if not places or multipliers.size < ends[-1]:
        return None
    parts = np.split(multipliers[: ends[-1]], ends[:-1])
    sums = [np.bincount(at, one, f.omega.size) for at, one, f in zip(places, parts, problem.frequency, strict=True)]
    least = np.sort(np.concatenate(sums))[-most:][0]
    masks = tuple(one >= least for one in sums)
    return masks if all(mask.any() for mask in masks) else None


def missed(problem: MixedProblem, masks: tuple[Mask, ...], model: StateSpace) -> tuple[Mask, ...] | None:
    """The masks and the worst points that a model of these misses by more than 1.5 bounds; None where there are none."""
    worst = [np.where(mask, 0.0, one) for mask, one in zip(masks, _ratios(problem, model), strict=True)]
    peaks = [_peaks(one) for one in worst]
    found = np.sort(np.concatenate([one[peak] for one, peak in zip(worst, peaks, strict=True)]))
    limit = found[-_ADDED:].min(initial=np.inf)
    joined = [peak & (one >= max(limit, _SPARE)) for one, peak in zip(worst, peaks, strict=True)]
    if not any(np.any(one) for one in joined):
        return None
    return tuple(mask | one for mask, one in zip(masks, joined, strict=True))


def _poles(problem: MixedProblem) -> Complex:
    basis = problem.parametric
    poles = np.zeros(0, complex) if basis is None else np.asarray(basis.poles, dtype=complex)
    found = np.unique(poles.round(12))
    return found[(np.imag(found) > 0) & (np.abs(found) < 1)]


def _of_response(angles: Real, poles: Complex, share: int) -> Mask:
    used = np.zeros(angles.size, bool)
    if angles.size <= share:
        return ~used
    width = float(np.ptp(angles)) or 1.0
    t = (angles - angles.min()) / width
    for pole in poles:
        turn, half = float(np.angle(pole)), -float(np.log(np.abs(pole)))
        t = t + _MODE / share * (0.5 + np.arctan((angles - turn) / half) / np.pi)
    order = np.argsort(t, kind="stable")
    t = t[order]
    steps = np.asarray(np.linspace(t[0], t[-1], share), dtype=float)
    used[order[np.unique(np.searchsorted(t, steps))]] = True
    return used


def _ratios(problem: MixedProblem, model: StateSpace) -> list[Real]:
    """Largest |residual|/bound at every point of every response."""
    out = [np.zeros(f.omega.size) for f in problem.frequency]
    for residual in model_residuals(dataclasses.replace(problem, time=()), model):
        place = np.searchsorted(problem.frequency[residual.index].omega, residual.axis)
        np.maximum.at(out[residual.index], place, residual.ratio)
    return out


def _peaks(ratio: Real) -> Mask:
    """Points whose neighbours are smaller: a resonance that is missed gives one point a round, not ten."""
    padded = np.concatenate([[-np.inf], ratio, [-np.inf]])
    return (ratio >= padded[:-2]) & (ratio >= padded[2:])

"""The smallest gain bound at every decay rate: all of the curve, or where its slope may be smallest; and the rates to try."""

from __future__ import annotations

import dataclasses
import logging
from collections.abc import Callable, Iterator
from typing import NamedTuple, TypeVar

import numpy as np

from robustid.advice.kept_gains import KeptGains
from robustid.advice.smallest_gain import (
    CEILINGS,
    DIGITS,
    TAILS,
    Mask,
    gain_bounds,
    pressing,
    response_sizes,
    selected,
    smallest_gain,
    thinned,
)
from robustid.core import Budget, Interruptible, Real
from robustid.errors import InputError, SizeError
from robustid.identification import MixedProblem, Prior
from robustid.identification.formulation import formulate

_log = logging.getLogger("robustid")
T = TypeVar("T")

SAFETY = 2.0  # recommended gain bound over the smallest one
FEW = 40  # frequency points (over the root of the entries) that stand for more of them
_FEWEST = 10  # frequency points of a response that are left where not all can be computed with
_NEWTON_STEPS = 15  # whose time a decision and a model take: 6 to 17 were measured, most where the margin is near 1
_RATES = 9
_QUICK_MATRIX = 800  # coefficients times the root of the entries: beyond, every smallest gain takes minutes
_FORGETS = 5.0  # what the log of the free response must decay by over a record of unknown initial state
_PRESSING = 30  # points with the largest multipliers, which stand for all at another decay rate
_QUICK_WORK = 2e10  # multiplications of a Newton step with all points, up to which they decide the recommended gain
_ALMOST = 1.5  # times the smallest slope
_APART = 2.0  # times the distance of the points in rad, at least: how far the decay rate is above 1 by default


class GainCurve(NamedTuple):
    """The smallest gain at every decay rate, or what it is not below."""

    rates: Real
    gains: Real

    def priors(self, problem: MixedProblem) -> tuple[Prior | None, ...]:
        """The prior that would be recommended at each decay rate."""
        # A non-parametric part smaller than every bound can't be seen, hence not excluded either.
        floor = response_sizes(problem)[1]
        return tuple(
            dataclasses.replace(problem.prior.with_rate(float(rho)), gain_bound=SAFETY * max(float(gain), floor))
            if np.isfinite(gain)
            else None
            for rho, gain in zip(self.rates, self.gains, strict=True)
        )

    def slopes(self, problem: MixedProblem) -> Real:
        """Slope bound of each of the `priors`; inf where there is none."""
        return np.array([np.inf if one is None else one.slope for one in self.priors(problem)])

    def knee(self, problem: MixedProblem) -> int:
        """Number of the decay rate with the smallest slope, or almost the smallest, if its gain alone is not above every response.

        What a plant answers at once is in every gain, and may be its largest response: only at a slower rate it is no larger.
        """
        slopes, largest = self.slopes(problem), response_sizes(problem)[0]
        k = int(np.argmin(slopes))
        if not self.gains[k] > largest:
            return k
        small = np.flatnonzero((self.gains <= largest) & (slopes <= _ALMOST * slopes[k]))
        return int(small[np.argmin(slopes[small])]) if small.size else k


def smallest_gains(
    problem: MixedProblem, part: MixedProblem, rates: Real, before: GainCurve | None, budget: Budget, kept: KeptGains
) -> GainCurve:
    """The curve of a part of the data, or the first of it where the time is over; `before` is that of a part of the part."""
    # Beyond 8 times the largest response nothing is said between the points: not worth minutes where there are many.
    ceilings = CEILINGS if part is problem else CEILINGS[:1]

    def gain_at(rate: float) -> float:
        gain = kept.gain(lighter(problem, part, rate), rate, problem, ceilings, budget)
        _log.info("decay rate %.6g: smallest gain bound %.6g", rate, gain)
        return gain

    if before is not None:
        return _at_knee(problem, rates, gain_at, before, budget)
    gains = _every_gain(rates, gain_at, budget)
    return GainCurve(rates[: gains.size], gains)


def _every_gain(rates: Real, gain_at: Callable[[float], float], budget: Budget) -> Real:
    """The smallest gain at every decay rate, or the first ones where the time is over."""
    gains, done = np.full(rates.size, np.inf), 0
    with Interruptible(lambda: done > 0):
        for k, rate in enumerate(rates.tolist()):
            gains[k] = gain_at(rate)
            done = k + 1
            budget.tell(done, rates.size)
            if np.isinf(gains[k]):
                done = rates.size  # a larger rho makes the class smaller still
            if done == rates.size or budget.over:
                break
    return gains[:done]


def _at_knee(
    problem: MixedProblem, rates: Real, gain_at: Callable[[float], float], before: GainCurve, budget: Budget
) -> GainCurve:
    """The smallest gain where the slope is smallest, and what it is not below at the other decay rates.

    The gain rises with the decay rate and with the data, so that what one rate or fewer points ask for bounds the others from
    below: first at the knee of fewer points, then where that bound of the slope is smallest, until the smallest was computed.
    """
    gains, known = np.maximum.accumulate(_not_below(before, rates)), np.zeros(rates.size, bool)
    knee = before.rates[int(np.argmin(before.slopes(problem)))]
    k = int(np.argmin(np.abs(rates - knee)))
    with Interruptible():
        while not budget.over:
            gains[k], known[k] = gain_at(float(rates[k])), True
            gains[k + 1 :] = np.maximum(gains[k + 1 :], gains[k] * (1 - DIGITS))
            budget.tell(int(known.sum()), rates.size)
            slopes = GainCurve(rates, gains).slopes(problem)
            k = int(np.argmin(slopes))
            if known[k] or np.isinf(slopes[k]):
                break
    return GainCurve(rates, gains)


def gains_of_all(problem: MixedProblem, few: GainCurve, budget: Budget) -> GainCurve | None:
    """The curve of fewer points with the gain of all at its knee; None where the time is over before it is known.

    What fewer points ask for bounds the gains of all from below. Where the slope may be smallest the bound is raised, until it is
    smaller at another decay rate, or is the gain: first by the points that ask for the gain at another decay rate, then by all.
    """
    rates, gains, known = few.rates, few.gains.copy(), np.zeros(few.rates.size, bool)
    searches: dict[int, Iterator[tuple[float, float, Real]]] = {}
    masks: tuple[Mask, ...] | None = None
    tried: set[int] = set()
    while not budget.over:
        curve = GainCurve(rates, gains)
        k = curve.knee(problem)
        if known[k] or (prior := curve.priors(problem)[k]) is None:
            return curve
        if k not in searches:
            if formulate(dataclasses.replace(problem, prior=prior), accuracy=TAILS).work > _QUICK_WORK:
                return curve
            if masks is not None and k not in tried:
                tried.add(k)
                part = lighter(problem, selected(problem, masks), prior.rate)
                gain = 0.0 if part is problem else smallest_gain(part, prior.rate, problem, CEILINGS[:1], budget)
                gains[k] = max(gains[k], 0.0 if budget.over else gain * (1 - DIGITS))
                continue
            searches[k] = gain_bounds(problem, prior.rate, problem, CEILINGS[:1], budget)
        below, above, multipliers = next(searches[k])
        if below > 0 and multipliers.size:
            masks = pressing(problem, multipliers, _PRESSING)
        known[k] = below == above
        gains[k] = above if known[k] else max(gains[k], below)
        if np.isinf(below):
            gains[k:] = np.inf
    return None


def _not_below(before: GainCurve, rates: Real) -> Real:
    """Gains of fewer points at the same decay rates, less what they may be too large by; 0 where there were none."""
    gains = dict(zip(before.rates.tolist(), (before.gains * (1 - DIGITS)).tolist(), strict=True))
    return np.array([gains.get(rate, 0.0) for rate in rates.tolist()])


def lighter(problem: MixedProblem, part: MixedProblem, rho: float) -> MixedProblem:
    """All points where they cost no more than a part of them: a fast decay needs few coefficients for any number of points."""
    if part is problem:
        return problem
    trials = (one.with_prior(gain_bound=CEILINGS[0] * response_sizes(problem)[0], rate=rho) for one in (problem, part))
    try:
        whole, few = (formulate(one, accuracy=TAILS).work for one in trials)
    except SizeError:
        return part
    return problem if whole <= few else part


def possible_rates(problem: MixedProblem) -> Real:
    """The default decay rates, those left out at which many data, or matrices, need too many coefficients.

    Where all points need too many at every rate, those of as few points as can be computed with.
    """
    return _of_fewest(problem, lambda part: possible(part, default_rates(problem)))[1]


def possible(problem: MixedProblem, rates: Real) -> Real:
    """The decay rates, the slowest left out at which many data, or matrices, need too many coefficients."""
    refusal: SizeError | None = None
    largest = response_sizes(problem)[0] * CEILINGS[0]
    entries = float(np.sqrt(problem.entries.outputs * problem.entries.inputs))
    for first, rho in enumerate(rates):
        try:
            trial = problem.with_prior(gain_bound=largest, rate=float(rho))
            form = formulate(trial, accuracy=DIGITS)
        except SizeError as error:
            refusal = error
            continue
        slow = not form.exact and form.count * entries > _QUICK_MATRIX
        if not slow or entries == 1 or rho == rates[-1]:
            return rates[first:]
    raise refusal or InputError("`problem` has no decay rate to try")


def default_rates(problem: MixedProblem) -> Real:
    """Decay rates from the distance of the points, or the length of the records, to half the highest frequency point."""
    finest: list[float] = []
    widest: list[float] = []
    if not problem.dt:
        top = float(max(f.omega.max() for f in problem.frequency)) or 1.0
        high, finest = top / 2, [_APART * top / min(problem.angles.size, FEW)]
        return np.asarray(np.geomspace(np.clip(finest[0], high / 300, high / 8), high, _RATES), dtype=float)
    if problem.angles.size:
        finest.append(_APART * float(problem.angles[-1]) / min(problem.angles.size, FEW))
        widest.append(float(problem.angles[-1]) / 2)
    if problem.taylor:
        # From unknown initial states a class that hardly decays over the record holds any data, and says nothing of the plant.
        free = all(record.initial == "free" for record in problem.time)
        finest.append((_FORGETS if free else 1) / problem.taylor)
        widest.append(0.3)
    high = min(max(widest), 0.3)
    low = float(np.clip(min(finest), high / 300, high / 8))
    return 1 + np.asarray(np.geomspace(low, high, _RATES), dtype=float)


def slower_rates(problem: MixedProblem, slowest: float) -> Real:
    """Decay rates below the slowest default one, down to what the distance of all points allows, rising; none where there are few.

    The default ones are for as many points as stand for all.
    """
    if not problem.frequency:
        return np.zeros(0)
    top = float(problem.angles[-1]) if problem.dt else max(float(f.omega.max()) for f in problem.frequency)
    least = 1.0 if problem.dt else 0.0
    halvings = max(int(np.log2((slowest - least) * problem.angles.size / (_APART * top))), 0)
    rates = np.asarray(least + (slowest - least) * 0.5 ** np.arange(halvings, 0, -1), dtype=float)
    try:
        return possible(problem, rates) if halvings else rates
    except SizeError:
        return rates[:0]


def computable_step(
    problem: MixedProblem, *, form: str = "auto", accuracy: float = 1e-4, seconds: float | None = None
) -> int:
    """The least step between frequency points that leaves a problem that is not too large; 1 where it would leave too few.

    Points over decades in a class that decays slowly need a coefficient for every number that was measured. Of a matrix of which
    one step takes longer than `seconds`, so many are left as can be decided in them.
    """

    def posed(part: MixedProblem) -> None:
        formulation = formulate(part, form, accuracy)
        formulation.check_memory()
        if formulation.is_late(seconds, 1 if part is problem else _NEWTON_STEPS):
            raise SizeError("`problem` takes longer than there is time")

    try:
        return _of_fewest(problem, posed)[0]
    except SizeError:
        return 1


def _of_fewest(problem: MixedProblem, found: Callable[[MixedProblem], T]) -> tuple[int, T]:
    """The step between frequency points, 1 where a problem of all is not too large, and a finding about that problem."""
    most, step = min((frf.omega.size for frf in problem.frequency), default=0) // _FEWEST, 1
    while True:
        part = tuple(frf.select(slice(None, None, step)) for frf in problem.frequency)
        try:
            return step, found(problem if step == 1 else dataclasses.replace(problem, frequency=part))
        except SizeError:
            step += 1
            if step > most:
                raise


def representatives(problem: MixedProblem) -> tuple[Mask, ...] | None:
    """Masks of the frequency points that stand for all; None where there are few enough."""
    own = 0 if problem.parametric is None else problem.parametric.size // 2 + 1  # points that tell its functions apart
    few = max(int(FEW / np.sqrt(problem.entries.count)), own)
    return None if sum(f.omega.size for f in problem.frequency) <= 1.25 * few else thinned(problem, few)

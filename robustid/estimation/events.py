"""Events in a signal: samples that are off, and jumps of its level, by what they leave in the innovations."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from robustid.core import Real
from robustid.estimation.innovations import LAST, Predictor, Predictors, order_for
from robustid.estimation.periodic import without_drift
from robustid.estimation.stretch import thinned

_FALSE_ALARM = 1e-4  # in one signal
_BLOCK = 128  # samples over which the level of the innovations is taken
_NORMAL = 0.6745  # median of |x| of normal values, in standard deviations
_MOST = 0.01  # part of the samples that may be off
_ABRUPT = 6.0  # standard deviations by which the samples around a jump show it alone
_ROUNDS = 12
_TOGETHER = 0.6  # of the largest: found in one round
_CROWD = 4  # events so near to each other that the predictor spans them
_SUDDEN, _BEFORE = (
    2.5,
    200,
)  # times the largest that was new in an input in so many samples before: the end of a sweep, a step
_NEAR, _APART = 2, 4.0  # samples, and standard deviations at least, of an event in the difference of two periods
_SMALLEST = 0.01  # of the rms of the signal: a jump below it harms nothing


class Event(NamedTuple):
    """Sample that is off, or from which on the level is another; by how much, and how many standard deviations that is."""

    at: int
    jump: bool
    height: float
    deviations: float


class Examined(NamedTuple):
    """Events of a signal, the largest first; the signal without them; and its predictor then, None where it is too short."""

    events: tuple[Event, ...]
    signal: Real
    predictor: Predictor | None


def examined(y: Real, predictors: Predictors, u: Real, period: int | None) -> Examined:
    """Events of an output (T,): found, taken out, and looked for again with the better predictor.

    With `period`, of three periods or more, what is the same in all periods is taken out first.
    """
    if predictors.order == 0 or np.ptp(y) == 0:
        return Examined((), y, None)
    clean, found = y, dict[tuple[int, bool], tuple[float, float]]()
    predictor: Predictor | None = None
    for _ in range(_ROUNDS):
        left = clean if period is None else without_period(_level_over_periods(clean, period), period)
        predictor = predictors.of(left)
        new = largest_events(predictor.innovations(left, u), predictor, period)
        if period is not None:  # the mean over the periods took its part of a sample that is off
            share = 1 - period / y.size
            new = [one if one.jump else one._replace(height=one.height / share) for one in new]
        new = [one for one in new if not one.jump or abs(one.height) > _SMALLEST * y.std()]
        if not new:
            break
        clean = clean.copy()
        for one in new:
            clean[one.at : None if one.jump else one.at + 1] -= one.height
            height, deviations = found.get((one.at, one.jump), (0.0, 0.0))
            found[one.at, one.jump] = height + one.height, max(deviations, one.deviations)
        if len(found) > max(_MOST * y.size, 3):
            return Examined((), y, predictor)  # noise of another kind
    events = [Event(at, jump, height, deviations) for (at, jump), (height, deviations) in found.items()]
    events = _not_of_seams(events, period, predictors.order)
    at = np.array([event.at for event in events])
    if any(np.sum(np.abs(at - one) <= 2 * predictors.order) > _CROWD for one in at):
        return Examined((), y, predictor)  # a burst, which is no single sample
    return Examined(tuple(sorted(events, key=lambda one: -one.deviations)), clean, predictor)


def not_after_changes(events: tuple[Event, ...], u: Real, reach: int) -> tuple[Event, ...]:
    """Events without those that come with a sudden change of an input: the plant answers it, more than a predictor knows."""
    if not events:
        return events
    places: list[int] = []
    for one in u.T:
        if order_for(one.size, 0) < LAST or np.ptp(one) == 0:
            continue
        alone = np.zeros((one.size, 0))
        w = np.abs(Predictors(alone, LAST).of(one).innovations(one, alone))
        usual = np.lib.stride_tricks.sliding_window_view(np.concatenate([np.zeros(_BEFORE), w[:-LAST]]), _BEFORE).max(
            axis=1
        )
        sudden = w[LAST - 1 :] > _SUDDEN * usual[: w.size - LAST + 1]
        places += (np.flatnonzero(sudden[_BEFORE:]) + _BEFORE + 2 * LAST - 1).tolist()
    at = np.array(places)
    return tuple(one for one in events if not np.any((one.at >= at - reach // 2) & (one.at <= at + reach)))


def not_repeated(events: tuple[Event, ...], y: Real, period: int) -> tuple[Event, ...]:
    """Events without those that a record of two periods shows in both: the plant answers the input so, which repeats.

    What is left in the difference of the periods, at the place of an event or a period before, is of one of them alone.
    """
    rest = y.size - period
    if not events or order_for(rest, 0) == 0:
        return events
    difference, alone = y[period:] - y[:rest], np.zeros((rest, 0))
    if np.ptp(difference) == 0:
        return ()
    predictor = Predictors(alone).of(difference)
    w, n = predictor.innovations(difference, alone), predictor.a.size - 1
    noise = _level(w, 1e-3 * predictor.noise)
    heights, weights = _matched(w, predictor.a)
    sizes = {False: np.abs(heights) * np.sqrt(weights) / noise, True: _jumps(w, np.cumsum(predictor.a), noise)[1]}

    def of_one(event: Event) -> bool:
        places = [at for at in (event.at - n, event.at - n - period) if 0 <= at < w.size]
        return not places or any(sizes[event.jump][max(at - _NEAR, 0) : at + _NEAR + 1].max() > _APART for at in places)

    return tuple(filter(of_one, events))


def _not_of_seams(events: list[Event], period: int | None, reach: int) -> list[Event]:
    """Events without those where the mean over the periods begins anew, if these are most: what drifts is no event."""
    if period is None:
        return events
    away = [one for one in events if abs((one.at + period // 2) % period - period // 2) > reach]
    return events if len(events) - len(away) < max(2, len(events) / 2) else away


def _level_over_periods(signal: Real, period: int) -> Real:
    """Signal without what drifts from period to period; samples beyond whole periods keep the level of the last."""
    whole = signal.size // period * period
    level = without_drift(signal[None, :whole, None], period)[0][0, :, 0]
    return np.concatenate([level, signal[whole:] - signal[whole - 1] + level[-1]])


def without_period(signal: Real, period: int) -> Real:
    """Signal less its mean over the periods."""
    whole = signal.size // period * period
    mean = signal[:whole].reshape(-1, period).mean(axis=0)
    return signal - mean[np.arange(signal.size) % period]


def largest_events(w: Real, predictor: Predictor, period: int | None) -> list[Event]:
    """Events of innovations ``w = a(q) y`` that are the largest, or close to it.

    One sample that is off by h adds ``h a[k]`` to w from there on; a jump adds the running sum of that. Least squares of h at every
    sample, in its standard deviations; tails of these are at most exponential, as their quantiles at 90 and 97 % show.
    """
    a, n = predictor.a, predictor.a.size - 1
    noise = _level(w, 1e-3 * predictor.noise)
    heights, weights = _matched(w, a)
    tau = np.abs(heights) * np.sqrt(weights) / noise
    limit = _limit(tau)
    jumps, sure = _jumps(w, np.cumsum(a), noise)
    if period is not None:
        # What no repetition explains, a drift or a transient, begins anew where the mean over the periods does.
        near = np.abs((np.arange(w.size) + n + period // 2) % period - period // 2)
        sure[near <= n] = 0.0
    most = max(float(tau.max()), float(sure.max()))
    if most <= limit:
        return []
    if sure.max() >= tau.max():
        at = int(np.argmax(sure))
        return [Event(at + n, True, float(jumps[at]), float(sure[at]))]
    return [
        Event(at + n, False, float(heights[at]), float(tau[at])) for at in _peaks(tau, max(limit, _TOGETHER * most), n)
    ]


def _peaks(size: Real, least: float, apart: int) -> list[int]:
    """Largest values above `least`, so many samples from each other."""
    kept: list[int] = []
    above = np.flatnonzero(size > least)
    for at in above[np.argsort(-size[above])]:
        if all(abs(at - other) > apart for other in kept):
            kept.append(int(at))
    return kept


def _level(w: Real, floor: float) -> Real:
    """Standard deviation of every innovation: that of all, or that of the samples around it where it is larger."""
    everywhere = max(float(np.median(np.abs(w))) / _NORMAL, floor)
    blocks = max(w.size // _BLOCK, 1)
    length = w.size // blocks
    own = np.median(np.abs(w[: blocks * length]).reshape(blocks, length), axis=1) / _NORMAL
    padded = np.concatenate([own[:1], own, own[-1:]])
    around = np.maximum(np.maximum(padded[:-2], padded[2:]), own)
    return np.maximum(around[np.minimum(np.arange(w.size) // length, blocks - 1)], everywhere)


def _limit(tau: Real) -> float:
    """Value that exponential tails with the quantiles of `tau` pass in one signal of 10 000, and normal ones at least."""
    lower, upper = np.quantile(thinned(tau), (0.9, 0.97))
    normal = math.sqrt(2 * math.log(tau.size / _FALSE_ALARM))
    tails = float(upper + (upper - lower) / math.log(0.1 / 0.03) * math.log(0.03 * tau.size / _FALSE_ALARM))
    return max(tails, normal)


def _matched(w: Real, pattern: Real) -> tuple[Real, Real]:
    """Least-squares height of a pattern that begins at every sample, and the weight that it is known with."""
    padded = np.concatenate([w, np.zeros(pattern.size - 1)])
    length = np.minimum(w.size - np.arange(w.size), pattern.size)
    weights = np.cumsum(pattern**2)[length - 1]
    return np.correlate(padded, pattern, mode="valid") / weights, weights


def _jumps(w: Real, sums: Real, noise: Real) -> tuple[Real, Real]:
    """Least-squares height of a jump at every sample, and its standard deviations; 0 where nothing abrupt shows it.

    The constant of the predictor takes the mean of w; so the pattern, `sums` and then its last value for ever, less its own.
    """
    count, total = sums.size, w.size
    if total < 4 * count:
        return np.zeros(total), np.zeros(total)
    near = np.correlate(np.concatenate([w, np.zeros(count - 1)]), sums, mode="valid")
    # A drift is no jump: the samples right after it have to show it against those right before.
    past = np.concatenate([np.zeros(count), np.cumsum(w)])
    before = (past[count - 1 : -1] - np.concatenate([np.zeros(count), past[count:-1]])[:total]) / count
    own, all_own = float(np.cumsum(sums)[-1]), float(np.cumsum(sums**2)[-1])
    height, sure = np.zeros(total), np.zeros(total)
    inside = slice(count, total - count)
    abrupt = (near - own * before)[inside] / (np.sqrt(all_own + own**2 / count) * noise[inside])
    at = np.flatnonzero(np.abs(abrupt) > _ABRUPT)
    if at.size == 0:
        return height, sure
    abrupt, at = abrupt[at], at + count
    rest = total - at - count
    tails = np.cumsum(w[::-1])[::-1][at + count]
    area, power = own + sums[-1] * rest, all_own + sums[-1] ** 2 * rest
    weight = np.maximum(power - area**2 / total, 1e-12 * power)
    height[at] = (near[at] + sums[-1] * tails - area * w.mean()) / weight
    sure[at] = np.where(abrupt * height[at] > 0, np.abs(height[at]) * np.sqrt(weight) / noise[at], 0.0)
    return height, sure

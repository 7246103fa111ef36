"""Real poles of plants with few modes or none: over the decades of a response in continuous time, or slow ones of a process."""

from __future__ import annotations

import dataclasses
import logging
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from robustid.advice.pole_fit import DAMPING
from robustid.core import Budget, Complex, Real, counted
from robustid.data import FrequencyResponse
from robustid.estimation import PoleFit, most_delay

_log = logging.getLogger("robustid")

_FEWER = 0.25  # of the sum of squares that poles over decades must leave to take the place of modes
_FAST = 0.7  # decay of a real pole per sample that the gain bound holds as well
HEAVY = 0.5  # damping ratio from which a pair is taken as real poles are
_FREE = (1, 2)  # integrators
_MANY = 400  # frequency points
_BELOW = 0.5  # of the lowest frequency point: a pole there may be one of a machine that is free to move
_SLOWEST = 0.1  # part of the lowest frequency point: a slower pole is a drift, or a machine that is free to move
_POINTS_A_POLE, _MOST_POLES, _ORDERS = 3, 24, 2  # over decades: at least, at most, and from one order to the next
# Parts of the sum of squares, at the start or of what is left, that two further poles must remove.
_WORTH, _WORTH_LEFT = 1e-4, 0.75


class RealPoles(NamedTuple):
    """Natural frequencies in rad/s and damping ratios (1 of a real pole), and what they leave, in units of the bounds."""

    omega: Real
    damping: Real
    left: float  # sum of squares
    largest: float
    whole: float = np.inf  # sum of squares without poles
    delay: int = 0  # samples
    standing: int = 0  # poles beside them that are as slow as those of a machine that is free to move
    beside: bool = False  # True where these poles are there beside integrators alone
    light: tuple[
        tuple[float, float], ...
    ] = ()  # natural frequencies and damping ratios of the lighter pairs beside them

    @property
    def order(self) -> int:
        """Poles, both of every pair."""
        return self.omega.size + int(np.sum(self.damping < 1))

    @property
    def words(self) -> str:
        """Say how many there are of each kind: "1 heavily damped pair and 2 real poles"."""
        pairs = int(np.sum(self.damping < 1))
        counts = (pairs, "heavily damped pair"), (self.omega.size - pairs, "real pole")
        return " and ".join(counted(count, noun) for count, noun in counts if count)


def explain_more(found: RealPoles, left: Real, pairs: int) -> bool:
    """Return whether poles over decades explain most of what pairs leave; or all of it, by fewer, mostly real."""
    simpler = (
        found.largest <= 1 and found.omega.size < 2 * pairs and 2 * int(np.sum(found.damping == 1)) > found.omega.size
    )
    return bool(found.left < _FEWER * (left @ left) or simpler)


def over_decades(frf: FrequencyResponse, budget: Budget) -> RealPoles | None:
    """Poles of partial fractions that keep a continuous response inside its bounds, or of the order beyond which little is won.

    None for less than two decades, or without a real pole among them. A battery, a cable, a viscoelastic mount has no few poles:
    real ones over the decades follow it all the same, and their places are a choice. Of the orders that the time suffices for.
    """
    fit = PoleFit(frf, feedthrough=True)
    if frf.dt or frf.omega.size < 2 * _POINTS_A_POLE or not fit.wide:
        return None
    best = _fractions(frf, fit, _ORDERS, budget)
    return best if np.any(best.damping == 1) else None


def slow_poles(frf: FrequencyResponse, budget: Budget, delay: int | None = None) -> RealPoles | None:
    """Real poles and heavily damped pairs of partial fractions that keep a response inside its bounds, those that decay slowly.

    Behind the delay with which the fewest do, or leave least: poles that stand for a dead time follow it on the frequency points,
    and a class around them is too small for the plant. By rising frequency; none of too few points, without such a pole, or where
    the time ends before the search. Where modes are in doubt (`FrequencyResponse.doubt`) those of the response that asks for
    more, with these or without: around fewer a class is too small for a plant that the bounds hold.
    """
    if (size := frf.omega.size) < 2 * _POINTS_A_POLE:
        return None
    if size > _MANY:  # as many stand for all, the lowest of them too
        few = np.concatenate([np.linspace(0, size - 1, _MANY // 2), np.geomspace(1, size, _MANY // 2) - 1])
        frf = frf.select(np.unique(few.astype(int)))
    found = _slow(frf, budget, delay)
    if frf.doubt is None:
        return found
    other = _slow(dataclasses.replace(frf, values=frf.values + frf.doubt, doubt=None), budget, delay)
    fewer = found is None or (other is not None and other.omega.size > found.omega.size)
    return other if fewer else found


def _slow(frf: FrequencyResponse, budget: Budget, delay: int | None) -> RealPoles | None:
    step = frf.dt or np.pi / float(frf.omega.max())
    delays = range(most_delay(frf, frf.dt) + 1) if frf.dt and delay is None else (delay or 0,)
    found = [_behind(frf, step, budget, one) for one in delays]
    if budget.over:  # another delay, or more poles, might be right
        return None
    best, lowest = min(found, key=_fewest), float(frf.omega[frf.omega > 0].min())
    if np.any(best.omega <= _BELOW * lowest):
        # Without integrators, which free machines have, a slower pole beside them is that of their friction.
        free = [_behind(frf, step, budget, best.delay, count) for count in _FREE]
        as_well = [one for one in free if one.largest <= 1 or (best.largest > 1 and one.left <= _WORTH * one.whole)]
        best = best if budget.over else min((best, *as_well), key=_fewest_free)
    slowest = (_SLOWEST**2 if best.standing else _SLOWEST) * lowest
    heavy, moves = best.damping > HEAVY, best.omega > slowest
    slow = heavy & moves & (best.omega * step < _FAST)
    if not slow.any():
        return None
    order = np.argsort(best.omega[slow])
    standing = best.standing + int(np.sum(np.where(best.damping < 1, 2, 1)[heavy & ~moves]))
    light = tuple(zip(best.omega[~heavy].tolist(), best.damping[~heavy].tolist(), strict=True))
    return best._replace(
        omega=best.omega[slow][order],
        damping=best.damping[slow][order],
        standing=standing,
        beside=standing > 0 and (best.largest <= 1 or best.standing > 0),
        light=light,
    )


def _fewest(one: RealPoles) -> tuple[bool, int, float]:
    """Order among poles: those that keep all bounds by their number, others by what they leave."""
    return one.largest > 1, one.order + one.standing if one.largest <= 1 else 0, one.left


def _fewest_free(one: RealPoles) -> tuple[int, bool, float]:
    """Order among poles, of which as few with integrators go first: far below the points nothing tells them from a slow pair."""
    return one.order + one.standing, one.standing == 0, one.left


def _behind(frf: FrequencyResponse, dt: float, budget: Budget, delay: int, integrators: int = 0) -> RealPoles:
    """The poles behind a delay, and behind integrators, which are taken as they are."""
    lift = ((1j * frf.omega if frf.dt is None else np.expm1(1j * dt * frf.omega)) ** integrators)[:, None, None]
    turned = frf.values * np.exp(1j * delay * dt * frf.omega)[:, None, None] * lift
    ahead = dataclasses.replace(frf, values=turned) if delay or integrators else frf
    found = _fractions(ahead, PoleFit(ahead, feedthrough=True), 1, budget, np.abs(lift))
    return found._replace(delay=delay, standing=integrators)


def _fractions(frf: FrequencyResponse, fit: PoleFit, step: int, budget: Budget, lift: Real | float = 1.0) -> RealPoles:
    """Partial fractions of the order, a multiple of the step, that keeps all inside its bounds, or beyond which little is won.

    `lift`: factor on the bounds of values that were multiplied.
    """
    size = np.abs(np.where(frf.missing, 0, frf.values))
    radius = 0.05 * np.maximum(size, 1e-6 * size.max(axis=0)) if frf.bound is None else frf.bound.outer_radius * lift
    fit.weight = 1 / np.where(frf.missing | (radius == 0), np.inf, radius).swapaxes(1, 2).reshape(frf.omega.size, -1)
    fit.values = np.where(fit.weight > 0, fit.values, 0)
    best = _left(fit, np.zeros(0, complex))
    whole, idle = best.left, 0
    for order in range(step, min(_MOST_POLES, frf.omega.size // _POINTS_A_POLE) + 1, step):
        if best.largest <= 1 or budget.over:
            break
        _, (poles,) = fit.search(order, np.zeros(1))
        found = _left(fit, poles := poles[~_needles(fit, poles)])
        if frf.dt is None and found.largest > 1:
            found = _descended(fit, poles, found)
        gain = best.left - found.left
        _log.debug("%d poles: largest |residual|/bound %.3g", order, found.largest)
        if gain > 0 and (gain >= _WORTH * whole or gain >= _WORTH_LEFT * best.left):
            best, idle = found, 0
        elif (idle := idle + 1) > 1:  # one alone may win nothing where two follow the response, those of a pair
            break
    return best._replace(whole=whole)


def _needles(fit: PoleFit, poles: Complex) -> NDArray[np.bool_]:
    """True of pairs as light as no mode of a class: they stand on a point and explain it alone, whatever it is."""
    s = _exponents(fit, poles)
    return (np.imag(poles) != 0) & (-s.real < DAMPING[0] * np.abs(s))


def _exponents(fit: PoleFit, poles: Complex) -> Complex:
    return np.asarray(poles * fit.omega[-1] if fit.dt is None else np.log(poles + 0j) / fit.dt, dtype=complex)


def _descended(fit: PoleFit, poles: Complex, before: RealPoles) -> RealPoles:
    """The poles after a descent from there, where it leaves less: what rises like s has its pole far beyond the points."""
    refined = fit.refine(0.0, poles, held=True).poles
    found = _left(fit, refined[~_needles(fit, refined)])
    return found if found.left < before.left and np.all(found.damping > 0) else before


def _left(fit: PoleFit, poles: Complex) -> RealPoles:
    left = np.abs(fit.residuals(poles))
    s = _exponents(fit, poles)
    return RealPoles(
        np.abs(s), np.where(np.imag(poles) == 0, 1.0, -s.real / np.abs(s)), float(np.sum(left**2)), float(left.max())
    )

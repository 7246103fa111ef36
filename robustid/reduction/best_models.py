"""The best model found of each order: refined from several starts, judged anew, held near the identified one between samples."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Iterable, Iterator
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from robustid.core import Budget, Real, pass_on
from robustid.data import FrequencyResponse
from robustid.errors import InputError
from robustid.fitting import FitStatus, Weight, fit_mfd
from robustid.identification import Identification, MixedProblem, largest_ratio
from robustid.reduction import pole_starts
from robustid.reduction.balanced import balanced_truncations
from robustid.reduction.between_points import Guard
from robustid.reduction.sample_fits import (
    Fit,
    Pair,
    apart,
    descended,
    inside,
    least_squares,
    levelled,
    pole_functions,
    with_poles,
)
from robustid.reduction.sample_map import SampleMap, sample_map, with_lines

if TYPE_CHECKING:
    import control

_log = logging.getLogger("robustid")

REFINED = 40  # poles that are refined; beyond, only the numerators of truncated models are
_QUICK, _ALL, _KEPT = 6, 40, 3  # steps of the first look at every start and to the end; starts that are followed to it
_NEAR = 1.5  # times the limit: where further starts are followed too
_EXCHANGES = 6  # times that points where nothing was measured are added at one order
_STEPS, _FEW = 40, 4  # convex steps of the minimax search; where least squares leave no hope
_ALIKE = 1e-3  # relative difference of least squares that are the same, size and largest residual
_FROM_ABOVE = 4  # orders above from which a model is truncated as a start
_CLOSER = 100  # times nearer the circle than any pole of the identified model: what a pole may be
_WITHIN = 1 - 4 * np.finfo(float).eps  # at most: functions of a pole on the circle or beyond have no norm
_ROUNDING = 1e-5  # of the margin of inconsistent data, which the identified model keeps to so much


class Found(NamedTuple):
    """The best model of an order."""

    judged: float  # the larger of its margin and of the distance where nothing was measured
    margin: float
    model: control.StateSpace


class BestModels:
    """The best model `found` of each order that was tried, and how near to the bounds it comes; `fits` are the same in the
    coordinates of the samples. A model must keep to `limit`: 1, or of inconsistent data, once `widen` was called, their margin.
    `chains` are the states of the integrators, `radius` is the largest modulus of a pole, `truncated` makes the balanced truncation
    of an order of the identified model.
    """

    def __init__(self, identification: Identification, integrators: int, budget: Budget | None = None):
        self.identification, self._budget = identification, Budget() if budget is None else budget
        self.samples: SampleMap = sample_map(identification.problem, integrators)
        self.chains = integrators * self.samples.heads
        self._guard = Guard(identification, integrators, max(1.0, identification.margin))
        self._holding = False
        self.truncated = balanced_truncations(identification.model)
        self._families = pole_starts.truncations(identification, self.samples, self.truncated)
        basis = identification.problem.parametric
        self._held = pole_starts.without_integrators(basis.poles if basis else np.zeros(0, complex), integrators)
        poles = pole_starts.without_integrators(identification.model.poles(), self.chains)
        self.radius = min(1 - (1 - float(np.abs(poles).max(initial=0.0))) / _CLOSER, _WITHIN)
        self.limit = 1.0
        self.fits: dict[int, Fit] = {}
        self.found: dict[int, Found] = {}
        self._target = self._rich()
        self._ends: dict[
            int, list[Real]
        ] = {}  # by number of poles, the least squares that were followed: size, largest residual
        integrals = pole_starts.integrals(self.samples, self._target)
        self._responses = ResponseFits(identification.problem, integrals) if self.samples.heads > 1 else None

    def within(self, order: int) -> bool:
        """Tell whether a model of this order is known that keeps the limit."""
        return order in self.found and self.found[order].judged <= self.limit

    def widen(self) -> None:
        """From now on within the bounds times the margin of the data."""
        self._ends = {}
        self.limit = self.identification.margin * (1 + _ROUNDING)
        self._guard = Guard(self.identification, self.samples.integrators)  # the limit is as wide now
        # What missed the narrower one wasn't compared with the identified model.
        self.found = {k: f for k, f in self.found.items() if f.margin > self.limit or self._stays(f.model)}

    def search(self, order: int) -> None:
        """Refine from every start; of a matrix from a fit of the responses first, and from others where that comes near."""
        n = order - self.chains
        if self._responses is not None and n <= REFINED:
            self._try(order, [self._fitted(n)])
            hopeless = self._responses.alone and order in self.found and self.found[order].margin > _NEAR * self.limit
            if self.within(order) or hopeless:
                return
        self._try(order, self._starts(n))

    def shorten(self, order: int) -> None:
        """Refine what truncation leaves of the model of the order above."""
        self._try(order, [pole_starts.truncated(self.samples, self.fits[order + 1], order - self.chains)])

    def refine(self, pair: Pair) -> None:
        """Refine these functions alone, with no poles held."""
        self._held = np.zeros(0, complex)
        self._try(pair.A.shape[0] + self.chains, [pair])

    def truncate(self, order: int) -> bool:
        """Tell whether a balanced truncation of an order keeps the limit: with the numerators of least squares, or as it is."""
        for model in self._truncated(order):
            margin = largest_ratio(self.identification.problem, model)
            if margin <= self.limit and self._stays(model):
                self.found[order] = Found(margin, margin, model)
                return True
        return False

    def _truncated(self, order: int) -> Iterator[control.StateSpace]:
        """Truncations to start from; of a matrix also the model's own: with as many states least squares follow every error."""
        pair = self._families[0](order - self.chains)
        fit = None if pair is None else _quiet(lambda: least_squares(self.samples, inside(pair, self.radius)))
        if fit is not None:
            yield pole_starts.statespace(self.samples, fit, self.identification.model)
        if self.samples.heads > 1 and not self.chains:
            yield self.truncated(order).model

    def _stays(self, model: control.StateSpace) -> bool:
        """Tell whether a model stays near the identified one."""
        return self._guard.check(model, self.limit)[1] is None

    def _try(self, order: int, pairs: Iterable[Pair | None]) -> None:
        """Refine these starts; the best model of the order is kept, judged anew at every sample. Where it leaves the identified
        model too far between or beyond them, points are added there, for all orders to come, and it is refined again.
        """
        n = order - self.chains
        fit = self._refined(n, pairs)
        for _ in range(_EXCHANGES):
            if fit is None:
                return
            model = pole_starts.statespace(self.samples, fit, self.identification.model)
            margin = largest_ratio(self.identification.problem, model)
            between, missed = self._guard.check(model, self.limit) if margin <= self.limit else (0.0, None)
            judged = max(margin, between)
            if order not in self.found or judged < self.found[order].judged:
                self.found[order] = Found(judged, margin, model)
                self.fits[order] = fit
            _log.info("order %d: margin %.4g", order, self.found[order].judged)
            if missed is None:
                return
            self._hold(missed)
            fit = self._best([fit.pair], n)

    def _hold(self, lines: FrequencyResponse) -> None:
        """Further frequency points with the identified model as data; with the first of them some everywhere."""
        problem = self.identification.problem
        if not self._holding:
            self._holding, self.samples = True, with_lines(self.samples, self._guard.spread, problem)
        self.samples = with_lines(self.samples, lines, problem)
        self._target, self._ends = self._rich(), {}

    def _refined(self, n: int, pairs: Iterable[Pair | None]) -> Fit | None:
        fit = self._parametric_kept(n)
        if fit is not None and fit.worst <= self.limit:
            return fit
        return self._best(pairs, n)

    def _parametric_kept(self, n: int) -> Fit | None:
        """The best fit with the poles of the parametric part, a short non-parametric part refined, the numerators minimax."""
        held, best = self._held, None
        if not held.size or not held.size <= n <= REFINED:
            return None
        for pair in self._with_held(n):
            if pair is not None and pair.A.shape[0] == n:  # a family may have more functions than were asked for
                fit = _quiet(lambda p=pair: self._rest_refined(p))
                best = fit if best is None or (fit is not None and fit.worst < best.worst) else best
        return best

    def _with_held(self, n: int) -> Iterator[Pair | None]:
        """Functions with the poles of the parametric part, the others inside; with several heads those poles alone."""
        rest = n - self._held.size
        if self.samples.heads > 1:
            yield self._families[1](n) if not rest else None
            return
        spread = pole_functions(np.append(self._held, pole_starts.spread(self.samples, rest)))
        for pair in (*(family(n) for family in self._families[1:]), spread):
            if pair is not None:
                moving = inside(pole_functions(apart(pair.poles, self._held)), self.radius)
                yield pole_functions(np.concatenate([self._held, moving.poles]))

    def _rest_refined(self, pair: Pair) -> Fit:
        samples, radius, held = self.samples, self.radius, self._held
        fit = descended(least_squares(samples, pair), radius, held=held, budget=self._budget)
        steps = _STEPS if fit.cost <= self.limit else 0
        return levelled(fit, radius, self.limit, steps, held, self._budget)

    def _rich(self) -> Fit:
        """A model of many states in the coordinates of the samples, which stands for the data."""
        most = min(pole_starts.RICH, self.identification.order - self.chains)
        pair = next(p for n in range(most, -1, -1) if (p := self._families[0](n)) is not None)
        return least_squares(self.samples, inside(pair, self.radius))

    def _fitted(self, n: int) -> Pair | None:
        """The functions of a matrix fraction fitted to the responses."""
        responses = self._responses
        model = None if responses is None else responses.model(n, self._budget)
        return None if model is None else pole_starts.of_model(model.A, model.B, model.C, self.samples)

    def _starts(self, n: int) -> Iterator[Pair | None]:
        """Functions to start from, n of them."""
        samples = self.samples
        yield from (family(n) for family in self._families)
        if n > REFINED:
            return
        yield pole_starts.from_lines(self.identification, samples, n)
        yield _usable(lambda: pole_starts.sanathanan_koerner(samples, self._target, n))
        for step in (1, 2):
            below = self.fits.get(n + self.chains - step)
            if below is not None:
                yield from pole_starts.grown(samples, below, n)
        for step in range(1, _FROM_ABOVE + 1) if samples.heads > 1 else ():
            above = self.fits.get(n + self.chains + step)
            if above is not None:
                yield _usable(lambda f=above: pole_starts.truncated(samples, f, n))

    def _best(self, pairs: Iterable[Pair | None], n: int) -> Fit | None:
        """The best fit from these starts: all are looked at, the best followed; where it comes near the limit, the others too."""
        samples, radius = self.samples, self.radius
        usable = [
            inside(with_poles(p, pole_starts.reflected), radius) for p in pairs if p is not None and p.A.shape[0] == n
        ]
        fits = [_quiet(lambda p=p: least_squares(samples, p)) for p in usable]
        if n <= REFINED:
            fits = [self._descended(f, _QUICK) for f in fits if f is not None]
        ranked = sorted((fit for fit in fits if fit is not None), key=self._promise)
        best = None
        for group in (ranked[:_KEPT], ranked[_KEPT:]):
            for found in self._followed(group, n):
                best = found if best is None or found.worst < best.worst else best
            if best is None or not self.limit < best.worst < _NEAR * self.limit:
                break
        return best

    def _promise(self, fit: Fit) -> tuple[bool, float]:
        """Sort key: the smallest squares first; of a matrix, where they leave hope, the smallest largest residual."""
        if self.samples.heads == 1:
            return False, fit.cost
        hopeless = fit.cost > self.limit
        return hopeless, fit.cost if hopeless else fit.worst

    def _known(self, fit: Fit) -> bool:
        """Tell whether these least squares of a matrix were followed before; from now on they are known."""
        if self.samples.heads == 1:
            return False
        here = np.array([fit.cost, fit.worst])
        known = self._ends.setdefault(fit.pair.A.shape[0], [])
        if any(np.allclose(here, other, rtol=_ALIKE, atol=0) for other in known):
            return True
        known.append(here)
        return False

    def _descended(self, fit: Fit, steps: int) -> Fit | None:
        """The fit at its least squares, or so many steps nearer."""
        return _quiet(lambda: descended(fit, self.radius, steps, budget=self._budget))

    def _followed(self, fits: list[Fit], n: int) -> Iterator[Fit]:
        """These fits at their least squares, then minimax, the first that is within the limit last."""
        radius = self.radius
        if n <= REFINED:
            ends = [self._descended(f, _ALL) for f in fits]
            fits = sorted((fit for fit in ends if fit is not None), key=self._promise)
        for fit in fits:
            if self._known(fit):
                continue
            # No model with the largest ratio s has a root mean square above s: no hope near this one.
            hopeful = fit.cost <= self.limit and n <= REFINED
            steps = _STEPS if hopeful else _FEW * (n <= REFINED)
            found = _quiet(lambda f=fit, s=steps: levelled(f, radius, self.limit, s, budget=self._budget))
            if found is not None:
                yield found
            if not hopeful or (found is not None and found.worst <= self.limit):
                return


def _usable(attempt: Callable[[], Pair]) -> Pair | None:
    """The functions, None where numbers overflow on the way or a factorisation fails: the other starts remain."""
    try:
        with np.errstate(all="ignore"):
            pair = attempt()
    except (np.linalg.LinAlgError, ValueError):
        return None
    return pair if np.isfinite(pair.A).all() and np.isfinite(pair.C).all() else None


def _quiet(attempt: Callable[[], Fit]) -> Fit | None:
    """The fit, None where numbers overflow on the way or a factorisation fails: that start leads nowhere."""
    try:
        with np.errstate(all="ignore"):
            fit = attempt()
    except (np.linalg.LinAlgError, ValueError):
        return None
    return fit if np.isfinite(fit.cost) else None


class ResponseFits:
    """Fits of a problem's responses, all points of all experiments, each weighted by the inverse of its bound; integrators, of
    coefficients (count, ny, nu) of 1/(z - 1), 1/(z - 1)^2, ..., are taken out first. No model with the largest ratio s has a
    weighted rms above s: a fit that misses the bounds by much leaves no hope for its order, as far as it is the best one.
    """

    def __init__(self, problem: MixedProblem, integrals: Real):
        self._responses = [f for f in problem.frequency if isinstance(f, FrequencyResponse)]
        self._dt, self._integrals = problem.dt, integrals
        self.alone = not problem.time and len(self._responses) == len(problem.frequency)
        self._stated = self._statement() if self._responses else None

    def _statement(self) -> tuple[FrequencyResponse, Weight]:
        """All points in the order of frequency, those that several experiments have once; missing entries have no weight."""
        omega, first = np.unique(np.concatenate([f.omega for f in self._responses]), return_index=True)
        used = np.concatenate([np.isfinite(f.bound.radius) for f in self._responses])[first]
        values = np.where(used, np.concatenate([f.values for f in self._responses])[first], 0.0)
        step = np.exp(1j * omega * self._dt) - 1
        for power, gains in enumerate(self._integrals, 1):
            values = values - used * gains / step[:, None, None] ** power
        frf = FrequencyResponse(omega, values, dt=self._dt)
        if all(f.bound.ellipsoid is not None for f in self._responses):
            white = np.concatenate([f.bound.whitening for f in self._responses])[first]
            return frf, Weight(np.ones(values.shape), matrix=white)
        radius = np.concatenate([f.bound.outer_radius for f in self._responses])[first]
        return frf, Weight(np.where(used, 1 / np.where(used, radius, 1.0), 0.0))

    def model(self, order: int, budget: Budget) -> control.StateSpace | None:
        """The stable fit of an order; None where there is none: no response, too few points, no time."""
        if self._stated is None or order < 1 or budget.over:
            return None
        frf, weight = self._stated
        limit = None if math.isinf(budget.left) else max(budget.left, 1e-3)
        try:
            fit = fit_mfd(frf, order=order, weight=weight, domain="z", feedthrough=True, time_limit=limit)
        except (InputError, np.linalg.LinAlgError):
            return None
        pass_on(fit.status is FitStatus.INTERRUPTED)
        return fit.model if fit.model.nstates == order and fit.stable else None

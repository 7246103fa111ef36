"""The smallest model that keeps every sample within its bound."""

from __future__ import annotations

import dataclasses
import enum
import logging
from collections.abc import Callable, Iterable, Iterator
from typing import Any, NamedTuple

import numpy as np

from robustid.core import Budget, Progress, as_kind, one_thread
from robustid.data import FrequencyResponse
from robustid.errors import InputError
from robustid.identification import Identification, largest_ratio
from robustid.mfd import RigidBody
from robustid.reduction import starts
from robustid.reduction.balanced import Reduction, balanced_truncations
from robustid.reduction.guard import Guard
from robustid.reduction.refinement import (
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

_log = logging.getLogger("robustid")

_ONE_BY_ONE = 12  # orders tried without a gap; further on every seventh or so, then those between
_REFINED = 40  # poles that are refined; beyond, only the numerators of truncated models are
_QUICK, _ALL, _KEPT = 6, 40, 3  # steps of the first look at every start and to the end; starts that are followed to it
_NEAR = 1.5  # times the limit: where further starts are followed too
_EXCHANGES = 6  # times that points where nothing was measured are added at one order
_STEPS, _FEW = 40, 4  # convex steps of the minimax search; where least squares leave no hope
_AT_ONE = 1e-7  # a pole of the parametric part so near z = 1 is an integrator
_CLOSER = 100  # times nearer the circle than any pole of the identified model: what a pole may be
_ROUNDING = 1e-5  # of the margin of inconsistent data, which the identified model keeps to so much


class SearchStatus(enum.Enum):
    """Status of a search; the value is the user's sentence."""

    WITHIN = (
        "every sample stays within its bound, and where nothing was measured the model stays near the identified one"
    )
    OUTSIDE = "every sample stays within its bound, but the data contradict the class: the model is none of it"
    INFLATED = "every sample stays within its bound times the margin of the data, which contradict the class"
    UNREDUCED = "no smaller model that keeps every sample within its bound was found; the model is the one identified"


@one_thread()
def reduce_within_bounds(
    identification: Identification,
    *,
    rigid_body: RigidBody | None = None,
    time_limit: float | None = None,
    progress: Progress | None = None,
) -> Reduction:
    r"""The smallest order r for which a stable model with every \|residual\| within its bound was found.

    .. math:: \min_{\deg G = r} \; \max_k |y_k - (G u)_k| / \epsilon_k \le 1

    at all frequency and time samples together, order by order. At each order, first the poles of the parametric part as they are,
    with a truncated non-parametric part: what is known of the plant is kept where that suffices. Else all poles move: starts from
    balanced truncation (of the whole model; of the non-parametric part alone), from a subspace and a Sanathanan-Koerner fit, and
    from the order below; refined by least squares over the poles; then made minimax by a sequence of second-order cone programs.
    The model is judged anew, by responses and simulations, at every sample.

    Between and beyond the frequency points, where no sample holds a model, it may differ from the identified one by K S (the
    prior) and the largest gain that one has within a tenth of the frequency, entry by entry: no resonance that nobody measured.
    Where a model differs by more, points are added there and it is refined again.

    Of a MIMO model the order is that of the whole matrix: modes of rank one cost two states each. With the poles the directions
    of the modes move, on the side with fewer signals; the other side is linear. Samples that share a bound count together.

    Parameters
    ----------
    identification : Identification
        Its model is the start, its margin what the bounds are multiplied by where the data contradict the class.
    rigid_body : RigidBody, optional
        ``RigidBody(1)``: a rigid-body mode, two poles at z = 1 that are exact; of a MIMO model ``RigidBody(min(ny, nu))``,
        one for each on the side with fewer. Integrators of the parametric part are always kept.
    time_limit : float, optional
        Seconds; then, and on Ctrl-C, the smallest order within the bounds that was found so far, or else by truncation; `stopped`
        says so.
    progress : callable (done, all), optional
        Orders on the way up to that of the identified model; most searches end long before it.

    Returns
    -------
    Reduction
        ``margin`` is the largest \|residual\|/bound of the model, ``tried`` the pairs (order, smallest such ratio found at that
        order, or that of its difference where nothing was measured if that is larger); `hankel` are the Hankel singular values of
        the identified model's stable part, `bounds` their a-priori error bounds; `bound` is inf, as the model isn't a truncated
        one: `worst_case_error(...).with_model(model)` bounds its error.

    Raises
    ------
    InputError, InputTypeError
        No Identification; a rigid-body mode with a frequency point at omega = 0 or with a periodic record.

    Notes
    -----
    A model that was found is a proof that its order suffices; that a smaller one was not found is none that there is none: the
    problem isn't convex in the poles. Poles stay inside the circle, at most a hundred times nearer to it than those of the
    identified model. Gain bound, decay rate and intervals of parameters are asked of the identified model, not of the small one.
    A smallest model touches the bounds, so that guarantees around it are wider than around the identified one: where the order
    is no concern, truncate that one.

    Source: `lawson1961` for the question, theory of orthonormal rational bases for the coordinates.

    Examples
    --------
    >>> import robustid as rid
    >>> data = rid.flexible_structure(seed=0)
    >>> basis = rid.kautz(data.modes[:, 0], data.modes[:, 1], dt=0.01, delay=1)
    >>> prior = rid.Prior(gain_bound=0.2, decay_rate=1.1)
    >>> problem = rid.MixedProblem(frequency=data.frequency, time=data.time, prior=prior, parametric=basis)
    >>> small = rid.reduce_within_bounds(rid.identify(problem))
    >>> small.order, small.margin <= 1
    (4, True)
    """
    as_kind("identification", identification, Identification, "the result of identify()")
    budget = Budget(time_limit, progress)
    return _Search(identification, _integrators(identification, rigid_body), budget).reduction()


def near_fit(identification: Identification, model: Any) -> Any:
    """The model of the same order inside the bounds that a search finds from a model without integrators; None where it finds none.

    All poles are refined by least squares at all samples, then made minimax only until every sample is inside.
    """
    search = _Search(identification, 0)
    if not identification.consistent:
        search.limit = identification.margin * (1 + _ROUNDING)
    A, B, C = (np.asarray(part, dtype=float) for part in (model.A, model.B, model.C))
    search.attempt(starts.of_model(A, B, C, search.samples))
    found = search.found.get(model.nstates)
    return None if found is None or found.judged > search.limit else found.model


def _integrators(identification: Identification, rigid_body: Any) -> int:
    """Number of poles at z = 1."""
    problem = identification.problem
    basis = problem.parametric
    held = 0 if basis is None else int(np.sum(np.abs(basis.poles - 1) <= _AT_ONE))
    if rigid_body is None:
        return held
    rigid_body = as_kind("rigid_body", rigid_body, RigidBody, "a RigidBody, such as RigidBody(1)")
    heads = min(problem.entries.outputs, problem.entries.inputs)
    if rigid_body.count != heads:
        raise InputError(
            f"`rigid_body` must be RigidBody({heads}), a mode for every signal on the side with fewer; got"
            f" {rigid_body.count} modes"
        )
    if np.any(problem.angles == 0) or any(record.initial == "periodic" for record in problem.time):
        raise InputError(
            "`rigid_body`: a frequency point at omega = 0, or a record in periodic steady state, leaves no finite response of a"
            " rigid body; identify without that point, or with the spectral lines of the record"
        )
    return max(held, 2)


class _Found(NamedTuple):
    """The best model of an order."""

    judged: float  # the larger of its margin and of the distance where nothing was measured
    margin: float
    model: Any


class _TimeIsOver(Exception):
    """Ends a search."""


class _Search:
    """Orders tried, with the best fit of each."""

    def __init__(self, identification: Identification, integrators: int, budget: Budget | None = None):
        self.identification, self.budget = identification, Budget() if budget is None else budget
        self.samples: SampleMap = sample_map(identification.problem, integrators)
        self.chains = integrators * self.samples.heads
        self.guard = Guard(identification, integrators, max(1.0, identification.margin))
        self.holding = False
        self.families = starts.truncations(identification, self.samples)
        basis = identification.problem.parametric
        self.held = starts.without_integrators(basis.poles if basis else np.zeros(0, complex), integrators)
        poles = starts.without_integrators(identification.model.poles(), self.chains)
        self.radius = 1 - (1 - float(np.abs(poles).max(initial=0.0))) / _CLOSER
        self.limit = 1.0
        self.fits: dict[int, Fit] = {}
        self.found: dict[int, _Found] = {}
        self.target = self._target()

    def reduction(self) -> Reduction:
        """The smallest order within the bounds; of inconsistent data, else, within the bounds times their margin."""
        try:
            return self._result(self._searched())
        except _TimeIsOver:
            stopped = "stopped at the time limit"
        except KeyboardInterrupt:
            stopped = "interrupted"
            _log.warning("interrupted; the smallest order found so far is returned")
        return dataclasses.replace(self._result(self._so_far()), stopped=f"{stopped}: a smaller order may suffice")

    def _searched(self) -> int:
        if not self.identification.consistent:
            few = [order for order in self._ladder() if order < _ONE_BY_ONE + self.chains]
            first = self._first(few)
            if first is not None:
                return self._downwards(first)
            self._widen()
        return self._smallest()

    def _first(self, orders: list[int]) -> int | None:
        """The first of these orders that suffices."""
        for done, order in enumerate(orders):
            self.budget.tell(done, len(orders))
            if self.suffices(order):
                self.budget.tell(len(orders), len(orders))
                return order
        return None

    def _widen(self) -> None:
        """From now on within the bounds times the margin of the data."""
        self.limit = self.identification.margin * (1 + _ROUNDING)
        self.guard = Guard(self.identification, self.samples.integrators)  # the limit is as wide now
        # What missed the narrower one wasn't compared with the identified model.
        self.found = {k: f for k, f in self.found.items() if f.margin > self.limit or self._stays(f.model)}

    def _so_far(self) -> int:
        """The smallest order found within the limit; where there is none, the first of some truncations with new numerators."""
        for widen in (False, True):
            if widen and not self.identification.consistent and self.limit == 1:
                self._widen()
            within = [k for k, found in self.found.items() if found.judged <= self.limit]
            if within:
                return min(within)
        low, high = max(self.found, default=self.chains), self.identification.order
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (low, middle) if self._truncation_suffices(middle) else (middle, high)
        return high

    def _truncation_suffices(self, order: int) -> bool:
        """Tell whether the balanced truncation of an order, with the numerators of least squares, keeps the limit."""
        pair = self.families[0](order - self.chains)
        fit = None if pair is None else _quiet(lambda: least_squares(self.samples, inside(pair, self.radius)))
        if fit is None:
            return False
        model = starts.statespace(self.samples, fit, self.identification.model)
        margin = largest_ratio(self.identification.problem, model)
        if margin > self.limit or not self._stays(model):
            return False
        self.found[order] = _Found(margin, margin, model)
        return True

    def _stays(self, model: Any) -> bool:
        """Tell whether a model stays near the identified one."""
        return self.guard.check(model, self.limit)[1] is None

    def _smallest(self) -> int:
        """Upwards to the first order that suffices, with gaps from some order on; then the orders in the gap; then down."""
        full, ladder = self.identification.order, self._ladder()
        first = self._first(ladder)
        high = full if first is None else first
        low = max((order for order in ladder if order < high), default=self.chains - 1)
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (low, middle) if self.suffices(middle) else (middle, high)
        return self._downwards(high)

    def _ladder(self) -> list[int]:
        """Orders on the way up, with gaps from some order on."""
        orders, order = list[int](), self.chains
        while order < self.identification.order:
            orders.append(order)
            order += max(1, (order - _ONE_BY_ONE) // 6)
        return orders

    def _downwards(self, order: int) -> int:
        """The lowest order that truncation leads to, from a model to one of the order below, and so on."""
        while order in self.fits and order > self.chains:
            start = starts.truncated(self.samples, self.fits[order], order - 1 - self.chains)
            self._try(order - 1, [start])
            if not self.suffices(order - 1):
                break
            order -= 1
        return order

    def suffices(self, order: int) -> bool:
        """Tell whether a model of this order was found that keeps the limit."""
        if self.budget.over:
            raise _TimeIsOver
        if order not in self.found:
            self._try(order, self._starts(order - self.chains))
        return order in self.found and self.found[order].judged <= self.limit

    def _try(self, order: int, pairs: Iterable[Pair | None]) -> None:
        """Refine these starts; the best model of the order is kept, judged anew at every sample.

        Where it leaves the identified model too far between or beyond them, points are added there, for all orders to come, and it
        is refined again.
        """
        n = order - self.chains
        fit = self._refined(n, pairs)
        for _ in range(_EXCHANGES):
            if fit is None:
                return
            model = starts.statespace(self.samples, fit, self.identification.model)
            margin = largest_ratio(self.identification.problem, model)
            between, missed = self.guard.check(model, self.limit) if margin <= self.limit else (0.0, None)
            judged = max(margin, between)
            if order not in self.found or judged < self.found[order].judged:
                self.found[order] = _Found(judged, margin, model)
                self.fits[order] = fit
            _log.info("order %d: margin %.4g", order, self.found[order].judged)
            if missed is None:
                return
            self._hold(missed)
            fit = self._best([fit.pair], n)

    def attempt(self, pair: Pair) -> None:
        """Refine these functions alone."""
        self.held = np.zeros(0, complex)
        self._try(pair.A.shape[0] + self.chains, [pair])

    def _hold(self, lines: FrequencyResponse) -> None:
        """Further frequency points with the identified model as data; with the first of them some everywhere."""
        problem = self.identification.problem
        if not self.holding:
            self.holding, self.samples = True, with_lines(self.samples, self.guard.spread, problem)
        self.samples = with_lines(self.samples, lines, problem)
        self.target = self._target()

    def _refined(self, n: int, pairs: Iterable[Pair | None]) -> Fit | None:
        fit = self._parametric_kept(n)
        if fit is not None and fit.worst <= self.limit:
            return fit
        return self._best(pairs, n)

    def _parametric_kept(self, n: int) -> Fit | None:
        """The best fit with the poles of the parametric part, a short non-parametric part refined, the numerators minimax."""
        held, best = self.held, None
        if not held.size or not held.size <= n <= _REFINED:
            return None
        for pair in self._with_held(n):
            if pair is not None:
                fit = _quiet(lambda p=pair: self._rest_refined(p))
                best = fit if best is None or (fit is not None and fit.worst < best.worst) else best
        return best

    def _with_held(self, n: int) -> Iterator[Pair | None]:
        """Functions with the poles of the parametric part, the others inside; with several heads those poles alone."""
        rest = n - self.held.size
        if self.samples.heads > 1:
            yield self.families[1](n) if not rest else None
            return
        spread = pole_functions(np.append(self.held, starts.spread(self.samples, rest)))
        for pair in (*(family(n) for family in self.families[1:]), spread):
            if pair is not None:
                moving = inside(pole_functions(apart(pair.poles, self.held)), self.radius)
                yield pole_functions(np.concatenate([self.held, moving.poles]))

    def _rest_refined(self, pair: Pair) -> Fit:
        samples, radius, held = self.samples, self.radius, self.held
        fit = descended(samples, least_squares(samples, pair), radius, held=held, budget=self.budget)
        steps = _STEPS if fit.cost <= self.limit else 0
        return levelled(samples, fit, radius, self.limit, steps, held, self.budget)

    def _target(self) -> Fit:
        """A rich model in the coordinates of the samples."""
        most = min(starts.RICH, self.identification.order - self.chains)
        pair = next(p for n in range(most, -1, -1) if (p := self.families[0](n)) is not None)
        return least_squares(self.samples, inside(pair, self.radius))

    def _starts(self, n: int) -> Iterator[Pair | None]:
        """Functions to start from, n of them."""
        yield from (family(n) for family in self.families)
        if n > _REFINED:
            return
        yield starts.from_lines(self.identification, self.samples, n)
        yield starts.sanathanan_koerner(self.samples, self.target, n)
        for step in (1, 2):
            below = self.fits.get(n + self.chains - step)
            if below is not None:
                yield from starts.grown(self.samples, below, n)

    def _best(self, pairs: Iterable[Pair | None], n: int) -> Fit | None:
        """The best fit from these starts: all are looked at, the best followed; where it comes near the limit, the others too."""
        samples, radius = self.samples, self.radius
        usable = [inside(with_poles(p, starts.reflected), radius) for p in pairs if p is not None and p.A.shape[0] == n]
        fits = [_quiet(lambda p=p: least_squares(samples, p)) for p in usable]
        if n <= _REFINED:
            fits = [self._descended(f, _QUICK) for f in fits if f is not None]
        ranked = sorted((fit for fit in fits if fit is not None), key=lambda fit: fit.cost)
        best = None
        for group in (ranked[:_KEPT], ranked[_KEPT:]):
            for found in self._followed(group, n):
                best = found if best is None or found.worst < best.worst else best
            if best is None or not self.limit < best.worst < _NEAR * self.limit:
                break
        return best

    def _descended(self, fit: Fit, steps: int) -> Fit | None:
        """The fit at its least squares, or so many steps nearer."""
        return _quiet(lambda: descended(self.samples, fit, self.radius, steps, budget=self.budget))

    def _followed(self, fits: list[Fit], n: int) -> Iterator[Fit]:
        """These fits at their least squares, then minimax, the first that is within the limit last."""
        samples, radius = self.samples, self.radius
        if n <= _REFINED:
            ends = [self._descended(f, _ALL) for f in fits]
            fits = sorted((fit for fit in ends if fit is not None), key=lambda fit: fit.cost)
        for fit in fits:
            # No model with the largest ratio s has a root mean square above s: no hope near this one.
            hopeful = fit.cost <= self.limit and n <= _REFINED
            steps = _STEPS if hopeful else _FEW * (n <= _REFINED)
            found = _quiet(lambda f=fit, s=steps: levelled(samples, f, radius, self.limit, s, budget=self.budget))
            if found is not None:
                yield found
            if not hopeful or (found is not None and found.worst <= self.limit):
                return

    def _result(self, order: int) -> Reduction:
        identification = self.identification
        whole = balanced_truncations(identification.model)(identification.order)
        tried = {k: found.judged for k, found in self.found.items()}
        if order in self.found and self.found[order].judged <= self.limit:
            _, margin, model = self.found[order]
            status, bound = self._status(margin), np.inf
        else:
            # Its own free responses, not refitted ones: the residuals that identify verified.
            margin, model = max(float(r.ratio.max()) for r in identification.residuals), identification.model
            order, status, bound = identification.order, SearchStatus.UNREDUCED, 0.0
            tried[order] = margin
        return Reduction(
            model,
            order=order,
            hankel=whole.hankel,
            bound=bound,
            bounds=whole.bounds,
            status=status,
            margin=margin,
            tried=tuple(sorted(tried.items())),
        )

    def _status(self, margin: float) -> SearchStatus:
        if self.identification.consistent:
            return SearchStatus.WITHIN
        return SearchStatus.OUTSIDE if margin <= 1 else SearchStatus.INFLATED


def _quiet(attempt: Callable[[], Fit]) -> Fit | None:
    """The fit, None where numbers overflow on the way or a factorisation fails: that start leads nowhere."""
    try:
        with np.errstate(all="ignore"):
            fit = attempt()
    except (np.linalg.LinAlgError, ValueError):
        return None
    return fit if np.isfinite(fit.cost) else None

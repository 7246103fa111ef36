"""A prior from the data: the smallest gain bound at each decay rate, and the knee of that curve."""

from __future__ import annotations

import dataclasses
import logging
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from robustid.advice.sensitivity import default_points, guaranteed
from robustid.advice.smallest_gain import (
    CEILINGS,
    DIGITS,
    TAILS,
    Mask,
    missed,
    response_sizes,
    selected,
    smallest_gain,
    thinned,
)
from robustid.core import Budget, Frozen, Interruptible, Progress, Real, as_array, as_kind, freeze, one_thread
from robustid.errors import InputError, SizeError
from robustid.identification import MixedProblem, Prior, identify
from robustid.identification.formulation import formulate

_log = logging.getLogger("robustid")

SAFETY = 2.0  # recommended gain bound over the smallest one
_RATES = 9
_QUICK_MATRIX = 800  # coefficients times the root of the entries: beyond, every smallest gain takes minutes
_FEW = 40  # frequency points (over the root of the entries) that stand for more of them
_QUICK_WORK = 2e10  # multiplications of a Newton step with all points, up to which they decide the recommended gain
_FORGETS = 5.0  # what the log of the free response must decay by over a record of unknown initial state
_APART = 2.0  # times the distance of the points in rad, at least: how far the decay rate is above 1 by default


@dataclasses.dataclass(frozen=True, eq=False, kw_only=True)
class PriorSuggestion(Frozen):
    """The curve of the smallest gain bound against the decay rate, and the prior at its knee.

    Attributes
    ----------
    prior : Prior or None
        Recommended; None where no gain bound makes the data consistent.
    decay_rates : (R,) array
        Ascending.
    gains : (R,) array
        Smallest K with which the data are consistent (to 0.1 %); 0 where the parametric part alone is, inf where none is.
    errors : (R,) array
        Median guaranteed error relative to the response with `priors`; NaN where it was not asked for.
    priors : tuple of Prior or None
        What would be recommended at each decay rate; None where no gain bound makes the data consistent.
    safety : float
        The gain bound of `prior` is this times the smallest one.
    reason : str
        In words.
    points : int
        Frequency points that the gains rest on; fewer than there are where a part stands for all.
    continuous : bool
        Whether `decay_rates` are decays in 1/s, of data of continuous time.
    """

    prior: Prior | None
    decay_rates: Real
    gains: Real
    errors: Real
    priors: tuple[Prior | None, ...]
    safety: float
    reason: str
    points: int = 0
    continuous: bool = False

    def __post_init__(self) -> None:
        self._set(**{name: freeze(getattr(self, name)) for name in ("decay_rates", "gains", "errors")})

    def by_slope(self) -> list[Prior]:
        """The consistent `priors`, that with the smallest slope bound (`Prior.slope`) first."""
        return sorted((p for p in self.priors if p is not None), key=lambda prior: prior.slope)

    @property
    def table(self) -> str:
        """The curve in plain text."""
        known = np.any(np.isfinite(self.errors))
        head = (
            "decay, 1/s    smallest K          K/(2 decay)"
            if self.continuous
            else "decay rate    smallest K    K rho/(rho^2 - 1)"
        )
        lines = [head + ("    guaranteed error" if known else "")]
        for rho, gain, error in zip(self.decay_rates, self.gains, self.errors, strict=True):
            slope = gain / (2 * rho) if self.continuous else gain * (rho / (rho**2 - 1))
            mark = "   <- recommended" if self.prior is not None and rho == self.prior.rate else ""
            lines.append(
                f"{rho:10.5g}    {gain:10.4g}    {slope:10.4g}" + (f"    {100 * error:16.3g}%" if known else "") + mark
            )
        return "\n".join(lines)

    def summary(self) -> str:
        """The curve as a table, then the reason."""
        return f"{self.table}\n{self.reason}"


@one_thread()
def suggest_prior(
    problem: MixedProblem,
    *,
    decay_rates: ArrayLike | None = None,
    criterion: str = "slope",
    time_limit: float | None = None,
    progress: Progress | None = None,
) -> PriorSuggestion:
    """Recommend gain bound and decay rate: twice the smallest K that the data allow, at the knee of K against rho.

    The smallest K grows with rho, while ``|dG/dz| <= K rho/(rho^2 - 1)`` on the unit circle (Schwarz-Pick) bounds how much G can
    change between the frequency points. The knee is the rho with the smallest such slope: below it the decay is given away, beyond
    it K grows faster than the decay pays.

    Parameters
    ----------
    problem : MixedProblem
        Measurements and parametric part. Its prior is a placeholder: neither K nor rho of it are used.
    decay_rates : (R,) array, optional
        The rho to try, all > 1; of continuous data the decays in 1/s. Default: 9 values, rho - 1 in equal ratios from twice the
        mean distance of (at most 40) frequency points in rad, or one over the number of time samples, to half the highest frequency
        point in rad, 0.3 at the most; of continuous data likewise, in rad/s. A slower decay lets the non-parametric part do
        anything between the points, and every data set is consistent; one that decays faster is next to a constant, a stronger
        assumption than a default should make.
    criterion : {"slope", "error"}
        What the recommended pair makes small: the slope bound (quick), or the median half-width of the guaranteed band relative
        to the response, with the gain bound that is recommended at each decay rate (each is identified and its worst case
        bounded at 7 frequencies: seconds to minutes). The parametric part is taken as it is: see `worst_case_over_poles` for
        poles from data.
    time_limit : float, optional
        Seconds after which no further decay rate is tried. Ctrl-C ends the search in the same way.
    progress : callable (text, done, count), optional
        Decay rates.

    Returns
    -------
    PriorSuggestion

    Raises
    ------
    InputError
        A decay rate that is not above 1, or too many coefficients (SizeError).
    InputTypeError
        Something that isn't a MixedProblem.

    Notes
    -----
    Of more than 50 frequency points (fewer for MIMO) about 40 stand for all: dense at the modes, a few everywhere. Where the
    model with the recommended prior misses others by more than 1.5 bounds, the worst of them join, until it misses none. The
    gains then are lower ends, computed where the slope may be smallest; at the recommended decay rate it is that of all points.
    A prior from the data at hand is the weakest assumption that these data don't refute, widened by the safety factor;
    they can refute it, never prove it. Source: class of `inanc2001` section II-B; slope from the Schwarz-Pick lemma.

    Examples
    --------
    >>> import robustid as rid
    >>> from robustid.advice import suggest_prior
    >>> data = rid.datasets.flexible_structure()
    >>> modes = rid.kautz(data.modes[:, 0], data.modes[:, 1], dt=0.01, delay=1)
    >>> anything = rid.Prior(gain_bound=1.0, decay_rate=1.1)
    >>> problem = rid.MixedProblem(frequency=data.frequency, time=data.time, parametric=modes, prior=anything)
    >>> found = suggest_prior(problem, decay_rates=[1.1, 1.3])
    >>> found.gains, found.prior
    (array([0., 0.]), Prior(gain_bound=0.06, decay_rate=1.3))
    """
    as_kind("problem", problem, MixedProblem, "a MixedProblem")
    if problem.prior.physical:
        raise InputError(
            f"`problem` has a {type(problem.prior).__name__} class, of which no gain bound is to be chosen; its decay is at most"
            " the smallest real part of the poles, in magnitude"
        )
    rates = None if decay_rates is None else np.unique(as_array("decay_rates", decay_rates, ndim=1))
    if criterion not in ("slope", "error"):
        raise InputError(f"`criterion` must be 'slope' or 'error'; got {criterion!r}")
    least = 1 if problem.dt else 0
    if rates is not None and (rates.size == 0 or rates[0] <= least):
        raise InputError(f"`decay_rates` must hold numbers above {least}; got {decay_rates!r}")
    budget = Budget(time_limit, progress, "looking for a prior")
    masks, found = representatives(problem), None
    while True:
        part = problem if masks is None else selected(problem, masks)
        tried = _possible(part, _default_rates(problem)) if rates is None else rates
        before = None if criterion == "error" else found
        found = _suggested(problem, part, tried, criterion, budget, before)
        if masks is None or found.prior is None or budget.over:
            return found
        if _lighter(problem, part, found.prior.rate) is problem:
            return found  # its gain is that of all points already
        model = identify(dataclasses.replace(part, prior=found.prior), time_limit=budget.seconds).model
        more = missed(problem, masks, model)
        if more is None:
            return _of_all(problem, found, budget)
        masks = more


def _of_all(problem: MixedProblem, found: PriorSuggestion, budget: Budget) -> PriorSuggestion:
    """The gain at the recommended decay rate from all frequency points; where it is infinite, at the next best."""
    while (prior := found.prior) is not None and not budget.over:
        trial = problem.with_prior(gain_bound=prior.gain_bound, rate=prior.rate)
        if formulate(trial, accuracy=TAILS).work > _QUICK_WORK:
            return found
        gain = smallest_gain(problem, prior.rate, problem, CEILINGS[:1], budget)
        gains = np.where(found.decay_rates == prior.rate, gain, found.gains)
        if np.isinf(gain):
            gains[found.decay_rates > prior.rate] = np.inf
        found = _result(problem, found.decay_rates, gains, found.errors, found.points)
        if found.prior is None or found.prior.rate == prior.rate:
            return found
    return found


def representatives(problem: MixedProblem) -> tuple[Mask, ...] | None:
    """Masks of the frequency points that stand for all; None where there are few enough."""
    few = int(_FEW / np.sqrt(problem.entries.count))
    return None if sum(f.omega.size for f in problem.frequency) <= 1.25 * few else thinned(problem, few)


def _suggested(
    problem: MixedProblem,
    part: MixedProblem,
    rates: Real,
    criterion: str,
    budget: Budget,
    before: PriorSuggestion | None,
) -> PriorSuggestion:
    """The curve of the gains of a part of the data, and the prior at its knee; `before` of a part of that part."""
    # Beyond 8 times the largest response nothing is said between the points: not worth minutes where there are many.
    ceilings = CEILINGS if part is problem else CEILINGS[:1]

    def gain_at(rate: float) -> float:
        gain = smallest_gain(_lighter(problem, part, rate), rate, problem, ceilings, budget)
        _log.info("decay rate %.6g: smallest gain bound %.6g", rate, gain)
        return gain

    if before is None:
        gains = _curve(rates, gain_at, budget)
        rates = rates[: gains.size]
    else:
        gains = _at_knee(problem, rates, gain_at, before, budget)
    errors = np.full(rates.size, np.nan)
    if criterion == "error":
        errors = _guaranteed_errors(problem, _priors(problem, rates, gains))
    return _result(problem, rates, gains, errors, sum(f.omega.size for f in part.frequency))


def _curve(rates: Real, gain_at: Callable[[float], float], budget: Budget) -> Real:
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
    problem: MixedProblem, rates: Real, gain_at: Callable[[float], float], before: PriorSuggestion, budget: Budget
) -> Real:
    """The smallest gain where the slope is smallest, and what it is not below at the other decay rates.

    The gain rises with the decay rate and with the data, so that what one rate or fewer points ask for bounds the others from
    below: first at the knee of fewer points, then where that bound of the slope is smallest, until the smallest was computed.
    """
    gains, known = np.maximum.accumulate(_not_below(before, rates)), np.zeros(rates.size, bool)
    k = 0 if before.prior is None else int(np.argmin(np.abs(rates - before.prior.rate)))
    with Interruptible():
        while not budget.over:
            gains[k], known[k] = gain_at(float(rates[k])), True
            gains[k + 1 :] = np.maximum(gains[k + 1 :], gains[k] * (1 - DIGITS))
            budget.tell(int(known.sum()), rates.size)
            slopes = [np.inf if one is None else one.slope for one in _priors(problem, rates, gains)]
            k = int(np.argmin(slopes))
            if known[k] or np.isinf(slopes[k]):
                break
    return gains


def _not_below(before: PriorSuggestion, rates: Real) -> Real:
    """Gains of fewer points at the same decay rates, less what they may be too large by; 0 where there were none."""
    gains = dict(zip(before.decay_rates.tolist(), (before.gains * (1 - DIGITS)).tolist(), strict=True))
    return np.array([gains.get(rate, 0.0) for rate in rates.tolist()])


def _lighter(problem: MixedProblem, part: MixedProblem, rho: float) -> MixedProblem:
    """All points where they cost no more than a part of them: a fast decay needs few coefficients for any number of points."""
    if part is problem:
        return problem
    trials = (one.with_prior(gain_bound=CEILINGS[0] * response_sizes(problem)[0], rate=rho) for one in (problem, part))
    try:
        whole, few = (formulate(one, accuracy=TAILS).work for one in trials)
    except SizeError:
        return part
    return problem if whole <= few else part


def _priors(problem: MixedProblem, rates: Real, gains: Real) -> tuple[Prior | None, ...]:
    """The prior that would be recommended at each decay rate."""
    # A non-parametric part smaller than every bound can't be seen, hence not excluded either.
    floor = response_sizes(problem)[1]
    return tuple(
        dataclasses.replace(problem.prior.with_rate(float(rho)), gain_bound=SAFETY * max(float(gain), floor))
        if np.isfinite(gain)
        else None
        for rho, gain in zip(rates, gains, strict=True)
    )


def _result(problem: MixedProblem, rates: Real, gains: Real, errors: Real, points: int) -> PriorSuggestion:
    priors = _priors(problem, rates, gains)
    prior, reason = _recommend(problem, rates, gains, errors, priors)
    return PriorSuggestion(
        prior=prior,
        decay_rates=rates,
        gains=gains,
        errors=errors,
        priors=priors,
        safety=SAFETY,
        reason=reason,
        points=points,
        continuous=not problem.dt,
    )


def _guaranteed_errors(problem: MixedProblem, priors: tuple[Prior | None, ...]) -> Real:
    """Median guaranteed error at every decay rate, with the gain bound that would be recommended there."""
    errors = np.full(len(priors), np.nan)
    for k, prior in enumerate(priors):
        if prior is not None:
            errors[k] = guaranteed(dataclasses.replace(problem, prior=prior), default_points(problem))[1]
            _log.info("decay rate %.6g: median guaranteed error %.4g", prior.rate, errors[k])
    return errors


def possible_rates(problem: MixedProblem) -> Real:
    """The default decay rates, those left out at which many data, or matrices, need too many coefficients."""
    return _possible(problem, _default_rates(problem))


def _possible(problem: MixedProblem, rates: Real) -> Real:
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


def _default_rates(problem: MixedProblem) -> Real:
    finest: list[float] = []
    widest: list[float] = []
    if not problem.dt:
        top = float(max(f.omega.max() for f in problem.frequency)) or 1.0
        high, finest = top / 2, [_APART * top / min(problem.angles.size, _FEW)]
        return np.asarray(np.geomspace(np.clip(finest[0], high / 300, high / 8), high, _RATES), dtype=float)
    if problem.angles.size:
        finest.append(_APART * float(problem.angles[-1]) / min(problem.angles.size, _FEW))
        widest.append(float(problem.angles[-1]) / 2)
    if problem.taylor:
        # From unknown initial states a class that hardly decays over the record holds any data, and says nothing of the plant.
        free = all(record.initial == "free" for record in problem.time)
        finest.append((_FORGETS if free else 1) / problem.taylor)
        widest.append(0.3)
    high = min(max(widest), 0.3)
    low = float(np.clip(min(finest), high / 300, high / 8))
    return 1 + np.asarray(np.geomspace(low, high, _RATES), dtype=float)


def _rate_words(rate: float, problem: MixedProblem) -> str:
    return f"decay rate {rate:.5g}" if problem.dt else f"decay {rate:.5g} 1/s"


def _recommend(
    problem: MixedProblem, rates: Real, gains: Real, errors: Real, priors: tuple[Prior | None, ...]
) -> tuple[Prior | None, str]:
    largest, floor = response_sizes(problem)
    cost = np.array([np.inf if p is None else p.slope for p in priors])
    k = int(np.argmin(cost)) if np.all(np.isnan(errors)) else int(np.nanargmin(errors))
    prior = priors[k]
    if prior is None:
        ceiling = CEILINGS[-1] * largest
        return None, (
            f"no gain bound up to {ceiling:.3g} makes the data consistent, even at {_rate_words(rates[0], problem)}: samples"
            " contradict each other (repeated frequency points, overlapping records) or the parametric part"
            + (" is wrong" if problem.parameter_bounds is None else " or an interval of its coefficients is wrong")
            + "; check them, or widen the bounds"
        )
    if gains[k] <= floor:
        what = (
            "the parametric part alone"
            if gains[k] == 0
            else f"a non-parametric part of {gains[k]:.3g}, below every bound,"
        )
        reason = (
            f"{what} fits the data up to {_rate_words(rates[k], problem)}: recommended"
            f" K = {prior.gain_bound:.4g} = {SAFETY:g} x the smallest error bound {floor:.4g}"
        )
    else:
        slope = "K rho/(rho^2 - 1)" if problem.dt else "K/(2 decay)"
        what = f" the slope bound {slope} is smallest;" if np.isnan(errors[k]) else ""
        reason = (
            f"at {_rate_words(rates[k], problem)}{what} the smallest K is"
            f" {gains[k]:.4g}, recommended K = {prior.gain_bound:.4g} = {SAFETY:g} x {gains[k]:.4g}"
        )
    if gains[k] > largest:
        reason += (
            f". This K exceeds the largest response in the data ({largest:.3g}): the non-parametric part is neither small nor"
            " smooth, and the class says next to nothing between the samples; a mode is missing in the parametric part, or the"
            " bounds are too tight"
        )
    if np.isfinite(errors[k]):
        reason += f". Its guaranteed band is the narrowest: median half-width {100 * errors[k]:.3g} % of the response"
    return prior, reason + ". An assumption: data can refute it, never prove it"

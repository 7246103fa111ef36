"""A prior from the data: the smallest gain bound at each decay rate, and the knee of that curve."""

from __future__ import annotations

import dataclasses
import functools
import logging
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from robustid.advice.gain_curve import (
    SAFETY,
    GainCurve,
    default_rates,
    gains_of_all,
    lighter,
    possible,
    representatives,
    slower_rates,
    smallest_gains,
)
from robustid.advice.kept_gains import KeptGains
from robustid.advice.sensitivity import default_points, guaranteed
from robustid.advice.smallest_gain import CEILINGS, DIGITS, missed, response_sizes, selected, without_doubt
from robustid.core import Budget, Frozen, Progress, Real, Stops, as_array, as_kind, freeze, one_thread
from robustid.errors import InputError, SizeError
from robustid.identification import MixedProblem, Prior, identify

_log = logging.getLogger("robustid")

Judge = Callable[[tuple[Prior | None, ...]], Real]  # median guaranteed errors


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
    complete : bool
        Whether the search came to its end; where time or Ctrl-C ended it, other points may ask for a larger gain bound.
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
    complete: bool = True

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
    it K grows faster than the decay pays. Where K exceeds the largest response at the knee, and not at a slower rate whose
    slope is at most half as large again, that rate is taken: what the plant answers at once is in every K.

    Parameters
    ----------
    problem : MixedProblem
        Measurements and parametric part. Its prior is a placeholder: neither K nor rho of it are used.
    decay_rates : (R,) array, optional
        The rho to try, all > 1; of continuous data the decays in 1/s. Default: 9 values, rho - 1 in equal ratios from twice the
        mean distance of (at most 40) frequency points in rad, or one over the number of time samples, to half the highest frequency
        point in rad, 0.3 at the most; of continuous data likewise, in rad/s. Where no K holds the data at any of them, slower ones,
        each half of the one before, down to twice the mean distance of all points. A slower decay lets the non-parametric part do
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
    The gains are those within the bounds without what is no noise in them (`FrequencyResponse.doubt` and `changed`), as long as the
    class says something: a bound that is wider for a doubt, or for a plant that changed, is no reason for a smaller class.
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
    judge = functools.partial(_guaranteed_errors, problem) if criterion == "error" else None

    def search(data: MixedProblem) -> PriorSuggestion:
        found = _search(data, rates, judge, budget)
        return found if rates is not None else _or_slower(data, found, judge, budget)

    return _of_what_is_sure(problem, search)


@one_thread()
def useful_prior(
    problem: MixedProblem,
    *,
    time_limit: float | None = None,
    progress: Progress | None = None,
    kept: KeptGains | None = None,
) -> PriorSuggestion:
    """The prior that `suggest_prior` recommends, for those who take none that says nothing, or takes minutes with all points.

    Gains only grow with the points that join: the search ends as soon as every one exceeds the largest response.
    """
    try:
        rates = possible(problem, default_rates(problem))
    except SizeError:  # with a smaller gain bound it may not be too large
        rates = None
    budget, largest = Budget(time_limit, progress, "looking for a prior"), response_sizes(problem)[0]

    def search(data: MixedProblem) -> PriorSuggestion:
        return _or_slower(data, _search(data, rates, None, budget, largest, kept), None, budget, largest, kept)

    return _of_what_is_sure(problem, search)


def _of_what_is_sure(problem: MixedProblem, search: Callable[[MixedProblem], PriorSuggestion]) -> PriorSuggestion:
    """The result of a search within the bounds without what is no noise, where it says something; else within them as they are.

    A class that is taken from wider bounds is smaller: the more a bound admits, the narrower a band would be.
    """
    sure = without_doubt(problem)
    found = search(sure)
    if sure is problem or not found.complete or says_something(problem, found):
        return found
    return search(problem)


def _or_slower(
    problem: MixedProblem,
    found: PriorSuggestion,
    judge: Judge | None,
    budget: Budget,
    most: float = np.inf,
    kept: KeptGains | None = None,
) -> PriorSuggestion:
    """The suggestion, or where no class holds the data one that decays more slowly: what no mode stands for may do so too."""
    if found.prior is not None or not found.complete or budget.over:
        return found
    slower = slower_rates(problem, float(found.decay_rates[0]))
    if not slower.size:
        return found
    other = _search(problem, slower, judge, budget, most, kept)
    return found if other.prior is None else other


def says_something(problem: MixedProblem, found: PriorSuggestion) -> bool:
    """Tell whether a suggested non-parametric part is not larger than every response."""
    return found.prior is not None and found.prior.gain_bound <= found.safety * response_sizes(problem)[0]


def _search(
    problem: MixedProblem,
    rates: Real | None,
    judge: Judge | None,
    budget: Budget,
    most: float = np.inf,
    kept: KeptGains | None = None,
) -> PriorSuggestion:
    """The prior from points that stand for all and those that it misses, until it misses none, or all gains exceed `most`."""
    masks, found, stops, kept = representatives(problem), None, Stops(), kept or KeptGains()
    with stops.listening():
        while True:
            part = problem if masks is None else selected(problem, masks)
            tried = possible(part, default_rates(problem)) if rates is None else rates
            before = None if found is None or judge is not None else GainCurve(found.decay_rates, found.gains)
            curve = smallest_gains(problem, part, tried, before, budget, kept)
            errors = np.full(curve.rates.size, np.nan) if judge is None else judge(curve.priors(problem))
            found = _result(problem, curve, errors, sum(f.omega.size for f in part.frequency))
            if budget.over or stops.interrupted:
                return dataclasses.replace(found, complete=False)
            if masks is None or found.prior is None or found.gains.min() * (1 - DIGITS) > most:
                return found
            if lighter(problem, part, found.prior.rate) is problem:
                return found  # its gain is that of all points already
            model = identify(dataclasses.replace(part, prior=found.prior), time_limit=budget.seconds).model
            masks = missed(problem, masks, model)
            if masks is None:
                if (raised := gains_of_all(problem, GainCurve(found.decay_rates, found.gains), budget)) is not None:
                    found = _result(problem, raised, found.errors, found.points)
                return dataclasses.replace(found, complete=not (budget.over or stops.interrupted))


def _result(problem: MixedProblem, curve: GainCurve, errors: Real, points: int) -> PriorSuggestion:
    rates, gains = curve
    priors = curve.priors(problem)
    prior, reason = _recommend(problem, rates, gains, errors, priors, points)
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


def _rate_words(rate: float, problem: MixedProblem) -> str:
    return f"decay rate {rate:.5g}" if problem.dt else f"decay {rate:.5g} 1/s"


def _recommend(
    problem: MixedProblem, rates: Real, gains: Real, errors: Real, priors: tuple[Prior | None, ...], points: int
) -> tuple[Prior | None, str]:
    largest, floor = response_sizes(problem)
    k = GainCurve(rates, gains).knee(problem) if np.all(np.isnan(errors)) else int(np.nanargmin(errors))
    prior = priors[k]
    if prior is None:
        whole = points == sum(f.omega.size for f in problem.frequency)
        ceiling = CEILINGS[-1 if whole else 0] * largest
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
        almost = "" if k == int(np.argmin(GainCurve(rates, gains).slopes(problem))) else "almost the "
        what = f" the slope bound {slope} is {almost}smallest;" if np.isnan(errors[k]) else ""
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

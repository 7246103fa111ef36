"""The model worth having: inside every bound, and not significantly worse than the best fit of the same data."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
import scipy.special

from robustid.core import Budget, Frozen, Progress, Real, as_kind, freeze, one_thread
from robustid.data import FrequencyResponse, TimeRecord
from robustid.fitting import MatrixFraction, OrderSweep, RecordFit, RigidBody, suggest_order
from robustid.identification import Identification, image_of, in_image, largest_ratio
from robustid.reduction.balanced import Reduction
from robustid.reduction.drawn_inside import Bounds, drawn_fits
from robustid.reduction.guard import Guard
from robustid.reduction.simulation import AS_WELL, Simulated, Simulations, with_transients
from robustid.reduction.within_bounds import SearchStatus, near_fit

_MOST = 12  # order of the fits that are looked at
_SURE = 0.95  # probability of the F-test
_PREDICTS = (
    1.25  # of the smallest error at withheld points: what the fit of the right order may have, as in suggest_order
)
_AT_ONE = 1e-6  # a pole so near z = 1 is an integrator
_FITS = 0.6  # part of the time for the fits of the response, where records are simulated too
_DRAWN = 0.3  # part of the time that is left for fits of one order that are drawn inside the bounds
_BEYOND = 2  # orders above the one that the data carry that are tried


@dataclasses.dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class ModelWorth(Frozen):
    """A small model beside the best least-squares fits of the same data, weighted without any factor on the bounds.

    Attributes
    ----------
    reduction : Reduction
        The model that is recommended: the smallest inside the bounds, or one that fits significantly better.
    orders, misfits, withheld : (n,) arrays
        Of the least-squares fits: their order, weighted rms misfit, and relative error at withheld points (nan: not judged).
    carried : int
        Order that the data carry: the smallest whose error at withheld points is within a quarter of the best; else by description
        length.
    misfit, smallest_misfit : float
        Of the recommended model, and of the smallest one.
    smallest : int
        Order of the smallest model inside the bounds.
    fit : MatrixFraction or RecordFit
        The best least-squares fit of the order `carried`.
    worse : bool
        Whether the recommended model is still significantly worse than that fit: no model as good was found inside the bounds.
    simulated : Simulated, optional
        Simulations of the records that the data come from, where they have transients; they decided then.

    Notes
    -----
    Without a frequency response misfits are errors of simulations, relative to the outputs.
    """

    reduction: Reduction
    orders: Real
    misfits: Real
    withheld: Real
    carried: int
    misfit: float
    smallest_misfit: float
    smallest: int
    fit: MatrixFraction | RecordFit
    worse: bool
    simulated: Simulated | None = None

    def __post_init__(self) -> None:
        self._set(**{name: freeze(getattr(self, name)) for name in ("orders", "misfits", "withheld")})

    @property
    def best(self) -> float:
        """Weighted rms misfit of the best fit of the order `carried`."""
        return float(self.misfits[self.orders == self.carried][0])

    def __repr__(self) -> str:
        return f"<ModelWorth: order {self.reduction.order}, misfit {self.misfit:.3g}, best fit {self.best:.3g}>"

    def summary(self) -> str:
        """In words."""
        kind = "weighted misfit" if self.of_response else "simulation error relative to the outputs"
        beside = f"the best least-squares fit of order {self.carried}, which these data carry, has {self.best:.3g}"
        text = f"The model of order {self.reduction.order} has a {kind} of {self.misfit:.3g} (rms); {beside}."
        if self.reduction.order != self.smallest:
            word = "misfit" if self.of_response else "error"
            text = (
                f"The smallest model inside the bounds has order {self.smallest} and a {word} of {self.smallest_misfit:.3g},"
                " significantly worse: smallest is not best where bounds are wide. "
            ) + text
        elif self.misfit <= self.best:
            text += " It fits at least as well."
        elif self.worse:
            text += " No model inside all bounds was found that fits about as well."
        else:
            text += " The difference is not significant."
        return text if self.simulated is None else f"{text} {self.simulated.summary()}"

    @property
    def of_response(self) -> bool:
        """True where misfits are those of a frequency response, not of simulations."""
        return isinstance(self.fit, MatrixFraction)


@one_thread()
def model_worth_having(
    identification: Identification,
    smallest: Reduction,
    frf: FrequencyResponse | None,
    *,
    records: Sequence[TimeRecord] = (),
    time_limit: float | None = 30.0,
    progress: Progress | None = None,
) -> ModelWorth | None:
    """The smallest model inside every bound whose misfit is not significantly worse than the best fit's.

    Wide bounds hold models of order 0 to 2 that say little of the machine, where a least-squares fit of the same data predicts
    well: the set says what is possible, the likelihood what is probable. Least-squares fits of order 1 to 12 show which order the
    data carry; a model that is worse than the best fit of that order (by more than 5 % in the rms misfit, and by an F-test) is
    replaced by the fit of the smallest order that isn't and lies inside the bounds, or by that fit moved inside as little as it
    needs.

    A short record says more of the machine than the response that it gives. Where records with transients are given, the model
    must simulate them about as well as the best output-error fit of the order that they carry, too; else it is
    replaced by the smallest fit of records and response together that does and lies inside every bound.

    Parameters
    ----------
    identification : Identification
    smallest : Reduction
        Of `reduce_within_bounds`.
    frf : FrequencyResponse or None
        The data with the bounds (or the covariance) that they were measured with, not inflated: they weight the misfit.
    records : sequence of TimeRecord
        Those that the response was estimated from, or without a response those of the problem.
    time_limit : float, optional
        Seconds for the fits.
    progress : callable (done, all), optional
        Fits.

    Returns
    -------
    ModelWorth or None
        None where fits don't compare, as `why_not_compared` says: the model has integrators that fits don't keep, or no fit is
        possible.

    Notes
    -----
    Where model errors exceed the noise every further state is significant; then the error at withheld frequency points decides.
    Source: F-test and description length, `pintelon2012`.
    """
    as_kind("identification", identification, Identification, "the result of identify()")
    if why_not_compared(identification, smallest, frf, records):
        return None
    budget, records = Budget(time_limit, progress), with_transients(records)
    if _integrators(identification, smallest):
        records = []  # output-error fits do not keep them
    worth = judge = None
    if frf is not None:
        sweep = _sweep(identification, smallest, frf, budget.share(_FITS) if records else budget)
        judge = _Judge(identification, sweep)
        worth = _chosen(identification, smallest, sweep, judge, frf, budget.share(_FITS) if records else budget)
    if not records:
        return worth
    least, most = _least_order(smallest), _MOST if worth is None else int(worth.orders[-1])
    direct = bool(np.any(smallest.model.D))
    found = Simulations(records, frf, range(least, max(most, least) + 1), direct, budget)
    if not found.fits:
        return worth
    simulated = _simulating(identification, smallest, worth, found)
    if worth is None or judge is None or simulated.reduction is worth.reduction:
        return simulated
    cost = judge.cost(simulated.reduction.model)
    worse = judge.worse(cost, simulated.reduction.order)
    return dataclasses.replace(simulated, misfit=float(judge.rms(cost)), worse=worse)


def why_not_compared(
    identification: Identification,
    smallest: Reduction,
    frf: FrequencyResponse | None,
    records: Sequence[TimeRecord] = (),
) -> str:
    """Why least-squares fits can't be compared with a small model, in a sentence; empty where they can."""
    begin, integrators = (
        "The small model was not compared with least-squares fits: ",
        _integrators(identification, smallest),
    )
    if integrators and integrators != 2 * _heads(identification):
        return begin + "it has integrators that are no rigid-body modes, which these fits do not keep."
    if frf is None:
        if integrators or not with_transients(records):
            return begin + "there is no frequency response, whose misfit could be compared."
    elif _largest_order(identification, frf) < max(1, integrators):
        return begin + f"{frf.omega.size} frequency points are too few to tell orders apart."
    return ""


def _integrators(identification: Identification, smallest: Reduction | MatrixFraction) -> int:
    """Number of poles at z = 1."""
    basis = identification.problem.parametric
    held = int(np.sum(np.abs(smallest.model.poles() - 1) < _AT_ONE)) if identification.problem.dt else 0
    return max(held, int(basis is not None and basis.has_integrator))


def _heads(identification: Identification) -> int:
    """Signals on the side with fewer of them: so many rigid-body modes are the most."""
    return min(identification.problem.entries.shape)


def _sweep(identification: Identification, smallest: Reduction, frf: FrequencyResponse, budget: Budget) -> OrderSweep:
    """Least-squares fits of the frequency response, with the rigid-body modes of the model."""
    sweep = suggest_order(
        frf,
        orders=range(max(1, _integrators(identification, smallest)), _largest_order(identification, frf) + 1),
        weight=_weight(frf),
        time_limit=budget.seconds,
        progress=budget.tell,
        **_body(identification, smallest),
    )
    if sweep.interrupted:
        raise KeyboardInterrupt
    return sweep


def _body(identification: Identification, smallest: Reduction) -> dict[str, Any]:
    """Structure of the fits: that of the small model."""
    problem = identification.problem
    return {
        "domain": "z" if problem.dt else "s",
        "feedthrough": problem.parametric is not None and bool(np.any(problem.parametric.D)),
        "rigid_body": RigidBody(_heads(identification)) if _integrators(identification, smallest) else None,
    }


def _largest_order(identification: Identification, frf: FrequencyResponse) -> int:
    entries = identification.problem.entries
    return min(_MOST, frf.omega.size * entries.count // (2 * sum(entries.shape)))


def _weight(frf: FrequencyResponse) -> Any:
    """One over the bounds, where there is no covariance."""
    if frf.covariance is not None or frf.bound is None:
        return None
    radius = np.where(frf.missing, np.inf, frf.bound.outer_radius)
    return np.where(np.isfinite(radius) & (radius > 0), 1 / np.where(radius > 0, radius, 1.0), 0.0)


def carried_order(sweep: OrderSweep) -> int:
    """The smallest order whose error at withheld points is within a quarter of the best; where none is known, that of least MDL."""
    usable = (sweep.parameters <= sweep.equations / 2) & (sweep.unresolved == 0)
    usable = usable if usable.any() else np.ones(usable.size, bool)
    judged = usable & np.isfinite(sweep.withheld)
    if judged.any():
        return int(sweep.orders[judged & (sweep.withheld <= _PREDICTS * sweep.withheld[judged].min())][0])
    return int(sweep.orders[usable][np.argmin(sweep.mdl[usable])])


class _Judge:
    """The misfit of models at the frequency points, and what is significantly above that of the fit of the order carried."""

    def __init__(self, identification: Identification, sweep: OrderSweep):
        self.carried = carried_order(sweep)
        self.fit, self._plane = sweep.fits[self.carried], identification.problem.plane
        place = int(np.flatnonzero(sweep.orders == self.carried)[0])
        self._signals, self._parameters = sum(identification.problem.entries.shape), int(sweep.parameters[place])
        self._count, self._best = sweep.equations, float(sweep.costs[place])

    def cost(self, model: Any) -> float:
        """Weighted sum of squares."""
        left = self.fit.problem.values - self._plane.values_at(model, self.fit.problem.omega)
        return float(np.linalg.norm(self.fit.problem.weight.apply(left)) ** 2)

    def worse(self, cost: float, order: int) -> bool:
        """Return whether a misfit is significantly and noticeably above that of the fit of the order carried."""
        if cost <= AS_WELL**2 * self._best:
            return False
        extra = max(self._parameters - order * self._signals, 1)
        free = max(self._count - self._parameters, 1)
        ratio = (cost - self._best) / extra / max(self._best / free, np.finfo(float).tiny)
        return float(scipy.special.fdtr(extra, free, ratio)) > _SURE

    def rms(self, cost: Any) -> Any:
        """Root mean square from a sum of squares."""
        return np.sqrt(cost / max(self._count, 1))


def _chosen(
    identification: Identification,
    smallest: Reduction,
    sweep: OrderSweep,
    judge: _Judge,
    frf: FrequencyResponse,
    budget: Budget,
) -> ModelWorth:
    first, guard = judge.cost(smallest.model), _guard(identification, smallest.model)
    chosen, misfit = smallest, first
    if judge.worse(first, smallest.order):
        limits, body = _limits(identification, guard, frf), _body(identification, smallest)

        def drawn(order: int) -> Iterator[Any]:
            return drawn_fits(frf, sweep.fits[order], limits, budget.share(_DRAWN), **body)

        candidates = _candidates(identification, sweep, judge.carried, _least_order(smallest), drawn)
        for model, order in _inside(identification, guard, candidates):
            if (value := judge.cost(model)) >= misfit:
                continue
            chosen, misfit = _recommended(identification, smallest, model, order), value
            if not judge.worse(value, order):
                break
    return ModelWorth(
        reduction=chosen,
        orders=sweep.orders.astype(float),
        misfits=judge.rms(np.asarray(sweep.costs, dtype=float)),
        withheld=sweep.withheld,
        carried=judge.carried,
        misfit=float(judge.rms(misfit)),
        smallest_misfit=float(judge.rms(first)),
        smallest=smallest.order,
        fit=judge.fit,
        worse=judge.worse(misfit, chosen.order),
    )


def _simulating(
    identification: Identification, smallest: Reduction, worth: ModelWorth | None, found: Simulations
) -> ModelWorth:
    """The model that also simulates the records about as well as the best of their fits."""
    carried = found.carried()
    fit, reference = found.fits[carried], found.error(found.fits[carried].model)
    before = smallest if worth is None else worth.reduction
    chosen, error = before, found.error(before.model)
    first, guard = found.error(smallest.model), _guard(identification, smallest.model)
    limits = _limits(identification, guard, found.frf)

    def candidates() -> Iterator[tuple[Any, int]]:
        for order in found.fits:
            drawn = None
            for drawn in found.drawn_inside(order, limits):
                yield _alike(drawn, identification), order
            if (moved := None if drawn is None else near_fit(identification, drawn)) is not None:
                yield moved, order

    if error > AS_WELL * reference:
        for model, order in _inside(identification, guard, candidates()):
            if (value := found.error(model)) >= error:
                continue
            chosen, error = _recommended(identification, smallest, model, order), value
            if value <= AS_WELL * reference:
                break
    qualities = [found.quality(one) for one in (chosen.model, before.model, fit.model)]
    worse = error > AS_WELL * reference
    simulated = Simulated(
        fits=qualities[0],
        before=qualities[1],
        best=qualities[2],
        best_order=carried,
        samples=found.samples,
        worse=worse,
    )
    if worth is not None:
        return dataclasses.replace(worth, reduction=chosen, simulated=simulated)
    orders = np.array(list(found.fits), dtype=float)
    return ModelWorth(
        reduction=chosen,
        orders=orders,
        misfits=np.array([found.error(one.model) for one in found.fits.values()]),
        withheld=np.full(orders.size, np.nan),
        carried=carried,
        misfit=error,
        smallest_misfit=first,
        smallest=smallest.order,
        fit=fit,
        worse=worse,
        simulated=simulated,
    )


def _guard(identification: Identification, like: Any) -> Guard:
    """Guard that holds models near the identified one where nothing was measured; `like` has the integrators of all of them."""
    integrators = int(np.sum(np.abs(like.poles() - 1) < _AT_ONE)) if like.dt else 0
    return Guard(image_of(identification), integrators, max(1.0, identification.margin))


def _limit(identification: Identification) -> float:
    """Largest error over its bound that is inside: the margin, where data are inconsistent."""
    return 1.0 if identification.consistent else float(identification.margin) * (1 + 1e-5)


def _limits(identification: Identification, guard: Guard, frf: FrequencyResponse | None) -> Bounds:
    """Bounds that fits are drawn to; `frf` has them as they were measured, and the problem wider ones, perhaps."""
    limit, plane = _limit(identification), identification.problem.plane
    times = limit
    if frf is not None and frf.bound is not None:
        parts = [one for one in identification.problem.frequency if isinstance(one, FrequencyResponse)]
        wide = next((one.bound for one in parts if one.values.shape == frf.values.shape), frf.bound)
        if wide is not None:
            times = limit * float(np.nanmedian(wide.outer_radius / frf.bound.outer_radius))

    def ratio(model: Any) -> float:
        return largest_ratio(identification.problem, model) / limit

    def beyond(model: Any) -> FrequencyResponse | None:
        # Points of the guard are angles: of continuous time no frequency points.
        return guard.check(in_image(model, plane), limit)[1] if plane.dt else None

    return Bounds(ratio, beyond, times)


def _inside(
    identification: Identification, guard: Guard, candidates: Iterator[tuple[Any, int]]
) -> Iterator[tuple[Any, int]]:
    """Keep models that keep every sample within its bound, and are near the identified model where nothing was measured."""
    limit, plane = _limit(identification), identification.problem.plane
    for model, order in candidates:
        inside = largest_ratio(identification.problem, model) <= limit
        if inside and guard.check(in_image(model, plane), limit)[1] is None:
            yield model, order


def _recommended(identification: Identification, smallest: Reduction, model: Any, order: int) -> Reduction:
    """The reduction with another model inside the bounds."""
    margin = largest_ratio(identification.problem, model)
    status = SearchStatus.WITHIN if identification.consistent else SearchStatus.INFLATED
    if not identification.consistent and margin <= 1:
        status = SearchStatus.OUTSIDE
    tried = tuple(sorted({**dict(smallest.tried), order: margin}.items()))
    return dataclasses.replace(
        smallest, model=model, order=order, bound=np.inf, status=status, margin=margin, tried=tried
    )


def _least_order(smallest: Reduction) -> int:
    return max(smallest.order, 1)


def _candidates(
    identification: Identification,
    sweep: OrderSweep,
    carried: int,
    least: int,
    drawn: Callable[[int], Iterator[Any]],
) -> Iterator[tuple[Any, int]]:
    """Least-squares fits from the order of the smallest model on; where they are outside the bounds, drawn or moved inside."""
    orders = [k for k in sweep.orders.tolist() if least <= k <= max(carried, least) + _BEYOND]
    for order in orders:
        yield _alike(sweep.fits[order].model, identification), order
    for order in orders:
        if order >= min(carried, max(orders)):
            yield from ((_alike(model, identification), order) for model in drawn(order))
    if _integrators(identification, sweep.fits[carried]):
        return  # moved inside they would not stay at z = 1
    for order in orders:
        if (
            order >= min(carried, max(orders))
            and (found := near_fit(identification, sweep.fits[order].model)) is not None
        ):
            yield found, order


def _alike(model: Any, identification: Identification) -> Any:
    """The model with the names of the identified one."""
    import control

    like = identification.model
    labels = {"inputs": like.input_labels, "outputs": like.output_labels, "name": "reduced"}
    return control.StateSpace(model.A, model.B, model.C, model.D, like.dt, remove_useless_states=False, **labels)

"""The model worth having: inside every bound, and not significantly worse than the best fit of the same data."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from robustid.core import Budget, Frozen, Progress, Real, as_kind, freeze, one_thread
from robustid.data import FrequencyResponse, TimeRecord
from robustid.fitting import MatrixFraction, OrderSweep, RecordFit
from robustid.identification import Identification, image_of, in_image, largest_ratio
from robustid.reduction.balanced import Reduction
from robustid.reduction.between_points import Guard
from robustid.reduction.drawn_inside import Bounds, drawn_fits
from robustid.reduction.record_simulations import AS_WELL, Simulated, Simulations, with_transients
from robustid.reduction.response_comparison import (
    AT_ONE,
    MOST,
    ResponseJudge,
    integrators_of,
    response_sweep,
    structure_of,
    why_not_compared,
)
from robustid.reduction.within_bounds import SearchStatus, near_fit

if TYPE_CHECKING:
    import control

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

    `frf` has the bounds (or the covariance) that it was measured with, not inflated: they weight the misfit; `records` are
    those that it was estimated from, or without it those of the problem. None where fits don't compare, as
    `why_not_compared` says: the model has integrators that fits don't keep, or no fit is possible.

    Where model errors exceed the noise every further state is significant; then the error at withheld frequency points
    decides. Source: F-test and description length, `pintelon2012`.
    """
    as_kind("identification", identification, Identification, "the result of identify()")
    if why_not_compared(identification, smallest, frf, records):
        return None
    budget, records = (
        Budget(time_limit, progress, "comparing the small model with the best fits"),
        with_transients(records),
    )
    if integrators_of(identification, smallest):
        records = []  # output-error fits do not keep them
    worth = judge = None
    if frf is not None:
        sweep = response_sweep(identification, smallest, frf, budget.share(_FITS) if records else budget)
        judge = ResponseJudge(identification, sweep)
        worth = _chosen(identification, smallest, sweep, judge, frf, budget.share(_FITS) if records else budget)
    if not records:
        return worth
    least, most = _least_order(smallest), MOST if worth is None else int(worth.orders[-1])
    direct = bool(np.any(smallest.model.D))
    carried = 0 if worth is None else worth.carried
    found = Simulations(records, frf, range(least, max(most, least) + 1), direct, budget, carried=carried)
    if not found.fits:
        return worth
    simulated = _simulating(identification, smallest, worth, found)
    if worth is None or judge is None or simulated.reduction is worth.reduction:
        return simulated
    cost = judge.cost(simulated.reduction.model)
    worse = judge.worse(cost, simulated.reduction.order)
    return dataclasses.replace(simulated, misfit=float(judge.rms(cost)), worse=worse)


def _chosen(
    identification: Identification,
    smallest: Reduction,
    sweep: OrderSweep,
    judge: ResponseJudge,
    frf: FrequencyResponse,
    budget: Budget,
) -> ModelWorth:
    first, guard = judge.cost(smallest.model), _guard(identification, smallest.model)
    chosen, misfit = smallest, first
    if judge.worse(first, smallest.order):
        limits, body = _limits(identification, guard, frf), structure_of(identification, smallest)

        def drawn(order: int) -> Iterator[control.StateSpace]:
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

    def candidates() -> Iterator[tuple[control.StateSpace, int]]:
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


def _guard(identification: Identification, like: control.StateSpace) -> Guard:
    """Guard that holds models near the identified one where nothing was measured; `like` has the integrators of all of them."""
    integrators = int(np.sum(np.abs(like.poles() - 1) < AT_ONE)) if like.dt else 0
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

    def ratio(model: control.StateSpace) -> float:
        return largest_ratio(identification.problem, model) / limit

    def beyond(model: control.StateSpace) -> FrequencyResponse | None:
        # Points of the guard are angles: of continuous time no frequency points.
        return guard.check(in_image(model, plane), limit)[1] if plane.dt else None

    return Bounds(ratio, beyond, times)


def _inside(
    identification: Identification, guard: Guard, candidates: Iterator[tuple[control.StateSpace, int]]
) -> Iterator[tuple[control.StateSpace, int]]:
    """Keep models that keep every sample within its bound, and are near the identified model where nothing was measured."""
    limit, plane = _limit(identification), identification.problem.plane
    for model, order in candidates:
        inside = largest_ratio(identification.problem, model) <= limit
        if inside and guard.check(in_image(model, plane), limit)[1] is None:
            yield model, order


def _recommended(
    identification: Identification, smallest: Reduction, model: control.StateSpace, order: int
) -> Reduction:
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
    drawn: Callable[[int], Iterator[control.StateSpace]],
) -> Iterator[tuple[control.StateSpace, int]]:
    """Least-squares fits from the order of the smallest model on; where they are outside the bounds, drawn or moved inside."""
    orders = [k for k in sweep.orders.tolist() if least <= k <= max(carried, least) + _BEYOND]
    for order in orders:
        yield _alike(sweep.fits[order].model, identification), order
    for order in orders:
        if order >= min(carried, max(orders)):
            yield from ((_alike(model, identification), order) for model in drawn(order))
    if integrators_of(identification, sweep.fits[carried]):
        return  # moved inside they would not stay at z = 1
    for order in orders:
        if (
            order >= min(carried, max(orders))
            and (found := near_fit(identification, sweep.fits[order].model)) is not None
        ):
            yield found, order


def _alike(model: control.StateSpace, identification: Identification) -> control.StateSpace:
    """The model with the names of the identified one."""
    import control

    like = identification.model
    labels = {"inputs": like.input_labels, "outputs": like.output_labels, "name": "reduced"}
    return control.StateSpace(model.A, model.B, model.C, model.D, like.dt, remove_useless_states=False, **labels)

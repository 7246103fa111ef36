"""The model worth having: inside every bound, and not significantly worse than the best fit of the same data."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from typing import Any

import numpy as np
import scipy.special

from robustid.core import Frozen, Progress, Real, as_kind, freeze, one_thread
from robustid.data import FrequencyResponse
from robustid.identification import Identification, image_of, in_image, largest_ratio
from robustid.mfd import MatrixFraction, OrderSweep, suggest_order
from robustid.reduction.balanced import Reduction
from robustid.reduction.guard import Guard
from robustid.reduction.within_bounds import SearchStatus, near_fit

_MOST = 12  # order of the fits that are looked at
_AS_WELL = 1.05  # of the root mean square misfit: differences that don't matter
_SURE = 0.95  # probability of the F-test
_PREDICTS = (
    1.25  # of the smallest error at withheld points: what the fit of the right order may have, as in suggest_order
)
_AT_ONE = 1e-6  # a pole so near z = 1 is an integrator
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
    fit : MatrixFraction
        The best least-squares fit of the order `carried`.
    worse : bool
        Whether the recommended model is still significantly worse than that fit: no model as good was found inside the bounds.
    """

    reduction: Reduction
    orders: Real
    misfits: Real
    withheld: Real
    carried: int
    misfit: float
    smallest_misfit: float
    smallest: int
    fit: MatrixFraction
    worse: bool

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
        beside = f"the best least-squares fit of order {self.carried}, which these data carry, has {self.best:.3g}"
        found = f"The model of order {self.reduction.order} has a weighted misfit of {self.misfit:.3g} (rms); {beside}."
        if self.reduction.order != self.smallest:
            text = (
                f"The smallest model inside the bounds has order {self.smallest} and a misfit of {self.smallest_misfit:.3g},"
                " significantly worse: smallest is not best where bounds are wide. "
            )
            return text + found
        if self.misfit <= self.best:
            return found + " It fits at least as well."
        if self.worse:
            return found + " No model inside all bounds was found that fits about as well."
        return found + " The difference is not significant."


@one_thread()
def model_worth_having(
    identification: Identification,
    smallest: Reduction,
    frf: FrequencyResponse,
    *,
    time_limit: float | None = 20.0,
    progress: Progress | None = None,
) -> ModelWorth | None:
    """The smallest model inside every bound whose misfit is not significantly worse than the best fit's.

    Wide bounds hold models of order 0 to 2 that say little of the machine, where a least-squares fit of the same data predicts
    well: the set says what is possible, the likelihood what is probable. Least-squares fits of order 1 to 12 show which order the
    data carry; a model that is worse than the best fit of that order (by more than 5 % in the rms misfit, and by an F-test) is
    replaced by the fit of the smallest order that isn't and lies inside the bounds, or by that fit moved inside as little as it
    needs.

    Parameters
    ----------
    identification : Identification
    smallest : Reduction
        Of `reduce_within_bounds`.
    frf : FrequencyResponse
        The data with the bounds (or the covariance) that they were measured with, not inflated: they weight the misfit.
    time_limit : float, optional
        Seconds for the fits.
    progress : callable (done, all), optional
        Fits.

    Returns
    -------
    ModelWorth or None
        None where fits don't compare, as `why_not_compared` says: the model has integrators, or no fit is possible.

    Notes
    -----
    Where model errors exceed the noise every further state is significant; then the error at withheld frequency points decides.
    Source: F-test and description length, `pintelon2012`.
    """
    as_kind("identification", identification, Identification, "the result of identify()")
    if why_not_compared(identification, smallest, frf):
        return None
    problem = identification.problem
    direct = problem.parametric is not None and bool(np.any(problem.parametric.D))
    sweep = suggest_order(
        frf,
        orders=range(1, _largest_order(identification, frf) + 1),
        weight=_weight(frf),
        domain="z" if problem.dt else "s",
        feedthrough=direct,
        time_limit=time_limit,
        progress=progress,
    )
    if sweep.interrupted:
        raise KeyboardInterrupt
    return _chosen(identification, smallest, sweep, frf)


def why_not_compared(identification: Identification, smallest: Reduction, frf: FrequencyResponse | None) -> str:
    """Why least-squares fits can't be compared with a small model, in a sentence; empty where they can."""
    problem, begin = identification.problem, "The small model was not compared with least-squares fits: "
    if frf is None:
        return begin + "there is no frequency response, whose misfit could be compared."
    if np.any(np.abs(smallest.model.poles() - 1) < _AT_ONE) or (
        problem.parametric is not None and problem.parametric.has_integrator
    ):
        return begin + "it has integrators, which these fits do not keep."
    if _largest_order(identification, frf) < 1:
        return begin + f"{frf.omega.size} frequency points are too few to tell orders apart."
    return ""


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


def _chosen(
    identification: Identification, smallest: Reduction, sweep: OrderSweep, frf: FrequencyResponse
) -> ModelWorth:
    carried = carried_order(sweep)
    fit, place = sweep.fits[carried], int(np.flatnonzero(sweep.orders == carried)[0])
    count, best = sweep.equations, float(sweep.costs[place])
    plane, image = identification.problem.plane, image_of(identification)

    def cost(model: Any) -> float:
        left = fit.problem.values - plane.values_at(model, fit.problem.omega)
        return float(np.linalg.norm(fit.problem.weight.apply(left)) ** 2)

    def worse(value: float, order: int) -> bool:
        """Return whether a misfit is significantly and noticeably above that of the fit of the order carried."""
        if value <= _AS_WELL**2 * best:
            return False
        extra = max(int(sweep.parameters[place]) - order * sum(identification.problem.entries.shape), 1)
        free = max(count - int(sweep.parameters[place]), 1)
        ratio = (value - best) / extra / max(best / free, np.finfo(float).tiny)
        return float(scipy.special.fdtr(extra, free, ratio)) > _SURE

    first = cost(smallest.model)
    chosen, misfit = smallest, first
    if worse(first, smallest.order):
        limit = 1.0 if identification.consistent else float(identification.margin) * (1 + 1e-5)
        guard = Guard(image, 0, max(1.0, identification.margin))
        for model, order in _candidates(identification, sweep, carried, smallest.order):
            margin, value = largest_ratio(identification.problem, model), cost(model)
            if margin > limit or value >= misfit or guard.check(in_image(model, plane), limit)[1] is not None:
                continue
            status = SearchStatus.WITHIN if identification.consistent else SearchStatus.INFLATED
            if not identification.consistent and margin <= 1:
                status = SearchStatus.OUTSIDE
            chosen = dataclasses.replace(
                smallest,
                model=model,
                order=order,
                bound=np.inf,
                status=status,
                margin=margin,
                tried=tuple(sorted({**dict(smallest.tried), order: margin}.items())),
            )
            misfit = value
            if not worse(value, order):
                break
    rms = np.sqrt(np.array([*sweep.costs, misfit, first]) / max(count, 1))
    return ModelWorth(
        reduction=chosen,
        orders=sweep.orders.astype(float),
        misfits=rms[:-2],
        withheld=sweep.withheld,
        carried=carried,
        misfit=float(rms[-2]),
        smallest_misfit=float(rms[-1]),
        smallest=smallest.order,
        fit=fit,
        worse=worse(misfit, chosen.order),
    )


def _candidates(
    identification: Identification, sweep: OrderSweep, carried: int, least: int
) -> Iterator[tuple[Any, int]]:
    """Least-squares fits from the order of the smallest model on; where they are outside the bounds, moved inside."""
    orders = [k for k in sweep.orders.tolist() if max(least, 1) <= k <= max(carried, least) + _BEYOND]
    for order in orders:
        yield _alike(sweep.fits[order].model, identification), order
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

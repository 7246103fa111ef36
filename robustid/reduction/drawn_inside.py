"""Fits drawn inside bounds: more weight where the one before lies outside, until none does."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, TypedDict, Unpack

import numpy as np

from robustid.core import Budget, Real, points_of
from robustid.data import FrequencyResponse
from robustid.errors import InputError
from robustid.fitting import MatrixFraction, RigidBody, fit_mfd

if TYPE_CHECKING:
    import control

_SIGMAS = 3.0  # standard deviations that a bound is taken for
_ROUNDS = 10
_SHARPLY = 4.0  # power of the error over its bound, where fits are of a response alone
_ASTRAY = 3.0  # times the smallest error over its bound so far
_NO_WEIGHT = 1e-9  # of the largest: values that aren't used
_AIM = 0.97  # of the bound, so that the limit is reached in a few rounds

Fitted = Callable[[FrequencyResponse, "control.StateSpace"], "control.StateSpace | None"]


class Structure(TypedDict):
    """Arguments of a fit that give it the structure of a model."""

    domain: str
    feedthrough: bool
    rigid_body: RigidBody | None


@dataclasses.dataclass(frozen=True)
class Bounds:
    """Largest error of a model over its bound, and what holds it where nothing was measured."""

    ratio: Callable[[control.StateSpace], float]  # of a model; 1 is inside
    # frequency points that hold a model where nothing was measured, if it is too far from what is known there
    beyond: Callable[[control.StateSpace], FrequencyResponse | None]
    times: float = 1.0  # factor on the bounds of the points within which a model is inside


def drawn_inside(
    model: control.StateSpace,
    points: FrequencyResponse | None,
    fitted: Fitted,
    bounds: Bounds,
    budget: Budget,
    deviation: Real | None = None,
    power: float = 1.0,
) -> Iterator[control.StateSpace]:
    """A fit, and fits with more weight where the one before lies outside a bound, until none does. Weights that are multiplied
    by what is outside end, where they end, at the least largest error of the points outside (`lawson1961`); the points inside
    keep the fit from going further than it must.
    """
    # The points have a known variance, as of `as_known`, and further ones are added where nothing was measured; `deviation` (F,
    # ny, nu) are the standard deviations of the first fit, by default those that the bounds are taken for. A weight is
    # multiplied by the `power` of the error over its bound: more than 1 where few points are far outside.
    if deviation is None and points is not None:
        deviation = _deviation(points)
    for _ in range(_ROUNDS + 1):
        if model is None:
            return
        yield model
        ratio, further = bounds.ratio(model), bounds.beyond(model)
        if budget.over or (ratio <= 1 and further is None):
            return
        if points is not None and deviation is not None:
            outside = np.maximum(_missed(model, points) / (_AIM * bounds.times * _SIGMAS), 1.0)
            deviation = deviation / outside**power
        if further is not None:
            points, deviation = _joined(
                points, deviation, further.with_bound(further.bound.outer_radius / bounds.times)
            )
        if points is None or deviation is None:
            return
        points = _with_deviation(points, deviation)
        model = fitted(points, model)


def drawn_fits(
    frf: FrequencyResponse, fit: MatrixFraction, bounds: Bounds, budget: Budget, **stated: Unpack[Structure]
) -> Iterator[control.StateSpace]:
    """A least-squares fit of a response, and fits of its order with more weight where it lies outside a bound. They begin with
    the weight of that fit; a sequence that goes astray, to three times the smallest error over its bound, is ended.
    """
    shape, order = frf.values.shape, len(fit.poles)
    units = np.eye(shape[1] * shape[2]).reshape(-1, *shape[1:])
    sizes = [
        np.linalg.norm(np.reshape(fit.problem.weight.apply(np.tile(e, (shape[0], 1, 1))), (shape[0], -1)), axis=1)
        for e in units
    ]
    weight = np.stack(sizes, axis=1).reshape(shape)
    smallest = np.inf

    def fitted(points: FrequencyResponse, start: control.StateSpace) -> control.StateSpace | None:
        nonlocal smallest
        ratio = bounds.ratio(start)
        smallest = min(smallest, ratio)
        if ratio > _ASTRAY * smallest:
            return None
        try:
            weight, seconds = 1 / _known(points), budget.seconds
            found = fit_mfd(points, order=order, weight=weight, start=start, time_limit=seconds, **stated)
        except (InputError, np.linalg.LinAlgError):
            return None
        return found.to_control()

    least = np.max(weight) * _NO_WEIGHT
    yield from drawn_inside(fit.to_control(), frf, fitted, bounds, budget, 1 / np.maximum(weight, least), _SHARPLY)


def _known(points: FrequencyResponse) -> Real:
    """Standard deviation of every value, of points with a known one."""
    F, ny, nu = points.values.shape
    variance = np.real(np.diagonal(np.asarray(points.covariance), axis1=1, axis2=2))
    return np.sqrt(variance).reshape(F, nu, ny).transpose(0, 2, 1)


def as_known(frf: FrequencyResponse) -> FrequencyResponse:
    """The response with a known variance at every point, from its bounds."""
    return _with_deviation(frf, _deviation(frf))


def _deviation(frf: FrequencyResponse) -> Real:
    """Standard deviation that a bound is taken for, (F, ny, nu), positive."""
    radius = np.ones(frf.values.shape) if frf.bound is None else np.asarray(frf.bound.outer_radius, dtype=float)
    usable = np.isfinite(radius) & (radius > 0)
    usual = np.median(radius[usable]) if usable.any() else 1.0
    return np.where(usable, radius, usual) / _SIGMAS


def _with_deviation(frf: FrequencyResponse, deviation: Real) -> FrequencyResponse:
    flat = deviation.transpose(0, 2, 1).reshape(len(deviation), -1)
    return dataclasses.replace(frf, covariance=np.eye(flat.shape[1]) * np.square(flat)[:, :, None], dof=None)


def _missed(model: control.StateSpace, points: FrequencyResponse) -> Real:
    """Error over the standard deviation that the bound is taken for, (F, ny, nu)."""
    response = np.moveaxis(np.asarray(model(points_of(points.omega, points.dt), squeeze=False)), -1, 0)
    return np.where(points.missing, 0.0, np.abs(response - points.values) / _deviation(points))


def _joined(
    points: FrequencyResponse | None, deviation: Real | None, further: FrequencyResponse
) -> tuple[FrequencyResponse, Real]:
    """All frequency points, with their deviations; of two at the same frequency the first."""
    if points is None or deviation is None:
        return further, _deviation(further)
    unknown = np.flatnonzero(~np.isin(further.omega, points.omega))
    if not unknown.size:
        return points, deviation
    new = further.select(unknown)
    omega = np.concatenate([points.omega, new.omega])
    order = np.argsort(omega)
    values = np.concatenate([points.values, new.values])[order]
    both = np.concatenate([deviation, _deviation(new)])[order]
    radius = np.concatenate([_SIGMAS * _deviation(points), _SIGMAS * _deviation(new)])[order]
    joined = FrequencyResponse(
        omega[order], values, bound=radius, dt=points.dt, inputs=points.inputs, outputs=points.outputs
    )
    return joined, both

"""Fits drawn inside bounds: more weight where the one before lies outside, until none does."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from robustid.core import Budget, Real
from robustid.data import FrequencyResponse

_SIGMAS = 3.0  # standard deviations that a bound is taken for
_ROUNDS = 10
_AIM = 0.97  # of the bound, so that the limit is reached in a few rounds

Fitted = Callable[[FrequencyResponse, Any], Any]


@dataclasses.dataclass(frozen=True)
class Bounds:
    """Largest error of a model over its bound, and what holds it where nothing was measured.

    Attributes
    ----------
    ratio : callable
        Of a model; 1 is inside.
    beyond : callable
        Frequency points that hold a model where nothing was measured and it is too far from what is known; None: it isn't.
    times : float
        Factor on the bounds of the points within which a model is inside.
    """

    ratio: Callable[[Any], float]
    beyond: Callable[[Any], FrequencyResponse | None]
    times: float = 1.0


def drawn_inside(
    model: Any, points: FrequencyResponse | None, fitted: Fitted, bounds: Bounds, budget: Budget
) -> Iterator[Any]:
    """A fit, and fits with more weight where the one before lies outside a bound, until none does.

    Weights that are multiplied by what is outside end, where they end, at the least largest error of the points outside
    (`lawson1961`); the points inside keep the fit from going further than it must.

    Parameters
    ----------
    model : control.StateSpace
        The first fit.
    points : FrequencyResponse or None
        With a known variance, as of `as_known`; further ones are added where nothing was measured.
    fitted : callable
        Model of points and a start, or None where there is none.
    bounds : Bounds
    budget : Budget
    """
    deviation = None if points is None else _deviation(points)
    for _ in range(_ROUNDS + 1):
        if model is None:
            return
        yield model
        ratio, further = bounds.ratio(model), bounds.beyond(model)
        if budget.over or (ratio <= 1 and further is None):
            return
        if points is not None and deviation is not None:
            deviation = deviation / np.maximum(_missed(model, points) / (_AIM * bounds.times * _SIGMAS), 1.0)
        if further is not None:
            points, deviation = _joined(
                points, deviation, further.with_bound(further.bound.outer_radius / bounds.times)
            )
        if points is None or deviation is None:
            return
        points = _with_deviation(points, deviation)
        model = fitted(points, model)


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


def _missed(model: Any, points: FrequencyResponse) -> Real:
    """Error over the standard deviation that the bound is taken for, (F, ny, nu)."""
    z = np.exp(1j * points.omega * float(points.dt or 0))
    response = np.moveaxis(np.asarray(model(z, squeeze=False)), -1, 0)
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

"""A bound that is constant on cells of the circle, as it comes from the user."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from robustid.core import as_array, freeze
from robustid.errors import InputError
from robustid.identification import check_model

KINDS = ("additive", "multiplicative", "inverse")


class Cells(NamedTuple):
    """Edges in rad/s, the same as angles in rad (the last is pi), and the bound (C,) or (C, ny, nu)."""

    edges: np.ndarray
    angles: np.ndarray
    bound: np.ndarray

    @classmethod
    def read(cls, edges: Any, bound: Any, dt: float, plant: Any = None) -> Cells:
        """Check what the user gave; shapes against a plant, where there is one."""
        edges, bound = as_array("edges", edges, ndim=1), as_array("bound", bound)
        if edges.size < 2 or np.any(np.diff(edges) <= 0) or edges[0] < 0:
            raise InputError(f"`edges` must rise from 0 rad/s or above, at least two of them; got {edges.size} edges")
        if not np.isclose(edges[-1] * dt, np.pi, rtol=1e-9, atol=0.0):
            raise InputError(
                f"`edges` must end at pi/dt = {np.pi / dt:.10g} rad/s, so that no frequency is left out; got {edges[-1]:.10g}"
            )
        shapes: list[tuple[int, ...]] = [(edges.size - 1,)]
        if plant is not None:
            shapes.append((edges.size - 1, plant.noutputs, plant.ninputs))
        if bound.shape not in shapes:
            raise InputError(
                f"`bound` must have shape {' or '.join(map(str, shapes))}, one value for each of the {edges.size - 1} cells"
                f" between `edges`; got {bound.shape}"
            )
        if not np.all(bound > 0):
            first = int(np.argmin(bound.reshape(bound.shape[0], -1).min(axis=1)))
            raise InputError(
                f"`bound` must be positive; got {bound[first].min():g} from {edges[first]:g} to {edges[first + 1]:g} rad/s."
                " A weight can't be zero on a whole cell: give cells without error a floor, such as 1e-3 of the largest bound"
            )
        angles = edges * dt
        angles[-1] = np.pi
        return cls(freeze(edges), freeze(angles), freeze(bound))


def check_plant(nominal: Any) -> Any:
    """The nominal model, discrete and with its sample time."""
    plant = check_model("nominal", nominal)
    if plant.dt is True or not plant.dt:
        raise InputError(f"`nominal` must be discrete with its sample time in s; got dt = {plant.dt}")
    return plant

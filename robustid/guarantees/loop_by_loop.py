r"""margins_by_loop(): margins of a loop of matrices, at one output or input of the plant at a time, the others closed as they are.

Opened at output i alone the loop is :math:`\ell_i` with :math:`S_{ii} = 1/(1 + \ell_i)`, the entry of the sensitivity; at input j
the entry of :math:`(I + C P)^{-1}`. So gain, phase and delay at one place follow from one entry, as of a loop of one output.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from robustid.core import Real, StateMatrices, as_kind, one_thread
from robustid.errors import InputError
from robustid.guarantees.cells import Pieces
from robustid.guarantees.loop_axis import FLOORS, BandAxis, LoopMargins, margins_of
from robustid.guarantees.loop_bounds import LoopBounds
from robustid.guarantees.loop_values import Balls, LoopValues, worst_of

_NAMES = ("sensitivity", "disk", "gain_above", "gain_below", "phase", "delay")


class MarginsByLoop(NamedTuple):
    """Margins at every output and at every input of the plant, each alone, that every consistent plant has at least."""

    outputs: tuple[LoopMargins, ...]
    inputs: tuple[LoopMargins, ...]


@one_thread()
def margins_by_loop(bounds: LoopBounds) -> MarginsByLoop:
    r"""Margins of every single loop, the others closed, that every consistent plant has: proved on the whole axis.

    Those of `LoopBounds.margins` hold for changes in all loops at once, and are smaller; these hold for a change in one alone.

    Parameters
    ----------
    bounds : LoopBounds
        Of a controller that is proved.

    Returns
    -------
    MarginsByLoop

    Raises
    ------
    InputError
        A controller that is not proved for every plant.

    References
    ----------
    `seiler2020`, on loops at a time and several at once.

    Examples
    --------
    >>> import control, numpy as np, robustid as rid
    >>> from robustid.guarantee import margins_by_loop
    >>> gain, omega = control.ss([], [], [], 0.5, 0.01), np.linspace(5.0, 300.0, 30)
    >>> frf = rid.FrequencyResponse(omega, [1 / (np.exp(0.01j * w) - 0.5) for w in omega], bound=0.02, dt=0.01)
    >>> problem = rid.MixedProblem(frequency=frf, prior=rid.Prior(gain_bound=10.0, decay_rate=1.4))
    >>> plant = control.ss(0.5, 1.0, 1.0, 0.0, 0.01)
    >>> bounds = rid.loop_bounds(rid.band(problem, model=plant), controller=gain)
    >>> found = margins_by_loop(bounds)
    >>> bool(2.7 < found.outputs[0].gain[1] < 3.0), bool(abs(found.inputs[0].phase - bounds.margins.phase) < 0.01)
    (True, True)
    """
    as_kind("bounds", bounds, LoopBounds, "LoopBounds, such as one of the proofs of a design")
    model = bounds.band.model
    if model is None or not bounds.guaranteed or bounds.unbounded:
        raise InputError(f"`bounds` must be proved at every frequency; got: {bounds.unbounded or bounds.status.value}")
    nu, ny = bounds.loop.shape
    controller = None if bounds.stability is None else bounds.loop.as_controller(bounds.controller)
    around, axis = bounds.loop.about(StateMatrices.of(model), controller), BandAxis(bounds.band)
    places = [("y", "d", k) for k in range(ny)] + [("u", "r", k) for k in range(nu)]

    def sizes(pieces: Pieces, reach: Real, _: Real, top: Real) -> Real:
        values, bound = LoopValues(pieces.values, reach, (nu, ny)), axis.bounds(pieces)
        return np.stack([one for place in places for one in _sizes(values.entry(*place, bound), top)], axis=1)

    floors = np.array([FLOORS.get(name, 0.0) for name in _NAMES] * len(places))
    largest, _ = axis.largest(around, sizes, floors)
    found = [
        margins_of(dict(zip(_NAMES, row, strict=True)), (1, 1)) for row in largest.reshape(len(places), -1).tolist()
    ]
    return MarginsByLoop(tuple(found[:ny]), tuple(found[ny:]))


def _sizes(entry: Balls, top: Real) -> list[Real]:
    """Sizes of one entry of a sensitivity that limit its margins, by their names."""
    return [entry.largest, entry.about(np.full((1, 1), 0.5)).largest, *worst_of(entry, top)]

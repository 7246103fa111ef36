"""Statements of proof files on loops: stability of every consistent plant, peaks and margins, on arcs of the whole axis."""

from __future__ import annotations

import functools
from collections.abc import Iterator

import numpy as np

from robustid.core import StateMatrices, response_at
from robustid.errors import InputError
from robustid.guarantees.linear.entry_band import EntryBand
from robustid.guarantees.loop_bounds import LoopBounds
from robustid.guarantees.proof_arcs import Arcs, Known, arcs_of
from robustid.guarantees.proof_question import NOT_YET
from robustid.identification import as_system

BEYOND = 1e-6  # of a bound, what a file may state more than this package proves
_FEW = (
    20  # states up to which the margin of a controller is written: the checker inverts a matrix of them at every knot
)
_SMALL = 0.5  # of a peak: bounds of a map below that are not made close, at its zeros they would take thousands of arcs
_KNOTS = 4000  # of a map, at most: each holds sums, and slow decays of a class ask for many

Said = tuple[Known, Arcs, str]


def statements_of(found: LoopBounds) -> list[Said]:
    """Return functions, arcs with their bounds, and kinds; of a plant that was measured in a loop with one of two controllers.

    The one that ran: peaks of its maps, which R changes linearly. Another one: that it stabilises every consistent plant.
    """
    if not found.band.problem.dt:
        raise InputError(NOT_YET.format("it is a loop in continuous time"))
    if not found.guaranteed or not np.isfinite(peak := found.peaks["sensitivity"].value):
        raise InputError(NOT_YET.format("its controller is not proved to stabilise every consistent plant"))
    if found.stability is None and not found.in_open_loop:
        said = list(_that_ran(found))
        if not said:
            raise InputError(NOT_YET.format("its sums do not bound its peaks as this package does"))
        return said
    one, known = found.band.bands[0], _factors(found)
    arcs = _below(one, known, peak if found.in_open_loop else 0.0)
    if arcs is None:
        raise InputError(NOT_YET.format("its sums do not say on every arc that its loop is stable"))
    return [(known, arcs, "loop"), *(_further(found, known) if found.in_open_loop else ())]


def _factors(found: LoopBounds) -> Known:
    """Factors of the controller in units of about the plant where their product is about 1, with those of a loop that ran."""
    one, dt, factors = found.band.bands[0], float(found.band.problem.dt or 1.0), found.loop.factors
    controller, z = StateMatrices.of(as_system("controller", found.controller)[0].model(dt)), np.exp(1j * one.angles)
    inner = np.stack([np.ones(z.size), one.centre], axis=1)
    u, y = np.abs(response_at(factors, z) @ inner[:, :, None])[:, :, 0].T
    size = np.abs(response_at(controller, z)[:, 0, 0]) * y / u
    size = np.where(np.isfinite(size), size, np.inf)  # at the pole of an integrator it has no value
    crossing = int(np.argmin(np.abs(np.log(np.maximum(size, np.finfo(float).tiny)))))
    known = Known.loop_of(controller, float((y / u)[crossing]), dt)
    return known if found.in_open_loop else known.behind(factors)


def _that_ran(found: LoopBounds) -> Iterator[Said]:
    for name, known in Known.maps_of(found.loop.factors, found.loop.back).items():
        peak, one = found.peaks[name].value, found.band.bands[0]
        asked, omega = (
            functools.partial(np.full_like, fill_value=peak),
            one.angles / float(found.band.problem.dt or 1.0),
        )
        arcs = arcs_of(one, known, omega, asked, loop=False, least=_SMALL * peak, most=_KNOTS)
        if arcs is not None and _largest(arcs) <= peak * (1 + BEYOND):
            yield known, arcs, "arcs"


def _further(found: LoopBounds, known: Known) -> Iterator[Said]:
    """Statements on the peaks of C S and T and the disk margin, where the sums bound them as this package does."""
    one, size = found.band.bands[0], 1 + BEYOND / 2
    peak = found.peaks["control_sensitivity"].value
    if (arcs := _below(one, known.control, peak)) is not None and _largest(arcs) <= peak * (1 + BEYOND):
        yield known.control, arcs, "loop"
    for x, y, peak in (
        (-1.0, 1.0, found.peaks["complementary_sensitivity"].value),
        (1.0, -0.5, 1 / found.margins.disk),
    ):
        if abs(y) / size <= peak <= abs(y) * size:
            continue
        apart, loop = known.within(x, y, peak * size), peak > abs(y)
        if (arcs := _below(one, apart, 1.0, loop=loop)) is not None and _largest(arcs) <= 1:
            yield apart, arcs._replace(bounds=["1"] * len(arcs.bounds)), "loop" if loop else "arcs"
    if found.stability is None or found.band.model is None:
        return
    model = StateMatrices.of(found.band.model)
    if len(model.A) + len(known.A) <= _FEW and 1 < (factor := found.stability.margin) < np.inf:
        grown = known.grown(model, factor * (1 - BEYOND))
        if (arcs := _below(one, grown, 0.0)) is not None:
            yield grown, arcs, "loop"


def _below(one: EntryBand, known: Known, peak: float, *, loop: bool = True) -> Arcs | None:
    omega = one.angles / float(one.samples.problem.dt or 1.0)
    return arcs_of(one, known, omega, lambda middle: np.full(middle.size, peak), loop=loop)


def _largest(arcs: Arcs) -> float:
    return max(map(float, arcs.bounds))

"""Registers verdicts on loops: stored are bands, systems and what refutes; every verdict and bound follows from them anew."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any

from robustid.core import Record, StateMatrices, keep, stored
from robustid.guarantees.band_result import Band
from robustid.guarantees.family_result import Family
from robustid.guarantees.interconnection import interconnection_again
from robustid.guarantees.interconnection_result import Interconnection
from robustid.guarantees.loop_bounds import LoopBounds, loop_bounds
from robustid.guarantees.over_cells import AroundModel
from robustid.guarantees.over_poles import WorstCaseOverPoles
from robustid.guarantees.unstable_plant import judged_plant
from robustid.guarantees.worst_case_result import WorstCaseError
from robustid.identification import Loop, as_system

if TYPE_CHECKING:
    import control

Side = Band | WorstCaseError | WorstCaseOverPoles | Family | StateMatrices
Pair = tuple[StateMatrices, StateMatrices]


def _loop(loop: Loop) -> Record:
    return {
        "controller": _matrices(loop.controller),
        "auxiliary": None if loop.auxiliary is None else _matrices(loop.auxiliary),
        "excitation": loop.excitation,
        "dt": loop.dt,
    }


def _make_loop(controller: StateMatrices, auxiliary: StateMatrices | None, excitation: str, dt: float) -> Loop:
    other = None if auxiliary is None else auxiliary.model(dt)
    return Loop(controller.model(dt), other, excitation=excitation)


def _matrices(system: Any) -> StateMatrices:
    return as_system("controller", system)[0]


def _bounds(found: LoopBounds) -> Record:
    refuted = found.refuted_by
    return {
        "band": found.band,
        "loop": found.loop,
        "controller": None if found.stability is None else _matrices(found.controller),
        "refuted_by": None if refuted is None else StateMatrices.of(refuted.residual),
        "near": None if refuted is None else refuted.omega,
    }


def _make_bounds(
    band: Band, loop: Loop, controller: StateMatrices | None, refuted_by: StateMatrices | None, near: float | None
) -> LoopBounds:
    """The bounds of the band and the controller, evaluated anew; the plant that refutes it is judged again."""
    found = loop_bounds(band, loop, None if controller is None else controller.model(loop.dt))
    if refuted_by is None or near is None:
        return found
    if found.guaranteed or controller is None:
        raise ValueError("it is refuted by a plant, and proved for every one")
    plant = judged_plant(band.problem, loop, controller, refuted_by.model(loop.dt), near)
    if plant is None:
        raise ValueError("the plant that refutes it does not agree with the data, or is stabilised by the controller")
    return dataclasses.replace(found, refuted_by=plant)


def _connection(found: Interconnection) -> Record:
    return {
        "source": _side(found.source),
        "load": _side(found.load),
        "time": found.dt,
        "pair": None if found.pair is None else tuple(StateMatrices.of(one) for one in found.pair),
    }


def _side(side: AroundModel | control.StateSpace) -> object:
    return side if isinstance(side, AroundModel) else StateMatrices.of(side)


def _make_connection(source: Side, load: Side, time: float, pair: Pair | None) -> Interconnection:
    """The verdict on two sides, evaluated anew; the pair that refutes that all loops are stable is judged again."""
    sides: list[Any] = [one.model(time) if isinstance(one, StateMatrices) else one for one in (source, load)]
    models = None if pair is None else (pair[0].model(time), pair[1].model(time))
    return interconnection_again(sides[0], sides[1], models)


stored(Loop, evidence=_loop, make=_make_loop)
keep(LoopBounds, "loop bounds", words="loop", evidence=_bounds, make=_make_bounds)
keep(Interconnection, "interconnection", evidence=_connection, make=_make_connection)

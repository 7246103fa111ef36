"""Registers designs of controllers: stored are bands, loops, the controller and what was asked; every proof is made anew."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from robustid.controllers.controller_design import ControllerDesign, DesignStatus
from robustid.controllers.factors import FIR, PID, Factor, Fixed, LeadLag, LowPass, Notch
from robustid.controllers.goals import Attenuation, Bandwidth, Goal, IntegralGain, LeastControl
from robustid.controllers.limits import TEMPLATES, Limits
from robustid.controllers.plants import Plants
from robustid.controllers.proving import proof_of
from robustid.controllers.structure import Matrix, basis_of, entries_of, free_of
from robustid.core import (
    Options,
    Progress,
    Real,
    Record,
    StateMatrices,
    Unfinished,
    fields_of,
    keep,
    points_of,
    response_at,
    stored,
)
from robustid.guarantees import Band
from robustid.identification import Loop, as_system

_POINTS = 200  # frequencies at which a controller is compared with those of its structure
_ROUNDING = 1e-6  # of its values


def _evidence(found: ControllerDesign) -> Record:
    controller = found.controller
    return {
        "bands": tuple(one.band for one in found.proofs),
        "loops": tuple(one.loop for one in found.proofs),
        "controller": None if controller is None else StateMatrices.of(controller),
        "structure": found.structure,
        "limits": found.limits,
        "goal": found.goal,
        "level": found.level,
        "searched": tuple(map(float, found.searched)),
        "dt": None if controller is None else float(controller.dt or 0.0),
        "found": found.status,
        "bounds_factor": found.bounds,
        "unfinished": found.unfinished,
    }


def design_again(
    bands: tuple[Band, ...],
    loops: tuple[Loop, ...],
    controller: StateMatrices | None,
    structure: tuple[Factor, ...] | Matrix,
    limits: Limits,
    goal: Goal,
    level: float,
    searched: tuple[float, ...],
    dt: float | None = None,
    found: DesignStatus = DesignStatus.FOUND,
    bounds_factor: float | None = None,
    unfinished: Unfinished | None = None,
    progress: Progress | None = None,
) -> ControllerDesign:
    """The design with its proof, judged again: that it is proved counts for nothing, that a search found none is recorded."""
    asked: Options = {"goal": goal, "limits": limits, "structure": structure, "searched": searched}
    asked |= {"bounds": bounds_factor, "unfinished": unfinished, "level": level}
    if len(bands) != len(loops):
        raise ValueError("every band needs its loop")
    if controller is None:
        none = found if found is DesignStatus.UNFINISHED else DesignStatus.NONE
        return ControllerDesign(status=none, controller=None, proofs=(), shares={}, **asked)
    unproved = DesignStatus.NONE if found is DesignStatus.NONE else DesignStatus.FOUND
    if not bands:
        if found is DesignStatus.PROVED:
            raise ValueError("a controller that is proved needs the bands of its plants")
        return ControllerDesign(status=unproved, controller=controller.model(dt or 0.0), proofs=(), shares={}, **asked)
    plants = [Plants(*one) for one in zip(bands, loops, strict=True)]
    _refuse_foreign(controller, structure, searched, plants[0])
    model = controller.model(plants[0].dt)
    proof = proof_of(plants, model, goal.asked(limits, level), progress)
    return ControllerDesign(
        status=DesignStatus.PROVED if proof.kept else unproved,
        controller=model,
        proofs=proof.proofs,
        shares=proof.shares,
        by_band=proof.by_band,
        **asked,
    )


def _refuse_foreign(
    controller: StateMatrices, structure: tuple[Factor, ...] | Matrix, searched: Sequence[float], plants: Plants
) -> None:
    """Raise a ValueError of a controller that no numbers of its structure make."""
    nu, ny = plants.loop.shape
    if len(searched) != len(free_of(entries_of(structure, (ny, nu)))):
        raise ValueError("there are not as many searched numbers as its structure has")
    basis, omega = basis_of(structure, searched, plants.dt, (ny, nu)), plants.band.omega
    top = np.pi / plants.dt if plants.dt else float(omega.max())
    omega = np.geomspace(float(omega[omega > 0].min()) / 10, 0.999 * top, _POINTS)
    values = response_at(controller, points_of(omega, plants.dt))
    size = np.linalg.norm(values, axis=(1, 2), keepdims=True)
    size = np.where(size > 0, size, 1.0)
    wanted = (values / size).ravel()
    columns = np.moveaxis(basis.response(omega) / size[:, None], 1, -1).reshape(wanted.size, -1)
    both = np.concatenate([columns.real, columns.imag])
    if _distance(both, np.concatenate([wanted.real, wanted.imag])) > _ROUNDING:
        raise ValueError("the controller is none of its structure")


def _distance(columns: Real, wanted: Real) -> float:
    """Largest distance of an array from the combinations of columns, each brought to the same size before."""
    scaled = columns / np.linalg.norm(columns, axis=0)
    weights: Real = np.asarray(np.linalg.lstsq(scaled, wanted)[0], dtype=float)
    return float(np.abs(scaled @ weights - wanted).max())


def _limits(limits: Limits) -> Record:
    rows = {name: tuple(tuple(map(float, row)) for row in getattr(limits, name)) for name in TEMPLATES}
    return fields_of(limits) | rows


def _fixed(factor: Fixed) -> Record:
    system, dt = as_system("model", factor.model)
    return {"system": system, "dt": dt}


def _make_fixed(system: StateMatrices, dt: float | None) -> Fixed:
    return Fixed(system.model(dt or 0.0))


stored(PID, Notch, LeadLag, LowPass, FIR, Matrix, Bandwidth, IntegralGain, Attenuation, LeastControl)
stored(DesignStatus)
stored(Limits, evidence=_limits)
stored(Fixed, evidence=_fixed, make=_make_fixed)
keep(ControllerDesign, "controller design", evidence=_evidence, make=design_again)

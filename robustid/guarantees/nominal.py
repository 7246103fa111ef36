"""Nominal model and frequencies of a bound, checked."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from robustid.core import Complex, Real, StateMatrices, as_array, as_kind
from robustid.errors import InputError
from robustid.identification import Identification, MixedProblem

if TYPE_CHECKING:
    import control

_BEYOND = 2.0  # times the highest frequency of continuous data: where the default grid ends
_OCTAVE = 2.0
_GRID = 64  # frequencies of the default grid, besides those of the poles


def as_nominal(model: control.StateSpace | None, identification: Identification) -> control.StateSpace:
    """The model, checked; by default that of the identification."""
    return identification.model if model is None else check_nominal(model, identification.problem)


def check_nominal(model: control.StateSpace, problem: MixedProblem) -> control.StateSpace:
    """Return the model: the inputs, outputs and dt of the data, stable (integrators where the parametric part has them)."""
    import control

    as_kind("model", model, control.StateSpace, "a control.StateSpace")
    dt, entries = problem.dt, problem.entries
    if (model.ninputs, model.noutputs) != (entries.inputs, entries.outputs):
        wanted = (
            "one input and one output" if entries.single else f"{entries.inputs} inputs and {entries.outputs} outputs"
        )
        raise InputError(f"`model` must have {wanted}; got {model.ninputs} and {model.noutputs}")
    if model.dt is True or model.dt is None or abs(float(model.dt) - dt) > 1e-9 * dt:
        wanted = f"discrete-time with the dt of the data, {dt:g} s" if dt else "continuous, as the data are"
        raise InputError(f"`model` must be {wanted}; got dt = {model.dt}")
    a = problem.plane.in_z(StateMatrices.of(model)).A
    poles = np.linalg.eigvals(a) if model.nstates else np.zeros(0)
    basis = problem.parametric
    allowed = np.abs(poles - 1) < 1e-6 if basis is not None and basis.has_integrator else np.zeros(poles.size, bool)
    if np.any(np.abs(poles[~allowed]) >= 1):
        worst = poles[~allowed][np.argmax(np.abs(poles[~allowed]))]
        pole = f"of modulus {np.abs(worst):.6g}"
        if not dt:
            pole = f"with real part {problem.plane.exponents(worst).real:.6g} rad/s"
        raise InputError(f"`model` must be stable: its error could not be bounded; got a pole {pole}")
    return model


def as_frequencies(omega: ArrayLike, problem: MixedProblem) -> Real:
    """Frequencies in rad/s, checked and sorted."""
    grid = np.unique(np.atleast_1d(as_array("omega", omega)))
    plane, basis = problem.plane, problem.parametric
    if grid.size == 0:
        raise InputError("`omega` is empty; give at least one frequency")
    if grid[0] < 0 or grid[-1] > plane.top * (1 + 1e-9):
        bad = grid[0] if grid[0] < 0 else grid[-1]
        end = f"lie between 0 and pi/dt = {plane.top:g} rad/s (not Hz)" if plane.dt else "not be negative"
        raise InputError(f"`omega` must {end}; got {bad:g}")
    if basis is not None and basis.has_integrator and grid[0] == 0:
        raise InputError("`omega` must not contain 0: the integrator of the parametric part is infinite there")
    return np.minimum(grid, plane.top)


def narrow_band(problem: MixedProblem) -> tuple[float, float] | None:
    """Frequency points on less than an octave, and as much again below and above, rad/s; None of any other data."""
    points = problem.plane.omega(problem.angles)
    if problem.time or points.size < 2 or not points.min() < points.max() < _OCTAVE * points.min():
        return None
    low, high = float(points.min()), float(points.max())
    return 2 * low - high, min(2 * high - low, problem.plane.top)


def default_grid(problem: MixedProblem) -> Real:
    """Half of the frequencies on a logarithmic scale, half on a linear one, and around the parametric poles."""
    plane, basis = problem.plane, problem.parametric
    lines = np.concatenate([np.zeros(0), *(f.omega for f in problem.frequency)])
    top = plane.top if plane.dt else _BEYOND * float(lines.max())
    lowest = lines[lines > 0].min() / 2 if np.any(lines > 0) else top / 200
    lowest, top = narrow_band(problem) or (lowest, top)
    grid = [np.geomspace(lowest, top, _GRID // 2), np.linspace(lowest, top, _GRID // 2)]
    if basis is not None:
        poles: Complex = basis.poles[(np.abs(basis.poles) > 0) & (np.imag(basis.poles) > 0)]
        for pole in np.unique(np.round(poles, 12)):
            width = -np.log(np.abs(pole)) * np.array([-2, -1, -0.5, 0, 0.5, 1, 2])
            grid.append(plane.omega(np.angle(pole) + width))
    grid = np.concatenate(grid)
    if basis is not None and basis.has_integrator and lines.size:
        grid = grid[grid >= lines.min()]
    return np.unique(np.clip(grid, lowest if basis is not None and basis.has_integrator else 0.0, top))

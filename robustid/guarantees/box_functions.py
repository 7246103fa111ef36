"""The parametric part of a problem with its poles as stated, or anywhere in a pole-uncertainty box."""

from __future__ import annotations

from typing import Any

import numpy as np

from robustid.core import Real, as_array
from robustid.errors import InputError, InputTypeError
from robustid.guarantees.linear.functions import Functions, fixed_functions, functions_over, pairs_of
from robustid.identification import MixedProblem

_NEAR = 3.0  # half-widths around a mode in which its resonance is looked for


def has_box(basis: Any, modes: int) -> bool:
    """Return whether functions are single pairs of so many modes, besides others: a pole-uncertainty box can hold these."""
    return basis is not None and len(pairs_of(basis)) == modes


def ends_of(box: Any) -> tuple[Real, Real]:
    """The intervals of a box."""
    omega, damping = getattr(box, "omega_interval", None), getattr(box, "damping_interval", None)
    if omega is None or damping is None:
        try:
            omega, damping = box
        except (TypeError, ValueError):
            raise InputTypeError(
                "`box` must be a KautzSuggestion or a pair of (M, 2) arrays: natural frequencies in rad/s, damping ratios;"
                f" got {type(box).__name__}"
            ) from None
    omega, damping = as_array("box", omega, ndim=2), as_array("box", damping, ndim=2)
    for name, ends in (("frequencies", omega), ("damping ratios", damping)):
        if ends.shape[1:] != (2,) or np.any(ends[:, 0] > ends[:, 1]) or np.any(ends <= 0):
            raise InputError(f"`box` must hold positive ends (low, high) of the {name}; got {ends.tolist()}")
    if omega.shape != damping.shape:
        raise InputError(
            f"`box` must have one row (low, high) a mode in both parts; got {omega.shape} for the frequencies and"
            f" {damping.shape} for the damping ratios"
        )
    if np.any(damping >= 1):
        raise InputError(f"`box` must hold damping ratios below 1; got {damping.max():g}")
    return omega, damping


def functions_of(problem: MixedProblem, box: Any) -> Functions:
    """The parametric part, with its poles in the box."""
    if box is None:
        return fixed_functions(problem.parametric)
    omega, damping = ends_of(box)
    return functions_over(problem.parametric, problem.plane, omega, damping, _peaks(problem, omega, damping))


def _peaks(problem: MixedProblem, omega: Real, damping: Real) -> Real:
    """Largest samples around every mode, in units of their bounds, (M,): so exactly its series must be."""
    found = np.zeros(len(omega))
    for points in problem.frequency:
        size = np.abs(np.where(points.bound.used, points.values, 0)) / points.bound.outer_radius
        size = size.max(axis=(1, 2))
        for k, ((low, high), (_, most)) in enumerate(zip(omega.tolist(), damping.tolist(), strict=True)):
            near = np.abs(points.omega - (low + high) / 2) <= (high - low) / 2 + _NEAR * most * high
            near[np.argmin(np.abs(points.omega - (low + high) / 2))] = True
            found[k] = max(found[k], float(size[near].max()))
    for record in problem.time:
        size = np.abs(np.where(record.bound.used, record.y, 0)) / record.bound.radius
        found = np.maximum(found, float(size.max()))
    return found

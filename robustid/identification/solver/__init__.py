"""Solvers of the convex question; nothing of what they say is believed without a check of the numbers."""

from robustid.identification.solver.cones import Cones
from robustid.identification.solver.cvxpy_backend import solver_name
from robustid.identification.solver.interior_point import path, start
from robustid.identification.solver.newton import Limits, Program
from robustid.identification.solver.paths import (
    Place,
    Supports,
    analytic_center,
    barrier_extents,
    gain_path,
    margin_path,
)

__all__ = [
    "Cones",
    "Limits",
    "Place",
    "Program",
    "Supports",
    "analytic_center",
    "barrier_extents",
    "gain_path",
    "margin_path",
    "path",
    "solver_name",
    "start",
]

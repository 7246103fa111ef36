"""Who answers the convex question; nothing of what they say is believed without a check of the numbers."""

from robustid.solve.conic import Candidate, ConvexData
from robustid.solve.cvxpy_backend import available_solvers, solve_conic, solver_name
from robustid.solve.paths import analytic_center, gain_path, margin_path, support_path
from robustid.solve.threads import threads_for

__all__ = [
    "Candidate",
    "ConvexData",
    "analytic_center",
    "available_solvers",
    "gain_path",
    "margin_path",
    "solve_conic",
    "solver_name",
    "support_path",
    "threads_for",
]

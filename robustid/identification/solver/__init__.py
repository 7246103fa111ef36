"""Who answers the convex question; nothing of what they say is believed without a check of the numbers."""

from robustid.identification.solver.ball import DenseMap, SymmetricBall
from robustid.identification.solver.conic import Candidate, ConvexData
from robustid.identification.solver.cvxpy_backend import solver_name
from robustid.identification.solver.design import DenseDesign
from robustid.identification.solver.discs import Cones
from robustid.identification.solver.interior_point import Limits, Program, path, start
from robustid.identification.solver.paths import analytic_center, gain_path, margin_path, support_path

__all__ = [
    "Candidate",
    "Cones",
    "ConvexData",
    "DenseDesign",
    "DenseMap",
    "Limits",
    "Program",
    "SymmetricBall",
    "analytic_center",
    "gain_path",
    "margin_path",
    "path",
    "solver_name",
    "start",
    "support_path",
]

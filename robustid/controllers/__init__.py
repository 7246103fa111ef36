"""Controllers of fixed structure for every plant that the data allow."""

from robustid.controllers import controller_storage as controller_storage  # registers the designs that can be saved
from robustid.controllers.by_hand import Corner, Gains, Kept, OneRoot, Section, Sections, TwoRoots
from robustid.controllers.controller_design import ControllerDesign, DesignStatus, design_controller
from robustid.controllers.factors import FIR, PID, Factor, Fixed, LeadLag, LowPass, Notch
from robustid.controllers.goals import Attenuation, Bandwidth, IntegralGain, LeastControl, as_goal
from robustid.controllers.improvements import Improvement
from robustid.controllers.limits import Limits
from robustid.controllers.obstacles import Law, Obstacle
from robustid.controllers.plants import Plants
from robustid.controllers.proving import Proof, proof_of, shares_of
from robustid.controllers.splitting import split
from robustid.controllers.structure import Matrix, entries_of, integral_gain
from robustid.controllers.worst_at import WorstAt, worst_at

__all__ = [
    "FIR",
    "PID",
    "Attenuation",
    "Bandwidth",
    "ControllerDesign",
    "Corner",
    "DesignStatus",
    "Factor",
    "Fixed",
    "Gains",
    "Improvement",
    "IntegralGain",
    "Kept",
    "Law",
    "LeadLag",
    "LeastControl",
    "Limits",
    "LowPass",
    "Matrix",
    "Notch",
    "Obstacle",
    "OneRoot",
    "Plants",
    "Proof",
    "Section",
    "Sections",
    "TwoRoots",
    "WorstAt",
    "as_goal",
    "design_controller",
    "entries_of",
    "integral_gain",
    "proof_of",
    "shares_of",
    "split",
    "worst_at",
]

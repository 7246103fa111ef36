"""Controllers of fixed structure for every plant that the data allow."""

from robustid.controllers import controller_storage as controller_storage  # registers the designs that can be saved
from robustid.controllers.controller_design import ControllerDesign, DesignStatus, design_controller
from robustid.controllers.factors import FIR, PID, Factor, Fixed, LeadLag, LowPass, Notch
from robustid.controllers.goals import Attenuation, Bandwidth, IntegralGain, LeastControl, as_goal
from robustid.controllers.improvements import Improvement
from robustid.controllers.limits import Limits
from robustid.controllers.obstacles import Law, Obstacle
from robustid.controllers.structure import Matrix, entries_of, integral_gain

__all__ = [
    "FIR",
    "PID",
    "Attenuation",
    "Bandwidth",
    "ControllerDesign",
    "DesignStatus",
    "Factor",
    "Fixed",
    "Improvement",
    "IntegralGain",
    "Law",
    "LeadLag",
    "LeastControl",
    "Limits",
    "LowPass",
    "Matrix",
    "Notch",
    "Obstacle",
    "as_goal",
    "design_controller",
    "entries_of",
    "integral_gain",
]

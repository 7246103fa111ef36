"""Controllers of fixed structure: factors, limits on the loop, goals, results of `design_controller`."""

from robustid.controllers import (
    FIR,
    PID,
    Attenuation,
    Bandwidth,
    ControllerDesign,
    DesignStatus,
    Fixed,
    Improvement,
    IntegralGain,
    Law,
    LeadLag,
    LeastControl,
    Limits,
    LowPass,
    Matrix,
    Notch,
    Obstacle,
)
from robustid.core import explain

__all__ = [
    "FIR",
    "PID",
    "Attenuation",
    "Bandwidth",
    "ControllerDesign",
    "DesignStatus",
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
]

explain(__name__, __all__)

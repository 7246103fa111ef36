"""Controllers of fixed structure: factors, limits on the loop, goals, results of `design_controller`."""

from robustid.controllers import (
    FIR,
    PID,
    Attenuation,
    Bandwidth,
    ControllerDesign,
    DesignStatus,
    Fixed,
    IntegralGain,
    LeadLag,
    LeastControl,
    Limits,
    LowPass,
    Matrix,
    Notch,
)

__all__ = [
    "FIR",
    "PID",
    "Attenuation",
    "Bandwidth",
    "ControllerDesign",
    "DesignStatus",
    "Fixed",
    "IntegralGain",
    "LeadLag",
    "LeastControl",
    "Limits",
    "LowPass",
    "Matrix",
    "Notch",
]

"""Controllers of fixed structure: factors, limits on the loop, results of `design_controller`."""

from robustid.controllers import FIR, PID, ControllerDesign, DesignStatus, Fixed, LeadLag, Limits, LowPass, Notch

__all__ = ["FIR", "PID", "ControllerDesign", "DesignStatus", "Fixed", "LeadLag", "Limits", "LowPass", "Notch"]

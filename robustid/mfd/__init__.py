"""Matrix-fraction fitting of frequency responses, with condition number one."""

from robustid.mfd.constraints import RollOff, StaticGain, Zero, ZeroEntries
from robustid.mfd.covariance import FitCovariance, fit_covariance
from robustid.mfd.criterion import Weight
from robustid.mfd.fit import MatrixFraction, fit_mfd
from robustid.mfd.iteration import FitStatus, FitStep
from robustid.mfd.modal import ModalForm, continuous, curve_points, modal_form, resolvent
from robustid.mfd.modes import ModeRow, mode_table
from robustid.mfd.order import suggest_order
from robustid.mfd.order_sweep import OrderSweep
from robustid.mfd.rigid_body import RigidBody
from robustid.mfd.subspace import subspace_estimate

__all__ = [
    "FitCovariance",
    "FitStatus",
    "FitStep",
    "MatrixFraction",
    "ModalForm",
    "ModeRow",
    "OrderSweep",
    "RigidBody",
    "RollOff",
    "StaticGain",
    "Weight",
    "Zero",
    "ZeroEntries",
    "continuous",
    "curve_points",
    "fit_covariance",
    "fit_mfd",
    "modal_form",
    "mode_table",
    "resolvent",
    "subspace_estimate",
    "suggest_order",
]

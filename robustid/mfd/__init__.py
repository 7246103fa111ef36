"""Matrix-fraction fitting of frequency responses, with condition number one."""

from robustid.mfd import storage as storage  # registers the fits that can be saved
from robustid.mfd.constraints import RollOff, StaticGain, Zero, ZeroEntries
from robustid.mfd.covariance import FitCovariance, fit_covariance
from robustid.mfd.criterion import Weight
from robustid.mfd.fit import MatrixFraction, fit_mfd
from robustid.mfd.iteration import FitStatus, FitStep, fit_fraction
from robustid.mfd.modal import ModalForm, continuous, modal_form
from robustid.mfd.modal_structure import DAMPINGS, QUANTITIES, Modal
from robustid.mfd.modes import ModeRow, mode_table
from robustid.mfd.node_fraction import NodeFraction
from robustid.mfd.order import suggest_order
from robustid.mfd.order_sweep import OrderSweep
from robustid.mfd.problem import FractionProblem
from robustid.mfd.record_fit import RecordFit
from robustid.mfd.records import fit_records
from robustid.mfd.rigid_body import RigidBody
from robustid.mfd.steps import into_form, retract, sk_step
from robustid.mfd.subspace import subspace_estimate
from robustid.mfd.vector_polynomials import orthonormal_polynomials, polynomial_nodes

__all__ = [
    "DAMPINGS",
    "QUANTITIES",
    "FitCovariance",
    "FitStatus",
    "FitStep",
    "FractionProblem",
    "MatrixFraction",
    "Modal",
    "ModalForm",
    "ModeRow",
    "NodeFraction",
    "OrderSweep",
    "RecordFit",
    "RigidBody",
    "RollOff",
    "StaticGain",
    "Weight",
    "Zero",
    "ZeroEntries",
    "continuous",
    "fit_covariance",
    "fit_fraction",
    "fit_mfd",
    "fit_records",
    "into_form",
    "modal_form",
    "mode_table",
    "orthonormal_polynomials",
    "polynomial_nodes",
    "retract",
    "sk_step",
    "subspace_estimate",
    "suggest_order",
]

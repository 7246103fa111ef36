"""Matrix-fraction fitting of frequency responses, with condition number one."""

from robustid.fitting import storage as storage  # registers the fits that can be saved
from robustid.fitting.fraction.constraints import RollOff, StaticGain, Zero, ZeroEntries
from robustid.fitting.fraction.criterion import Weight
from robustid.fitting.fraction.fit_covariance import FitCovariance, fit_covariance
from robustid.fitting.fraction.fraction_iteration import FitStatus, FitStep, fit_fraction
from robustid.fitting.fraction.fraction_problem import FractionProblem
from robustid.fitting.fraction.fraction_steps import into_form, retract, sk_step
from robustid.fitting.fraction.node_fraction import NodeFraction
from robustid.fitting.fraction.rigid_body import RigidBody
from robustid.fitting.fraction.vector_polynomials import orthonormal_polynomials, polynomial_nodes
from robustid.fitting.matrix_fraction import MatrixFraction, fit_mfd
from robustid.fitting.modal.modal_form import ModalForm, continuous, modal_form
from robustid.fitting.modal.modal_structure import DAMPINGS, QUANTITIES, Modal
from robustid.fitting.modal.mode_table import ModeRow, mode_table
from robustid.fitting.order_choice import orders_fitted, suggest_order
from robustid.fitting.order_sweep import OrderSweep, StabilisationMark
from robustid.fitting.records.output_error import fit_records
from robustid.fitting.records.record_fit import RecordFit
from robustid.fitting.state_space.subspace import subspace_estimate

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
    "StabilisationMark",
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
    "orders_fitted",
    "orthonormal_polynomials",
    "polynomial_nodes",
    "retract",
    "sk_step",
    "subspace_estimate",
    "suggest_order",
]

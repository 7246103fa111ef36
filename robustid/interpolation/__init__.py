"""The convex question: the class, the data, and the condition that a system of the class fits them."""

from robustid.interpolation.central import Interpolants, interpolants
from robustid.interpolation.certificate import MarginCertificate, certify_margin, evaluate_certificate
from robustid.interpolation.classical import ClassicalForm, classical_form
from robustid.interpolation.columns import DenseColumns, ShiftColumns
from robustid.interpolation.exact_evaluation import (
    enclose_margin,
    enclose_support,
    verify_margin_exactly,
    verify_support_exactly,
)
from robustid.interpolation.hankel import ImpulseReduction, balanced_from_impulse
from robustid.interpolation.prior import Prior
from robustid.interpolation.problem import MixedProblem
from robustid.interpolation.rows import Rows, measurement_rows, taylor_tail
from robustid.interpolation.sarason import SarasonMap, ShiftMap
from robustid.interpolation.schur import TaylorInterpolants, taylor_interpolants
from robustid.interpolation.support_certificate import Functional, SupportCertificate, certify_support, evaluate_support

__all__ = [
    "ClassicalForm",
    "DenseColumns",
    "Functional",
    "ImpulseReduction",
    "Interpolants",
    "MarginCertificate",
    "MixedProblem",
    "Prior",
    "Rows",
    "SarasonMap",
    "ShiftColumns",
    "ShiftMap",
    "SupportCertificate",
    "TaylorInterpolants",
    "balanced_from_impulse",
    "certify_margin",
    "certify_support",
    "classical_form",
    "enclose_margin",
    "enclose_support",
    "evaluate_certificate",
    "evaluate_support",
    "interpolants",
    "measurement_rows",
    "taylor_interpolants",
    "taylor_tail",
    "verify_margin_exactly",
    "verify_support_exactly",
]

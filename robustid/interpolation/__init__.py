"""The convex question: the class, the data, and the condition that a system of the class fits them."""

from robustid.interpolation.central import Interpolants, interpolants, transfer
from robustid.interpolation.certificate import MarginCertificate, certify_margin, evaluate_certificate
from robustid.interpolation.classical import ClassicalForm, classical_form
from robustid.interpolation.columns import BlockColumns, ColumnPart, DenseColumns, ShiftColumns
from robustid.interpolation.contraction import BalancedContraction
from robustid.interpolation.entries import Entries
from robustid.interpolation.exact_evaluation import (
    enclose_margin,
    enclose_support,
    verify_margin_exactly,
    verify_support_exactly,
)
from robustid.interpolation.functions import line_tails, taylor_tail
from robustid.interpolation.hankel import ImpulseReduction, balanced_from_impulse
from robustid.interpolation.prior import Prior, prior_fields
from robustid.interpolation.problem import MixedProblem
from robustid.interpolation.rows import Rows, measurement_rows
from robustid.interpolation.sarason import SarasonMap, SectionMap, ShiftMap, antidiagonal_blocks
from robustid.interpolation.schur import TaylorInterpolants, taylor_interpolants
from robustid.interpolation.support_certificate import Functional, SupportCertificate, certify_support, evaluate_support

__all__ = [
    "BalancedContraction",
    "BlockColumns",
    "ClassicalForm",
    "ColumnPart",
    "DenseColumns",
    "Entries",
    "Functional",
    "ImpulseReduction",
    "Interpolants",
    "MarginCertificate",
    "MixedProblem",
    "Prior",
    "Rows",
    "SarasonMap",
    "SectionMap",
    "ShiftColumns",
    "ShiftMap",
    "SupportCertificate",
    "TaylorInterpolants",
    "antidiagonal_blocks",
    "balanced_from_impulse",
    "certify_margin",
    "certify_support",
    "classical_form",
    "enclose_margin",
    "enclose_support",
    "evaluate_certificate",
    "evaluate_support",
    "interpolants",
    "line_tails",
    "measurement_rows",
    "prior_fields",
    "taylor_interpolants",
    "taylor_tail",
    "transfer",
    "verify_margin_exactly",
    "verify_support_exactly",
]

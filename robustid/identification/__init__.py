"""The answer: identify() and its result."""

from robustid.identification.certificate import MarginCertificate
from robustid.identification.consistency import FORMS, OBJECTIVES, identify
from robustid.identification.exact_evaluation import verify_margin_exactly, verify_support_exactly
from robustid.identification.forms import (
    LARGEST_EXACT,
    LONGEST_TAYLOR,
    QUICK_EXACT,
    Claim,
    Posed,
    pose,
    sections_of,
    taylor_length,
)
from robustid.identification.interpolant import interpolants
from robustid.identification.margin import prove_margin
from robustid.identification.model import parametric_states
from robustid.identification.prior import Prior, prior_fields
from robustid.identification.problem import MixedProblem, excited_lines
from robustid.identification.residuals import Residual, entry_name, largest_ratio, model_residuals
from robustid.identification.result import Identification
from robustid.identification.storage import describe_problem
from robustid.identification.support_certificate import Functional, SupportCertificate, certify_support
from robustid.identification.validation import Validation, check_model, describe_poles, validate
from robustid.identification.verification import Check

__all__ = [
    "FORMS",
    "LARGEST_EXACT",
    "LONGEST_TAYLOR",
    "OBJECTIVES",
    "QUICK_EXACT",
    "Check",
    "Claim",
    "Functional",
    "Identification",
    "MarginCertificate",
    "MixedProblem",
    "Posed",
    "Prior",
    "Residual",
    "SupportCertificate",
    "Validation",
    "certify_support",
    "check_model",
    "describe_poles",
    "describe_problem",
    "entry_name",
    "excited_lines",
    "identify",
    "interpolants",
    "largest_ratio",
    "model_residuals",
    "parametric_states",
    "pose",
    "prior_fields",
    "prove_margin",
    "sections_of",
    "taylor_length",
    "validate",
    "verify_margin_exactly",
    "verify_support_exactly",
]

"""The convex question and its answer: the problem, identify(), its result and its proofs."""

from robustid.identification import storage as storage  # registers what can be saved
from robustid.identification.bilinear_image import from_image, image_of, in_image
from robustid.identification.certificate import (
    Functional,
    MarginCertificate,
    SupportCertificate,
    certify_support,
    evaluate_support,
)
from robustid.identification.comparing import compare
from robustid.identification.comparison import Comparison, Differing
from robustid.identification.consistency import OBJECTIVES, identify
from robustid.identification.exact_evaluation import ball_arithmetic, verify_margin_exactly, verify_support_exactly
from robustid.identification.formulation import FORMS, check_equations, told_apart_functions
from robustid.identification.loop import Loop
from robustid.identification.loop_response import loop_noise, loop_response, measured_faults
from robustid.identification.margin import decide_margin, prove_margin
from robustid.identification.model import nominal_model, parametric_states
from robustid.identification.passive import check_gain, class_size, class_value, contradictions
from robustid.identification.passive_prior import (
    PASSIVE_NAMES,
    BoundedReal,
    NegativeImaginary,
    PositiveReal,
    prior_from,
)
from robustid.identification.prior import Prior, any_prior, prior_fields
from robustid.identification.problem import MixedProblem, check_sampled, common_scope, excited_lines, posed_alone
from robustid.identification.residuals import Residual, entry_name, fit_percent, largest_ratio, model_residuals
from robustid.identification.result import Identification
from robustid.identification.sample_faults import sample_faults
from robustid.identification.validation import Validation, as_system, check_model, describe_poles, validate
from robustid.identification.verification import Check, Claim
from robustid.identification.weighting import PriorWeight, as_weight

__all__ = [
    "FORMS",
    "OBJECTIVES",
    "PASSIVE_NAMES",
    "BoundedReal",
    "Check",
    "Claim",
    "Comparison",
    "Differing",
    "Functional",
    "Identification",
    "Loop",
    "MarginCertificate",
    "MixedProblem",
    "NegativeImaginary",
    "PositiveReal",
    "Prior",
    "PriorWeight",
    "Residual",
    "SupportCertificate",
    "Validation",
    "any_prior",
    "as_system",
    "as_weight",
    "ball_arithmetic",
    "certify_support",
    "check_equations",
    "check_gain",
    "check_model",
    "check_sampled",
    "class_size",
    "class_value",
    "common_scope",
    "compare",
    "contradictions",
    "decide_margin",
    "describe_poles",
    "entry_name",
    "evaluate_support",
    "excited_lines",
    "fit_percent",
    "from_image",
    "identify",
    "image_of",
    "in_image",
    "largest_ratio",
    "loop_noise",
    "loop_response",
    "measured_faults",
    "model_residuals",
    "nominal_model",
    "parametric_states",
    "posed_alone",
    "prior_fields",
    "prior_from",
    "prove_margin",
    "sample_faults",
    "told_apart_functions",
    "validate",
    "verify_margin_exactly",
    "verify_support_exactly",
]

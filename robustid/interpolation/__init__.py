"""The convex question: the class, the data, and the condition that a system of the class fits them."""

from robustid.interpolation.central import Interpolants, interpolants
from robustid.interpolation.certificate import MarginCertificate, certify_margin, evaluate_certificate
from robustid.interpolation.classical import ClassicalForm, classical_form
from robustid.interpolation.prior import Prior
from robustid.interpolation.problem import MixedProblem
from robustid.interpolation.rows import Rows, measurement_rows
from robustid.interpolation.sarason import SarasonMap

__all__ = [
    "ClassicalForm",
    "Interpolants",
    "MarginCertificate",
    "MixedProblem",
    "Prior",
    "Rows",
    "SarasonMap",
    "certify_margin",
    "classical_form",
    "evaluate_certificate",
    "interpolants",
    "measurement_rows",
]

"""The answer: identify() and its result."""

from robustid.identification.identify import identify
from robustid.identification.result import Identification
from robustid.identification.storage import load_identification
from robustid.identification.validation import Validation, validate

__all__ = ["Identification", "Validation", "identify", "load_identification", "validate"]

"""The answer: identify() and its result."""

from robustid.identification.consistency import identify
from robustid.identification.loading import load_identification
from robustid.identification.result import Identification
from robustid.identification.validation import Validation, validate

__all__ = ["Identification", "Validation", "identify", "load_identification", "validate"]

"""Exceptions of the library and the status values of its results.

Misuse raises, at the boundary, an exception that derives from `RobustIdError` *and* from the matching
built-in. Numerical outcomes are never raised: they are a `Status` of the result, whose value is the sentence
shown to the user.
"""

from __future__ import annotations

import enum


class RobustIdError(Exception):
    """Base of everything that robustid raises on purpose."""


class InputError(RobustIdError, ValueError):
    """An argument has a wrong value or shape; the sentence names it, what was got, and what to do."""


class InputTypeError(RobustIdError, TypeError):
    """An argument is of the wrong kind."""


class FileFormatError(RobustIdError, ValueError):
    """A file can't be read as what it claims to be."""


class DatasetNotFoundError(RobustIdError, FileNotFoundError):
    """A measured data file isn't on this machine; the sentence says where to get it."""


class SizeError(RobustIdError, ValueError):
    """The problem is too large for the chosen form."""


class TimeLimitError(RobustIdError, TimeoutError):
    """An attribute would take longer than attributes should; the sentence names the method that shows its progress."""


class SolverError(RobustIdError, RuntimeError):
    """No solver is available, or none returned usable numbers."""


class InconsistentDataError(RobustIdError, RuntimeError):
    """Raised only by ``result.require()``: the data do not fit the a-priori class."""


class Status(enum.Enum):
    """Outcome of an identification; the value is the user's sentence."""

    CONSISTENT = "consistent: a system of the class keeps every sample within its bound"
    INCONSISTENT = "inconsistent: proved that no system of the class keeps every sample within its bound"
    UNDECIDED = (
        "undecided: the proven interval of the margin contains 1; ask for a smaller `accuracy`, or give more time"
    )
    FAILED = "failed: no solver returned numbers that could be verified to the accuracy asked"

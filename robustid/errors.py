"""Exceptions of the library and the status values of its results.

Misuse raises, at the boundary, an exception that derives from `RobustIdError` *and* from the matching
built-in. Numerical outcomes are never raised: they are a `Status` of the result, whose value is the sentence
shown to the user.
"""

from __future__ import annotations

import enum
import json
import re
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple, Self

__all__ = [
    "DatasetNotFoundError",
    "FileFormatError",
    "InconsistentDataError",
    "InputError",
    "InputTypeError",
    "Remedy",
    "RobustIdError",
    "SizeError",
    "SolverError",
    "Status",
]

_MARKED = re.compile("`([^`]*)`")


class Remedy(NamedTuple):
    """Arguments that would do, the part of a sentence that says what to do.

    Attributes
    ----------
    arguments : dict
        Values by the names of the arguments.
    words : str
        What stands in the sentence; "" for the arguments as Python takes them.

    Examples
    --------
    >>> from robustid.errors import Remedy
    >>> print(Remedy({"fields": {"u": "current"}, "dt": 1.0}))
    `fields={"u": "current"}, dt=1.0`
    """

    arguments: dict[str, Any]
    words: str = ""

    @property
    def typed(self) -> str:
        """The arguments as Python takes them."""
        return ", ".join(f"{name}={json.dumps(value, ensure_ascii=False)}" for name, value in self.arguments.items())

    def __str__(self) -> str:
        return self.words or f"`{self.typed}`"


class RobustIdError(Exception):
    """Base of everything that robustid raises on purpose: a sentence for people, and what code may want of it as data.

    Parameters
    ----------
    *parts : str or Remedy
        The sentence. Arguments, as Python has them, stand in backticks.
    argument : str, optional
        Name of the argument that is wrong.
    got : optional
        Its value.
    place : str, optional
        What the sentence begins with, where it names a file.

    Examples
    --------
    >>> from robustid.errors import InputError, Remedy
    >>> error = InputError("`u` isn't found; name it by ", Remedy({"fields": {"u": "current"}}))
    >>> print(error)
    `u` isn't found; name it by `fields={"u": "current"}`
    >>> error.remedy
    {'fields': {'u': 'current'}}
    >>> error.said({"u": "the input"}, lambda remedy: f"--field u={remedy.arguments['fields']['u']}")
    "the input isn't found; name it by --field u=current"
    """

    def __init__(
        self, *parts: str | Remedy, argument: str | None = None, got: Any = None, place: str | None = None
    ) -> None:
        super().__init__("".join(map(str, parts)))  # one text: as of every exception of Python
        self.parts, self.argument, self.got, self.place = parts, argument, got, place

    @property
    def remedy(self) -> dict[str, Any]:
        """Arguments that would do; {} where none are known."""
        return next((part.arguments for part in self.parts if isinstance(part, Remedy)), {})

    def said(
        self,
        names: Mapping[str, str],
        remedy: Callable[[Remedy], str] | None = None,
        *,
        unknown: Callable[[str], str] = "`{}`".format,
    ) -> str:
        """Return the sentence for surroundings that have other names for the arguments.

        Parameters
        ----------
        names : mapping
            From what stands in backticks to what is said in its place.
        remedy : callable, optional
            Words for a remedy; default: its own.
        unknown : callable, optional
            Words for what else stands in backticks.
        """
        return "".join(map(str, self._spoken(names, remedy, unknown)))

    def reworded(self, names: Mapping[str, str], remedy: Callable[[Remedy], str | Remedy] | None = None) -> Self:
        """Return the same error with its sentence as `said` gives it; of a remedy that `remedy` returns, with its arguments."""
        return self._with(*self._spoken(names, remedy, "`{}`".format))

    def _spoken(
        self, names: Mapping[str, str], remedy: Callable[[Remedy], str | Remedy] | None, unknown: Callable[[str], str]
    ) -> list[str | Remedy]:
        """The parts in other words."""

        def named(found: re.Match[str]) -> str:
            return names[found[1]] if found[1] in names else unknown(found[1])

        def spoken(part: str | Remedy) -> str | Remedy:
            if not isinstance(part, Remedy):
                return _MARKED.sub(named, part)
            said = remedy(part) if remedy else _MARKED.sub(named, str(part))
            return said if isinstance(said, Remedy) else Remedy(part.arguments, said)

        return list(map(spoken, self.parts))

    def at(self, place: str) -> Self:
        """Return the same error with a place in front, but for a sentence that names one."""
        if self.place is not None:
            return self
        found = self._with(f"{place}: ", *self.parts)
        found.place = place
        return found

    def _with(self, *parts: str | Remedy) -> Self:
        found = type(self)(*parts)
        found.argument, found.got, found.place = self.argument, self.got, self.place
        return found


class InputError(RobustIdError, ValueError):
    """An argument has a wrong value or shape; the sentence names it, what was got, and what to do."""


class InputTypeError(RobustIdError, TypeError):
    """An argument is of the wrong kind."""


class FileFormatError(RobustIdError, ValueError):
    """A file can't be read as what it claims to be."""


class DatasetNotFoundError(RobustIdError, FileNotFoundError):
    """A measured data file isn't on this machine; the sentence says where to get it."""


class SizeError(RobustIdError, ValueError):
    """The problem is too large for the chosen form; the remedy is how to ask for less."""


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

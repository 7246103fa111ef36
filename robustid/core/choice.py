"""Choices: what was chosen, who chose it, and why; code reads the source, people the reason."""

from __future__ import annotations

import dataclasses
import enum
from typing import Any


class Source(enum.StrEnum):
    """Origin of a chosen value."""

    STATED = "stated"  # by the user
    DATA = "data"  # taken from the data
    PROGRAM = "program"  # found by a search, or put in the place of what the data don't give
    STOPPED = "stopped"  # what had been reached when the time was over, or on Ctrl-C


@dataclasses.dataclass(frozen=True)
class Choice:
    """A value that was chosen, its source, and the reason in words; `details` are the numbers behind it, as a table."""

    value: Any
    source: Source
    reason: str
    details: str = ""

    @property
    def in_place(self) -> bool:
        """True where a search in the data came to no choice, or to no end, and the program put this in the place of one."""
        return bool(self.details) and self.source in (Source.PROGRAM, Source.STOPPED)

    @property
    def note(self) -> str:
        """The reason, then the table."""
        return "\n".join(part for part in (self.reason, self.details) if part)

"""Time of a search for modes, which has none for halves."""

from __future__ import annotations

import time

from robustid.core import as_positive
from robustid.errors import Remedy, SizeError

MOST_LINES = 1000  # for the search; the interval of a mode uses the frequency points around it
PLACES = 400  # of a resonance on the grid of poles, at most
_PER_SECOND = 4e6  # places at a frequency point of an entry, in the search for a mode: as measured
_PATIENCE = 5.0  # seconds that a search may take in any case
_SEARCHED = 0.65  # of a time limit: intervals take half as long as the search, or less (measured)


class StepClock:
    """Time of a search for modes: no step begins that would end after its part of the limit.

    A step is expected to take as long as the longest one before, the first one by its number of multiplications. The rest of the
    limit is for the intervals, which the modes that are found must have.
    """

    def __init__(self, entries: int, lines: int, time_limit: float | None) -> None:
        self._limit = None if time_limit is None else as_positive("time_limit", time_limit)
        self.ended = False  # before the modes came to an end
        self._entries, self._lines = entries, min(lines, MOST_LINES)
        self._longest = self._entries * self._lines * min(8 * self._lines, PLACES) / _PER_SECOND
        self._start = self._last = time.monotonic()

    def begins(self) -> bool:
        """Tell whether there is time for the next step; where there is none the search has ended."""
        now = time.monotonic()
        self._longest, self._last = max(self._longest, now - self._last), now
        if self._limit is not None:
            self.ended = now - self._start + self._longest > max(_SEARCHED * self._limit, _PATIENCE)
        return not self.ended

    def refuse(self, found: str) -> SizeError:
        """Say that the next step has no time, and what was found."""
        return SizeError(
            f"`frf` has {self._entries} entries of {self._lines} frequency points: {found} after"
            f" {self._last - self._start:.3g} s, and the next step takes about {self._longest:.2g} s, `time_limit` is"
            f" {self._limit:g} s. ",
            Remedy({}, "Take single entries, frf.entry(output, input), fewer points, frf.select, or more time"),
        )

"""Times of day in tables of text, as loggers write them, as seconds."""

from __future__ import annotations

import re
from collections.abc import Iterator

Row = tuple[int, str]  # number and text of a line

# A time of day, with or without its date: "2026-11-30 07:54:00.125", "30.11.2026 07:54:00", "7:54:00.125 PM". Where commas
# separate no columns they may be decimal marks.
_BEFORE = r"(?:\d{1,4}[-./]\d{1,2}[-./]\d{1,4}[ T]\s*)?(?<![\d:.])(\d{1,2}):(\d{2}):"
_BEHIND = r"(?:\s*([AP])M\b|Z\b)?(?![\d:])"
_CLOCK, _WITH_COMMA = (re.compile(rf"{_BEFORE}(\d{{2}}(?:{mark}\d+)?){_BEHIND}") for mark in (r"\.", "[.,]"))
_DAY, _HALF, _NANO = 86400.0, 43200.0, 1e9  # seconds; their parts


def tells_clock_times(line: str) -> bool:
    """Return whether a line holds a time of day."""
    return _CLOCK.search(line) is not None


def in_seconds(rows: Iterator[Row]) -> Iterator[Row]:
    """The lines with the times of day in them as seconds since the midnight before the first; dates are not read.

    A time that is far before that of the line above is one of the next day.
    """
    last: list[float] = []  # of every time in a line

    for number, line in rows:
        place = 0

        def seconds(found: re.Match[str]) -> str:
            nonlocal place
            hours, minutes, rest, half = found.groups()
            of_day = int(hours) % 12 + 12 * (half == "P") if half else int(hours)
            value = 3600 * of_day + 60 * int(minutes) + float(rest.replace(",", "."))
            if place == len(last):
                last.append(value)
            value += _DAY * round((last[place] - value) / _DAY) if last[place] - value > _HALF else 0.0
            last[place] = value
            place += 1
            return f"{round(value * _NANO)}e-9"  # a number whatever the decimal mark is

        yield number, (_WITH_COMMA if ";" in line or "\t" in line else _CLOCK).sub(seconds, line)

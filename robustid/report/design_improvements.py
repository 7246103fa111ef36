"""Improvements of a design: what smaller bounds, range by range, and wider limits would bring, and where to measure."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import cast

import numpy as np

from robustid.controllers import ControllerDesign, Improvement
from robustid.data import FrequencyResponse
from robustid.errors import InputTypeError
from robustid.report.document import Block, Column, Heading, Table, Text, of_numbers
from robustid.report.words import HZ, in_hz_span, number

_WORTH = 1.01  # of what a goal reaches, from which on an improvement is one
_WORDS = (
    "Each is a search from this controller on, with one change, at frequencies: it is not proved, and tells where better data or"
    " a wider limit help most. Of a range the point of the data is named whose bound adds most to what is known where it limits."
)


def as_improvements(value: object) -> tuple[Improvement, ...]:
    """Improvements of a design, checked."""
    found = tuple(cast("Sequence[object]", value)) if isinstance(value, list | tuple) else ()
    if not found or not all(isinstance(one, Improvement) for one in found):
        raise InputTypeError("`sensitivity` of a design must be what its improvements() gives; got another object")
    return cast("tuple[Improvement, ...]", found)


def improvements_section(design: ControllerDesign, rows: Sequence[Improvement]) -> list[Block]:
    """Build the section of what would help."""
    cells = [
        [_change(row), _where(row), _points(design, row), _most(row), _more(row), design.goal.told(row.level)]
        for row in rows
    ]
    heads = (
        Column("change"),
        Column("where"),
        *of_numbers("frequency points there", "most, Hz", "more"),
        Column(design.goal.name),
    )
    return [Heading("What would help"), Text(_WORDS, "soft"), Table(heads, cells)]


def where_to_measure(design: ControllerDesign, rows: Sequence[Improvement]) -> str:
    """Say in which range smaller bounds bring most; empty where in none."""
    ranges = [row for row in rows if math.isfinite(row.high) and row.ratio >= _WORTH]
    if not ranges:
        return ""
    best = max(ranges, key=lambda row: row.ratio)
    count = _points(design, best)
    most = f", above all the one at {_most(best)} Hz" if _most(best) else ""
    return (
        f"Measure better {_where(best)} first, {count} frequency point{'s' * (count != '1')}{most}: bounds times"
        f" {number(best.factor)} there bring {_more(best)} {design.goal.name}."
    )


def _change(row: Improvement) -> str:
    if math.isnan(row.low):
        return f"{row.of.replace('_', ' ')} wider by {number(100 * (row.factor - 1), 3)} %"
    return f"bounds times {number(row.factor)}"


def _where(row: Improvement) -> str:
    if math.isnan(row.low):
        return ""
    if math.isinf(row.high):
        return "everywhere"
    return f"from {in_hz_span(row.low / HZ, row.high / HZ, 4)}"


def _more(row: Improvement) -> str:
    return f"+{number(max(100 * (row.ratio - 1), 0.0), 3)} %"


def _most(row: Improvement) -> str:
    """Frequency in Hz of the point of the data that bears most."""
    return number(row.point / HZ, 4) if math.isfinite(row.point) else ""


def _points(design: ControllerDesign, row: Improvement) -> str:
    """Number of frequency points of all responses in the range of a row."""
    if math.isnan(row.low):
        return ""
    responses = [
        one for each in design.proofs for one in each.band.problem.frequency if isinstance(one, FrequencyResponse)
    ]
    return str(sum(int(np.sum((one.omega >= row.low) & (one.omega <= row.high))) for one in responses))

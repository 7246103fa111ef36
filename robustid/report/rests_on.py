"""What a page shows of the assumptions that a guarantee rests on: the table of `sensitivity`, drawn and in sentences."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from robustid.advice import Sensitivity, Variation
from robustid.errors import InputError, InputTypeError
from robustid.identification import Identification
from robustid.report.charts import HZ, Axis, Chart, Layer, Panel
from robustid.report.facts import unit
from robustid.report.style import ALERT, DATA, NOMINAL, number
from robustid.report.worst_case_facts import at_most

_SAME = 2e-3  # difference of two margins of one problem, at most
_KINDS = {"gain": "gain_bound", "decay": "decay_rate", "lines": "lines"}
_NONE = np.zeros(0)
LEGEND = (
    Layer(name="worst of the frequencies", x=_NONE, y=_NONE, colour=ALERT, dash="dash", marker="square"),
    Layer(name="median over the frequencies", x=_NONE, y=_NONE, colour=NOMINAL, dash="solid", marker="circle"),
    Layer(name="as stated", x=_NONE, y=_NONE, colour=DATA, marker="circle-open", size=2.0),
)
_WORDS = {"gain": "the gain bound", "decay": "the decay rate", "lines": "the number of lines"}


def checked(table: Sensitivity, identification: Identification) -> None:
    """Refuse what isn't a table of sensitivities, or belongs to another problem, as far as its margin tells."""
    if not isinstance(table, Sensitivity):
        raise InputTypeError(f"`sensitivity` must be a Sensitivity, from sensitivity(); got {type(table).__name__}")
    margin, low, high = table.variations[0].margin, identification.margin_lower, identification.margin
    if np.isfinite(margin) and not (1 - _SAME) * low - _SAME <= margin <= (1 + _SAME) * high + _SAME:
        raise InputError(
            f"`sensitivity` is about another problem than the one reported: its margin is {margin:.6g}, that of the"
            f" identification {high:.6g}; compute sensitivity(identification.problem)"
        )


def chart(table: Sensitivity, identification: Identification) -> Chart:
    """Median and largest half-width over each assumption, one panel an assumption, one scale for all."""
    rows = table.variations
    largest = max((row.worst for row in rows if np.isfinite(row.worst)), default=1.0)
    y = Axis(label="half-width / response [%]", range=(0.0, 112 * largest))
    axes = {"gain": f"gain bound K [{unit(identification) or '–'}]", "decay": "decay rate ρ [–]", "lines": "lines [–]"}
    panels = []
    for kind, label in axes.items():
        found = sorted(
            (row for row in rows if row.kind in ("stated", kind)), key=lambda row: getattr(row, _KINDS[kind])
        )
        if len(found) == 1:
            continue
        x = np.array([getattr(row, _KINDS[kind]) for row in found], dtype=float)
        room = 0.12 * np.ptp(x)
        axis = Axis(label=label, range=(float(x.min() - room), float(x.max() + room)))
        panels.append(Panel(title=label.split(" [")[0], x=axis, y=y, layers=_layers(found, x)))
    return Chart(name="sensitivity", panels=tuple(panels))


def _layers(rows: Sequence[Variation], x: np.ndarray) -> tuple[Layer, ...]:
    layers, stated = [], [row.kind == "stated" for row in rows]
    for layer, part in zip(LEGEND, ("worst", "median"), strict=False):
        y = 100 * np.array([getattr(row, part) for row in rows])
        hover = tuple(f"{row.what}: {number(v, 3)} %" for row, v in zip(rows, y, strict=True))
        layers.append(dataclasses.replace(layer, x=x, y=y, hover=hover))
        layers.append(dataclasses.replace(LEGEND[-1], x=x[stated], y=y[stated]))
    return tuple(layers)


def sentence(table: Sensitivity) -> str:
    """With which assumption the guarantee moves most."""
    stated, *others = table.variations
    moved = [(abs(np.log(row.median / stated.median)), row) for row in others if row.median > 0 and stated.median > 0]
    if not moved:
        return "None of the variations leaves a guarantee to compare with: as stated, or with every change, the data don’t fit."
    _, most = max(moved, key=lambda pair: pair[0])
    return (
        f"The guarantee moves most with {_WORDS[most.kind]}: with {_change(most)} the median half-width is"
        f" {at_most(100 * most.median, 3)} % of the response instead of {at_most(100 * stated.median, 3)} %."
    )


def _change(row: Variation) -> str:
    return row.what.replace(" x ", " × ")


class Row(NamedTuple):
    """One variation, as text."""

    what: str
    margin: str
    median: str
    worst: str
    change: str


def rows(table: Sensitivity) -> list[Row]:
    """As stated first; the change is that of the median."""
    stated = table.variations[0].median
    return [
        Row(_change(row), _margin(row), _percent(row.median), _percent(row.worst), _against(row.median, stated))
        for row in table.variations
    ]


def _margin(row: Variation) -> str:
    if np.isnan(row.margin):
        return "not solved"
    return f"{number(row.margin)}{': refuted' if row.margin > 1 else ''}"


def _percent(value: float) -> str:
    return f"{at_most(100 * value, 3)} %" if np.isfinite(value) else "–"


def _against(median: float, stated: float) -> str:
    return f"× {number(median / stated, 3)}" if median > 0 and stated > 0 else "–"


def where(table: Sensitivity) -> str:
    """The frequencies of the table."""
    hz = table.omega / HZ
    return (
        f"{hz.size} frequencies from {number(hz[0])} to {number(hz[-1])} Hz" if hz.size > 1 else f"{number(hz[0])} Hz"
    )

"""Figures of a page as pictures: for a page without scripts, small enough to be sent."""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence
from typing import Any

from robustid.report.charts import Chart
from robustid.report.with_matplotlib import draw
from robustid.report.with_plotly import Figure

MOST_BYTES = 360_000  # of all pictures of a page, as base64
_COLOURS = 96  # of a picture: those of its curves, and steps between
_FIRST = 110  # dots per inch of the picture of the first screen
_FINENESS = (110, 96, 84, 72, 60, 50, 40, 32)  # of the others, tried one after another
_SMALL = 0.6  # fineness of one of many pictures beside each other


def pictures(figures: Sequence[Figure]) -> dict[str, str]:
    """Draw figures as PNG data addresses by their id, as fine as fits into `MOST_BYTES`; the first is always fine."""
    drawn = [draw(Chart(name=one.id, panels=one.panels, linked=True, grid=one.small)) for one in figures]
    found: dict[str, str] = {}
    for dpi in _FINENESS:
        for figure, picture in zip(figures, drawn, strict=True):
            fine = _FIRST if figure is figures[0] else dpi * (_SMALL if figure.small else 1.0)
            found[figure.id] = _address(picture, fine)
        if sum(map(len, found.values())) <= MOST_BYTES:
            break
    return found


def _address(figure: Any, dpi: float) -> str:
    from PIL import Image

    raw, small = io.BytesIO(), io.BytesIO()
    figure.savefig(raw, format="png", dpi=dpi)
    # Every colour counts, those of few points too: not only the frequent ones.
    few = Image.open(raw).convert("RGB").quantize(_COLOURS, method=Image.Quantize.MAXCOVERAGE)
    few.save(small, format="png", optimize=True)
    return f"data:image/png;base64,{base64.b64encode(small.getvalue()).decode()}"

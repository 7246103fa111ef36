"""Figures of a page as pictures: for a page without scripts, small enough to be sent."""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence

from robustid.report.charts import Chart
from robustid.report.with_matplotlib import draw
from robustid.report.with_plotly import Figure

MOST_BYTES = 360_000  # of all pictures of a page, as base64
_COLOURS = 32  # of a picture: those of its curves, and steps between
_FINENESS = (110, 90, 72, 56, 42, 32)  # dots per inch, tried one after another


def pictures(figures: Sequence[Figure]) -> dict[str, str]:
    """Draw figures as PNG data addresses by their id, as fine as fits into `MOST_BYTES`."""
    drawn = {
        figure.id: draw(Chart(name=figure.id, panels=figure.panels, linked=True, grid=figure.small))
        for figure in figures
    }
    found: dict[str, str] = {}
    for dpi in _FINENESS:
        found = {name: _address(one, dpi) for name, one in drawn.items()}
        if sum(map(len, found.values())) <= MOST_BYTES:
            break
    return found


def _address(figure: object, dpi: int) -> str:
    from PIL import Image

    raw, small = io.BytesIO(), io.BytesIO()
    figure.savefig(raw, format="png", dpi=dpi)  # type: ignore[attr-defined]
    Image.open(raw).convert("RGB").quantize(_COLOURS).save(small, format="png", optimize=True)
    return f"data:image/png;base64,{base64.b64encode(small.getvalue()).decode()}"

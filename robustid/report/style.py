"""How things look, in every medium: colours, dashes, and numbers with sensible digits."""

from __future__ import annotations

import math
from typing import Any

# Okabe and Ito's palette: told apart with every kind of colour blindness, and by their grey when printed.
DATA = "#222222"
FAINT = "#8a8a8a"
NOMINAL = "#0072B2"
ALERT = "#D55E00"
FURTHER = ("#009E73", "#CC79A7", "#E69F00", "#56B4E9")
# Colour is never the only difference: models also differ by their dashes and markers.
DASHES = ("dash", "dashdot", "dot")
MARKERS = ("square-open", "diamond-open", "triangle-up-open")

MATPLOTLIB: dict[Any, Any] = {
    "font.size": 9.5,
    "axes.titlesize": 9.5,
    "axes.titlelocation": "left",
    "axes.titlecolor": "#444444",
    "axes.edgecolor": "#8a8a8a",
    "axes.linewidth": 0.7,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#e3e3e3",
    "grid.linewidth": 0.6,
    "axes.axisbelow": True,
    "xtick.color": "#444444",
    "ytick.color": "#444444",
    "legend.frameon": False,
}

_SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def further(index: int) -> tuple[str, str, str]:
    """Colour, dash and marker of the further model number `index`."""
    return FURTHER[index % len(FURTHER)], DASHES[index % len(DASHES)], MARKERS[index % len(MARKERS)]


def number(value: float, digits: int = 4) -> str:
    """A number for people: significant digits, powers of ten as such.

    Examples
    --------
    >>> number(17.67321), number(5.2e-7, 2), number(float("inf")), number(float("nan"))
    ('17.67', '5.2×10⁻⁷', '∞', '–')
    """
    if math.isnan(value):
        return "–"
    if math.isinf(value):
        return "∞" if value > 0 else "−∞"
    text = f"{value:.{digits}g}"
    if "e" in text:
        mantissa, exponent = text.split("e")
        text = f"{mantissa}×10{str(int(exponent)).translate(_SUPERSCRIPT)}"
    return text.replace("-", "−", 1) if text.startswith("-") else text

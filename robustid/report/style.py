"""Looks in every medium: colours, dashes and markers."""

from __future__ import annotations

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
FINE = 0.45  # size of a curve or marker that must not hide what is around it

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


def further(index: int) -> tuple[str, str, str]:
    """Colour, dash and marker of the further model number `index`."""
    return FURTHER[index % len(FURTHER)], DASHES[index % len(DASHES)], MARKERS[index % len(MARKERS)]

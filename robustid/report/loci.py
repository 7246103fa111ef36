"""Generalised Nyquist plot of two measured things: eigenvalues of the product of both, in discs that hold those of every pair."""

from __future__ import annotations

import numpy as np

from robustid.guarantees import Interconnection
from robustid.report.charts import ALERT, FAINT, FINE, NOMINAL, Chart
from robustid.report.value_sets import TURN, plane_layer, square_panel, with_gaps
from robustid.report.words import HZ, number

_MOST = 60  # discs
_WIDE = 3.0  # times the largest eigenvalue, or 1: larger discs say nothing


def loci_chart(result: Interconnection) -> Chart:
    """Eigenvalues of the product of both models, the discs around them, and -1: kept from it where no disc holds it."""
    values, radii = result.loci.ravel(), result.radius.ravel()
    shown = np.flatnonzero(radii <= _WIDE * max(1.0, float(np.abs(values).max())))
    shown = shown[:: max(1, shown.size // _MOST)]
    outlines = [value + radius * TURN for value, radius in zip(values[shown], radii[shown], strict=True)]
    layers = (
        [plane_layer("holds those of every pair", with_gaps(outlines), FAINT, dash="solid", size=FINE)]
        if outlines
        else []
    )
    place = int(np.argmin(np.abs(result.omega - result.frequency)))
    words = f"models at {number(float(result.omega[place]) / HZ, 5)} Hz, which limits"
    layers += [
        plane_layer("models", values, NOMINAL, marker="circle", size=0.4),
        plane_layer(words, result.loci[place], ALERT, marker="diamond"),
        plane_layer("-1", np.array([-1.0 + 0j]), ALERT, marker="x"),
    ]
    title = "Eigenvalues of source times load"
    return Chart("loci", [square_panel(title, "of the eigenvalues [–]", layers)])

"""Modes that were taken from the data and rest on a single frequency point: an outlier may be all that they are."""

from __future__ import annotations

import numpy as np

from robustid.advice.pole_fit import line_data, ratios, residual_rows
from robustid.core import Real, hz_words, plane_of
from robustid.data import Fault, FaultKind, FrequencyResponse
from robustid.estimation import leaving_out

_NARROW = 0.25  # of the line spacing: half-width below which a mode shows on one line only
_AS_WELL = 1.05  # times what the other lines leave with the mode: without it they are followed as well


def suspect_modes(frf: FrequencyResponse, omega: Real, damping: Real) -> tuple[Fault, ...]:
    """Faults of modes much narrower than the line spacing that no line but the nearest one asks for, by natural frequency in rad/s.

    Without that line and without the mode the residuals of least squares at the other poles, beside a smooth remainder, are within
    the bounds, or no larger than with the mode.
    """
    light = np.flatnonzero(np.asarray(damping) < 1)
    whole = frf.select(~frf.missing.all(axis=(1, 2)))
    plane = plane_of(frf.dt, whole.omega)
    data = line_data([whole], plane)
    if not light.size or data.room < light.size:
        return ()
    omega, damping = np.asarray(omega)[light], np.asarray(damping)[light]
    poles = np.log(np.stack(plane.turned(omega, damping), axis=1))
    found: list[Fault] = []
    for k, (place, half) in enumerate(zip(omega, omega * damping, strict=True)):
        line = int(np.argmin(np.abs(whole.omega - place)))
        apart = np.abs(whole.omega - whole.omega[line])
        spacing = float(apart[apart > 0].min(initial=np.inf))
        low, high = whole.omega.min() - spacing, whole.omega.max() + spacing
        if (
            not low <= place <= high or not half < _NARROW * spacing
        ):  # beyond all lines it is a slope, which no one line makes
            continue
        others = data.select(np.arange(whole.omega.size) != line)
        with_, without = (
            float(ratios(residual_rows(one, others)).max()) for one in (poles, np.delete(poles, k, axis=0))
        )
        if without <= max(1.0, _AS_WELL * with_):
            found.append(_suspect(whole, line, float(place), float(damping[k]), half / spacing))
    return tuple(found)


def _suspect(frf: FrequencyResponse, line: int, omega: float, damping: float, part: float) -> Fault:
    words = f"the mode at {hz_words(omega / (2 * np.pi))} with damping {damping:.3g} rests on one frequency point"
    evidence = (
        f"its half-width is {part:.2g} of the line spacing, and without this point the others ask for no such mode. Suspect: the"
        " point may be off; measure between the lines, or leave it out"
    )
    return Fault(FaultKind.OUTLIER, words, evidence, leaving_out(frf, [line]), size=part)

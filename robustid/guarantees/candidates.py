"""Frequencies at which polygons of a band are thought of, and the errors that are known there."""

from __future__ import annotations

import numpy as np

from robustid.core import Real
from robustid.guarantees.linear.functions import Box
from robustid.guarantees.sweep import Known
from robustid.identification import MixedProblem

_GRID = 40  # further candidates, equally spaced
_THIN = 1e-3  # of a frequency, that is left out so near above another one, over a box
_NARROW = 0.25  # and of the half-width of the nearest resonance
_AROUND = 13  # and so many over three times the width of the box of every mode


def candidates_of(band: Known, problem: MixedProblem, omega: Real, box: Box | None = None) -> Real:
    """Frequencies at which polygons are thought of: those of a band, a grid, and some around a box, in the range of the data.

    Beyond it those of the band where its discs are larger than anywhere in it.
    """
    lines = np.concatenate([np.zeros(0), *(f.omega for f in problem.frequency)])
    low, high = band.range
    if lines.size:
        low, high = max(low, float(lines.min())), min(high, float(lines.max()))
    within = (omega >= low) & (omega <= high)
    radius = np.max(band.at(omega)[1], axis=(1, 2))
    beyond = omega[
        ~within & np.isfinite(radius) & (radius > radius[within].max(initial=np.inf if not within.any() else 0.0))
    ]
    inside = omega[within]
    every = [inside, np.linspace(low, high, _GRID)]
    ends: list[list[float]] = [] if box is None else box[0].tolist()
    for least, most in ends:
        first, last = (min(max(end, low), high) for end in (2 * least - most, 2 * most - least))
        every.append(np.linspace(first, last, _AROUND))
    found = np.unique(np.concatenate(every))
    if box is None:
        return np.union1d(found, beyond)
    # A resonance can be narrower than that: at least a few candidates over the half-width of the lightest one in a box.
    nearest = np.argmin(np.abs(found[:, None] - box[0].mean(axis=1)), axis=1)
    narrow = _NARROW * (box[0][:, 0] * box[1][:, 0])[nearest]
    apart = np.minimum(_THIN * found, narrow)
    # Those of the band, at which its error is reported, before the others.
    away = np.abs(found[:, None] - inside).min(axis=1, initial=np.inf)
    found, apart = found[(away == 0) | (away > apart)], apart[(away == 0) | (away > apart)]
    return np.union1d(found[np.diff(found, prepend=-np.inf) > apart], beyond)


def halved(omega: Real, tried: Real) -> tuple[Real, Real]:
    """Frequencies and those halfway between them, with what is known of the former."""
    every = np.empty(2 * omega.size - 1)
    every[::2], every[1::2] = omega, (omega[1:] + omega[:-1]) / 2
    known = np.full((every.size, *tried.shape[1:]), np.nan)
    known[::2] = tried
    return every, known


def in_units(errors: Real, largest: Real) -> Real:
    """Errors (..., ny, nu) over the `largest` (ny, nu); 1 where neither has a bound."""
    shares = np.ones(errors.shape)
    np.divide(errors, largest, out=shares, where=np.isfinite(errors) | np.isfinite(largest))
    return shares


def shares_of(errors: Real, largest: Real) -> Real:
    """Errors (F, ny, nu) in units of the `largest` (ny, nu), (F,): of the entry where that is most."""
    return np.asarray(in_units(errors, largest).max(axis=(1, 2)), dtype=float)

"""Bands of multipliers that are known, as files hold them: checked against the samples of the problem."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from robustid.core import Real
from robustid.guarantees.band import Band
from robustid.guarantees.consistent_set import independent_entries
from robustid.guarantees.linear.amplitudes import Extraction, wide_modes
from robustid.guarantees.linear.entry_band import EntryBand
from robustid.guarantees.linear.functions import functions_of
from robustid.guarantees.linear.samples import Samples, samples_of, seen_in
from robustid.guarantees.nominal import as_frequencies
from robustid.guarantees.refinement import polygons_hold
from robustid.identification import MixedProblem


def band_of_multipliers(
    problem: MixedProblem,
    box: tuple[Real, Real] | None,
    omega: Real,
    model: Any,
    multipliers: Sequence[tuple[Real, NDArray[Any], NDArray[Any], dict[str, NDArray[Any]]]],
    polygons: Any = None,
) -> Band:
    """Make the band of known multipliers; all that it claims follows from them.

    Of every entry angles, points and multipliers of the knots, and the fields of an `Extraction` but for its samples.

    Raises
    ------
    ValueError
        Arrays that do not belong to the problem.
    """
    functions, seen = functions_of(problem, box), seen_in(problem)
    places = independent_entries(problem.entries)
    if len(places) != len(multipliers):
        raise ValueError("its entries are not those of the problem")
    bands: list[EntryBand] = []
    for place, (angles, points, d, proof) in zip(places, multipliers, strict=True):
        samples = samples_of(problem, functions, place, seen)
        extraction = Extraction(samples, **proof)
        fits = multipliers_fit(samples, points, d, angles.size) and extraction_fits(extraction)
        ordered = angles.ndim == 1 and angles.size > 1 and bool(np.all(np.diff(angles) > 0))
        if not (fits and ordered):
            raise ValueError("its multipliers do not belong to the samples of the problem")
        bands.append(EntryBand(samples, extraction, angles, points, d))
    if polygons is not None and not polygons_hold(polygons):
        raise ValueError("its polygons do not follow from their certificates")
    grid = as_frequencies(omega, problem)
    found = Band(problem=problem, omega=grid, bands=tuple(bands), box=box, model=model)
    return found if polygons is None else found.with_polygons(polygons)


def multipliers_fit(samples: Samples, points: NDArray[Any], d: NDArray[Any], count: int) -> bool:
    """Return whether so many rows of points and multipliers belong to the samples."""
    return bool(
        points.shape[:1] == (count,) == d.shape[:1]
        and d.shape[1] == points.shape[1] + samples.rows
        and (not points.size or (points.min() >= 0 and points.max() < samples.angles.size))
        and np.all(np.isfinite(d))
    )


def extraction_fits(found: Extraction) -> bool:
    """Return whether what bounds the amplitudes belongs to the samples.

    Raises
    ------
    ValueError
        It assumes amplitudes that could be proved.
    """
    samples = found.samples
    g = samples.amplitudes
    if not (found.assumed.shape == (g,) == found.about.shape):
        return False
    if np.any(np.isfinite(found.assumed) & ~wide_modes(samples)) or np.any(found.assumed < 0):
        raise ValueError("it assumes amplitudes of modes that can be proved")
    return multipliers_fit(samples, found.points, found.multipliers, g)

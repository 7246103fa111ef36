"""The band that is proved at every frequency, over the pole-uncertainty box where poles were taken from the same data."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from robustid.app.run.settings import Modes
from robustid.core import Real
from robustid.guarantees import Band, WorstCaseError, WorstCaseOverPoles, band, has_box
from robustid.identification import Identification, MixedProblem

if TYPE_CHECKING:
    import control

Box = tuple[Real, Real]  # (M, 2) each: natural frequencies in rad/s, damping ratios

_KNOTS, _KNOTS_OF_BOX = (
    400,
    300,
)  # of a band at once; over a box each takes longer, and the band is wider than between them


def box_of_modes(modes: Modes) -> Box | None:
    """The box that data leave to modes, by rising frequency; None where there is none. Real poles (damping 1) have none."""
    if not modes.hz or modes.damping is None or modes.hz_interval is None or modes.damping_interval is None:
        return None
    order = [k for k in np.argsort(modes.hz).tolist() if modes.damping[k] < 1]
    if not order:
        return None
    hz, damping = (np.asarray(ends, dtype=float)[order] for ends in (modes.hz_interval, modes.damping_interval))
    return 2 * np.pi * hz, damping


def proved_band(result: Identification, box: Box | None, model: control.StateSpace | None = None) -> Band | None:
    """The band; at the poles as they stand where a box does not go with them, None of classes without a gain."""
    if not result.consistent or result.prior.positive_real:
        return None
    return band(result, model=model, box=_held(box, result.problem))


def refined_band(
    band: Band | None, error: WorstCaseError | None, over_poles: WorstCaseOverPoles | None = None
) -> Band | None:
    """The band with the polygons that bound what it does: at exact poles those of the sweep, over a box those over the same box."""
    if band is None:
        return None
    polygons = error if band.box is None else over_poles
    return band if polygons is None or not polygons.omega.size else band.with_polygons(polygons)


def band_at_once(problem: MixedProblem, box: Box | None) -> Band:
    """The band around its centres with few knots, for whoever waits for it; of a class with a gain."""
    held = _held(box, problem)
    return band(problem, box=held, knots=_KNOTS if held is None else _KNOTS_OF_BOX)


def _held(box: Box | None, problem: MixedProblem) -> Box | None:
    """The box, where it goes with the poles."""
    return box if box is not None and has_box(problem.parametric, len(box[0])) else None

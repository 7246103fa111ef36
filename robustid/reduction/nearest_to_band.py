"""The model of an order that is nearest to the centre of a proved band, inside every bound."""

# pyright: reportConstantRedefinition=false
# Matrices have capital letters.
from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from typing import TYPE_CHECKING, NamedTuple, Protocol, runtime_checkable

import numpy as np

from robustid.core import Complex, Real, responses
from robustid.data import FrequencyResponse
from robustid.identification import MixedProblem, largest_ratio
from robustid.reduction.best_models import REFINED, BestModels, Found
from robustid.reduction.between_points import resonances
from robustid.reduction.pole_starts import statespace
from robustid.reduction.sample_fits import Fit, descended, inside, least_squares, normal_functions, numerators_levelled
from robustid.reduction.sample_map import with_lines

if TYPE_CHECKING:
    import control

_STEPS = 15  # of least squares
_HALVINGS = 12  # of the way to a bound
_EVEN = 48  # frequencies beside those of the band, evenly up to its end


@runtime_checkable
class Known(Protocol):
    """Discs that are known to hold the response at every frequency, a `Band` for instance."""

    @property
    def problem(self) -> MixedProblem:
        """The statement that they were proved for."""
        ...

    @property
    def omega(self) -> Real:
        """Frequencies that were asked for, rad/s."""
        ...

    @property
    def range(self) -> tuple[float, float]:
        """Frequencies between which they are known, rad/s."""
        ...

    def at(self, omega: Real) -> tuple[Complex, Real]:
        """Centres and radii, (F, ny, nu) each."""
        ...


class Discs(NamedTuple):
    """Discs of a band at angles: (F,), (F, ny, nu), (F, ny, nu)."""

    angles: Real
    centre: Complex
    radius: Real

    def error(self, model: control.StateSpace) -> float:
        """Mean over all discs of the guaranteed error of a model over its least, the radius."""
        return float(np.mean(np.abs(responses(model, self.angles) - self.centre) / self.radius)) + 1


def discs_of(band: Known, model: control.StateSpace) -> Discs:
    """The discs at the frequencies of a band, evenly up to its end, and around the poles of a model of the image."""
    plane = band.problem.plane
    low, high = plane.angles(np.array(band.range)).tolist()
    own: list[Real] = [plane.angles(band.omega), np.linspace(low, high, _EVEN), resonances(model)]
    angles = np.unique(np.concatenate(own))
    angles = angles[(angles >= low) & (angles <= high) & (angles < np.pi)]
    centre, radius = band.at(plane.omega(angles))
    known = np.isfinite(radius).all(axis=(1, 2)) & (radius > 0).all(axis=(1, 2))
    return Discs(angles[known], centre[known], radius[known])


def move_towards(models: BestModels, order: int, band: Known) -> None:
    """Replace the best model of an order by one of smaller guaranteed error, if any: by least squares of (F - centre)/radius over
    all its parameters; where that leaves a bound of a sample, by numerators as near to it as the bounds allow, towards those with
    the smallest largest ratio. Both keep to the poles, and the bounds are convex in the numerators.
    """
    fit = models.fits.get(order)
    if fit is None or not models.within(order) or not 0 < fit.pair.A.shape[0] <= REFINED:
        return
    before = models.found[order].model
    discs = discs_of(band, before)
    if not discs.angles.size:
        return
    least = discs.error(before)
    for model in _candidates(models, fit, discs):
        # Poles that have moved are looked at too: a resonance between the frequencies of the fit is none.
        here = discs_of(band, model)
        margin = largest_ratio(models.identification.problem, model)
        error = max(discs.error(model), here.error(model))
        if margin <= models.limit and error < least:
            least, models.found[order] = error, Found(margin, margin, model)


def _candidates(models: BestModels, fit: Fit, discs: Discs) -> Iterator[control.StateSpace]:
    """The model of least squares, and the one on the way to it at the first bound."""
    samples, like = models.samples, models.identification.model
    dt = models.identification.problem.dt
    lines = FrequencyResponse(discs.angles / dt, discs.centre, bound=discs.radius, dt=dt)
    target = with_lines(dataclasses.replace(samples, tracks=(), discs=0), lines, models.identification.problem)
    moved = descended(least_squares(target, fit.pair), models.radius, _STEPS)
    pair = normal_functions(inside(moved.pair, models.radius)._replace(size=None), samples.weights)
    wanted = least_squares(target, pair)
    model = statespace(samples, wanted, like)
    yield model
    if largest_ratio(models.identification.problem, model) <= models.limit:
        return
    safe = numerators_levelled(least_squares(samples, pair))
    if safe.worst > models.limit:
        return
    low, high, count = 0.0, 1.0, wanted.fixed.size
    for _ in range(_HALVINGS):
        part = (low + high) / 2
        fixed = (1 - part) * safe.fixed[:count] + part * wanted.fixed
        between = dataclasses.replace(safe, X=(1 - part) * safe.X + part * wanted.X, fixed=fixed)
        model = statespace(samples, between, like)
        if largest_ratio(models.identification.problem, model) <= models.limit:
            low = part
            yield model
        else:
            high = part

"""Combinations of samples that no system of the class leaves so large: the linear certificate of the number zero."""

# pyright: reportConstantRedefinition=false
# Matrices have capital letters.
from __future__ import annotations

import dataclasses
import functools

import numpy as np
from numpy.typing import NDArray

from robustid.core import Complex, Frozen, Real, freeze
from robustid.guarantees.linear.amplitudes import Extraction
from robustid.guarantees.linear.certificate import centres, choose, radii
from robustid.guarantees.linear.predictions import lines_of, nothing, predicted_lines, predicted_rows
from robustid.guarantees.linear.samples import Samples
from robustid.guarantees.linear.search import POINTS, nearest_points, reweighted

_MOST = 4 * POINTS  # points of a combination of all samples together
_STEPS = 30
_TRIED = 3  # predictions from which such combinations start
_HOPE = 0.5  # excess of the worst prediction below which they are not tried: they are seldom twice as large
_INSIDE = 1.0, 0.9  # times the zeta of these: from farther inside more of the circle counts
_BELOW = 1 - 1e-9  # the factor on the bounds: what is proved, just below where the combination is as large as allowed


@dataclasses.dataclass(frozen=True, eq=False)
class Clash(Frozen):
    """Multipliers d of samples, -1 for one of them: what the others say of that one.

    A sum of functionals, d_k f_k, is bounded for all systems by its norm and what it sees of the functions; the sum of the samples
    is no farther from it than sum |d_k| bound_k.
    """

    extraction: Extraction  # of the samples, with the discs of the amplitudes
    base: complex  # zeta from which the harmonic measure is seen
    points: NDArray[np.intp]  # (n,)
    multipliers: Complex  # (n + T,)
    sample: int  # number among the multipliers of the sample that the others predict

    def __post_init__(self) -> None:
        self._set(**{name: freeze(np.asarray(getattr(self, name))) for name in ("points", "multipliers")})

    @property
    def samples(self) -> Samples:
        """All samples of the entry."""
        return self.extraction.samples

    @functools.cached_property
    def own(self) -> tuple[Complex, Real]:
        """The sample that is predicted, and its bound with what the series leave out."""
        chosen = choose(self.samples, nothing(self.samples, np.array([self.base])), self.points[None])
        bound = chosen.bound + chosen.left_out @ self.extraction.known.largest
        return chosen.y[0, self.sample], bound[0, self.sample]

    @functools.cached_property
    def disc(self) -> tuple[Complex, Real]:
        """Centre and radius of the disc that holds zero, if any system keeps all bounds."""
        clash = of_zero(self.extraction, np.array([self.base]), self.points[None], self.multipliers[None])
        return clash[0][0], clash[1][0]

    @property
    def excess(self) -> float:
        """Distance of zero from the centre over the radius: above 1 no system keeps the bounds."""
        centre, radius = self.disc
        return float(np.abs(centre) / radius)

    def at_bounds(self, factor: float) -> Clash:
        """The same multipliers with every bound times a factor."""
        samples = self.samples
        records = tuple(dataclasses.replace(one, bound=factor * one.bound) for one in samples.records)
        wider = dataclasses.replace(samples, bound=factor * samples.bound, records=records)
        return dataclasses.replace(self, extraction=dataclasses.replace(self.extraction, samples=wider))

    @functools.cached_property
    def factor(self) -> float:
        """Factor on all bounds up to which a combination with an excess above 1 refutes: radii are affine in it, as those of
        the amplitudes are.
        """
        size, radius = abs(complex(self.disc[0])), float(self.disc[1])
        slope = float(self.at_bounds(2.0).disc[1]) - radius
        if not slope > 0:
            return np.inf  # all bounds are zero
        found = max(_BELOW * (1 + (size - radius) / slope), 1.0)
        return found if self.at_bounds(found).excess > 1 else 1.0


def of_zero(extraction: Extraction, base: Complex, points: NDArray[np.intp], d: Complex) -> tuple[Complex, Real]:
    """Discs that hold zero if any system keeps the bounds, (B,) each."""
    samples, known = extraction.samples, extraction.known
    targets = nothing(samples, base)
    chosen = choose(samples, targets, points)
    return centres(samples, chosen, targets, d, known), radii(samples, chosen, targets, d, known)


def clash_of(extraction: Extraction) -> Clash | None:
    """The combination that is largest against what systems and bounds allow; None where nothing is known of the amplitudes.

    At first every line, and some samples of the records, as the others predict it; then, unless all of them agree well, all samples
    together, from the worst ones on.
    """
    samples = extraction.samples
    if not np.all(np.isfinite(extraction.known.radius)) or samples.angles.size + samples.rows < 2:
        return None
    each = [*predicted_lines(extraction, lines_of(samples)), *predicted_rows(extraction)]
    best = sorted(
        (
            (float(part.excess[k]), Clash(extraction, *part.proof(k)))
            for part in each
            for k in np.argsort(-part.excess)[:_TRIED].tolist()
        ),
        key=lambda one: -one[0],
    )[:_TRIED]
    found = [one for _, one in best]
    if best and best[0][0] > _HOPE:
        found += [together(dataclasses.replace(one, base=part * one.base)) for one in found for part in _INSIDE]
    return max(found, key=lambda one: one.excess, default=None)


def together(start: Clash) -> Clash:
    """Search the combination of all samples that is 1 and of the smallest radius, from a prediction on."""
    extraction, samples = start.extraction, start.samples
    count = start.points.size
    far = nearest_points(samples, np.array([start.base]), _MOST)[0]
    points = np.concatenate([start.points, far[~np.isin(far, start.points)]])
    added = points.size - count
    d = np.concatenate([start.multipliers[:count], np.zeros(added, complex), start.multipliers[count:]])
    base = np.array([start.base])
    targets = nothing(samples, base)
    chosen = choose(samples, targets, points[None])
    middle, _ = extraction.known.coefficients(samples)
    seen = chosen.y - chosen.values @ middle
    size = complex(seen[0] @ d)
    if size == 0:
        return start
    d = reweighted(samples, chosen, targets, extraction.known, steps=_STEPS, start=d[None] / size, one=seen)[0]
    sample = int(np.argmax(np.abs(d) * chosen.bound[0]))
    if d[sample] == 0:
        return start
    d = -d / d[sample]
    d[sample] = -1
    return Clash(extraction, start.base, points, d, sample)

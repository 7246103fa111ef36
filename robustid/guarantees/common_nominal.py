"""The nominal of several plants: the centres of the smallest discs that hold them all, and a small model of these."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from robustid.core import Complex, Plane, Real, freeze
from robustid.data import FrequencyResponse
from robustid.errors import InputError, RobustIdError
from robustid.fitting import fit_mfd
from robustid.guarantees.nominal import as_nominal
from robustid.guarantees.over_cells import WorstCase
from robustid.identification import Identification

if TYPE_CHECKING:
    import control

_OUTSIDE = 1 + 1e-12  # of a radius: what rounding may put a point of the rim outside
_ROUNDING = 1e-15  # of the extent of the points, besides
_ROUNDS = 100  # exchanges; a handful are needed
_log = logging.getLogger("robustid")
ENOUGH = 1.2  # the band of a nominal may exceed the radius of the smallest disc by so much
_ORDERS = 30  # tried at most
_HELD = np.array([0.25, 0.5, 0.75])  # parts of the way from one frequency to the next where the fit is held too,
_LIGHTER = 0.3  # with a weight so much smaller; and where it is looked at:
_SEEN = np.arange(1, 16) / 16
_FAR = 1.0  # radii: a model farther from what takes the place of the centres has a peak of its own


class Disc(NamedTuple):
    """A closed disc of the complex plane."""

    centre: complex
    radius: float


def smallest_disc(points: Complex) -> Disc:
    """Return the smallest disc that holds all points.

    The exchange of `elzinga1972`: the farthest point joins those on the rim, whose own smallest disc grows every time. A rim of two
    ends of a diameter, or of three points whose triangle is acute, can't be smaller.
    """
    points = np.unique(np.ravel(points))
    middle = complex((points.real.min() + points.real.max()) / 2, (points.imag.min() + points.imag.max()) / 2)
    shifted = points - middle  # so that rounding is relative to the extent of the points, not to where they lie
    rim = [complex(shifted[np.argmax(np.abs(shifted))])]
    found = Disc(rim[0], 0.0)
    slack = _ROUNDING * float(np.abs(shifted).max(initial=0.0))
    for _ in range(_ROUNDS):
        distance = np.abs(shifted - found.centre)
        farthest = int(np.argmax(distance))
        if distance[farthest] <= found.radius * _OUTSIDE + slack:
            break
        found, rim = _of_few([*rim, complex(shifted[farthest])])
    centre = found.centre + middle
    return Disc(centre, float(np.abs(points - centre).max()))


def _of_few(points: list[complex]) -> tuple[Disc, list[complex]]:
    """The smallest disc of two to four points, and those on its rim that hold it."""
    count = len(points)
    pairs = [(i, j) for i in range(count) for j in range(i)]
    triples = [(i, j, k) for i, j in pairs for k in range(j)]
    best, rim = Disc(0j, np.inf), points
    for chosen in (*pairs, *triples):
        held = [points[i] for i in chosen]
        disc = _through(held)
        reach = max(abs(p - disc.centre) for p in points) if np.isfinite(disc.radius) else np.inf
        if reach <= disc.radius * (1 + 1e-10) and reach < best.radius:
            best, rim = Disc(disc.centre, reach), held
    return best, rim


def _through(points: list[complex]) -> Disc:
    """The disc with two points as diameter, or through three; of infinite radius where these are on one line."""
    if len(points) == 2:
        return Disc((points[0] + points[1]) / 2, abs(points[0] - points[1]) / 2)
    a, (b, c) = points[0], (points[1] - points[0], points[2] - points[0])
    cross = (b.conjugate() * c).imag
    if abs(cross) <= 1e-14 * abs(b) * abs(c):
        return Disc(a, np.inf)
    offset = 1j * (b * abs(c) ** 2 - c * abs(b) ** 2) / (2 * cross)
    return Disc(a + offset, abs(offset))


class Centres(NamedTuple):
    """Smallest discs that hold the values of all members, entry by entry: centre and radius, (F, ny, nu) each."""

    centre: Complex
    radius: Real


def centres_of(bounded: Sequence[WorstCase]) -> Centres:
    """Smallest discs around the polygons of all members; InputError for a pole-uncertainty box that is too wide for a bound."""
    shape = bounded[0].upper.shape
    centre, radius = np.zeros(shape, complex), np.zeros(shape)
    for entry in np.ndindex(shape[1:]):
        hulls = [hull for one in bounded if (hull := one.hull(entry)) is not None]
        if len(hulls) < len(bounded):
            raise InputError(
                "`poles`: the pole-uncertainty box of a member is too wide for a bound; allow more `cells`, or measure more"
            )
        for k, parts in enumerate(zip(*hulls, strict=True)):
            centre[k, *entry], radius[k, *entry] = smallest_disc(np.concatenate(parts))
    return Centres(freeze(centre), freeze(radius))


def fitted_nominal(
    identifications: Sequence[Identification],
    omega: Real,
    centres: Centres,
    order: int | None,
    band: Callable[[control.StateSpace], Real],
) -> tuple[control.StateSpace, tuple[tuple[int, float], ...]]:
    """Small stable model near the centres, in units of the radii, and the ratio of its band to the radii at every order tried.

    The smallest order at which the band of the members around it, which `band` gives, exceeds the radius nowhere by more than
    `ENOUGH`; where none does, that with the smallest largest ratio.
    """
    # Between the frequencies, where nothing was solved, the mean of the members' models takes the place of the centres (shifted by
    # what the centres are off it at both sides), and a model farther from it than the radius is none: fits of few points may have
    # peaks between them. Where the plants have an integrator, whose pole a fit would miss, and where no fit is usable, one of the
    # models of the members is taken.
    problem = identifications[0].problem
    radius = np.maximum(centres.radius, 1e-9 * centres.radius.max(axis=0))
    centres = centres._replace(radius=radius)
    seen = _Between.of(identifications, omega, centres, _SEEN)

    def ratio(model: control.StateSpace) -> float:
        return float((band(model) / radius).max())

    found: list[tuple[float, int, control.StateSpace]] = []
    if problem.parametric is None or not problem.parametric.has_integrator:
        held = _Between.of(identifications, omega, centres, _HELD)
        data, weight = _targets(omega, centres, held)
        most = min(2 * omega.size, max(i.model.nstates for i in identifications), 2 * _ORDERS)
        orders = [order] if order is not None else _orders(most, min(problem.entries.outputs, problem.entries.inputs))
        for count in orders:
            model = _fitted(data, weight, count, identifications[0])
            if model is None or seen.away(model) > _FAR:
                continue
            found.append((ratio(model), count, model))
            _log.info("nominal of order %d: its band is at most %.3g times the smallest disc", count, found[-1][0])
            if found[-1][0] <= ENOUGH:
                break
    if not found:
        found = [(ratio(i.model), i.model.nstates, i.model) for i in identifications]
    best = min(found, key=lambda one: one[0])
    return best[2], tuple((count, size) for size, count, _ in found)


class _Between(NamedTuple):
    """Discs in place of those between the frequencies: their angles (N,), centres and radii (N, ny, nu)."""

    plane: Plane
    angles: Real
    centre: Complex
    radius: Real

    @classmethod
    def of(cls, identifications: Sequence[Identification], omega: Real, centres: Centres, parts: Real) -> _Between:
        plane = identifications[0].problem.plane
        angles = plane.angles((omega[:-1, None] + np.diff(omega)[:, None] * parts).ravel())
        models = [i.model for i in identifications]
        mean, at = (
            np.mean([plane.values(m, where) for m in models], axis=0) for where in (angles, plane.angles(omega))
        )
        off, radius = centres.centre - at, centres.radius
        later = np.tile(parts, omega.size - 1)[:, None, None]
        before, after = (np.repeat(part, parts.size, axis=0) for part in (off[:-1], off[1:]))
        shifted: Complex = mean + before + later * (after - before)
        return cls(plane, angles, shifted, np.repeat(np.maximum(radius[:-1], radius[1:]), parts.size, axis=0))

    def away(self, model: control.StateSpace) -> float:
        """Largest distance of a model from the centres, in units of the radii."""
        if not self.angles.size:
            return 0.0
        return float((np.abs(self.plane.values(model, self.angles) - self.centre) / self.radius).max())


def _targets(omega: Real, centres: Centres, between: _Between) -> tuple[FrequencyResponse, Real]:
    """Values that the nominal is fitted to, and the weight of each."""
    points = np.concatenate([omega, between.plane.omega(between.angles)])
    values = np.concatenate([centres.centre, between.centre])
    weight = np.concatenate([1 / centres.radius, _LIGHTER / between.radius])
    order = np.argsort(points, kind="stable")
    return FrequencyResponse(points[order], values[order], dt=between.plane.dt or None), weight[order]


def _orders(most: int, step: int) -> list[int]:
    """Orders from small to large, in steps that a fit of so many inputs or outputs can use; at most a few dozen."""
    counts = np.arange(step, max(most, step) + 1, step)
    return counts[:: max(1, counts.size // _ORDERS)].tolist()


def _fitted(
    data: FrequencyResponse, weight: Real, order: int, identification: Identification
) -> control.StateSpace | None:
    """A stable model of an order; None where the fit fails or isn't usable."""
    try:
        domain = "z" if data.dt else "s"
        fit = fit_mfd(data, order=order, weight=weight, domain=domain, feedthrough=True)
        return as_nominal(fit.model, identification)
    except (RobustIdError, np.linalg.LinAlgError) as error:
        _log.info("no nominal of order %d: %s", order, error)
        return None

"""Certified discs of the amplitudes of the parametric part: linear certificates that extract them from the samples."""

# pyright: reportConstantRedefinition=false
# Matrices have capital letters.
from __future__ import annotations

import dataclasses
import functools

import numpy as np
from numpy.typing import NDArray

from robustid.core import Arrays, Budget, Complex, Frozen, Real, freeze
from robustid.guarantees.linear.certificate import Amplitudes, Targets, choose, class_radius, mismatch
from robustid.guarantees.linear.samples import Samples
from robustid.guarantees.linear.search import POINTS, nearest_points, search

_ROUNDS = 4
_SLACK = 1 + 1e-9
_SILENT = 0.9  # of an amplitude in what a combination that extracts it confuses it with: it extracts nothing
_TIMES, _ENLARGED = 100.0, 4  # larger discs for such ones, and how often
_LARGER = 10.0, 1.0, 100.0, 0.1  # times amplitudes of a fit and the gain: radii to begin with
# Times the discs of a larger box, which are those of amplitudes about another middle and may be too small: then no sums are as good
# as none; and the steps of the search from its sums.
_ROOM, _STEPS = 1.5, 3
_FIRST = 80  # points of the first look around a mode


@dataclasses.dataclass(frozen=True, eq=False)
class Extraction(Frozen):
    """Combinations of the samples that extract every amplitude."""

    samples: Samples
    about: Complex  # (g,), from where the proof measures the amplitudes
    points: NDArray[np.intp]  # (g, n)
    multipliers: Complex  # (g, n + T)

    def __post_init__(self) -> None:
        names = ("about", "points", "multipliers")
        self._set(**{name: freeze(np.asarray(getattr(self, name))) for name in names})

    @property
    def stored(self) -> Arrays:
        """Arrays that are stored of them: all but the samples, which follow from the problem and a box."""
        return {name: getattr(self, name) for name in ("about", "points", "multipliers")}

    @functools.cached_property
    def known(self) -> Amplitudes:
        """The discs that they prove: infinite where the data do not tell the amplitudes apart."""
        if not self.samples.amplitudes:
            return Amplitudes(np.zeros(0, complex), np.zeros(0))
        return discs(self.samples, amplitude_targets(self.samples), self)


def base_of(samples: Samples) -> Complex:
    """Zeta from which the class is seen when an amplitude is extracted: at the frequency of its mode, (g,)."""
    turns = np.tile(samples.functions.turns, len(samples.components))
    return samples.problem.region.points(np.concatenate([turns, np.zeros(samples.transients)]))


def amplitude_targets(samples: Samples) -> Targets:
    """The functionals that take the amplitude out of a system."""
    count = samples.amplitudes
    values = np.zeros((count, samples.amplitude_of.size), complex)
    own = samples.first & ~samples.conjugate
    values[samples.amplitude_of[own], np.flatnonzero(own)] = 1
    return Targets(base_of(samples), np.zeros(count, complex), values, np.zeros((count, count)))


def extract(samples: Samples, budget: Budget | None = None, before: Extraction | None = None) -> Extraction:
    """Search combinations that extract the amplitudes, each round as far as what the last one proved asks for.

    The first matches all functions exactly; where that proves nothing, since many terms of a series ask for large multipliers, it
    begins with discs that are surely too large. Where the budget is over: the best of those so far. From combinations `before`, of
    the same samples with a larger box, one round does, unless it proves nothing.
    """
    targets = amplitude_targets(samples)
    if before is not None and np.all(np.isfinite(before.known.radius)):
        there, centre = (before.points, before.multipliers), before.known.centre
        known = Amplitudes(centre, _ROOM * before.known.radius)
        found = Extraction(samples, centre, *search(samples, targets, known, start=there, steps=_STEPS))
        if np.all(np.isfinite(found.known.radius)):
            return found
    fit = guess(samples, targets)
    large = np.abs(fit) + float(samples.gains.max())
    best = None
    for start in (np.full(large.size, np.inf), *(factor * large for factor in _LARGER)):
        known, rounds, larger = Amplitudes(fit, start), _ROUNDS, _ENLARGED
        while rounds:
            points, d = search(samples, targets, known, points=POINTS + samples.amplitude_of.size, budget=budget)
            found = Extraction(samples, known.centre, points, d)
            if best is None or found.known.radius.sum() < best.known.radius.sum():
                best = found
            over = budget is not None and budget.over
            if np.all(np.isfinite(found.known.radius)):
                known, rounds = found.known, rounds - 1
            else:  # to say nothing of an amplitude costs least where its disc is too small to begin with
                silent = np.isfinite(known.radius) & (np.diag(confusion(samples, targets, found)[2]) > _SILENT)
                known = Amplitudes(known.centre, np.where(silent, _TIMES * known.radius, known.radius))
                done = np.all(np.isfinite(best.known.radius)) or not silent.any() or not larger
                rounds, larger = rounds * (not done), larger - 1
            if over:
                break
        if over or np.all(np.isfinite(best.known.radius)):  # type: ignore[union-attr]
            break
    return best  # type: ignore[return-value]  # there is a round


def discs(samples: Samples, targets: Targets, extraction: Extraction) -> Amplitudes:
    r"""Discs that combinations of the samples prove for all amplitudes at once.

    With u_g = |c_g - q_g| about any q, every combination says u <= b + E u, E >= 0 what it confuses with other amplitudes, with the
    terms of the series and with what these leave out. Where E has a spectral radius below 1, u <= (I - E)^-1 b.
    """
    e, b, E = confusion(samples, targets, extraction)
    found: Real = np.full(b.size, np.inf)
    if np.all(np.isfinite(E)) and np.abs(np.linalg.eigvals(E)).max() < 1:
        solved = np.linalg.solve(np.eye(b.size) - E, b) * _SLACK
        if np.all(solved >= 0) and np.all(b + E @ solved <= solved):
            found[:] = solved
    return Amplitudes(extraction.about + e, found)


def confusion(samples: Samples, targets: Targets, extraction: Extraction) -> tuple[Complex, Real, Real]:
    """Return c - about as the combinations say it, and b, E of `discs`, whose radii count from there."""
    d, at, count, about = extraction.multipliers, samples.amplitude_of, samples.amplitudes, extraction.about
    chosen, first = choose(samples, targets, extraction.points), samples.first
    centre = np.where(first, np.where(samples.conjugate, about[at].conj(), about[at]), 0)
    missed = mismatch(chosen, targets, d)
    e: Complex = (d * chosen.y).sum(axis=1) - missed @ centre - about
    e = np.where(np.bincount(at[first], minlength=count) == 1, np.real(e), e)  # real amplitudes
    size = np.abs(d)
    left = (size[:, :, None] * chosen.left_out).sum(axis=1)  # (g, g): times the largest amplitude
    by = np.zeros((at.size, count))
    by[np.arange(at.size), at] = 1
    near, series = np.abs(missed) @ (by * first[:, None]), np.abs(missed) @ (by * (samples.powers * ~first)[:, None])
    terms = np.abs(chosen.values).swapaxes(1, 2) @ size[:, :, None]
    rounded = 1e-14 * ((terms[:, :, 0] + 1) @ (by * samples.powers[:, None]))
    whole = series + left + rounded
    b = (size * chosen.bound).sum(axis=1) + class_radius(samples, chosen, targets, d) + whole @ np.abs(about + e)
    b = b + near @ np.abs(e) + 1e-13 * (size * np.abs(chosen.y)).sum(axis=1)
    return e, b * (1 + 1e-12), (near + whole) * (1 + 1e-12)


def guess(samples: Samples, targets: Targets) -> Complex:
    """Amplitudes of a least-squares fit with the class as its noise: from where the first proof measures them."""
    count = samples.amplitudes
    if not count or not samples.angles.size + samples.rows:
        return np.zeros(count, complex)
    points = np.unique(nearest_points(samples, targets.base, _FIRST))
    points = np.unique(np.concatenate([points, np.mod(points + samples.angles.size // 2, max(samples.angles.size, 1))]))
    middle = samples.problem.region.points(
        np.array([np.median(np.abs(samples.angles)) if samples.angles.size else 0.0])
    )
    one = Targets(middle, np.zeros(1, complex), targets.values[:1], targets.left_out[:1])
    chosen = choose(samples, one, points[None])
    columns = np.flatnonzero(samples.first)
    P, y, bound = chosen.values[0][:, columns], chosen.y[0], chosen.bound[0]
    unit = 1 / np.maximum(np.linalg.norm(P, axis=0), 1e-300)
    gram = chosen.gram[0]
    noise = np.diag(bound**2 * bound.size + 1e-12 * np.trace(gram).real / y.size)
    factor = np.asarray(np.linalg.cholesky(gram + noise), dtype=complex)  # type: ignore[reportUnknownArgumentType]
    white, seen = (np.asarray(np.linalg.solve(factor, one), dtype=complex) for one in (P * unit, y))
    found = np.asarray(np.linalg.lstsq(white, seen, rcond=1e-9)[0], dtype=complex) * unit
    q: Complex = np.zeros(count, complex)
    plain = ~samples.conjugate[columns]
    own = samples.amplitude_of[columns]
    q[own[plain]] = found[plain]
    return np.where(np.bincount(own, minlength=count) == 1, q.real, q)  # real coefficients

r"""Certified bounds of the amplitudes of modes whose poles lie anywhere in a pole-uncertainty box: from sums over the samples.

Linear certificates bound the amplitude c' = c (1 - |a_1|^2)/(1 - a_1* a) of a mode c n(x)/(1 - a x), for every pole a within the
hyperbolic distance T of a_1. Since |1 - a_1* a| <= (1 - |a_1|^2) + |a_1| T |1 - a_1* a|,

.. math:: |c| \le |c'| / (1 - T |a_1|),

and of a box that reaches the circle c' = c. In continuous time (1 + x)/(1 - a x) = (b - p)/(s - p), b the corner of the map, p the
pole, so that the amplitude of 1/(s - p) is at most |b - p| times as large.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from robustid.core import Arrays, Complex, Real, hz_words, one_thread
from robustid.errors import InputError
from robustid.guarantees.consistent_set import independent_entries, which
from robustid.guarantees.linear.amplitudes import Extraction, extract
from robustid.guarantees.linear.entry_band import extraction_fits
from robustid.guarantees.linear.functions import Functions, functions_of
from robustid.guarantees.linear.samples import Samples, samples_of, seen_in
from robustid.identification import MixedProblem, ball_arithmetic

_WIDER = 1 + 1e-9  # what a few operations round

Extractions = tuple[Extraction, ...]  # of the independent entries


def extractions_over(problem: MixedProblem, omega: Real, damping: Real, before: Extractions = ()) -> Extractions:
    """Search sums that extract the amplitudes of the modes from the samples, for poles anywhere in a box (M, 2), (M, 2).

    Here and below the poles of the parametric part lie in the box. From those `before`, of a larger box, it takes less time.
    """
    every = _samples(problem, omega, damping)
    with one_thread():
        pairs = zip(every, before or [None] * len(every), strict=True)
        return tuple(extract(one, before=known if _of_same(one, known) else None) for one, known in pairs)


def _of_same(samples: Samples, before: Extraction | None) -> bool:
    """Return whether sums are of the same samples: a box that reaches the circle is told nothing by records, its halves may be."""
    return before is not None and before.samples.rows == samples.rows and before.samples.v.shape == samples.v.shape


def extractions_of(problem: MixedProblem, omega: Real, damping: Real, multipliers: Sequence[Arrays]) -> Extractions:
    """The same of known multipliers, the fields of an `Extraction` but for its samples. ValueError for those of other entries."""
    every = _samples(problem, omega, damping)
    if len(every) != len(multipliers):
        raise ValueError("its amplitudes are not those of all entries")
    found = tuple(Extraction(one, **known) for one, known in zip(every, multipliers, strict=True))
    if not all(extraction_fits(one) for one in found):
        raise ValueError("the multipliers of its amplitudes do not belong to the samples of the problem")
    return found


def amplitudes_proved(extraction: Extraction) -> bool:
    """Say whether the sums prove the discs of the amplitudes in ball arithmetic (`robustid[exact]`)."""
    from robustid.guarantees.linear.verification import Sums

    with ball_arithmetic() as flint:
        return Sums(flint, extraction.samples).amplitudes_proved(extraction, extraction.known)


def _samples(problem: MixedProblem, omega: Real, damping: Real) -> list[Samples]:
    rank = modes_by_frequency(problem)
    functions, seen = functions_of(problem, (omega[rank], damping[rank])), seen_in(problem)
    return [samples_of(problem, functions, entry, seen) for entry in independent_entries(problem.entries)]


def modes_by_frequency(problem: MixedProblem) -> NDArray[np.intp]:
    """Numbers of the modes of the parametric part by rising frequency, as linear certificates have them."""
    poles: Complex = problem.parametric.poles
    return np.argsort(np.angle(poles[np.imag(poles) > 0]), kind="stable")


def largest_amplitudes(problem: MixedProblem, omega: Real, damping: Real, extractions: Extractions) -> Real:
    """Proved bounds of the amplitudes c of all modes in every entry, (M, ny, nu), modes in the order of the parametric part.

    InputError: the samples bound no amplitude of some mode by itself.
    """
    rank, found = modes_by_frequency(problem), np.zeros((len(omega), *problem.entries.shape))
    for one in extractions:
        again = dataclasses.replace(one)  # nothing that was computed before is taken over
        functions, (i, j) = again.samples.functions, again.samples.entry
        _check_apart(problem, functions)
        largest = again.known.largest[again.samples.own_amplitudes]
        if not np.all(np.isfinite(largest)):
            mode = int(rank[np.argmax(~np.isfinite(largest))]) + 1
            raise InputError(
                f"the samples{which(problem, (i, j))} prove no bound of the amplitude of mode {mode} with its poles anywhere in"
                " the pole-uncertainty box; measure more frequency points around it or state a smaller box. `band` holds over the"
                " box all the same"
            )
        found[rank, i, j] = largest * _factors(problem, functions, omega[rank], damping[rank])
        if problem.entries.symmetric:
            found[:, j, i] = found[:, i, j]
    return found


def _check_apart(problem: MixedProblem, functions: Functions) -> None:
    """Refuse modes that only have joint amplitudes."""
    modes, first = functions.modes, 0
    for sizes in () if modes is None else modes.sizes:
        count = sizes.shape[1]
        if count > 1:
            angles = np.sort(np.angle(modes.middle[first : first + count]))  # type: ignore[union-attr]
            hz = problem.plane.omega(angles[[0, -1]]) / (2 * np.pi)
            raise InputError(
                f"the pole-uncertainty boxes of {count} modes around {hz_words(hz.mean())} are so close that no data tell their"
                " amplitudes apart; state smaller boxes, measure more frequency points there or take fewer modes. `band` bounds"
                " these modes together, and holds over the box all the same"
            )
        first += count


def _factors(problem: MixedProblem, functions: Functions, omega: Real, damping: Real) -> Real:
    """Largest |c/c'| over the box of every mode, (M,), modes and box by rising frequency."""
    modes: Any = functions.modes
    size = np.where(modes.reach > 0, 1.0, 1 / (1 - modes.distance * np.abs(modes.middle)))
    if problem.dt:
        return size * _WIDER
    plane: Any = problem.plane
    corner = float(plane.corner)
    w, d = omega[:, 1], damping[:, 1]
    away = np.sqrt(corner**2 + 2 * corner * d * w + w**2)
    return size * away * _WIDER

"""A class beside all modes of a response, where those whose places it bounds leave none that says anything."""

from __future__ import annotations

import dataclasses

import numpy as np

from robustid.advice import PriorSuggestion, every_mode, says_something, useful_prior
from robustid.app.run.modes import basis_of
from robustid.app.run.run_file import RunFile
from robustid.app.run.run_folder import Surroundings
from robustid.app.run.settings import Modes
from robustid.core import Real, counted, hz_words
from robustid.data import FrequencyResponse
from robustid.errors import InputError
from robustid.identification import MixedProblem

_SHARE = 0.3  # of the time that is left
_WORDS = (
    "{more} of the response ({hz}): the points bound neither {their} place nor {their} amplitude, and beside the others alone no"
    " class that says anything holds the data; beside all of them one does. {These}, and modes that may lie together with {them},"
    " are taken as exact."
)


def with_every_mode(
    run: RunFile, problem: MixedProblem, around: Surroundings
) -> tuple[RunFile, MixedProblem, PriorSuggestion] | None:
    """The modes that were left to the gain bound beside the others, if a class says something then."""
    frf = next((one for one in problem.frequency if isinstance(one, FrequencyResponse)), None)
    if frf is None:
        return None
    words = "looking for a prior beside all modes"
    try:
        with around.step(words, _SHARE) as limit:
            modes = _beside(run.modes, every_mode(frf, limit))
        if modes is None:
            return None
        wider = dataclasses.replace(problem, parametric=basis_of(modes, problem.dt))
        with around.step(words, _SHARE) as limit:
            found = useful_prior(wider, time_limit=limit, progress=around.told, kept=around.folder.gains)
    except InputError:  # functions that the samples can't tell apart, or no time for the first mode
        return None
    if not (found.complete and says_something(wider, found)):
        return None
    return dataclasses.replace(run, modes=modes), wider, found


def _beside(modes: Modes, every: Real) -> Modes | None:
    """The modes with those that they lack; exact are these, and those that may lie together with one. None where none lacks."""
    hz, damping = every[:, 0] / (2 * np.pi), every[:, 1]
    own, lacks = np.array(modes.hz or (), dtype=float), np.ones(hz.size, bool)
    place: list[int] = []
    for one in own.tolist():
        if not lacks.any():
            return None
        place.append(int(np.argmin(np.where(lacks, np.abs(hz - one), np.inf))))
        lacks[place[-1]] = False
    if not lacks.any():
        return None
    ends = [((a, a), (z, z)) for a, z in zip(hz.tolist(), damping.tolist(), strict=True)]
    boxes = zip(place, modes.hz_interval or (), modes.damping_interval or (), strict=False)
    for k, frequency, ratio in boxes:
        within = frequency[0] <= hz[k] <= frequency[1] and ratio[0] <= damping[k] <= ratio[1]
        low, high = frequency[0] * (1 - ratio[1]), frequency[1] * (1 + ratio[1])  # with half-widths of the heaviest
        if within and not np.any((hz[lacks] >= low) & (hz[lacks] <= high)):
            ends[k] = frequency, ratio
    several = int(lacks.sum()) > 1
    words = _WORDS.format(
        more=counted(int(lacks.sum()), "more mode"),
        hz=", ".join(hz_words(float(one), 4) for one in hz[lacks]),
        their="their" if several else "its",
        These="These" if several else "It",
        them="them" if several else "it",
    )
    return dataclasses.replace(
        modes,
        hz=tuple(hz.tolist()),
        damping=tuple(damping.tolist()),
        hz_interval=tuple(one[0] for one in ends),
        damping_interval=tuple(one[1] for one in ends),
        note=f"{modes.note}\n{words}",
    )

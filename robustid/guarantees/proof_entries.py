"""Entries of a matrix as problems of their own: what samples of one entry prove is a proof file of that entry."""

from __future__ import annotations

import dataclasses

from robustid.errors import InputError
from robustid.guarantees.band_result import Band
from robustid.guarantees.contradictions import Contradiction
from robustid.guarantees.linear.amplitudes import Extraction
from robustid.guarantees.linear.entry_band import EntryBand
from robustid.guarantees.linear.samples import Samples
from robustid.guarantees.proof_question import NOT_YET
from robustid.identification import BoundedReal, MixedProblem, Prior


def words_of(samples: Samples) -> str:
    """Return what the unit of the response of a file says: of which entry it is, counted from 1."""
    output, into = samples.entry
    several = samples.problem.entries.shape != (1, 1)
    return "that of the data" + f", of output {output + 1} and input {into + 1}" * several


def band_of_entry(band: Band, number: int) -> Band:
    """Return the band of an entry, with the model of that entry."""
    one = band.bands[number]
    if one.samples.problem.entries.shape == (1, 1):
        return band
    samples, extraction = _alone(one.samples, one.extraction)
    output, into = one.samples.entry
    model = None if band.model is None else band.model[output, into]
    own = EntryBand(samples, extraction, one.angles, one.points, one.multipliers, one.complete)
    return Band(problem=samples.problem, omega=band.omega, bands=(own,), box=band.box, model=model)


def contradiction_of_entry(found: Contradiction) -> Contradiction:
    """Return the contradiction between samples of one entry: every entry of a consistent matrix would be consistent."""
    if found.problem.entries.shape == (1, 1):
        return found
    samples, extraction = _alone(found.samples, found.extraction)
    return dataclasses.replace(found, problem=samples.problem, extraction=extraction)


def _alone(samples: Samples, extraction: Extraction) -> tuple[Samples, Extraction]:
    """Return the samples in the problem of their entry, whose gain is at most its part of the bound of the matrix."""
    problem, prior = samples.problem, samples.problem.prior
    reasons = {
        "its class is not the ball of one gain bound": type(prior) not in (Prior, BoundedReal)
        or not problem.weighting.trivial,
        "its parameters have intervals": problem.parameter_bounds is not None,
        "samples of several entries are tied together": samples.components != (samples.entry,) or problem.symmetric,
        "its entries have records": bool(problem.time),
    }
    for reason, holds in reasons.items():
        if holds:
            raise InputError(NOT_YET.format(f"it has several inputs or outputs, and {reason}"))
    gain = float(samples.gains[0])
    own = Prior(gain_bound=gain, decay_rate=prior.decay_rate, decay=prior.decay)
    lines = [item.entry(*samples.entry) for item in problem.frequency]
    alone = MixedProblem(frequency=lines, prior=own, parametric=problem.parametric)
    one = dataclasses.replace(samples, problem=alone, entry=(0, 0), components=((0, 0),))
    return one, dataclasses.replace(extraction, samples=one)

"""Ends of a tube at the samples of an output: by semidefinite programs, and by sums where these are too much work."""

from __future__ import annotations

import concurrent.futures
import functools
import logging
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from robustid.core import Budget, Interruptible, Real
from robustid.guarantees.consistent_set import Extreme
from robustid.guarantees.linear.amplitudes import Extraction, extract
from robustid.guarantees.linear.functions import functions_of
from robustid.guarantees.linear.in_time import response_discs
from robustid.guarantees.linear.samples import samples_of
from robustid.guarantees.outputs import Outputs
from robustid.guarantees.sweep import spread_order
from robustid.guarantees.whole_axis import without_long_records
from robustid.identification import Identification, SupportCertificate

_log = logging.getLogger("robustid")

_AT_ONCE = 3.5  # seconds of work, as estimated, that a tube takes unless more is asked for
_SECONDS, _STEPS, _EACH = 2e-10, 5.5, 0.005  # for a multiplication, Newton steps of an end, and for an end besides
_ROUNDED = 1e-9  # of a centre of sums and its radius: what another way of adding them may change


class Ends(NamedTuple):
    """Samples (T,) and their `lower` and `upper` ends, what is `attained` of them (T, 2), and certificates of -y_k and y_k."""

    samples: NDArray[np.intp]
    lower: Real
    upper: Real
    attained: Real
    certificates: tuple[SupportCertificate | None, ...]


def extraction_of(identification: Identification, entry: tuple[int, int]) -> Extraction:
    """Certified discs of the parameters of an entry, poles as stated, by sums of the samples: little work at every size."""
    problem = without_long_records(identification.problem)
    return extract(samples_of(problem, functions_of(problem, None), entry))


def reach_of(extraction: Extraction, parameters: Real) -> Real:
    """Largest distance of the parameters (m,) of an entry from given ones; infinite where functions depend on each other."""
    samples, known = extraction.samples, extraction.known
    if samples.functions.fixed_count < parameters.size:
        return np.full(parameters.size, np.inf)
    own = samples.own_amplitudes
    return np.abs(known.centre[own].real - parameters) + known.radius[own]


def sums_of(extraction: Extraction, u: Real) -> tuple[Real, Real]:
    """Lower and upper ends of the samples of the response to an input (H,), by sums alone."""
    centre, radius = response_discs(extraction, u)
    radius = radius + _ROUNDED * (np.abs(centre) + radius)
    return centre - radius, centre + radius


def little_work(outputs: Outputs, samples: int) -> bool:
    """Tell whether both ends of so many samples, and of the parameters, are a few seconds of work at most."""
    return _seconds(outputs) * 2 * (samples + outputs.consistent.data.rows.P.shape[1]) <= _AT_ONCE


def _seconds(outputs: Outputs) -> float:
    return _EACH + _SECONDS * _STEPS * outputs.consistent.posed.work


def solved_ends(
    outputs: Outputs,
    output: int,
    samples: NDArray[np.intp],
    gap: float,
    executor: concurrent.futures.Executor | None,
    budget: Budget,
) -> Ends:
    """The samples that were bounded within a budget, at least one, in their order."""
    order = spread_order(samples.size) if np.isfinite(budget.left) else range(samples.size)
    work = functools.partial(_ends, outputs, output, gap)
    found: dict[int, tuple[Extreme, Extreme]] = {}
    bounded: Iterable[tuple[Extreme, Extreme]] = (map if executor is None else executor.map)(
        work, samples[list(order)].tolist()
    )
    with Interruptible(lambda: bool(found)) as sweep:
        for k, pair in zip(order, bounded, strict=False):
            found[k] = pair
            budget.tell(len(found), samples.size)
            if budget.over:
                break
    if sweep.interrupted:
        _log.warning("interrupted: %d of %d samples are finished, and returned", len(found), samples.size)
    places = sorted(found)
    pairs = [found[k] for k in places]
    attained = np.array([[-low.attained, high.attained] for low, high in pairs]).reshape(-1, 2)
    return Ends(
        samples[places],
        np.array([-low.upper for low, _ in pairs]),
        np.array([high.upper for _, high in pairs]),
        np.where(np.isfinite(attained), attained, np.nan),
        tuple(end.certificate for pair in pairs for end in pair),
    )


def _ends(outputs: Outputs, output: int, gap: float, sample: int) -> tuple[Extreme, Extreme]:
    return outputs.extreme(sample, -1.0, gap, output), outputs.extreme(sample, 1.0, gap, output)


def ends_by_sums(
    outputs: Outputs,
    output: int,
    sums: tuple[Real, Real],
    gap: float,
    executor: concurrent.futures.Executor | None,
    budget: Budget,
) -> Ends:
    """Every sample at which sums say something, and programs at the widest of so many parts of the horizon as time allows."""
    lower, upper = sums
    count = int(_AT_ONCE / 2 / _seconds(outputs))
    parts = np.array_split(np.arange(lower.size), min(count, lower.size)) if count else []
    widest = np.array([part[np.argmax((upper - lower)[part])] for part in parts], int)
    solved = solved_ends(outputs, output, widest, gap, executor, budget)
    attained, proofs = np.full((lower.size, 2), np.nan), np.full((lower.size, 2), None)
    lower, upper = lower.copy(), upper.copy()
    lower[solved.samples], upper[solved.samples], attained[solved.samples] = solved.lower, solved.upper, solved.attained
    proofs[solved.samples] = np.array(solved.certificates, object).reshape(-1, 2)
    there = np.flatnonzero(np.isfinite(upper - lower))
    return Ends(there, lower[there], upper[there], attained[there], tuple(proofs[there].ravel()))

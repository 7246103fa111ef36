"""Judge of the catalogue of faults: are the right kind among the first two that are named, and its correction given."""

from typing import NamedTuple

import numpy as np

import robustid as rid
import support.fault_relations
import support.fault_responses
import support.fault_samples  # noqa: F401  # they enter theirs in the catalogue
from robustid.estimation import delay_fault
from support.fault_catalogue import CATALOGUE, STRENGTHS, Faulty

__all__ = ["CATALOGUE", "STRENGTHS", "Judged", "catalogue", "faulty_of", "found_faults", "judged", "of_faulty"]
AMONG = 2


class Judged(NamedTuple):
    """Outcome ("named", "no remedy", "other", "silent") and what was said."""

    outcome: str
    said: tuple[str, ...]


def catalogue():
    """All faults, by name."""
    return CATALOGUE


def of_faulty(faulty: Faulty):
    """The faults that are found in measurements."""
    found = []
    if faulty.records:
        found += rid.prepare.record_faults(faulty.records, period=faulty.period)
    if faulty.response is not None and faulty.step is None:
        found += rid.prepare.response_faults(faulty.response)
    if faulty.step is not None:
        found += rid.prepare.experiment_faults(faulty.response, faulty.step)
        found += rid.prepare.record_faults(faulty.step)
    return found


def faulty_of(fault, clean, strength):
    """The measurements with the fault; None where the plant has nothing of the kind."""
    seed = [*map(ord, fault.name + clean.name), STRENGTHS.index(strength)]
    return fault.of(clean, strength, np.random.default_rng(seed))


def judged(fault, clean, strength):
    """None where the plant has nothing of the kind."""
    faulty = faulty_of(fault, clean, strength)
    if faulty is None:
        return None
    found = of_faulty(faulty)
    first = [one for one in found[:AMONG] if one.kind in fault.kinds]
    said = tuple(map(str, found))
    if not found:
        return Judged("silent", said)
    if not first:
        return Judged("other", said)
    if not fault.corrections or any(one.correction.startswith(fault.corrections) for one in first):
        return Judged("named", said)
    return Judged("no remedy", said)


def found_faults(clean):
    """What clean measurements are told."""
    found = list(rid.prepare.record_faults(clean.periodic, period=clean.period)) if clean.periodic else []
    if clean.random:
        found += rid.prepare.record_faults(clean.random)
    if clean.response is not None:
        found += rid.prepare.response_faults(clean.response)
        # Of a plant without a delay; the heater has one, which is asked about.
        found += [] if clean.periodic or (late := delay_fault(clean.response, False, True)) is None else [late]
    if clean.step is not None:
        found += rid.prepare.record_faults(clean.step)
        found += rid.prepare.experiment_faults(clean.response, clean.step)
    return found

"""Parts of answers to other programs: rows of what a command found, by the fields of the schema."""

from __future__ import annotations

import enum
import math
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from robustid.advice import Cause, CommonModes
from robustid.core import Choice, Record
from robustid.data import Fault
from robustid.guarantees import (
    Band,
    LoopBounds,
    Peak,
    RobustStabilityMargin,
    WorstCaseError,
    WorstCaseOverPoles,
    largest_error,
)
from robustid.identification import Comparison, Identification, MixedProblem

if TYPE_CHECKING:
    import control

ASSUMED = (
    "Gain bound, decay rate, number of modes, poles as far as they are stated, and bounds of the samples are assumptions: data"
    " can refute them, never prove them."
)
_STATED = "Poles other than those of the class: it holds for these poles exactly."
_KINDS = {Band: "band", WorstCaseError: "frequencies", WorstCaseOverPoles: "frequencies over poles"}
_MARGINS = "gain_margin", "phase_margin_degrees", "delay_margin_s", "modulus_margin", "disk_margin"


def model_row(model: control.StateSpace, error: float | None = None) -> Record:
    """Size of a model, and what is known beforehand of its error."""
    size = {"order": model.nstates, "outputs": model.noutputs, "inputs": model.ninputs}
    return size | {"dt": model.dt or None, "error_at_most": error}


def difference_row(found: Comparison) -> Record:
    """Two measurements beside each other."""
    outputs, inputs = found.first.outputs, found.first.inputs
    places = [
        {
            "output": str(outputs[one.output]),
            "input": str(inputs[one.input]),
            "from_hz": one.low,
            "to_hz": one.high,
            "times": one.times,
        }
        for one in found.where
    ]
    return {"points": found.omega.size, "by_chance": found.by_chance, "at_hz": found.hz, "places": places}


def mode_rows(found: CommonModes) -> list[Record]:
    """Modes by several setups: what all leave, and which two contradict each other."""
    pairs = {one.mode: list(one.setups) for one in found.disagreements}
    rows = zip(found.freq_hz_interval, found.damping_interval, found.used, found.probability, strict=True)
    return [
        {
            "hz": None if mode in pairs else hz,
            "damping": None if mode in pairs else damping,
            "setups": [name for name, shows in zip(found.names, used, strict=True) if shows],
            "probability": probability,
            "contradicting": pairs.get(mode, []),
        }
        for mode, (hz, damping, used, probability) in enumerate(rows)
    ]


def of_identification(result: Identification) -> Record:
    """Margin, scope and checks of an identification."""
    checks = [
        {"name": one.name, "measured": one.measured, "limit": one.limit, "holds": one.holds}
        for one in result.verification.checks
    ]
    return {
        "margin": {"lower": result.margin_lower, "upper": result.margin},
        "scope": list(result.problem.about),
        "assumed": [ASSUMED],
        "checks": checks,
        "warnings": list(result.warnings),
    }


def of_guarantees(found: Sequence[Band | WorstCaseError | WorstCaseOverPoles]) -> Record:
    """Guaranteed errors, and what none of them covers."""
    rows = [_guarantee(one) for one in found]
    missing = [words for row in rows for words in row.pop("not_covered")]
    circles = [_circle(one) for one in found if isinstance(one, WorstCaseError) and one.known_circle is not None]
    return {"guarantees": [*rows, *circles], "not_covered": list(dict.fromkeys(missing))}


def _guarantee(found: Band | WorstCaseError | WorstCaseOverPoles) -> Record:
    """One bound of the largest singular value of the error, and where it is largest."""
    upper, over_box = found.sigma_upper, isinstance(found, WorstCaseOverPoles)
    known = found.bounded if isinstance(found, Band) else np.isfinite(upper)
    missing: list[str] = []
    if isinstance(found, Band):
        over_box = found.box is not None
        open_ones = f"Nothing is proved from {found.open_words}: the box of a mode there reaches undamped ones."
        nothing = f"Nothing is proved at any frequency: {found.why_nothing}."
        missing += [nothing] if not known.any() else [open_ones] if found.open_ranges else []
    else:
        missing.append("Frequencies between those that were bounded, and beyond them.")
    if isinstance(found, Band | WorstCaseError) and found.unfinished:
        missing.append(found.unfinished)
    if found.problem.parametric is not None and not over_box:
        missing.append(_STATED)
    largest = None
    if known.any():
        at = int(np.argmax(np.where(known, upper, -1.0)))
        largest = largest_error(found) if isinstance(found, Band) else Peak(upper[at], found.omega[at])
    return {
        "of": _KINDS[type(found)],
        "sentence": found.claim if isinstance(found, Band) else found.summary(),
        "at_most": None if largest is None else largest.value,
        "at_hz": None if largest is None else largest.omega / (2 * np.pi),
        "unit": _unit(found.problem),
        "median_percent": found.relative.median if known.any() else None,
        "every_frequency": isinstance(found, Band) and bool(known.any()) and not found.open_ranges,
        "over_poles": over_box,
        "frequencies": int(known.sum()),
        "not_covered": missing,
    }


def _circle(error: WorstCaseError) -> Record:
    """The bound between the frequencies too."""
    circle = error.circle
    return {
        "of": "circle",
        "sentence": circle_words(error),
        "at_most": circle.largest,
        "at_hz": circle.peak / (2 * np.pi),
        "unit": _unit(error.problem),
        "median_percent": None,
        "every_frequency": True,
        "over_poles": False,
        "frequencies": circle.bound.size,
    }


def circle_words(error: WorstCaseError) -> str:
    """The bound on the whole circle in words."""
    found, end = error.circle, "pi/dt" if error.identification.problem.dt else "infinity"
    text = f"|F - model| <= {found.largest:.4g} at every frequency from {found.edges[0]:.4g} rad/s to {end}"
    return text + f" (attained: {found.lower:.4g})" + ("" if found.converged else "; to less accuracy than asked")


def margin_row(name: str, found: RobustStabilityMargin | None, status: enum.Enum | None = None) -> Record:
    """A controller: the verdict, and its robust stability margin with where it is limited."""
    verdict = status or (None if found is None else found.status)
    return {
        "name": name or None,
        "status": None if verdict is None else verdict.name.lower(),
        "sentence": None if verdict is None else verdict.value,
        "robust_stability_margin": None if found is None else found.margin,
        "limited_at_hz": None if found is None else found.frequency / (2 * np.pi),
        "peaks": {},
        **dict.fromkeys(_MARGINS),
        "refuted_by_order": None,
    }


def controller_row(name: str, found: LoopBounds) -> Record:
    """The same with peaks and margins that hold for every consistent plant, and the plant that refutes it."""
    row, margins = margin_row(name, found.stability, found.status), found.margins
    row["peaks"] = {
        name: {"at_most": peak.value, "at_hz": peak.omega / (2 * np.pi)} for name, peak in found.peaks.items()
    }
    if not found.unbounded:
        numbers = list(margins.gain), math.degrees(margins.phase), margins.delay, margins.modulus, margins.disk
        row |= dict(zip(_MARGINS, numbers, strict=True))
    return row | {"refuted_by_order": None if found.refuted_by is None else found.refuted_by.plant.nstates}


def _unit(problem: MixedProblem) -> str | None:
    """Unit of the response, of one input and one output; None where it is not known, or of several."""
    output, input_ = problem.signals
    single = len(problem.outputs) == len(problem.inputs) == 1
    return f"{output.unit}/{input_.unit}" if single and output.unit and input_.unit else None


def problem_of(result: object) -> MixedProblem | None:
    """Statement that a result, or its band, is about."""
    found = getattr(result, "problem", None) or getattr(getattr(result, "band", None), "problem", None)
    return found if isinstance(found, MixedProblem) else None


def faults_of(faults: Iterable[Fault]) -> list[Record]:
    """Probable faults of the data."""
    return [
        {
            "kind": one.kind.value,
            "sentence": one.said_alone,
            "where": one.where or None,
            "record": one.record or None,
            "size": one.size,
            "correction": one.correction or None,
            "undone": one.undone,
        }
        for one in faults
    ]


def cause_row(one: Cause) -> Record:
    """Cause of a contradiction, and what would help."""
    return {
        "sentence": one.cause,
        "evidence": one.evidence or None,
        "change": one.change or None,
        "option": one.option or None,
        "margin": one.margin,
        "solves": one.solves,
    }


def choice_row(one: Choice) -> Record:
    """Value that was left to the program."""
    return {"value": one.value, "source": one.source.value, "reason": one.reason}

"""Answers for other programs: what a command found, as data; sentences are those of the library."""

from __future__ import annotations

import enum
import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from robustid.advice import Cause
from robustid.app.answers.form import Answer, answer, refusal
from robustid.app.look import Look
from robustid.app.run.reading import option_words, values_of_options
from robustid.app.run.work import Work
from robustid.controllers import ControllerDesign
from robustid.core import Choice
from robustid.data import Fault
from robustid.errors import Remedy
from robustid.guarantees import (
    Band,
    Coverage,
    Judgement,
    LoopBounds,
    Refutation,
    RobustStabilityMargin,
    Watch,
    WorstCaseError,
    WorstCaseOverPoles,
)
from robustid.identification import Identification, MixedProblem

_ASSUMED = (
    "Gain bound, decay rate, number of modes, poles as far as they are stated, and bounds of the samples are assumptions: data"
    " can refute them, never prove them."
)
_STATED = "Poles other than those of the class: it holds for these poles exactly."
_KINDS = {Band: "band", WorstCaseError: "frequencies", WorstCaseOverPoles: "frequencies over poles"}
_MARGINS = "gain_margin", "phase_margin_degrees", "delay_margin_s", "modulus_margin", "disk_margin"


def looked(found: Sequence[Look], exit_code: int) -> Answer:
    """Contents of files; of one that can't be read yet the refusal."""
    contents = [
        {
            "file": one.path,
            "read_as": None if one.data is None else repr(one.data),
            "how": one.how,
            "items": [{"address": address, "shape": shape, "words": words} for address, shape, words in one.rows],
        }
        for one in found
    ]
    open_ones = [one for one in found if one.data is None]
    status = "unread" if open_ones else "read"
    sentence = "; ".join(one.refusal for one in open_ones) or "Every file can be read as it is."
    return answer(
        "look",
        status,
        sentence,
        exit_code,
        contents=contents,
        faults=_faults(fault for one in found for fault in one.faults),
        next=[line for one in found for line in one.next],
        warnings=[
            f"{one.path} states no error bound; one taken from the data: {one.bound}" for one in found if one.bound
        ],
        summary="\n".join(one.summary() for one in found),
        refusal=_open_question(open_ones[0]) if open_ones else None,
    )


def _open_question(found: Look) -> dict[str, Any]:
    """The refusal of a file as `identify` would have it: its arguments by their options."""
    kind = found.kind or ("frequency" if found.argument == "frequency_unit" else "time")
    argument = found.argument or next(iter(found.unknown), None)
    asked = None if argument is None else option_words(kind).get(argument, argument)
    return refusal(asked, None, values_of_options(Remedy(found.arguments), kind))


def identified(work: Work, files: Iterable[Path], exit_code: int) -> Answer:
    """The verdict on a class, with the band that is proved and what would resolve a contradiction."""
    result, status = work.identification, work.identification.verified_status
    bands = [] if work.band is None else [work.band]
    unfinished = work.around.unfinished
    causes = [] if work.diagnosis is None else [*work.diagnosis.causes, *work.diagnosis.corrections]
    next_ = [] if work.undoing is None else [line for line in (work.undoing.paste, work.undoing.then) if line]
    return answer(
        "identify",
        status.name.lower(),
        status.value + result.problem.scope,
        exit_code,
        **_of_identification(result),
        **_of_guarantees(bands),
        faults=_faults(result.problem.data_faults),
        causes=[_cause(one) for one in causes],
        choices={name: _choice(one) for name, one in result.choices.items()},
        unfinished=None if unfinished is None else unfinished.sentence,
        files=[str(path) for path in files],
        next=next_,
        summary="\n".join([result.summary(), *(one.summary() for one in bands)]),
    )


def bounded(
    identification: Identification,
    guarantees: Sequence[Band | WorstCaseError | WorstCaseOverPoles],
    files: Iterable[Path],
    margins: Mapping[str, RobustStabilityMargin],
    exit_code: int,
) -> Answer:
    """Bounds of the error of every consistent system, each with what it covers."""
    status = "failed" if exit_code else "verified"
    sentence = "Every certificate holds." if not exit_code else "A certificate does not hold: verify names it."
    return answer(
        "bounds",
        status,
        sentence,
        exit_code,
        **_of_identification(identification),
        **_of_guarantees(guarantees),
        faults=_faults(identification.problem.data_faults),
        files=[str(path) for path in files],
        controllers=[_margin(name, one) for name, one in margins.items()],
        summary="\n".join(one.summary() for one in guarantees),
    )


def verified(result: Any, failed: Sequence[str], exit_code: int) -> Answer:
    """The proofs of a file, evaluated again: what holds, and the names of what does not."""
    identification = getattr(result, "identification", result)
    of_class = _of_identification(identification) if isinstance(identification, Identification) else {}
    bounds = [result] if isinstance(result, Band | WorstCaseError | WorstCaseOverPoles) else []
    said = f" Its claim is: {result.status.value}." if isinstance(result, Identification) else ""
    status, sentence = "verified", f"Every proof in the file holds.{said}"
    if failed:
        status, sentence = "failed", f"Not verified: {'; '.join(failed)}."
    elif isinstance(result, ControllerDesign) and not result.proofs:
        status, sentence = "undecided", "The file holds what a search found: it has no proof."
    of_loop = {"controllers": [_controller("", result)]} if isinstance(result, LoopBounds) else {}
    problem = _problem_of(result)
    return answer(
        "verify",
        status,
        sentence,
        exit_code,
        **of_class,
        **_of_guarantees(bounds),
        **of_loop,
        faults=[] if problem is None else _faults(problem.data_faults),
        summary=result.summary(),
    )


def contradicted(found: Refutation | Coverage, faults: Iterable[Fault], exit_code: int) -> Answer:
    """New samples against everything that is consistent, or a band: the verdict, and the sample that is furthest outside."""
    status, sentence = verdict_of(found)
    if isinstance(found, Refutation):
        kind, index, at, ratio, attainable = found.worst
        worst: dict[str, Any] = {"kind": kind, "experiment": index + 1, "ratio": ratio, "attainable": attainable}
        worst |= {"at_hz": at / (2 * np.pi), "at_s": None} if kind == "frequency" else {"at_hz": None, "at_s": at}
        count, of_class = found.ratio, _of_identification(found.identification)
    else:
        excess = np.where(np.isfinite(found.error), found.excess, -1.0)
        record, at, *_ = np.unravel_index(np.argmax(excess), excess.shape)
        worst = {"kind": "frequency", "experiment": int(record) + 1, "ratio": found.largest, "attainable": None}
        worst |= {"at_hz": found.omega[at] / (2 * np.pi), "at_s": None}
        count, of_class = found.excess[np.isfinite(found.error)], {"assumed": [_ASSUMED]}
    return answer(
        "refute",
        status,
        sentence,
        exit_code,
        samples={"count": count.size, "refuted": int(np.sum(count > 1)), "worst": worst},
        **of_class,
        faults=_faults(faults),
        summary=found.summary(),
    )


def watched(found: Watch, faults: Iterable[Fault], files: Iterable[Path], exit_code: int) -> Answer:
    """What a watch says of all its records: the worst alarm so far."""
    status = "refuted" if found.refuted else "drifted" if found.drifted else "quiet"
    return answer(
        "watch",
        status,
        found.verdict,
        exit_code,
        assumed=[_ASSUMED, "for the rate of a drift: records are exchangeable while nothing changes"],
        faults=_faults(faults),
        files=[str(path) for path in files],
        summary=found.summary(),
    )


def verdict_of(found: Refutation | Coverage) -> tuple[str, str]:
    """The verdict on new data in a word, refuted, inside or undecided, and in sentences."""
    if isinstance(found, Refutation):
        return found.verdict
    word = {Judgement.CONTRADICTED: "refuted", Judgement.SUPPORTED: "inside", Judgement.NOT_TESTED: "undecided"}
    return word[found.judgement], " ".join(found.sentences)


def tried(found: Mapping[str, LoopBounds], files: Iterable[Path], exit_code: int) -> Answer:
    """Controllers with every consistent plant; the status is that of the worst."""
    order = ("STABLE", "UNDECIDED", "UNSTABLE")
    worst = max(found.values(), key=lambda one: order.index(one.status.name))
    problem = worst.band.problem
    return answer(
        "loop",
        worst.status.name.lower(),
        worst.status.value + problem.scope,
        exit_code,
        controllers=[_controller(name, one) for name, one in found.items()],
        scope=[*problem.about],
        assumed=[_ASSUMED],
        not_covered=list(dict.fromkeys(one.unbounded for one in found.values() if one.unbounded)),
        faults=_faults(problem.data_faults),
        files=[str(path) for path in files],
        summary="\n".join(one.summary() for one in found.values()),
    )


def _of_identification(result: Identification) -> dict[str, Any]:
    """Margin, scope and checks of an identification."""
    checks = [
        {"name": one.name, "measured": one.measured, "limit": one.limit, "holds": one.holds}
        for one in result.verification.checks
    ]
    return {
        "margin": {"lower": result.margin_lower, "upper": result.margin},
        "scope": list(result.problem.about),
        "assumed": [_ASSUMED],
        "checks": checks,
        "warnings": list(result.warnings),
    }


def _of_guarantees(found: Sequence[Band | WorstCaseError | WorstCaseOverPoles]) -> dict[str, Any]:
    """Guaranteed errors, and what none of them covers."""
    rows = [_guarantee(one) for one in found]
    missing = [words for row in rows for words in row.pop("not_covered")]
    circles = [_circle(one) for one in found if isinstance(one, WorstCaseError) and one.known_circle is not None]
    return {"guarantees": [*rows, *circles], "not_covered": list(dict.fromkeys(missing))}


def _guarantee(found: Band | WorstCaseError | WorstCaseOverPoles) -> dict[str, Any]:
    """One bound of the largest singular value of the error, at the frequency where it is largest."""
    upper, over_box = found.sigma_upper, isinstance(found, WorstCaseOverPoles)
    missing: list[str] = []
    if isinstance(found, Band):
        over_box = found.box is not None
        open_ones = f"Nothing is proved from {found.open_words}: the box of a mode there reaches undamped ones."
        missing += [open_ones] if found.open_ranges else []
        missing += [f"{found.why_nothing[0].upper()}{found.why_nothing[1:]}."] if not found.bounded.any() else []
    else:
        missing.append("Frequencies between those that were bounded, and beyond them.")
    if isinstance(found, Band | WorstCaseError) and found.unfinished:
        missing.append(found.unfinished)
    if found.problem.parametric is not None and not over_box:
        missing.append(_STATED)
    known = np.isfinite(upper)
    at = int(np.argmax(np.where(known, upper, -1.0))) if known.any() else None
    return {
        "of": _KINDS[type(found)],
        "sentence": found.claim if isinstance(found, Band) else found.summary(),
        "at_most": None if at is None else upper[at],
        "at_hz": None if at is None else found.omega[at] / (2 * np.pi),
        "unit": _unit(found.problem),
        "median_percent": found.relative.median if known.any() else None,
        "every_frequency": isinstance(found, Band) and bool(known.any()) and not found.open_ranges,
        "over_poles": over_box,
        "frequencies": int(known.sum()),
        "not_covered": missing,
    }


def _circle(error: WorstCaseError) -> dict[str, Any]:
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


def _margin(name: str, found: RobustStabilityMargin | None, status: enum.Enum | None = None) -> dict[str, Any]:
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


def _controller(name: str, found: LoopBounds) -> dict[str, Any]:
    """The same with peaks and margins that hold for every consistent plant, and the plant that refutes it."""
    row, margins = _margin(name, found.stability, found.status), found.margins
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


def _problem_of(result: Any) -> MixedProblem | None:
    found = getattr(result, "problem", None) or getattr(getattr(result, "band", None), "problem", None)
    return found if isinstance(found, MixedProblem) else None


def _faults(faults: Iterable[Fault]) -> list[dict[str, Any]]:
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


def _cause(one: Cause) -> dict[str, Any]:
    return {
        "sentence": one.cause,
        "evidence": one.evidence or None,
        "change": one.change or None,
        "option": one.option or None,
        "margin": one.margin,
        "solves": one.solves,
    }


def _choice(one: Choice) -> dict[str, Any]:
    return {"value": one.value, "source": one.source.value, "reason": one.reason}

"""Answers for other programs: what a command found, as data; sentences are those of the library."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from robustid.advice import CommonModes
from robustid.app.answers.form import Answer, answer, refusal
from robustid.app.answers.parts import (
    ASSUMED,
    cause_row,
    choice_row,
    controller_row,
    difference_row,
    faults_of,
    margin_row,
    mode_rows,
    model_row,
    of_guarantees,
    of_identification,
    problem_of,
)
from robustid.app.look import Look
from robustid.app.run.reading import option_words, values_of_options
from robustid.app.run.results import FamilyRun, IdentifiedReduced
from robustid.app.run.work import Work
from robustid.controllers import ControllerDesign
from robustid.core import Options, Record, counted
from robustid.data import Fault, FrequencyResponse
from robustid.errors import Remedy
from robustid.fitting import MatrixFraction
from robustid.guarantees import (
    Band,
    Coverage,
    Interconnection,
    Judgement,
    LoopBounds,
    Refutation,
    RobustStabilityMargin,
    Watch,
    WorstCaseError,
    WorstCaseOverPoles,
)
from robustid.identification import Comparison, Identification, MixedProblem, Validation
from robustid.reduction import Reduction
from robustid.report import Document


def looked(found: Sequence[Look], exit_code: int) -> Answer:
    """Contents of files; of one that can't be read yet the refusal."""
    contents = [
        {
            "file": one.path,
            "read_as": one.read_as or None,
            "how": one.how,
            "items": [{"address": address, "shape": shape, "words": words} for address, shape, words in one.rows],
        }
        for one in found
    ]
    open_ones = [one for one in found if one.found is None]
    status = "unread" if open_ones else "read"
    sentence = "; ".join(one.refusal for one in open_ones) or "Every file can be read as it is."
    return answer(
        "look",
        status,
        sentence,
        exit_code,
        contents=contents,
        faults=faults_of(fault for one in found for fault in one.faults),
        next=[line for one in found for line in one.next],
        warnings=[
            f"{one.path} states no error bound; one taken from the data: {one.bound}" for one in found if one.bound
        ],
        summary="\n".join(one.summary() for one in found),
        refusal=_open_question(open_ones[0]) if open_ones else None,
    )


def _open_question(found: Look) -> Record:
    """The refusal of a file as `identify` would have it: its arguments by their options."""
    kind = found.asked_kind
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
        **of_identification(result),
        **of_guarantees(bands),
        faults=faults_of(result.problem.data_faults),
        causes=[cause_row(one) for one in causes],
        choices={name: choice_row(one) for name, one in result.choices.items()},
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
    found = of_guarantees(guarantees)
    if not exit_code and all(row["at_most"] is None for row in found["guarantees"]):
        sentence = "Every certificate holds, but none bounds the error at any frequency."
    return answer(
        "bounds",
        status,
        sentence,
        exit_code,
        **of_identification(identification),
        **found,
        faults=faults_of(identification.problem.data_faults),
        files=[str(path) for path in files],
        controllers=[margin_row(name, one) for name, one in margins.items()],
        summary="\n".join(one.summary() for one in guarantees),
    )


def verified(result: Any, failed: Sequence[str], exit_code: int, by: str) -> Answer:
    """The proofs of a file, evaluated again: what holds, by whom it was checked, and the names of what does not."""
    identification = getattr(result, "identification", result)
    of_class = of_identification(identification) if isinstance(identification, Identification) else {}
    bounds = [result] if isinstance(result, Band | WorstCaseError | WorstCaseOverPoles) else []
    said = f" Its claim is: {result.status.value}." if isinstance(result, Identification) else ""
    status, sentence = "verified", f"Every proof in the file holds, checked by {by}.{said}"
    if failed:
        status, sentence = "failed", f"Not verified: {'; '.join(failed)}; checked by {by}."
    elif isinstance(result, ControllerDesign) and not result.proofs:
        status, sentence = "undecided", "The file holds what a search found: it has no proof."
    of_loop = {"controllers": [controller_row("", result)]} if isinstance(result, LoopBounds) else {}
    problem = problem_of(result)
    return answer(
        "verify",
        status,
        sentence,
        exit_code,
        **of_class,
        **of_guarantees(bounds),
        **of_loop,
        faults=[] if problem is None else faults_of(problem.data_faults),
        summary=result.summary(),
    )


def contradicted(found: Refutation | Coverage, faults: Iterable[Fault], exit_code: int) -> Answer:
    """New samples against everything that is consistent, or a band: the verdict, and the sample that is furthest outside."""
    status, sentence = verdict_of(found)
    if isinstance(found, Refutation):
        kind, index, at, ratio, attainable = found.worst
        worst: Record = {"kind": kind, "experiment": index + 1, "ratio": ratio, "attainable": attainable}
        worst |= {"at_hz": at / (2 * np.pi), "at_s": None} if kind == "frequency" else {"at_hz": None, "at_s": at}
        count, of_class = found.ratio, of_identification(found.identification)
    else:
        excess = np.where(np.isfinite(found.error), found.excess, -1.0)
        record, at, *_ = np.unravel_index(np.argmax(excess), excess.shape)
        worst = {"kind": "frequency", "experiment": int(record) + 1, "ratio": found.largest, "attainable": None}
        worst |= {"at_hz": found.omega[at] / (2 * np.pi), "at_s": None}
        count, of_class = found.excess[np.isfinite(found.error)], {"assumed": [ASSUMED]}
    return answer(
        "refute",
        status,
        sentence,
        exit_code,
        samples={"count": count.size, "refuted": int(np.sum(count > 1)), "worst": worst},
        **of_class,
        faults=faults_of(faults),
        summary=found.summary(),
    )


def watched(found: Watch, faults: Iterable[Fault], files: Iterable[Path], exit_code: int) -> Answer:
    """Records of a watch: the worst alarm so far."""
    status = "refuted" if found.refuted else "drifted" if found.drifted else "quiet"
    return answer(
        "watch",
        status,
        found.verdict,
        exit_code,
        assumed=[ASSUMED, "for the rate of a drift: records are exchangeable while nothing changes"],
        faults=faults_of(faults),
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
        controllers=[controller_row(name, one) for name, one in found.items()],
        scope=[*problem.about],
        assumed=[ASSUMED],
        not_covered=list(dict.fromkeys(one.unbounded for one in found.values() if one.unbounded)),
        faults=faults_of(problem.data_faults),
        files=[str(path) for path in files],
        summary="\n".join(one.summary() for one in found.values()),
    )


def concluded(
    command: str, status: str, head: Document, exit_code: int, files: Iterable[Path | None], **found: object
) -> Answer:
    """A command by the first screen of what it found, which says the same to people; `found`: what is typed besides."""
    said, numbers = head.verdict, [{"what": what, "words": words} for what, words in head.numbers]
    own = {
        "numbers": numbers,
        "not_covered": [head.glance.not_covered] if head.glance.not_covered else [],
        "warnings": head.warnings,
        "files": [str(path) for path in files if path is not None],
        "summary": "\n".join(
            [*([] if said is None else [said.words]), *(f"{one['what']}: {one['words']}" for one in numbers)]
        ),
    }
    return answer(command, status, "" if said is None else said.said, exit_code, **own | found)


def estimated(found: FrequencyResponse, head: Document, files: Iterable[Path | None]) -> Answer:
    """A response that was estimated from records."""
    return concluded("frf", "estimated", head, 0, files, faults=faults_of(found.faults))


def fitted(
    found: MatrixFraction,
    status: str,
    faults: Iterable[Fault],
    head: Document,
    exit_code: int,
    files: Iterable[Path | None],
) -> Answer:
    """A matrix fraction."""
    left_out = None if found.unfinished is None else found.unfinished.sentence
    own: Record = {"model": model_row(found.model), "faults": faults_of(faults), "unfinished": left_out}
    return concluded("fit", status, head, exit_code, files, **own)


def compared(found: Comparison, head: Document, exit_code: int, files: Iterable[Path | None]) -> Answer:
    """Two measurements."""
    own = {"difference": difference_row(found), "faults": faults_of([*found.first.faults, *found.second.faults])}
    word = "differ" if found.differ else "alike"
    return concluded("compare", word, head, exit_code, files, **own, summary=found.summary())


def setups_compared(
    found: CommonModes, faults: Iterable[Fault], head: Document, exit_code: int, files: Iterable[Path | None]
) -> Answer:
    """Modes of several setups."""
    own = {"modes": mode_rows(found), "faults": faults_of(faults), "assumed": found.assumed}
    word = "undecided" if not found.compared else "differ" if found.disagreements else "alike"
    return concluded("compare", word, head, exit_code, files, **own, summary=found.summary())


def connected(
    found: Interconnection, parts: Iterable[object], head: Document, exit_code: int, files: Iterable[Path | None]
) -> Answer:
    """Two parts of a loop, every pair of them."""
    problems = [problem for one in parts if (problem := problem_of(one)) is not None]
    own = {
        "faults": faults_of(fault for one in problems for fault in one.data_faults),
        "assumed": [ASSUMED] * bool(problems),
    }
    return concluded("connect", found.status.name.lower(), head, exit_code, files, **own, summary=found.summary())


def ran(result: IdentifiedReduced | FamilyRun, status: str, exit_code: int, files: Iterable[Path]) -> Answer:
    """A whole run: of one plant with everything that is guaranteed of it."""
    found: Record = {"unfinished": None if result.unfinished is None else result.unfinished.sentence}
    found["model"] = None if result.model is None else model_row(result.model)
    identifications = (
        [result.identification] if isinstance(result, IdentifiedReduced) else result.identifications.values()
    )
    found["faults"] = faults_of(fault for one in identifications for fault in one.problem.data_faults)
    found["choices"] = {name: choice_row(one) for name, one in result.run_file.choices.items()}
    if isinstance(result, IdentifiedReduced):
        bounds = [one for one in (result.band, result.error, result.over_poles) if one is not None]
        causes = [] if result.diagnosis is None else [*result.diagnosis.causes, *result.diagnosis.corrections]
        found |= of_identification(result.identification) | of_guarantees(bounds)
        found["causes"] = [cause_row(one) for one in causes]
        found["controllers"] = [controller_row(name, one) for name, one in result.candidates.items()]
    return concluded("run", status, result.first_screen(), exit_code, files, **found, summary=result.summary())


def smaller(found: Reduction, status: str, exit_code: int, file: Path, about: MixedProblem | None) -> Answer:
    """A smaller model."""
    return answer(
        "reduce",
        status,
        found.status.value,
        exit_code,
        model=model_row(found.model, found.bound),
        faults=[] if about is None else faults_of(about.data_faults),
        files=[str(file)],
        warnings=[found.stopped] if found.stopped else [],
    )


def held_against(found: Validation, exit_code: int) -> Answer:
    """A model beside a measurement."""
    status = "undecided" if found.outside is None else "refuted" if found.outside else "inside"
    sentence = {
        "undecided": "Nothing says how large the errors of the measurement are.",
        "refuted": f"The model is outside the bounds of {counted(found.outside or 0, 'sample')}.",
        "inside": "The model is inside the bounds of all samples.",
    }[status]
    return answer("compare", status, sentence, exit_code, summary=found.summary())


def designed(found: ControllerDesign, head: Document, exit_code: int, files: Iterable[Path | None]) -> Answer:
    """A controller that was designed, with what is proved of it for the plants of every band."""
    rows = [controller_row("", one) for one in found.proofs]
    model = None if found.controller is None or found.status.name == "NONE" else model_row(found.controller)
    faults = [fault for one in found.proofs for fault in one.band.problem.data_faults]
    how: Options = {"controllers": rows, "model": model, "faults": faults_of(faults), "assumed": [ASSUMED]}
    status = found.status.name.lower()
    return concluded("control", status, head, exit_code, files, **how, summary=found.summary())

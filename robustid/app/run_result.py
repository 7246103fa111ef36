"""What a run finds, and the folder in which it is kept."""

from __future__ import annotations

import dataclasses
import os
import shutil
from pathlib import Path
from typing import TYPE_CHECKING

from robustid.app.files import load_result
from robustid.app.run_file import RunFile, read_run_file
from robustid.core import Frozen, atomic_write, digest, paths, save, text_array
from robustid.data import FrequencyResponse
from robustid.data.io import save_model
from robustid.errors import InputError, Status
from robustid.guarantees import WorstCaseError, WorstCaseOverPoles
from robustid.identification import Identification, MixedProblem, describe_problem
from robustid.reduction import Reduction

if TYPE_CHECKING:
    import control

RUN_FILE = "run.toml"
_NUMBERS = ("identification", "worst_case", "over_poles")
_PAGE, _MODEL, _SUMMARY, _LINES, _UNFINISHED = (
    "report.html",
    "small_model.npz",
    "summary.txt",
    "response-{}.csv",
    "unfinished",
)


@dataclasses.dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class IdentifiedReduced(Frozen):
    """What was found on the way from measurements to a small model, and how.

    Attributes
    ----------
    identification : Identification
    reduction : Reduction
        The smallest model that was found inside the bounds (those times the margin, where the data contradict the class).
    worst_case, error : WorstCaseError or None
        Around the identified model, and around the small one; None where it wasn't asked for, or nothing is consistent.
    over_poles : WorstCaseOverPoles or None
        With the poles anywhere in their box, around the small model.
    findings : tuple of str
        What can be said, in sentences: the contradiction and what would resolve it, samples outside their bounds, the error of
        the small model.
    run_file : RunFile
        Every choice, made explicit; `run_file.text()` as TOML.
    """

    identification: Identification
    reduction: Reduction
    worst_case: WorstCaseError | None
    error: WorstCaseError | None
    over_poles: WorstCaseOverPoles | None
    findings: tuple[str, ...]
    run_file: RunFile

    @property
    def choices(self) -> tuple[str, ...]:
        """How the program made what was left to it, one paragraph each."""
        return self.run_file.choices

    @property
    def model(self) -> control.StateSpace:
        """The small model."""
        return self.reduction.model

    @property
    def consistent(self) -> bool:
        """Whether a system of the class keeps every sample within its (stated) bound."""
        return self.identification.consistent

    def __repr__(self) -> str:
        found = self.identification
        return (
            f"<IdentifiedReduced: {found.status.name.lower()}, margin {found.margin:.6g}, order {self.reduction.order}>"
        )

    def summary(self) -> str:
        """The findings, then the identification, in plain text."""
        return "\n".join([*self.findings, "", self.identification.summary()])

    def report(self, path: str | os.PathLike[str], *, title: str | None = None) -> None:
        """Write the page of everything, with the run file in it; see `write_report`."""
        from robustid.report import write_report

        write_report(
            self.identification,
            path,
            reduction=self.reduction,
            title=title or self.run_file.title,
            worst_case=self.error,
            over_poles=self.over_poles,
            findings=self.findings,
            run_file=self.run_file.text(),
        )


class Store:
    """The folder of a run: every finished step is written as soon as it is there. Without a folder: nothing is."""

    def __init__(self, folder: Path | None = None, resume: bool = False) -> None:
        self.folder, self.resume = folder, resume

    @property
    def unfinished(self) -> Path | None:
        """Where finished frequencies go until all are."""
        return None if self.folder is None else self.folder / _UNFINISHED

    def open(self, force: bool) -> None:
        """Create the folder; with `force`, without what an earlier run wrote there."""
        if self.folder is None:
            return
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(f"the folder {self.folder} can't be created: {error.strerror}") from None
        if force and not self.resume:
            for path in self._written():
                path.unlink()
            self._clear()

    def _written(self) -> list[Path]:
        """Files of a run that are there."""
        if self.folder is None:
            return []
        names = [name for part in _NUMBERS for name in paths(self.folder / part)]
        names += [self.folder / name for name in (RUN_FILE, _PAGE, _MODEL, _SUMMARY)]
        return [path for path in (*names, *self.folder.glob(_LINES.format("*"))) if path.is_file()]

    def _clear(self) -> None:
        if self.unfinished is not None and self.unfinished.is_dir():
            shutil.rmtree(self.unfinished)

    def choices(self, run: RunFile) -> None:
        """Keep the run file as far as its choices are made."""
        self._text(RUN_FILE, run.text())

    def _text(self, name: str, text: str) -> None:
        if self.folder is not None:
            with atomic_write(self.folder / name) as file:
                file.write(text)

    def asked(self, run: RunFile) -> RunFile | None:
        """What was chosen before for the same question, None where nothing was; InputError if it was another one."""
        if self.folder is None or not self.resume or not (self.folder / RUN_FILE).is_file():
            return None
        before = read_run_file(self.folder / RUN_FILE)
        if not before.agrees(run):
            raise InputError(
                f"the run in {self.folder} was asked something else: go on with the run file that it was started with, or choose"
                " another folder"
            )
        return before

    def responses(self, frfs: tuple[FrequencyResponse, ...]) -> None:
        """Keep the frequency responses, all lines of them."""
        for k, frf in enumerate(frfs, start=1):
            if self.folder is not None:
                save(self.folder / _LINES.format(k), frf)

    def identification(self, problem: MixedProblem, objective: str) -> Identification | None:
        """The one that was finished before, of exactly this problem."""
        if self.folder is None or not self.resume or not paths(self.folder / "identification")[1].is_file():
            return None
        found = load_result(self.folder / "identification", "identification")
        return found if found.objective == objective and _digest(found.problem) == _digest(problem) else None

    def identified(self, result: Identification) -> None:
        """Keep it, if it came to its end."""
        ended = result.status in (Status.CONSISTENT, Status.INCONSISTENT)
        if self.folder is not None and ended and not any(note.startswith("interrupted") for note in result.notes):
            result.save(self.folder / "identification")

    def finish(self, result: IdentifiedReduced) -> list[Path]:
        """Keep the rest; the names of all files."""
        if self.folder is None:
            return []
        result.identification.save(self.folder / "identification")
        if result.error is not None:
            result.error.save(self.folder / "worst_case")
        if result.over_poles is not None:
            result.over_poles.save(self.folder / "over_poles")
        save_model(result.model, self.folder / _MODEL)
        self.choices(result.run_file)
        self._text(_SUMMARY, result.summary() + "\n")
        result.report(self.folder / _PAGE)
        self._clear()
        return self._written()


def _digest(problem: MixedProblem) -> str:
    arrays, text = describe_problem(problem)
    return digest(arrays | {"text": text_array(text)})

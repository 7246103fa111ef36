"""The results of a run: of one plant, or of the members of a family."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Mapping
from typing import TYPE_CHECKING, NamedTuple

from robustid.advice import Content, Diagnosis
from robustid.app.run.run_file import RunFile
from robustid.controllers import ControllerDesign
from robustid.core import Choice, Frozen, Progress, Savable, Unfinished
from robustid.data import Undoing
from robustid.errors import Status
from robustid.guarantees import Band, Coverage, Family, Judgement, LoopBounds, WorstCaseError, WorstCaseOverPoles
from robustid.identification import Identification
from robustid.reduction import ModelWorth, PlantReduction, Reduction

if TYPE_CHECKING:
    import control

    from robustid.report import Document, Parts


class WiderBand(NamedTuple):
    """The band that data which contradict their class would leave if every bound were `factor` times as large."""

    factor: float
    band: Band


@dataclasses.dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class IdentifiedReduced(Frozen):
    """Everything that was found on the way from measurements to a small model, and how.

    Attributes
    ----------
    identification : Identification
    reduction : Reduction
        The smallest model that was found inside the bounds (those times the margin, where the data contradict the class), or one
        inside them that fits significantly better; see `worth`.
    worth : ModelWorth or None
        The small model beside the best least-squares fits; None where they don't compare, as a sentence in `findings` says.
    worst_case, error : WorstCaseError or None
        Around the identified model, and around the small one; None where it wasn't asked for, or nothing is consistent. Bounds of
        matrices are made tight around the small one.
    band : Band or None
        Proved at every frequency, around the small model: over the pole-uncertainty box where the poles were taken from the data.
    wider : WiderBand or None
        Of data that are not consistent: the same with all bounds larger, by 10 % more than the class needs; `wider.factor` says
        how much, `wider.band.problem` has them. No guarantee about the data as they were measured.
    over_poles : WorstCaseOverPoles or None
        With the poles anywhere in the pole-uncertainty box, around the small model.
    content : Content or None
        Whether the class says something between the frequency points; None where nothing is consistent, or there are none.
    withheld : Coverage or None
        What the data that were kept out say of the band around the small model; None where there is no band or nothing was kept
        out.
    findings : tuple of str
        What can be said, in sentences: the contradiction, samples outside their bounds, the error of the small model.
    diagnosis : Diagnosis or None
        What would resolve the contradiction; None where there is none.
    run_file : RunFile
        Every choice, made explicit; `run_file.text()` as TOML.
    unfinished : Unfinished or None
        What Ctrl-C or the time limit has left out.
    undoing : Undoing or None
        The line of the run file that undoes a fault of the data; None where there is none, or no run file.
    loop : LoopBounds or None
        Of a plant in a loop: worst cases and margins of the controller that ran, over every consistent plant.
    plant : PlantReduction or None
        Of a plant in a loop: its small model; `model` is that of the stable system R.
    candidates : dict of str to LoopBounds
        Other controllers that the run file names: each proved for every consistent plant, refuted by one, or neither.
    design : ControllerDesign or None
        The controller that the run file asks for; None where it asks for none, or where there is no band.
    """

    identification: Identification
    reduction: Reduction
    worth: ModelWorth | None
    worst_case: WorstCaseError | None
    error: WorstCaseError | None
    over_poles: WorstCaseOverPoles | None
    content: Content | None
    withheld: Coverage | None = None
    findings: tuple[str, ...]
    run_file: RunFile
    band: Band | None = None
    wider: WiderBand | None = None
    diagnosis: Diagnosis | None = None
    unfinished: Unfinished | None = None
    undoing: Undoing | None = None
    loop: LoopBounds | None = None
    plant: PlantReduction | None = None
    candidates: Mapping[str, LoopBounds] = dataclasses.field(default_factory=dict[str, LoopBounds])
    design: ControllerDesign | None = None

    @property
    def choices(self) -> dict[str, Choice]:
        """The choices that were left to the program, by their names, each with its `source` and its `reason`."""
        return self.run_file.choices

    @property
    def model(self) -> control.StateSpace:
        """The small model."""
        return self.reduction.model

    @property
    def numbers(self) -> dict[str, Savable | None]:
        """Everything that is saved with its proofs, by the names of the files."""
        found: dict[str, Savable | None] = {
            "identification": marked(self.identification, self.unfinished, "the run"),
            "worst_case": self.error,
            "over_poles": self.over_poles,
            "band": self.band,
            "wider_band": None if self.wider is None else self.wider.band,
            "loop": self.loop,
            "controller": self.design,
        }
        return found | {f"loop-{name}": bounds for name, bounds in self.candidates.items()}

    @property
    def consistent(self) -> bool:
        """True if a system of the class keeps every sample within its (stated) bound."""
        return self.identification.consistent

    @property
    def contradicted(self) -> bool:
        """True if data that were kept out lie outside the band by more than their own bounds: it is no guarantee then."""
        return self.withheld is not None and self.withheld.contradicted

    def __repr__(self) -> str:
        found = self.identification
        said = found.status.name.lower() + ", contradicted by withheld data" * self.contradicted
        return f"<IdentifiedReduced: {said}, margin {found.margin:.6g}, order {self.reduction.order}>"

    def summary(self) -> str:
        """The omissions, the findings and what would help, then the identification, in plain text."""
        help = [] if self.diagnosis is None else [self.diagnosis.summary()]
        return "\n".join([*unfinished_words(self.unfinished), *self.findings, *help, "", self.identification.summary()])

    def report(
        self,
        path: str | os.PathLike[str],
        *,
        title: str | None = None,
        static: bool = False,
        progress: Progress | None = None,
    ) -> None:
        """Write the page of everything, with the run file in it; see `write_report`."""
        from robustid.report import Parts, write_report

        title, parts = title or self.run_file.title, self._parts | Parts(run_file=self.run_file.text())
        write_report(self.identification, path, title=title, static=static, progress=progress, **parts)

    def first_screen(self) -> Document:
        """Return the head of the page."""
        from robustid.report import first_screen

        return first_screen(self.identification, **self._parts)

    @property
    def _parts(self) -> Parts:
        """Everything that stands beside the identification on its page, but for the run file."""
        return {
            "reduction": self.reduction,
            "worst_case": self.error,
            "over_poles": self.over_poles,
            "findings": self.findings,
            "diagnosis": self.diagnosis,
            "withheld": self.withheld,
            "content": self.content,
            "worth": self.worth,
            "band": self.band,
            "unfinished": self.unfinished,
            "undoing": self.undoing,
            "loop": self.loop,
            "plant": self.plant,
            "candidates": self.candidates or None,
            "design": self.design,
        }


@dataclasses.dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class FamilyRun(Frozen):
    """Everything that was found on the way from the measurements of several plants to their family.

    Attributes
    ----------
    identifications : dict of str to Identification
        Of every member.
    family : Family or None
        None where the data of a member refute the class.
    withheld : dict of str to Coverage
        What the data of a member that were kept out say of the band of the family.
    findings : tuple of str
    run_file : RunFile
    unfinished : Unfinished or None
        What Ctrl-C or the time limit has left out.
    undoing : Undoing or None
        The line of the run file that undoes a fault of the data of a member; None where there is none.
    design : ControllerDesign or None
        The one controller for the plants of all members that the run file asks for.
    """

    identifications: dict[str, Identification]
    family: Family | None
    withheld: dict[str, Coverage]
    findings: tuple[str, ...]
    run_file: RunFile
    unfinished: Unfinished | None = None
    undoing: Undoing | None = None
    design: ControllerDesign | None = None

    @property
    def numbers(self) -> dict[str, Savable | None]:
        """Everything that is saved with its proofs, by the names of the files."""
        family, left_out = self.family, self.unfinished
        if family is not None and left_out is not None:  # for pages that are drawn from its file
            family = family.ended_early(dataclasses.replace(left_out, run="the run"))
        return {"family": family, "controller": self.design}

    @property
    def consistent(self) -> bool:
        """True if the data of every member are consistent with the one class."""
        return self.family is not None

    @property
    def contradicted(self) -> bool:
        """True if withheld data of a member lie outside the band by more than their own bounds."""
        return any(found.contradicted for found in self.withheld.values())

    @property
    def status(self) -> Status:
        """The worst finding about a member."""
        order = Status.CONSISTENT, Status.UNDECIDED, Status.INCONSISTENT, Status.FAILED
        return max((i.verified_status for i in self.identifications.values()), key=order.index)

    @property
    def model(self) -> control.StateSpace | None:
        """The nominal of the family."""
        return None if self.family is None else self.family.model

    def __repr__(self) -> str:
        said = "inconsistent" if self.family is None else "contradicted by withheld data" * self.contradicted
        return f"<FamilyRun: {len(self.identifications)} members{', ' * bool(said)}{said}>"

    def summary(self) -> str:
        """The omissions, the findings, then the family, in plain text."""
        return "\n".join(
            [
                *unfinished_words(self.unfinished),
                *self.findings,
                *([] if self.family is None else ["", self.family.summary()]),
            ]
        )

    def report(
        self,
        path: str | os.PathLike[str],
        *,
        title: str | None = None,
        static: bool = False,
        progress: Progress | None = None,
    ) -> None:
        """Write the page of the family, with the run file in it; nothing where there is none."""
        from robustid.report import Parts, write_report

        if self.family is not None:
            title, parts = title or self.run_file.title, self._parts | Parts(run_file=self.run_file.text())
            write_report(self.family, path, title=title, static=static, progress=progress, **parts)

    def first_screen(self) -> Document:
        """Return the head of the page; without a family the worst finding about a member."""
        from robustid.report import Document, Verdict, first_screen, verdict

        if self.family is not None:
            return first_screen(self.family, **self._parts)
        names = [name for name, one in self.identifications.items() if one.verified_status is self.status]
        said = verdict(self.identifications[names[0]])
        others = [Verdict(said.key, "Member", name) for name in names[1:]]
        return Document("", head=[dataclasses.replace(said, word=f"{names[0]}: {said.word}"), *others], body=[])

    @property
    def _parts(self) -> Parts:
        order = Judgement.SUPPORTED, Judgement.NOT_TESTED, Judgement.CONTRADICTED
        seen = self.withheld.values()
        worst = max(seen, key=lambda found: (order.index(found.judgement), found.largest), default=None)
        return {
            "findings": self.findings,
            "withheld": worst,
            "unfinished": self.unfinished,
            "undoing": self.undoing,
            "design": self.design,
        }


def marked(found: Identification, unfinished: Unfinished | None, run: str) -> Identification:
    """The identification with what the run that found it has left out, for pages that are drawn from its file."""
    kept = {} if unfinished is None else unfinished.kept(run)
    return dataclasses.replace(found, choices=Unfinished.without(found.choices) | kept)


def unfinished_words(unfinished: Unfinished | None) -> list[str]:
    """The line that says what was left out; none where nothing was."""
    return [] if unfinished is None else [f"{unfinished.word}: {unfinished.sentence}"]

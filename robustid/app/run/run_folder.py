"""The surroundings of a run: who is told how far it is, and its folder, where what is finished is found again."""

from __future__ import annotations

import contextlib
import dataclasses
import shutil
from collections.abc import Generator, Sequence
from concurrent.futures import Executor
from pathlib import Path
from typing import TypedDict

from robustid.advice import KeptGains
from robustid.app.load_save import load_result
from robustid.app.run.controller_settings import ControllerChoice
from robustid.app.run.results import FamilyRun, IdentifiedReduced
from robustid.app.run.run_file import RunFile, read_run_file
from robustid.controllers import ControllerDesign, DesignStatus, Factor, Matrix, Plants, as_goal
from robustid.core import Budget, Progress, Source, Stops, Unfinished, atomic_write, fingerprint, paths, save
from robustid.data import FrequencyResponse
from robustid.errors import InputError, Status
from robustid.fitting import MatrixFraction
from robustid.formats import save_model
from robustid.guarantees import Band, LoopBounds
from robustid.identification import Identification, MixedProblem

RUN_FILE = "run.toml"
_NUMBERS = ("identification", "band", "wider_band", "worst_case", "over_poles", "family", "fit", "loop", "controller")
_TRIED, _DESIGN = "loop-*.*", "controller"
_PAGE, _MODEL, _PLANT, _CONTROLLER, _SUMMARY, _RESPONSE, _UNFINISHED = (
    "report.html",
    "small_model.npz",
    "plant.npz",
    "controller-model.npz",
    "summary.txt",
    "response-{}.csv",
    "unfinished",
)


class RunFolder:
    """The folder of a run: every finished step is written as soon as it is there. Without a folder: nothing is."""

    def __init__(self, folder: Path | None = None, resume: bool = False, static: bool = False) -> None:
        self.folder, self.resume, self.static = folder, resume, static

    @property
    def unfinished(self) -> Path | None:
        """Folder of finished frequencies, until all are."""
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
        names += [self.folder / name for name in (RUN_FILE, _PAGE, _MODEL, _PLANT, _CONTROLLER, _SUMMARY)]
        names += [*self.folder.glob(_RESPONSE.format("*")), *self.folder.glob(_TRIED)]
        return [path for path in names if path.is_file()]

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
        """Run file as it was completed before for the same question; None where nothing was, InputError if it was another one."""
        if self.folder is None or not self.resume or not (self.folder / RUN_FILE).is_file():
            return None
        before = read_run_file(self.folder / RUN_FILE)
        if not before.agrees(run):
            raise InputError(
                f"the run in {self.folder} was asked something else: go on with the run file that it was started with, or choose"
                " another folder"
            )
        if before.prior.source == Source.STOPPED or before.frequency_points != run.frequency_points:
            # It goes on from the gains that it has found, perhaps with more points in its new time.
            chosen = {name: getattr(run, name) for name in ("prior", "frequency_points", "withheld")}
            return dataclasses.replace(before, **chosen)
        return before

    @property
    def gains(self) -> KeptGains:
        """The gain bounds that a search for a class has found, until the run has come to its end."""
        return KeptGains(None if self.unfinished is None else self.unfinished / "gains.json")

    def responses(self, frfs: tuple[FrequencyResponse, ...]) -> None:
        """Keep the frequency responses, all frequency points of them."""
        for k, frf in enumerate(frfs, start=1):
            if self.folder is not None:
                save(self.folder / _RESPONSE.format(k), frf)

    def fitted(self, fit: MatrixFraction) -> None:
        """Keep the matrix fraction that the modes come from."""
        if self.folder is not None:
            fit.save(self.folder / "fit")

    def _identification(self, member: int | None) -> Path | None:
        """Place of the identification, or of that of a member, which is kept until the family is there."""
        if self.folder is None or self.unfinished is None:
            return None
        return self.folder / "identification" if member is None else self.unfinished / f"identification-{member}"

    def identification(
        self, problem: MixedProblem, objective: str, *, member: int | None = None
    ) -> Identification | None:
        """The one that was finished before, of exactly this problem."""
        place = self._identification(member)
        if place is None or not self.resume or not paths(place)[1].is_file():
            return None
        found: Identification = load_result(place, "identification")
        found = dataclasses.replace(found, choices=Unfinished.without(found.choices))  # it is this run that goes on
        return found if found.objective == objective and fingerprint(found.problem) == fingerprint(problem) else None

    def identified(self, result: Identification, *, member: int | None = None) -> None:
        """Keep it, if it came to its end."""
        place = self._identification(member)
        ended = result.verified_status in (Status.CONSISTENT, Status.INCONSISTENT)
        stopped = any(choice.source is Source.STOPPED for choice in result.choices.values())
        if place is not None and ended and not stopped:
            place.parent.mkdir(parents=True, exist_ok=True)
            result.save(place)

    def proved(self, band: Band) -> None:
        """Keep the band."""
        if self.folder is not None:
            band.save(self.folder / "band")

    def designed(self, design: ControllerDesign) -> None:
        """Keep a controller."""
        if self.folder is not None:
            design.save(self.folder / _DESIGN)

    def design(
        self,
        plants: Sequence[Band | LoopBounds],
        structure: tuple[Factor, ...] | Matrix,
        asked: ControllerChoice,
        progress: Progress,
    ) -> ControllerDesign | None:
        """The controller of this structure that was designed before for exactly these plants, limits and goal, proved again."""
        if self.folder is None or not self.resume or not paths(self.folder / _DESIGN)[1].is_file():
            return None
        found: ControllerDesign = load_result(self.folder / _DESIGN, "controller design", progress=progress)
        if not found.finished:
            return None
        bands = tuple(Plants.of(one).band for one in plants)  # about the models that the design takes
        before = (tuple(one.band for one in found.proofs), found.structure, found.limits, found.goal)
        now = (bands, structure, asked.limits, as_goal(asked.goal))
        return found if fingerprint(before) == fingerprint(now) else None

    def finish(self, result: IdentifiedReduced | FamilyRun, progress: Progress | None = None) -> None:
        """Keep everything that isn't kept yet; of members that refute the class the sentences."""
        self.choices(result.run_file)
        self._text(_SUMMARY, result.summary() + "\n")
        if self.folder is None or result.model is None:
            return
        for name, numbers in result.numbers.items():
            if numbers is not None:
                numbers.save(self.folder / name)
        save_model(result.model, self.folder / _MODEL)
        if isinstance(result, IdentifiedReduced) and result.plant is not None:
            save_model(result.plant.model, self.folder / _PLANT)
            for name, found in result.candidates.items():
                if found.refuted_by is not None:
                    save_model(found.refuted_by.plant, self.folder / f"loop-{name}-plant.npz")
        design = result.design
        usable = design is not None and design.status in (DesignStatus.PROVED, DesignStatus.FOUND)
        if usable and design is not None and design.controller is not None:
            save_model(design.controller, self.folder / _CONTROLLER)
        result.report(self.folder / _PAGE, static=self.static, progress=progress)
        if result.unfinished is None:
            self._clear()


_NO_TIME = 1e-3  # seconds


class Counted(TypedDict):
    """Arguments of what is computed at many frequencies."""

    executor: Executor | int | None
    resume: Path | None
    progress: Progress


@dataclasses.dataclass(frozen=True)
class Surroundings:
    """Receiver of progress, folder of results, folder of finished frequencies where it is another one, workers, the time of the
    whole way, and what ended before its end.
    """

    told: Progress | None = None
    folder: RunFolder = dataclasses.field(default_factory=RunFolder)
    executor: Executor | int | None = None
    resume: Path | None = None
    budget: Budget = dataclasses.field(default_factory=Budget)
    stops: Stops = dataclasses.field(default_factory=Stops)

    @contextlib.contextmanager
    def step(
        self, text: str, share: float = 1.0, stated: float | None = None, *, needed: bool = True
    ) -> Generator[float | None]:
        """Say what begins; its time limit, a share of the time that is left and at most what is stated.

        It is late if that ends, unless what it adds is not needed. After Ctrl-C the time is over: a step gives what costs nothing.
        """
        if self.stops.interrupted:
            yield _NO_TIME
            return
        self.say(text)
        budget = self.budget.share(share)
        if stated is not None and stated < budget.left:
            budget = Budget(stated)
        yield budget.seconds
        if budget.over and needed:
            self.ended_early(text)

    def ended_early(self, text: str) -> None:
        """Say once that a step has ended before its end: its time was over, or too short for what comes next."""
        if text not in self.stops.late and not self.stops.interrupted:
            self.stops.late.append(text)

    @property
    def unfinished(self) -> Unfinished | None:
        """The steps that ended before their end, and whether a folder keeps what is finished; None where nothing did."""
        found = self.stops.unfinished
        kept = self.folder.folder is not None or self.resume is not None
        return None if found is None else dataclasses.replace(found, resumable=kept)

    def say(self, text: str) -> None:
        """Say what is done now."""
        if self.told is not None:
            self.told(text, 0, 0)

    def progress(self, text: str) -> Progress:
        """Receiver of the progress of something, told in these words."""

        def progress(_: str, done: int, count: int) -> None:
            if self.told is not None:
                self.told(text, done, count)

        return progress

    def begun(self, text: str) -> Progress:
        """Say what begins; receiver of its progress."""
        self.say(text)
        return self.progress(text)

    def counted(self, text: str) -> Counted:
        """Workers, finished frequencies and progress, in these words."""
        resume = self.resume or self.folder.unfinished
        return {"executor": self.executor, "resume": resume, "progress": self.progress(text)}

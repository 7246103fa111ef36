"""The state of a run while its steps are carried out: each step takes what is there, and adds what it finds."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

from robustid.advice import Content, Diagnosis
from robustid.app.run.modes import Box
from robustid.app.run.results import WiderBand
from robustid.app.run.run_file import RunFile
from robustid.app.run.run_folder import Surroundings
from robustid.controllers import ControllerDesign, Factor, Matrix
from robustid.core import Interruptible, Real
from robustid.data import FrequencyResponse, TimeRecord, Undoing
from robustid.guarantees import Band, Contradiction, Coverage, LoopBounds, WorstCaseError, WorstCaseOverPoles
from robustid.identification import Identification, Loop
from robustid.reduction import DoubtfulMode, ModelWorth, PlantReduction, Reduction

if TYPE_CHECKING:
    import control

    from robustid.report import Parts

# What narrows a band that is proved at every frequency already ends within this part of the time of the whole run: a run that has
# taken long is not made much longer for it. And the least, of the time that is left.
_NARROWED, _LEAST = 0.12, 0.03


class Untouched(NamedTuple):
    """Data that were not used: frequency points with the bounds of those that were, and what was kept out, of one kind.

    `measured` are those that were used, with the bounds as they were measured; a small model is simulated over `records`.
    """

    points: Sequence[FrequencyResponse] = ()
    withheld: Sequence[FrequencyResponse] = ()
    kind: str = "lines"
    measured: Sequence[FrequencyResponse | TimeRecord] = ()
    records: Sequence[TimeRecord] = ()

    @property
    def response(self) -> FrequencyResponse | None:
        """The first frequency response that was used."""
        return next((one for one in self.measured if isinstance(one, FrequencyResponse)), None)


@dataclasses.dataclass(kw_only=True, eq=False)
class Work:
    """An identification, the run file that it answers with every choice so far, and what was found of it."""

    run: RunFile
    identification: Identification
    around: Surroundings = dataclasses.field(default_factory=Surroundings)
    left: Untouched = dataclasses.field(default_factory=Untouched)
    refuted: Contradiction | None = None
    box: Box | None = None  # of the poles, which the band covers
    omega: Real | None = None  # of the worst case; None: the usual grid
    band: Band | None = None
    wider: WiderBand | None = None  # of data that are not consistent
    reduction: Reduction | None = None
    worth: ModelWorth | None = None
    not_compared: str = ""  # why there is no worth
    doubtful: tuple[DoubtfulMode, ...] = ()
    content: Content | None = None
    error: WorstCaseError | None = None  # around the model
    over_poles: WorstCaseOverPoles | None = None
    not_over_poles: str = ""  # why there is none
    withheld: Coverage | None = None
    diagnosis: Diagnosis | None = None
    undoing: Undoing | None = None
    loop: Loop | None = None  # that the data were opened from
    looped: LoopBounds | None = None
    controllers: Mapping[str, control.StateSpace] = dataclasses.field(default_factory=dict[str, "control.StateSpace"])
    tried: dict[str, LoopBounds] = dataclasses.field(default_factory=dict[str, LoopBounds])
    plant: PlantReduction | None = None
    structure: tuple[Factor, ...] | Matrix = ()  # of the controller that is designed
    design: ControllerDesign | None = None
    not_designed: str = ""  # why there is none

    @property
    def model(self) -> control.StateSpace:
        """The small model, or as long as there is none the identified one."""
        return self.identification.model if self.reduction is None else self.reduction.model

    @property
    def small(self) -> Reduction:
        """The small model, for the steps after the one that finds it."""
        if self.reduction is None:
            raise RuntimeError("`reduced` comes before the steps that need the small model")
        return self.reduction

    @property
    def parts(self) -> Parts:
        """Everything that stands beside the identification on its page."""
        return {
            "reduction": self.reduction,
            "worst_case": self.error,
            "over_poles": self.over_poles,
            "band": self.band,
            "diagnosis": self.diagnosis,
            "unfinished": self.around.unfinished,
            "undoing": self.undoing,
            "loop": self.looped,
            "plant": self.plant,
            "candidates": self.tried or None,
            "design": self.design,
        }


Step = Callable[[Work], None]


def carry_out(work: Work, steps: Sequence[Step]) -> None:
    """Carry out the steps in their order; one that Ctrl-C has ended gives what costs nothing, as those behind it."""
    with work.around.stops.listening():
        for step in steps:
            with Interruptible() as first:
                step(work)
            if first.interrupted:
                step(work)


def narrowing_limit(whole: float, left: float) -> float:
    """Seconds for what narrows the band of a run of so many, of which some are left; of one without end as where it begins."""
    if math.isinf(left):
        return _NARROWED * whole
    return max(_NARROWED * whole - (whole - left), _LEAST * left, 0.0)

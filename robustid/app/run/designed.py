"""The step of a run that designs a controller for every plant that the data allow, and its sentence."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from robustid.app.run.controller_settings import ControllerChoice
from robustid.app.run.modes import box_of, held_box
from robustid.app.run.run_file import RunFile
from robustid.app.run.run_folder import Surroundings
from robustid.app.run.work import Work
from robustid.controllers import ControllerDesign, DesignStatus, Factor, Matrix, design_controller
from robustid.errors import InputError, InputTypeError, Status
from robustid.guarantees import Band, LoopBounds, band
from robustid.identification import Identification

_SHARE = 0.5  # of the time that is left
_PLACE = "[controller]"
_NO_BAND = "there is no band of consistent plants that it could be designed for"
NOT_DESIGNED = "No controller was designed: {}."


def designed(work: Work) -> None:
    """The step that designs a controller: of a plant in a loop from what is known of that, else from the band."""
    if not work.run.controller.is_stated:
        return
    plants = work.looped if work.loop is not None else work.band
    if plants is None or not work.identification.consistent:
        work.not_designed = _NO_BAND
        return
    if work.loop is None and work.band is not None:
        plants = work.band.with_model(work.model)
    work.design, work.not_designed = _design([plants], work.structure, work.run.controller, work.around)


def designed_for_members(
    run: RunFile, found: Mapping[str, Identification], structure: tuple[Factor, ...] | Matrix, around: Surroundings
) -> tuple[ControllerDesign | None, list[str]]:
    """One controller for the plants of all members, each in the band of its own data over the box of its poles; and words on it."""
    if not run.controller.is_stated:
        return None, []
    bands: list[Band] = []
    for member in run.members:
        result = found[member.name]
        if result.verified_status is not Status.CONSISTENT or result.prior.positive_real:
            return None, [NOT_DESIGNED.format(_NO_BAND)]
        words = f"proving the error of {member.name} at every frequency"
        with around.step(words, _SHARE / len(found)) as limit:
            box, told = held_box(box_of(member), result.problem), around.progress(words)
            bands.append(band(result, box=box, time_limit=limit, progress=told).with_model(result.model))
    design, why = _design(bands, structure, run.controller, around)
    return design, [design_words(design) if design is not None else NOT_DESIGNED.format(why)]


def _design(
    plants: Sequence[Band | LoopBounds],
    structure: tuple[Factor, ...] | Matrix,
    asked: ControllerChoice,
    around: Surroundings,
) -> tuple[ControllerDesign | None, str]:
    """The controller for all plants, kept in the folder or taken from it; or why there is none."""
    progress = around.progress("designing the controller")
    before = around.folder.design(plants, structure, asked, progress)
    if before is not None:
        around.say("controller: taken from the unfinished run")
        return before, ""
    words = ControllerChoice.words(lambda one: f"{_PLACE} {one}") | {"bands": "the band"}
    with around.step("designing the controller", _SHARE, asked.time_limit) as limit:
        try:
            found = design_controller(
                plants, structure, limits=asked.limits, maximise=asked.goal, time_limit=limit, progress=progress
            )
        except (InputError, InputTypeError) as error:
            return None, error.said(words, unknown=str)
    around.folder.designed(found)
    return found, ""


def design_words(design: ControllerDesign) -> str:
    """Sentence on a design."""
    if design.status is DesignStatus.NONE or design.controller is None:
        law = design.obstacle()
        why = (
            "; a search, no proof that there is none"
            if law is None
            else f"; no controller at all keeps them: {law.sentence}"
        )
        return f"Controller: {design.status.value}{why}."
    words = f"Controller of order {design.controller.nstates}: {design.goal.name} {design.goal.told(design.level)},"
    if design.status is DesignStatus.PROVED:
        return f"{words} proved for every consistent plant, at every frequency{design.scope}."
    return f"{words} {design.status.value}."

"""The step of a run that designs a controller for every plant that the data allow, and its sentence."""

from __future__ import annotations

from robustid.app.run.controller_settings import ControllerChoice
from robustid.app.run.work import Work
from robustid.controllers import ControllerDesign, DesignStatus, design_controller
from robustid.errors import InputError, InputTypeError

_SHARE = 0.5  # of the time that is left
_PLACE = "[controller]"


def designed(work: Work) -> None:
    """The step that designs a controller: of a plant in a loop from what is known of that, else from the band."""
    asked = work.run.controller
    if not asked.is_stated:
        return
    plants = work.looped if work.loop is not None else work.band
    if plants is None or not work.identification.consistent:
        work.not_designed = "there is no band of consistent plants that it could be designed for"
        return
    if work.loop is None and work.band is not None:
        plants = work.band.with_model(work.model)
    before = work.around.folder.design(plants, work.structure, asked)
    if before is not None:
        work.around.say("controller: taken from the unfinished run")
        work.design = before
        return
    words = ControllerChoice.words(lambda one: f"{_PLACE} {one}") | {"bands": "the band"}
    with work.around.step("designing the controller", _SHARE, asked.time_limit) as limit:
        try:
            work.design = design_controller(
                plants,
                work.structure,
                limits=asked.limits,
                maximise=asked.goal,
                time_limit=limit,
                progress=work.around.progress("designing the controller"),
            )
        except (InputError, InputTypeError) as error:
            work.not_designed = error.said(words, unknown=str)
            return
    work.around.folder.designed(work.design)


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

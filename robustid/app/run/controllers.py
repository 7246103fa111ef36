"""Controllers from their files, tried in the loop of every consistent plant: the step of a run, and its sentences."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from robustid.app.load_save import load
from robustid.app.run.work import Work
from robustid.core import Budget
from robustid.errors import FileFormatError, InputError, InputTypeError
from robustid.guarantees import LoopBounds, loop_bounds
from robustid.identification import Loop
from robustid.reduction import controller_model

if TYPE_CHECKING:
    import control

    Controllers = dict[str, control.StateSpace]


_SHARE = 0.3  # of the time that is left, for each


def controller_in(path: Path, dt: float | None, name: str = "controller") -> control.StateSpace:
    """The controller in a file that holds a model, or the response of one; `dt` is that of responses that state none."""
    try:
        return load(path, kind="model")
    except (InputError, FileFormatError):
        try:
            frf = load(path, kind="frequency", dt=dt or None)
        except (InputError, FileFormatError):
            frf = None
        if frf is None:
            raise
        return controller_model(frf, name=name)


def read_controllers(paths: Sequence[Path], place: str, loop: Loop | None = None) -> Controllers:
    """The controllers of files by the names of these, checked against the loop where there is one; `place`: where they stand."""
    found: Controllers = {}
    for path in paths:
        if not path.is_file():
            raise InputError(f"{place} {path}: there is no such file")
        if path.stem in found:
            raise InputError(f"{place} {path}: a controller of the name {path.stem} was given before; rename one file")
        try:
            model = controller_in(path, None if loop is None else loop.dt)
            if loop is not None:
                loop.as_controller(model)
        except (InputError, InputTypeError, FileFormatError) as error:
            words = {"controller": "it", "path": "it"}
            raise InputError(f"{place} {path}: {error.said(words, unknown=str)}") from None
        found[path.stem] = model
    return found


def tried(work: Work) -> None:
    """The step that tries other controllers: proved for every consistent plant, refuted by one, or neither."""
    if work.looped is None:
        return
    for name, controller in work.controllers.items():
        with work.around.step(f"trying the controller {name}", _SHARE) as limit:
            budget = Budget(limit)
            found = loop_bounds(work.looped.band, work.looped.loop, controller, time_limit=budget.share(0.5).seconds)
            work.tried[name] = found.refuted(work.identification, time_limit=budget.seconds)


def candidate_words(name: str, found: LoopBounds) -> str:
    """Sentence on a controller that was tried."""
    words = f"Controller {name}: {found.status.value}"
    if (plant := found.refuted_by) is not None:
        return f"{words}; its closed loop has a {plant.pole_words}."
    if found.unbounded:
        return f"{words}; {found.unbounded}."
    return f"{words}; the sensitivity is at most {found.peaks['sensitivity'].value:.4g} (zone {found.zone} of ISO 14839-3:2006)."

"""Controllers from their files, to be tried in a loop."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from robustid.app.load_save import load
from robustid.errors import FileFormatError, InputError, InputTypeError
from robustid.identification import Loop
from robustid.reduction import controller_model

if TYPE_CHECKING:
    import control

    Controllers = dict[str, control.StateSpace]


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

"""Controllers from their files, to be tried in a loop."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from robustid.app.load_save import load
from robustid.errors import InputError, InputTypeError
from robustid.identification import Loop

if TYPE_CHECKING:
    import control

    Controllers = dict[str, control.StateSpace]


def read_controllers(paths: Sequence[Path], place: str, loop: Loop | None = None) -> Controllers:
    """The controllers of files by the names of these, checked against the loop where there is one; `place`: where they stand."""
    found: Controllers = {}
    for path in paths:
        if not path.is_file():
            raise InputError(f"{place} {path}: there is no such file")
        if path.stem in found:
            raise InputError(f"{place} {path}: a controller of the name {path.stem} was given before; rename one file")
        try:
            model = load(path, kind="model")
            if loop is not None:
                loop.as_controller(model)
        except (InputError, InputTypeError) as error:
            words = {"controller": "it", "path": "it"}
            raise InputError(f"{place} {path}: {error.said(words, unknown=str)}") from None
        found[path.stem] = model
    return found

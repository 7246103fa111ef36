"""One way out: the ending of a file and the thing that is saved choose the writer."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

from robustid.app.exports import c_header, json_text, matlab, roots, tables, universal
from robustid.core import atomic_write
from robustid.data import FrequencyResponse
from robustid.errors import InputError
from robustid.estimation import DelayedModel
from robustid.formats import save_model
from robustid.guarantees import UncertaintyWeight, WorstCaseError
from robustid.identification import Identification

Writer = Callable[[Any, str], str]
_OF_MODELS: dict[str, Writer] = {
    ".m": matlab.script,
    ".json": json_text.model_text,
    ".h": c_header.header,
    ".sos": roots.sections_text,
    ".zpk": roots.roots_text,
    ".csv": tables.poles,
}
_OF_RESULTS: tuple[tuple[type, dict[str, Writer]], ...] = (
    (WorstCaseError, {".csv": tables.bounds}),
    (Identification, {".csv": tables.verdict}),
    (UncertaintyWeight, {".m": matlab.uncertain_script}),
)
_OF_RESPONSES = (".uff", ".unv", ".uf")


def exported(path: str | os.PathLike[str], thing: Any) -> bool:
    """Write a thing for another program, whole or not at all; False where that isn't what the ending of the file means."""
    import control

    path = Path(path)
    ending = path.suffix.lower()
    if isinstance(thing, FrequencyResponse) and ending in _OF_RESPONSES:
        universal.write(path, thing)
        return True
    writers = next((own for kind, own in _OF_RESULTS if isinstance(thing, kind)), None)
    if isinstance(thing, DelayedModel):  # its delay is in the states of the model
        thing = thing.model
    if isinstance(thing, control.StateSpace):
        writers = _OF_MODELS
        if ending in (".npz", ".mat"):
            save_model(thing, path)
            return True
    if writers is None or ending not in writers:
        if isinstance(thing, control.StateSpace | UncertaintyWeight):
            known = [*([".npz", ".mat"] if writers is _OF_MODELS else []), *(writers or {})]
            raise InputError(f"`path` must end in {', '.join(known)} for a {type(thing).__name__}; got {path.name}")
        return False
    text = writers[ending](thing, path.stem)
    with atomic_write(path) as file:
        file.write(text)
    return True

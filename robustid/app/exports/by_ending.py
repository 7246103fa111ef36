"""One way out: the ending of a file and the thing that is saved choose the writer; JSON and tables are written here."""

from __future__ import annotations

import csv
import io
import json
import os
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from robustid.app.exports import c_header, matlab, roots
from robustid.app.exports.controller_source import designed_controller, write_controller_c
from robustid.controllers import ControllerDesign
from robustid.core import Complex, as_state_space, atomic_write, exponents_of, model_of
from robustid.data import FrequencyResponse
from robustid.errors import InputError
from robustid.estimation import DelayedModel
from robustid.formats import save_model, write_universal
from robustid.guarantees import UncertaintyWeight, WorstCaseError
from robustid.identification import Identification

if TYPE_CHECKING:
    import control


def _json_text(model: control.StateSpace, name: str) -> str:
    """Return A, B, C, D, dt (0: continuous), the names of the signals; numbers with all their digits."""
    found: dict[str, object] = {"name": name, "dt": float(model.dt or 0)}
    found |= {part: np.asarray(getattr(model, part), dtype=float).tolist() for part in "ABCD"}
    found |= {"inputs": list(model.input_labels), "outputs": list(model.output_labels)}
    return json.dumps(found, indent=1) + "\n"


def _pole_table(model: control.StateSpace, name: str) -> str:
    """Return the poles of a model: in Hz with damping ratio, and as complex numbers."""
    found: Complex = np.array(model.poles(), dtype=complex)
    with np.errstate(divide="ignore"):
        s = exponents_of(found, model.dt)
    size = np.abs(s)
    damping = -s.real / np.where(size > 0, size, 1)
    order = np.lexsort((found.imag, size))
    rows = [(size[k] / (2 * np.pi), damping[k], found[k].real, found[k].imag) for k in order]
    return _csv(("frequency [Hz]", "damping ratio", "real", "imag"), rows)


def _bound_table(error: WorstCaseError, name: str) -> str:
    """Return the model and the bounds of its error at every frequency, a row for each entry."""
    columns = error.table()
    return _csv(tuple(columns), zip(*columns.values(), strict=True))


def _verdict_table(identification: Identification, name: str) -> str:
    """Return status, margin, order, class and checks."""
    prior = identification.problem.prior
    rows = [
        ("status", identification.status.value),
        ("margin, proved from below", identification.margin_lower),
        ("margin, reached", identification.margin),
        ("order of the model", identification.order),
        ("gain bound K", prior.gain_bound),
        ("decay rate rho" if identification.problem.dt else "decay alpha [1/s]", prior.rate),
        ("samples", identification.problem.samples),
    ]
    rows += [(f"check: {one.name}", "holds" if one.holds else "fails") for one in identification.verification.checks]
    return _csv(("what", "value"), rows)


def _csv(heads: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(heads)
    for row in rows:
        writer.writerow([f"{cell:.17g}" if isinstance(cell, float) else cell for cell in row])
    return out.getvalue()


Writer = Callable[[Any, str], str]
_OF_MODELS: dict[str, Writer] = {
    ".m": matlab.script,
    ".json": _json_text,
    ".h": c_header.header,
    ".sos": roots.sections_text,
    ".zpk": roots.roots_text,
    ".csv": _pole_table,
}
_OF_RESULTS: tuple[tuple[type, dict[str, Writer]], ...] = (
    (WorstCaseError, {".csv": _bound_table}),
    (Identification, {".csv": _verdict_table}),
    (UncertaintyWeight, {".m": matlab.uncertain_script}),
)
_OF_RESPONSES = (".uff", ".unv", ".uf")
_FOR_MODELS = (".m", ".mat", ".c", ".h", ".sos", ".zpk")  # of a result its model


def exported(path: str | os.PathLike[str], thing: object) -> bool:
    """Write a thing for another program, whole or not at all; False where that isn't what the ending of the file means."""
    import control

    path = Path(path)
    ending = path.suffix.lower()
    if isinstance(thing, FrequencyResponse) and ending in _OF_RESPONSES:
        write_universal(path, thing)
        return True
    of_its_own = any(isinstance(thing, kind) and ending in own for kind, own in _OF_RESULTS)
    thing = as_state_space("thing", model_of(thing) if ending in _FOR_MODELS and not of_its_own else thing)
    designed = isinstance(thing, ControllerDesign) and ending in (".c", ".h")
    if designed or (ending == ".c" and isinstance(thing, control.StateSpace | control.TransferFunction)):
        write_controller_c(path, thing)
        return True
    if isinstance(thing, ControllerDesign) and ending in (".m", ".mat", ".sos"):
        thing = designed_controller(thing)
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
            known += [".c"] if writers is _OF_MODELS else []
            raise InputError(f"`path` must end in {', '.join(known)} for a {type(thing).__name__}; got {path.name}")
        return False
    text = writers[ending](thing, path.stem)
    with atomic_write(path) as file:
        file.write(text)
    return True

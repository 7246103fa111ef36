"""Models as other programs have them, as `control.StateSpace`: transfer functions and scipy.signal's systems."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import scipy.linalg

from robustid.core.frozen import Frozen
from robustid.core.validation import Signal
from robustid.errors import InputError


def as_state_space(name: str, model: Any) -> Any:
    """Return the `control.StateSpace` of a transfer function, or of a scipy.signal system; everything else as it is.

    Of a matrix of transfer functions every entry has states of its own.
    """
    import control

    if isinstance(model, control.TransferFunction):
        return _of_entries(name, model)
    if type(model).__module__.startswith("scipy.signal") and hasattr(model, "to_ss"):
        found = _proper(name, model.to_ss)
        return control.ss(found.A, found.B, found.C, found.D, 0 if found.dt is None else found.dt)
    return model


def labels_of(signals: Sequence[Signal], letter: str) -> list[str]:
    """Names and units of signals as labels that `control` takes: not empty, and without dots."""
    return [str(Signal(name.replace(".", "_") or letter, unit.replace(".", "·"))) for name, unit in signals]


def numbered(labels: list[str], letter: str) -> bool:
    """Return whether labels are those that `control` gives to signals without names."""
    return labels == [f"{letter}[{k}]" for k in range(len(labels))]


def model_of(thing: Any) -> Any:
    """Return the `control.StateSpace` of a result that has one as its `model`; everything else as it is."""
    import control

    model = getattr(thing, "model", None) if isinstance(thing, Frozen) else None
    return model if isinstance(model, control.StateSpace) else thing


def _of_entries(name: str, model: Any) -> Any:
    """A transfer function as a state space, entry by entry: slycot isn't needed."""
    import control

    labels = {"inputs": model.input_labels, "outputs": model.output_labels, "name": model.name}
    if model.noutputs == model.ninputs == 1:
        return control.ss(_proper(name, lambda: control.ss(model)), **labels)
    parts = [
        [_proper(name, lambda i=i, j=j: control.ss(control.tf(model.num[i][j], model.den[i][j], model.dt)))
         for j in range(model.ninputs)]
        for i in range(model.noutputs)
    ]  # fmt: skip
    every = [(i, j, part) for i, row in enumerate(parts) for j, part in enumerate(row)]
    A = scipy.linalg.block_diag(*(part.A for *_, part in every))
    B = np.vstack([part.B @ np.eye(model.ninputs)[[j]] for _, j, part in every])
    C = np.hstack([np.eye(model.noutputs)[:, [i]] @ part.C for i, _, part in every])
    D = np.block([[part.D for part in row] for row in parts])
    return control.ss(A, B, C, D, model.dt, **labels)


def _proper(name: str, converted: Any) -> Any:
    try:
        return converted()
    except ValueError:
        raise InputError(
            f"`{name}` must be proper; got a transfer function with more zeros than poles. Add the poles that its roll-off has"
        ) from None

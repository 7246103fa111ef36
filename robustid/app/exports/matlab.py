"""MATLAB scripts that make a model, or a model with its uncertainty."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from robustid.core import Signal, as_signals, numbered
from robustid.errors import InputError

if TYPE_CHECKING:
    import control

    from robustid.guarantees import UncertaintyWeight

_PLANTS = {
    "additive": "{p} + {w}*Delta",
    "multiplicative": "(eye({ny}) + {w}*Delta)*{p}",
    "input_multiplicative": "{p}*(eye({nu}) + Delta*{w})",
    "inverse": "inv(eye({ny}) + {w}*Delta)*{p}",
}


def script(model: control.StateSpace, name: str) -> str:
    """Return a script that makes the model: ss(A, B, C, D, Ts), with the names and units of its signals."""
    name = identifier(name)
    lines = [f"% {name}: written by robustid; run it, and {name} is a model of the Control System Toolbox."]
    lines += _system(name, model)
    for side, labels in (("Input", model.input_labels), ("Output", model.output_labels)):
        plain = numbered(labels, "u" if side == "Input" else "y")
        signals = [Signal(label) for label in labels] if plain else as_signals(side, labels, len(labels), "")
        lines.append(f"{name}.{side}Name = {_cells(signal.name for signal in signals)};")
        if any(signal.unit for signal in signals):
            lines.append(f"{name}.{side}Unit = {_cells(signal.unit for signal in signals)};")
    return "\n".join(lines) + "\n"


def uncertain_script(weight: UncertaintyWeight, name: str) -> str:
    """Return a script that makes the uncertain plant: nominal model, weight, and Delta = ultidyn of norm one."""
    if weight.nominal is None:
        raise InputError(
            "`nominal` is not known to this weight: make it with uncertainty_weight(nominal, edges, bound)"
        )
    name, nominal = identifier(name), weight.nominal
    ny, nu = nominal.noutputs, nominal.ninputs
    block = {"additive": (ny, nu), "multiplicative": (ny, ny), "input_multiplicative": (nu, nu), "inverse": (ny, ny)}
    rows, columns = block[weight.kind]
    words = {"p": f"{name}_nominal", "w": f"{name}_weight", "ny": ny, "nu": nu}
    return "\n".join(
        [
            f"% {name}: written by robustid; every plant within the {weight.kind} bound. Robust Control Toolbox.",
            *_system(f"{name}_nominal", nominal),
            *_system(f"{name}_weight", weight.model),
            f"Delta = ultidyn('Delta', [{rows} {columns}]" + (", 'SampleStateDim', 2);" if not nominal.dt else ");"),
            *([f"Delta.Ts = {float(nominal.dt)!r};"] if nominal.dt else []),
            f"{name} = {_PLANTS[weight.kind].format(**words)};",
            "",
        ]
    )


def identifier(name: str) -> str:
    """Return a name that MATLAB and C take."""
    name = re.sub(r"\W", "_", name)
    return name if re.match(r"[A-Za-z]", name) else f"m_{name}"


def _system(name: str, system: control.StateSpace) -> list[str]:
    lines = [f"{name}_{part} = {_matrix(getattr(system, part))};" for part in "ABCD"]
    parts = ", ".join(f"{name}_{part}" for part in "ABCD")
    step = f", {float(system.dt)!r}" if system.dt else ""
    return [*lines, f"{name} = ss({parts}{step});"]


def _matrix(values: ArrayLike) -> str:
    values = np.atleast_2d(np.asarray(values, dtype=float))
    if not values.size:
        return f"zeros({values.shape[0]}, {values.shape[1]})"
    return "[" + ";\n  ".join(" ".join(f"{value:.17g}" for value in row) for row in values) + "]"


def _cells(labels: Iterable[str]) -> str:
    return "{" + ", ".join("'" + str(label).replace("'", "''") + "'" for label in labels) + "}"

"""The list of problems, and their results as flat tables of numbers and texts."""

from __future__ import annotations

import dataclasses
import enum
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import robustid as rid

MOST = 240  # numbers of an array that are kept one by one
ANGLES = np.linspace(0.0, np.pi, 15)  # of z = exp(j angle), where responses of discrete models are kept
OMEGA = np.geomspace(0.1, 1e4, 15)  # rad/s, of continuous models


class Problem(NamedTuple):
    """A function from an empty folder to what it found, and whether the suite runs it every time.

    Values whose last bits depend on the number of threads have a name with one of `near` in it: within 1e-9 they are
    the same. Those with one of `loose`, or of LOOSE, depend on rounding (a step more of an iteration, one of two equal
    maxima, one of many proofs), and are compared on the same machine only.
    """

    function: Callable[[Path], Mapping[str, Any]]
    quick: bool
    near: tuple[str, ...]
    loose: tuple[str, ...]


PROBLEMS: dict[str, Problem] = {}
LOOSE = ("limiting/",)  # the shares of samples in a proof


def problem(*, quick: bool = False, near: tuple[str, ...] = (), loose: tuple[str, ...] = ()):
    """Enter a function under its name."""

    def entered(function):
        if function.__name__ in PROBLEMS:
            raise ValueError(f"two problems are called {function.__name__}")
        PROBLEMS[function.__name__] = Problem(function, quick, near, (*LOOSE, *loose))
        return function

    return entered


def of(thing: Any, names: str) -> dict[str, Any]:
    """Attributes of a result by their names; those that are methods are called."""
    found = {}
    for name in names.split():
        value = getattr(thing, name)
        found[name] = value() if callable(value) and not hasattr(value, "nstates") else value
    return found


def table_of(found: Any, folder: Path, name: str = "") -> dict[str, Any]:
    """Everything that was found as {name: number, text or {shape, values}}; parts of parts get names with strokes."""
    if isinstance(found, Mapping):
        parts = {str(key): value for key, value in found.items()}
    elif hasattr(found, "nstates"):
        parts = _model(found)
    elif isinstance(found, (rid.FrequencyResponse, rid.TimeRecord, rid.TangentialResponse, rid.Bound)):
        parts = {field.name: getattr(found, field.name) for field in dataclasses.fields(found)}
    elif isinstance(found, (list, tuple)) and not isinstance(found, rid.prepare.Fault) and not _numeric(found):
        parts = {"count": len(found)} | {str(k): value for k, value in enumerate(found)}
    else:
        return {name: _leaf(found, folder)}
    table = {}
    for key, value in parts.items():
        table |= table_of(value, folder, f"{name}/{key}" if name else key)
    return table


def _model(model: Any) -> dict[str, Any]:
    """Order, sample time and response of a model: the coordinates of states are nobody's claim."""
    points = np.exp(1j * ANGLES) if model.dt else 1j * OMEGA
    response = model(points, squeeze=False)
    return {"states": model.nstates, "dt": float(model.dt or 0), "response": np.moveaxis(response, -1, 0)}


def _numeric(value: Any) -> bool:
    try:
        return np.asarray(value).dtype.kind in "biufc"
    except (TypeError, ValueError):  # parts of different shapes
        return False


def _leaf(value: Any, folder: Path) -> Any:
    if isinstance(value, enum.Enum):
        return value.name
    if value is None or isinstance(value, (bool, np.bool_)):
        return value if value is None else bool(value)
    if isinstance(value, (int, np.integer)):
        return int(value)
    if isinstance(value, (float, np.floating)):
        return float(value)
    if _numeric(value):
        return _array(np.asarray(value))
    return plain(str(value), folder)


def _array(values: np.ndarray) -> dict[str, Any]:
    """All numbers, or of a large array some, their sum and the root of the sum of squares; complex ones as pairs."""
    shape, flat = list(values.shape), values.ravel()
    if flat.dtype.kind == "c":
        shape, flat = [*shape, "complex"], np.stack([flat.real, flat.imag], axis=-1).ravel()
    flat = flat.astype(float)
    if flat.size > MOST:
        finite = flat[np.isfinite(flat)]
        some = flat[np.linspace(0, flat.size - 1, MOST // 2).astype(int)]
        flat = np.concatenate([some, [finite.sum(), np.sqrt((finite**2).sum())]])
    return {"shape": shape, "values": flat.tolist()}


_REPLACED = (
    (rf"\b{re.escape(rid.__version__)}\b", "VERSION"),
    (r"\b\d{4}-\d\d-\d\d(?:[T ]\d\d:\d\d(?::\d\d)?)?(?: ?UTC)?", "DATE"),
    (r"(?<![.\w])(?=[0-9]*[a-f])[0-9a-f]{16,}\b", "DIGEST"),
    (r"\b(Python|numpy|scipy|cvxpy|clarabel|control) \d+(?:\.\w+)+", r"\1 VERSION"),
    (r"(?m)^Time: .* s\.$", "Time: SECONDS"),
    (r'"timing": \{[^}]*\}', '"timing": SECONDS'),
    (r"─{2,}", "──"),  # frames are as wide as the terminal
)


def plain(text: str, folder: Path) -> str:
    """A text without what belongs to one run: folder, versions, dates, digests, seconds; no blanks end a line."""
    text = text.replace(str(folder), "FOLDER")
    for pattern, word in _REPLACED:
        text = re.sub(pattern, word, text)
    return "\n".join(line.rstrip() for line in text.splitlines())

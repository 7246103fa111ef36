"""Axes of arrays, named in their order: ``"time,signal,realisation,period"``, ``"output,input,frequency"``."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from robustid.errors import InputError

TIME = ("realisation", "period", "time", "signal")
FREQUENCY = ("frequency", "output", "input")
_SYNONYMS = {"channel": "signal", "sample": "time", "realization": "realisation", "experiment": "realisation"}


def parse(text: Any) -> tuple[str, ...]:
    """The names of axes that a text holds, each once, of one kind of data."""
    given = [word.strip().lower() for word in text.split(",")] if isinstance(text, str) else []
    names = tuple(_SYNONYMS.get(name, name) for name in (word.removesuffix("s") for word in given))
    known = [kind for kind in (TIME, FREQUENCY) if set(names) <= set(kind)]
    if not names or not known or len(set(names)) < len(names):
        raise InputError(
            f"`axes` names the axes of the arrays in their order, of a time record from {', '.join(TIME)}, of a frequency response"
            f" from {', '.join(FREQUENCY)}, each once, such as 'time,signal'; got {text!r}"
        )
    first = "time" if known[0] is TIME else "frequency"
    if first not in names:
        raise InputError(f"`axes` must name the axis {first!r}; got {text!r}")
    return names


def arranged(what: str, values: np.ndarray, names: Sequence[str], wanted: Sequence[str]) -> np.ndarray:
    """Move the axes of an array into the order wanted; those that it lacks have length 1. A vector is along time or frequency."""
    if values.ndim == 1 and len(names) > 1:
        names = ["frequency" if "frequency" in wanted else "time"]
    if values.ndim != len(names):
        raise InputError(
            f"`axes` names {len(names)} axes ({', '.join(names)}), and {what} has the shape {values.shape}"
        )
    there = [name for name in wanted if name in names]
    values = values.transpose([list(names).index(name) for name in there])
    return values.reshape([values.shape[there.index(name)] if name in there else 1 for name in wanted])

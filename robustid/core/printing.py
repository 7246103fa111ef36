"""Printing of statements and results: in a line or a few, whatever they hold."""

from __future__ import annotations

import dataclasses
import enum
from collections.abc import Mapping, Sequence
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

_FEW = 6  # numbers, items or fields that are written out
_LINE = 100  # characters of one value
_SCREEN = 24  # fields


def short_repr(thing: Any) -> str:
    """Print a dataclass in at most a screen: small values as they are, of large ones their kind and size.

    Examples
    --------
    >>> import dataclasses, numpy as np
    >>> from robustid.core import Frozen
    >>> @dataclasses.dataclass(frozen=True)
    ... class Found(Frozen):
    ...     order: int
    ...     hankel: np.ndarray
    >>> Found(4, np.zeros(200))
    Found(order=4, hankel=<(200,) float64 array>)
    """
    fields = [field.name for field in dataclasses.fields(thing) if field.repr]
    parts = [f"{name}={_value(getattr(thing, name))}" for name in fields[:_SCREEN]]
    parts += [f"... {len(fields) - _SCREEN} more"] if len(fields) > _SCREEN else []
    line = f"{type(thing).__qualname__}({', '.join(parts)})"
    return line if len(line) <= _LINE else f"{type(thing).__qualname__}(\n  " + ",\n  ".join(parts) + "\n)"


def _value(value: Any) -> str:
    if isinstance(value, np.ndarray):
        return _array(cast(NDArray[Any], value))
    if isinstance(value, enum.Enum):
        return f"{type(value).__name__}.{value.name}"
    if hasattr(value, "nstates"):
        dt = "continuous" if value.dt == 0 else f"dt={value.dt}"
        return f"<StateSpace: {value.nstates} states, {value.noutputs}x{value.ninputs}, {dt}>"
    if type(value) in (tuple, list) or isinstance(value, Mapping):
        return _several(cast(Mapping[Any, Any] | Sequence[Any], value))
    text = repr(value)
    return text if len(text) <= _LINE and "\n" not in text else f"<{type(value).__name__}>"


def _array(value: NDArray[Any]) -> str:
    if value.size <= _FEW and value.ndim <= 1:
        text = np.array2string(value, separator=", ", precision=6, max_line_width=10 * _LINE)
        if len(text) <= _LINE:
            return text
    return f"<{value.shape} {value.dtype} array>"


def _several(value: Mapping[Any, Any] | Sequence[Any]) -> str:
    """Items of a few that are short; else how many there are."""
    if len(value) <= _FEW:
        if isinstance(value, Mapping):
            text = "{" + ", ".join(f"{key!r}: {_value(item)}" for key, item in value.items()) + "}"
        else:
            text = ", ".join(map(_value, value))
            text = f"[{text}]" if isinstance(value, list) else f"({text}{',' * (len(value) == 1)})"
        if len(text) <= _LINE and "\n" not in text:
            return text
    return f"<{type(value).__name__} of {len(value)}>"

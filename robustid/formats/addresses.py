"""Addresses of parts of arrays, ``"hairdryer[:,0]"``, and names of their axes, ``"time,signal"``; read, never executed."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from types import EllipsisType
from typing import NamedTuple, cast

import numpy as np

from robustid.errors import InputError, Remedy

Index = int | slice | EllipsisType

_ADDRESS = re.compile(r"(?P<name>.*?)\s*\[(?P<index>[-+\d:,.\s]*)\]", re.DOTALL)
TIME_AXES = ("realisation", "period", "time", "signal")
FREQUENCY_AXES = ("frequency", "output", "input")
_SYNONYMS = {"channel": "signal", "sample": "time", "realization": "realisation", "experiment": "realisation"}
_WHOLE = re.compile(r"[-+]?\d{1,12}")


class Address(NamedTuple):
    """Name of an array ("" where the file has one array, without a name), and the part of it."""

    name: str
    parts: tuple[Index, ...]


def parse(text: str) -> Address | None:
    """The address that a text is; None for a plain name, and for a unit in brackets such as ``"ratio [1/s]"``."""
    if (match := _ADDRESS.fullmatch(text.strip())) is None:
        return None
    parts = [_part(part.strip()) for part in match["index"].split(",")]
    known = tuple(part for part in parts if part is not None)
    return Address(match["name"], known) if len(known) == len(parts) else None


def _part(text: str) -> Index | None:
    """A whole number, a slice or ``...``; None for anything else."""
    if text == "...":
        return ...
    if _WHOLE.fullmatch(text):
        return int(text)
    pieces = [piece.strip() for piece in text.split(":")]
    if not 2 <= len(pieces) <= 3 or any(piece and not _WHOLE.fullmatch(piece) for piece in pieces):
        return None
    return slice(*(int(piece) if piece else None for piece in pieces))


def taken(what: str, index: tuple[Index, ...], values: np.ndarray) -> np.ndarray:
    """The part of an array that an index names; `what` stands in the sentence where there is none."""
    parts = expanded(what, index, values.shape)
    for axis, (part, length) in enumerate(zip(parts, values.shape, strict=True)):
        if isinstance(part, int) and not -length <= part < length:
            raise InputError(
                f"{what}: there is no {part} on axis {axis} of the shape {values.shape}; indices count from 0 to {length - 1}"
            )
        if isinstance(part, slice) and (part.step == 0 or not len(range(*part.indices(length)))):
            raise InputError(f"{what} takes nothing from axis {axis} of the shape {values.shape}")
    return values[parts]


def expanded(what: str, index: tuple[Index, ...], shape: tuple[int, ...]) -> tuple[int | slice, ...]:
    """One part an axis: those of ``...`` and those left out are whole."""
    at = [k for k, part in enumerate(index) if part is ...]
    missing = len(shape) - len(index) + len(at)
    if len(at) > 1 or missing < 0:
        raise InputError(f"{what} has {len(index)} indices, and the array has the shape {shape}")
    place = at[0] if at else len(index)
    whole = (slice(None),) * missing
    return tuple(
        part for part in (*index[:place], *whole, *index[place + len(at) :]) if not isinstance(part, EllipsisType)
    )


def part_of(names: Mapping[str, object], first: int, end: int, step: int = 1) -> Remedy | None:
    """Addresses of samples from `first` to before `end` of arrays by roles; None where one is a part of an array already."""
    listed = {role: cast("list[str]", one if isinstance(one, list) else [one]) for role, one in names.items()}
    if any(parse(one) is not None for several in listed.values() for one in several):
        return None
    samples = _text(slice(first, end, None if step == 1 else step))
    parts = {role: [f"{one}[{samples}]" for one in several] for role, several in listed.items()}
    return Remedy({"fields": {role: one if isinstance(names[role], list) else one[0] for role, one in parts.items()}})


def columns(address: Address, shape: tuple[int, ...]) -> list[str]:
    """The addresses of the columns of a slice that is a matrix: ``x[:,0:2]`` is ``x[:,0]`` and ``x[:,1]``."""
    parts = expanded(address.name, address.parts, shape)
    second = [axis for axis, part in enumerate(parts) if isinstance(part, slice)][1:2]
    if not second:
        return [written(address.name, parts)]
    axis = second[0]
    numbers = range(*slice_of(parts[axis]).indices(shape[axis]))
    return [written(address.name, (*parts[:axis], number, *parts[axis + 1 :])) for number in numbers]


def slice_of(part: int | slice) -> slice:
    """One index as the slice that it is."""
    return part if isinstance(part, slice) else slice(part, part + 1)


def written(name: str, index: Sequence[Index]) -> str:
    """The text of an address."""
    return f"{name}[{','.join(map(_text, index))}]"


def _text(part: Index) -> str:
    if isinstance(part, EllipsisType):
        return "..."
    if isinstance(part, int):
        return str(part)
    ends = ["" if end is None else str(end) for end in (part.start, part.stop)]
    return ":".join(ends if part.step is None else [*ends, str(part.step)])


def axis_names(text: object) -> tuple[str, ...]:
    """The names of axes that a text holds, each once, of one kind of data."""
    given = [word.strip().lower() for word in text.split(",")] if isinstance(text, str) else []
    names = tuple(_SYNONYMS.get(name, name) for name in (word.removesuffix("s") for word in given))
    known = [kind for kind in (TIME_AXES, FREQUENCY_AXES) if set(names) <= set(kind)]
    if not names or not known or len(set(names)) < len(names):
        raise InputError(
            f"`axes` names the axes of the arrays in their order, of a time record from {', '.join(TIME_AXES)}, of a frequency"
            f" response from {', '.join(FREQUENCY_AXES)}, each once, such as 'time,signal'; got {text!r}"
        )
    first = "time" if known[0] is TIME_AXES else "frequency"
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

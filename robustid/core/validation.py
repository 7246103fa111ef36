"""The only validation helpers: shapes, finiteness, signals."""

from __future__ import annotations

import operator
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, TypeVar, cast

import numpy as np

from robustid.errors import InputError, InputTypeError

Kind = TypeVar("Kind")
Called = TypeVar("Called", bound=Callable[..., Any])


class Signal(NamedTuple):
    """Name and unit of one input or output signal; ``str()`` gives ``name [unit]``."""

    name: str
    unit: str = ""

    def __str__(self) -> str:
        return f"{self.name} [{self.unit}]" if self.unit else self.name


def as_array(name: str, value: Any, *, dtype: type = float, ndim: int | None = None, finite: bool = True) -> np.ndarray:
    """Convert to a fresh array of `dtype`, or say by name why not."""
    if value is None:
        raise InputTypeError(f"`{name}` is required; got None")
    try:
        array = np.array(value)
        if array.dtype == object or array.dtype.kind in "USOMmV":
            raise TypeError
        if dtype is float and np.iscomplexobj(array):
            raise InputTypeError(f"`{name}` must be real; got complex values")
        array = array.astype(dtype, copy=False)  # it is a copy already
    except InputTypeError:
        raise
    except (TypeError, ValueError):
        raise InputTypeError(f"`{name}` must be an array of numbers; got {_brief(value)}") from None
    if ndim is not None and array.ndim != ndim:
        raise InputError(f"`{name}` must have {ndim} dimension{'s' * (ndim != 1)}; got shape {array.shape}")
    if finite and not np.all(np.isfinite(array)):
        where = np.argwhere(~np.isfinite(array))
        raise InputError(
            f"`{name}` must be finite; got {array[tuple(where[0])]} at index {tuple(int(i) for i in where[0])}"
            f" ({len(where)} of {array.size} values are not finite)"
        )
    return array


def as_positive(name: str, value: object) -> float:
    """A finite float > 0."""
    number = as_float(name, value)
    if not number > 0:
        raise InputError(f"`{name}` must be positive; got {number:g}")
    return number


def as_float(name: str, value: object) -> float:
    """A finite real scalar."""
    if isinstance(value, str | bytes) or callable(value):
        raise InputTypeError(f"`{name}` must be one number; got {_brief(value)}")
    array = as_array(name, value, finite=False)
    if array.size != 1:
        raise InputTypeError(f"`{name}` must be one number; got shape {array.shape}")
    number = float(array.reshape(()))
    if not np.isfinite(number):
        raise InputError(f"`{name}` must be finite; got {number:g}")
    return number


def as_count(name: str, value: Any, *, least: int = 0) -> int:
    """An integer >= `least`."""
    try:
        number = operator.index(value)
    except TypeError:
        raise InputTypeError(f"`{name}` must be an integer; got {_brief(value)}") from None
    if number < least:
        raise InputError(f"`{name}` must be at least {least}; got {number}")
    return number


def as_kind(name: str, value: object, kind: type[Kind] | tuple[type[Kind], ...], described: str) -> Kind:
    """`value` itself, if it is of the `kind`; else a sentence with what it must be."""
    if not isinstance(value, kind):
        raise InputTypeError(f"`{name}` must be {described}; got {type(value).__name__}")
    return value


def as_flag(name: str, value: object) -> bool:
    """True or False; a word such as "no" would count as true."""
    if not isinstance(value, bool | np.bool_):
        raise InputTypeError(f"`{name}` must be True or False; got {_brief(value)}")
    return bool(cast("bool", value))


def as_function(name: str, value: Called | None) -> Called | None:
    """`value` itself, if it can be called or is None; else a sentence."""
    if value is not None and not callable(value):
        raise InputTypeError(f"`{name}` must be a function; got {_brief(value)}")
    return value


def as_signals(name: str, value: Any, count: int, letter: str) -> tuple[Signal, ...]:
    """Signal names and units: strings, ``"name [unit]"``, or (name, unit) pairs."""
    if value is None:
        return tuple(Signal(f"{letter}{i + 1}" if count > 1 else letter) for i in range(count))
    if isinstance(value, str | Signal):
        value = [value]
    items: list[Any] | None = list(value) if isinstance(value, Sequence) else None  # type: ignore[reportUnknownArgumentType]
    if items is None or len(items) != count:
        raise InputError(f"`{name}` must name {count} signal{'s' * (count != 1)}; got {_brief(value)}")
    return tuple(_signal(name, item) for item in items)


def _signal(name: str, item: Any) -> Signal:
    if isinstance(item, str):
        text = item.strip()
        if text.endswith("]") and "[" in text:
            label, unit = text[:-1].rsplit("[", 1)
            return Signal(label.strip(), unit.strip())
        return Signal(text)
    parts: list[Any] = list(item) if isinstance(item, Sequence) else []  # type: ignore[reportUnknownArgumentType]
    if len(parts) == 2 and all(isinstance(part, str) for part in parts):
        return Signal(*parts)
    raise InputTypeError(f'`{name}` must hold names such as "current [A]" or pairs (name, unit); got {_brief(item)}')


def _brief(value: Any) -> str:
    text = repr(value)
    return f"{type(value).__name__} {text if len(text) <= 60 else text[:57] + '...'}"

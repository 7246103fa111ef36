"""The only validation helpers: shapes, finiteness, freezing."""

from __future__ import annotations

import dataclasses
import operator
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from robustid.core.printing import short_repr
from robustid.errors import InputError, InputTypeError

Kind = TypeVar("Kind")
Called = TypeVar("Called", bound=Callable[..., Any])


class Signal(NamedTuple):
    """Name and unit of one input or output signal; ``str()`` gives ``name [unit]``."""

    name: str
    unit: str = ""

    def __str__(self) -> str:
        return f"{self.name} [{self.unit}]" if self.unit else self.name


_SMALL = 100  # numbers that are sent as they are


class Frozen:
    """Mixin of frozen dataclasses: copies and pickles go through ``__init__``, so that they stay checked and read-only.

    They print in at most a screen (`short_repr`).
    """

    def __init_subclass__(cls, **options: Any) -> None:
        """Keep the dataclass from writing a `__repr__` that prints every number."""
        super().__init_subclass__(**options)
        if "__repr__" not in cls.__dict__:
            cls.__repr__ = cls.__repr__  # in the class itself, where the decorator looks for one

    def __repr__(self) -> str:
        return short_repr(self)

    def _repr_html_(self) -> str | None:
        """Head of the page about it, which notebooks show."""
        from robustid.figures import head

        return head(self)

    def __reduce__(self) -> tuple[Any, tuple[type[Any], dict[str, Any]]]:
        fields = {f.name: _pack(getattr(self, f.name)) for f in dataclasses.fields(self) if f.init}  # type: ignore[arg-type]
        return _rebuild, (type(self), fields)

    def _set(self, **values: Any) -> None:
        for name, value in values.items():
            object.__setattr__(self, name, value)


def _rebuild(cls: type[Any], fields: dict[str, Any]) -> Any:
    return cls(**{name: _unpack(value) for name, value in fields.items()})


class _PackedModel(NamedTuple):
    """The parts of a `control.StateSpace`: the object itself holds lambdas, which can't be pickled."""

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    dt: Any
    inputs: list[str]
    outputs: list[str]
    name: str


class _PackedRows(NamedTuple):
    """An array of which at least half of the rows are zero: what is known of a part, among the numbers of the whole."""

    length: int
    rows: np.ndarray
    values: np.ndarray


def _pack(value: Any) -> Any:
    if type(value).__module__.startswith("control.") and type(value).__name__ == "StateSpace":
        matrices = (value.A, value.B, value.C, value.D)
        return _PackedModel(*matrices, value.dt, value.input_labels, value.output_labels, value.name)
    return _without_zeros(cast("NDArray[Any]", value)) if isinstance(value, np.ndarray) else value


def _without_zeros(array: NDArray[Any]) -> NDArray[Any] | _PackedRows:
    if array.ndim not in (1, 2) or array.size <= _SMALL:
        return array
    rows = np.flatnonzero(array.reshape(len(array), -1).any(axis=1))
    return _PackedRows(len(array), rows, array[rows]) if 2 * rows.size <= len(array) else array


def _unpack(value: Any) -> Any:
    if isinstance(value, _PackedModel):
        import control

        return control.ss(*value[:4], value.dt, inputs=value.inputs, outputs=value.outputs, name=value.name)
    if isinstance(value, _PackedRows):
        whole = np.zeros((value.length, *value.values.shape[1:]), value.values.dtype)
        whole[value.rows] = value.values
        return whole
    return value


def freeze(array: np.ndarray) -> np.ndarray:
    """A read-only array that nobody else can write to."""
    array = np.array(array)
    array.flags.writeable = False
    return array


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
        array = array.astype(dtype)
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


def as_positive(name: str, value: Any) -> float:
    """A finite float > 0."""
    number = as_float(name, value)
    if not number > 0:
        raise InputError(f"`{name}` must be positive; got {number:g}")
    return number


def as_float(name: str, value: Any) -> float:
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


def as_kind(name: str, value: Any, kind: type[Kind] | tuple[type[Kind], ...], described: str) -> Kind:
    """`value` itself, if it is of the `kind`; else a sentence with what it must be."""
    if not isinstance(value, kind):
        raise InputTypeError(f"`{name}` must be {described}; got {type(value).__name__}")
    return value


def as_flag(name: str, value: Any) -> bool:
    """True or False; a word such as "no" would count as true."""
    if not isinstance(value, bool | np.bool_):
        raise InputTypeError(f"`{name}` must be True or False; got {_brief(value)}")
    return bool(cast("bool", value))


def as_function(name: str, value: Called | None) -> Called | None:
    """`value` itself, if it can be called or is None; else a sentence."""
    if value is not None and not callable(value):
        raise InputTypeError(f"`{name}` must be a function; got {_brief(value)}")
    return value


def as_bound(value: Any, shape: tuple[int, ...], axis: str, *, infinite: bool = False) -> np.ndarray | None:
    """Broadcast a bound (scalar, per sample, or per sample and signal) to `shape`, positive everywhere."""
    if value is None:
        return None
    bound = as_array("bound", value, finite=not infinite)
    if np.any(np.isnan(bound)):
        raise InputError(f"`bound` must not contain NaN; got {int(np.isnan(bound).sum())} of them")
    if bound.ndim == 1 and bound.shape == shape[:1]:
        bound = bound.reshape(shape[:1] + (1,) * (len(shape) - 1))
    elif bound.ndim != 0 and bound.shape != shape:
        raise InputError(
            f"`bound` must be a scalar or have shape ({axis},) = {shape[:1]} or {shape}; got {bound.shape}"
        )
    if np.any(bound <= 0):
        raise InputError(
            f"`bound` must be positive (it divides the residuals); got a smallest value of {bound.min():g}."
            " For samples known exactly give a bound small against the data, such as 1e-6 of their size"
        )
    return freeze(np.broadcast_to(bound, shape))


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

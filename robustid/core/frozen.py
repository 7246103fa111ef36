"""Values that nobody can change: frozen dataclasses, which copy, pickle and print well, and arrays."""

from __future__ import annotations

import dataclasses
import enum
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from robustid.core.calling import explain_methods

_SMALL = 100  # numbers that are sent as they are
_FEW = 6  # numbers, items or fields that are written out
_LINE = 100  # characters of one value
_SCREEN = 24  # fields


class Frozen:
    """Mixin of frozen dataclasses: copies and pickles go through ``__init__``, so that they stay checked and read-only.

    They print in at most a screen.
    """

    def __init_subclass__(cls, **options: object) -> None:
        """Keep the dataclass from writing a `__repr__` that prints every number; explain wrong calls of its methods."""
        super().__init_subclass__(**options)
        explain_methods(cls)
        if "__repr__" not in cls.__dict__:
            cls.__repr__ = cls.__repr__  # in the class itself, where the decorator looks for one

    def __repr__(self) -> str:
        # at most a screen: small values as they are, of large ones their kind and size
        fields = [field.name for field in dataclasses.fields(self) if field.repr]  # type: ignore[arg-type]
        parts = [f"{name}={_value(getattr(self, name))}" for name in fields[:_SCREEN]]
        parts += [f"... {len(fields) - _SCREEN} more"] if len(fields) > _SCREEN else []
        line = f"{type(self).__qualname__}({', '.join(parts)})"
        return line if len(line) <= _LINE else f"{type(self).__qualname__}(\n  " + ",\n  ".join(parts) + "\n)"

    def _repr_html_(self) -> str | None:
        """Head of the page about it, which notebooks show."""
        from robustid.figures import head

        return head(self)

    if not TYPE_CHECKING:  # types know which attributes there are

        def __getattr__(self, name: str) -> Any:
            """Refuse an attribute that is not there, with what is meant; a property that failed fails as it did."""
            if hasattr(type(self), name):
                return object.__getattribute__(self, name)
            raise MissingAttribute(self, name)

    def __reduce__(self) -> tuple[object, tuple[type[Frozen], dict[str, object]]]:
        fields = {f.name: _pack(getattr(self, f.name)) for f in dataclasses.fields(self) if f.init}  # type: ignore[arg-type]
        return _rebuild, (type(self), fields)

    def _set(self, **values: object) -> None:
        for name, value in values.items():
            object.__setattr__(self, name, value)


class MissingAttribute(AttributeError):
    """An attribute that is not there; what is meant is looked for when it is said, not whenever code asks for one."""

    def __init__(self, thing: object, name: str) -> None:
        super().__init__(thing, name)
        self.thing, self.typed = thing, name

    def __str__(self) -> str:
        from robustid.figures import led_on

        return led_on(self.thing, self.typed)

    def __reduce__(self) -> tuple[type[AttributeError], tuple[str]]:
        return AttributeError, (str(self),)


def _rebuild(cls: type[Frozen], fields: dict[str, object]) -> Frozen:
    return cls(**{name: _unpack(value) for name, value in fields.items()})


class _PackedModel(NamedTuple):
    """The parts of a `control.StateSpace`: the object itself holds lambdas, which can't be pickled."""

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    dt: float | None
    inputs: list[str]
    outputs: list[str]
    name: str


class _PackedRows(NamedTuple):
    """An array of which at least half of the rows are zero: what is known of a part, among the numbers of the whole."""

    length: int
    rows: np.ndarray
    values: np.ndarray


def _pack(value: Any) -> object:
    if type(value).__module__.startswith("control.") and type(value).__name__ == "StateSpace":
        matrices = (value.A, value.B, value.C, value.D)
        return _PackedModel(*matrices, value.dt, value.input_labels, value.output_labels, value.name)
    return _without_zeros(cast("NDArray[Any]", value)) if isinstance(value, np.ndarray) else value


def _without_zeros(array: NDArray[Any]) -> NDArray[Any] | _PackedRows:
    if array.ndim not in (1, 2) or array.size <= _SMALL:
        return array
    rows = np.flatnonzero(array.reshape(len(array), -1).any(axis=1))
    return _PackedRows(len(array), rows, array[rows]) if 2 * rows.size <= len(array) else array


def _unpack(value: object) -> object:
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


def _value(value: Any) -> str:
    if isinstance(value, np.ndarray):
        return _array(cast(NDArray[Any], value))
    if isinstance(value, enum.Enum):
        return f"{type(value).__name__}.{value.name}"
    if hasattr(value, "nstates"):
        dt = "continuous" if value.dt == 0 else f"dt={value.dt}"
        return f"<StateSpace: {value.nstates} states, {value.noutputs}x{value.ninputs}, {dt}>"
    if type(value) in (tuple, list) or isinstance(value, Mapping):
        return _several(cast(Mapping[object, object] | Sequence[object], value))
    text = repr(value)
    return text if len(text) <= _LINE and "\n" not in text else f"<{type(value).__name__}>"


def _array(value: NDArray[Any]) -> str:
    if value.size <= _FEW and value.ndim <= 1:
        text = np.array2string(value, separator=", ", precision=6, max_line_width=10 * _LINE)
        if len(text) <= _LINE:
            return text
    return f"<{value.shape} {value.dtype} array>"


def _several(value: Mapping[object, object] | Sequence[object]) -> str:
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

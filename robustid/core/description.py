"""Values as text and arrays, and made from them again: numbers, texts, tuples and the classes that are registered, nothing else.

What is read may come from a stranger: no name in it is imported, a class is found in the register alone, and its fields must be
those that it states, with values of their types.
"""

from __future__ import annotations

import dataclasses
import enum
import functools
import hashlib
import inspect
import json
import types
import typing
from collections.abc import Callable, Collection
from typing import Any

import numpy as np

from robustid.core.progress import Progress
from robustid.errors import FileFormatError, InputTypeError

Arrays = dict[str, np.ndarray]
Record = dict[str, Any]  # an object as text has it: numbers, texts, lists and records by their names
Options = dict[str, Any]  # arguments of a call by their names
_TOLD = "progress"  # an argument that is no field
_NUMBERS = {float: (int, float), complex: (int, float, complex), int: (int,)}


@dataclasses.dataclass(frozen=True, eq=False)
class Form:
    """The fields that are stored of the objects of a class, the function of these fields that makes them again, and a check."""

    cls: type
    evidence: Callable[[Any], Record]
    make: Callable[..., Any]
    verify: Callable[[Any], None] | None = None

    @functools.cached_property
    def types(self) -> dict[str, Any]:
        """Types of the fields by name."""
        hints = typing.get_type_hints(self.make)
        return {name: hints[name] for name in self._arguments if name != _TOLD}

    @property
    def _arguments(self) -> Collection[str]:
        return inspect.signature(self.make).parameters

    def described(self, value: object, path: str, arrays: Arrays) -> Record:
        """Text of the fields of an object; their arrays go to `arrays`, by path."""
        return _described_items(self.evidence(value), path, arrays)

    def made(self, text: Record, arrays: Arrays, progress: Progress | None = None) -> Any:
        """Make an object of its fields; a function with an argument `progress` tells how far it is."""
        name = self.cls.__name__
        if text.keys() != self.types.keys():
            wrong = sorted(text.keys() ^ self.types.keys())[0]
            raise FileFormatError(
                f"it was saved by another version of robustid, or edited since: the field {wrong!r} of its {name} is"
                f" {'unknown' if wrong in text else 'missing'}; make it again with this version, from its data"
            )
        fields = {field: made(item, arrays) for field, item in text.items()}
        for field, value in fields.items():
            if not _fits(value, self.types[field]):
                raise ValueError(f"the field {field!r} of its {name} can't be a {type(value).__name__} as it is there")
        thing = self.make(**fields, **({_TOLD: progress} if _TOLD in self._arguments else {}))
        if self.verify is not None:
            self.verify(thing)
        return thing


_FORMS: dict[str, Form] = {}


def stored(
    *classes: type,
    evidence: Callable[[Any], Record] | None = None,
    make: Callable[..., Any] | None = None,
    verify: Callable[[Any], None] | None = None,
) -> None:
    """Register dataclasses, NamedTuples and enumerations that files may hold.

    Parameters
    ----------
    *classes : type
    evidence : callable, optional
        From an object to the fields that are stored; default: those from which it is made.
    make : callable, optional
        From these fields, which it takes by name and with their types, to the object; default: the class itself.
    verify : callable, optional
        Raises ValueError where an object claims more than its own numbers support.
    """
    for cls in classes:
        if cls.__name__ in _FORMS:
            raise ValueError(f"two classes named {cls.__name__} can't both be stored")
        _FORMS[cls.__name__] = Form(cls, evidence or fields_of, make or cls, verify)


def form_of(cls: type) -> Form:
    """Form of a registered class, or of the nearest registered one that it is derived from; KeyError of any other."""
    for base in cls.__mro__:
        if (form := _FORMS.get(base.__name__)) is not None and form.cls is base:
            return form
    raise KeyError(cls.__name__)


def fields_of(value: Any) -> Record:
    """The fields from which a dataclass or NamedTuple is made."""
    if dataclasses.is_dataclass(value):
        return {field.name: getattr(value, field.name) for field in dataclasses.fields(value) if field.init}
    return value._asdict()


def described(value: Any, path: str, arrays: Arrays) -> Any:
    """Text of a value, as JSON can hold it; its arrays go to `arrays`, by path.

    InputTypeError: a value of a class that is not registered.
    """
    if isinstance(value, np.generic):
        return described(typing.cast("object", value.item()), path, arrays)
    cls: type[object] = value.__class__
    if issubclass(cls, np.ndarray):
        arrays[path] = value
        return {"$array": path}
    if issubclass(cls, enum.Enum):
        return {"$one of": [cls.__name__, value.name]}
    if cls in (bool, int, float, str, type(None)):
        return value
    if cls is complex:
        return {"$complex": [value.real, value.imag]}
    if cls is dict:
        return _described_items(value, path, arrays)
    if cls in (tuple, list):
        items = list(_described_items({str(k): item for k, item in enumerate(value)}, path, arrays).values())
        return items if cls is tuple else {"$list": items}
    try:
        form = form_of(cls)
    except KeyError:
        raise InputTypeError(f"a {cls.__name__} can't be stored ({path})") from None
    return {"$class": form.cls.__name__} | form.described(value, path, arrays)


def _described_items(items: Record, path: str, arrays: Arrays) -> Record:
    if any(type(name) is not str or name.startswith("$") for name in items):
        raise InputTypeError(f"the keys of a dictionary must be texts without $ to be stored ({path})")
    return {name: described(item, f"{path}/{name}" if path else name, arrays) for name, item in items.items()}


def made(text: Any, arrays: Arrays) -> Any:
    """Make the value again that was described so.

    ValueError, TypeError, KeyError: a text that describes nothing.
    """
    if isinstance(text, list):
        return tuple(made(item, arrays) for item in typing.cast("list[Any]", text))
    if not isinstance(text, dict):
        return text
    fields: Record = dict(typing.cast("Record", text))
    tag = next((name for name in fields if name.startswith("$")), None)
    if tag is None:
        return {name: made(item, arrays) for name, item in fields.items()}
    said = fields.pop(tag)
    if tag == "$class":
        return _form(said).made(fields, arrays)
    if fields:
        raise ValueError(f"there is more beside its {tag}")
    if tag == "$array":
        return arrays[said]
    if tag == "$list":
        return list(made(said, arrays))
    if tag == "$complex":
        real, imag = said
        return complex(real, imag)
    if tag == "$one of":
        name, member = said
        kind = _form(name).cls
        if issubclass(kind, enum.Enum):
            return kind[member]
        raise ValueError(f"{name} has no members to choose from")
    raise ValueError(f"it holds {tag!r}, which has no meaning")


def _form(name: Any) -> Form:
    if type(name) is not str or name not in _FORMS:
        raise ValueError(f"it holds an object of {name!r}, which is no class that can be stored")
    return _FORMS[name]


def _fits(value: Any, wanted: Any) -> bool:
    """Return whether a value is of a type as annotations state it."""
    origin, inner, cls = typing.get_origin(wanted) or wanted, typing.get_args(wanted), value.__class__
    if wanted is Any:
        return True
    if origin in (typing.Union, types.UnionType):
        return any(_fits(value, one) for one in inner)
    if typing.is_typeddict(wanted):
        hints = typing.get_type_hints(wanted)
        return cls is dict and value.keys() == hints.keys() and all(_fits(value[name], hints[name]) for name in hints)
    if origin is dict and inner:
        return cls is dict and all(_fits(item, inner[1]) for item in value.values())
    if origin is tuple and inner:
        if cls is not tuple:
            return False
        each = inner[:1] * len(value) if inner[1:] == (...,) else inner
        return len(value) == len(each) and all(map(_fits, value, each))
    if origin is np.ndarray:
        return cls is np.ndarray and _holds(value.dtype, inner)
    if origin in _NUMBERS:
        return cls in _NUMBERS[origin]
    return issubclass(cls, type(None) if origin is None else origin)


def _holds(dtype: np.dtype[Any], inner: tuple[Any, ...]) -> bool:
    """Return whether an array has numbers, of the kind that its annotation states where it states one."""
    stated = typing.get_args(inner[1]) if inner else ()
    kind = stated[0] if stated and isinstance(stated[0], type) else np.complex128
    return dtype.kind in "biufc" and np.can_cast(dtype, kind, "same_kind")


def fingerprint(value: object) -> str:
    """SHA-256 of everything that is stored of a value: equal for what was saved and what was loaded."""
    arrays: Arrays = {}
    return digest(arrays, described(value, "", arrays))


def digest(arrays: Arrays, text: object = None) -> str:
    """SHA-256 of arrays with their names, types and shapes, and of a text of any structure."""
    total = hashlib.sha256(json.dumps(text, sort_keys=True).encode())
    for name in sorted(arrays):
        array = np.ascontiguousarray(arrays[name])
        total.update(f"{name} {array.dtype.str} {array.shape}".encode())
        total.update(array.tobytes())
    return total.hexdigest()

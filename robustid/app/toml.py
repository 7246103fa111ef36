"""Run files as text: TOML read by the standard library, written here, and what is wrong said in one sentence."""

from __future__ import annotations

import dataclasses
import difflib
import json
import math
import re
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

from robustid.errors import FileFormatError, InputError, InputTypeError

AUTO = "auto"
Check = Callable[[str, Any], Any]


def read_toml(path: Path) -> dict[str, Any]:
    """The content of a TOML file.

    Raises
    ------
    FileFormatError
        No such file, or not TOML.
    """
    import tomllib

    try:
        return tomllib.loads(path.read_bytes().decode("utf-8"))
    except OSError as error:
        raise FileFormatError(f"{path} can't be read: {error.strerror}") from None
    except UnicodeDecodeError:
        raise FileFormatError(f"{path} is no text in UTF-8; a run file is TOML") from None
    except tomllib.TOMLDecodeError as error:
        raise FileFormatError(f"{path} is not TOML: {error}") from None


def key(check: Check, default: Any = None) -> Any:
    """A field of a section, with what its value must be; None: left to the program."""
    return dataclasses.field(default=default, metadata={"check": check})


def section(kind: Any, content: Any, place: str) -> Any:
    """A section of the kind, every key known and of the right type."""
    if not isinstance(content, Mapping):
        raise InputTypeError(f"{place} must be a section with keys; got {_got(content)}")
    checks = {field.name: field.metadata["check"] for field in dataclasses.fields(kind) if "check" in field.metadata}
    refuse_unknown(content, checks, place)
    return kind(**{name: checks[name](f"{place} {name}", value) for name, value in content.items()})


def refuse_unknown(content: Mapping[str, Any], known: Iterable[str], place: str) -> None:
    """InputError with the nearest known key for one that isn't."""
    known = list(known)
    for name in content:
        if name not in known:
            near = difflib.get_close_matches(name, known, n=1, cutoff=0.0)[0]
            raise InputError(f"{place} has no key {name!r}; the nearest is {near!r} (all: {', '.join(known)})")


def text(*choices: str) -> Check:
    """Text, one of the choices where there are any."""

    def check(name: str, value: Any) -> str:
        if not isinstance(value, str):
            raise InputTypeError(f"{name} must be text in quotes; got {_got(value)}")
        if choices and value not in choices:
            raise InputError(f"{name} must be one of {', '.join(map(repr, choices))}; got {value!r}")
        return value

    return check


def number(above: float = -math.inf, least: float = -math.inf) -> Check:
    """A finite number."""

    def check(name: str, value: Any) -> float:
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise InputTypeError(f"{name} must be a number; got {_got(value)}")
        if not math.isfinite(value):
            raise InputError(f"{name} must be finite; got {value}")
        if value <= above or value < least:
            limit = f"above {above:g}" if value <= above else f"at least {least:g}"
            raise InputError(f"{name} must be {limit}; got {value:g}")
        return float(value)

    return check


def whole(least: int = 0) -> Check:
    """A whole number."""

    def check(name: str, value: Any) -> int:
        if isinstance(value, bool) or not isinstance(value, int):
            raise InputTypeError(f"{name} must be a whole number; got {_got(value)}")
        if value < least:
            raise InputError(f"{name} must be at least {least}; got {value}")
        return value

    return check


def flag(name: str, value: Any) -> bool:
    """True or false."""
    if not isinstance(value, bool):
        raise InputTypeError(f"{name} must be true or false; got {_got(value)}")
    return value


def several(item: Check, size: int | None = None) -> Check:
    """An array, of `size` items where that is given."""

    def check(name: str, value: Any) -> tuple:
        if not isinstance(value, list | tuple):
            raise InputTypeError(f"{name} must be an array in [ ]; got {_got(value)}")
        if size is not None and len(value) != size:
            raise InputError(f"{name} must have {size} items; got {len(value)}")
        return tuple(item(f"{name}, item {k + 1},", one) for k, one in enumerate(value))

    return check


def table(item: Check) -> Check:
    """A table of names and values."""

    def check(name: str, value: Any) -> dict[str, Any]:
        if not isinstance(value, Mapping) or not value:
            raise InputTypeError(f"{name} must be a table such as {{ name = value }}; got {_got(value)}")
        return {part: item(f"{name} {part}", one) for part, one in value.items()}

    return check


def either(*checks: Check) -> Check:
    """What passes one of the checks; the sentence is that of the last."""

    def check(name: str, value: Any) -> Any:
        for one in checks[:-1]:
            try:
                return one(name, value)
            except (InputError, InputTypeError):
                continue
        return checks[-1](name, value)

    return check


def auto_or(item: Check) -> Check:
    """What passes the check, or the word auto."""

    def check(name: str, value: Any) -> Any:
        if isinstance(value, str):
            if value == AUTO:
                return value
            raise InputError(f'{name} must be "{AUTO}" or a number; got {value!r}')
        return item(name, value)

    return check


def write_toml(content: Mapping[str, Any]) -> str:
    """Plain values first, then sections; what is None, or empty as a section, is left out."""
    plain = {k: v for k, v in content.items() if v is not None and not _is_section(v)}
    parts = ["".join(f"{_name(k)} = {_value(v)}\n" for k, v in plain.items())]
    for name, value in content.items():
        if not _is_section(value):
            continue
        many = not isinstance(value, Mapping)
        for item in value if many else [value]:
            lines = [f"{_name(k)} = {_value(v)}\n" for k, v in item.items() if v is not None]
            head = f"[[{name}]]\n" if many else f"[{name}]\n"
            parts.append(head + "".join(lines) if lines else "")
    return "\n".join(part for part in parts if part)


def _is_section(value: Any) -> bool:
    if isinstance(value, list | tuple):
        return bool(value) and all(isinstance(item, Mapping) for item in value)
    return isinstance(value, Mapping)


def _name(name: str) -> str:
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else _quoted(name)


def _value(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int | float):
        return repr(value)  # shortest digits that give the same number again
    if isinstance(value, str):
        if "\n" not in value:
            return _quoted(value)
        return '"""\n' + "\n".join(_quoted(line)[1:-1] for line in value.split("\n")) + '"""'
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{_name(k)} = {_value(v)}" for k, v in value.items()) + " }"
    return "[" + ", ".join(_value(item) for item in value) + "]"


def _quoted(line: str) -> str:
    """JSON's strings are TOML's, but for one letter."""
    return json.dumps(line, ensure_ascii=False).replace("\x7f", "\\u007f")


def _got(value: Any) -> str:
    shown = repr(value)
    return shown if len(shown) <= 60 else shown[:57] + "..."

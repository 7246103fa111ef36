"""Run files as text: TOML read by the standard library, and written here."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TypeGuard

from robustid.errors import FileFormatError


def is_table(value: object) -> TypeGuard[Mapping[str, object]]:
    """True of names with values."""
    return isinstance(value, Mapping)


def is_array(value: object) -> TypeGuard[Sequence[object]]:
    """True of a list, a tuple or another sequence, but for text."""
    return isinstance(value, Sequence) and not isinstance(value, str | bytes)


_OF_DATA = "; for measurements robustid new {} writes a run file"


def read_toml(path: Path) -> dict[str, object]:
    """The content of a TOML file; FileFormatError where there is none."""
    import tomllib

    try:
        return tomllib.loads(path.read_bytes().decode("utf-8"))
    except FileNotFoundError:
        raise FileFormatError(f"{path}: there is no such file; check the name and the folder") from None
    except OSError as error:
        raise FileFormatError(f"{path} can't be read: {error.strerror}") from None
    except UnicodeDecodeError:
        raise FileFormatError(f"{path} is no text in UTF-8; a run file is TOML{_OF_DATA.format(path)}") from None
    except tomllib.TOMLDecodeError as error:
        hint = "" if path.suffix == ".toml" else _OF_DATA.format(path)
        raise FileFormatError(f"{path} is not TOML: {error}{hint}") from None


def write_toml(content: Mapping[str, object]) -> str:
    """Plain values first, then sections; what is None, or empty as a section, is left out."""
    plain = {k: v for k, v in content.items() if v is not None and not is_table(v) and not _sections(v)}
    parts = ["".join(f"{_name(k)} = {_value(v)}\n" for k, v in plain.items())]
    for name, value in content.items():
        for item in _sections(value):
            lines = [f"{_name(k)} = {_value(v)}\n" for k, v in item.items() if v is not None]
            head = f"[{name}]\n" if is_table(value) else f"[[{name}]]\n"
            parts.append(head + "".join(lines) if lines else "")
    return "\n".join(part for part in parts if part)


def _sections(value: object) -> list[Mapping[str, object]]:
    """The tables of a section, one or several; none of a plain value."""
    if is_table(value):
        return [value]
    tables = [item for item in value if is_table(item)] if is_array(value) else []
    return tables if is_array(value) and len(tables) == len(value) else []


def _name(name: str) -> str:
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else _quoted(name)


def _value(value: object) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int | float):
        return repr(value)  # shortest digits that give the same number again
    if isinstance(value, str):
        if "\n" not in value:
            return _quoted(value)
        return '"""\n' + "\n".join(_quoted(line)[1:-1] for line in value.split("\n")) + '"""'
    if is_table(value):
        return "{ " + ", ".join(f"{_name(k)} = {_value(v)}" for k, v in value.items()) + " }"
    if is_array(value):
        return "[" + ", ".join(map(_value, value)) + "]"
    raise TypeError(f"{type(value).__name__} has no place in TOML")


def _quoted(line: str) -> str:
    """JSON's strings are TOML's, but for one letter."""
    return json.dumps(line, ensure_ascii=False).replace("\x7f", "\\u007f")

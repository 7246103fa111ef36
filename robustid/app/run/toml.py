"""Run files as text: TOML read by the standard library, and written here."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from robustid.errors import FileFormatError


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

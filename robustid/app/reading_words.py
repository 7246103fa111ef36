"""Sentences about files, which name the arguments of `load`, in the words of run files and of the command line."""

from __future__ import annotations

import json
import re
import shlex
from collections.abc import Callable
from typing import Any

from robustid.app.toml import write_toml

# As `suggestion` writes an example: roles and addresses as JSON, then other arguments.
_EXAMPLE = re.compile(r"`fields=(?P<fields>\{\".*?\})(?P<more>(?:, \w+=(?:\"[^\"]*\"|[\d.]+))*)`")
_ARGUMENT = re.compile(r", (\w+)=(\"[^\"]*\"|[\d.]+)")
_KEYS = {"frequency_unit": "unit"}


def in_run_file(text: str) -> str:
    """A sentence of the library with its example as lines of a run file."""

    def lines(fields: dict[str, Any], more: dict[str, Any]) -> str:
        keys = {_KEYS.get(name, name): value for name, value in more.items()}
        return f"`{write_toml_line({'fields': fields} | keys)}`"

    return re.sub(r"`(bound|averages)`", r"\1 = ...", _with_example(text, lines))


def in_options(text: str, kind: str) -> str:
    """A sentence of the library with its example as options for a file of this kind."""

    def flags(fields: dict[str, Any], more: dict[str, Any]) -> str:
        words: list[str] = []
        for role, names in fields.items():
            for name in names if isinstance(names, list) else [names]:
                words += [f"--{kind}-field", shlex.quote(f"{role}={name}")]
        for name, value in more.items():
            flag = f"--{kind}-{_KEYS.get(name, name)}" if name in ("start", "step", "frequency_unit") else f"--{name}"
            words += [flag, shlex.quote(str(value))]
        return " ".join(words)

    return _with_example(text, flags)


def write_toml_line(content: dict[str, Any]) -> str:
    """Keys of a section in one line, one after the other."""
    return "; ".join(write_toml({"x": {name: value}}).split("\n")[1] for name, value in content.items())


def _with_example(text: str, write: Callable[[dict[str, Any], dict[str, Any]], str]) -> str:
    def written(match: re.Match[str]) -> str:
        more = {name: json.loads(value) for name, value in _ARGUMENT.findall(match["more"])}
        return write(json.loads(match["fields"]), more)

    return _EXAMPLE.sub(written, text)

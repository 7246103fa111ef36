"""Remedies about files, which give arguments of `load`, in the words of run files and of the command line."""

from __future__ import annotations

import shlex

from robustid.app.toml import write_toml
from robustid.errors import Remedy
from robustid.formats import NAMES

_KEYS = {"frequency_unit": "unit"}
RUN_FILE = {name: f"{name} = ..." for name in ("bound", "averages")}


def in_run_file(remedy: Remedy) -> str:
    """A remedy as lines of a run file."""
    keys = {_KEYS.get(name, name): value for name, value in remedy.arguments.items()}
    lines = (write_toml({"x": {name: value}}).split("\n")[1] for name, value in keys.items())
    return remedy.words or f"`{'; '.join(lines)}`"


def in_options(remedy: Remedy, kind: str) -> str:
    """A remedy as options for a file of this kind."""
    if remedy.words:
        return remedy.words
    words: list[str] = []
    for name, value in remedy.arguments.items():
        if name == "fields":
            several = {role: names if isinstance(names, list) else [names] for role, names in value.items()}
            pairs = [f"{role}={one}" for role, names in several.items() for one in names]
            words += [f"--{kind}-field {shlex.quote(pair)}" for pair in pairs]
        else:
            words.append(f"{option_words(kind)[name]} {shlex.quote(str(value))}")
    return " ".join(words)


def option_words(kind: str) -> dict[str, str]:
    """Options for a file of this kind, by the arguments of `load` and `with_bound` as sentences have them."""
    field = f"--{kind}-field"
    return {
        **{name: f"--{name}" for name in ("dt", "rate", "axes", "decimal", "averages")},
        **{name: f"--frequency-{name}" for name in ("start", "step")},
        **{f"fields[{role!r}]": f"{field} {role}" for role in NAMES},
        **{f"fields={{{role!r}: ...}}": f"{field} {role}=NAME" for role in NAMES},
        "frequency_unit": "--frequency-unit",
        "bound": f"--{kind}-bound",
        "fields": f"{field} ROLE=NAME",
    }

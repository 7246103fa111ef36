"""The form of an answer to another program: every field of the one schema that is published. It needs nothing heavy."""

from __future__ import annotations

import enum
import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, cast

from robustid._version import __version__
from robustid.app.run.toml import is_array
from robustid.core import Record
from robustid.errors import RobustIdError

FORMAT = "robustid answer 1"
SCHEMA = Path(__file__).with_name("answer.schema.json")
Answer = dict[str, Any]


def schema() -> Record:
    """The published schema, JSON Schema 2020-12."""
    return json.loads(SCHEMA.read_text(encoding="utf-8"))


def answer(command: str, status: str, sentence: str, exit_code: int, **found: object) -> Answer:
    """An answer with every field of the schema: what was found, null or nothing for the rest."""
    own = {"format": FORMAT, "program": f"robustid {__version__}", "command": command, "status": status}
    own |= {"sentence": sentence, "exit_code": exit_code}
    lists: Record = dict.fromkeys(
        (
            *("scope", "guarantees", "not_covered", "assumed", "checks", "controllers", "faults", "causes"),
            *("numbers", "contents", "files", "next", "warnings"),
        ),
        (),
    )
    nothing = dict.fromkeys(("margin", "model", "difference", "unfinished", "samples", "choices", "refusal", "summary"))
    return _plain(own | lists | nothing | found)


def text_of(found: Answer) -> str:
    """An answer as it is written; numbers with all their digits."""
    return json.dumps(found, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def _plain(value: Any) -> Any:
    """A value as JSON has it; of numbers that are not finite nothing."""
    if isinstance(value, Mapping):
        return {str(name): _plain(one) for name, one in cast("Mapping[object, object]", value).items()}
    if hasattr(value, "tolist"):  # of numpy, which a refusal doesn't need
        return _plain(value.tolist())
    if isinstance(value, enum.Enum):
        return value.value
    if is_array(value):
        return [_plain(one) for one in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value if isinstance(value, str | int | None) else str(value)


def ended(command: str, status: str, sentence: str, exit_code: int, error: RobustIdError | None = None) -> Answer:
    """The answer of a command that found nothing: refused, stopped, or broken; an error says which argument it is about."""
    about = refusal() if error is None else refusal(error.argument, error.got, error.remedy)
    return answer(command, status, sentence, exit_code, refusal=about if status == "refused" else None)


def refusal(argument: str | None = None, got: object = None, remedy: Mapping[str, Any] | None = None) -> Record:
    """The argument that is wrong or missing, what was got, and arguments that would do.

    A sample time in a remedy stands for one that nobody has said: it is named among the `unknown`, and no value.
    """
    known = {name_of(name): value for name, value in (remedy or {}).items()}
    unknown = [name for name in ("dt",) if name in known]
    kept = {name: value for name, value in known.items() if name not in unknown}
    return {"argument": None if argument is None else name_of(argument), "got": got, "remedy": kept, "unknown": unknown}


def name_of(option: str) -> str:
    """The name of an argument for a tool, of its option."""
    return option.split(maxsplit=1)[0].lstrip("-").replace("-", "_") if option else option

"""Options of commands from their descriptions: a parameter that is a section becomes one option for each field with a flag."""

from __future__ import annotations

import dataclasses
import functools
import inspect
import typing
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer

from robustid.app.run.checks import Option, options
from robustid.app.run.settings import PARTS
from robustid.errors import RobustIdError

if TYPE_CHECKING:
    from robustid.core import Options

FILES = "Files and screen"  # headings of the help
_READING, _CLASS, _USED = "How files are read", "The class", "Data that are used"
_HEADINGS = {
    "RecordSource": _READING,
    "ResponseSource": _READING,
    "LoopChoice": "The loop it was measured in",
    "FrequencyPoints": _USED,
    "Modes": _CLASS,
    "PriorChoice": _CLASS,
    "ControllerChoice": "Structure, limits and goal",
}
_result = functools.partial(typer.Option, rich_help_panel=FILES)
Output = Annotated[Path, _result("--output", "-o", help="Where results go: NAME.npz and NAME.json.")]
Report = Annotated[Path | None, _result("--report", help="Write the HTML report here.")]
Static = Annotated[bool, _result("--static", help="Write the report with pictures only: small, and without scripts.")]
Force = Annotated[bool, _result("--force", help="Replace files that exist.")]
Verbose = Annotated[bool, _result("--verbose", "-v", help="Print everything that was found, not one screen of it.")]
AsJson = Annotated[
    bool,
    _result("--json", help="Print the answer as JSON, by the schema that is published; everything else to stderr."),
]
First = Annotated[
    int | None,
    typer.Option(
        "--first", help="Use only the first so many samples of every record.", metavar="SAMPLES", rich_help_panel=_USED
    ),
]
FLAGS = {
    field.name: option.flag
    for kind in PARTS.values()
    for field, option in options(kind)
    if option.flag and field.name not in ("bound", "fields")
}
_BESIDE = (
    "output",
    "report",
    "static",
    "force",
    "verbose",
    "as_json",
    "source",
    "context",
)  # of every command: no arguments of the library
_METAVARS = {"s": "SECONDS", "Hz": "HZ", "samples": "SAMPLES"}


class Only(NamedTuple):
    """In an annotation: the fields of a section that a command takes."""

    names: tuple[str, ...]


def only(*names: str) -> Only:
    """Some fields of a section: ``asked: Annotated[WorstCase, only("rtol", "directions")]``."""
    return Only(names)


class EndedEarly(Exception):
    """End of a command whose results were written after a Ctrl-C that its loops kept back."""


def opened(command: Callable[..., None]) -> Callable[..., None]:
    """Return the command as typer reads it: with options in place of sections; equal flags are one option."""
    hints = typing.get_type_hints(command, include_extras=True)
    parameters: dict[str, inspect.Parameter] = {}
    parts: dict[str, tuple[Any, dict[str, tuple[str, Option]]]] = {}
    for name, parameter in inspect.signature(command).parameters.items():
        kind, chosen = _section(hints[name])
        if kind is None:
            parameters[name] = parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY, annotation=hints[name])
            continue
        parts[name] = kind, {}
        types = typing.get_type_hints(kind)
        for field, option in options(kind):
            if option.flag and (chosen is None or field.name in chosen):
                title = _title(option)
                parts[name][1][field.name] = title, option
                parameters.setdefault(title, _parameter(option, types[field.name], field.default, kind))

    @functools.wraps(command)
    def called(**given: Any) -> None:
        from robustid.core import Stops

        built = {name: _built(kind, fields, given) for name, (kind, fields) in parts.items()}
        shared = {title for _, fields in parts.values() for title, _ in fields.values()}
        stops = Stops()
        try:
            with stops.listening():
                command(**{name: value for name, value in given.items() if name not in shared}, **built)
        except typer.Exit:
            if not stops.interrupted:
                raise
        except RobustIdError:  # of a step that needs what Ctrl-C has left out
            if not stops.interrupted:
                raise
            raise KeyboardInterrupt from None
        if stops.interrupted:
            raise EndedEarly

    called.__signature__ = inspect.Signature(list(parameters.values()))  # type: ignore[attr-defined]
    called.__annotations__ = {name: parameter.annotation for name, parameter in parameters.items()}
    return called


def words_of(command: Callable[..., None], **others: str) -> dict[str, str]:
    """Words that stand in sentences for Python's arguments: the options of a command, and others in words."""
    own = {name: f"--{name.replace('_', '-')}" for name in inspect.signature(command).parameters if name not in _BESIDE}
    return FLAGS | own | others


def _section(hint: Any) -> tuple[Any, tuple[str, ...] | None]:
    """The section that an annotation names, and which of its fields; None for any other type."""
    kind, *extras = typing.get_args(hint) if typing.get_origin(hint) is Annotated else [hint]
    if not dataclasses.is_dataclass(kind):
        return None, None
    return kind, next((extra.names for extra in extras if isinstance(extra, Only)), None)


def _title(option: Option) -> str:
    """Name of the parameter of an option."""
    return str(option.flag).lstrip("-").replace("-", "_")


def _parameter(option: Option, kind: Any, default: Any, section: Any) -> inspect.Parameter:
    """One option of the command line."""
    if option.text is not None:  # several texts where the value is a table
        kind = str | None if "Mapping" not in str(kind) else list[str] | None
    states_both = kind == bool | None
    shown = typer.Option(
        f"{option.flag}/--no-{str(option.flag)[2:]}" if states_both else option.flag,
        help=option.sentence.replace("[", "\\["),  # no markup of rich
        metavar=option.metavar or _METAVARS.get(option.unit),
        rich_help_panel=_HEADINGS.get(section.__name__),
    )
    return inspect.Parameter(
        _title(option), inspect.Parameter.KEYWORD_ONLY, default=default, annotation=Annotated[kind, shown]
    )


def _built(kind: Any, fields: dict[str, tuple[str, Option]], given: Options) -> Any:
    """The section with what was given, every value checked under the name of its option."""
    values = {}
    for name, (title, option) in fields.items():
        value, flag = given[title], str(option.flag)
        if value is None or value == []:
            continue
        values[name] = option.check(flag, value if option.text is None else option.text(flag, value))
    return kind(**values)

"""The tools: commands of the program with their options as arguments, checked; files only of one folder, never overwritten."""

from __future__ import annotations

import functools
import inspect
import math
import types
import typing
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from typer.models import ArgumentInfo

from robustid.app.cli.bounds import bounds
from robustid.app.cli.command_options import opened
from robustid.app.cli.files import look
from robustid.app.cli.identify import identify
from robustid.app.cli.loops import loop
from robustid.app.cli.refute import refute
from robustid.app.cli.verify import verify
from robustid.app.run.checks import refuse_unknown
from robustid.app.run.toml import is_array
from robustid.core import Record, paths
from robustid.errors import InputError, InputTypeError

# No arguments of a tool: how the answer is written, what replaces files or starts processes, and options that name files as text.
_LEFT_OUT = {"context", "as_json", "force", "static", "workers", "resume", "loop", "excitation", "auxiliary"}
_TYPES = {str: ["string", "number"], Path: "string", float: "number", int: "integer", bool: "boolean"}
_WORDS = {str: "text", Path: "the path of a file", float: "a number", int: "a whole number", bool: "true or false"}
_SHARE = 0.9  # of the time of a call, which is left to a command to end by itself


class Argument(NamedTuple):
    """An option of a command as an argument of a tool."""

    option: str  # "" of one without
    kind: type
    several: bool
    required: bool
    help: str
    default: Any

    @property
    def schema(self) -> Record:
        """JSON Schema of its values."""
        one: Record = {"type": _TYPES[self.kind]}
        found = {"type": "array", "items": one, "minItems": 1} if self.several else one
        return found | {"description": self.help}

    def fits(self, value: object) -> bool:
        """Return whether a value, or every item, is of the kind."""
        if self.several:
            return is_array(value) and len(value) > 0 and all(self._fits(one) for one in value)
        return self._fits(value)

    def _fits(self, value: object) -> bool:
        if isinstance(value, bool):
            return self.kind is bool
        numbers = isinstance(value, int | float) and math.isfinite(value)
        if self.kind in (str, Path):
            return isinstance(value, str) or (numbers and self.kind is str)
        return isinstance(value, int) if self.kind is int else numbers and self.kind is float


class Tool(NamedTuple):
    """A command that others call."""

    name: str
    command: Callable[..., None]
    says: str
    fixed: tuple[str, ...] = ()

    @property
    def arguments(self) -> dict[str, Argument]:
        """The options that are arguments, by their names."""
        return _arguments(self.command)

    @property
    def schema(self) -> Record:
        """JSON Schema of all arguments."""
        return {
            "type": "object",
            "properties": {name: one.schema for name, one in self.arguments.items()},
            "required": [name for name, one in self.arguments.items() if one.required],
            "additionalProperties": False,
        }

    def words(self, given: Mapping[str, Any], folder: Path, limit: float) -> list[str]:
        """The command with these arguments: its words.

        InputError, InputTypeError: an unknown argument, a missing one, one of another kind, a path outside of the folder.
        """
        known = self.arguments
        for name in given:
            try:
                refuse_unknown([name], known, f"the tool {self.name}", "argument")
            except InputError as error:
                error.argument = name
                raise
        for name, one in known.items():
            if one.required and name not in given:
                raise InputError(f"{name} is missing: {one.help}", argument=name)
        if "time_limit" in known:
            given = {"time_limit": min(known["time_limit"].default, _SHARE * limit), **given}
        options: list[str] = []
        placed: list[str] = []
        for name, value in given.items():
            one = known[name]
            if not one.fits(value):
                wanted = "a list, each item " * one.several + _WORDS[one.kind]
                raise InputTypeError(f"{name} must be {wanted}; got {value!r}", argument=name, got=value)
            items = list(value) if one.several else [value]
            if one.kind is Path:
                for item in items:
                    _check_place(name, item, folder)
            if one.kind is bool:
                yes, _, no = one.option.partition("/")
                options += [yes] if bool(value) else [no] * bool(no)
            elif one.option:
                options += [f"{one.option}={item}" for item in items]
            else:
                placed += items
        return [self.command.__name__, *options, *self.fixed, "--json", "--", *placed]


def _check_place(name: str, value: str, folder: Path) -> None:
    """Refuse a path outside of the folder, also by a link, of the file itself or of those of a saved result."""
    try:
        place = folder / value
        held = list(place.iterdir()) if place.is_dir() else []
        inside = all(one.resolve().is_relative_to(folder) for one in (place, *paths(place), *held))
    except (OSError, ValueError):  # no name of a file
        inside = False
    if not inside:
        words = f"{name} = {value!r} lies outside of the folder that the server was started for; give a path inside it"
        raise InputError(words, argument=name, got=value)


@functools.cache
def _arguments(command: Callable[..., None]) -> dict[str, Argument]:
    parameters = inspect.signature(opened(command)).parameters
    return {name: _argument(name, one) for name, one in parameters.items() if name not in _LEFT_OUT}


def _argument(name: str, parameter: inspect.Parameter) -> Argument:
    """The argument that an option is."""
    hint, info = typing.get_args(parameter.annotation)
    kinds = (
        [one for one in typing.get_args(hint) if one is not type(None)] if isinstance(hint, types.UnionType) else [hint]
    )
    several = typing.get_origin(kinds[0]) is list
    kind = typing.get_args(kinds[0])[0] if several else kinds[0]
    placed, default = isinstance(info, ArgumentInfo), parameter.default
    own = next((one for one in info.param_decls or () if one.startswith("--")), None)
    option = own or f"--{name.replace('_', '-')}"
    if kind is bool and own is None:
        option += f"/--no-{option[2:]}"
    text = (info.help or "").replace("\\[", "[") + (f" Written {info.metavar}." if info.metavar and kind is str else "")
    required = default in (inspect.Parameter.empty, ...)
    return Argument("" if placed else option, kind, several, required, text, default)


TOOLS = {
    tool.name: tool
    for tool in (
        Tool(
            "look",
            look,
            "Show what is in files of measurements: names, shapes, ranges, what looks odd, and what has to be told.",
        ),
        Tool(
            "identify",
            identify,
            "Decide whether measurements fit a class of systems, with a proof, and build a model with a guaranteed error. What is"
            " not stated of the class is chosen from the data, and said. Writes NAME.npz and NAME.json.",
        ),
        Tool(
            "bounds",
            bounds,
            "Bound how far every consistent system can be from an identified model, frequency by frequency, with certificates."
            " Writes NAME and NAME-band, each .npz and .json.",
            ("--workers=1",),  # one that is ended leaves no other process
        ),
        Tool("refute", refute, "Decide whether new measurements contradict an identification or a band, with a proof."),
        Tool(
            "margin",
            loop,
            "Robust stability margin of controllers with every plant that the data allow: proved stable, or refuted by a plant;"
            " with peaks and margins of the loop. Writes NAME.npz and NAME.json.",
        ),
        Tool("verify", verify, "Evaluate every proof in a saved file again, from its numbers and without a solver."),
    )
}

"""Misuse of a command that leads on: files that stand where an option takes them, and what is missing, with an example."""

from __future__ import annotations

import inspect
import itertools
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from typer import Context

from robustid.errors import InputError

_KINDS = "--frequency", "--time"
_EXAMPLE = re.compile(r"\[bold\]Example\[/bold\]: (robustid .*?)(?:\n *\n|\n *\[bold\]|\Z)", re.S)


def lead_on(command: Any, context: Context, words: Sequence[str]) -> None:
    """Refuse words that a command can't take, with the line that does what they mean."""
    given, over, _ = command.make_parser(context).parse_args(list(words))
    if context.resilient_parsing or any(given.get(one.name) for one in command.get_params(context) if one.is_eager):
        return
    known = {flag: one for one in command.params for flag in (*one.opts, *one.secondary_opts)}
    for word, after in itertools.pairwise(words):
        if word in _valued(command) and after in known:
            raise InputError(f"{word} needs a value, and {after} is another option. {known[word].help}", argument=word)
    name = str(context.info_name)
    needed = [one for one in command.params if one.required and given.get(one.name) in (None, ())]
    if over:
        raise InputError(_with_options(command, name, words, over), argument=_KINDS[0], got=over)
    if needed:
        raise InputError(_missing(command, name, needed[0]), argument=_said(needed[0]))


def _valued(command: Any) -> set[str]:
    """Options that take a value."""
    return {flag for one in command.params if not getattr(one, "is_flag", True) for flag in one.opts}


def _said(parameter: Any) -> str:
    """A parameter as a user names it."""
    return max(parameter.opts, key=len) if parameter.param_type_name == "option" else str(parameter.name).upper()


def _missing(command: Any, name: str, parameter: Any) -> str:
    found = _EXAMPLE.search(inspect.cleandoc(command.help or ""))
    return f"{_said(parameter)} is missing" + (
        f"; robustid {name} is called so, for example:\n  {' '.join(found[1].split())}" if found else ""
    )


def _with_options(command: Any, name: str, words: Sequence[str], over: Sequence[str]) -> str:
    """Sentence on files that stand alone, with the command in which each has the option that takes it."""
    from robustid.app.run.undoing import command_line
    from robustid.core import saved_kind

    known = {flag for one in command.params for flag in one.opts}
    said = ", ".join(over)
    if missing := [path for path in over if not Path(path).exists() and saved_kind(path) is None]:
        return f"robustid {name} can't take {', '.join(missing)}: there is no such file"
    flags: dict[str, str] = {}
    added: list[str] = []
    for path in over:
        if (kind := saved_kind(path)) is not None:
            if "--bounds" not in known:
                return f"{path} is a saved {kind}, and robustid {name} takes {_taken(command)}"
            flags[path] = "--bounds"
            continue
        if _KINDS[0] not in known:
            return f"robustid {name} takes {_taken(command)}; got {said} too. Of several files each needs a call of its own"
        from robustid.app.look import look

        found = look(path)
        if found.found is None or not found.kind:
            line = command_line(["look", path])
            return f"{path} holds no measurements that are understood as they are; what it holds, and how to go on:\n  {line}"
        flags[path] = f"--{found.kind}"
        added += found.as_options() if len(over) == 1 else []
    called = _flagged(command, words, flags)
    line = command_line([name, *called, *(added if not set(added[::2]) & set(called) else [])])
    return f"robustid {name} takes {'these files' if len(over) > 1 else 'this file'} by an option:\n  {line}"


def _taken(command: Any) -> str:
    """Words for what stands without an option."""
    bare = [one for one in command.params if one.param_type_name == "argument"]
    return (
        "measurements, --frequency FILE and --time FILE" if not bare else "one file" if len(bare) == 1 else "two files"
    )


def _flagged(command: Any, words: Sequence[str], flags: dict[str, str]) -> list[str]:
    """The words with the option of each file in front of it, where it is not the value of another option."""
    valued, found = _valued(command), list[str]()
    for word in words:
        free = not found or found[-1] not in valued
        found += [flags[word], word] if free and word in flags else [word]
    return found

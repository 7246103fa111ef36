"""A command as it explains itself: its help in two columns of 80 characters, and what is missing or stands in the wrong place."""

from __future__ import annotations

import inspect
import itertools
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from typer import Context
from typer.core import TyperCommand

from robustid.errors import InputError

_NAMES = 26  # characters of the first column; longer names stand on a line of their own
_WIDEST = 120  # of a line that is read easily
_KINDS = {"path": "FILE", "range": "NUMBER", "int": "NUMBER", "float": "NUMBER", "str": "TEXT"}
_DATA = "--frequency", "--time"

_EXAMPLE = re.compile(r"\[bold\]Example\[/bold\]: (robustid .*?)(?:\n *\n|\n *\[bold\]|\Z)", re.S)


class Explained(TyperCommand):
    """A command that shows its help so, and leads on where it is misused."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Read the words of a call."""
        lead_on(self, ctx, args)
        return super().parse_args(ctx, args)

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Print the help."""
        del formatter
        show_help(self, ctx, parameters(self, ctx))


def parameters(command: Any, ctx: Context) -> list[tuple[Any, str, str]]:
    """The parameters with their names and help."""
    return [(param, _names(param, ctx), _help(param, ctx)) for param in command.get_params(ctx)]


def show_help(command: Any, ctx: Context, rows: list[tuple[Any, str, str]], names_width: int = _NAMES) -> None:
    """Print usage, words, and rows of names and help under the heading of each."""
    from rich.console import Console
    from rich.text import Text

    out = Console()
    width = min(out.width, _WIDEST)
    out.print(Text(f"Usage: {ctx.command_path} {' '.join(command.collect_usage_pieces(ctx))}\n"), highlight=False)
    for paragraph in _paragraphs(inspect.cleandoc(command.help or "")):
        out.print(paragraph + "\n", width=width, highlight=False)
    headings = dict.fromkeys(_heading(thing) for thing, *_ in rows)
    for heading in headings:
        out.print(f"[bold]{heading}[/bold]", highlight=False)
        for _, names, words in (row for row in rows if _heading(row[0]) == heading):
            lines = Text.from_markup(words).wrap(out, width - names_width - 2)
            first = Text(names.ljust(names_width), style="cyan")
            if len(names) < names_width - 1 and lines:
                first.append_text(lines.pop(0))
            for k, line in enumerate([first, *lines]):
                out.print(Text(" " * (names_width + 2 if k else 2)).append_text(line), highlight=False)
        out.print()


def _paragraphs(text: str) -> Iterator[str]:
    """Paragraphs in one line each, but for text that is indented, which stays; an example begins a line."""
    for paragraph in text.split("\n\n"):
        if paragraph.startswith(" "):
            yield paragraph
        else:
            yield re.sub(r"\s*\n\s*(?!\[bold\]Example)", " ", paragraph).replace(r"\ ", " ")


def _heading(thing: Any) -> str:
    """Heading of a parameter or a command."""
    if getattr(thing, "param_type_name", "") == "argument":
        return "Arguments"
    return getattr(thing, "rich_help_panel", None) or "Options"


def _names(param: Any, ctx: Context) -> str:
    """The names of a parameter, with what its value is."""
    if param.param_type_name == "argument":
        return param.metavar or str(param.name).upper()
    names = ", ".join([*sorted(param.opts, key=len), *param.secondary_opts])
    if param.is_flag or param.count:
        return names
    shown = param.get_help_record(ctx)[0].split()[-1]  # its type, where nothing else is said
    return f"{names} {param.metavar or next((word for name, word in _KINDS.items() if name in shown.lower()), shown)}"


def _help(param: Any, ctx: Context) -> str:
    """The help of a parameter, with its default."""
    words = getattr(param, "help", None) or ""
    if param.name == "help" or param.is_eager:
        return words
    default = param.get_default(ctx, call=False)
    given = default not in (None, False, True, ()) and param.param_type_name == "option" and not param.required
    needed = " Needed." if param.required and param.param_type_name == "option" else ""
    return f"{words}{needed}" + (f" [dim]Default: {default}.[/dim]" if given else "")


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
        raise InputError(_with_options(command, name, words, over), argument=_DATA[0], got=over)
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
        if _DATA[0] not in known:
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

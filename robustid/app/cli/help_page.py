"""The help of a command: its words, then its options by what they are for, in two columns that fit 80 characters."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator
from typing import Any

from typer import Context
from typer.core import TyperCommand

from robustid.app.cli.leading_on import lead_on

_NAMES = 26  # characters of the first column; longer names stand on a line of their own
_WIDEST = 120  # of a line that is read easily
_KINDS = {"path": "FILE", "range": "NUMBER", "int": "NUMBER", "float": "NUMBER", "str": "TEXT"}


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

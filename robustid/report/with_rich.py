"""Blocks of a document at the terminal; charts have no place there."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from robustid.core import in_short
from robustid.report.document import (
    MOST_WARNINGS,
    Block,
    Code,
    Column,
    Document,
    Facts,
    Heading,
    Share,
    Table,
    Text,
    Verdict,
)

if TYPE_CHECKING:
    from rich.console import Group, RenderableType
    from rich.text import Text as Line

_COLOURS = {"consistent": "green", "weak": "yellow", "inconsistent": "red", "undecided": "yellow", "failed": "red"}
_STYLES = {"": "", "soft": "dim", "caution": "dim", "warning": "yellow"}
_VALUES = 20  # columns of a screen that are left for them
_MORE = "and {} more; the HTML report lists all"


def render(blocks: Iterable[Block]) -> Group:
    """Render blocks for ``rich.print`` or a rich console."""
    from rich.console import Group

    return Group(*(part for block in blocks if (part := _rendered(block)) is not None))


def render_head(document: Document, width: int, most: int) -> Group:
    """Render verdicts, numbers, what is covered and what is not, and warnings in short, in at most so many lines.

    Of lines that have no place the words on the result go first, from their last sentence on, then warnings.
    """
    from rich.console import Group

    said = [one for one in (*document.ahead, document.verdict) if one is not None]
    notice = [] if document.notice is None else [(document.notice.head, document.notice.text)]
    first = [line for head, text in notice for line in _wrapped(f"{head}: {text}", width, style="yellow")]
    for one in said:
        first += _wrapped(
            f"{one.word}  {one.said}", width, head=len(one.word), style=f"bold {_COLOURS.get(one.key, '')}"
        )
        first += [line for name, value in one.numbers * one.ahead for line in _wrapped(f"  {name}: {value}", width)]
    first += _two_columns(document.numbers, width)
    beside = [line for one in document.beside if isinstance(one, Verdict) for line in _wrapped(one.short, width)]
    left_out = f"Not covered: {document.glance.not_covered}." if document.glance.not_covered else ""
    last = [*beside, *_wrapped(left_out, width, style="dim")]
    last += _warnings(document.warnings, width, most - len(first) - len(last))
    words = _sentences(document.glance.words, width, most - len(first) - len(last))
    return Group(*_cut([*first, *words, *last], width, most))


def _wrapped(text: str, width: int, head: int = 0, style: str = "") -> list[Line]:
    """Text in lines, its head, or else all of it, in a style."""
    from rich.console import Console
    from rich.text import Text as Words

    if not text:
        return []
    words = Words(text)
    words.stylize(style, 0, head or len(text))
    return list(words.wrap(Console(width=width), width))


def _two_columns(rows: Iterable[tuple[str, str]], width: int) -> list[Line]:
    """Names and values, which begin in one column."""
    from rich.text import Text as Words

    rows = list(rows)
    column = min(max((len(name) for name, _ in rows), default=0), width - _VALUES) + 2
    found: list[Line] = []
    for name, value in rows:
        if len(name) + 2 > column or column + len(value) > width:
            found += _wrapped(f"{name}: {value}", width)
        else:
            found.append(Words(f"{name:<{column}}{value}"))
    return found


def _sentences(text: str, width: int, most: int) -> list[Line]:
    """As many sentences of a text as so many lines take, at least the first where there is a line."""
    kept, rest = in_short(text) if text else ("", "")
    while rest:
        sentence, after = in_short(rest)
        if len(_wrapped(f"{kept} {sentence}", width)) > most:
            break
        kept, rest = f"{kept} {sentence}", after
    return _cut(_wrapped(kept, width), width, most)


def _cut(lines: list[Line], width: int, most: int) -> list[Line]:
    """At most so many lines; of more the last one shows that what it says goes on."""
    if len(lines) <= max(most, 0):
        return lines
    lines = lines[: max(most, 0)]
    if lines:
        lines[-1].rstrip()
        lines[-1].truncate(width - 2)
        lines[-1].append(" …")
    return lines


def _warnings(warnings: Iterable[str], width: int, most: int) -> list[Line]:
    """The first sentences of the first warnings, and how many more there are."""
    found: list[Line] = []
    warnings, shown = list(warnings), 0
    for words in warnings[:MOST_WARNINGS]:
        lines = _wrapped(f"warning: {in_short(words)[0]}", width, head=len("warning:"), style="yellow")
        if len(found) + len(lines) > most - 1 and shown:
            break
        found, shown = found + lines, shown + 1
    if shown:  # where the first one alone has no room, what it says goes on elsewhere
        found = _cut(found, width, max(most, 1))
    left = len(warnings) - shown
    return found + _wrapped(f"and {left} more warning{'s' * (left > 1)}" if left else "", width, style="yellow")


def _rendered(block: Block) -> RenderableType | None:
    # Text, never markup: names in brackets, such as units, are to be shown as they stand.
    from rich.text import Text as Words

    match block:
        case Verdict():
            return _banner(block)
        case Facts():
            return _facts(block)
        case Table():
            return _table(block)
        case Text():
            return Words(f"{block.head}: {block.text}" if block.head else block.text, style=_STYLES[block.role])
        case Heading():
            return Words(f"\n{block.text}", style="bold")
        case Code():
            return Words(f"{block.text}\n")
        case _:
            return None


def _banner(verdict: Verdict) -> RenderableType:
    from rich.panel import Panel
    from rich.text import Text as Words

    colour = _COLOURS[verdict.key]
    numbers = "".join(f"\n{name}: {value}" for name, value in verdict.numbers if verdict.ahead)
    return Panel(Words.assemble((verdict.word, f"bold {colour}"), "  ", verdict.said, numbers), border_style=colour)


def _facts(facts: Facts) -> RenderableType:
    from rich.table import Table as Grid
    from rich.text import Text as Words

    grid = Grid.grid(padding=(0, 2))
    for name, words in facts.rows:
        grid.add_row(Words(name, style="bold"), Words(words))
    return grid


def _table(table: Table) -> RenderableType:
    from rich import box
    from rich.table import Table as Rows
    from rich.text import Text as Words

    out = Rows(title=Words(table.title), title_justify="left", title_style="bold", box=box.SIMPLE_HEAD, pad_edge=False)
    for column in (*table.columns, *[Column("", "whole")] * bool(table.marks)):
        justify = "right" if column.kind in ("n", "share") else "left"
        # Where space is short the claims and names wrap, never the numbers.
        out.add_column(Words(column.short or column.head), justify=justify, no_wrap=column.kind not in ("", "text"))
    for k, row in enumerate(table.rows[: table.most]):
        cells = [Words(cell.text if isinstance(cell, Share) else cell) for cell in row]
        if table.marks:
            cells.append(Words("holds", "green") if table.marks[k] else Words("FAILS", "bold red"))
        out.add_row(*cells)
    left = 0 if table.most is None else len(table.rows) - table.most
    if caption := _MORE.format(left) if left > 0 else table.note:
        out.caption, out.caption_justify = caption, "left"
    return out

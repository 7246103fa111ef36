"""Blocks of a document at the terminal; charts have no place there."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from robustid.report.document import Block, Code, Column, Facts, Heading, Share, Table, Text, Verdict

if TYPE_CHECKING:
    from rich.console import Group, RenderableType

_COLOURS = {"consistent": "green", "weak": "yellow", "inconsistent": "red", "undecided": "yellow", "failed": "red"}
_STYLES = {"": "", "soft": "dim", "caution": "dim", "warning": "yellow"}
_MORE = "and {} more; the HTML report lists all"


def render(blocks: Iterable[Block]) -> Group:
    """Render blocks for ``rich.print`` or a rich console."""
    from rich.console import Group

    return Group(*(part for block in blocks if (part := _rendered(block)) is not None))


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

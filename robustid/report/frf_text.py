"""The summary of a measured frequency response at the terminal."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from robustid.report import frf_facts
from robustid.report.frf_view import FrfView
from robustid.report.text import COLOURS, add_row, headed, left_out

if TYPE_CHECKING:
    from rich.console import Group

_MOST_ENTRIES = 16


def render_frf(view: FrfView) -> Group:
    """What the bound promises, what was measured, levels of every entry, warnings."""
    from rich.console import Group
    from rich.panel import Panel
    from rich.table import Table
    from rich.text import Text

    verdict = frf_facts.verdict(view)
    colour = COLOURS[verdict.key]
    head = Text.assemble((verdict.word, f"bold {colour}"), "  ", verdict.sentence)
    overview = Table.grid(padding=(0, 2))
    for name, words in frf_facts.summary_rows(view):
        overview.add_row(Text(name, style="bold"), Text(words))
    levels = headed("Medians over the lines, relative to the response", *frf_facts.level_columns(view))
    rows = frf_facts.level_rows(view)
    for row in rows[:_MOST_ENTRIES]:
        add_row(levels, *row)
    parts: list[Any] = [Panel(head, border_style=colour), overview, left_out(levels, len(rows) - _MOST_ENTRIES)]
    parts += [Text(f"Warning: {sentence}", style="yellow") for sentence in frf_facts.warnings(view)]
    return Group(*parts)

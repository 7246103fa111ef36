"""The summary of a measured frequency response at the terminal."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from robustid.report import frf_facts
from robustid.report.frf_view import FrfView
from robustid.report.text import add_row, banner, headed, left_out, named_rows

if TYPE_CHECKING:
    from rich.console import Group

_MOST_ENTRIES = 16


def render_frf(view: FrfView) -> Group:
    """What the bound promises, what was measured, levels of every entry, warnings."""
    from rich.console import Group
    from rich.text import Text

    levels = headed("Medians over the lines, relative to the response", *frf_facts.level_columns(view))
    rows = frf_facts.level_rows(view)
    for row in rows[:_MOST_ENTRIES]:
        add_row(levels, *row)
    parts: list[Any] = [
        banner(frf_facts.verdict(view)),
        named_rows(frf_facts.summary_rows(view)),
        left_out(levels, len(rows) - _MOST_ENTRIES),
    ]
    parts += [Text(f"Warning: {sentence}", style="yellow") for sentence in frf_facts.warnings(view)]
    return Group(*parts)

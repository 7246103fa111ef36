"""The summary of a matrix-fraction fit at the terminal."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from robustid.report import mfd_facts
from robustid.report.mfd_view import FitView
from robustid.report.style import number
from robustid.report.text import add_row, banner, headed, left_out, named_rows

if TYPE_CHECKING:
    from rich.console import Group

_MOST_MODES = 40


def render_fit(view: FitView) -> Group:
    """Verdict, cost, checks and modes."""
    from rich.console import Group
    from rich.text import Text

    checks = headed("Verification", "Claim", ">Number", ">Limit", "")
    for check in view.checks:
        mark = ("holds", "green") if check.holds else ("FAILS", "bold red")
        add_row(checks, check.name, number(check.measured), number(check.limit, 6), mark)
    modes = headed("Modes; peak: relative to that of the largest", ">Hz", ">Damping", ">Peak", "Largest in", ">States")
    for row in view.modes[:_MOST_MODES]:
        add_row(modes, *mfd_facts.mode_cells(view, row))
    parts: list[Any] = [banner(mfd_facts.verdict(view)), named_rows(mfd_facts.summary_rows(view)), checks]
    parts.append(left_out(modes, len(view.modes) - _MOST_MODES))
    if view.covariance is not None:
        parts.append(Text(mfd_facts.SIGMA, style="dim"))
    return Group(*parts)

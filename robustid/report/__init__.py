"""Everything that people see: a report as one HTML page, a summary at the terminal, and plots."""

from robustid.report import plot
from robustid.report.document import Document, Verdict
from robustid.report.identified import Parts, same
from robustid.report.live import live_figure, live_numbers, live_words, look_figure, look_words
from robustid.report.pages import (
    first_screen,
    has_page,
    head_at_terminal,
    render_report,
    render_summary,
    verdict,
    write_report,
)
from robustid.report.poles import PoleRow, pole_table
from robustid.report.proved_band import stands_on
from robustid.report.tuning import tuning_bode, tuning_limits, tuning_numbers, tuning_nyquist, tuning_words
from robustid.report.words import at_least, at_most

__all__ = [
    "Document",
    "Parts",
    "PoleRow",
    "Verdict",
    "at_least",
    "at_most",
    "first_screen",
    "has_page",
    "head_at_terminal",
    "live_figure",
    "live_numbers",
    "live_words",
    "look_figure",
    "look_words",
    "plot",
    "pole_table",
    "render_report",
    "render_summary",
    "same",
    "stands_on",
    "tuning_bode",
    "tuning_limits",
    "tuning_numbers",
    "tuning_nyquist",
    "tuning_words",
    "verdict",
    "write_report",
]

"""The summary at the terminal."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

from robustid.data import FrequencyResponse
from robustid.mfd import MatrixFraction
from robustid.report import facts
from robustid.report.frf_view import FrfView
from robustid.report.mfd_view import FitView
from robustid.report.modes import ModeRow, mode_rows
from robustid.report.poles import pole_table
from robustid.report.style import number

if TYPE_CHECKING:
    from rich.console import Group
    from rich.panel import Panel
    from rich.table import Table

    from robustid.identification import Identification
    from robustid.reduction import Reduction

_COLOURS = {"consistent": "green", "weak": "yellow", "inconsistent": "red", "undecided": "yellow", "failed": "red"}
_MOST_SAMPLES, _MOST_POLES, _MOST_EXPERIMENTS = 8, 10, 6


def render_summary(
    identification: Identification | MatrixFraction | FrequencyResponse,
    reduction: Reduction | None = None,
    *,
    data: FrequencyResponse | None = None,
) -> Group:
    """Verdict, margin or cost, checks, limiting samples, poles or modes, for ``rich.print`` or a rich console.

    Of a frequency response: what its bound promises, lines, levels of every entry, warnings.

    Parameters
    ----------
    identification : Identification, MatrixFraction or FrequencyResponse
    reduction : Reduction, optional
        Of the model of an identification; its poles are then shown instead.
    data : FrequencyResponse, optional
        What a matrix fraction was fitted to, for the names of its channels.

    Returns
    -------
    rich.console.Group

    Examples
    --------
    >>> import io, numpy as np, rich.console, robustid as rid
    >>> record = rid.TimeRecord(np.ones(4), [0.5, 0.75, 0.875, 0.94], dt=0.01, bound=0.01)
    >>> prior = rid.Prior(gain_bound=2.0, decay_rate=1.2)
    >>> result = rid.identify(rid.MixedProblem(time=record, prior=prior))
    >>> console = rich.console.Console(file=io.StringIO(), width=100)
    >>> console.print(render_summary(result))
    >>> "Consistent" in console.file.getvalue()
    True
    """
    from rich.console import Group
    from rich.text import Text

    if isinstance(identification, MatrixFraction):
        from robustid.report.mfd_text import render_fit

        return render_fit(FitView(identification, data))
    if isinstance(identification, FrequencyResponse):
        from robustid.report.frf_text import render_frf

        return render_frf(FrfView(identification))
    verdict = facts.verdict(identification)
    parts: list[Any] = [banner(verdict)]
    parts += [Text(f"Warning: {sentence}.", style="yellow") for sentence in identification.warnings]
    parts.append(_overview(identification, reduction))
    if identification.notes:
        parts.append(Text(f"\n{facts.CHOSEN}", style="bold"))
        parts += [Text(f"{note}\n") for note in identification.notes]
    parts.append(_checks(identification))
    limiting = facts.limiting(identification)
    if limiting:
        parts.append(_limiting(identification, limiting, verdict.key == "inconsistent"))
    if rows := mode_rows(identification):
        parts.append(_modes(rows, facts.unit(identification)))
    parts.append(_poles(identification, reduction))
    parts.append(Text(facts.CAUTION, style="dim"))
    return Group(*parts)


def _overview(identification: Identification, reduction: Reduction | None) -> Table:
    rows = [("Margin", facts.margin_interval(identification)), ("", facts.margin_words(identification))]
    measured = facts.experiments(identification)
    rows += [
        (row.name, f"{row.channel}: {row.samples} samples, {row.span}, {row.bound} (source: {row.source})")
        for row in measured[:_MOST_EXPERIMENTS]
    ]
    if (more := len(measured) - _MOST_EXPERIMENTS) > 0:
        rows.append(("", f"and {more} more; the HTML report lists all"))
    if shared := facts.shared_words(identification):
        rows.append(("Bounds", shared))
    rows += facts.assumptions(identification)[:-1]  # the bounds stand with their experiments
    rows.append(("Model", f"order {identification.order}, dt = {number(identification.problem.dt, 6)} s"))
    if reduction is not None:
        rows.append(("Reduced model", facts.reduction_words(identification, reduction)))
    return named_rows(rows)


def _checks(identification: Identification) -> Table:
    table = headed("Verification", "Claim", ">Number", ">Limit", "")
    for check in identification.verification.checks:
        mark = ("holds", "green") if check.holds else ("FAILS", "bold red")
        add_row(table, check.name, number(check.measured), number(check.limit, 6), mark)
    return table


def _limiting(identification: Identification, rows: list[facts.Limiting], inconsistent: bool) -> Table:
    title = "Samples that contradict the assumptions" if inconsistent else "Samples that limit the margin"
    several = not identification.problem.entries.single
    columns = ["Experiment", *["Response"] * several, ">At", ">Share of\nthe proof", ">|residual|\n/ bound"]
    table = headed(title, *columns)
    for row in rows[:_MOST_SAMPLES]:
        where = (row.experiment, *[row.channel] * several, row.place)
        add_row(table, *where, f"{number(100 * row.share, 2)} %", number(row.ratio))
    return left_out(table, len(rows) - _MOST_SAMPLES)


def _modes(rows: list[ModeRow], unit: str) -> Table:
    peak = f">Peak\n[{unit}]" if unit else ">Peak"
    table = headed("Modes of the parametric part", ">Hz", ">Damping", peak, "Largest in", ">Rank\nratio")
    for row in rows[:_MOST_POLES]:
        add_row(table, *row)
    table.caption, table.caption_justify = "Rank ratio: near 0 where the mode has one shape", "left"
    return left_out(table, len(rows) - _MOST_POLES)


def _poles(identification: Identification, reduction: Reduction | None) -> Table:
    model, name = (identification.model, "nominal") if reduction is None else (reduction.model, "reduced")
    rows = pole_table(model)
    table = headed(f"Slowest poles of the {name} model", ">Hz", ">Damping", ">|z|", ">Time constant [s]", ">States")
    slowest = sorted(rows, key=lambda row: -row.modulus)[:_MOST_POLES]
    for row in sorted(slowest, key=lambda row: row.hz):
        cells = (number(row.hz, 5), number(row.damping, 3), number(row.modulus, 5), number(row.time_constant, 3))
        if row.modulus == 0:
            cells = ("delay", "–", "0", "–")
        add_row(table, *cells, str(row.count))
    return left_out(table, len(rows) - _MOST_POLES)


def banner(verdict: Any) -> Panel:
    """The verdict in its frame."""
    from rich.panel import Panel
    from rich.text import Text

    colour = _COLOURS[verdict.key]
    # Text, never markup: names in brackets, such as units, are to be shown as they stand.
    return Panel(Text.assemble((verdict.word, f"bold {colour}"), "  ", verdict.sentence), border_style=colour)


def named_rows(rows: Iterable[tuple[str, str]]) -> Table:
    """What it is in bold, and in words."""
    from rich.table import Table
    from rich.text import Text

    table = Table.grid(padding=(0, 2))
    for name, words in rows:
        table.add_row(Text(name, style="bold"), Text(words))
    return table


def headed(title: str, *columns: str) -> Table:
    """A table with a title; ">" before a column's name aligns it to the right."""
    from rich import box
    from rich.table import Table
    from rich.text import Text

    table = Table(title=Text(title), title_justify="left", title_style="bold", box=box.SIMPLE_HEAD, pad_edge=False)
    for name in columns:
        right = name.startswith(">")
        # Where space is short the claims and names wrap, never the numbers.
        words = name in ("Claim", "Largest in", "Response")
        table.add_column(Text(name.removeprefix(">")), justify="right" if right else "left", no_wrap=not words)
    return table


def add_row(table: Table, *cells: str | tuple[str, str]) -> None:
    """Cells as text or (text, style), never read as markup."""
    from rich.text import Text

    table.add_row(*(Text(cell) if isinstance(cell, str) else Text(*cell) for cell in cells))


def left_out(table: Table, count: int) -> Table:
    """The table, with a word on how many rows it lacks."""
    if count > 0:
        table.caption = f"and {count} more; the HTML report lists all"
        table.caption_justify = "left"
    return table

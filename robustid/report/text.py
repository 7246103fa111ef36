"""The summary at the terminal."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from robustid.report import facts
from robustid.report.poles import pole_table
from robustid.report.style import number

if TYPE_CHECKING:
    from rich.console import Group
    from rich.table import Table

    from robustid.identification import Identification
    from robustid.reduction import Reduction

_COLOURS = {"consistent": "green", "weak": "yellow", "inconsistent": "red", "undecided": "yellow", "failed": "red"}
_MOST_SAMPLES, _MOST_POLES = 8, 10


def render_summary(identification: Identification, reduction: Reduction | None = None) -> Group:
    """Verdict, margin, checks, limiting samples and poles, for ``rich.print`` or a rich console.

    Parameters
    ----------
    identification : Identification
    reduction : Reduction, optional
        Of `identification.model`; its poles are then shown instead.

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
    from rich.panel import Panel
    from rich.text import Text

    verdict = facts.verdict(identification)
    colour = _COLOURS[verdict.key]
    # Text, never markup: names in brackets, such as units, are to be shown as they stand.
    head = Text.assemble((verdict.word, f"bold {colour}"), "  ", verdict.sentence)
    parts: list[Any] = [Panel(head, border_style=colour)]
    parts += [Text(f"Warning: {sentence}.", style="yellow") for sentence in identification.warnings]
    parts.append(_overview(identification, reduction))
    if identification.notes:
        parts.append(Text(f"\n{facts.CHOSEN}", style="bold"))
        parts += [Text(f"{note}\n") for note in identification.notes]
    parts.append(_checks(identification))
    limiting = facts.limiting(identification)
    if limiting:
        parts.append(_limiting(limiting, verdict.key == "inconsistent"))
    parts.append(_poles(identification, reduction))
    parts.append(Text(facts.CAUTION, style="dim"))
    return Group(*parts)


def _overview(identification: Identification, reduction: Reduction | None) -> Table:
    from rich.table import Table
    from rich.text import Text

    table = Table.grid(padding=(0, 2))
    rows = [("Margin", facts.margin_interval(identification)), ("", facts.margin_words(identification))]
    rows += [
        (row.name, f"{row.channel}: {row.samples} samples, {row.span}, {row.bound} (source: {row.source})")
        for row in facts.experiments(identification)
    ]
    rows += facts.assumptions(identification)[:-1]  # the bounds stand with their experiments
    rows.append(("Model", f"order {identification.order}, dt = {number(identification.problem.dt, 6)} s"))
    if reduction is not None:
        rows.append(("Reduced model", facts.reduction_words(identification, reduction)))
    for name, words in rows:
        table.add_row(Text(name, style="bold"), Text(words))
    return table


def _checks(identification: Identification) -> Table:
    table = _table("Verification", "Claim", ">Number", ">Limit", "")
    for check in identification.verification.checks:
        mark = ("holds", "green") if check.holds else ("FAILS", "bold red")
        _add(table, check.name, number(check.measured), number(check.limit, 6), mark)
    return table


def _limiting(rows: list[facts.Limiting], inconsistent: bool) -> Table:
    title = "Samples that contradict the assumptions" if inconsistent else "Samples that limit the margin"
    table = _table(title, "Experiment", ">At", ">Share of\nthe proof", ">|residual|\n/ bound")
    for row in rows[:_MOST_SAMPLES]:
        _add(table, row.experiment, row.place, f"{number(100 * row.share, 2)} %", number(row.ratio))
    return _left_out(table, len(rows) - _MOST_SAMPLES)


def _poles(identification: Identification, reduction: Reduction | None) -> Table:
    model, name = (identification.model, "nominal") if reduction is None else (reduction.model, "reduced")
    rows = pole_table(model)
    table = _table(f"Slowest poles of the {name} model", ">Hz", ">Damping", ">|z|", ">Time constant [s]", ">States")
    slowest = sorted(rows, key=lambda row: -row.modulus)[:_MOST_POLES]
    for row in sorted(slowest, key=lambda row: row.hz):
        cells = (number(row.hz, 5), number(row.damping, 3), number(row.modulus, 5), number(row.time_constant, 3))
        if row.modulus == 0:
            cells = ("delay", "–", "0", "–")
        _add(table, *cells, str(row.count))
    return _left_out(table, len(rows) - _MOST_POLES)


def _table(title: str, *columns: str) -> Table:
    from rich import box
    from rich.table import Table
    from rich.text import Text

    table = Table(title=Text(title), title_justify="left", title_style="bold", box=box.SIMPLE_HEAD, pad_edge=False)
    for name in columns:
        right = name.startswith(">")
        # Where space is short the claims wrap, never the numbers.
        table.add_column(Text(name.removeprefix(">")), justify="right" if right else "left", no_wrap=name != "Claim")
    return table


def _add(table: Table, *cells: str | tuple[str, str]) -> None:
    from rich.text import Text

    table.add_row(*(Text(cell) if isinstance(cell, str) else Text(*cell) for cell in cells))


def _left_out(table: Table, count: int) -> Table:
    if count > 0:
        table.caption = f"and {count} more; the HTML report lists all"
        table.caption_justify = "left"
    return table

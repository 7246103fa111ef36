"""The summary at the terminal."""

import io

import pytest
import rich.console

import robustid as rid
from robustid.report import render_summary
from robustid.report.identification_page import margin_interval
from robustid.report.words import number
from support.report_pages import printed, problem

pytestmark = pytest.mark.quick


def test_summary_is_readable_in_sixty_columns(consistent, inconsistent):
    for result in (consistent, inconsistent):
        console = rich.console.Console(file=io.StringIO(), width=60)
        console.print(render_summary(result))
        lines = console.file.getvalue().splitlines()
        table = lines[lines.index(next(line for line in lines if line.startswith("Verification"))) :]
        assert max(len(line) for line in lines) <= 60
        assert sum(line.rstrip().endswith("holds") for line in table) == len(result.verification.checks)
        for check in result.verification.checks:
            assert any(number(check.measured) in line and number(check.limit, 6) in line for line in table), check.name
        assert not any(line.rstrip().endswith("…") or "… " in line for line in table)


def test_summary_at_the_terminal(consistent, inconsistent, reduction):
    text = printed(consistent, reduction)
    wanted = ["Consistent", "margin", "torsion [rad] / current [A]", "17.67 Hz with damping 0.004", "never prove them"]
    wanted += [check.name for check in consistent.verification.checks]
    wanted += [f"Order {reduction.order} instead of {consistent.order}"]
    assert [part for part in wanted if part not in " ".join(text.split())] == []
    text = printed(inconsistent)
    assert "Inconsistent" in text
    assert "17.67 Hz" in text
    assert margin_interval(inconsistent) in text


def test_markup_in_names_is_shown_as_it_stands():
    result = rid.identify(problem(inputs=[("[red]u[/red]", "")], outputs=[("y", "")]))
    assert "[red]u[/red]" in printed(result)

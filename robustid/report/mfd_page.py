"""The page of a matrix-fraction fit."""

from __future__ import annotations

from typing import Any

from robustid.data import FrequencyResponse
from robustid.mfd import MatrixFraction, OrderSweep
from robustid.report import mfd_charts, mfd_facts, mfd_order_charts
from robustid.report.grids import grid_of
from robustid.report.html import page
from robustid.report.mfd_view import FitView
from robustid.report.plotly_figures import figures


def fit_page(
    fit: MatrixFraction, data: FrequencyResponse | None, order_sweep: OrderSweep | None, title: str | None
) -> str:
    """The page as text."""
    view = FitView(fit, data)
    entries = grid_of(mfd_charts.response_charts(view), view.nu)
    found = [mfd_charts.convergence_chart(view), mfd_charts.pole_chart(view)]
    if order_sweep is not None:
        sweep = mfd_order_charts.checked_sweep(order_sweep)
        found += [mfd_order_charts.order_chart(sweep), mfd_order_charts.stabilisation_chart(sweep)]
    return page(
        "fit.html.j2",
        entries.drawn | {chart.name: figures(chart) for chart in found},
        title=title or _title(view),
        verdict=mfd_facts.verdict(view),
        order=fit.fraction.A.shape[0],
        rms=mfd_facts.root_mean_square(view),
        summary=mfd_facts.summary_rows(view),
        checks=view.checks,
        lines=view.omega.size,
        most_drawn=mfd_charts.drawn_lines(view),
        sure=view.covariance is not None,
        sigma=mfd_facts.SIGMA,
        entries=entries,
        modes=[mfd_facts.mode_cells(view, row) for row in view.modes],
        sweep_words="" if order_sweep is None else mfd_facts.order_words(order_sweep),
    )


def _title(view: FitView) -> str:
    if (view.ny, view.nu) == (1, 1):
        return f"Matrix fraction of {view.entry(0, 0)}"
    names: list[Any] = [", ".join(channel.name for channel in group) for group in (view.outputs, view.inputs)]
    return f"Matrix fraction from {names[1]} to {names[0]}"

"""The page of a measured frequency response."""

from __future__ import annotations

from typing import Any

import numpy as np

from robustid.data import FrequencyResponse
from robustid.report import frf_charts, frf_facts
from robustid.report.charts import Layer
from robustid.report.frf_view import FrfView
from robustid.report.html import page
from robustid.report.plotly_figures import Figure, figures
from robustid.report.style import number

_COLUMNS = 4  # of a grid on a wide screen


def frf_page(frf: FrequencyResponse, records: Any, title: str | None) -> str:
    """The page as text."""
    view = FrfView(frf, records)
    alone, wide = view.ny * view.nu == 1, view.nu == 1
    entries, overview, spectra = (
        frf_charts.entry_charts(view),
        frf_charts.overview_charts(view),
        frf_charts.spectrum_charts(view),
    )
    drawn: dict[str, list[Figure]] = {chart.name: figures(chart, small=not wide) for chart in entries}
    drawn |= {chart.name: figures(chart) for chart in overview}
    drawn |= {chart.name: figures(chart, small=True) for chart in spectra}
    return page(
        "frf.html.j2",
        drawn,
        title=title or _title(view),
        verdict=frf_facts.verdict(view),
        numbers=_numbers(view),
        summary=frf_facts.summary_rows(view),
        warnings=frf_facts.warnings(view),
        heads=[name.removeprefix(">").replace("\n", " ") for name in frf_facts.level_columns(view)],
        levels=frf_facts.level_rows(view),
        levels_words=frf_facts.LEVELS,
        lines=frf.omega.size,
        most_drawn=frf_charts.drawn_lines(view),
        legend=[] if wide else _legend(entries),
        columns=min(view.nu, _COLUMNS),
        entries=[("" if alone else chart.panels[0].title, drawn[chart.name][0]) for chart in entries],
        overview=[drawn[chart.name][0] for chart in overview],
        spectra_legend=_legend(spectra),
        spectra=[(chart.panels[0].title, drawn[chart.name][0]) for chart in spectra],
        records=len(view.records),
        spectra_columns=min(max(view.nu, view.ny), _COLUMNS),
    )


def _legend(charts: list[Any]) -> list[Layer]:
    layers: dict[str, Layer] = {}
    for chart in charts:
        layers |= {layer.name: layer for layer in chart.panels[0].layers}
    return list(layers.values())


def _numbers(view: FrfView) -> list[tuple[str, str]]:
    found = [("lines", str(view.frf.omega.size))]
    if view.radius is not None:
        share = view.relative(view.radius)
        worst = ", worst entry" if share.size > 1 else ""
        found.append((f"median bound / response{worst}", f"{number(100 * float(np.max(share)), 2)} %"))
    return found


def _title(view: FrfView) -> str:
    if view.ny * view.nu == 1:
        return f"Frequency response of {view.entry(0, 0)}"
    names = [", ".join(channel.name for channel in group) for group in (view.frf.inputs, view.frf.outputs)]
    return f"Frequency response from {names[0]} to {names[1]}"

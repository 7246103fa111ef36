"""The page of a measured frequency response."""

from __future__ import annotations

from typing import Any

import numpy as np

from robustid.data import FrequencyResponse
from robustid.report import frf_charts, frf_facts
from robustid.report.frf_view import FrfView
from robustid.report.grids import grid_of
from robustid.report.html import page
from robustid.report.plotly_figures import figures
from robustid.report.style import number


def frf_page(frf: FrequencyResponse, records: Any, title: str | None) -> str:
    """The page as text."""
    view = FrfView(frf, records)
    entries = grid_of(frf_charts.entry_charts(view), view.nu, small=view.nu > 1, titles=view.ny * view.nu > 1)
    spectra = grid_of(frf_charts.spectrum_charts(view), max(view.nu, view.ny))
    overview = {chart.name: figures(chart) for chart in frf_charts.overview_charts(view)}
    return page(
        "frf.html.j2",
        entries.drawn | overview | spectra.drawn,
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
        entries=entries,
        overview=[figure for parts in overview.values() for figure in parts],
        spectra=spectra,
        records=len(view.records),
        complete=bool(view.complete.all()),
    )


def _numbers(view: FrfView) -> list[tuple[str, str]]:
    found = [("lines", str(view.frf.omega.size))]
    if view.radius is not None:
        share = view.relative(view.radius)
        worst = ", worst entry" if share.size > 1 else ""
        found.append(
            (f"median bound / response{worst}", f"{number(100 * float(np.fmax.reduce(share, axis=None)), 2)} %")
        )
    return found


def _title(view: FrfView) -> str:
    if view.ny * view.nu == 1:
        return f"Frequency response of {view.entry(0, 0)}"
    names = [", ".join(channel.name for channel in group) for group in (view.frf.inputs, view.frf.outputs)]
    return f"Frequency response from {names[0]} to {names[1]}"

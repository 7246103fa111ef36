"""Charts of many entries as one grid of small figures in a page."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from robustid.report.charts import Chart, Layer
from robustid.report.plotly_figures import Figure, figures

_COLUMNS = 4  # on a wide screen


class Grid(NamedTuple):
    """Small figures with their titles, and a legend that stands before them all."""

    columns: int
    legend: list[Layer]
    entries: list[tuple[str, Figure]]

    @property
    def drawn(self) -> dict[str, list[Figure]]:
        """The figures by their ids, for the data of the page."""
        return {figure.id: [figure] for _, figure in self.entries}


def grid_of(charts: Sequence[Chart], columns: int, *, small: bool = True, titles: bool = True) -> Grid:
    """Charts as figures beside each other; full ones (not `small`) have their own legends."""
    legend: dict[str, Layer] = {}
    for chart in charts if small else ():
        for panel in chart.panels:
            for layer in panel.layers:
                legend.setdefault(layer.name, layer)
    found = [figure for chart in charts for figure in figures(chart, small=small)]
    return Grid(
        min(columns, _COLUMNS), list(legend.values()), [(figure.label if titles else "", figure) for figure in found]
    )

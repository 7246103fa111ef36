"""Measured frequency responses with matplotlib."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from robustid.data import FrequencyResponse, TimeRecord
from robustid.report import frf_charts
from robustid.report.frf_view import FrfView
from robustid.report.matrix_charts import side_by_side
from robustid.report.plots import draw

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def plot_frf(frf: FrequencyResponse, records: TimeRecord | Sequence[TimeRecord] | None = None) -> Figure:
    """Magnitude and phase of every entry with bound, noise and distortion; singular values, coherence, and spectra.

    Band: |value| ± bound, and the phase ± arcsin(bound/|value|) of that disc (any phase where it holds 0). Singular values
    (CMIF) of several channels with ``||bound||``, which none of them is farther from its true one.

    Parameters
    ----------
    frf : FrequencyResponse
    records : TimeRecord or sequence of TimeRecord, optional
        What `frf` was estimated from: amplitudes of inputs and outputs (root mean square over the records), its lines marked.

    Returns
    -------
    matplotlib.figure.Figure
        Outputs below each other, inputs beside each other; of many lines the smallest and largest values of short intervals are
        drawn.

    Raises
    ------
    InputError, InputTypeError
        Records with other channels, another sample time, or of different lengths.

    Examples
    --------
    >>> import robustid as rid
    >>> frf = rid.FrequencyResponse([10.0, 20.0, 30.0], [1 - 0.1j, -2j, -0.3], bound=0.02, outputs=["x [m]"])
    >>> [axes.get_ylabel() for axes in plot_frf(frf).axes]
    ['magnitude [m]', 'phase [°]']
    """
    view = FrfView(frf, records)
    spectra = frf_charts.spectrum_charts(view)
    further = (frf_charts.overview_charts(view), spectra[: view.nu], spectra[view.nu :])
    groups = ([panel for chart in group for panel in chart.panels] for group in further)
    return draw(side_by_side("frf", frf_charts.entry_charts(view), view.nu, *groups))

"""Chart of the response of a model alone."""

from __future__ import annotations

from typing import Any

import numpy as np

from robustid.core import StateMatrices, points_of, response_at
from robustid.errors import InputError
from robustid.fitting import continuous
from robustid.identification import check_model
from robustid.report.charts import Axis, Chart, Layer, frequency_axis, phase_axis, side_by_side, stacked
from robustid.report.curves import low_quantile, magnitude_range, phase_curves, resolved, with_gaps
from robustid.report.style import NOMINAL
from robustid.report.words import HZ

_POINTS, _AROUND = 600, np.linspace(-1.55, 1.55, 61)
_BESIDE = 30  # times the slowest and the fastest pole


def model_chart(model: Any) -> Chart:
    """Magnitude and phase of every entry of a `control.StateSpace`, around its poles and up to the Nyquist frequency."""
    system = check_model("result", model)
    if system.dt is True:
        raise InputError("`result` is discrete without a sample time; give it its dt in s")
    dt = system.dt or 0.0
    s = np.array([continuous(pole, dt) for pole in system.poles()], dtype=complex)
    s = s[np.isfinite(s) & (np.abs(s) > 0)]
    sizes = np.abs(s) if s.size else np.ones(1)
    high = np.pi / dt if dt else _BESIDE * sizes.max()
    low = min(sizes.min(), high) / _BESIDE
    omega = resolved(np.geomspace(low, high, _POINTS), s, _AROUND, low, high)
    values = response_at(StateMatrices.of(system), points_of(omega, dt))
    charts = [_entry(system, i, j, omega, values[:, i, j]) for i, j in np.ndindex(values.shape[1:])]
    return side_by_side("model", charts, system.ninputs)


def _entry(system: Any, i: int, j: int, omega: np.ndarray, values: np.ndarray) -> Chart:
    size, ((angle,), span) = np.abs(values), phase_curves([values])
    axis, name = frequency_axis(omega), f"model, order {system.nstates}"
    magnitude = Axis(label="magnitude", log=True, range=magnitude_range(float(size.max()), [low_quantile(size)]))
    drawn = [Layer(name=name, x=omega / HZ, y=y, colour=NOMINAL, dash="solid") for y in (size, with_gaps(angle))]
    title = f"{system.output_labels[i]} / {system.input_labels[j]}"
    return stacked(f"entry-{i}-{j}", axis, ((magnitude, drawn[:1]), (phase_axis(span), drawn[1:])), (title, ""))

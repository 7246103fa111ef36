"""Charts of a measured frequency response: entries with bounds and levels, singular values, coherence, spectra."""

from __future__ import annotations

from typing import Any

import numpy as np

from robustid.report.charts import Axis, Chart, Layer, Panel, frequency_axis, phase_axis, stacked
from robustid.report.curves import (
    cells_per_entry,
    half_angle,
    low_quantile,
    magnitude_range,
    measured_phase,
    position,
    positive,
    rounded,
    thinned,
    with_gaps,
)
from robustid.report.sections.response_view import ResponseView
from robustid.report.style import ALERT, DASHES, DATA, FAINT, FURTHER, NOMINAL
from robustid.report.words import HZ, matrix_unit_label, unit_label

_BAND = FURTHER[3]
_LOOKS = {
    "σ of the noise": (FURTHER[0], "dot"),
    "σ of the response": (FURTHER[0], "dot"),
    "σ of the distortion": (FURTHER[1], "dashdot"),
}
_FEW = 300  # points, up to which each gets a marker


def entry_charts(view: ResponseView) -> list[Chart]:
    """Magnitude and phase of every entry, row by row."""
    cells = cells_per_entry(view.ny * view.nu)
    return [_entry(view, i, j, cells) for i in range(view.ny) for j in range(view.nu)]


def _entry(view: ResponseView, i: int, j: int, cells: int) -> Chart:
    frf, axis = view.frf, frequency_axis(view.frf.omega)
    used = ~frf.missing[:, i, j]
    if not used.any():
        titles = f"{view.entry(i, j)}: not measured", ""
        return stacked(f"entry-{i}-{j}", axis, [(Axis(label=""), ())] * 2, titles)
    omega, size, silent = frf.omega[used], view.size[used, i, j], view.silent[used, i, j]
    radius = None if view.radius is None else view.radius[used, i, j]
    levels = {name: level[used, i, j] for name, level in view.levels.items()}
    angle, span = measured_phase(omega, frf.values[used, i, j], radius)
    kept = _thinned(omega, axis, [size, next(iter(levels.values()), size)], cells)
    x, low_high = rounded(omega[kept] / HZ), _range(size, [*levels.values(), *([] if radius is None else [radius])])
    magnitude, phase = [], []
    if radius is not None:
        ends = {"low": np.maximum(size - radius, low_high[0]), "high": size + radius}
        magnitude.append(_band(x, size, ends, kept))
        turn = half_angle(size, radius)
        ends = {"low": np.where(silent, span[0], angle - turn), "high": np.where(silent, span[1], angle + turn)}
        jump = np.isnan(with_gaps(angle[kept])) & ~silent[kept] & ~silent[np.roll(kept, 1)]
        phase.append(_band(x, angle, {name: np.clip(end, *span) for name, end in ends.items()}, kept, jump))
        magnitude.append(Layer(name="bound", x=x, y=_shown(radius[kept]), colour=NOMINAL, dash="dash", size=0.5))
    for name, level in levels.items():
        colour, dash = _LOOKS[name]
        magnitude.append(Layer(name=name, x=x, y=_shown(level[kept]), colour=colour, dash=dash))
    marker = "circle" if kept.size <= _FEW else ""
    curve: dict[str, Any] = {"name": "response", "x": x, "colour": DATA, "dash": "solid", "marker": marker, "size": 0.5}
    sure = np.where(silent, np.nan, 1.0)
    magnitude.append(Layer(y=_shown((sure * size)[kept]), **curve))
    phase.append(Layer(y=rounded(with_gaps((sure * angle)[kept])), **curve))
    if silent[kept].any():
        lost: dict[str, Any] = {
            "name": "response below its bound",
            "colour": ALERT,
            "marker": "circle-open",
            "size": 0.5,
        }
        part = silent[kept]
        magnitude.append(Layer(x=x[part], y=_shown(size[kept][part]), **lost))
        phase.append(Layer(x=x[part], y=rounded(angle[kept][part]), **lost))
    unit = unit_label(frf.outputs[i].unit, frf.inputs[j].unit)
    y = Axis(label=f"magnitude{unit}", log=True, range=low_high)
    return stacked(f"entry-{i}-{j}", axis, ((y, magnitude), (phase_axis(span), phase)), (view.entry(i, j), ""))


def _band(x: np.ndarray, y: np.ndarray, ends: dict[str, np.ndarray], kept: np.ndarray, gap: Any = False) -> Layer:
    drawn: dict[str, Any] = {name: rounded(np.where(gap, np.nan, end[kept])) for name, end in ends.items()}
    return Layer(name="response ± bound", x=x, y=rounded(y[kept]), colour=_BAND, fill=True, **drawn)


def _shown(values: np.ndarray) -> np.ndarray:
    return rounded(positive(values))


def _thinned(omega: np.ndarray, axis: Axis, sizes: list[np.ndarray], cells: int) -> np.ndarray:
    """The points to draw on the axis; a logarithmic one has no 0."""
    kept = thinned(position(omega, axis.log), sizes, cells)
    return kept[omega[kept] > 0] if axis.log else kept


def _range(size: np.ndarray, further: list[np.ndarray]) -> tuple[float, float]:
    """Range that holds the values and almost all levels, but not the bottom of deep notches, and no bound far above all values."""
    top = float(size.max())
    floors = [low_quantile(part[part > 0]) for part in (size, *further) if np.any(part > 0)]
    return magnitude_range(top, [*floors, top / 10])


def overview_charts(view: ResponseView) -> list[Chart]:
    """Charts of all entries at once: singular values where there are several, coherence where it is known."""
    charts = [singular_chart(view)] if min(view.ny, view.nu) > 1 and view.complete.any() else []
    return charts + ([coherence_chart(view)] if view.frf.coherence is not None else [])


def singular_chart(view: ResponseView) -> Chart:
    """Singular values of the matrix (CMIF): a peak of the largest one is a mode, a second peak there another one."""
    omega, values = view.frf.omega[view.complete], view.singular_values
    axis = frequency_axis(view.frf.omega)
    kept = _thinned(omega, axis, [values[:, 0], values[:, -1]], cells_per_entry(1))
    x, layers = rounded(omega[kept] / HZ), []
    for k, (colour, dash) in enumerate(_cycle(values.shape[1])):
        name = "largest singular value" if k == 0 else f"singular value {k + 1}"
        layers.append(Layer(name=name, x=x, y=_shown(values[kept, k]), colour=colour, dash=dash, size=0.6))
    bound = view.singular_bound
    if bound is not None:
        layers.append(Layer(name="bound of the singular values", x=x, y=_shown(bound[kept]), colour=FAINT, dash="dash"))
    span = _range(values.ravel(), [] if bound is None else [bound])
    unit = matrix_unit_label(view.frf.outputs, view.frf.inputs)
    y = Axis(label=f"singular value{unit}", log=True, range=span)
    panel = Panel(title="Singular values (CMIF)", x=axis, y=y, layers=tuple(layers))
    return Chart(name="singular", panels=(panel,), linked=True)


def _cycle(count: int) -> list[tuple[str, str]]:
    """Colours, each with a dash of its own."""
    colours, dashes = (NOMINAL, *FURTHER), ("solid", *DASHES)
    return [(colours[k % len(colours)], dashes[k % len(dashes)]) for k in range(count)]


def coherence_chart(view: ResponseView) -> Chart:
    """Multiple coherence of every output."""
    coherence, omega = view.frf.coherence, view.frf.omega
    axis, layers = frequency_axis(omega), []
    for i, (colour, dash) in enumerate(_cycle(view.ny)):
        kept = _thinned(omega, axis, [coherence[:, i]], cells_per_entry(view.ny))
        x, y = rounded(omega[kept] / HZ), rounded(coherence[kept, i])
        name = f"coherence of {view.frf.outputs[i].name}"
        layers.append(Layer(name=name, x=x, y=y, colour=colour, dash=dash, size=0.6))
    least = float(coherence.min())
    low = 0.0 if least < 0.5 else 0.5 if least < 0.9 else 0.9
    panel = Panel(
        title="Coherence",
        x=axis,
        y=Axis(label="coherence [–]", range=(low - 0.02 * (1 - low), 1 + 0.03 * (1 - low))),
        layers=tuple(layers),
    )
    return Chart(name="coherence", panels=(panel,), linked=True)


def spectrum_charts(view: ResponseView) -> list[Chart]:
    """Amplitudes of every input, then of every output, over the frequencies of the response; none without records."""
    if not view.records:
        return []
    axis = frequency_axis(view.frf.omega)
    sides = [("input", "u", view.frf.inputs), ("output", "y", view.frf.outputs)]
    return [
        _spectrum(view, axis, name, side, index, signal)
        for name, side, signals in sides
        for index, signal in enumerate(signals)
    ]


def _spectrum(view: ResponseView, axis: Axis, name: str, side: str, index: int, signal: Any) -> Chart:
    found = view.spectrum(side, index)
    low, high = axis.range or (0.0, np.inf)
    inside = (found.freq_hz >= low) & (found.freq_hz <= high)
    cells, layers = cells_per_entry(view.nu + view.ny), []
    groups = (
        ("between these spectral lines", inside & ~found.excited, FAINT, "solid", ""),
        ("spectral lines of the response", inside & found.excited, NOMINAL, "", "circle"),
    )
    for title, mask, colour, dash, marker in groups:
        freq, amplitude = found.freq_hz[mask], found.amplitude[mask]
        if freq.size:
            kept = thinned(position(freq, axis.log), [amplitude], cells)
            style: dict[str, Any] = {"colour": colour, "dash": dash, "marker": marker, "size": 0.6}
            layers.append(Layer(name=title, x=rounded(freq[kept]), y=_shown(amplitude[kept]), **style))
    span = _range(found.amplitude[inside], [])
    y = Axis(label=f"amplitude{f' [{signal.unit}]' if signal.unit else ''}", log=True, range=span)
    panel = Panel(title=f"{name} {signal}", x=axis, y=y, layers=tuple(layers))
    return Chart(name=f"{name}-{index}", panels=(panel,), linked=True)

"""A measured record: every signal over time, and its amplitude spectrum beside it."""

from __future__ import annotations

import numpy as np

from robustid.core import Real, Signal
from robustid.data import TimeRecord
from robustid.report.charts import DATA, FAINT, NOMINAL, Axis, Chart, Layer, Panel, frequency_axis
from robustid.report.curves import cells_per_entry, low_quantile, magnitude_range, position, positive, rounded, thinned
from robustid.report.words import HZ

_DEPTH = 1e-5  # of the largest amplitude: what is lower is leakage or rounding


def amplitudes(signals: Real, dt: float) -> tuple[Real, Real]:
    """Frequencies in Hz and amplitudes of the sines that make up signals (R, T), root mean square over them; 0 Hz left out."""
    samples = signals.shape[1]
    size: Real = 2 * np.sqrt(np.mean(np.abs(np.fft.rfft(signals, axis=1)) ** 2, axis=0)) / samples
    if samples % 2 == 0:
        size[-1] /= 2
    hz: Real = np.arange(1, size.size) / (samples * dt)
    return hz, size[1:]


def record_chart(record: TimeRecord) -> Chart:
    """Inputs, references and outputs over time, with the bounds of the outputs, each beside its spectrum."""
    sides = [("input", record.inputs, record.u), ("output", record.outputs, record.y)]
    if record.reference is not None:
        names = [Signal(f"reference {k + 1}") for k in range(record.reference.shape[1])]
        sides.insert(1, ("", names, record.reference))
    count = sum(values.shape[1] for _, _, values in sides)
    panels: list[Panel] = []
    for side, signals, values in sides:
        for k, signal in enumerate(signals):
            bound = record.bound.radius[:, k] if side == "output" and record.bound is not None else None
            title = f"{side} {signal}".strip()
            panels += [
                _over_time(record, title, signal, values[:, k], bound, 2 * count),
                _spectrum(record, signal, values[:, k], 2 * count),
            ]
    return Chart("record", panels, columns=2, grid=True)


def _label(word: str, signal: Signal) -> str:
    return f"{word} [{signal.unit}]" if signal.unit else word


def _over_time(record: TimeRecord, title: str, signal: Signal, values: Real, bound: Real | None, panels: int) -> Panel:
    kept, time = thinned(record.time, [values], cells_per_entry(panels)), record.time
    layers: list[Layer] = []
    if bound is not None and (used := np.isfinite(bound)).any():
        part = kept[used[kept]]
        x, y = rounded(time[part]), rounded(values[part])
        low, high = rounded((values - bound)[part]), rounded((values + bound)[part])
        layers.append(Layer("± bound", x, y, NOMINAL, low=low, high=high, fill=True))
        if not used.all():
            rest = kept[~used[kept]]
            layers.append(
                Layer("not used", rounded(time[rest]), rounded(values[rest]), FAINT, marker="circle", size=0.4)
            )
    layers.append(Layer("measured", rounded(time[kept]), rounded(values[kept]), DATA, dash="solid", size=0.5))
    return Panel(title, Axis("time [s]", range=(0.0, float(time[-1]))), Axis(_label(signal.name, signal)), layers)


def _spectrum(record: TimeRecord, signal: Signal, values: Real, panels: int) -> Panel:
    hz, size = amplitudes(values[None] - values.mean(), record.dt)
    if not hz.size or not size.any():
        return Panel("spectrum: nothing but a constant", Axis("frequency [Hz]"), Axis(""), ())
    axis = frequency_axis(HZ * hz)
    kept = thinned(position(hz, axis.log), [size], cells_per_entry(panels))
    layer = Layer("amplitude", rounded(hz[kept]), rounded(positive(size[kept])), DATA, marker="circle", size=0.35)
    reach = magnitude_range(float(size.max()), [low_quantile(size[size > 0])], _DEPTH)
    return Panel("its spectrum", axis, Axis(_label("amplitude", signal), log=True, range=reach), [layer])

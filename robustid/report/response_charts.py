"""A measured frequency response with the things that follow from it, computed once, and its charts."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np

from robustid.core import Signal, StateMatrices, as_kind, counted, exponents_of, points_of, response_at
from robustid.data import Fault, FrequencyResponse, TimeRecord, as_records, variances
from robustid.errors import InputError
from robustid.report.charts import (
    ALERT,
    BAND,
    DASHES,
    DATA,
    FAINT,
    FURTHER,
    NOMINAL,
    Axis,
    Chart,
    Layer,
    Panel,
    frequency_axis,
    side_by_side,
)
from robustid.report.curves import (
    cells_per_entry,
    half_angle,
    log_axis,
    low_quantile,
    magnitude_range,
    measured_phase,
    next_to,
    position,
    positive,
    resolved,
    rounded,
    spread,
    thinned,
    with_gaps,
)
from robustid.report.data_faults import faults_of_response
from robustid.report.identified import Models, Shown, other_models
from robustid.report.magnitude_phase import MagnitudePhase, Ranged, phase_axis
from robustid.report.record_charts import amplitudes
from robustid.report.words import HZ, matrix_unit_label, unit_label

_SAME_STEP = 1e-6
_LOOKS = {"noise": (FURTHER[0], "dot"), "response": (FURTHER[0], "dot"), "distortion": (FURTHER[1], "dashdot")}
_FEW = 300  # points, up to which each gets a marker
_GRID = 600  # points of a model's response, along the axis
_AROUND = np.linspace(-1.4, 1.4, 21)  # phases across a light resonance

Records = TimeRecord | Sequence[TimeRecord] | None


class Spectrum(NamedTuple):
    """Amplitudes of one signal: of the sine at every spectral line of the whole record, 0 left out."""

    freq_hz: np.ndarray  # (K,)
    amplitude: np.ndarray  # (K,) root mean square over the records
    excited: np.ndarray  # (K,) whether it is a frequency point of the response


@dataclasses.dataclass(frozen=True, eq=False)
class ResponseView:
    """Frequency response with the records that it was estimated from, which must belong to it: they show what was excited."""

    frf: FrequencyResponse
    given: Records = None
    models: Models = None

    def __post_init__(self) -> None:
        as_kind("frf", self.frf, FrequencyResponse, "a FrequencyResponse")
        _ = self.records, self.curves

    @cached_property
    def records(self) -> tuple[TimeRecord, ...]:
        """The records that are given, which belong to the response."""
        return _checked(self.given, self.frf)

    @cached_property
    def curves(self) -> list[tuple[Shown, np.ndarray, np.ndarray]]:
        """Models to be drawn over the response, each with frequencies (rad/s) that resolve it and its values there."""
        omega = self.frf.omega
        low, high, log = float(omega[omega > 0].min(initial=omega.max())), float(omega.max()), log_axis(omega)
        found: list[tuple[Shown, np.ndarray, np.ndarray]] = []
        for one in other_models(self.models, self.frf):
            with np.errstate(divide="ignore"):
                s = exponents_of(np.asarray(one.model.poles(), dtype=complex), self.frf.dt or 0)
            at = resolved(spread(low, high, _GRID, log), s[np.isfinite(s)], _AROUND, low, high)
            found.append((one, at, response_at(StateMatrices.of(one.model), points_of(at, self.frf.dt))))
        return found

    @cached_property
    def faults(self) -> tuple[Fault, ...]:
        """Faults of the records of the response, and of itself."""
        return faults_of_response(self.frf)

    @property
    def ny(self) -> int:
        """Number of outputs."""
        return len(self.frf.outputs)

    @property
    def nu(self) -> int:
        """Number of inputs."""
        return len(self.frf.inputs)

    def entry(self, output: int, input: int) -> str:
        """Name of an entry, "displacement [mm] / force [N]"."""
        return f"{self.frf.outputs[output]} / {self.frf.inputs[input]}"

    @cached_property
    def size(self) -> np.ndarray:
        """|G|, (F, ny, nu); NaN where it was not measured."""
        return np.where(self.frf.missing, np.nan, np.abs(self.frf.values))

    @cached_property
    def measured(self) -> np.ndarray:
        """Number of frequency points at which each entry was measured, (ny, nu)."""
        return np.sum(~self.frf.missing, axis=0)

    @cached_property
    def complete(self) -> np.ndarray:
        """Frequency points at which every entry was measured, (F,) bool."""
        return np.all(~self.frf.missing, axis=(1, 2))

    @property
    def radius(self) -> np.ndarray | None:
        """Radius of the disc around each value; infinite where it was not measured."""
        return None if self.frf.bound is None else self.frf.bound.outer_radius

    @cached_property
    def silent(self) -> np.ndarray:
        """Samples that say nothing, (F, ny, nu) bool: their disc holds 0."""
        return np.zeros(self.size.shape, bool) if self.radius is None else self.radius >= self.size

    @cached_property
    def levels(self) -> dict[str, np.ndarray]:
        """Standard deviations (F, ny, nu) that are known, by that of which they are."""
        frf, found = self.frf, dict[str, np.ndarray]()
        if frf.noise is not None:
            found["noise"] = frf.noise
        elif frf.covariance is not None:
            found["response"] = np.sqrt(np.maximum(variances(frf.covariance, self.size.shape), 0))
        if frf.distortion is not None:
            found["distortion"] = frf.distortion
        return found

    def relative(self, level: np.ndarray) -> np.ndarray:
        """Median over the measured points of a level relative to the response, (ny, nu); NaN where the response is zero."""
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = level / self.size
        ratio[self.size == 0] = np.inf  # a median over all points: zeros count as large
        middle = self.median(ratio)
        return np.where(np.isfinite(middle), middle, np.nan)

    def median(self, array: np.ndarray) -> np.ndarray:
        """Median over the points at which each entry was measured, (ny, nu); NaN for an entry without one."""
        middle = np.full(self.measured.shape, np.nan)
        for place in np.argwhere(self.measured):
            i, j = map(int, place)
            middle[i, j] = np.median(array[~self.frf.missing[:, i, j], i, j])
        return middle

    @cached_property
    def singular_values(self) -> np.ndarray:
        """Singular values at every `complete` point, largest first: complex mode indicator function, (F, min(ny, nu))."""
        return np.linalg.svd(self.frf.values[self.complete], compute_uv=False)

    @cached_property
    def singular_bound(self) -> np.ndarray | None:
        """Distance that each of them can have from its true one, (F,): |E| <= R entry by entry has ||E|| <= ||R||."""
        return None if self.radius is None else np.linalg.norm(self.radius[self.complete], 2, axis=(1, 2))

    def spectrum(self, side: str, index: int) -> Spectrum:
        """Spectrum of an input ("u") or output ("y") of the records."""
        signals = np.stack([getattr(record, side)[:, index] for record in self.records])
        hz, amplitude = amplitudes(signals, self.records[0].dt)
        excited = np.zeros(hz.size + 1, bool)
        excited[np.rint(self.frf.freq_hz / hz[0]).astype(int).clip(0, hz.size)] = True
        return Spectrum(hz, amplitude, excited[1:])


def _checked(records: Records, frf: FrequencyResponse) -> tuple[TimeRecord, ...]:
    listed = [] if records is None else as_records("records", records)
    for k, record in enumerate(listed):
        shape, wanted = (len(record.outputs), len(record.inputs)), (len(frf.outputs), len(frf.inputs))
        if shape != wanted:
            raise InputError(
                f"`records` must have the {counted(wanted[0], 'output')} and {counted(wanted[1], 'input')} of the"
                f" response; got {shape[0]} and"
                f" {shape[1]} (number {k})"
            )
        if frf.dt is None or abs(record.dt - frf.dt) > _SAME_STEP * frf.dt:
            here = "continuous time" if frf.dt is None else f"dt = {frf.dt:g} s"
            raise InputError(
                f"`records` must have the sample time of the response, {here}; got {record.dt:g} s (number {k})"
            )
        if len(record.u) != len(listed[0].u):
            raise InputError(
                f"`records` must all have one length; got {len(listed[0].u)} and {len(record.u)} samples (number {k})"
            )
    return tuple(listed)


def entry_charts(view: ResponseView) -> list[Chart]:
    """Magnitude and phase of every entry, row by row."""
    cells = cells_per_entry(view.ny * view.nu)
    return [_entry(view, i, j, cells) for i in range(view.ny) for j in range(view.nu)]


def _entry(view: ResponseView, i: int, j: int, cells: int) -> Chart:
    frf, axis = view.frf, frequency_axis(view.frf.omega)
    used = ~frf.missing[:, i, j]
    if not used.any():
        title = f"{view.entry(i, j)}: not measured"
        return MagnitudePhase().chart(f"entry-{i}-{j}", axis, Axis(""), Axis(""), title)
    omega, size, silent = frf.omega[used], view.size[used, i, j], view.silent[used, i, j]
    radius = None if view.radius is None else view.radius[used, i, j]
    levels = {name: level[used, i, j] for name, level in view.levels.items()}
    angle, span = measured_phase(omega, frf.values[used, i, j], radius)
    kept = _thinned(omega, axis, [size, next(iter(levels.values()), size)], cells)
    x, low_high = rounded(omega[kept] / HZ), _range(size, [*levels.values(), *([] if radius is None else [radius])])
    drawn = MagnitudePhase()
    if radius is not None:
        turn = half_angle(size, radius)
        ends = np.where(silent, span[0], angle - turn), np.where(silent, span[1], angle + turn)
        jump = np.isnan(with_gaps(angle[kept])) & ~silent[kept] & ~silent[np.roll(kept, 1)]
        low, high = (np.where(jump, np.nan, np.clip(end, *span)[kept]) for end in ends)
        sizes = Ranged(*map(rounded, (size[kept], np.maximum(size - radius, low_high[0])[kept], (size + radius)[kept])))
        angles = Ranged(*map(rounded, (angle[kept], low, high)))
        drawn.add("response ± bound", x, sizes, angles, colour=BAND, fill=True)
        drawn.add("bound", x, _shown(radius[kept]), colour=NOMINAL, dash="dash", size=0.5)
    for name, level in levels.items():
        drawn.add(f"σ of the {name}", x, _shown(level[kept]), colour=_LOOKS[name][0], dash=_LOOKS[name][1])
    marker, sure = "circle" if kept.size <= _FEW else "", np.where(silent, np.nan, 1.0)
    curve = _shown((sure * size)[kept]), rounded(with_gaps((sure * angle)[kept]))
    drawn.add("response", x, *curve, colour=DATA, dash="solid", marker=marker, size=0.5)
    for one, at, response in view.curves:
        value = response[:, i, j]
        turned = next_to(np.degrees(np.angle(value)), np.interp(at, omega, angle))
        curve = _shown(np.abs(value)), rounded(with_gaps(turned))
        drawn.add(one.name, at / HZ, *curve, colour=one.colour, dash=one.dash, size=0.7)
    if (lost := silent[kept]).any():
        places = _shown(size[kept][lost]), rounded(angle[kept][lost])
        drawn.add("response below its bound", x[lost], *places, colour=ALERT, marker="circle-open", size=0.5)
    y = Axis(f"magnitude{unit_label(frf.outputs[i].unit, frf.inputs[j].unit)}", log=True, range=low_high)
    return drawn.chart(f"entry-{i}-{j}", axis, y, phase_axis(span), view.entry(i, j))


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
    x = rounded(omega[kept] / HZ)
    layers: list[Layer] = []
    for k, (colour, dash) in enumerate(_cycle(values.shape[1])):
        name = "largest singular value" if k == 0 else f"singular value {k + 1}"
        layers.append(Layer(name, x, _shown(values[kept, k]), colour, dash=dash, size=0.6))
    bound = view.singular_bound
    if bound is not None:
        layers.append(Layer("bound of the singular values", x, _shown(bound[kept]), FAINT, dash="dash"))
    span = _range(values.ravel(), [] if bound is None else [bound])
    unit = matrix_unit_label(view.frf.outputs, view.frf.inputs)
    y = Axis(f"singular value{unit}", log=True, range=span)
    panel = Panel("Singular values (CMIF)", axis, y, layers)
    return Chart("singular", (panel,), linked=True)


def _cycle(count: int) -> list[tuple[str, str]]:
    """Colours, each with a dash of its own."""
    colours, dashes = (NOMINAL, *FURTHER), ("solid", *DASHES)
    return [(colours[k % len(colours)], dashes[k % len(dashes)]) for k in range(count)]


def coherence_chart(view: ResponseView) -> Chart:
    """Multiple coherence of every output."""
    coherence, omega = view.frf.coherence, view.frf.omega
    axis = frequency_axis(omega)
    layers: list[Layer] = []
    for i, (colour, dash) in enumerate(_cycle(view.ny)):
        kept = _thinned(omega, axis, [coherence[:, i]], cells_per_entry(view.ny))
        x, y = rounded(omega[kept] / HZ), rounded(coherence[kept, i])
        name = f"coherence of {view.frf.outputs[i].name}"
        layers.append(Layer(name, x, y, colour, dash=dash, size=0.6))
    least = float(coherence.min())
    low = 0.0 if least < 0.5 else 0.5 if least < 0.9 else 0.9
    panel = Panel(
        "Coherence", axis, Axis("coherence [–]", range=(low - 0.02 * (1 - low), 1 + 0.03 * (1 - low))), layers
    )
    return Chart("coherence", (panel,), linked=True)


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


def _spectrum(view: ResponseView, axis: Axis, name: str, side: str, index: int, signal: Signal) -> Chart:
    found = view.spectrum(side, index)
    low, high = axis.range or (0.0, np.inf)
    inside = (found.freq_hz >= low) & (found.freq_hz <= high)
    cells = cells_per_entry(view.nu + view.ny)
    layers: list[Layer] = []
    groups = (
        ("between these spectral lines", inside & ~found.excited, FAINT, "solid", ""),
        ("spectral lines of the response", inside & found.excited, NOMINAL, "", "circle"),
    )
    for title, mask, colour, dash, marker in groups:
        freq, amplitude = found.freq_hz[mask], found.amplitude[mask]
        if freq.size:
            kept = thinned(position(freq, axis.log), [amplitude], cells)
            x, y = rounded(freq[kept]), _shown(amplitude[kept])
            layers.append(Layer(title, x, y, colour, dash=dash, marker=marker, size=0.6))
    span = _range(found.amplitude[inside], [])
    y = Axis(f"amplitude{f' [{signal.unit}]' if signal.unit else ''}", log=True, range=span)
    panel = Panel(f"{name} {signal}", axis, y, layers)
    return Chart(f"{name}-{index}", (panel,), linked=True)


def response_bode(
    frf: FrequencyResponse, records: TimeRecord | Sequence[TimeRecord] | None = None, models: Models = None
) -> Chart:
    """Every entry of a response with models over it, then overviews, and the spectra of its records."""
    view = ResponseView(frf, records, models)
    spectra = spectrum_charts(view)
    further = (overview_charts(view), spectra[: view.nu], spectra[view.nu :])
    groups = ([panel for chart in group for panel in chart.panels] for group in further)
    return side_by_side("frf", entry_charts(view), view.nu, *groups)

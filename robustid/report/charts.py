"""What is drawn, prepared once for two renderers: what a chart is, and the responses against the samples.

`plots` draws a `Chart` with matplotlib, `html` with plotly; neither computes anything.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np

from robustid.core import responses as values_at
from robustid.core import simulate
from robustid.data import FrequencyResponse
from robustid.errors import InputError, InputTypeError
from robustid.identification import Identification, Residual, check_model, model_residuals
from robustid.report.facts import started, transfer, unit_label
from robustid.report.style import DATA, FAINT, NOMINAL, further, number

HZ = 2 * np.pi
_GRID = 800  # points of a response, evenly spaced in log frequency
_MANY = 300  # lines, above which their bars run into one another
_NOWHERE = np.zeros(0)
_BLOCK = 64  # frequencies evaluated at once: memory grows with states^2 times this


@dataclasses.dataclass(frozen=True, kw_only=True)
class Axis:
    """One axis: label with unit, scale, and range (None: as the data want)."""

    label: str
    log: bool = False
    range: tuple[float, float] | None = None
    tick: float | None = None

    @property
    def in_full(self) -> bool:
        """Whether the numbers of a logarithmic axis are written in full, 0.5, 1, 2, and not as powers of ten."""
        if not self.log or self.range is None or self.range[1] > 2e4 * self.range[0]:
            return False
        return self.range[1] < 30 * self.range[0] or (self.range[0] >= 1e-4 and self.range[1] <= 1e5)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Layer:
    """A curve (`dash`), samples (`marker`), or both; `low` and `high` are the ends of the bars, or of an area (`fill`)."""

    name: str
    x: np.ndarray
    y: np.ndarray
    colour: str
    dash: str = ""
    marker: str = ""
    low: np.ndarray | None = None
    high: np.ndarray | None = None
    hover: tuple[str, ...] = ()
    size: float = 1.0
    fill: bool = False


@dataclasses.dataclass(frozen=True, kw_only=True)
class Panel:
    """One pair of axes."""

    title: str
    x: Axis
    y: Axis
    layers: tuple[Layer, ...]
    square: bool = False


BLANK = Panel(title="", x=Axis(label=""), y=Axis(label=""), layers=())  # a place that stays empty


@dataclasses.dataclass(frozen=True, kw_only=True)
class Chart:
    """One figure: panels below each other on one x axis (`linked`), or each with its own; `grid`: one of many low ones."""

    name: str
    panels: tuple[Panel, ...]
    linked: bool = False
    columns: int = 1
    grid: bool = False


Models = Mapping[str, Any] | None


def curves(identification: Identification, models: Models) -> list[tuple[str, Any, str, str, str]]:
    """The nominal model and the further ones: (name, model, colour, dash, marker)."""
    out = [(f"nominal model, order {identification.order}", identification.model, NOMINAL, "solid", "circle")]
    if models is None:
        return out
    if not isinstance(models, Mapping):
        raise InputTypeError(f"`models` must map names to control.StateSpace; got {type(models).__name__}")
    for k, (name, model) in enumerate(models.items()):
        if not isinstance(name, str):
            raise InputTypeError(f"`models` must have text as names; got {name!r}")
        out.append((name, checked_model(f"models[{name!r}]", model, identification), *further(k)))
    return out


def checked_model(name: str, model: Any, identification: Identification) -> Any:
    """The model, if it has the channels and the time base of the data."""
    system, dt = check_model(name, model), identification.problem.dt
    p, q = identification.problem.entries.outputs, identification.problem.entries.inputs
    if (system.noutputs, system.ninputs) != (p, q):
        raise InputError(
            f"`{name}` must have {p} output{'s' * (p > 1)} and {q} input{'s' * (q > 1)}; got {system.noutputs} and"
            f" {system.ninputs}"
        )
    if system.nstates and (system.dt is True or abs(system.dt - dt) > 1e-9 * dt):
        raise InputError(
            f"`{name}` must be discrete with dt = {dt:g} s, as the data; got dt = {system.dt}."
            f" Sample it first: control.sample_system(model, {dt:g})"
        )
    return system


def frequency_chart(identification: Identification, models: Models = None, omega: np.ndarray = _NOWHERE) -> Chart:
    """The chart of one channel, as `frequency_charts`."""
    return frequency_charts(identification, models, omega)[0]


def frequency_charts(
    identification: Identification, models: Models = None, omega: np.ndarray = _NOWHERE
) -> list[Chart]:
    """Magnitude and phase of every entry, row by row: the models, at `omega` (rad/s) too, and every sample with its disc."""
    problem, ends, shown = identification.problem, shown_band(identification, omega), curves(identification, models)
    omega, values = responses([model for _, model, *_ in shown], problem, ends, omega)
    pairs = np.ndindex(problem.entries.outputs, problem.entries.inputs)
    return [_entry_chart(identification, (i, j), shown, omega, [v[:, i, j] for v in values], ends) for i, j in pairs]


def _entry_chart(
    identification: Identification,
    entry: tuple[int, int],
    shown: list[Any],
    omega: np.ndarray,
    values: list[np.ndarray],
    band: tuple[float, float],
) -> Chart:
    problem, (low, high) = identification.problem, band
    output, input_ = problem.outputs[entry[0]], problem.inputs[entry[1]]
    phases, span = phase_curves(values)
    measured = _measured(problem, *entry)
    bottom, top = _magnitude_range(measured, values)
    magnitude, phase = [], []
    for (name, _, colour, dash, _), value, angle in zip(shown, values, phases, strict=True):
        style: dict[str, Any] = {"name": name, "x": omega / HZ, "colour": colour, "dash": dash}
        magnitude.append(Layer(y=np.abs(value), **style))
        phase.append(Layer(y=with_gaps(angle), **style))
    for name, at, value, bound in measured:
        x, size = np.maximum(at, low) / HZ, np.abs(value)
        turn = np.degrees(np.arcsin(np.minimum(bound / np.maximum(size, bound), 1)))
        turn = np.where(bound >= size, 180.0, turn)  # the disc holds 0: any phase
        near = phases[0][np.searchsorted(omega, at).clip(0, omega.size - 1)]
        angle = np.degrees(np.angle(value))
        angle = angle - 360 * np.round((angle - near) / 360)  # next to the curve, on this side of the jump
        hover = tuple(
            f"{number(w / HZ, 6)} Hz: {number(a)} ± {number(b)}, {number(p)}°"
            for w, a, b, p in zip(at, size, bound, angle, strict=True)
        )
        style = {"name": name, "x": x, "colour": DATA, "marker": "circle", "hover": hover}
        ends = np.maximum(size - bound, bottom), size + bound
        _add_samples(magnitude, np.maximum(size, bottom), ends, style)
        _add_samples(phase, angle, (angle - turn, angle + turn), style)
    alone, title = problem.entries.single, transfer(identification, *entry)
    axis = hertz(problem, low, high)
    labels = title, f"phase [°] of\n{output.name} / {input_.name}"
    if not alone:  # the name stands above
        labels = f"magnitude{unit_label(output.unit, input_.unit)}", "phase [°]"
    tick = 90.0 if alone or span[1] - span[0] <= 450 else 180.0
    panels = (
        Panel(
            title="Magnitude" if alone else title,
            x=axis,
            y=Axis(label=labels[0], log=True, range=(bottom, top)),
            layers=tuple(magnitude),
        ),
        Panel(
            title="Phase" if alone else "",
            x=axis,
            y=Axis(label=labels[1], range=span, tick=tick),
            layers=tuple(phase),
        ),
    )
    chart = "frequency" if alone else f"entry-{entry[0]}-{entry[1]}"
    return Chart(name=chart, panels=panels, linked=True, grid=not alone)


def _measured(problem: Any, output: int, input_: int) -> list[tuple[str, np.ndarray, np.ndarray, np.ndarray]]:
    """Samples of an entry: name, lines in rad/s, values, and radius of the disc around what the bound leaves to it alone."""
    responses, out = [f for f in problem.frequency if isinstance(f, FrequencyResponse)], []
    for k, frf in enumerate(responses):
        used, place = np.isfinite(frf.bound[:, output, input_]), (slice(None), output, input_)
        if not used.any():
            continue
        what = "data with their discs" if frf.tilt is None else "data with discs around their ellipses"
        what += "" if frf.joint == "entry" else " (shared bound)"
        name = _numbered(what, k, len(responses))
        out.append((name, frf.omega[used], frf.values[place][used], frf.outer_radius[place][used]))
    return out


def shown_band(identification: Identification, omega: np.ndarray) -> tuple[float, float]:
    """The `band` of the data, down to the lowest of further frequencies, rad/s."""
    low, high = band(identification.problem)
    return min([low, *omega[omega > 0].tolist()]), high


def responses(
    models: list[Any], problem: Any, ends: tuple[float, float], wanted: np.ndarray
) -> tuple[np.ndarray, list[np.ndarray]]:
    """Frequencies in rad/s that resolve every model, the `wanted` ones among them, and the response (F, ny, nu) of each model."""
    omega = _grid(models, problem, *ends, wanted)
    return omega, [_evaluate(model, omega * problem.dt) for model in models]


def _add_samples(
    layers: list[Layer], y: np.ndarray, ends: tuple[np.ndarray, np.ndarray], style: dict[str, Any]
) -> None:
    """Samples with bars; so many that bars would hide everything: small ones on an area, behind the models."""
    low, high = ends
    if y.size <= _MANY:
        layers.append(Layer(y=y, low=low, high=high, **style))
        return
    name = style["name"].replace("data with their discs", "bounds of the data")
    layers[:0] = [
        Layer(name=name, x=style["x"], y=y, colour=DATA, low=low, high=high, fill=True),
        Layer(y=y, size=0.4, **style | {"name": style["name"].replace(" with their discs", "")}),
    ]


def phase_curves(values: list[np.ndarray]) -> tuple[list[np.ndarray], tuple[float, float]]:
    """Phases in degrees and their range: continuous where they stay within two turns, else from -180 to 180."""
    turned = [np.degrees(np.unwrap(np.angle(v))) for v in values]
    turned = [p - 360 * np.round(np.median(p - turned[0]) / 360) for p in turned]
    low, high = (float(limit(np.concatenate(turned))) for limit in (np.min, np.max))
    if high - low <= 720:
        return turned, (90 * np.floor(low / 90) - 45, 90 * np.ceil(high / 90) + 45)
    return [np.degrees(np.angle(v)) for v in values], (-225.0, 225.0)


def with_gaps(angle: np.ndarray) -> np.ndarray:
    """The curve with a gap where the phase jumps by a turn."""
    out = angle.copy()
    out[1:][np.abs(np.diff(angle)) > 180] = np.nan
    return out


def between_gaps(values: np.ndarray) -> list[slice]:
    """The stretches without NaN.

    Examples
    --------
    >>> between_gaps(np.array([1.0, np.nan, 2.0, 3.0]))
    [slice(0, 1, None), slice(2, 4, None)]
    """
    known = np.concatenate([[False], np.isfinite(values), [False]])
    ends = np.flatnonzero(np.diff(known.astype(int)))
    return [slice(int(a), int(b)) for a, b in ends.reshape(-1, 2)]


def _numbered(text: str, index: int, count: int) -> str:
    return f"{text} ({index + 1})" if count > 1 else text


def band(problem: Any) -> tuple[float, float]:
    """From below the lowest line (or 1/length of the longest record) to the Nyquist frequency, rad/s."""
    high = np.pi / problem.dt
    lines = problem.angles[problem.angles > 0] / problem.dt
    starts = [lines.min()] if lines.size else [2 * high / max(t.u.shape[0], 2) for t in problem.time]
    return min([*starts, high / 4]) / 2, high


def hertz(problem: Any, low: float, high: float) -> Axis:
    """The frequency axis; a logarithmic one has no 0, so that samples there are put at its left end and this is said."""
    at_zero = bool(problem.angles.size) and problem.angles[0] == 0
    note = " (samples at 0 Hz are drawn at the left end)" if at_zero else ""
    return Axis(label=f"frequency [Hz]{note}", log=True, range=(low / HZ, high / HZ))


def _grid(models: list[Any], problem: Any, low: float, high: float, wanted: np.ndarray) -> np.ndarray:
    """Log-spaced, the lines of the data, wanted ones, and as many points around each light pole as its resonance needs."""
    base = np.geomspace(low, high, _GRID)
    step = base[1] / base[0] - 1
    extra = [base, wanted, problem.angles[problem.angles > 0] / problem.dt]
    # Equal steps of phase across the resonance: w + sigma tan(theta).
    spread = np.tan(np.linspace(-1.55, 1.55, 61))
    for model in models:
        poles = model.poles()
        s = np.log(poles[np.abs(poles) > 0].astype(complex)) / problem.dt
        narrow = (s.imag > 0) & (np.abs(s.real) < 4 * step * s.imag) & (s.real != 0)
        extra += [pole.imag + abs(pole.real) * spread for pole in s[narrow]]
    omega = np.unique(np.concatenate(extra))
    return omega[(omega >= low) & (omega <= high)]


def _evaluate(model: Any, angles: np.ndarray) -> np.ndarray:
    parts = np.array_split(angles, max(1, angles.size // _BLOCK))
    return np.concatenate([values_at(model, part) for part in parts])


def _magnitude_range(measured: list[Any], values: list[np.ndarray]) -> tuple[float, float]:
    """Holds all samples and the curves, but not the bottom of deep notches."""
    sizes = [np.abs(value) for *_, value, _ in measured]
    tops = [size + bound for size, (*_, bound) in zip(sizes, measured, strict=True)]
    top = float(np.max(np.concatenate([*map(np.abs, values), *tops])))
    if not top > 0:
        return 0.1, 1.0
    floors = [np.quantile(np.abs(values[0]), 0.02), *(s[s > 0].min(initial=top) for s in sizes)]
    return max(min(floors) / 2, 1e-8 * top), 1.5 * top


def time_chart(identification: Identification, models: Models = None) -> Chart:
    """Every record against the models; of one channel also the step and pulse responses of the models."""
    problem, shown = identification.problem, curves(identification, models)
    # The nominal model keeps the initial state that was identified with it.
    found = [identification.residuals, *(model_residuals(problem, model) for _, model, *_ in shown[1:])]
    panels = [
        _record_panel(identification, shown, answers)
        for answers in zip(*found, strict=True)
        if answers[0].kind == "time"
    ]
    if problem.entries.single:
        panels += answer_panels(identification, shown, 0, 0)
    return Chart(name="time", panels=tuple(panels), grid=not problem.entries.single)


def answer_panels(identification: Identification, shown: list[Any], output: int, input_: int) -> list[Panel]:
    """Step and pulse response of one entry of the models."""
    problem = identification.problem
    cause, effect = problem.inputs[input_], problem.outputs[output]
    count = _settling(identification.model)
    t, u = problem.dt * np.arange(count), np.zeros((count, problem.entries.inputs))
    u[0, input_] = 1
    pulses = [simulate(model, u)[0][:, output] for _, model, *_ in shown]
    amount = f"1 {cause.unit}".rstrip()
    panels = []
    for title, answers in (
        (f"Step response: {cause.name} rises by {amount} at 0 s", [np.cumsum(p) for p in pulses]),
        (f"Pulse response: {cause.name} is {amount} during the first sample", pulses),
    ):
        layers = tuple(
            Layer(name=name, x=t, y=y, colour=colour, dash=dash)
            for (name, _, colour, dash, _), y in zip(shown, answers, strict=True)
        )
        panels.append(Panel(title=title, x=Axis(label="time [s]"), y=Axis(label=str(effect)), layers=layers))
    return panels


def _settling(model: Any) -> int:
    """Samples until the slowest decaying mode is down to 5 %, within reason."""
    size = np.abs(model.poles())
    slowest = max(size[size < 1 - 1e-7], default=0.0)
    return int(np.clip(3 / -np.log(slowest), 40, 600)) if slowest > 0 else 40


def _record_panel(identification: Identification, shown: list[Any], residuals: tuple[Residual, ...]) -> Panel:
    problem, (index, output) = identification.problem, (residuals[0].index, residuals[0].entry[0] or 0)
    record = problem.time[index]
    used = np.isfinite(record.bound[:, output])
    t, y, bound = record.time[used], record.y[used, output], residuals[0].bound
    layers = [
        Layer(name=name, x=t, y=y - residual.error, colour=colour, dash=dash)
        for (name, _, colour, dash, _), residual in zip(shown, residuals, strict=True)
    ]
    if not np.all(used):
        style: dict[str, Any] = {"name": "not used", "colour": FAINT, "marker": "circle-open"}
        layers.append(Layer(x=record.time[~used], y=record.y[~used, output], **style))
    hover = tuple(f"{number(a, 6)} s: {number(b, 6)} ± {number(c)}" for a, b, c in zip(t, y, bound, strict=True))
    bars = {"low": y - bound, "high": y + bound, "hover": hover}
    layers.append(Layer(name="data with their intervals", x=t, y=y, colour=DATA, marker="circle", **bars))
    title = f"{_numbered('Record', index, len(problem.time))} {started(record)}"
    if not problem.entries.single:
        title += f": {record.outputs[output].name}"
    if np.any(bound > record.bound[used, output] * (1 + 1e-12)):
        title += ", intervals widened by what the unknown past can add"
    return Panel(title=title, x=Axis(label="time [s]"), y=Axis(label=str(record.outputs[output])), layers=tuple(layers))

"""What is drawn, prepared once for two renderers: what a chart is, and the responses against the samples.

`plots` draws a `Chart` with matplotlib, `html` with plotly; neither computes anything.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from robustid.errors import InputError, InputTypeError
from robustid.identification import Identification
from robustid.identification.residuals import model_residuals
from robustid.identification.simulation import response, simulate
from robustid.identification.validation import check_model
from robustid.report.facts import started, transfer
from robustid.report.style import DATA, FAINT, NOMINAL, further, number

if TYPE_CHECKING:
    pass

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
    """One figure: panels below each other on one x axis (`linked`), or each with its own."""

    name: str
    panels: tuple[Panel, ...]
    linked: bool = False
    columns: int = 1


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
    """The model, if it has one channel and the time base of the data."""
    system, dt = check_model(name, model), identification.problem.dt
    if (system.noutputs, system.ninputs) != (1, 1):
        raise InputError(f"`{name}` must have 1 output and 1 input; got {system.noutputs} and {system.ninputs}")
    if system.nstates and (system.dt is True or abs(system.dt - dt) > 1e-9 * dt):
        raise InputError(
            f"`{name}` must be discrete with dt = {dt:g} s, as the data; got dt = {system.dt}."
            f" Sample it first: control.sample_system(model, {dt:g})"
        )
    return system


def frequency_chart(identification: Identification, models: Models = None, omega: np.ndarray = _NOWHERE) -> Chart:
    """Magnitude and phase of the models, those at `omega` (rad/s) among others, and of every sample with its disc."""
    problem, (low, high), shown = (
        identification.problem,
        shown_band(identification, omega),
        curves(identification, models),
    )
    omega, values = responses([model for _, model, *_ in shown], problem, (low, high), omega)
    phases, span = phase_curves(values)
    bottom, top = _magnitude_range(problem, values)
    magnitude, phase = [], []
    for (name, _, colour, dash, _), value, angle in zip(shown, values, phases, strict=True):
        style: dict[str, Any] = {"name": name, "x": omega / HZ, "colour": colour, "dash": dash}
        magnitude.append(Layer(y=np.abs(value), **style))
        phase.append(Layer(y=with_gaps(angle), **style))
    for k, frf in enumerate(problem.frequency):
        measured, bound, x = frf.values[:, 0, 0], frf.outer_radius[:, 0, 0], np.maximum(frf.omega, low) / HZ
        size = np.abs(measured)
        turn = np.degrees(np.arcsin(np.minimum(bound / np.maximum(size, bound), 1)))
        turn = np.where(bound >= size, 180.0, turn)  # the disc holds 0: any phase
        near = phases[0][np.searchsorted(omega, frf.omega).clip(0, omega.size - 1)]
        angle = np.degrees(np.angle(measured))
        angle = angle - 360 * np.round((angle - near) / 360)  # next to the curve, on this side of the jump
        what = "data with their discs" if frf.tilt is None else "data with discs around their ellipses"
        name = _numbered(what, k, len(problem.frequency))
        hover = tuple(
            f"{number(w / HZ, 6)} Hz: {number(a)} ± {number(b)}, {number(p)}°"
            for w, a, b, p in zip(frf.omega, size, bound, angle, strict=True)
        )
        style = {"name": name, "x": x, "colour": DATA, "marker": "circle", "hover": hover}
        ends = np.maximum(size - bound, bottom), size + bound
        _add_samples(magnitude, np.maximum(size, bottom), ends, style)
        _add_samples(phase, angle, (angle - turn, angle + turn), style)
    axis = hertz(problem, low, high)
    title = transfer(identification)
    panels = (
        Panel(title="Magnitude", x=axis, y=Axis(label=title, log=True, range=(bottom, top)), layers=tuple(magnitude)),
        Panel(
            title="Phase",
            x=axis,
            y=Axis(
                label=f"phase [°] of\n{problem.channel[0].name} / {problem.channel[1].name}",
                range=span,
                tick=90.0,
            ),
            layers=tuple(phase),
        ),
    )
    return Chart(name="frequency", panels=panels, linked=True)


def shown_band(identification: Identification, omega: np.ndarray) -> tuple[float, float]:
    """The `band` of the data, down to the lowest of further frequencies, rad/s."""
    low, high = band(identification.problem)
    return min([low, *omega[omega > 0].tolist()]), high


def responses(
    models: list[Any], problem: Any, ends: tuple[float, float], wanted: np.ndarray
) -> tuple[np.ndarray, list[np.ndarray]]:
    """Frequencies in rad/s that resolve every model, the `wanted` ones among them, and the response of each model there."""
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
    return np.concatenate([response(model, part) for part in parts])


def _magnitude_range(problem: Any, values: list[np.ndarray]) -> tuple[float, float]:
    """Holds all samples and the curves, but not the bottom of deep notches."""
    sizes = [np.abs(f.values[:, 0, 0]) for f in problem.frequency]
    tops = [s + f.outer_radius[:, 0, 0] for s, f in zip(sizes, problem.frequency, strict=True)]
    top = float(np.max(np.concatenate([*map(np.abs, values), *tops])))
    if not top > 0:
        return 0.1, 1.0
    floors = [np.quantile(np.abs(values[0]), 0.02), *(s[s > 0].min(initial=top) for s in sizes)]
    return max(min(floors) / 2, 1e-8 * top), 1.5 * top


def time_chart(identification: Identification, models: Models = None) -> Chart:
    """Every record against the models, and the step and pulse responses of the models."""
    problem, shown = identification.problem, curves(identification, models)
    panels = [_record_panel(identification, index, shown) for index in range(len(problem.time))]
    output, input_ = problem.channel
    count = _settling(identification.model)
    u = np.eye(1, count)[0]
    t = problem.dt * np.arange(count)
    pulses = [simulate(model, u[:, None])[0][:, 0] for _, model, *_ in shown]
    amount = f"1 {input_.unit}".rstrip()
    for title, answers in (
        (f"Step response: {input_.name} rises by {amount} at 0 s", [np.cumsum(p) for p in pulses]),
        (f"Pulse response: {input_.name} is {amount} during the first sample", pulses),
    ):
        layers = tuple(
            Layer(name=name, x=t, y=y, colour=colour, dash=dash)
            for (name, _, colour, dash, _), y in zip(shown, answers, strict=True)
        )
        panels.append(Panel(title=title, x=Axis(label="time [s]"), y=Axis(label=str(output)), layers=layers))
    return Chart(name="time", panels=tuple(panels))


def _settling(model: Any) -> int:
    """Samples until the slowest decaying mode is down to 5 %, within reason."""
    size = np.abs(model.poles())
    slowest = max(size[size < 1 - 1e-7], default=0.0)
    return int(np.clip(3 / -np.log(slowest), 40, 600)) if slowest > 0 else 40


def _record_panel(identification: Identification, index: int, shown: list[Any]) -> Panel:
    problem = identification.problem
    record = problem.time[index]
    used = np.isfinite(record.bound[:, 0])
    t, y = record.time[used], record.y[used, 0]
    layers, place = [], len(problem.frequency) + index
    bound = identification.residuals[place].bound
    for k, (name, model, colour, dash, _) in enumerate(shown):
        # The nominal model keeps the initial state that was identified with it.
        residual = (identification.residuals if k == 0 else model_residuals(problem, model))[place]
        layers.append(Layer(name=name, x=t, y=y - residual.error, colour=colour, dash=dash))
    if not np.all(used):
        layers.append(
            Layer(name="not used", x=record.time[~used], y=record.y[~used, 0], colour=FAINT, marker="circle-open")
        )
    hover = tuple(f"{number(a, 6)} s: {number(b, 6)} ± {number(c)}" for a, b, c in zip(t, y, bound, strict=True))
    bars = {"low": y - bound, "high": y + bound, "hover": hover}
    layers.append(Layer(name="data with their intervals", x=t, y=y, colour=DATA, marker="circle", **bars))
    title = f"{_numbered('Record', index, len(problem.time))} {started(record)}"
    if np.any(bound > record.bound[used, 0] * (1 + 1e-12)):
        title += ", intervals widened by what the unknown past can add"
    return Panel(title=title, x=Axis(label="time [s]"), y=Axis(label=str(record.outputs[0])), layers=tuple(layers))

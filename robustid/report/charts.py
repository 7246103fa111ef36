"""What is drawn: curves and samples of every plot, prepared once and drawn by two renderers.

`plots` draws a `Chart` with matplotlib, `html` with plotly; neither computes anything.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from robustid.errors import InputError, InputTypeError
from robustid.identification import Identification
from robustid.identification.validation import check_model
from robustid.identification.verification import Residual, model_residuals, response, simulate
from robustid.report.facts import PoleRow, pole_table, started, transfer
from robustid.report.style import ALERT, DATA, FAINT, NOMINAL, further, number

if TYPE_CHECKING:
    pass

_HZ = 2 * np.pi
_GRID = 800  # points of a response, evenly spaced in log frequency
_BLOCK = 64  # frequencies evaluated at once: memory grows with states^2 times this
_TOUCHES = 0.99  # of the limit: the sample is marked
_LIGHT = 0.3  # below this damping a pole is an oscillation that is labelled
_SMALLEST_RATIO = 1e-3


@dataclasses.dataclass(frozen=True, kw_only=True)
class Axis:
    """One axis: label with unit, scale, and range (None: as the data want)."""

    label: str
    log: bool = False
    range: tuple[float, float] | None = None
    tick: float | None = None


@dataclasses.dataclass(frozen=True, kw_only=True)
class Layer:
    """A curve (`dash`), samples (`marker`), or both; `low` and `high` are the ends of the bars."""

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


@dataclasses.dataclass(frozen=True, kw_only=True)
class Panel:
    """One pair of axes."""

    title: str
    x: Axis
    y: Axis
    layers: tuple[Layer, ...]
    square: bool = False


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


def frequency_chart(identification: Identification, models: Models = None) -> Chart:
    """Magnitude and phase of the models, and of every sample with its disc."""
    problem, shown = identification.problem, curves(identification, models)
    low, high = _band(problem)
    omega = _grid([model for _, model, *_ in shown], problem, low, high)
    values = [_evaluate(model, omega * problem.dt) for _, model, *_ in shown]
    phases = [np.degrees(np.angle(v)) for v in values]
    bottom, top = _magnitude_range(problem, values)
    magnitude, phase = [], []
    for (name, _, colour, dash, _), value, angle in zip(shown, values, phases, strict=True):
        style: dict[str, Any] = {"name": name, "x": omega / _HZ, "colour": colour, "dash": dash}
        magnitude.append(Layer(y=np.abs(value), **style))
        phase.append(Layer(y=_broken(angle), **style))
    for k, frf in enumerate(problem.frequency):
        measured, bound, x = frf.values[:, 0, 0], frf.bound[:, 0, 0], np.maximum(frf.omega, low) / _HZ
        size = np.abs(measured)
        turn = np.degrees(np.arcsin(np.minimum(bound / np.maximum(size, bound), 1)))
        turn = np.where(bound >= size, 180.0, turn)  # the disc holds 0: any phase
        near = phases[0][np.searchsorted(omega, frf.omega).clip(0, omega.size - 1)]
        angle = np.degrees(np.angle(measured))
        angle = angle - 360 * np.round((angle - near) / 360)  # next to the curve, on this side of the jump
        name = _numbered("data with their discs", k, len(problem.frequency))
        hover = tuple(
            f"{number(w / _HZ, 6)} Hz: {number(a)} ± {number(b)}, {number(p)}°"
            for w, a, b, p in zip(frf.omega, size, bound, angle, strict=True)
        )
        style = {"name": name, "x": x, "colour": DATA, "marker": "circle", "hover": hover}
        reach = np.maximum(size - bound, bottom)
        magnitude.append(Layer(y=np.maximum(size, bottom), low=reach, high=size + bound, **style))
        phase.append(Layer(y=angle, low=angle - turn, high=angle + turn, **style))
    axis = _hertz(problem, low, high)
    title = transfer(identification)
    panels = (
        Panel(title="Magnitude", x=axis, y=Axis(label=title, log=True, range=(bottom, top)), layers=tuple(magnitude)),
        Panel(
            title="Phase",
            x=axis,
            y=Axis(
                label=f"phase [°] of\n{problem.channel[0].name} / {problem.channel[1].name}",
                range=(-225.0, 225.0),
                tick=90.0,
            ),
            layers=tuple(phase),
        ),
    )
    return Chart(name="frequency", panels=panels, linked=True)


def _broken(angle: np.ndarray) -> np.ndarray:
    """The curve with a gap where the phase jumps by a turn."""
    out = angle.copy()
    out[1:][np.abs(np.diff(angle)) > 180] = np.nan
    return out


def _numbered(text: str, index: int, count: int) -> str:
    return f"{text} ({index + 1})" if count > 1 else text


def _band(problem: Any) -> tuple[float, float]:
    """From below the lowest line (or 1/length of the longest record) to the Nyquist frequency, rad/s."""
    high = np.pi / problem.dt
    lines = problem.angles[problem.angles > 0] / problem.dt
    starts = [lines.min()] if lines.size else [2 * high / max(t.u.shape[0], 2) for t in problem.time]
    return min([*starts, high / 4]) / 2, high


def _hertz(problem: Any, low: float, high: float) -> Axis:
    """The frequency axis; a logarithmic one has no 0, so that samples there are put at its left end and this is said."""
    at_zero = bool(problem.angles.size) and problem.angles[0] == 0
    note = " (samples at 0 Hz are drawn at the left end)" if at_zero else ""
    return Axis(label=f"frequency [Hz]{note}", log=True, range=(low / _HZ, high / _HZ))


def _grid(models: list[Any], problem: Any, low: float, high: float) -> np.ndarray:
    """Log-spaced, the lines of the data, and as many points around each light pole as its resonance needs."""
    base = np.geomspace(low, high, _GRID)
    step = base[1] / base[0] - 1
    extra = [base, problem.angles[problem.angles > 0] / problem.dt]
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
    tops = [s + f.bound[:, 0, 0] for s, f in zip(sizes, problem.frequency, strict=True)]
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
    pulses = [simulate(model, u) for _, model, *_ in shown]
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


def residual_chart(identification: Identification, models: Models = None) -> Chart:
    """|residual|/bound of every sample, the limit, and who touches it."""
    problem, shown = identification.problem, curves(identification, models)
    found = [list(identification.residuals), *(model_residuals(problem, model) for _, model, *_ in shown[1:])]
    panels = []
    for kind, label in (("frequency", transfer(identification)), ("time", str(problem.channel[0]))):
        parts = [[r for r in residuals if r.kind == kind] for residuals in found]
        if parts[0]:
            panels.append(_residual_panel(identification, kind, label, parts, shown))
    return Chart(name="residuals", panels=tuple(panels))


def _residual_panel(
    identification: Identification, kind: str, label: str, parts: list[list[Residual]], shown: list[Any]
) -> Panel:
    problem, margin = identification.problem, identification.margin
    low, high = _band(problem)
    last = max(float(r.axis.max()) for r in parts[0])
    x = _hertz(problem, low, high) if kind == "frequency" else Axis(label="time [s]", range=(-0.02 * last, 1.02 * last))
    largest = max(margin, *(float(r.ratio.max()) for residuals in parts for r in residuals))
    log = largest > 3
    smallest = min(float(r.ratio.min()) for residuals in parts for r in residuals)
    floor = (
        float(np.clip(10 ** np.floor(np.log10(max(smallest, _SMALLEST_RATIO))), _SMALLEST_RATIO, 0.1)) if log else 0.0
    )
    layers = []
    for (name, _, colour, _, marker), residuals in zip(shown, parts, strict=True):
        at = np.concatenate([np.maximum(r.axis, low) / _HZ if kind == "frequency" else r.axis for r in residuals])
        true = np.concatenate([r.ratio for r in residuals])
        ratio = np.maximum(true, floor)
        hover = tuple(f"{number(a, 6)}: {number(r)} of the bound" for a, r in zip(at, true, strict=True))
        nominal = colour == NOMINAL
        bars = {"low": np.full(at.size, floor), "high": ratio} if nominal else {}
        layers.append(Layer(name=name, x=at, y=ratio, colour=colour, marker=marker, hover=hover, **bars))
        if nominal:
            layers += _marked(at, ratio, max(1.0, margin))
    ends = np.array(x.range if x.range else (0.0, last))
    layers.append(Layer(name="limit: residual = bound", x=ends, y=np.ones(2), colour=DATA, dash="solid"))
    # A margin of (nearly) 0 would be a line on the axis.
    if margin > max(floor, 1e-3):
        name = f"smallest reachable: {number(margin)}"
        layers.append(Layer(name=name, x=ends, y=np.full(2, margin), colour=ALERT, dash="dash"))
    span = (floor, 2 * largest) if log else (0.0, 1.12 * max(largest, 1.0))
    return Panel(
        title=f"{label}: {kind} samples",
        x=x,
        y=Axis(label="|residual| / bound", log=log, range=span),
        layers=tuple(layers),
    )


def _marked(at: np.ndarray, ratio: np.ndarray, limit: float) -> list[Layer]:
    """Rings around the samples outside their bound, and around those that touch the limit."""
    touches = ratio >= _TOUCHES * limit
    outside = (ratio > 1) & ~touches
    groups = (
        (touches, "touches the limit" if limit == 1 else "touches margin × bound", "diamond-open", 2.2),
        (outside, "outside its bound", "circle-open", 2.0),
    )
    return [
        Layer(name=name, x=at[mask], y=ratio[mask], colour=ALERT, marker=marker, size=size)
        for mask, name, marker, size in groups
        if np.any(mask)
    ]


def hankel_chart(identification: Identification, reduction: Any = None) -> Chart:
    """Hankel singular values, and the order that was chosen.

    Those of the reduction where there is one, else of the model; integrators have none and are always kept.
    """
    from robustid.reduction import balanced_truncation

    shown = reduction
    if shown is None:
        shown = balanced_truncation(identification.model, order=identification.order, unstable="keep")
    values = shown.hankel
    held = shown.bounds.size - 1 - values.size
    top = float(values.max(initial=0.0)) or 1.0
    floor = 1e-17 * top
    index = np.arange(1, values.size + 1)
    kept = index <= shown.order - held
    groups = [(kept, "kept", NOMINAL, "circle"), (~kept, "truncated", FAINT, "circle-open")]
    if reduction is None:
        groups = [(np.ones(index.size, bool), "of the nominal model", NOMINAL, "circle")]
    y = np.maximum(values, floor)
    layers = [
        Layer(name=name, x=index[mask].astype(float), y=y[mask], colour=colour, marker=marker)
        for mask, name, colour, marker in groups
        if np.any(mask)
    ]
    span = (max(float(y.min(initial=top)), floor) / 3, 3 * top)
    if reduction is not None:
        place = np.full(2, shown.order - held + 0.5)
        name = f"chosen order {shown.order}"
        layers.append(Layer(name=name, x=place, y=np.array(span), colour=ALERT, dash="dash"))
    title = "Hankel singular values"
    if held:
        title += f" of the stable part ({held} state{'s' * (held > 1)} on the stability boundary always kept)"
    x = Axis(label="number [–]", range=(0.0, index.size + 1.0))
    y_axis = Axis(label=f"Hankel singular value\n{transfer(identification)}", log=True, range=span)
    return Chart(name="hankel", panels=(Panel(title=title, x=x, y=y_axis, layers=tuple(layers)),))


def pole_chart(identification: Identification, models: Models = None) -> Chart:
    """Poles in the z-plane, and their damping over their frequency."""
    problem, shown = identification.problem, curves(identification, models)
    rho = identification.prior.decay_rate
    turn = np.linspace(0, 2 * np.pi, 361)
    circles = (("unit circle: |z| = 1", 1.0, DATA, "solid"), (f"|z| = 1/ρ = {number(1 / rho)}", 1 / rho, FAINT, "dash"))
    plane = [
        Layer(name=name, x=radius * np.cos(turn), y=radius * np.sin(turn), colour=colour, dash=dash)
        for name, radius, colour, dash in circles
    ]
    damping, reach = [], 1.0
    for name, model, colour, _, marker in shown:
        rows, poles = pole_table(model) if model.nstates else [], model.poles()
        marker = "x" if colour == NOMINAL else marker
        style: dict[str, Any] = {"name": name, "colour": colour, "marker": marker, "size": 1.3}
        words = {row.pole: _pole_words(row) for row in rows}
        words |= {pole.conjugate(): text for pole, text in words.items()}
        hover = tuple(words.get(complex(p), "") for p in poles)
        reach = max(reach, float(np.abs(poles).max(initial=0.0)))
        plane.append(Layer(x=poles.real, y=poles.imag, hover=hover, **style))
        swings = [row for row in rows if row.count == 2 and row.damping > 0]
        x, y = (np.array([getattr(row, part) for row in swings]) for part in ("hz", "damping"))
        damping.append(Layer(x=x, y=y, hover=tuple(_pole_words(row) for row in swings), **style))
    span = (-1.1 * reach, 1.1 * reach)
    low, high = _band(problem)
    every = np.concatenate([layer.x for layer in damping] + [np.array([low, high]) / _HZ])
    ratios = np.concatenate([layer.y for layer in damping])
    y_range = (min(0.5 * ratios.min(initial=1.0), 0.05), 2.0)
    panels = (
        Panel(
            title="Poles in the z-plane",
            x=Axis(label="real part of z [–]", range=span),
            y=Axis(label="imaginary part of z [–]", range=span),
            layers=tuple(plane),
            square=True,
        ),
        Panel(
            title="Damping of the oscillating poles",
            x=Axis(label="natural frequency [Hz]", log=True, range=(every.min() * 0.9, every.max() * 1.1)),
            y=Axis(label="damping ratio [–]", log=True, range=y_range),
            layers=tuple(damping),
        ),
    )
    return Chart(name="poles", panels=panels, columns=2)


def _pole_words(row: PoleRow) -> str:
    text = f"|z| = {number(row.modulus, 5)}"
    if row.hz == 0:
        return f"integrator, {text}"
    return f"{number(row.hz)} Hz, damping {number(row.damping, 3)}, {text}"

"""What is drawn of a matrix-fraction fit: the response of every entry, convergence, poles."""

from __future__ import annotations

from typing import Any

import numpy as np

from robustid.mfd import continuous
from robustid.report.charts import HZ, Axis, Chart, Layer, Panel, phase_curves, with_gaps
from robustid.report.facts import unit_label
from robustid.report.mfd_facts import with_deviation
from robustid.report.mfd_view import FitView
from robustid.report.style import ALERT, DATA, FAINT, FURTHER, MARKERS, NOMINAL

EPSILON = float(np.finfo(float).eps)
_GRID = 600  # points of a response, along the axis
_AROUND = 21  # further points around each light mode
# Cells of the frequency axis; of each, two points of the curve or three samples are drawn.
_MOST_CELLS, _LEAST_CELLS, _ALL_CELLS = 350, 60, 4800
_DIGITS = 6


def response_charts(view: FitView) -> list[Chart]:
    """Magnitude and phase of every entry, row by row: samples, model, residual, and how sure the model is."""
    log = log_axis(view.omega)
    omega = model_grid(view, log)
    values = view.response(omega)
    deviation = None if view.covariance is None else view.covariance.response_std(omega)
    cells = cells_per_entry(view.ny * view.nu)
    charts = []
    for i in range(view.ny):
        for j in range(view.nu):
            here = thinned(position(omega, log), [np.abs(values[:, i, j])], cells)
            spread = None if deviation is None else deviation[here, i, j]
            charts.append(_entry(view, i, j, omega[here], values[here, i, j], spread, cells))
    return charts


def drawn_lines(view: FitView) -> int:
    """How many lines of an entry are drawn at most."""
    return min(view.omega.size, 3 * cells_per_entry(view.ny * view.nu))


def cells_per_entry(entries: int) -> int:
    """Fewer for many entries: the page keeps its size."""
    return int(np.clip(_ALL_CELLS // entries, _LEAST_CELLS, _MOST_CELLS))


def _entry(
    view: FitView, i: int, j: int, omega: np.ndarray, values: np.ndarray, deviation: np.ndarray | None, cells: int
) -> Chart:
    axis = frequency_axis(view.omega)
    lines, measured = view.omega, view.values[:, i, j]
    error, used = np.abs(measured - view.fitted[:, i, j]), view.used[:, i, j]
    kept = thinned(position(lines, axis.log), [np.abs(measured), error], cells)
    span = _magnitude_range(np.abs(measured), error[used], np.abs(values))
    (angle,), phase_span = phase_curves([values])
    name = f"model, order {view.fit.fraction.A.shape[0]}"
    magnitude, phase = [], []
    x = rounded(omega / HZ)
    if deviation is not None:
        low = np.maximum(np.abs(values) - deviation, span[0])
        bounds: dict[str, Any] = {"low": rounded(low), "high": rounded(np.abs(values) + deviation)}
        magnitude.append(
            Layer(name="model ± σ", x=x, y=rounded(np.abs(values)), colour=NOMINAL, dash="solid", fill=True, **bounds)
        )
        magnitude.append(Layer(name="σ of the model", x=x, y=rounded(deviation), colour=FURTHER[0], dash="dash"))
    if view.noise is not None:
        at, level = rounded(lines[kept] / HZ), rounded(view.noise[kept, i, j])
        magnitude.append(Layer(name="σ of the data", x=at, y=level, colour=FAINT, dash="dot"))
    # Drawn over the samples, thin: where both agree both are seen.
    curve: dict[str, Any] = {"name": name, "x": x, "colour": NOMINAL, "dash": "solid", "size": 0.5}
    unused = ~used & (measured != 0)  # a fit knows zeros where entries are missing
    groups = ((used, "data", DATA, "circle"), (unused, "data without weight", FAINT, "circle-open"))
    for mask, label, colour, marker in groups:
        part = kept[mask[kept]]
        if not part.size:
            continue
        style: dict[str, Any] = {"name": label, "x": rounded(lines[part] / HZ), "colour": colour, "marker": marker}
        near = angle[np.searchsorted(omega, lines[part]).clip(0, omega.size - 1)]
        turned = np.degrees(np.angle(measured[part]))
        turned = turned - 360 * np.round((turned - near) / 360)
        magnitude.append(Layer(y=rounded(np.abs(measured[part])), size=0.6, **style))
        phase.append(Layer(y=rounded(turned), size=0.6, **style))
    part = kept[used[kept]]
    at, left = rounded(lines[part] / HZ), rounded(error[part])
    magnitude.append(Layer(name="residual |P_o − P|", x=at, y=left, colour=ALERT, marker="circle", size=0.45))
    magnitude.append(Layer(y=rounded(np.abs(values)), **curve))
    phase.append(Layer(y=rounded(with_gaps(angle)), **curve))
    size = Axis(label=f"magnitude{unit_label(view.outputs[i].unit, view.inputs[j].unit)}", log=True, range=span)
    tick = 90.0 if phase_span[1] - phase_span[0] <= 450 else 180.0 * np.ceil((phase_span[1] - phase_span[0]) / 1080)
    turn = Axis(label="phase [°]", range=phase_span, tick=float(tick))
    panels = (
        Panel(title=view.entry(i, j), x=axis, y=size, layers=tuple(magnitude)),
        Panel(title="", x=axis, y=turn, layers=tuple(phase)),
    )
    return Chart(name=f"entry-{i}-{j}", panels=panels, linked=True)


def log_axis(omega: np.ndarray) -> bool:
    """Whether the lines are spread rather like a geometric sequence than evenly."""
    lines = omega[omega > 0]
    if lines.size < 2:
        return bool(lines.size)
    middle, ends = np.median(lines), lines[[0, -1]]
    return bool(abs(np.log(middle / np.sqrt(ends.prod()))) <= abs(np.log(middle / ends.mean())))


def frequency_axis(omega: np.ndarray) -> Axis:
    """In Hz, over the lines."""
    log = log_axis(omega)
    low, high = float(omega[omega > 0].min(initial=omega.max())) / HZ, float(omega.max()) / HZ
    if not high:
        return Axis(label="frequency [Hz]")
    if log:
        at_zero = " (0 Hz has no place on it)" if omega.min() == 0 else ""
        return Axis(label=f"frequency [Hz]{at_zero}", log=True, range=(low / 1.05, high * 1.05))
    return Axis(label="frequency [Hz]", range=(float(omega.min()) / HZ - 0.02 * high, 1.02 * high))


def model_grid(view: FitView, log: bool) -> np.ndarray:
    """Frequencies of the curves: spread along the axis, and as many around each light pole as its resonance needs."""
    lines = view.omega
    low, high = float(lines[lines > 0].min(initial=lines.max())), float(lines.max())
    base = np.geomspace(low, high, _GRID) if log else np.linspace(lines.min(), high, _GRID)
    s = np.array([continuous(row.pole, view.dt or 0) for row in view.modes if row.count == 2 and not row.rigid])
    s = s[np.isfinite(s)] if s.size else np.zeros(0, dtype=complex)
    # Equal steps of phase across the resonance: w + sigma tan(theta).
    spread = np.tan(np.linspace(-1.4, 1.4, _AROUND))
    around = [pole.imag + abs(pole.real) * spread for pole in s]
    omega = np.unique(np.concatenate([base, *around]))
    return omega[(omega >= low if log else omega >= lines.min()) & (omega <= high)]


def position(omega: np.ndarray, log: bool) -> np.ndarray:
    """Where a frequency lies along the axis."""
    return np.log(np.maximum(omega, omega[omega > 0].min(initial=1.0))) if log else omega


def thinned(position: np.ndarray, sizes: list[np.ndarray], cells: int) -> np.ndarray:
    """Which points to draw: all where they are few, else of every cell the smallest and largest of the first array, and
    the largest of every other one; no peak, no notch and no outlier is lost.

    Examples
    --------
    >>> thinned(np.arange(12.0), [np.array([1, 3, 2, 9, 4, 5, 5, 6, 5, 5, 0, 5])], 2)
    array([ 0,  3,  7, 10])
    """
    if position.size <= (len(sizes) + 1) * cells:
        return np.arange(position.size)
    width = (position[-1] - position[0]) / cells or 1.0
    cell = np.minimum((position - position[0]) // width, cells - 1)
    chosen = []
    for k, size in enumerate(sizes):
        order = np.lexsort((size, cell))
        last = np.append(np.flatnonzero(np.diff(cell[order])), position.size - 1)
        chosen.append(order[last])
        if k == 0:
            chosen.append(order[np.append(0, last[:-1] + 1)])
    return np.unique(np.concatenate(chosen))


def rounded(values: np.ndarray) -> np.ndarray:
    """To six digits, more than a picture shows: the page becomes a third as large."""
    with np.errstate(divide="ignore", invalid="ignore"):
        places = _DIGITS - 1 - np.floor(np.log10(np.abs(values)))
    places = np.where(np.isfinite(places), places, 0)
    # Division by a power of ten rounds to the shortest decimal; multiplication by 1e-5 doesn't.
    large, small = 10.0 ** np.minimum(np.abs(places), 290), places >= 0
    return np.where(small, np.round(values * large) / large, np.round(values / large) * large)


def _magnitude_range(measured: np.ndarray, error: np.ndarray, model: np.ndarray) -> tuple[float, float]:
    """Holds the samples, the curve and nearly all residuals, but not the bottom of deep notches."""
    top = max(float(measured.max()), float(model.max()))
    if not top > 0:
        return 0.1, 1.0
    floors = [float(np.quantile(part, 0.02)) for part in (measured, error) if part.size]
    low = min(*floors, top / 10) if floors else top / 10
    return max(low / 2, 1e-12 * top), 1.5 * top


def convergence_chart(view: FitView) -> Chart:
    """Cost after every iteration, and how far the condition number of its normal matrix is from one."""
    fit = view.fit
    steps = fit.history
    number = np.arange(1.0, len(steps) + 1)
    axis = Axis(label="iteration [–]", range=(-0.5, len(steps) + 0.5), tick=float(max(1, np.ceil(len(steps) / 12))))
    cost, condition = (
        [Layer(name="start", x=np.zeros(1), y=_positive([fit.start_cost]), colour=DATA, marker="x", size=1.4)],
        [],
    )
    looks = zip((NOMINAL, *FURTHER, ALERT, FAINT), ("circle", *MARKERS, "circle-open", "square"), strict=False)
    for name, (colour, marker) in zip(dict.fromkeys(step.method for step in steps), looks, strict=False):
        mine = np.array([step.method == name for step in steps])
        style: dict[str, Any] = {"name": name, "colour": colour, "marker": marker}
        values = np.array([step.cost for step in steps])
        # Iterations of other methods in between are gaps of the line.
        cost.append(Layer(x=number, y=_positive(np.where(mine, values, np.nan)), dash="solid", **style))
        excess = np.maximum(fit.condition_numbers - 1, EPSILON)
        condition.append(Layer(x=number, y=np.where(mine, excess, np.nan), dash="solid", **style))
    if np.isfinite(fit.unstable_cost):
        name, level = "best fit, with unstable poles", _positive([fit.unstable_cost] * 2)
        cost.append(Layer(name=name, x=np.array(axis.range), y=level, colour=FAINT, dash="dash"))
    panels = [Panel(title="Cost", x=axis, y=Axis(label="cost [–]", log=True, range=_decades(cost)), layers=tuple(cost))]
    if condition:
        floor = Layer(name="machine epsilon", x=np.array(axis.range), y=np.full(2, EPSILON), colour=FAINT, dash="dot")
        top = max(1e-10, *(float(np.nanmax(layer.y)) for layer in condition))
        y = Axis(label="κ − 1 [–]", log=True, range=(EPSILON / 3, 3 * top))
        title = "Condition number κ of the normal matrix, less one"
        panels.append(Panel(title=title, x=axis, y=y, layers=(*condition, floor)))
    return Chart(name="convergence", panels=tuple(panels), linked=True)


def _positive(values: Any) -> np.ndarray:
    """What a logarithmic axis can show."""
    values = np.array(values, dtype=float)
    return np.where(values > 0, values, np.nan)


def _decades(layers: list[Layer]) -> tuple[float, float] | None:
    values = np.concatenate([layer.y for layer in layers])
    values = values[np.isfinite(values)]
    if not values.size:
        return None
    # At least a factor of two, so that the last digits of a flat cost don't fill the height.
    return min(values.min() / 1.2, values.max() / 2), values.max() * 1.2


def pole_chart(view: FitView) -> Chart:
    """Poles in their plane, and damping over frequency, with one standard deviation."""
    rows, dt = view.modes, view.dt
    plane = [_plane_layer(view, kind) for kind in (False, True) if any(row.rigid == kind for row in rows)]
    damped = [row for row in rows if row.count == 2 and not row.rigid and row.damping > 0]
    hz, damping, std = (np.array([getattr(row, part) for row in damped]) for part in ("hz", "damping", "damping_std"))
    bars: dict[str, Any] = {}
    if np.all(np.isfinite(std)):
        bars = {"low": np.maximum(damping - std, damping / 100), "high": damping + std}
    hover = tuple(_words(row) for row in damped)
    modes = Layer(name="modes", x=hz, y=damping, colour=NOMINAL, marker="x", hover=hover, size=1.3, **bars)
    if dt is None:
        across = max((abs(row.pole.real) / HZ for row in rows), default=1.0) or 1.0
        x = Axis(label="real part of s/2π [Hz]", range=(-1.1 * across, 0.15 * across))
        y, title = Axis(label="imaginary part of s/2π [Hz]"), "Poles in the s-plane (upper half)"
        height = 1.08 * max((row.pole.imag / HZ for row in rows), default=1.0) or 1.0
        y = Axis(label=y.label, range=(-0.04 * height, height))
        edge = Layer(name="stability boundary", x=np.zeros(2), y=np.array(y.range), colour=DATA, dash="solid")
    else:
        turn = np.linspace(0, 2 * np.pi, 361)
        x, y = (Axis(label=f"{part} part of z [–]", range=(-1.12, 1.12)) for part in ("real", "imaginary"))
        edge = Layer(name="stability boundary", x=np.cos(turn), y=np.sin(turn), colour=DATA, dash="solid")
        title = "Poles in the z-plane"
    log = log_axis(view.omega)
    ends = np.concatenate([hz, view.omega[view.omega > 0][[0, -1]] / HZ])
    reach = (ends.min() * 0.9, ends.max() * 1.1) if log else (0.0, ends.max() * 1.05)
    x_hz = Axis(label="natural frequency [Hz]", log=log, range=(float(reach[0]), float(reach[1])))
    y_damping = Axis(label="damping ratio [–]", log=True, range=(damping.min(initial=0.01) / 2, 2.0))
    panels = (
        Panel(title=title, x=x, y=y, layers=(edge, *plane), square=dt is not None),
        Panel(title="Damping of the oscillating modes", x=x_hz, y=y_damping, layers=(modes,)),
    )
    return Chart(name="poles", panels=panels, columns=2)


def _plane_layer(view: FitView, rigid: bool) -> Layer:
    rows = [row for row in view.modes if row.rigid == rigid]
    poles = np.array([complex(row.pole) for row in rows], dtype=complex)
    hover = tuple(_words(row) for row in rows)
    bars: dict[str, Any] = {}
    if view.dt is None:
        poles = poles / HZ
        # The imaginary part of a light mode is its frequency.
        std = np.array([row.hz_std if row.count == 2 else 0.0 for row in rows])
        if np.all(np.isfinite(std)):
            bars = {"low": np.imag(poles) - std, "high": np.imag(poles) + std}
    else:
        poles, hover = np.concatenate([poles, poles.conj()]), hover + hover
    name, colour, marker = ("rigid body", ALERT, "square-open") if rigid else ("poles", NOMINAL, "x")
    return Layer(
        name=name, x=np.real(poles), y=np.imag(poles), colour=colour, marker=marker, hover=hover, size=1.3, **bars
    )


def _words(row: Any) -> str:
    if row.rigid:
        return f"rigid body, {row.count} states"
    if row.count == 1:
        return f"real pole, {with_deviation(row.hz, row.hz_std)} Hz"
    return f"{with_deviation(row.hz, row.hz_std)} Hz, damping {with_deviation(row.damping, row.damping_std)}"

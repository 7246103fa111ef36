"""Charts of a matrix-fraction fit: the response of every entry, convergence, poles."""

from __future__ import annotations

from functools import partial

import numpy as np

from robustid.core import hz_scale
from robustid.data import FrequencyResponse
from robustid.fitting import MatrixFraction, ModeRow, continuous
from robustid.report.charts import (
    ALERT,
    DATA,
    FAINT,
    FURTHER,
    MARKERS,
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
    log_axis,
    low_quantile,
    magnitude_range,
    next_to,
    phase_curves,
    position,
    positive,
    resolved,
    rounded,
    spread,
    thinned,
    with_gaps,
)
from robustid.report.fit_view import FitView
from robustid.report.magnitude_phase import MagnitudePhase, Ranged, phase_axis
from robustid.report.words import HZ, number, unit_label

EPSILON = float(np.finfo(float).eps)
_GRID = 600  # points of a response, along the axis
_DEPTH = 1e-12  # of the largest magnitude: a fit can leave little
_AROUND = np.linspace(-1.4, 1.4, 21)  # phases across a light resonance


def response_charts(view: FitView) -> list[Chart]:
    """Magnitude and phase of every entry, row by row: samples, model, residual, and how sure the model is."""
    log = log_axis(view.omega)
    omega = model_grid(view, log)
    values = view.response(omega)
    deviation = None if view.covariance is None else view.covariance.response_std(omega)
    cells = cells_per_entry(view.ny * view.nu)
    charts: list[Chart] = []
    for i in range(view.ny):
        for j in range(view.nu):
            here = thinned(position(omega, log), [np.abs(values[:, i, j])], cells)
            spread = None if deviation is None else deviation[here, i, j]
            charts.append(_entry(view, i, j, omega[here], values[here, i, j], spread, cells))
    return charts


def _entry(
    view: FitView, i: int, j: int, omega: np.ndarray, values: np.ndarray, deviation: np.ndarray | None, cells: int
) -> Chart:
    axis = frequency_axis(view.omega)
    points, measured = view.omega, view.values[:, i, j]
    error, used = np.abs(measured - view.fitted[:, i, j]), view.used[:, i, j]
    kept = thinned(position(points, axis.log), [np.abs(measured), error], cells)
    top = max(float(np.abs(measured).max()), float(np.abs(values).max()))
    floors = [low_quantile(part) for part in (np.abs(measured), error[used]) if part.size]
    span = magnitude_range(top, [*floors, top / 10], _DEPTH)
    (angle,), phase_span = phase_curves([values])
    name = f"model, order {view.fit.fraction.A.shape[0]}"
    drawn, x, size = MagnitudePhase(), rounded(omega / HZ), rounded(np.abs(values))
    if deviation is not None:
        ends = np.maximum(np.abs(values) - deviation, span[0]), np.abs(values) + deviation
        drawn.add("model ± σ", x, Ranged(size, *map(rounded, ends)), colour=NOMINAL, dash="solid", fill=True)
        drawn.add("σ of the model", x, rounded(deviation), colour=FURTHER[0], dash="dash")
    if view.noise is not None:
        drawn.add(
            "σ of the data", rounded(points[kept] / HZ), rounded(view.noise[kept, i, j]), colour=FAINT, dash="dot"
        )
    unused = ~used & (measured != 0)  # a fit knows zeros where entries are missing
    groups = ((used, "data", DATA, "circle"), (unused, "data without weight", FAINT, "circle-open"))
    for mask, label, colour, marker in groups:
        part = kept[mask[kept]]
        if not part.size:
            continue
        near = angle[np.searchsorted(omega, points[part]).clip(0, omega.size - 1)]
        turned = next_to(np.degrees(np.angle(measured[part])), near)
        samples = rounded(np.abs(measured[part])), rounded(turned)
        drawn.add(label, rounded(points[part] / HZ), *samples, colour=colour, marker=marker, size=0.6)
    part = kept[used[kept]]
    at, left = rounded(points[part] / HZ), rounded(error[part])
    drawn.add("residual |data − model|", at, left, colour=ALERT, marker="circle", size=0.45)
    # Drawn over the samples, thin: where both agree both are seen.
    drawn.add(name, x, size, rounded(with_gaps(angle)), colour=NOMINAL, dash="solid", size=0.5)
    y = Axis(f"magnitude{unit_label(view.outputs[i].unit, view.inputs[j].unit)}", log=True, range=span)
    return drawn.chart(f"entry-{i}-{j}", axis, y, phase_axis(phase_span), view.entry(i, j))


def model_grid(view: FitView, log: bool) -> np.ndarray:
    """Frequencies of the curves: spread along the axis, and as many around each light pole as its resonance needs."""
    points = view.omega
    high = float(points.max())
    low = float(points[points > 0].min(initial=high) if log else points.min())
    s = np.array([continuous(row.pole, view.dt or 0) for row in view.modes if row.count == 2 and not row.rigid])
    s = s[np.isfinite(s)] if s.size else np.zeros(0, dtype=complex)
    return resolved(spread(low, high, _GRID, log), s, _AROUND, low, high)


def convergence_chart(view: FitView) -> Chart:
    """Cost after every iteration, and how far the condition number of its normal matrix is from one."""
    fit = view.fit
    steps = fit.history
    iteration = np.arange(1.0, len(steps) + 1)
    axis = Axis("iteration [–]", range=(-0.5, len(steps) + 0.5), tick=float(max(1, np.ceil(len(steps) / 12))))
    cost = [Layer("start", np.zeros(1), positive(np.array([fit.start_cost])), DATA, marker="x", size=1.4)]
    condition: list[Layer] = []
    looks = zip((NOMINAL, *FURTHER, ALERT, FAINT), ("circle", *MARKERS, "circle-open", "square"), strict=False)
    for name, (colour, marker) in zip(dict.fromkeys(step.words for step in steps), looks, strict=False):
        mine = np.array([step.words == name for step in steps])
        line = partial(Layer, name, iteration, colour=colour, dash="solid", marker=marker)
        values = np.array([step.cost for step in steps])
        # Iterations of other methods and criteria in between are gaps of the line.
        cost.append(line(positive(np.where(mine, values, np.nan))))
        excess = np.maximum(fit.condition_numbers - 1, EPSILON)
        condition.append(line(np.where(mine, excess, np.nan)))
    if steps and steps[-1].former:  # the start and the end have the same weight
        cost.append(Layer("end", np.array([len(steps)]), positive(np.array([fit.cost])), DATA, marker="x"))
    if np.isfinite(fit.unstable_cost):
        name, level = "best fit, with unstable poles", positive(np.full(2, fit.unstable_cost))
        cost.append(Layer(name, np.array(axis.range), level, FAINT, dash="dash"))
    panels = [Panel("Cost", axis, Axis("cost [–]", log=True, range=_decades(cost)), cost)]
    if condition:
        floor = Layer("machine epsilon", np.array(axis.range), np.full(2, EPSILON), FAINT, dash="dot")
        top = max(1e-10, *(float(np.nanmax(layer.y)) for layer in condition))
        y = Axis("κ − 1 [–]", log=True, range=(EPSILON / 3, 3 * top))
        title = "Condition number κ of the normal matrix, less one"
        panels.append(Panel(title, axis, y, (*condition, floor)))
    return Chart("convergence", panels, linked=True)


def _decades(layers: list[Layer]) -> tuple[float, float] | None:
    values = np.concatenate([layer.y for layer in layers])
    values = values[np.isfinite(values)]
    if not values.size:
        return None
    # At least a factor of two, so that the last digits of a flat cost don't fill the height.
    return min(values.min() / 1.2, values.max() / 2), values.max() * 1.2


def fit_pole_chart(view: FitView) -> Chart:
    """Poles in their plane, and damping over frequency, with one standard deviation."""
    rows, dt = view.modes, view.dt
    plane = [_plane_layer(view, kind) for kind in (False, True) if any(row.rigid == kind for row in rows)]
    damped = [row for row in rows if row.count == 2 and not row.rigid and row.damping > 0]
    hz, damping, std = (np.array([getattr(row, part) for row in damped]) for part in ("hz", "damping", "damping_std"))
    low, high = (np.maximum(damping - std, damping / 100), damping + std) if np.all(np.isfinite(std)) else (None, None)
    hover = tuple(_words(row) for row in damped)
    modes = Layer("modes", hz, damping, NOMINAL, marker="x", hover=hover, size=1.3, low=low, high=high)
    if dt is None:
        across = max((abs(row.pole.real) / HZ for row in rows), default=1.0) or 1.0
        x = Axis("real part of s/2π [Hz]", range=(-1.1 * across, 0.15 * across))
        y, title = Axis("imaginary part of s/2π [Hz]"), "Poles in the s-plane (upper half)"
        height = 1.08 * max((row.pole.imag / HZ for row in rows), default=1.0) or 1.0
        y = Axis(y.label, range=(-0.04 * height, height))
        edge = Layer("stability boundary", np.zeros(2), np.array(y.range), DATA, dash="solid")
    else:
        turn = np.linspace(0, 2 * np.pi, 361)
        x, y = (Axis(f"{part} part of z [–]", range=(-1.12, 1.12)) for part in ("real", "imaginary"))
        edge = Layer("stability boundary", np.cos(turn), np.sin(turn), DATA, dash="solid")
        title = "Poles in the z-plane"
    log = log_axis(view.omega)
    ends = np.concatenate([hz, view.omega[view.omega > 0][[0, -1]] / HZ])
    reach = (ends.min() * 0.9, ends.max() * 1.1) if log else (0.0, ends.max() * 1.05)
    x_hz = Axis("natural frequency [Hz]", log=log, range=(float(reach[0]), float(reach[1])))
    y_damping = Axis("damping ratio [–]", log=True, range=(damping.min(initial=0.01) / 2, 2.0))
    panels = (
        Panel(title, x, y, (edge, *plane), square=dt is not None),
        Panel("Damping of the oscillating modes", x_hz, y_damping, (modes,)),
    )
    return Chart("poles", panels, columns=2)


def _plane_layer(view: FitView, rigid: bool) -> Layer:
    rows = [row for row in view.modes if row.rigid == rigid]
    poles = np.array([complex(row.pole) for row in rows], dtype=complex)
    hover = tuple(_words(row) for row in rows)
    low = high = None
    if view.dt is None:
        poles = poles / HZ
        # The imaginary part of a light mode is its frequency.
        std = np.array([row.hz_std if row.count == 2 else 0.0 for row in rows])
        if np.all(np.isfinite(std)):
            low, high = np.imag(poles) - std, np.imag(poles) + std
    else:
        poles, hover = np.concatenate([poles, poles.conj()]), hover + hover
    name, colour, marker = ("rigid body", ALERT, "square-open") if rigid else ("poles", NOMINAL, "x")
    where = np.real(poles), np.imag(poles)
    return Layer(name, *where, colour, marker=marker, hover=hover, size=1.3, low=low, high=high)


def _words(row: ModeRow) -> str:
    if row.rigid:
        return f"rigid body, {row.count} states"
    size, unit = hz_scale(row.hz)
    if row.count == 1:
        return f"real pole, {with_deviation(row.hz / size, row.hz_std / size)} {unit}"
    return f"{with_deviation(row.hz / size, row.hz_std / size)} {unit}, damping {with_deviation(row.damping, row.damping_std)}"


def with_deviation(value: float, deviation: float) -> str:
    """Write the value with as many digits as its standard deviation leaves."""
    if np.isnan(deviation) or deviation <= 0:
        return number(value, 5)
    if np.isinf(deviation):
        return f"{number(value, 5)} (not determined)"
    decimals = 1 - int(np.floor(np.log10(deviation)))
    if not 0 <= decimals <= 9:
        return f"{number(value, 6)} ± {number(deviation, 2)}"
    return f"{value:.{decimals}f} ± {deviation:.{decimals}f}"


def fit_bode(fit: MatrixFraction, data: FrequencyResponse | None = None) -> Chart:
    """Every entry of a fit, outputs below each other."""
    view = FitView(fit, data)
    return side_by_side("fit", response_charts(view), view.nu)


def fit_poles(fit: MatrixFraction, data: FrequencyResponse | None = None) -> Chart:
    """Poles of a fit and their damping."""
    return fit_pole_chart(FitView(fit, data))


def fit_convergence(fit: MatrixFraction) -> Chart:
    """Cost and condition number after every iteration of a fit."""
    return convergence_chart(FitView(fit))

"""What is drawn as evidence: residuals against their bounds, Hankel singular values, poles."""

from __future__ import annotations

from typing import Any

import numpy as np

from robustid.identification import Identification, Residual, model_residuals
from robustid.report.charts import HZ, Axis, Chart, Layer, Models, Panel, band, curves, hertz
from robustid.report.facts import transfer, unit, where
from robustid.report.poles import PoleRow, pole_table
from robustid.report.style import ALERT, DATA, FAINT, NOMINAL, number

_TOUCHES = 0.99  # of the limit: the sample is marked
_BESIDE = 1.1  # of the axis beside the first and the last line
_SMALLEST_RATIO = 1e-3


def residual_chart(identification: Identification, models: Models = None) -> Chart:
    """|residual|/bound of every sample, the limit, and who touches it: a panel for each entry or output that has bounds."""
    problem, shown = identification.problem, curves(identification, models)
    found = [list(identification.residuals), *(model_residuals(problem, model) for _, model, *_ in shown[1:])]
    panels = []
    for kind in ("frequency", "time"):
        places = [k for k, r in enumerate(found[0]) if r.kind == kind]
        if not places:
            continue
        parts = [[residuals[k] for k in places] for residuals in found]
        # One scale for all: they are compared.
        largest = max(identification.margin, *(float(r.ratio.max()) for residuals in parts for r in residuals))
        smallest = min(float(r.ratio.min()) for residuals in parts for r in residuals)
        for entries, label in _grouped(identification, parts[0]):
            part = [[residuals[k] for k in entries] for residuals in parts]
            panels.append(_residual_panel(identification, kind, label, part, shown, (smallest, largest)))
    return Chart(name="residuals", panels=tuple(panels), grid=not problem.entries.single)


def _grouped(identification: Identification, residuals: list[Residual]) -> list[tuple[list[int], str]]:
    """Which of them belong in one panel, those of one entry in several experiments for instance, and its name."""
    if identification.problem.entries.single:
        label = transfer(identification) if residuals[0].kind == "frequency" else where(identification, residuals[0])
        return [(list(range(len(residuals))), f"{label}: {residuals[0].kind} samples")]
    names: dict[str, list[int]] = {}
    # Row by row; what belongs to no row, or to none at all, at the end.
    places = [[np.inf if number is None else number for number in residual.entry] for residual in residuals]
    for k in sorted(range(len(residuals)), key=places.__getitem__):
        names.setdefault(where(identification, residuals[k]), []).append(k)
    return [(places, name) for name, places in names.items()]


def _residual_panel(
    identification: Identification,
    kind: str,
    label: str,
    parts: list[list[Residual]],
    shown: list[Any],
    span: tuple[float, float],
) -> Panel:
    problem, margin, (smallest, largest) = identification.problem, identification.margin, span
    low, high = band(problem)
    last = max(float(r.axis.max()) for r in parts[0])
    if kind == "frequency" and last > 0:
        first = min(float(r.axis.min(where=r.axis > 0, initial=last)) for r in parts[0])
        low, high = max(low, first / _BESIDE), min(high, last * _BESIDE)
    x = hertz(problem, low, high) if kind == "frequency" else Axis(label="time [s]", range=(-0.02 * last, 1.02 * last))
    log = largest > 3
    floor = (
        float(np.clip(10 ** np.floor(np.log10(max(smallest, _SMALLEST_RATIO))), _SMALLEST_RATIO, 0.1)) if log else 0.0
    )
    layers = []
    for (name, _, colour, _, marker), residuals in zip(shown, parts, strict=True):
        at = np.concatenate([np.maximum(r.axis, low) / HZ if kind == "frequency" else r.axis for r in residuals])
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
    reach = (floor, 2 * largest) if log else (0.0, 1.12 * max(largest, 1.0))
    y = Axis(label="|residual| / bound", log=log, range=reach)
    return Panel(title=label, x=x, y=y, layers=tuple(layers))


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
    if reduction is None or reduction.tried:  # a search truncates nothing
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
    single, what = identification.problem.entries.single, unit(identification)
    name = f"\n{transfer(identification)}" if single else f" [{what}]" if what else ""
    y_axis = Axis(label=f"Hankel singular value{name}", log=True, range=span)
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
    low, high = band(problem)
    every = np.concatenate([layer.x for layer in damping] + [np.array([low, high]) / HZ])
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
    if row.modulus == 0:
        return "delay of one sample, |z| = 0"
    text = f"|z| = {number(row.modulus, 5)}"
    if row.hz == 0:
        return f"integrator, {text}"
    return f"{number(row.hz)} Hz, damping {number(row.damping, 3)}, {text}"

"""A sweep over the order of a fit: singular values, costs, criteria and the stabilisation diagram."""

from __future__ import annotations

import numpy as np

from robustid.core import as_kind, hz_words
from robustid.fitting import OrderSweep, StabilisationMark
from robustid.report.charts import (
    ALERT,
    DATA,
    FAINT,
    FURTHER,
    NOMINAL,
    Axis,
    Chart,
    Layer,
    Panel,
    frequency_axis,
    whole_axis,
)
from robustid.report.curves import rounded, span_of, thinned
from robustid.report.document import Block, Drawing, Heading, Text
from robustid.report.words import HZ

_KINDS = (
    ("stable", "frequency and damping", NOMINAL, "circle"),
    ("frequency", "frequency only", FURTHER[0], "diamond-open"),
    ("damping", "damping only", FURTHER[1], "triangle-up-open"),
    ("new", "new", FAINT, "x"),
)
_CELLS = 400


def order_sweep_section(sweep: OrderSweep) -> list[Block]:
    """Build the section of the order that the data carry."""
    as_kind("order_sweep", sweep, OrderSweep, "an OrderSweep from suggest_order")
    words = "Every oscillating pole of every order, compared with those of the next lower order: frequency within 1 %, damping"
    return [
        Heading("Order"),
        Text(order_words(sweep)),
        Drawing(order_chart(sweep), titled=True),
        Heading("Stabilisation diagram", 3),
        Text(f"{words} within 5 %.", "soft"),
        Drawing(stabilisation_chart(sweep)),
    ]


def order_words(sweep: OrderSweep) -> str:
    """Name the order that the data carry, and the rule."""
    noise = "known from the covariance of the data" if sweep.noise_known else "of unknown level"
    words = (
        f"Of the {sweep.orders.size} orders tried, {sweep.orders[0]} to {sweep.orders[-1]}, order {sweep.suggested}"
        f" {sweep.restraint or 'has the smallest description length (MDL)'}, with noise {noise}; {sweep.subspace_order} singular"
        " values lie above the noise."
    )
    if sweep.failures:
        words += f" Not fitted: {', '.join(f'order {order}' for order in sweep.failures)}."
    if sweep.hint:
        words += f" {sweep.hint[0].upper()}{sweep.hint[1:]}."
    if sweep.orders.size > 1 and sweep.suggested == sweep.orders[-1]:
        words += " It is the largest order tried: try larger ones."
    if sweep.interrupted:
        words += " Ctrl-C ended the sweep: the other orders were not tried."
    return words


def order_chart(sweep: OrderSweep) -> Chart:
    """Singular values against the noise, cost and information criteria against the order."""
    return Chart("orders", (_singular_values(sweep), _costs(sweep), _criteria(sweep)))


def _singular_values(sweep: OrderSweep) -> Panel:
    values, edge = sweep.singular_values, sweep.noise_edge
    # Far beyond the order asked there is nothing but noise.
    values = values[: max(2 * sweep.subspace_order + 10, int(sweep.orders.max()) + 5)]
    index = np.arange(1.0, values.size + 1)
    above = values > edge
    layers = [
        Layer(name, index[mask], values[mask], colour, marker=marker)
        for mask, name, colour, marker in (
            (above, "above the noise", NOMINAL, "circle"),
            (~above, "noise", FAINT, "circle-open"),
        )
        if np.any(mask)
    ]
    ends = np.array([0.0, values.size + 1.0])
    layers.append(Layer("largest of noise alone", ends, np.full(2, edge), ALERT, dash="dash"))
    return Panel(
        "Singular values of the subspace estimate",
        Axis("number [–]", range=(0.0, values.size + 1.0)),
        Axis("singular value [–]", log=True, range=_span(np.append(values, edge))),
        layers,
    )


def _costs(sweep: OrderSweep) -> Panel:
    orders = sweep.orders.astype(float)
    curve = Layer("cost", orders, sweep.costs, NOMINAL, dash="solid", marker="circle")
    unstable = np.array([not fit.stable for fit in sweep.fits.values()])
    layers = [curve]
    if np.any(unstable):
        x, y = orders[unstable], sweep.costs[unstable]
        layers.append(Layer("unstable poles", x, y, ALERT, marker="diamond-open", size=2.0))
    span = _span(sweep.costs)
    layers.append(_suggested(sweep, span))
    return Panel("Cost", _axis(sweep, 0.7), Axis("cost [–]", log=True, range=span), layers)


def _criteria(sweep: OrderSweep) -> Panel:
    orders = sweep.orders.astype(float)
    layers = [
        # One more, so that the smallest has a place on the axis.
        Layer(name, orders, values - values.min() + 1, colour, dash=dash, marker=marker)
        for name, values, colour, dash, marker in (
            ("MDL", sweep.mdl, NOMINAL, "solid", "circle"),
            ("AIC", sweep.aic, FURTHER[0], "dash", "square-open"),
        )
    ]
    span = _span(np.concatenate([layer.y for layer in layers]))
    layers.append(_suggested(sweep, span))
    y = Axis("criterion − smallest + 1 [–]", log=True, range=span)
    return Panel("Information criteria", _axis(sweep, 0.7), y, layers)


def _axis(sweep: OrderSweep, beyond: float) -> Axis:
    return whole_axis(float(sweep.orders.min()), float(sweep.orders.max()), beyond)


def _suggested(sweep: OrderSweep, span: tuple[float, float]) -> Layer:
    name = f"suggested order {sweep.suggested}"
    return Layer(name, np.full(2, float(sweep.suggested)), np.array(span), DATA, dash="dot")


def _span(values: np.ndarray) -> tuple[float, float]:
    return span_of(values, 2) or (0.1, 1.0)


def stabilisation_chart(sweep: OrderSweep) -> Chart:
    """Every pole of every order over the sum of all magnitudes: physical modes stand in columns."""
    problem = next(iter(sweep.fits.values())).problem
    axis, order = frequency_axis(problem.omega), _axis(sweep, 0.8)
    low, high = order.range or (0.0, 1.0)
    total = np.sum(np.abs(problem.values), axis=(1, 2))
    position = np.log(np.maximum(problem.omega, 1e-300)) if axis.log else problem.omega
    kept = thinned(position, [total], _CELLS)
    kept = kept[(problem.omega[kept] > 0) & (total[kept] > 0)]
    level = np.log(total[kept])
    level = low + (high - low) * (level - level.min()) / (np.ptp(level) or 1.0)
    x = rounded(problem.omega[kept] / HZ)
    layers = [Layer("Σ |data|, logarithmic", x, rounded(level), "#c4cad1", dash="solid")]
    rows = [row for row in sweep.stabilisation if problem.omega.min() <= row.frequency <= problem.omega.max()]
    for kind, words, colour, marker in _KINDS:
        layers += _marks([row for row in rows if row.kind == kind and row.damping > 0], words, colour, marker)
    layers += _marks([row for row in rows if row.damping <= 0], "unstable", ALERT, "square-open")
    return Chart("stabilisation", (Panel("Stabilisation", axis, order, layers),))


def _marks(rows: list[StabilisationMark], name: str, colour: str, marker: str) -> list[Layer]:
    if not rows:
        return []
    x, y = np.array([row.frequency / HZ for row in rows]), np.array([float(row.order) for row in rows])
    hover = tuple(f"order {row.order}: {hz_words(row.frequency / HZ, 6)}, damping {row.damping:.3g}" for row in rows)
    return [Layer(name, x, y, colour, marker=marker, hover=hover)]

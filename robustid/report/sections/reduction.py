"""The order of an identification and of its reduced model: Hankel singular values, and what a search for the smallest one found."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from robustid.identification import Identification, largest_ratio
from robustid.report.charts import Axis, Chart, Layer, Panel, order_axis
from robustid.report.document import Block, Drawing, Heading, Text
from robustid.report.identified import in_unit, siso, transfer, unit
from robustid.report.style import ALERT, FAINT, NOMINAL
from robustid.report.words import number

if TYPE_CHECKING:
    from robustid.reduction import Reduction

_HANKEL_FLOOR = 1e-8  # of the largest Hankel singular value
_FLOOR = 1e-3  # what lies below, an interpolation of the samples, is drawn here


def order_section(identification: Identification, reduction: Reduction | None) -> list[Block]:
    """Build the section of the order of the model and of the reduced one."""
    blocks: list[Block] = [Heading("Order")]
    if reduction is not None:
        blocks.append(Text(reduction_words(identification, reduction)))
        if reduction.tried:
            blocks.append(Drawing(margin_chart(reduction)))
    return [*blocks, Drawing(hankel_chart(identification, reduction))]


def reduction_words(identification: Identification, reduction: Reduction) -> str:
    """Say how small and how close the reduced model is, and whether the samples are still kept."""
    ratio = largest_ratio(identification.problem, reduction.model)
    kept = "every sample stays within its bound" if ratio <= 1 else "not every sample stays within its bound"
    size = in_unit(number(reduction.bound, 3), identification)
    norm = "" if siso(identification) else " (largest singular value)"
    near = f" The frequency responses differ by at most {size}{norm}." if np.isfinite(reduction.bound) else ""
    early = f"; {reduction.stopped}" if reduction.stopped else ""
    return (
        f"Order {reduction.order} instead of {identification.order}.{near} Samples:"
        f" {kept} (largest |residual|/bound {number(ratio)}). Status: {reduction.status.value}{early}."
    )


def margin_chart(reduction: Reduction) -> Chart:
    """Largest error over what is allowed, with the limit itself, against the order; and the order that was chosen."""
    orders, margins = np.array(reduction.tried, dtype=float).T
    shown = np.maximum(margins, _FLOOR)
    within, chosen = margins <= 1, orders == reduction.order
    words = tuple(f"order {k:.0f}: {m:.4g}" for k, m in reduction.tried)
    layers = [Layer(name="smallest found", x=orders, y=shown, colour=FAINT, dash="solid")]
    groups = (
        (within & ~chosen, "within", NOMINAL, "circle-open"),
        (~within & ~chosen, "beyond the bounds", FAINT, "circle-open"),
        (chosen, f"chosen order {reduction.order}", NOMINAL, "circle"),
    )
    for mask, name, colour, marker in groups:
        if np.any(mask):
            hover = tuple(np.array(words)[mask])
            layers.append(Layer(name=name, x=orders[mask], y=shown[mask], colour=colour, marker=marker, hover=hover))
    x = order_axis(float(orders.min()), float(orders.max()), 0.5)
    layers.append(Layer(name="bound", x=np.array(x.range), y=np.ones(2), colour=ALERT, dash="dash"))
    span = min(0.5, float(shown.min()) / 2), max(2.0, 2 * float(shown.max()))
    panel = Panel(
        title="Best model of every order: at the samples, and where nothing was measured",
        x=x,
        y=Axis(label="largest |error| / allowed [–]", log=True, range=span),
        layers=tuple(layers),
    )
    return Chart(name="margins", panels=(panel,))


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
    floor = _HANKEL_FLOOR * top
    values = values[: max(np.count_nonzero(values >= floor), shown.order - held, 1)]  # the others are rounding
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
    x, what = Axis(label="number [–]", range=(0.0, index.size + 1.0)), unit(identification)
    name = f"\n{transfer(identification)}" if siso(identification) else f" [{what}]" if what else ""
    y_axis = Axis(label=f"Hankel singular value{name}", log=True, range=span)
    return Chart(name="hankel", panels=(Panel(title=title, x=x, y=y_axis, layers=tuple(layers)),))

"""How the largest residual falls with the order: what a search for the smallest model found."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from robustid.errors import InputError, InputTypeError
from robustid.report.charts import Axis, Chart, Layer, Panel
from robustid.report.plots import draw
from robustid.report.style import ALERT, FAINT, NOMINAL

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from robustid.reduction import Reduction

_FLOOR = 1e-3  # what lies below, an interpolation of the samples, is drawn here


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
    ends = np.array([orders.min() - 0.5, orders.max() + 0.5])
    layers.append(Layer(name="bound", x=ends, y=np.ones(2), colour=ALERT, dash="dash"))
    span = min(0.5, float(shown.min()) / 2), max(2.0, 2 * float(shown.max()))
    panel = Panel(
        title="Best model of every order: at the samples, and where nothing was measured",
        x=Axis(
            label="order [–]", range=(float(ends[0]), float(ends[1])), tick=float(max(1, np.ceil(np.ptp(orders) / 14)))
        ),
        y=Axis(label="largest |error| / allowed [–]", log=True, range=span),
        layers=tuple(layers),
    )
    return Chart(name="margins", panels=(panel,))


def plot_margins(reduction: Reduction) -> Figure:
    r"""Largest \|residual\|/bound, or error where nothing was measured, over the orders that `reduce_within_bounds` tried.

    Parameters
    ----------
    reduction : Reduction
        From `reduce_within_bounds`.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    InputError, InputTypeError
        If `reduction` isn't a Reduction, or comes from a truncation, which tried no orders.

    Examples
    --------
    >>> import numpy as np, robustid as rid
    >>> record = rid.TimeRecord(np.ones(4), [0.5, 0.75, 0.875, 0.94], dt=0.01, bound=0.01)
    >>> prior = rid.Prior(gain_bound=2.0, decay_rate=1.2)
    >>> small = rid.reduce_within_bounds(rid.identify(rid.MixedProblem(time=record, prior=prior)))
    >>> plot_margins(small).axes[0].get_xlabel()
    'order [–]'
    """
    from robustid.reduction import Reduction

    if not isinstance(reduction, Reduction):
        raise InputTypeError(f"`reduction` must be from reduce_within_bounds; got {type(reduction).__name__}")
    if not reduction.tried:
        raise InputError(
            "`reduction` must be from reduce_within_bounds: a truncation tries no orders against the samples"
        )
    return draw(margin_chart(reduction))

"""The small model beside the best least-squares fits of the same data: the verdict, and the picture of misfit against order."""

from __future__ import annotations

import numpy as np

from robustid.reduction import ModelWorth
from robustid.report.charts import Axis, Chart, Layer, Panel, order_axis
from robustid.report.curves import span_of
from robustid.report.document import Block, Drawing, Heading, Text, Verdict
from robustid.report.style import ALERT, DATA, FAINT, NOMINAL
from robustid.report.words import number


def worth_verdict(found: ModelWorth) -> Verdict:
    """Verdict on the small model: about as good as the best fit of the order that the data carry, or worse."""
    key, word = "consistent", "The small model fits about as well as the best fit"
    if found.worse:
        key, word = "weak", "The small model fits worse than the best fit"
    numbers = (("misfit", number(found.misfit, 3)), ("best fit", number(found.best, 3)))
    return Verdict(key, word, found.summary(), numbers, id="worth")


def worth_section(found: ModelWorth | None) -> list[Block]:
    """Build the section of the comparison; nothing where there was none."""
    if found is None:
        return []
    words = (
        "Misfit: root mean square of the residuals at the used frequency points in units of their bounds, as measured, without any"
        " factor (of their covariance, where there is one)."
        if found.of_response
        else "Misfit: root mean square of the error of simulations over that of the outputs, from the initial state that fits best."
    )
    return [
        Heading("What the small model is worth"),
        Text(found.summary()),
        Text(words, "soft"),
        Drawing(worth_chart(found)),
    ]


def worth_chart(found: ModelWorth) -> Chart:
    """Misfit of the best fits against their order with the small models, and the error of the fits at withheld points."""
    points = [(float(found.reduction.order), found.misfit, f"small model, order {found.reduction.order}", NOMINAL)]
    if found.reduction.order != found.smallest:
        name = f"smallest inside the bounds, order {found.smallest}"
        points.append((float(found.smallest), found.smallest_misfit, name, ALERT))
    layers = [
        Layer(name="best fits", x=found.orders, y=found.misfits, colour=FAINT, dash="solid", marker="circle-open")
    ]
    layers += [
        Layer(name=name, x=np.array([order]), y=np.array([misfit]), colour=colour, marker="diamond", size=1.5)
        for order, misfit, name, colour in points
    ]
    span = span_of(np.concatenate([layer.y for layer in layers]), 2) or (0.1, 1.0)
    name = f"order {found.carried}, which the data carry"
    layers.append(Layer(name=name, x=np.full(2, float(found.carried)), y=np.array(span), colour=DATA, dash="dot"))
    orders = np.append(found.orders, [point[0] for point in points])
    x = order_axis(float(orders.min()), float(orders.max()), 0.7)
    panels = [Panel(title="Misfit", x=x, y=Axis(label="misfit [–]", log=True, range=span), layers=tuple(layers))]
    judged = np.isfinite(found.withheld)
    if np.any(judged):
        error = 100 * found.withheld[judged]
        curve = Layer(
            name="best fits", x=found.orders[judged], y=error, colour=FAINT, dash="solid", marker="circle-open"
        )
        y = Axis(label="error [% of the response]", log=True, range=span_of(error, 2) or (1.0, 100.0))
        panels.append(Panel(title="Best fits at points that were kept out of them", x=x, y=y, layers=(curve,)))
    return Chart(name="worth", panels=tuple(panels))

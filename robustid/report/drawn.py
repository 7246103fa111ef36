"""A figure of a result: the chart that belongs to its kind, drawn with matplotlib."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

from robustid.report.charts import Chart
from robustid.report.pages import kind_of, refuse_foreign
from robustid.report.with_matplotlib import draw

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    Where = Axes | Sequence[Axes] | None


def drawn(
    kinds: Mapping[type, tuple[Callable[..., Chart], tuple[str, ...]]],
    result: object,
    options: dict[str, object],
    ax: Where,
) -> Figure:
    """Draw the chart that belongs to the kind of the result; refuse other kinds, and options that don't belong to this one."""
    chart, belonging = kinds[kind_of("result", result, kinds)]
    given = {name: value for name, value in options.items() if value is not None}
    refuse_foreign(result, given, belonging)
    return draw(chart(result, **given), ax)

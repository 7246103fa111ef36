"""`result.plot()` and heads for notebooks: results know that they can be shown; the room `report`, after theirs, knows how."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class Drawable:
    """A result that `robustid.plot` has a figure for."""

    def plot(self, **options: Any) -> Figure:
        """Draw the figure of `robustid.plot` that shows this result best.

        Parameters
        ----------
        **options
            Those of `robustid.plot.of`, such as `ax`.

        Returns
        -------
        matplotlib.figure.Figure
        """
        import robustid  # through the front door: no room knows one that stands after it

        return robustid.plot.of(self, **options)


def head(result: Any) -> str | None:
    """Head of the page about a result, for notebooks; None where it has none."""
    return importlib.import_module("robustid.report.pages").notebook_head(
        result
    )  # no room imports one that stands after it

"""Results that lead on: `result.plot()`, heads for notebooks, attributes that are not there; later rooms know how."""

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


class Modes:
    """A fit whose modes can be told."""

    @property
    def modes(self) -> Any:
        """Rows of `robustid.fits.mode_table`: frequency, damping and participation of every mode."""
        import robustid

        return robustid.fits.mode_table(self)  # type: ignore[arg-type] # a fit


def led_on(thing: object, name: str) -> str:
    """Sentence on an attribute that an object has not, with what is meant."""
    front = importlib.import_module("robustid")  # through the front door, where all names are known
    return importlib.import_module("robustid.spellings").attribute_words(thing, name, front._known())


def head(result: object) -> str | None:
    """Head of the page about a result, for notebooks; None where it has none."""
    return importlib.import_module("robustid.report.notebook").notebook_head(
        result
    )  # no room imports one that stands after it

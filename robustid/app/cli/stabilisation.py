"""The stabilisation diagram in the terminal: one line an order, printed as soon as the order is fitted."""

from __future__ import annotations

import math
from typing import Any

_WIDTH = 56  # characters of the frequency axis
_MARKS = {"stable": "o", "frequency": "+", "damping": ".", "new": "."}
_STRONGER = ".+o"  # of two marks in one place the later one stays


class Stabilisation:
    """Lines of a stabilisation diagram over a logarithmic frequency axis, each given once.

    Parameters
    ----------
    omega : (F,) array
        Frequency points of the data, rad/s; those at 0 have no place.
    """

    def __init__(self, omega: Any) -> None:
        known = omega[omega > 0]
        self.low, self.high = float(known.min()), float(known.max())
        self.told: set[int] = set()

    def lines(self, sweep: Any) -> list[str]:
        """Lines of the orders that are new, below the axis at first, and what the sweep suggests so far."""
        new = [order for order in sweep.fits if order not in self.told]
        out = [] if self.told else self._axis()
        self.told.update(new)
        withheld = dict(zip(sweep.orders.tolist(), sweep.withheld.tolist(), strict=True))
        for order in new:
            error = f"  withheld {100 * withheld[order]:.3g} %" if math.isfinite(withheld[order]) else ""
            out.append(f"{order:5d} |{self._marks(sweep, order)}|{error}")
        return [*out, f"so far order {sweep.suggested} {sweep.reason}"]

    def _axis(self) -> list[str]:
        ends = [f"{omega / (2 * math.pi):.4g} Hz" for omega in (self.low, self.high)]
        return [
            "poles by order: o as in the order before, + only the frequency, . new",
            f"order  {ends[0]}{ends[1]:>{_WIDTH - len(ends[0])}}",
        ]

    def _marks(self, sweep: Any, order: int) -> str:
        """The poles of an order, each at its natural frequency; those beside the band at its ends."""
        marks = [" "] * _WIDTH
        span = math.log(self.high / self.low) or 1.0
        for row in sweep.stabilisation:
            if row.order == order and row.frequency > 0:
                part = min(max(math.log(row.frequency / self.low) / span, 0.0), 1.0)
                place = round(part * (_WIDTH - 1))
                mark = _MARKS[row.kind]
                if marks[place] == " " or _STRONGER.index(mark) > _STRONGER.index(marks[place]):
                    marks[place] = mark
        return "".join(marks)

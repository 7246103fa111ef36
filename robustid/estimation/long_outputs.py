"""Events of very long outputs: every piece is looked at with one predictor, and examined as a record where that finds some."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from robustid.core import Real
from robustid.estimation.events import Event, Examined, largest_events, without_period
from robustid.estimation.innovations import Predictor, Predictors
from robustid.estimation.stretch import pieces

_EXAMINED = 4  # pieces, those that show most


class OutputPieces:
    """Pieces of a very long record with inputs u (T, nu): themselves, and with what is beside them; the liveliest of these."""

    def __init__(self, u: Real, period: int | None, length: int) -> None:
        self.u, self.period = u, period
        self.parts = pieces(len(u), period, length)
        power = [float(np.sum(u[wide] ** 2)) for _, wide in self.parts]
        self.lead = self.parts[int(np.argmax(power))][1]
        self.predictors = Predictors(u[self.lead])

    def examined(self, y: Real, examine: Callable[[slice], Examined]) -> Examined:
        """Events of an output (T,) by those of its pieces, the output without them, and the predictor of the liveliest piece.

        Of more pieces with events than are examined, the others show what one look finds: the largest, and those close to it.
        """
        if self.predictors.order == 0 or np.ptp(y) == 0:
            return Examined((), y, None)
        predictor = self.predictors.of(_rest(y[self.lead], self.period))
        predictor = predictor._replace(trend=0 * predictor.trend)
        shown = [_shown(y[wide], self.u[wide], predictor, self.period) for _, wide in self.parts]
        order = sorted((k for k, one in enumerate(shown) if one), key=lambda k: -max(e.deviations for e in shown[k]))
        found: list[Event] = []
        for number, k in enumerate(order):
            own, wide = self.parts[k]
            if number < _EXAMINED:
                events: tuple[Event, ...] = examine(wide).events
            elif number == _EXAMINED and not found:
                break
            else:
                events = tuple(shown[k])
            placed = [one._replace(at=one.at + wide.start) for one in events]
            found += [one for one in placed if own.start <= one.at < own.stop]
        clean = y.copy() if found else y
        for one in found:
            clean[one.at : None if one.jump else one.at + 1] -= one.height
        return Examined(tuple(sorted(found, key=lambda one: -one.deviations)), clean, predictor)


def _rest(y: Real, period: int | None) -> Real:
    return y if period is None else without_period(y, period)


def _shown(y: Real, u: Real, predictor: Predictor, period: int | None) -> list[Event]:
    """Events that one look at a piece finds."""
    w = predictor.innovations(_rest(y, period), u)
    return largest_events(w - w.mean(), predictor, period) if np.ptp(w) > 0 else []

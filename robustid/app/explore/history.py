"""Undo and redo of what the fields of a page state."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Sequence
from typing import Any

_MOST = 50  # statements that can be taken back
_PAUSE = 1.0  # seconds without a change: what is changed then is another change

Fields = tuple[object, ...]  # their values, in the order of the page


class History:
    """Fields as they stood; the same fields that are changed again without a pause, as a slider does, are one change.

    Examples
    --------
    >>> history = History([9.0, "17.4"])
    >>> history.note([9.1, "17.4"])
    >>> history.undo(), history.redo()
    ((9.0, '17.4'), (9.1, '17.4'))
    """

    def __init__(self, start: Sequence[object], clock: Callable[[], float] = time.monotonic) -> None:
        self._present: Fields = tuple(start)
        self._before: list[Fields] = []
        self._after: list[Fields] = []
        self._clock, self._changed, self._one = clock, -math.inf, threading.Lock()
        self._places: list[int] = []  # of the fields that were changed

    @property
    def present(self) -> Fields:
        """The fields as they stand now."""
        return self._present

    def note(self, fields: Sequence[object]) -> None:
        """Note what the fields state now; nothing where that was known."""
        with self._one:
            now, fields = self._clock(), tuple(fields)
            if fields == self._present:
                return
            pairs = zip(fields, self._present, strict=True)
            places = [k for k, (new, old) in enumerate(pairs) if new != old]
            if now - self._changed > _PAUSE or places != self._places:
                self._before = [*self._before, self._present][-_MOST:]
            self._present, self._after, self._changed, self._places = fields, [], now, places

    def undo(self) -> Fields:
        """The fields before the last change; the present ones where there was none."""
        return self._step(self._before, self._after)

    def redo(self) -> Fields:
        """The fields before the last undo; the present ones where there was none, or where they were changed since."""
        return self._step(self._after, self._before)

    def _step(self, source: list[Fields], target: list[Fields]) -> Fields:
        with self._one:
            if source:
                target.append(self._present)
                self._present, self._changed = source.pop(), -math.inf
            return self._present


def connect_history(app: Any, history: History, fields: Sequence[tuple[str, str]]) -> None:
    """Make the buttons `undo` and `redo` of a Dash application write the fields, each an id and a property."""
    from dash import Input, Output, ctx

    @app.callback(
        *[Output(*field, allow_duplicate=True) for field in fields],
        Input("undo", "n_clicks"),
        Input("redo", "n_clicks"),
        prevent_initial_call=True,
    )
    def returned(*_: object) -> list[object]:
        undone = str(ctx.triggered_id) == "undo"  # type: ignore[reportUnknownMemberType]
        return list(history.undo() if undone else history.redo())

"""Budgets of time: when a computation must end, and whom it tells how far it is."""

from __future__ import annotations

import math
import time
from collections.abc import Callable

from robustid.core.validation import as_function, as_positive

Progress = Callable[[int, int], None]


class Budget:
    """Seconds of wall clock that a computation may take from now on, and its receiver of (done, all).

    Parameters
    ----------
    time_limit : float or None
        None: no limit.
    progress : callable (done, all), optional
    """

    def __init__(self, time_limit: float | None = None, progress: Progress | None = None) -> None:
        limit = math.inf if time_limit is None else as_positive("time_limit", time_limit)
        self._deadline, self._progress = time.monotonic() + limit, as_function("progress", progress)

    @property
    def left(self) -> float:
        """Seconds that are left; inf without a limit."""
        return self._deadline - time.monotonic()

    @property
    def seconds(self) -> float | None:
        """Seconds that are left, as the `time_limit` of another call, positive; None without a limit."""
        return None if math.isinf(self.left) else max(self.left, 1e-9)

    @property
    def over(self) -> bool:
        """True if the time is up."""
        return self.left <= 0

    def share(self, part: float) -> Budget:
        """The budget of a first stage: a part of what is left, and the same receiver."""
        limit = None if math.isinf(self.left) else max(part * self.left, 1e-9)
        return Budget(limit, self._progress)

    def tell(self, done: int, count: int) -> None:
        """Tell how far it is."""
        if self._progress is not None:
            self._progress(done, count)

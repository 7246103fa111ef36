"""Smallest gain bounds that are kept on disk, so that a search that was ended goes on from there."""

from __future__ import annotations

import json
import logging
from pathlib import Path

from robustid.advice.smallest_gain import response_sizes, smallest_gain
from robustid.core import Budget, atomic_write, fingerprint
from robustid.identification import MixedProblem

_log = logging.getLogger("robustid")


class KeptGains:
    """Smallest gain bounds by data and decay rate, in a file; without one nothing is kept."""

    def __init__(self, path: Path | None = None) -> None:
        self._path, self._found = path, {} if path is None or not path.is_file() else _read(path)

    def gain(
        self, data: MixedProblem, rate: float, whole: MixedProblem, ceilings: tuple[float, ...], budget: Budget
    ) -> float:
        """The `smallest_gain` of data: as it was found before, or found now, and kept if its search came to its end."""
        if self._path is None:
            return smallest_gain(data, rate, whole, ceilings, budget)
        key = fingerprint((data, rate, *ceilings, *response_sizes(whole)))
        if key not in self._found:
            found = smallest_gain(data, rate, whole, ceilings, budget)
            if budget.over:
                return found
            self._found[key] = found
            self._path.parent.mkdir(parents=True, exist_ok=True)
            with atomic_write(self._path) as file:
                json.dump(self._found, file)
        return self._found[key]


def _read(path: Path) -> dict[str, float]:
    """Gain bounds of a file; none of one that can't be used."""
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
        return {str(key): float(gain) for key, gain in found.items() if float(gain) >= 0}
    except (OSError, ValueError, TypeError, AttributeError) as error:
        _log.warning("%s can't be used (%s); its gain bounds are sought again", path, error)
        return {}

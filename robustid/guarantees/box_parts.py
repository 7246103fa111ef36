"""Parts of a box, given by the ends (n, 2) of its sides: do they lie within it and cover it?"""

from __future__ import annotations

import numpy as np

from robustid.core import Real


def lies_within(inner: Real, outer: Real) -> bool:
    """Return whether a box lies within another one."""
    return inner.shape == outer.shape and bool(np.all((outer[:, 0] <= inner[:, 0]) & (inner[:, 1] <= outer[:, 1])))


def are_covered(whole: Real, parts: list[Real]) -> bool:
    """Return whether parts of a box cover it: it is cut where as few of them as possible lie on both sides, these are cut too."""
    if any(lies_within(whole, part) for part in parts):
        return True
    side, cut = _cut(whole.tolist(), [part.tolist() for part in parts])
    if side < 0:
        return False
    for end in (0, 1):
        half = whole.copy()
        half[side, 1 - end] = cut
        mine = [part.copy() for part in parts if (part[side, 0] < cut if end == 0 else part[side, 1] > cut)]
        for part in mine:
            part[side] = np.clip(part[side], *half[side])
        if not are_covered(half, mine):
            return False
    return True


def _cut(whole: list[list[float]], parts: list[list[list[float]]]) -> tuple[int, float]:
    """Side of a box and the end of a part where it is cut; side -1 where no part ends inside."""
    best, found = len(parts) + 1, (-1, 0.0)
    for side, (low, high) in enumerate(whole):
        ends = [part[side] for part in parts]
        for cut in {end for pair in ends for end in pair if low < end < high}:
            across = sum(a < cut < b for a, b in ends)
            if across < best:
                best, found = across, (side, cut)
            if not across:
                return found
    return found

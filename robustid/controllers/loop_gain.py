"""Least gain of a loop, from the disc of its sensitivity."""

from __future__ import annotations

import numpy as np

from robustid.core import Complex, Real


def largest_reciprocal(centre: Complex, radius: Real) -> Real:
    r"""Largest :math:`1/|L|` where S = 1/(1 + L) is in a disc: infinite where L may be 0.

    The inverse of the disc is a disc of 1 + L, or the outside of one where the disc holds 0.
    """
    room = np.abs(centre) ** 2 - radius**2
    with np.errstate(divide="ignore", invalid="ignore"):
        far = np.abs(centre.conj() / room - 1)
        least = np.where(room > 0, far - radius / room, radius / -room - far)
        least = np.where(room == 0, -np.inf, least)
        return np.where(np.isfinite(radius) & (least > 0), 1 / least, np.inf)

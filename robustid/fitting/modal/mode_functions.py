"""The function of frequency with which a mode of real shape moves, continuous or behind a zero-order hold."""

from __future__ import annotations

import numpy as np

from robustid.core import Complex


def mode_gains(upper: Complex, discrete: bool, power: int) -> Complex:
    """Residue of ``s^q/((s - p)(s - p*))``, or of its samples behind a zero-order hold, at the upper pole p in s."""
    held = zero_order_held(upper, power)[0] if discrete else upper**power
    return held / (2j * upper.imag)


def zero_order_held(p: Complex, power: int) -> tuple[Complex, Complex]:
    """Residue ``k = p^q (e^p - 1)/p`` of ``p^q/(s - p)`` behind a zero-order hold, ``k/(z - e^p)``, and its slope.

    For q = 2 there is a constant 1 beside it.
    """
    first = np.expm1(p) / p
    slope = (np.exp(p) - first) / p
    if power == 0:
        return first, slope
    if power == 1:
        return np.expm1(p), np.exp(p)
    return p * np.expm1(p), np.expm1(p) + p * np.exp(p)

r"""A mode in powers of an inner function: the functions that serve near the resonance of poles in a hyperbolic disc.

With the pole a within the hyperbolic distance r < 1 of a_0, and x the delay,

.. math:: \frac{c}{1 - a x} = \frac{c'}{1 - a_0 x} \sum_{k < m} (t b)^k + \frac{c'}{1 - a_0 x} \frac{(t b)^m}{1 - t b},
    \qquad b = \frac{x - a_0^*}{1 - a_0 x}, \qquad t = \frac{a - a_0}{1 - a_0^* a}, \qquad c' = c\, \frac{1 - |a_0|^2}{1 - a_0^* a}

On the circle :math:`|b| = 1`. In continuous time :math:`c/(s - a)` has the same form with

.. math:: b = \frac{s + a_0^*}{s - a_0}, \qquad t = \frac{a - a_0}{a + a_0^*}, \qquad c' = c\, \frac{a_0 + a_0^*}{a + a_0^*}

The functions :math:`b^k/(1 - a_0 x)` span what those with an m-fold pole at a_0 span: :math:`b = u + v X`, X the step from one
of these to the next, so that the binomial formula says how they are made of them.
"""

# pyright: reportConstantRedefinition=false
# Matrices have capital letters.
from __future__ import annotations

import dataclasses
from math import comb

import numpy as np

from robustid.bases import ParametricBasis
from robustid.core import Complex, Real


def norms_of(pair: ParametricBasis) -> Real:
    """H2 norms by which the functions of one repeated `kautz` pair are divided, (2 repeat,)."""
    at_once = bool(pair.dt) and bool(np.any(pair.D))
    plain = np.linalg.norm(pair.A[: pair.size], axis=1) if at_once else np.ones(pair.size)
    return plain / np.linalg.norm(pair.C, axis=1)


def inner_scale(pair: ParametricBasis) -> float:
    """Factor of the functions of `inner_pair`, about one over their norms: those of b^k/(1 - a_0 x) are all the same."""
    a = _pole(pair)
    return float(np.sqrt(2 * (1 - abs(a)) * (1 + abs(a)))) if pair.dt else 2 * float(np.sqrt(-a.real))


def inner_pair(pair: ParametricBasis) -> ParametricBasis:
    """Real and imaginary parts of all b^k/(1 - a_0 x), or b^k/(s - a_0), times `inner_scale`, from one repeated `kautz` pair."""
    a, count = _pole(pair), pair.size // 2
    u, v = (-a.conjugate(), (1 - abs(a)) * (1 + abs(a)) / a) if pair.dt else (1.0, 2 * a.real / abs(a))
    T = np.zeros((pair.size, pair.size))
    for k in range(count):
        for j in range(k + 1):
            factor = complex(comb(k, j) * u ** (k - j) * v**j) * inner_scale(pair)
            T[2 * k : 2 * k + 2, 2 * j : 2 * j + 2] = [[factor.real, -factor.imag], [factor.imag, factor.real]]
    T = T * norms_of(pair)
    return dataclasses.replace(pair, C=T @ pair.C, D=T @ pair.D)


def _pole(pair: ParametricBasis) -> complex:
    """The pole in the upper half plane."""
    poles: Complex = pair.poles
    return complex(poles[np.argmax(np.imag(poles))])

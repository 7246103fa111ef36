"""The samples |e_k| <= r_k as second-order cones (r, e) in R x C, with their Nesterov-Todd scaling.

Real samples are discs whose imaginary parts are zero throughout. J(a, b) = (a, -b); products of pairs are
(a, b) o (c, d) = (ac + Re conj(b) d, ad + cb); inner products <(a, b), (c, d)> = ac + Re conj(b) d. All arrays (N,).
"""

from __future__ import annotations

import numpy as np

Pair = tuple[np.ndarray, np.ndarray]


def dot(b: np.ndarray, d: np.ndarray) -> np.ndarray:
    """Re conj(b) d."""
    return np.real(b) * np.real(d) + np.imag(b) * np.imag(d)


def determinant(s: Pair) -> np.ndarray:
    """r^2 - |e|^2, positive inside the cone."""
    size = np.abs(s[1])
    return (s[0] - size) * (s[0] + size)


def inverse(s: Pair) -> Pair:
    """J s / det(s): s o s^-1 = (1, 0)."""
    gap = determinant(s)
    return s[0] / gap, -s[1] / gap


def product(a: Pair, b: Pair) -> Pair:
    """A o b."""
    return a[0] * b[0] + dot(a[1], b[1]), a[0] * b[1] + b[0] * a[1]


def divide(a: Pair, b: Pair) -> Pair:
    """The c with a o c = b."""
    first = (a[0] * b[0] - dot(a[1], b[1])) / determinant(a)
    return first, (b[1] - first * a[1]) / a[0]


def longest_step(s: Pair, d: Pair) -> float:
    """Largest a for which s + a d stays in every cone."""
    A, B, C = d[0] ** 2 - np.abs(d[1]) ** 2, s[0] * d[0] - dot(s[1], d[1]), determinant(s)
    # B^2 - AC >= 0 for s inside its cone: only rounding makes it negative.
    below = np.sqrt(np.maximum(B * B - A * C, 0)) - B
    with np.errstate(divide="ignore", invalid="ignore"):
        steps = np.where(below > 0, C / below, np.inf)
    return float(steps.min(initial=np.inf))


class Scaling:
    """The W with W z = W^-1 s = lambda, for s and z inside the cones.

    W = b [[w0, w1'], [w1, I + w1 w1'/(1 + w0)]] with w = (s/|s| + J z/|z|)/(2 g), |s|^2 = det(s),
    g^2 = (1 + <s/|s|, z/|z|>)/2, b^2 = |s|/|z|; W^-2 = (2 (Jw)(Jw)' - J)/b^2.
    Source: `nesterov1997`; formulas as in `vandenberghe2010` section 4.2.
    """

    def __init__(self, s: Pair, z: Pair):
        size_s, size_z = np.sqrt(determinant(s)), np.sqrt(determinant(z))
        a, b = (s[0] / size_s, s[1] / size_s), (z[0] / size_z, z[1] / size_z)
        g = np.sqrt(2 * (1 + a[0] * b[0] + dot(a[1], b[1])))
        self.w = (a[0] + b[0]) / g, (a[1] - b[1]) / g
        self.squared = size_s / size_z
        self.point = self.apply(z)

    def apply(self, d: Pair) -> Pair:
        """W d."""
        root = np.sqrt(self.squared)
        first, second = self._unit(d, 1.0)
        return root * first, root * second

    def solve(self, d: Pair) -> Pair:
        """W^-1 d."""
        root = np.sqrt(self.squared)
        first, second = self._unit(d, -1.0)
        return first / root, second / root

    def solve_twice(self, d: Pair) -> Pair:
        """W^-2 d."""
        along = 2 * (self.w[0] * d[0] - dot(self.w[1], d[1]))
        return (along * self.w[0] - d[0]) / self.squared, (d[1] - along * self.w[1]) / self.squared

    @property
    def curvature(self) -> Pair:
        """The block of W^-2 on e as weights (a, b): e'W^-2 e = a |e|^2 + Re(b e^2)."""
        return (1 + np.abs(self.w[1]) ** 2) / self.squared, self.w[1].conj() ** 2 / self.squared

    def _unit(self, d: Pair, sign: float) -> Pair:
        w1 = sign * self.w[1]
        along = dot(w1, d[1])
        return self.w[0] * d[0] + along, w1 * (d[0] + along / (1 + self.w[0])) + d[1]

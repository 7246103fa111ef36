"""The samples |e_k| <= r_k as second-order cones (r, e) in R x C^d, with their Nesterov-Todd scaling; steps to borders.

Most cones hold one sample, d = 1; a bound on several samples together has all of them. Real samples are discs whose imaginary
parts are zero throughout. J(a, b) = (a, -b); products of pairs are (a, b) o (c, d) = (ac + Re <b, d>, ad + cb); inner products
<(a, b), (c, d)> = ac + Re <b, d>. First parts (M,), second ones (N,).
"""

from __future__ import annotations

import functools

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from robustid.core import Numbers, Real

Pair = tuple[Real, Numbers]


class Cones:
    """M cones, and the cone (N,) to which each sample belongs; None where sample k is alone in cone k."""

    def __init__(self, count: int, cone: NDArray[np.intp] | None = None):
        self.count, self.cone = count, cone

    def each(self, first: Real) -> Real:
        """The number of its cone for every sample, (N,)."""
        return first if self.cone is None else first[self.cone]

    def sums(self, second: Real) -> Real:
        """Sums of real numbers over every cone, (M,)."""
        if self.cone is None:
            return second
        return np.asarray(np.bincount(self.cone, second, minlength=self.count), dtype=float)

    def followed_by(self, more: int) -> Cones:
        """These cones and further ones of one sample each."""
        cone = None if self.cone is None else np.concatenate([self.cone, self.count + np.arange(more)])
        return Cones(self.count + more, cone)

    def dot(self, b: Numbers, d: Numbers) -> Real:
        """Re <b, d>, (M,)."""
        return self.sums(b.real * d.real + b.imag * d.imag)

    def size(self, e: Numbers) -> Real:
        """||e||, (M,)."""
        return np.abs(e) if self.cone is None else np.sqrt(self.dot(e, e))

    def determinant(self, s: Pair) -> Real:
        """r^2 - |e|^2, positive inside the cone."""
        size = self.size(s[1])
        return (s[0] - size) * (s[0] + size)

    def inverse(self, s: Pair) -> Pair:
        """J s / det(s): s o s^-1 = (1, 0)."""
        gap = self.determinant(s)
        return s[0] / gap, s[1] * self.each(-1 / gap)

    def product(self, a: Pair, b: Pair) -> Pair:
        """A o b."""
        return a[0] * b[0] + self.dot(a[1], b[1]), self.each(a[0]) * b[1] + self.each(b[0]) * a[1]

    def divide(self, a: Pair, b: Pair) -> Pair:
        """The c with a o c = b."""
        first = (a[0] * b[0] - self.dot(a[1], b[1])) / self.determinant(a)
        return first, (b[1] - self.each(first) * a[1]) * self.each(1 / a[0])

    def longest_step(self, s: Pair, d: Pair) -> float:
        """Largest a for which s + a d stays in every cone."""
        A, B, C = d[0] ** 2 - self.size(d[1]) ** 2, s[0] * d[0] - self.dot(s[1], d[1]), self.determinant(s)
        # B^2 - AC >= 0 for s inside its cone: only rounding makes it negative.
        below = np.sqrt(np.maximum(B * B - A * C, 0)) - B
        return float(np.divide(C, below, out=np.full(below.size, np.inf), where=below > 0).min(initial=np.inf))


class Scaling:
    """The W with W z = W^-1 s = lambda, for s and z inside the cones. Source: `nesterov1997`, `vandenberghe2010` section 4.2."""

    # W = b [[w0, w1'], [w1, I + w1 w1'/(1 + w0)]] with w = (s/|s| + J z/|z|)/(2 g), |s|^2 = det(s), g^2 = (1 + <s/|s|,
    # z/|z|>)/2, b^2 = |s|/|z|; W^-2 = (2 (Jw)(Jw)' - J)/b^2.

    def __init__(self, cones: Cones, s: Pair, z: Pair):
        each, size_s, size_z = cones.each, np.sqrt(cones.determinant(s)), np.sqrt(cones.determinant(z))
        a, b = (s[0] / size_s, s[1] * each(1 / size_s)), (z[0] / size_z, z[1] * each(1 / size_z))
        g = np.sqrt(2 * (1 + a[0] * b[0] + cones.dot(a[1], b[1])))
        self._cones = cones
        self.w = (a[0] + b[0]) / g, (a[1] - b[1]) * each(1 / g)
        self.squared = size_s / size_z
        self._root = np.sqrt(self.squared)
        self.point = self.apply(z)

    def apply(self, d: Pair) -> Pair:
        """W d."""
        first, second = self._unit(d, self.w[1])
        return self._root * first, self._cones.each(self._root) * second

    def solve(self, d: Pair) -> Pair:
        """W^-1 d."""
        first, second = self._unit(d, -self.w[1])
        return first / self._root, second * self._cones.each(1 / self._root)

    def solve_twice(self, d: Pair) -> Pair:
        """W^-2 d."""
        along, each = 2 * (self.w[0] * d[0] - self._cones.dot(self.w[1], d[1])), self._cones.each
        return (along * self.w[0] - d[0]) / self.squared, (d[1] - each(along) * self.w[1]) * each(1 / self.squared)

    @property
    def curvature(self) -> tuple[Real, Numbers, Numbers | None]:
        """The block of W^-2 on e as weights (a, b, c): e'W^-2 e = sum a |e|^2 + Re(b e^2) + sum (Re <c, e>)^2 over the cones.

        Samples alone in their cone need no c; it is None where all are.
        """
        squared, w, cone = self._cones.each(self.squared), self.w[1], self._cones.cone
        if cone is None:
            return (1 + np.abs(w) ** 2) / squared, w.conj() ** 2 * (1 / squared), None
        alone = np.bincount(cone)[cone] == 1
        a = np.where(alone, 1 + np.abs(w) ** 2, 1.0) / squared
        return a, np.where(alone, w.conj() ** 2, 0.0) / squared, np.where(alone, 0.0, w * np.sqrt(2 / squared))

    def _unit(self, d: Pair, w1: Numbers) -> Pair:
        along = self._cones.dot(w1, d[1])
        return self.w[0] * d[0] + along, w1 * self._cones.each(d[0] + along / (1 + self.w[0])) + d[1]


def longest_step(factor: Real, direction: Real, enough: float = np.inf, whole: Real | None = None) -> float:
    """Largest a with LL' + a D >= 0, from the smallest eigenvalue of L^-1 D L^-T; a little less for large sizes.

    Where a step `enough` stays inside, that one: a Cholesky factor of M + a D shows it, M = LL' (`whole`), at a tenth of the cost.
    """
    n = factor.shape[0]
    if n == 0:
        return np.inf
    if (
        whole is not None
        and not scipy.linalg.lapack.dpotrf(whole + enough * direction, lower=1, clean=0, overwrite_a=1)[1]
    ):
        return enough
    if n <= _DENSE:
        smallest = _smallest_of_few(factor, direction)
    else:
        smallest = 1.001 * _smallest(factor, direction)
    return -1 / smallest if smallest < 0 else np.inf


_DENSE = 160  # below, a dense eigenvalue routine is quicker than Lanczos
_workspace = functools.cache(scipy.linalg.lapack.dsyevr_lwork)


def _smallest_of_few(factor: Real, direction: Real) -> float:
    """By LAPACK directly: called four times a Newton system, where the checks of SciPy's functions cost as much as the numbers."""
    upper, lapack = factor.T, scipy.linalg.lapack  # in Fortran's order as it is
    half, singular = lapack.dtrtrs(upper, direction, lower=0, trans=1)
    scaled, _ = lapack.dtrtrs(upper, half.T, lower=0, trans=1)
    size, integers, _ = _workspace(len(scaled))
    values, *_, failed = lapack.dsyevr(
        scaled, compute_v=0, range="I", il=1, iu=1, lower=1, lwork=int(size), liwork=int(integers), overwrite_a=1
    )
    if singular or failed:
        raise np.linalg.LinAlgError("no eigenvalue of a step to the border")
    return float(values[0])


def _smallest(factor: Real, direction: Real) -> float:
    import scipy.sparse.linalg as arpack

    upper = factor.T  # in Fortran's order as it is: no copies

    def product(v: Real) -> Real:
        v = scipy.linalg.blas.dtrsv(upper, v.ravel(), lower=0)
        return scipy.linalg.blas.dtrsv(upper, direction @ v, lower=0, trans=1)

    operator = arpack.LinearOperator(direction.shape, matvec=product, dtype=float)
    start = np.ones(direction.shape[0])
    try:
        return float(arpack.eigsh(operator, k=1, which="SA", tol=1e-3, v0=start, return_eigenvectors=False)[0])
    except arpack.ArpackNoConvergence as stop:
        # Ritz values lie inside the spectrum: the step found is too long, and the caller shortens it.
        return float(min(stop.eigenvalues, default=0.0))

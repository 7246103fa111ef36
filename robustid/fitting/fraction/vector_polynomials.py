"""Vector polynomials orthonormal on the data: least squares over polynomials with condition number one."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np
import scipy.linalg

from robustid.core import Frozen, as_array, freeze
from robustid.errors import InputError
from robustid.fitting.fraction.householder import triangle_inverse
from robustid.fitting.fraction.krylov_blocks import (
    NULL,
    Block,
    block_layout,
    check_equations,
    orthonormal_columns,
    raised,
    stacked,
    syrk,
    times_xi,
    without,
)


def polynomial_nodes(omega: np.ndarray, dt: float | None) -> tuple[np.ndarray, float]:
    """Nodes xi of the polynomials and their unit: ``s = scale*xi``, or ``z = xi`` with scale 1.

    In continuous time |xi| <= 1 and `scale` is a power of two, so that powers of xi neither overflow nor round.

    Examples
    --------
    >>> polynomial_nodes(np.array([1.0, 6.0]), None)
    (array([0.+0.125j, 0.+0.75j ]), 8.0)
    """
    omega = np.asarray(omega, dtype=float)
    if dt is not None:
        return np.exp(1j * omega * dt), 1.0
    scale = float(np.ldexp(1.0, int(np.frexp(omega.max(initial=0.0))[1])))
    return 1j * (omega / scale), scale


@dataclasses.dataclass(frozen=True, eq=False)
class VectorPolynomials(Frozen):
    """Vector polynomials phi_c with real coefficients: ``Re sum_k (M_k phi_c(xi_k))^H M_k phi_d(xi_k) = delta_cd``, so that the
    normal matrix of ``min sum_k |M_k x(xi_k)|^2`` is the identity; known by their recursion only, monomials never appear.
    `bultheel2005`, `voorhoeve2016` section IV; block Lanczos with full reorthogonalisation (twice is enough).
    """

    xi: np.ndarray  # (F,) nodes, on the imaginary axis or on the unit circle
    limits: np.ndarray  # (b,) largest degree per component (-1: absent): the span holds all x below these
    # (xi Phi_{k-1}, fresh components) = (Phi_0 .. Phi_k) recursion[k], k = 0 .. L, for the `blocks`; the square last
    # part is triangular
    recursion: tuple[np.ndarray, ...]
    columns: np.ndarray  # M_k (F, r, b)
    values: np.ndarray  # M_k phi_c(xi_k) (2*F*r, n), real parts above imaginary parts, orthonormal columns
    # (n,) columns that vanish on the data (an exact fit): their values are zero, the polynomials go on as (xi + 1)
    # phi (s) or xi phi (z), so that the factors that cancel are stable
    null: np.ndarray

    def __post_init__(self) -> None:
        self.values.flags.writeable = False  # not copied: the largest array of a fit
        self.columns.flags.writeable = False
        self._set(
            xi=freeze(self.xi),
            limits=freeze(self.limits),
            recursion=tuple(freeze(part) for part in self.recursion),
            null=freeze(self.null),
        )

    @cached_property
    def condition(self) -> float:
        """Measured condition number of the normal matrix (without null columns)."""
        values = self.values[:, ~self.null] if self.null.any() else self.values
        if not values.shape[1]:
            return 1.0
        eigenvalues = scipy.linalg.eigvalsh(syrk(1.0, values, trans=1), lower=False)
        return float(eigenvalues[-1] / eigenvalues[0]) if eigenvalues[0] > 0 else np.inf

    @property
    def size(self) -> int:
        """Number n of polynomials."""
        return self.values.shape[1]

    @property
    def blocks(self) -> tuple[Block, ...]:
        """The blocks Phi_k (`block_layout`)."""
        return block_layout(self.limits)

    def project(self, vector: np.ndarray) -> np.ndarray:
        """Coordinates (n,) of the projection of a complex (F, r) vector, or of a stacked real one, on the basis."""
        return self.values.T @ (stacked(vector) if np.iscomplexobj(vector) else vector)

    def polynomials(self, points: np.ndarray) -> np.ndarray:
        """All polynomials at once, (m, b, n), by the recursion itself."""
        points = np.asarray(points, dtype=complex)
        return self._recur(points[:, None, None], np.ones(points.size))

    def derivatives(self, point: complex, count: int) -> np.ndarray:
        """All polynomials and their first derivatives at one point, (count, b, n), by order of the derivative; at infinity the
        coefficients of degree ``limits``, ``limits - 1``, ... of every component (two at most).
        """
        if np.isinf(point):
            return self._highest()[:count]
        # (xi f)^(d) = xi f^(d) + d f^(d-1): multiplication by xi as a bidiagonal matrix.
        return self._recur(point * np.eye(count) + np.diag(np.arange(1, count), -1), np.eye(count)[0])

    def derivatives_of(self, point: complex, count: int, terms: Sequence[np.ndarray]) -> np.ndarray:
        """Value and first derivatives at one point, (count, b), of a polynomial given by the arguments of `evaluate`."""
        values = self.derivatives(point, count)
        out = values @ terms[0]
        if np.isinf(point):
            if len(terms) > 1:  # xi raises the degree by one
                out[0] += self._highest()[1] @ terms[1]
            return out
        if len(terms) > 1:
            low = values @ terms[1]
            out += point * low
            out[1:] += np.arange(1, count)[:, None] * low[:-1]
            out[0] += terms[2]
        return out

    def _highest(self) -> np.ndarray:
        """Coefficients of degree ``limits`` and ``limits - 1``, (2, b, n), by the recursion on its two highest terms."""
        out = np.zeros((2, self.limits.size, self.size))
        for G, (before, here, fresh) in zip(self.recursion, self.blocks, strict=True):
            older, count = before.stop - before.start, here.stop - here.start
            lifted = np.zeros((2, self.limits.size, count))
            # Multiplied by xi, and the degrees that are looked at are one higher.
            lifted[..., :older] = out[..., before]
            lifted[0, fresh, np.arange(older, count)] = 1.0
            lifted[1] -= out[0][:, before] @ G[before]
            # The block before is one degree lower, those before it are out of sight.
            out[1][:, before] = out[0][:, before]
            out[0][:, before] = 0.0
            out[1][:, : before.start] = 0.0
            out[..., here] = lifted @ triangle_inverse(G[here])
        return out

    def _recur(self, xi: np.ndarray, one: np.ndarray) -> np.ndarray:
        """The recursion in any algebra: `xi` multiplies the first axis (a matrix, or entry by entry), `one` is 1 there."""
        out = np.zeros((one.size, self.limits.size, self.size), dtype=complex)
        for G, (before, here, fresh) in zip(self.recursion, self.blocks, strict=True):
            older, count = before.stop - before.start, here.stop - here.start
            lifted = np.zeros((one.size, self.limits.size, count), dtype=complex)
            last = out[..., before]
            lifted[..., :older] = np.tensordot(xi, last, axes=1) if xi.ndim == 2 else xi * last
            lifted[:, fresh, np.arange(older, count)] = one[:, None]
            lifted -= out[..., : here.start] @ G[: here.start]
            out[..., here] = lifted @ triangle_inverse(G[here])
        return out

    def evaluate(
        self,
        points: np.ndarray,
        coordinates: np.ndarray,
        shifted: np.ndarray | None = None,
        constant: np.ndarray | None = None,
    ) -> np.ndarray:
        """Values (m, b) of ``Phi coordinates + xi Phi shifted + constant`` anywhere in the plane, by Clenshaw's recursion."""
        points = np.asarray(points, dtype=complex)
        work = np.repeat(coordinates.astype(complex)[:, None], points.size, axis=1)
        if shifted is not None:
            work += shifted[:, None] * points
        out = np.zeros((self.limits.size, points.size), dtype=complex)
        for G, (before, here, fresh) in zip(reversed(self.recursion), reversed(self.blocks), strict=True):
            older = before.stop - before.start
            top = _real_times(triangle_inverse(G[here]), work[here])
            work[: here.start] -= _real_times(G[: here.start], top)
            work[before] += points * top[:older]
            out[fresh] = top[older:]
        return out.T if constant is None else out.T + constant

    def monic(self, leading: np.ndarray) -> MonicPolynomial:
        """The smallest x on the data whose component l is ``leading[l] xi^(limits[l] + 1)`` + less: nothing is left to solve,
        as the minimum is the leading term with its projection on the basis taken out.
        """
        leading = np.asarray(leading, dtype=float)
        top = np.zeros(0)
        # Only the highest block matters: xi times what is lower stays in the span.
        for G, block in zip(self.recursion, self.blocks, strict=True):
            top = G[block.here] @ np.concatenate([top, leading[block.fresh]])
        shifted = np.zeros(self.size)
        shifted[self.size - top.size :] = top
        constant = np.where(self.limits < 0, leading, 0.0)
        vector = times_xi(self.xi, (self.values @ shifted)[:, None])[:, 0] + stacked(self.columns @ constant)
        coordinates = -self.project(vector)
        vector += self.values @ coordinates
        again = self.project(vector)
        vector -= self.values @ again
        return MonicPolynomial(coordinates - again, shifted, constant, float(np.linalg.norm(vector)))


class MonicPolynomial(NamedTuple):
    """A polynomial outside the span, as arguments of `VectorPolynomials.evaluate`, and its length on the data."""

    coordinates: np.ndarray
    shifted: np.ndarray
    constant: np.ndarray
    length: float


def orthonormal_polynomials(columns: np.ndarray, xi: np.ndarray, limits: np.ndarray) -> VectorPolynomials:
    """Vector polynomials that the data make orthonormal, by a block Krylov process.

    Multiplication by xi is skew (s = j omega) or orthogonal (z = exp(j omega T)) in the real inner product, so that
    the process is a block Lanczos or Arnoldi; every block is orthogonalised twice.

    `columns` (F, r, b) are M_k, such as ``W(k) (D^{-T} kron [P_o -I])``: what the data see of each component at the nodes
    `xi`; `limits` (b,) its largest degree, -1 leaves it out. InputError: fewer real equations than coefficients.

    Examples
    --------
    >>> xi, _ = polynomial_nodes(np.linspace(1, 9, 30), None)
    >>> basis = orthonormal_polynomials(np.ones((30, 1, 1)), xi, np.array([5]))
    >>> basis.size, bool(basis.condition - 1 < 1e-13)
    (6, True)
    """
    columns = as_array("columns", columns, dtype=complex, ndim=3)
    xi = as_array("xi", xi, dtype=complex, ndim=1)
    limits = np.asarray(limits, dtype=int)
    if xi.size != columns.shape[0] or limits.shape != columns.shape[2:]:
        raise InputError(
            f"`columns` must have shape (F, r, b) with F = {xi.size} from `xi` and b = {limits.size} from `limits`;"
            f" got {columns.shape}"
        )
    rows, size = check_equations(limits, columns)
    skew = not np.any(np.real(xi))
    values = np.empty((rows, size), order="F")
    null = np.zeros(size, dtype=bool)
    recursion: list[np.ndarray] = []
    last_but_one = slice(0, 0)
    for before, here, fresh in block_layout(limits):
        block = raised(xi, values[:, before], columns[..., fresh])
        # Skew: three terms, where no component starts.
        local = last_but_one.start if skew and not fresh.size else 0
        G, null[here] = _append(values, block, here.start, local)
        if skew:  # (xi + 1) phi instead of xi phi where nothing was left on the data already
            gone = np.flatnonzero(null[before])
            G[before.start + gone, gone] = -1.0
        recursion.append(G)
        last_but_one = before
    return VectorPolynomials(xi, limits, tuple(recursion), columns, values, null)


def _append(values: np.ndarray, block: np.ndarray, start: int, local: int) -> tuple[np.ndarray, np.ndarray]:
    """Orthonormalise `block` into ``values[:, start:]``; returns its coordinates and which columns were null."""
    count = block.shape[1]
    length = np.linalg.norm(block, axis=0)
    G = np.zeros((start + count, count))
    near, all_earlier = values[:, local:start], values[:, :start]
    block, G[local:start] = without(near, near, block)
    keep = length > 0
    while True:
        whole = bool(keep.all())
        first, R = orthonormal_columns(block if whole else np.asfortranarray(block[:, keep]))
        small = np.abs(np.diag(R)) <= NULL * length[keep]
        if not small.any():
            break
        keep[np.flatnonzero(keep)[np.argmax(small)]] = False
    kept = np.flatnonzero(keep)
    # Second pass: against everything, which also makes good what the first one left out or rounded away.
    first, again = without(all_earlier, all_earlier, first)
    second, S = orthonormal_columns(first)
    G[:start, kept] += again @ R
    G[(start + kept)[:, None], kept] = S @ R
    for column in np.flatnonzero(~keep):
        earlier = kept < column
        G[start + kept[earlier], column] = second[:, earlier].T @ block[:, column]
        G[start + column, column] = length[column] if length[column] > 0 else 1.0
    values[:, start : start + count] = 0.0
    values[:, start + kept] = second
    return G, ~keep


def _real_times(matrix: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Real matrix times complex vectors, in real arithmetic."""
    return (matrix @ np.ascontiguousarray(vectors).view(float)).view(complex)

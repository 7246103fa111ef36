r"""Largest sine of the angle between the graphs of two systems over the frequency axis, without normalised factors.

The graph of P at a frequency is spanned by :math:`G = [D; N]` of any state feedback, none included (:math:`[I; P]`), and
:math:`\tilde G = [-\tilde N, \tilde D]` is zero on it. The sine of the angle between two graphs is

.. math:: \kappa = \bar\sigma\left( (\tilde G_2 \tilde G_2^*)^{-1/2} \, \tilde G_2 G_1 \, (G_1^* G_1)^{-1/2} \right)

and equals :math:`\gamma` where the following has no inverse: the zeros of a matrix of transfer functions whose states are those of
both systems and of their adjoints.

.. math:: \begin{bmatrix} G_1 & \\ & \tilde G_2^* \end{bmatrix}^*
          \begin{bmatrix} -\gamma I & I \\ I & -\gamma I \end{bmatrix}
          \begin{bmatrix} G_1 & \\ & \tilde G_2^* \end{bmatrix}
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy.linalg

from robustid.core import Complex, Numbers, Response, StateMatrices, bilinear_in_s, input_states, poles_of
from robustid.reduction import LargestGain, Modes, Values, turned

_APART = 1 - 1e-14  # a sine that is 1 but for rounding
# Relative to its matrix: an eigenvalue so near the axis has its condition looked at; the error of one whose condition is 1.
_DOUBTED, _ROUNDED = 1e-6, 2e-15
_LARGE = 1e3  # a gain whose square leaves too few digits of the identity beside it


class Graph(NamedTuple):
    """A system that spans a graph, or is zero on it, and the same as a sum over its poles where that serves."""

    system: StateMatrices
    sums: Modes | None


class LargestAngle(LargestGain):
    """The largest sine of the angle between two graphs, one by its G, the other by what is zero on it."""

    def __init__(self, graph: Graph, complement: Graph, *, discrete: bool):
        self.pair = graph.system, complement.system
        self.continuous = [bilinear_in_s(one, 2.0) if discrete else one for one in self.pair]
        direct = np.real(_orthonormal(*(one.D[None] for one in self.continuous))[0])
        sums = _Sines(graph.sums, complement.sums) if graph.sums and complement.sums else None
        super().__init__(sums, direct, discrete=discrete)

    def winds_alike(self) -> bool | None:
        """The winding condition; also true where the sine is 1 at the end of the axis, so that no sides can be counted.

        None where rounding may move a zero to the other side: of gains far from 1, or where the sine is 1.

        As many zeros of the square matrix ``[G, G*]`` of the graph and of the adjoint of the complement as the latter has states
        are right of the axis: no feedback moves them.
        """
        if np.linalg.norm(self.direct, 2) >= _APART:
            return True
        (A, B, C, D), (E, F, G, H) = self.continuous
        back = np.linalg.solve(np.hstack([D, H.T]), np.hstack([C, F.T]))
        states = _beside(A, -E.T) - np.vstack([B @ back[: B.shape[1]], -G.T @ back[B.shape[1] :]])
        zeros = poles_of(states)
        if np.any(np.abs(zeros.real) <= _DOUBTED * np.linalg.norm(states)) and _may_cross(states):
            return None
        return bool(np.count_nonzero(zeros.real > 0) == len(E))

    def factorised(self) -> Values:
        """The response by two Schur forms."""
        return _Sines(*(Response(one) for one in self.pair))

    def exact(self, point: Complex) -> float:
        """The sine at a point, with both graphs made orthonormal there."""
        graph, complement = (D + C @ input_states(A, B, point) for A, B, C, D in self.pair)
        return min(float(np.linalg.norm(_orthonormal(graph, complement)[0], 2)), 1.0)

    def level_matrix(self, level: float, pivot: float | None) -> Numbers:
        """The Hamiltonian matrix of a level, of twice as many states as both systems have."""
        (a, b, c, d), (other, *rest) = (turned(one, pivot) for one in self.continuous)
        f, g, h = map(_star, rest)  # of the adjoint, whose input is g and whose output is f
        rows = np.block([[-level * c, f], [c, -level * f]])
        direct = np.block([[-level * d, h], [d, -level * h]])
        pairs = (a, -_star(other)), (b, -g), (c, f), (d, h)
        states, inputs, outputs, through = (_beside(*two) for two in pairs)
        n = len(states)
        found = np.zeros((2 * n, 2 * n), dtype=states.dtype)
        found[:n, :n], found[n:, n:], found[n:, :n] = states, -_star(states), -_star(outputs) @ rows
        left, right = np.vstack([inputs, -_star(outputs) @ direct]), np.hstack([_star(through) @ rows, _star(inputs)])
        return found - left @ np.linalg.solve(_star(through) @ direct, right)


def _may_cross(states: Numbers) -> bool:
    """Say whether rounding may take an eigenvalue to the other side of the axis, by the conditions after balancing."""
    states = np.asarray(scipy.linalg.matrix_balance(states, permute=False)[0], dtype=float)
    values, right = np.linalg.eig(states)
    try:
        left = np.linalg.inv(right)
    except np.linalg.LinAlgError:
        return True
    error = _ROUNDED * np.linalg.norm(states) * np.linalg.norm(left, axis=1)  # the right ones have length 1
    return bool(np.any(np.abs(np.real(values)) <= error))


class _Sines:
    """Matrices whose singular values are the sines, from both responses."""

    def __init__(self, graph: Values, complement: Values):
        self.graph, self.complement = graph, complement
        self.poles = np.concatenate([graph.poles, complement.poles])

    def at(self, points: Complex) -> Complex:
        """Values at points s or z."""
        graph, complement = self.graph.at(points), self.complement.at(points)
        large = np.maximum(np.abs(graph).max(axis=(1, 2)), np.abs(complement).max(axis=(1, 2))) > _LARGE
        if not large.any():
            return _product(graph, complement)
        found = np.empty((len(points), complement.shape[1], graph.shape[2]), dtype=complex)
        found[large] = _orthonormal(graph[large], complement[large])
        found[~large] = _product(graph[~large], complement[~large])
        return found


def _beside(one: Numbers, other: Numbers) -> Numbers:
    """Two blocks on the diagonal."""
    rows, columns = one.shape
    found = np.zeros((rows + other.shape[0], columns + other.shape[1]), dtype=np.result_type(one, other))
    found[:rows, :columns], found[rows:, columns:] = one, other
    return found


def _star(matrix: Numbers) -> Numbers:
    return matrix.conj().swapaxes(-1, -2)


def _product(graph: Complex, complement: Complex) -> Complex:
    """The product between the inverse Cholesky factors of both Gram matrices, which square the gain."""
    first, second = np.linalg.cholesky(_star(graph) @ graph), np.linalg.cholesky(complement @ _star(complement))
    half = np.linalg.solve(second, complement @ graph)
    return np.asarray(_star(np.linalg.solve(first, _star(half))), dtype=complex)


def _orthonormal(graph: Numbers, complement: Numbers) -> Numbers:
    """A matrix of the same singular values by QR, in three times the time."""
    return _star(_basis(_star(complement))) @ _basis(graph)


def _basis(columns: Numbers) -> Numbers:
    """Orthonormal columns of the same range: rows of large entries first, beside which the others would be rounded."""
    order = np.argsort(-np.abs(columns).max(axis=(0, 2)))
    found = np.empty_like(columns)
    found[:, order] = np.linalg.qr(columns[:, order])[0]
    return found

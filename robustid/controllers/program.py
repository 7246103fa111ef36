"""Cone program in the factors of a controller, one slack that is to be large, and helpers that bound norms."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import Any, NamedTuple

import clarabel
import numpy as np
import scipy.sparse

from robustid.controllers.discs import Indices
from robustid.core import Complex, Real

_TOLERANCE = 1e-6  # of the solver: what it finds is judged by its numbers
_SMALL = 1e-10  # weight of the size of the factors, which makes them unique

Helper = tuple[Indices, Real]  # numbers of helpers, one to a cone (N,), and their factors (N,)


class Rows(NamedTuple):
    """N cones of R rows each: ``factors x + slack t + (sum of helpers) unit + constant`` is in the cone."""

    factors: Real  # (N, R, m)
    slack: Real  # (N, R)
    constant: Real  # (N, R)
    helpers: Sequence[Helper] = ()
    unit: Real = np.ones(1)  # (R,)


class Functions(NamedTuple):
    """Values of the functions of a controller between axes, (N, m, k, l), and constant matrices around them."""

    axes: Complex
    into: Real  # (nu, k)
    out_of: Real  # (l, ny)

    @property
    def whole(self) -> Complex:
        """From the outputs of the plant to its inputs, (N, m, nu, ny)."""
        return self.into @ self.axes @ self.out_of

    def at(self, place: Indices) -> Functions:
        """At some of the points."""
        return Functions(self.axes[place], self.into, self.out_of)

    def scaled(self, q: Complex) -> Complex:
        r"""Values with a singular value at least that of Q (N, nu, nu) times the whole, (N, m, ...): between axes, one to each.

        With t the norms of the columns of Q A and w those of the rows of B,
        :math:`\|Q A D B\| \le \|Q A T^{-1}\| \max_i t_i |d_i| w_i \|W^{-1} B\|`; else exact.
        """
        held = np.any(self.axes != 0, axis=(0, 1))
        if held.sum(axis=0).max() > 1 or held.sum(axis=1).max() > 1:
            return q[:, None] @ self.whole
        before, w = q @ self.into, np.linalg.norm(self.out_of, axis=1)
        t = np.maximum(np.linalg.norm(before, axis=1), np.finfo(float).tiny)
        lost = np.linalg.norm(before / t[:, None, :], 2, axis=(1, 2)) * np.linalg.norm(self.out_of / w[:, None], 2)
        return self.axes * (lost[:, None] * t)[:, None, :, None] * w


class Program:
    """Rows of a program, to be solved."""

    def __init__(self, count: int) -> None:
        self.count, self.size = count, count + 1
        self.groups: list[tuple[Rows, Any]] = []
        self._norms: dict[tuple[int, bytes], tuple[int, float]] = {}

    def not_negative(self, factors: Real, slack: Real, constant: Real, helpers: Sequence[Helper] = ()) -> None:
        """``factors x + slack t + constant + helpers >= 0``, (N, m), (N,), (N,)."""
        rows = Rows(factors[:, None], slack[:, None], constant[:, None], helpers)
        self.groups.append((rows, clarabel.NonnegativeConeT(1)))

    def hold(self, ahead: Real, slack: Real, fixed: Real, small: Complex, rest: Complex) -> None:
        """``ahead x + slack t + fixed >= |small x + rest|``, (N, m), (N,), (N,), (N, m), (N,)."""
        plain = ~np.any(small, axis=1)
        if plain.any():
            self.not_negative(ahead[plain], slack[plain], fixed[plain] - np.abs(rest[plain]))
            ahead, slack, fixed, small, rest = ahead[~plain], slack[~plain], fixed[~plain], small[~plain], rest[~plain]
        if not slack.size:
            return
        factors = np.stack([ahead, small.real, small.imag], axis=1)
        none = np.zeros_like(slack)
        constant = np.stack([fixed, rest.real, rest.imag], axis=1)
        rows = Rows(factors, np.stack([slack, none, none], axis=1), constant)
        self.groups.append((rows, clarabel.SecondOrderConeT(3)))

    def semidefinite(self, values: Complex, fixed: Complex, slack: Real, helpers: Sequence[Helper]) -> None:
        """Hermitian part of ``values x + fixed`` at least ``-(slack t + helpers) I``: (N, m, p, p), (N, p, p), (N,)."""
        size = fixed.shape[1]
        form, cone = (
            (_pauli, clarabel.SecondOrderConeT(4)) if size == 2 else (_triangle, clarabel.PSDTriangleConeT(2 * size))
        )
        unit = form(np.eye(size, dtype=complex))
        rows = Rows(form(values).swapaxes(1, 2), slack[:, None] * unit, form(fixed), helpers, unit)
        self.groups.append((rows, cone))

    def norm(self, values: Complex, fixed: Complex, slack: Real, constant: Real, helpers: Sequence[Helper]) -> None:
        """Norm of ``values x + fixed``, (N, m, p, q) and (N, p, q), at most ``slack t + constant + helpers``, (N,)."""
        if values.shape[2:] == (1, 1):
            none, one = np.zeros(len(values)), values[:, :, 0, 0]
            rows = Rows(
                np.stack([np.zeros(one.shape), one.real, one.imag], axis=1),
                np.stack([slack, none, none], axis=1),
                np.stack([constant, fixed[:, 0, 0].real, fixed[:, 0, 0].imag], axis=1),
                helpers,
                np.array([1.0, 0.0, 0.0]),
            )
            self.groups.append((rows, clarabel.SecondOrderConeT(3)))
            return
        N, m, p, q = values.shape
        whole = np.zeros((N, m, p + q, p + q), complex)
        whole[:, :, :p, p:] = 2 * values  # of which the Hermitian part is taken
        rest = np.zeros((N, p + q, p + q), complex)
        rest[:, :p, p:] = 2 * fixed
        rest += constant[:, None, None] * np.eye(p + q)
        self.semidefinite(whole, rest, slack, helpers)

    def helpers(self, count: int) -> Indices:
        """Numbers of new helpers."""
        found = self.size + np.arange(count)
        self.size += count
        return found

    def norms(self, place: Indices, q: Complex, shift: Complex, functions: Functions) -> list[Helper]:
        """Helpers that are at least ``|Q_k C + A_k|``, (N, k, nu, ...), with C of functions at N places; less each.

        Those of the same place are the same for all conditions. They are in units of the largest function.
        """
        found: list[Helper] = []
        for k in range(q.shape[1]):
            every = zip(place, q[:, k], shift[:, k], strict=True)
            keys = [(int(at), one.tobytes() + other.tobytes()) for at, one, other in every]
            first = {key: n for n, key in reversed(list(enumerate(keys))) if key not in self._norms}
            new = np.array(sorted(first.values()), dtype=int)
            moved = np.any(shift[new, k], axis=(1, 2))
            for some, own in ((new[~moved], False), (new[moved], True)):
                at, A = functions.at(some), shift[some, k]
                values = q[some, k][:, None] @ at.whole if own else at.scaled(q[some, k])
                units = np.maximum(np.abs(values).max(axis=(1, 2, 3), initial=0.0), np.finfo(float).tiny)
                units = np.maximum(units, np.abs(A).max(axis=(1, 2), initial=0.0))
                index = self.helpers(some.size)
                for n, helper, unit in zip(some, index, units.tolist(), strict=True):
                    self._norms[keys[n]] = int(helper), unit
                if some.size:
                    self._at_least(
                        index, values / units[:, None, None, None], A / units[:, None, None] if own else None
                    )
            index = np.array([self._norms[key][0] for key in keys])
            found.append((index, -np.array([self._norms[key][1] for key in keys])))
        return found

    def _at_least(self, index: Indices, values: Complex, fixed: Complex | None) -> None:
        """Helpers not below norms of ``values x + fixed``: by entries where no row and no column holds two of them."""
        none, helper = np.zeros(len(values)), [(index, np.ones(len(values)))]
        held = np.any(values != 0, axis=(0, 1))
        if fixed is not None or held.sum(axis=0).max() > 1 or held.sum(axis=1).max() > 1:
            rest = np.zeros((len(values), *held.shape), complex) if fixed is None else fixed
            self.norm(values, rest, none, none, helper)
            return
        for i, j in np.argwhere(held):
            self.norm(values[:, :, i : i + 1, j : j + 1], np.zeros((len(values), 1, 1), complex), none, none, helper)

    def solved(self) -> tuple[Real, float] | None:
        """The factors where the slack is largest, and the slack."""
        m, place = self.count, 0
        dense, constants, cones, at, columns, values = (list[Any]() for _ in range(6))
        for rows, cone in self.groups:
            N, R = rows.slack.shape
            every = np.concatenate([rows.factors, rows.slack[..., None], rows.constant[..., None]], axis=2)
            size = np.abs(every).max(axis=(1, 2))
            for _, factor in rows.helpers:
                size = np.maximum(size, np.abs(factor))
            size = np.where(size > 0, size, 1.0)  # cones don't mind, and the solver does
            every = (every / size[:, None, None]).reshape(N * R, m + 2)
            dense.append(every[:, :-1])
            constants.append(every[:, -1])
            cones += [cone] * N
            used = np.flatnonzero(rows.unit)
            for index, factor in rows.helpers:
                filled: Indices = np.asarray(place + np.arange(N)[:, None] * R + used, dtype=np.intp)
                at.append(filled.ravel())
                columns.append(np.repeat(index - m - 1, used.size))
                values.append(((factor / size)[:, None] * rows.unit[used]).ravel())
            place += N * R
        matrix = _sparse(-np.concatenate(dense))
        if values:
            places = np.concatenate(at), np.concatenate(columns)
            beside = scipy.sparse.csc_matrix((-np.concatenate(values), places), shape=(place, self.size - m - 1))
            matrix = scipy.sparse.csc_matrix(scipy.sparse.hstack([matrix, beside]))
        settings = clarabel.DefaultSettings()
        settings.verbose = False
        settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = _TOLERANCE
        settings.chordal_decomposition_enable = False  # many small cones: parts of them are no gain
        goal = np.zeros(self.size)
        goal[m] = -1.0
        solver = clarabel.DefaultSolver(_weight(m, self.size), goal, matrix, np.concatenate(constants), cones, settings)
        found = np.asarray(solver.solve().x, dtype=float)[: m + 1]
        return (found[:m], float(found[m])) if np.all(np.isfinite(found)) else None


@functools.lru_cache(maxsize=16)
def _weight(count: int, size: int) -> scipy.sparse.csc_matrix:
    """A diagonal, of the factors alone."""
    one = np.minimum(np.arange(size + 1), count)
    return scipy.sparse.csc_matrix((np.full(count, _SMALL), np.arange(count), one), shape=(size, size))


def _sparse(matrix: Real) -> scipy.sparse.csc_matrix:
    """The entries that are not zero, by columns."""
    columns, rows = np.nonzero(matrix.T)
    starts: Indices = np.searchsorted(columns, np.arange(int(matrix.shape[1]) + 1))
    return scipy.sparse.csc_matrix((matrix[rows, columns], rows, starts), shape=matrix.shape)


def _triangle(matrices: Complex) -> Real:
    """Upper triangle, by columns, of the real form of the Hermitian part, times sqrt(2) beside the diagonal: (..., rows)."""
    half = (matrices + matrices.conj().swapaxes(-1, -2)) / 2
    real = np.concatenate(
        [np.concatenate([half.real, -half.imag], axis=-1), np.concatenate([half.imag, half.real], axis=-1)], axis=-2
    )
    columns, rows = np.tril_indices(real.shape[-1])
    return real[..., rows, columns] * np.where(rows == columns, 1.0, np.sqrt(2))


def _pauli(matrices: Complex) -> Real:
    """Hermitian part of two rows as one number and a vector: semidefinite where the number is at least its length, (..., 4)."""
    a, d = matrices[..., 0, 0].real, matrices[..., 1, 1].real
    beside = (matrices[..., 0, 1] + matrices[..., 1, 0].conj()) / 2
    return np.stack([(a + d) / 2, (a - d) / 2, beside.real, beside.imag], axis=-1)

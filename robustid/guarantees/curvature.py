"""Bounds of the second derivative of a model's error along the circle: how much it can bend between two frequencies.

E = G + sum (p_i - q_i) P_i + (q'P - model) for every consistent F, with q a member's parameters, is bounded in three parts:

* |d^2 G/d theta^2| <= K rho/(rho-1)^2 in discrete time: with g(zeta) = G(rho zeta)/K in the unit ball, |g^(n)| <= n!
  (1 - |g|^2)/((1-|zeta|)^n (1+|zeta|)) [`ruscheweyh1985`] for n = 1, 2 at |zeta| = 1/rho, and d^2/d theta^2 =
  -(z G' + z^2 G''); in continuous time likewise (`Region.bend`); positive-real ones in `class_size`.
  Where the class has a weight W, G = W phi with phi in the ball: |G''| <= |W| |phi''| + 2 |W'| |phi'| + |W''| |phi|, those of
  W from its state space. MIMO: this holds for the singular values of G divided by its scaling, hence for their entries;
* the P_i from their state space, times the half-widths of the certified intervals;
* the remainder, a known rational function, from its state space; where it is -G_id, with G_id in the same ball (`inside`), the
  bound of G serves for it too.
"""

from __future__ import annotations

import dataclasses
import functools
from typing import TYPE_CHECKING

import numpy as np
import scipy.linalg

from robustid.core import Complex, Real, StateMatrices
from robustid.guarantees.parameters import ParameterIntervals
from robustid.identification import Identification, MixedProblem, class_size, class_value, parametric_states

if TYPE_CHECKING:
    import control

_DEPENDENT = 1e-8  # ratio of the eigenvalues of a Gramian below which states are almost dependent
_CHANGED = 1e-11  # by rounding in other coordinates, times the resolvent: more than sqrt(1/_DEPENDENT) roundings
_SHORT = 0.25  # half of an arc times the resolvent at its middle
_PIECES = 4000  # of an arc, at most
_RESOLVENTS = 50_000  # whose norms are computed, about: seconds
_STACK = 50_000  # complex numbers in the columns of a stack: what a cache holds
_AT_ONCE = 16  # angles whose resolvents get their norms together
_NEAR = 0.05  # of the distance of a singular matrix: how far its norm is used, which it makes larger by as much

StateSpace = tuple[Real, Real, Real]  # A, B, C


@dataclasses.dataclass(frozen=True)
class Curvature:
    """Bounds of the second derivative of the entries of E = F - model along the circle, for every consistent F.

    E = G + sum (p_i - q_i) P_i + (q'P - model) with q a member's parameters: three parts, bounded apart as the module says.
    """

    problem: MixedProblem
    known: StateSpace
    basis: StateSpace | None
    reach: Real
    inside: bool

    def largest(self, low: Real, high: Real) -> Real:
        """On the arcs from the angles `low` to `high`, (arcs, ny, nu); inf where an arc is too long for the bound to hold."""
        known = self._of_known.on_arcs(low, high)
        of_class = self._of_class(low, high)[:, None, None]
        ball = self.problem.prior.scales(*known.shape[1:]) * (of_class * (1 + 1e-6))
        total = ball + (np.minimum(known, ball) if self.inside else known)
        return self._with_parameters(total, low, high)

    def _of_class(self, low: Real, high: Real) -> Real:
        """Bound of |G''| on each arc for every G of the class, without its scaling."""
        K, region = class_size(self.problem, low, high), self.problem.region
        if self.problem.weighting.trivial:
            return region.bend(K, low, high)
        size, slope, bend = self._weight(low, high)
        value = class_value(self.problem, low, high)
        return size * region.bend(K, low, high) + 2 * slope * region.slope(K, low, high) + bend * value

    def _weight(self, low: Real, high: Real) -> tuple[Real, Real, Real]:
        """Bounds of |W|, |W'| and |W''| on each arc: values in the middle, and what the next derivative can add."""
        A, B, C = self._states_of_weight
        middle, half = (low + high) / 2, (high - low) / 2
        R = np.asarray(np.linalg.inv(np.exp(1j * middle)[:, None, None] * np.eye(A.shape[0]) - A), dtype=complex)
        there: Real = np.abs(C @ R @ R @ B).sum(axis=(1, 2))
        bend: Real = self._of_weight.on_arcs(low, high).sum(axis=(1, 2))
        slope = there + half * bend
        return self.problem.weighting.sizes(middle) + half * slope, slope, bend

    @functools.cached_property
    def _states_of_weight(self) -> StateSpace:
        states = self.problem.weighting.states[:3]
        return states if self.problem.prior.positive_real else input_normal(*states)  # 1/s has no input-normal form

    @functools.cached_property
    def _of_known(self) -> ArcDerivatives:
        return ArcDerivatives(*self.known)

    @functools.cached_property
    def _of_basis(self) -> ArcDerivatives | None:
        return None if self.basis is None else ArcDerivatives(*self.basis)

    @functools.cached_property
    def _of_weight(self) -> ArcDerivatives:
        return ArcDerivatives(*self._states_of_weight)

    def weight(self, low: Real, high: Real) -> Real:
        """Bound of |W| on each arc, from its ends."""
        weighting = self.problem.weighting
        if weighting.trivial:
            return np.ones(low.size)
        bend: Real = self._of_weight.on_arcs(low, high).sum(axis=(1, 2))
        ends = np.maximum(weighting.sizes(low), weighting.sizes(high))
        return ends * (1 + 1e-9) + bend * (high - low) ** 2 / 8

    def outside(self, low: Real, high: Real) -> Real:
        """Bound of E - G on each arc, (arcs, ny, nu)."""
        return self._with_parameters(self._of_known.on_arcs(low, high), low, high)

    def _with_parameters(self, total: Real, low: Real, high: Real) -> Real:
        if self._of_basis is not None:
            sizes = self._of_basis.on_arcs(low, high)[:, :, :1]
            for k, reach in enumerate(self.reach):
                total = total + np.where(reach > 0, sizes[:, k : k + 1], 0.0) * reach
        return total


def curvature_of(
    model: control.StateSpace, identification: Identification, parameters: ParameterIntervals
) -> Curvature:
    """Curvature of F - model, with intervals of the parameters."""
    basis, own = identification.problem.parametric, is_own(model, identification)
    # Of a negative-imaginary class the constant has no states of its own in the model.
    joined = identification.problem.prior.positive_real and not identification.problem.weighting.trivial
    parts = interpolant_part(identification) if own and not joined else known_part(model, identification)
    reach = parameters.reach(identification.parameters)
    functions = None if basis is None or not basis.states else input_normal(basis.A, basis.B, basis.C)
    # A reduced interpolant is near the ball, not in it.
    inside = own and identification.formulation.exact
    shape = len(identification.problem.outputs), len(identification.problem.inputs)
    return Curvature(identification.problem, parts, functions, reach.reshape(-1, *shape), inside)


def is_own(model: control.StateSpace, identification: Identification) -> bool:
    """Return whether a nominal is the model of the identification (or a copy of it)."""
    return all(np.array_equal(getattr(model, name), getattr(identification.model, name)) for name in "ABCD")


class ArcDerivatives:
    """Bounds of |d^2/d theta^2 C (zI - A)^-1 B|, z = exp(j theta), on arcs: of every entry.

    From a Schur form of A, which makes products with the resolvents of all arcs sums over its columns.
    """

    def __init__(self, A: Real, B: Real, C: Real) -> None:
        self.shape = C.shape[0], B.shape[1]
        upper, basis = scipy.linalg.schur(A, output="complex") if A.size else (A, A)
        self._upper = np.asarray(upper, dtype=complex)
        self._inputs = np.asarray(basis.conj().T @ B, dtype=complex)
        self._outputs = np.asarray(C @ basis, dtype=complex)
        self._known: tuple[Real, Real] = (
            np.zeros(0),
            np.zeros(0),
        )  # angles, rising, and the norms of the resolvents there

    def on_arcs(self, low: Real, high: Real) -> Real:
        """The largest on arcs between angles, (arcs, rows of C, columns of B).

        Arcs that are long beside the distance of a pole are halved; infinite where a pole is too near for that, and where poles
        that lie together make the resolvents of too many pieces large.
        """
        largest = np.zeros((low.size, *self.shape))  # rises piece by piece
        if not self._upper.size:
            return largest
        arc, start, end = np.arange(low.size), low, high
        pieces, step = np.zeros(low.size, int), max(1, _STACK // len(self._upper))
        while arc.size:
            np.add.at(pieces, arc, 1)
            middle, half = (start + end) / 2, (end - start) / 2
            sizes = self.norms(middle)
            with np.errstate(invalid="ignore"):
                short = half * sizes < _SHORT
            for part in np.split(np.flatnonzero(short), range(step, int(short.sum()), step)):
                np.maximum.at(largest, arc[part], self._on_short_arcs(middle[part], half[part], sizes[part]))
            left = ~short & (pieces[arc] < _PIECES) & (self._known[0].size < _RESOLVENTS)
            largest[arc[~short & ~left]] = np.inf
            arc, start, middle, end = arc[left], start[left], middle[left], end[left]
            arc, start, end = np.tile(arc, 2), np.concatenate([start, middle]), np.concatenate([middle, end])
        return largest

    def norms(self, angles: Real) -> Real:
        """Bounds of the norms of the resolvents at angles, near them, (N,).

        1/||R|| is the distance of zI - A from the singular matrices, which differs by at most the distance of two z: a norm at one
        of them is one at those beside it.
        """
        found = self._from_known(angles)
        while (left := np.flatnonzero(np.isinf(found))).size:
            at = np.unique(angles[left[:: max(1, left.size // _AT_ONCE)]])
            matrices = np.exp(1j * at)[:, None, None] * np.eye(len(self._upper)) - self._upper
            with np.errstate(divide="ignore"):
                own = np.minimum(1 / np.linalg.svd(matrices, compute_uv=False)[:, -1], np.finfo(float).max)
            known = (np.concatenate(both) for both in zip(self._known, (at, own), strict=True))
            order = np.argsort((every := next(known)), kind="stable")
            self._known = every[order], next(known)[order]
            found[left] = self._from_known(angles[left])
        return found

    def _from_known(self, angles: Real) -> Real:
        """The same from those that are known beside them; infinite where these are too far away."""
        there, sizes = self._known
        found = np.full(angles.size, np.inf)
        for shift in (1, 0) if there.size else ():
            k = np.clip(np.searchsorted(there, angles) - shift, 0, there.size - 1)
            part = np.abs(angles - there[k]) * sizes[k]
            near = part <= _NEAR
            found[near] = np.minimum(found[near], sizes[k][near] / (1 - part[near]))
        return found

    def _on_short_arcs(self, middle: Real, half: Real, sizes: Real) -> Real:
        """Bounds on arcs that are short beside the distance of a pole.

        The value at the middle, and half the arc times a bound of the third derivative: R(z) = R (I + (z - middle) R)^-1, R =
        (zI - A)^-1 at the middle, commutes with it, hence |C R(z)^k B| <= |C R^i| |R^(k-i) B| / (1 - d ||R||)^k for |z - middle|
        <= d and any i of them.
        """
        z = np.exp(1j * middle)
        columns = np.broadcast_to(self._inputs[:, None], (len(self._inputs), z.size, self.shape[1]))
        one = self._times_resolvents(z, columns)
        two = self._times_resolvents(z, one)
        columns = np.broadcast_to(self._outputs.T[:, None], (len(self._inputs), z.size, self.shape[0]))
        row = self._times_resolvents(z, columns, turned=True)
        rows = self._times_resolvents(z, row, turned=True)
        first, second = -_inner(row, one), 2 * _inner(rows, one)
        z, half, sizes = (each[:, None, None] for each in (z, half, sizes))
        here = np.abs(z * first + z**2 * second)
        short, shorter = (np.linalg.norm(each, axis=0)[:, None, :] for each in (one, two))
        long, longer = (np.linalg.norm(each, axis=0)[:, :, None] for each in (row, rows))
        grown = 1 / (1 - half * sizes)
        third = long * short * grown**2 + 6 * np.minimum(long * shorter, longer * short) * grown**3
        third += 6 * longer * shorter * grown**4
        return (here + half * third) * (1 + 1e-9 + _CHANGED * sizes)

    def _times_resolvents(self, z: Complex, right: Complex, turned: bool = False) -> Complex:
        """Resolvents (N) of the Schur form, or their transposes, times columns, (states, N, columns)."""
        n = len(self._upper)
        upper, found = self._upper.T if turned else self._upper, np.empty(right.shape, complex)
        for k in range(n) if turned else range(n - 1, -1, -1):
            done = slice(0, k) if turned else slice(k + 1, n)
            known = np.tensordot(upper[k, done], found[done], 1)
            found[k] = (right[k] + known) / (z - upper[k, k])[:, None]
        return found


def _inner(rows: Complex, columns: Complex) -> Complex:
    """Products of rows and columns, (states, N, rows) and (states, N, columns), as matrices (N, rows, columns)."""
    return np.asarray(np.moveaxis(rows, 0, 2) @ np.moveaxis(columns, 0, 1), dtype=complex)


def known_part(model: control.StateSpace, identification: Identification) -> StateSpace:
    """State space (A, B, C) of q'P - model, each in coordinates of its own."""
    problem = identification.problem
    a, b, c, _ = problem.plane.in_z(StateMatrices.of(model))
    A, B, C = input_normal(a, b, -c)
    if problem.parametric is None or not problem.parametric.states:
        return A, B, C
    residues = identification.parameters.reshape(-1, *model.D.shape)
    a, b, c = input_normal(*parametric_states(problem, residues)[:3])
    return scipy.linalg.block_diag(A, a), np.vstack([B, b]), np.hstack([C, c])


def interpolant_part(identification: Identification) -> StateSpace:
    """State space of minus the non-parametric part of its own model, whose parametric part is q'P exactly, its states the last."""
    model, basis = identification.model, identification.problem.parametric
    n = model.nstates - (0 if basis is None else basis.states * min(model.D.shape))
    A, B, C, _ = identification.problem.plane.in_z(StateMatrices.of(model))
    return input_normal(A[:n, :n], B[:n], -C[:, :n])


def input_normal(A: Real, B: Real, C: Real) -> StateSpace:
    """A similar realisation whose states are orthonormal: its resolvent is hardly larger than its poles make it.

    Of repeated light poles by far: 1/distance^2 becomes 2.4/distance. Where the states are almost dependent, or a pole is on the
    circle, a diagonal scaling by powers of two.
    """
    if not A.shape[0]:
        return A, B, C
    if np.abs(np.linalg.eigvals(A)).max() < 1:
        gramian = scipy.linalg.solve_discrete_lyapunov(A, B @ B.T)
        if np.all(np.diag(gramian) > 0):
            unit = 2.0 ** np.round(
                -0.5 * np.log2(np.diag(gramian))
            )  # exact, and repeated poles become well conditioned
            size, V = np.linalg.eigh(gramian * unit * unit[:, None])
            if size[0] > _DEPENDENT * size[-1]:
                there, back = V / unit[:, None] * np.sqrt(size), (V / np.sqrt(size)).T * unit
                return back @ A @ there, back @ B, C @ there
    balanced, (scale, _) = scipy.linalg.matrix_balance(A, permute=False, separate=True)
    return balanced, B / scale[:, None], C * scale

"""The Newton system of the interior-point method at an iterate: its matrix, condensed to the unknowns, and its directions."""

from __future__ import annotations

import copy
import dataclasses
import functools
from collections.abc import Callable

import numpy as np
import scipy.linalg
import scipy.sparse

from robustid.core import Numbers, Real, threads_for
from robustid.identification.formulation.ball import Ball
from robustid.identification.formulation.columns import Design
from robustid.identification.solver.cones import Cones, Pair, Scaling, longest_step

_FULL = 1.2  # longer steps are cut to one, whatever part of them is taken


@dataclasses.dataclass(frozen=True)
class Limits:
    """Radius of the ball and reach of the samples as affine functions of one number t: a + b t."""

    ball: tuple[float, float]
    reach: tuple[Real, Real]


@dataclasses.dataclass(frozen=True)
class Program:
    """min cost t + linear'v subject to ||X(x)|| <= ball(t), |y - G v|_k <= reach_k(t), v = (x, q)."""

    # With cost None there is no t (it is 0). Both are strictly feasible, primal and dual, for the problems posed here, so that
    # no homogeneous embedding is needed: infeasibility is a margin above 1, not a status.

    ball: Ball
    design: Design
    cones: Cones
    y: Numbers
    limits: Limits
    cost: float | None
    linear: Real
    quick: bool = False  # for bounds: a step to the border may be a rounding too long, a centre is one to start from

    @functools.cached_property
    def sums(self) -> scipy.sparse.csr_array:
        """The sparse matrix (M, N) that adds up the samples of every cone."""
        count = self.y.size
        cone = np.arange(count) if self.cones.cone is None else self.cones.cone
        return scipy.sparse.csr_array((np.ones(count), (cone, np.arange(count))), shape=(self.cones.count, count))

    @property
    def degree(self) -> int:
        """Parameter nu of the barrier: <s, z> = nu mu on the central path."""
        return sum(self.ball.blocks) + self.cones.count


@dataclasses.dataclass
class Iterate:
    """A strictly feasible primal point, with multipliers inside the dual cones.

    The primal slacks S_k = ball I + A_k(x) and (r, e) are functions of (v, t), so that the primal constraints hold exactly.
    """

    v: Real
    t: float
    Z: list[Real]
    z: Pair
    gap: float = np.inf
    # Norm of what is missing in linear - sum A_k*(Z_k) + G'z1 = 0 and cost - ball' sum tr(Z_k) - <reach', z0> = 0.
    dual: float = np.inf

    @property
    def estimate(self) -> float:
        """Gap to the optimum, approximately: what is missing in the dual equalities counts with the size of the unknowns."""
        return self.gap + self.dual * (1 + _size(self.v) + abs(self.t))


class State:
    """All that one Newton system needs at an iterate; raises LinAlgError where an iterate has left its cone."""

    matrix: Real
    _factored = False

    def __init__(self, program: Program, at: Iterate):
        self.program, self.at = program, at
        cones = program.cones
        self.S, self.s = slacks(program, at.v, at.t)
        if not all(cones.determinant(one).min(initial=1) > 0 for one in (self.s, at.z)):  # NaN is no inside either
            raise np.linalg.LinAlgError("a sample has left its cone")
        self.root_S = [cholesky(S) for S in self.S]
        self.root_Z = [cholesky(Z) for Z in at.Z]
        at.gap = inner(cones, self.S, at.Z, self.s, at.z)
        self.mu = at.gap / program.degree
        self.residual = self._dual_residual(at.Z, at.z, program.linear, program.cost)
        at.dual = _size(self.residual)
        self.scaling = Scaling(cones, self.s, at.z)
        if not cones.determinant(self.scaling.point).min(initial=1) > 0:
            raise np.linalg.LinAlgError("a scaled point has lost its digits")

    @functools.cached_property
    def inverse(self) -> list[Real]:
        """The S^-1: of the last state of a path nobody asks for them."""
        return [inverse_of(root) for root in self.root_S]

    def _dual_residual(self, Z: list[Real], z: Pair, linear: Real | float, cost: float | None) -> Real:
        """Gradient of the Lagrangian in (v, t) at multipliers (Z, z)."""
        program = self.program
        out = linear + program.design.adjoint(z[1])
        out[: program.ball.size] -= program.ball.adjoint(Z)
        if program.cost is None:
            return out
        traces = program.limits.ball[1] * sum(map(np.trace, Z))
        return _followed_by(out, float((cost or 0.0) - traces - program.limits.reach[1] @ z[0]))

    def factorise(self) -> None:
        """The condensed Newton matrix G'W^-2 G + sum A_k*(Z_k A_k(.) S_k^-1), and its Cholesky factor at unit diagonal."""
        # For the semidefinite blocks the direction of Helmberg, Rendl, Vanderbei and Wolkowicz (`helmberg1996`): it needs two
        # Cholesky factors where the Nesterov-Todd direction needs a singular value decomposition more, and its curvature is as
        # symmetric.
        if self._factored:
            return
        program, n = self.program, self.program.ball.size
        a, b, c = self.scaling.curvature
        inside = program.design.gram(a, b)
        if c is not None:
            together = program.design.turned(c, program.sums)
            inside += together.T @ together
        with threads_for(n):  # cores may have become busy since the last one
            inside[:n, :n] += program.ball.curvature(list(zip(self.at.Z, self.inverse, strict=True)))
            if program.cost is not None:
                inside = self._bordered(inside)
            self.matrix = inside
            if not np.diag(inside).min(initial=1) > 0:
                raise np.linalg.LinAlgError("a curvature has lost its digits")
            self.scale = 1 / np.sqrt(np.diag(inside))
            self._solve = _solver(inside * self.scale * self.scale[:, None])
        self._factored = True

    def towards(self, linear: Real) -> State:
        """The same state of a program with another linear objective: the Newton matrix is the same one."""
        other = copy.copy(self)
        other.program, other.at = dataclasses.replace(self.program, linear=linear), dataclasses.replace(self.at)
        other.residual = self._dual_residual(self.at.Z, self.at.z, linear, self.program.cost)
        other.at.dual = _size(other.residual)
        return other

    def _bordered(self, inside: Real) -> Real:
        """With the row of t."""
        program, n = self.program, self.program.ball.size
        slope, reach = program.limits.ball[1], program.limits.reach[1]
        along = self.scaling.solve_twice((reach, np.zeros(program.y.size, complex)))
        column, corner = -program.design.adjoint(along[1]), reach @ along[0]
        if slope:
            mixed = [_symmetric(Z @ inverse) for Z, inverse in zip(self.at.Z, self.inverse, strict=True)]
            column[:n] += slope * program.ball.adjoint(mixed)
            corner += slope**2 * sum(map(np.trace, mixed))
        whole = np.empty((column.size + 1, column.size + 1))
        whole[:-1, :-1], whole[-1, :-1], whole[:-1, -1], whole[-1, -1] = inside, column, column, corner
        return whole

    def solve(self, right: Real) -> Real:
        """Newton system, with one step of iterative refinement."""
        found = self.scale * self._solve(self.scale * right)
        rest = right - self.matrix @ found
        return found + self.scale * self._solve(self.scale * rest)

    def direction(self, target: list[Real], aim: Pair, gradient: Real | None = None) -> Direction:
        """DZ = target - sym(Z dS S^-1), dz = aim - W^-2 ds, and the dual equalities met by a full step.

        `gradient`: of the Lagrangian at the multipliers plus (target, aim), where it is known.
        """
        program, at, n = self.program, self.at, self.program.ball.size
        if gradient is None:
            gradient = self.residual + self._dual_residual(target, aim, 0.0, 0.0)
        step = self.solve(-gradient)
        dv, dt = (step, 0.0) if program.cost is None else (step[:-1], float(step[-1]))
        grow = program.limits.ball[1] * dt
        matrices, products = program.ball.both(dv[:n], self.inverse)
        dS = [_shifted(A, grow) for A in matrices]
        turned = [grow * inverse + product for inverse, product in zip(self.inverse, products, strict=True)]
        dZ = [goal - _symmetric(Z @ turn) for goal, Z, turn in zip(target, at.Z, turned, strict=True)]
        ds = program.limits.reach[1] * dt, -program.design.apply(dv)
        back = self.scaling.solve_twice(ds)
        return Direction(dv, dt, dS, dZ, turned, ds, (aim[0] - back[0], aim[1] - back[1]))

    def affine(self) -> Direction:
        """Straight to complementarity zero: multipliers that leave the objective alone."""
        linear, cost = self.program.linear, self.program.cost
        gradient = linear if cost is None else _followed_by(linear, cost)
        return self.direction([-Z for Z in self.at.Z], (-self.at.z[0], -self.at.z[1]), gradient)

    def centring(self, mu: float, affine: Direction) -> Direction:
        """To the point mu of the central path, with Mehrotra's second-order correction by the affine direction."""
        target = [mu * inverse - Z for Z, inverse in zip(self.at.Z, self.inverse, strict=True)]
        point, cones = self.scaling.point, self.program.cones
        squared = cones.product(point, point)
        first, second = mu - squared[0], -squared[1]
        for k in range(len(target)):
            target[k] = target[k] - _symmetric(affine.dZ[k] @ affine.turned[k])
        bend = cones.product(self.scaling.solve(affine.ds), self.scaling.apply(affine.dz))
        first, second = first - bend[0], second - bend[1]
        return self.direction(target, self.scaling.solve(cones.divide(point, (first, second))))

    def longest_steps(self, d: Direction) -> tuple[float, float]:
        """Steps of the primal and of the dual part to the border of the cones; 1.2 where they are longer."""
        return self.longest_primal(d), self._longest(self.at.z, d.dz, self.root_Z, d.dZ, self.at.Z)

    def longest_primal(self, d: Direction) -> float:
        """The step of the primal part alone."""
        return self._longest(self.s, d.ds, self.root_S, d.dS, self.S)

    def _longest(self, s: Pair, ds: Pair, roots: list[Real], directions: list[Real], whole: list[Real]) -> float:
        enough = min(self.program.cones.longest_step(s, ds), _FULL)
        for root, direction, M in zip(roots, directions, whole, strict=True):
            enough = min(enough, longest_step(root, direction, enough if self.program.quick else _FULL, M))
        return enough

    def gap_after(self, d: Direction, primal: float, dual: float) -> float:
        """<s, z> after a step."""
        return inner(
            self.program.cones,
            [S + primal * dS for S, dS in zip(self.S, d.dS, strict=True)],
            [Z + dual * dZ for Z, dZ in zip(self.at.Z, d.dZ, strict=True)],
            (self.s[0] + primal * d.ds[0], self.s[1] + primal * d.ds[1]),
            (self.at.z[0] + dual * d.dz[0], self.at.z[1] + dual * d.dz[1]),
        )


@dataclasses.dataclass(frozen=True)
class Direction:
    """Changes of all variables; `turned` holds dS S^-1 of both blocks."""

    dv: Real
    dt: float
    dS: list[Real]
    dZ: list[Real]
    turned: list[Real]
    ds: Pair
    dz: Pair

    def moved(self, at: Iterate, primal: float, dual: float) -> Iterate:
        """The iterate after these steps of the primal and of the dual part."""
        Z = [Z + dual * dZ for Z, dZ in zip(at.Z, self.dZ, strict=True)]
        z = at.z[0] + dual * self.dz[0], at.z[1] + dual * self.dz[1]
        return Iterate(at.v + primal * self.dv, at.t + primal * self.dt, Z, z)


def inner(cones: Cones, S: list[Real], Z: list[Real], s: Pair, z: Pair) -> float:
    """<S, Z> + <s, z>."""
    blocks = sum(float(np.vdot(a, b)) for a, b in zip(S, Z, strict=True))
    return blocks + float(s[0] @ z[0] + np.sum(cones.dot(s[1], z[1])))


def slacks(program: Program, v: Real, t: float) -> tuple[list[Real], Pair]:
    """The slacks S_k of the ball and (r, e) of the samples."""
    limits, n = program.limits, program.ball.size
    radius = limits.ball[0] + limits.ball[1] * t
    S = [_shifted(A, radius) for A in program.ball.matrices(v[:n])]
    return S, (limits.reach[0] + limits.reach[1] * t, program.y - program.design.apply(v))


def cholesky(M: Real) -> Real:
    """The lower Cholesky factor of a symmetric M; LinAlgError where that is not positive definite."""
    if not M.size:
        return M
    lower, indefinite = scipy.linalg.lapack.dpotrf(M, lower=1, clean=1)  # directly: called four times a Newton system
    if indefinite:
        raise np.linalg.LinAlgError("a matrix that is not positive definite")
    return np.ascontiguousarray(lower)


def inverse_of(root: Real) -> Real:
    """(L L')^-1."""
    if not root.size:
        return root
    lower, info = scipy.linalg.lapack.dpotri(root, lower=1)
    if info:
        raise np.linalg.LinAlgError("singular factor")
    whole = lower + lower.T  # above the diagonal it has the zeros of the factor
    whole.flat[:: len(whole) + 1] /= 2
    return whole


def _solver(M: Real) -> Callable[[Real], Real]:
    """M^-1 by Cholesky; where rounding has made M indefinite, with its smallest eigenvalues raised to rounding level."""
    if not M.size:
        return lambda right: right
    factor, indefinite = scipy.linalg.lapack.dpotrf(M, lower=1, clean=0)  # as in `longest_step`
    if not indefinite:
        return lambda right: scipy.linalg.lapack.dpotrs(factor, right, lower=1)[0]
    values, U = np.linalg.eigh(M)
    values = np.maximum(values, values.size * np.finfo(float).eps * values[-1])
    return lambda right: U @ ((U.T @ right) / values)


def _shifted(M: Real, radius: float) -> Real:
    """M + radius I, in the place of M."""
    M.flat[:: M.shape[0] + 1] += radius
    return M


def _followed_by(v: Real, last: float) -> Real:
    out = np.empty(v.size + 1)
    out[:-1], out[-1] = v, last
    return out


def _size(v: Real) -> float:
    return float(np.sqrt(v @ v))


def _symmetric(M: Real) -> Real:
    return (M + M.T) / 2

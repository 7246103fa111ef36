"""The best outputs C and D of a realisation, for data in blocks, and the projection that takes them out."""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from robustid.core import Complex, Real, StateMatrices, lengths
from robustid.fitting.fraction.conditions import ResponseCondition, equations, wanted
from robustid.fitting.fraction.criterion import Weight
from robustid.fitting.fraction.fraction_problem import FractionProblem
from robustid.fitting.fraction.householder import orthonormal, triangle_inverse
from robustid.fitting.state_space.block_model import BlockModel
from robustid.fitting.state_space.given_poles import diagonal_blocks
from robustid.fitting.state_space.real_modes import RealModes

LocalModel = BlockModel | RealModes
Numbers = NDArray[np.float64 | np.complex128]

_RANK = 1e-12  # columns of the outputs' problem that are this dependent count as one
_LINES = 500  # points at which the derivatives of all states are held at once
_NUMBERS = 2**17  # of the derivatives that are held at once: they stay in the cache
_EXACT = 1e-10  # a residual of this part of the weighted data is rounding
_CONTRADICTION = 1e-6  # conditions that contradict each other leave this much of themselves


class Block(NamedTuple):
    """Data at some points: ``values = P(xi) directions``, and the weight of their residual; a frequency response has no
    directions: every input alone.
    """

    at: slice | NDArray[np.int_]  # which points of the criterion
    values: Complex  # (F, ny, c)
    weight: Weight  # of that shape
    directions: Complex | None = None  # (F, m, c) of all inputs of the model
    # of a record with zero initial conditions, whose final state is no unknown; its points: the whole DFT
    samples: int = 0


@dataclasses.dataclass(frozen=True, eq=False)
class Criterion:
    """Sum over blocks of data of ``|W vec(values - P directions)|^2``, for P of a given order."""

    xi: Complex  # (F,) in the unit of the nodes, in rising order of the frequency
    blocks: tuple[Block, ...]
    order: int
    inputs: int  # the first ones of the directions; further ones (initial states) have no feed-through
    feedthrough: bool
    held: tuple[ResponseCondition, ...] = ()  # conditions that C and D must meet exactly

    @classmethod
    def of(cls, problem: FractionProblem | Criterion) -> Criterion:
        """The criterion of a frequency response: one block."""
        if isinstance(problem, Criterion):
            return problem
        block = Block(slice(None), problem.values, problem.weight)
        held = problem.response_conditions
        return cls(problem.xi, (block,), problem.order, problem.values.shape[2], problem.feedthrough, held)

    @functools.cached_property
    def equations(self) -> int:
        """Number of real equations: two for every weighted value, one where it is real."""
        real = np.abs(self.xi.imag) < _EXACT * np.abs(self.xi)
        return sum(
            int(np.sum(np.count_nonzero(block.weight.entries, axis=(1, 2)) * np.where(real[block.at], 1, 2)))
            for block in self.blocks
        )

    @functools.cached_property
    def rounding(self) -> float:
        """A criterion below this is rounding: the model passes through the data."""
        return _EXACT**2 * sum(float(np.linalg.norm(b.weight.apply(b.values))) ** 2 for b in self.blocks)


class Restriction(NamedTuple):
    """Conditions ``K u = e`` on the coordinates u of the outputs in their basis, those of all groups one after the other."""

    forbidden: Real  # (r, n): orthonormal rows that span those of K
    inverse: Real  # (n, m): pseudo-inverse of K


class Fitted(NamedTuple):
    """A model with its best outputs."""

    model: Any  # LocalModel: the kind that was given
    states: Complex  # (F, n, nu), those of initial states last
    C: Real
    D: Real
    basis: Real  # (G, rows, columns): orthonormal, what C and D reach
    residual: Real  # (G, rows)
    cost: float
    inverse: Real  # (G, columns, columns): from coordinates in the basis to [C D]
    restriction: Restriction | None = None

    @property
    def condition(self) -> float:
        """Condition number of the normal matrix of C and D in the basis that they were solved in, measured."""
        used = [Q[:, np.any(Q != 0, axis=0)] for Q in self.basis]
        if self.restriction is not None:
            used.append(self.restriction.forbidden.T)
        values = np.concatenate([np.linalg.eigvalsh(Q.T @ Q) for Q in used])
        return float(values.max() / values.min()) if values.size else 1.0

    def along(self, coordinates: Real) -> Real:
        """The part (G, columns, T) of coordinates that the conditions allow."""
        if self.restriction is None:
            return coordinates
        V = self.restriction.forbidden
        flat = coordinates.reshape(V.shape[1], -1)
        return (flat - V.T @ (V @ flat)).reshape(coordinates.shape)

    @property
    def response(self) -> Complex:
        """At the frequency points, (F, ny, nu)."""
        return self.C @ self.states[:, :, : self.D.shape[1]] + self.D

    def state_space(self, scale: float) -> StateMatrices:
        """In s or z, from the unit of the nodes; initial states are columns of B."""
        A, B, C, D = self.model.realised(self.C, self.D)
        return StateMatrices(scale * A, scale * B, C, D)


class Outputs:
    """The best C and D for given states, and the projection that takes them out of a Jacobian. Where the weight is one number
    an entry, every output has a least-squares problem of its own (G = ny); else they share one (G = 1).
    """

    def __init__(self, problem: FractionProblem | Criterion) -> None:
        self.criterion = criterion = Criterion.of(problem)
        weights = [block.weight for block in criterion.blocks]
        self.ny = criterion.blocks[0].values.shape[1]
        self.apart = all(weight.entries_only for weight in weights)
        self.alike = self.apart and all(bool(np.all(w.entries == w.entries[:, :1])) for w in weights)
        self.target = self.rows([block.values[..., None] for block in criterion.blocks])[..., 0]

    def rows(self, changes: Sequence[Numbers]) -> Real:
        """Weighted changes (F, ny, c, T) of the blocks' values, real parts over imaginary ones: (G, rows, T)."""
        pairs = zip(self.criterion.blocks, changes, strict=True)
        return self._joined([self._weighted(block, change) for block, change in pairs])

    def _weighted(self, block: Block, change: Numbers, part: slice = slice(None)) -> Numbers:
        """Weighted changes of a block's values at a part of its points, from (F, ny, c, T): (G, F, rows of one point, T)."""
        if self.apart:
            return (block.weight.entries[part][..., None] * change).transpose(1, 0, 2, 3)
        weight = block.weight if part == slice(None) else block.weight.select(part)
        return weight.apply_all(change)[None]

    def _joined(self, parts: Sequence[Numbers]) -> Real:
        """Weighted columns (G, F, rows of one point, T) of the blocks, real parts over imaginary ones: (G, rows, T)."""
        return np.concatenate([_real(part.reshape(len(part), -1, part.shape[3])) for part in parts], axis=1)

    def design(self, model: LocalModel, states: Complex) -> Real:
        """Weighted response (G, rows, columns) of every coefficient of [C D], row by row or column by column."""
        stack: list[Numbers] = []
        for block in self.criterion.blocks:
            rows = self._seen(block, model, states).transpose(0, 2, 1)
            lines, ny, count = block.values.shape
            if self.criterion.feedthrough:
                through = np.broadcast_to(np.eye(count), (lines, count, count))
                if block.directions is not None:
                    through = block.directions[:, : self.criterion.inputs].transpose(0, 2, 1)
                rows = np.concatenate([rows, through], axis=2)
            if self.apart:
                entries = block.weight.entries[:, : 1 if self.alike else ny]
                stack.append(entries.transpose(1, 0, 2)[..., None] * rows)
            else:
                one = np.broadcast_to(np.eye(ny), (lines, ny, ny))
                stack.append(block.weight.linearised(rows, one)[None])
        return self._joined(stack)

    def fitted(self, model: LocalModel) -> Fitted:
        """The model with its best outputs; of infinite cost where a pole lies on a frequency point."""
        with np.errstate(all="ignore"):
            states = model.states(self.criterion.xi)
        no_feedthrough = np.zeros((self.ny, self.criterion.inputs))
        if not np.all(np.isfinite(states)):
            nothing = np.zeros((1, 0, 0))
            C = np.zeros((self.ny, model.order))
            return Fitted(model, states, C, no_feedthrough, nothing, self.target, math.inf, nothing)
        basis, inverse = _orthonormal(self.design(model, states))
        u = basis.transpose(0, 2, 1) @ self.target[..., None]
        restriction, allowed = None, True
        if self.criterion.held:
            restriction, u, allowed = self._restricted(model, inverse, u)
        residual = self.target - (basis @ u)[..., 0]
        matrix = self.matrix(model, (inverse @ u)[..., 0])
        D = matrix[:, model.order :] if self.criterion.feedthrough else no_feedthrough
        cost = float(np.sum(residual**2)) if allowed else math.inf
        return Fitted(model, states, matrix[:, : model.order], D, basis, residual, cost, inverse, restriction)

    def matrix(self, model: LocalModel, coefficients: Real) -> Real:
        """[C D] of the coefficients (G, columns) that `design` belongs to."""
        del model
        return coefficients if self.apart else coefficients.reshape(-1, self.ny).T

    def _restricted(self, model: Any, inverse: Real, u: Real) -> tuple[Restriction, Real, bool]:
        """Directions that the conditions forbid, the nearest coordinates that meet them, and whether any do; the coordinates
        are orthonormal, so that the nearest ones raise the criterion least.
        """
        with np.errstate(all="ignore"):
            rows = equations(self.criterion.held, model, self.criterion.feedthrough)
        if not np.all(np.isfinite(rows)):  # a pole on the point of a condition
            return Restriction(np.zeros((0, u.size)), np.zeros((u.size, len(rows)))), u, False
        inverse = np.broadcast_to(inverse, (u.shape[0], *inverse.shape[1:]))
        K: Real = (
            np.einsum("mgx,gxu->mgu", rows, inverse).reshape(len(rows), -1)
            if self.apart
            else rows.transpose(0, 2, 1).reshape(len(rows), -1) @ inverse[0]
        )
        size = lengths(K, axis=1)
        U, sizes, Vt = np.linalg.svd(K / size[:, None], full_matrices=False)
        kept = sizes > _RANK * sizes.max(initial=0.0)
        V = Vt[kept]
        pseudo = (V.T / sizes[kept]) @ U[:, kept].T / size
        e, flat = wanted(self.criterion.held), u.ravel()
        for _ in range(2):  # the second pass takes away what rounding left of the first
            flat = flat - pseudo @ (K @ flat - e)
        left = np.abs(K @ flat - e)
        allowed = bool(np.all(left <= _CONTRADICTION * (np.abs(e) + size * np.linalg.norm(flat))))
        return Restriction(V, pseudo), flat.reshape(u.shape), allowed

    def directions(self, fitted: Fitted) -> Real:
        """Weighted derivatives (rows, T) of the response in the coordinates of the model, outputs taken out; conditions turn
        with the model, and the outputs follow them by the least change.
        """
        changes = self.changes(fitted)
        Q = fitted.basis
        taken = fitted.along(Q.transpose(0, 2, 1) @ changes)
        if fitted.restriction is not None:
            turned = np.concatenate([c.changes(fitted.model, fitted.C) for c in self.criterion.held])
            taken = taken + (fitted.restriction.inverse @ turned).reshape(taken.shape)
        changes -= Q @ taken
        return changes.reshape(-1, changes.shape[2])

    def changes(self, fitted: Fitted) -> Real:
        """Weighted derivatives (G, rows, T) of the response in the coordinates of the model, outputs held."""
        return np.concatenate([self._changes(block, fitted) for block in self.criterion.blocks], axis=1)

    def importance(self, fitted: Fitted) -> Real:
        """Rise of the criterion when a block of two poles is taken away and the outputs are fitted anew, (m,)."""
        coefficients, width = self.by_blocks(fitted)
        groups, columns = coefficients.shape[0], fitted.inverse.shape[2]
        inverse = np.broadcast_to(fitted.inverse, (groups, *fitted.inverse.shape[1:]))
        V = None if fitted.restriction is None else fitted.restriction.forbidden.reshape(-1, groups, columns)
        out = np.zeros(fitted.model.centre.size)
        for block in range(out.size):
            here = slice(block * width, (block + 1) * width)
            S, c = inverse[:, here], coefficients[:, here, None]
            if V is None:
                out[block] = _risen(S @ S.transpose(0, 2, 1), c)
            else:
                SV = np.einsum("gwu,rgu->gwr", S, V).reshape(groups * width, -1)
                gram = diagonal_blocks(*(S @ S.transpose(0, 2, 1))) - SV @ SV.T
                own = np.asarray(np.linalg.pinv(gram, hermitian=True), dtype=float)
                out[block] = float(c.ravel() @ own @ c.ravel())
        return out

    def by_blocks(self, fitted: Fitted) -> tuple[Real, int]:
        """Coefficients of C (G, columns), and how many belong to a block of poles."""
        if self.apart:
            return fitted.C, fitted.model.width
        return fitted.C.T.reshape(1, -1), fitted.model.width * self.ny

    def residuals(self, fitted: Fitted) -> list[Complex]:
        """``values - P directions`` of the blocks, without their weights."""
        out: list[Complex] = []
        for block in self.criterion.blocks:
            through = fitted.D if block.directions is None else fitted.D @ block.directions[:, : self.criterion.inputs]
            out.append(block.values - fitted.C @ self._seen(block, fitted.model, fitted.states) - through)
        return out

    def _seen(self, block: Block, model: Any, states: Complex) -> Complex:
        """States (F, n, c) that the inputs of a block drive."""
        states = states[block.at] if block.directions is None else states[block.at] @ block.directions
        if not block.samples:
            return states
        xi = self.criterion.xi[block.at]
        final = _final(model, _sum(states[..., 0], block.samples)[:, None], block.samples)
        return states - xi[:, None, None] * model.driven(final).states(xi)

    def _changes(self, block: Block, fitted: Fitted) -> Real:
        """Weighted derivatives (G, rows, T) of what a block sees in the coordinates of the model, outputs held; by parts of the
        points that stay in the cache.
        """
        xi, model = self.criterion.xi[block.at], fitted.model
        states = self._seen(block, model, fitted.states)
        final = self._final_changes(block, model, states) if block.samples else None
        out = np.zeros((0, 0, 0, 0, 0))
        size = max(_NUMBERS // (block.values[0].size * model.order * self.criterion.inputs), 1)
        for first in range(0, xi.size, size):
            part = slice(first, first + size)
            directions = None if block.directions is None else block.directions[part]
            change = model.tangent(xi[part], states[part], fitted.C, directions)
            if final is not None:
                change -= (xi[part, None, None] * model.output_rows(xi[part], fitted.C) @ final)[:, :, None]
            weighted = self._weighted(block, change, part)
            if not out.size:
                out = np.empty((len(weighted), 2, xi.size, *weighted.shape[2:]))
            out[:, 0, part], out[:, 1, part] = weighted.real, weighted.imag
        return out.reshape(len(out), -1, out.shape[-1])

    def _final_changes(self, block: Block, model: BlockModel, states: Complex) -> Real:
        """Derivatives (n, T) of the final states of a record from zero initial conditions."""
        xi = self.criterion.xi[block.at]
        total = np.zeros((model.order, 1))
        for first in range(0, xi.size, _LINES):
            part, own = slice(first, first + _LINES), np.eye(model.order)
            directions = None if block.directions is None else block.directions[part]
            whole = model.tangent(xi[part], states[part], own, directions)[:, :, 0]
            total = total + _sum(whole, block.samples, first)
        return _final(model, total, block.samples)


def _orthonormal(design: Real) -> tuple[Real, Real]:
    """An orthonormal basis (G, rows, columns) of the columns, and the matrices that bring its coordinates back to theirs."""
    Q, R = orthonormal(design)
    size = lengths(R, axis=1, keepdims=True)
    scaled = R / size
    if R.shape[1] == R.shape[2]:
        with np.errstate(all="ignore"):
            regular = np.all(np.diagonal(R, axis1=1, axis2=2))
            inverse = np.array([triangle_inverse(upper) for upper in scaled]) if regular else np.full(R.shape, np.inf)
            # |R| |R^-1| in the norm of Frobenius: no more than that many columns away from the condition number
            conditions = np.linalg.norm(scaled, axis=(1, 2)) * np.linalg.norm(inverse, axis=(1, 2))
        if np.all(conditions < 1 / _RANK):
            return Q, inverse / size.transpose(0, 2, 1)
    U, sizes, Vt = np.linalg.svd(scaled, full_matrices=False)
    kept = sizes > _RANK * sizes[:, :1]
    inverse = np.where(kept, 1 / np.where(kept, sizes, 1.0), 0.0)
    return Q @ (U * kept[:, None]), Vt.transpose(0, 2, 1) * inverse[:, None] / size.transpose(0, 2, 1)


def _final(model: BlockModel, periodic: Real, samples: int) -> Real:
    """Final states (n, T), over sqrt(N), of a record from zero initial conditions: periodic states that begin at p belong to
    the final state ``(I - A^N) p`` of those that begin at zero.
    """
    A = model.matrices()[0]
    return (periodic - np.linalg.matrix_power(A, samples) @ periodic) / math.sqrt(samples)


def _sum(spectrum: Complex, samples: int, first: int = 0) -> Real:
    """Contribution of a half DFT (F, ...), or of a part of it from a line on, to the first sample."""
    lines = first + np.arange(len(spectrum))
    single = (lines == 0) | (2 * lines == samples)
    return np.tensordot(np.where(single, 1.0, 2.0), spectrum.real, axes=1) / math.sqrt(samples)


def _real(rows: Numbers) -> Real:
    """Real parts over imaginary ones, (G, 2 rows, T)."""
    return np.concatenate([np.real(rows), np.imag(rows)], axis=1)


def _risen(gram: Real, c: Real) -> float:
    """``c^T gram^-1 c``, summed; poles that a part of the data does not see cost nothing there."""
    try:
        return float(np.sum(c * np.linalg.solve(gram, c)))
    except np.linalg.LinAlgError:
        return float(np.sum(c * (np.linalg.pinv(gram, hermitian=True) @ c)))

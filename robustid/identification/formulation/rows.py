"""The measurements as linear equations in the unknowns, in units of their bounds."""

# pyright: reportConstantRedefinition=false
# Matrices have capital letters.
from __future__ import annotations

import dataclasses
import functools

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from robustid.core import Array, Frozen, Numbers, Real, decoupled_parts, freeze, real_rows, singular_parts
from robustid.errors import InputError, Remedy, SizeError
from robustid.identification.formulation.assembly import Assembly, Block
from robustid.identification.formulation.columns import BlockColumns, ColumnPart, Columns
from robustid.identification.formulation.functions import Functions
from robustid.identification.problem import MixedProblem

_MOST_NUMBERS = 2**26  # in the equations of the parameters, half a gigabyte, of which there are several copies


@dataclasses.dataclass(frozen=True, eq=False)
class Rows(Frozen):
    """Residuals e = y - E x - P p of all samples, each divided by its bound: sample k is kept if |e_k| <= 1.

    Complex samples come first; imaginary parts of real samples are zero throughout, so that one formula serves both.
    """

    # Where a bound is an ellipse, e stands for e + kappa conj(e), in its y, E and P alike: linear in the real unknowns. Where a
    # bound holds for several samples together, they are one cone: kept if the norm of their e is at most 1. A system with the
    # coefficients x has the residuals e - d with ||d_k|| <= tail_k: what its other coefficients can do.

    y: Numbers  # (N,)
    E: Columns  # (N, n), of the coefficients x of G/K in the orthonormal basis
    # (N, m), of the parameters, then of the free transients; columns scaled by powers of two (`column_scale`).
    P: Array
    fixed: Real  # (M,), part of each (unit) bound that does not grow with K; below 1 only where an unknown past input widens it
    tail: Real  # (M,), zero where n coefficients determine the samples (the exact form)
    discs: int  # number of complex samples
    column_scale: Real  # (m,)
    parameters: int  # how many of the columns of P are parameters
    ends: Real  # (m, 2), lower and upper end of every scaled parameter, known beforehand; -inf and inf where it is free
    # (N,), number of the bound to which a sample belongs; None where every sample has its own, M = N.
    cone: NDArray[np.intp] | None = None
    reach: float = 1.0  # largest norm of x, of functions of the unit ball

    def __post_init__(self) -> None:
        self._set(**{n: freeze(getattr(self, n)) for n in ("y", "P", "fixed", "tail", "column_scale", "ends")})
        self._set(cone=None if self.cone is None else freeze(self.cone))

    @property
    def held(self) -> NDArray[np.bool_]:
        """Mask of the parameters that have an interval, (m,)."""
        return np.isfinite(self.ends[:, 0])

    @property
    def cones(self) -> int:
        """Number M of bounds."""
        return self.tail.size

    @functools.cached_property
    def free_singular(self) -> tuple[float, float]:
        """Largest and smallest singular value of the columns of the parameters without an interval, as real ones."""
        free = self.P[:, ~self.held]
        parts = [real_rows(free[np.ix_(at, columns)]) for at, columns in decoupled_parts(free)]
        sizes = [
            np.append(np.linalg.svd(one, compute_uv=False), np.zeros(max(0, one.shape[1] - len(one)))) for one in parts
        ]
        return max(float(one[0]) for one in sizes), min(float(one[-1]) for one in sizes)

    def within(self, p: Real) -> bool:
        """Say whether every scaled parameter is in its interval."""
        return bool(np.all((self.ends[:, 0] <= p) & (p <= self.ends[:, 1])))

    def real(self, a: Numbers) -> Real:
        """Real rows of an array of complex ones: real parts of all samples, then imaginary parts of the discs."""
        return np.concatenate([np.real(a), np.imag(a[: self.discs])])

    def sizes(self, e: Numbers) -> Real:
        """|e| of every bound, the norm of the samples that share it, (M,)."""
        if self.cone is None:
            return np.abs(e)
        return np.sqrt(np.bincount(self.cone, np.real(e) ** 2 + np.imag(e) ** 2, minlength=self.cones))

    def ratio(self, x: Real, p: Real) -> Real:
        """Upper bound of |residual|/bound, (M,), for every system with coefficients x and scaled parameters p."""
        return self.sizes(self.y - self.E @ x - self.P @ p) + self.tail


def measurement_rows(functions: Functions) -> Rows:
    """All samples of the problem as `Rows`, seen through the functions of a formulation."""
    return _stacked(functions.problem, experiment_blocks(functions), functions)


def check_equations(samples: int, entries: int, functions: int) -> None:
    """Refuse so many parametric functions for every entry where no memory holds their equations in the samples of all."""
    numbers = 2 * samples * entries * functions
    if numbers > _MOST_NUMBERS:
        part = "thin the data, frf.select(slice(None, None, step))"
        raise SizeError(
            f"`problem` has {entries} entries and {samples} samples: the equations of {functions} functions for every entry are"
            f" {8e-9 * numbers:.2g} GB, {8e-9 * _MOST_NUMBERS:.2g} GB are possible. ",
            Remedy(
                {}, part.capitalize() if entries == 1 else f"Take single entries, frf.entry(output, input), or {part}"
            ),
        )


def experiment_blocks(functions: Functions) -> list[Block]:
    """The rows of all experiments of the problem, responses first."""
    problem = functions.problem
    if problem.parametric is not None:
        check_equations(problem.samples, problem.entries.count, problem.parametric.size)
    assembly = Assembly(problem, functions)
    blocks = [block for frf in problem.frequency for block in assembly.lines(frf)]
    for record in problem.time:
        make = assembly.periodic if record.initial == "periodic" else assembly.transient
        for output in range(record.y.shape[1]):
            if np.any(record.bound.used[:, output]):
                blocks.append(make(record, output))
    return blocks


def _stacked(problem: MixedProblem, blocks: list[Block], functions: Functions) -> Rows:
    """All blocks as one system."""
    entries = problem.entries
    free = scipy.linalg.block_diag(*(b.free for b in blocks))
    P = np.vstack([b.P for b in blocks])  # the largest array of all: a copy that is changed in place
    if free.shape[1]:
        P = np.hstack([P, free])
    y = np.concatenate([b.y for b in blocks])
    E = _joined(blocks, functions.count * entries.count, functions)
    magnitudes = np.abs(P)
    sizes = [float(magnitudes.max(initial=0.0)), float(np.abs(y).max(initial=0.0)), E.norm]
    if not max(sizes) < 1e100:
        raise InputError(
            "`bound` is too small against the data (or a basis function is infinite at a sample): their ratio is"
            f" {max(sizes):.3g}; give bounds that the measurement deserves"
        )
    norms: Real = np.linalg.norm(magnitudes, axis=0)
    if np.any(norms == 0):
        name = _parameter_name(problem, int(np.argmin(norms)))
        raise InputError(f"`parametric`: function {name} does not act on any sample; remove it, or add samples")
    powers: Real = np.log2(norms)
    scale = 2.0 ** np.round(powers)
    P /= scale
    parameters = 0 if problem.parametric is None else problem.parametric.size * entries.count
    ends = np.tile([-np.inf, np.inf], (P.shape[1], 1))
    if problem.parameter_bounds is not None:
        ends[:parameters] = problem.unknown_bounds * scale[:parameters, None]
    _check_independent(problem, P, np.flatnonzero(np.isinf(ends).any(axis=1)))
    fixed, tail = (np.concatenate(parts) for parts in zip(*((b.fixed, b.tail) for b in blocks), strict=True))
    discs = sum(b.y.size for b in blocks if b.complex)
    return Rows(y, E, P, fixed, tail, discs, scale, parameters, ends, _cones(blocks), entries.reach)


def _cones(blocks: list[Block]) -> NDArray[np.intp] | None:
    """Number of the bound of every sample; None where each has its own."""
    if not any(block.joins for block in blocks):
        return None
    first, total = 0, 0
    numbers: list[NDArray[np.intp]] = []
    for block in blocks:
        first = first if block.joins else total
        total += block.tail.size
        numbers.append(first + block.cone)
    return np.concatenate(numbers)


def _joined(blocks: list[Block], width: int, functions: Functions) -> Columns:
    """The columns of all blocks, in one piece where they all act on all coefficients in one way."""
    if all(block.columns == slice(0, width) for block in blocks):
        lines, real = ([block.E for block in blocks if block.complex is kind] for kind in (True, False))
        if (together := functions.joined(lines, real)) is not None:
            return together
    parts: list[ColumnPart] = []
    row = 0
    for block in blocks:
        parts.append(ColumnPart(slice(row, row + block.y.size), block.columns, block.E))
        row += block.y.size
    return BlockColumns(tuple(parts), (row, width))


def _parameter_name(problem: MixedProblem, column: int) -> str:
    """Name of a column of P in messages."""
    basis, entries = problem.parametric, problem.entries
    if basis is None or column >= basis.size * entries.count:
        return "of a transient"
    label = basis.labels[column % basis.size]
    if entries.single:  # the user counts the functions
        return f"number {column} ({label})"
    output, input = (int(k) for k in np.argwhere(entries.basis[column // basis.size])[0])
    return f"{label} of the entry from {problem.inputs[input].name} to {problem.outputs[output].name}"


def _check_independent(problem: MixedProblem, P: Numbers, free: NDArray[np.intp]) -> None:
    """Coefficients without an interval must be told apart by the data: else they, and the sets, are unbounded."""
    P = P if free.size == P.shape[1] else P[:, free]
    if not P.shape[1]:
        return
    levels, weakest = np.zeros(0), (np.inf, free[:0])
    for rows, columns in decoupled_parts(P):  # hundreds of entries, each in samples of its own
        stacked = real_rows(P[np.ix_(rows, columns)])
        _, singular, directions = singular_parts(stacked / np.linalg.norm(stacked, axis=0))
        levels = np.append(levels, singular)
        least = singular[-1] if singular.size == columns.size else 0.0
        if least < weakest[0]:
            weakest = least, free[columns[np.abs(directions[-1]) > 0.1]]
    rank = int(np.sum(levels > 1e-10 * levels.max(initial=0.0)))
    if rank < P.shape[1]:
        involved = weakest[1]
        own = problem.parametric.size * problem.entries.count if problem.parametric is not None else 0
        names = ", ".join(_parameter_name(problem, i) for i in involved if i < own)
        raise InputError(
            f"`parametric`: the data cannot tell its {P.shape[1]} functions (transients included) apart: their rank on the"
            f" samples is {rank}. Linearly dependent: {names}. Remove one of them, or add samples"
        )

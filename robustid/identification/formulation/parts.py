"""Entries of a matrix that no sample sees together with others: smaller problems, whose proofs are proofs about the whole."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from robustid.core import Frozen, Real
from robustid.identification.entries import Entries
from robustid.identification.formulation.columns import BlockColumns, ColumnPart, Columns, DenseColumns
from robustid.identification.formulation.convex import ConvexData
from robustid.identification.formulation.rows import Rows

_LONG = 200  # coefficients from which on structured columns are quicker than stored ones

Index = NDArray[np.intp]


@dataclasses.dataclass(frozen=True, eq=False)
class Part(Frozen):
    """The problem of some outputs and inputs alone, of their samples and of the ball of their block of the matrix."""

    # Blocks of contractions are contractions: the entries of whatever is consistent with all data are in this set too. So an
    # upper bound over it is one over the consistent systems, and its multipliers, with zeros for all other samples and blocks,
    # prove it there. Nothing is lost where the ball does not tie the entries together.

    data: ConvexData
    samples: Index  # which samples, coefficients and parameters of the whole problem its own are
    x: Index
    p: Index
    # A coefficient of the whole problem times this is one of the part: below 1 off the diagonal of symmetric matrices
    factor: float
    outputs: Index
    inputs: Index
    whole: tuple[int, int, int]  # number of samples, outputs and inputs of the whole problem

    def sees(self, x: Real, p: Real) -> bool:
        """Say whether weights of coefficients and parameters of the whole are zero outside of the part."""
        return np.count_nonzero(x) == np.count_nonzero(x[self.x]) and np.count_nonzero(p) == np.count_nonzero(p[self.p])

    def weights(self, x: Real, p: Real) -> tuple[Real, Real]:
        """Weights of the whole as weights of the part."""
        return x[self.x] / self.factor, p[self.p]

    def restricted(self, x: Real, p: Real) -> tuple[Real, Real]:
        """Coefficients and parameters of the whole as those of the part."""
        return x[self.x] * self.factor, p[self.p]

    def replaced(self, x: Real, p: Real, mine: tuple[Real, Real]) -> tuple[Real, Real]:
        """Coefficients and parameters of the whole with those of the part in their places."""
        x, p = x.copy(), p.copy()
        x[self.x], p[self.p] = mine[0] / self.factor, mine[1]
        return x, p

    def lifted(
        self, samples: NDArray[np.complex128], left: Real, right: Real
    ) -> tuple[NDArray[np.complex128], Real, Real]:
        """Multipliers of the part as multipliers of the whole: those of the samples, and the factors of Y."""
        count, p, q = self.whole
        everywhere = np.zeros(count, complex)
        everywhere[self.samples] = samples
        return everywhere, _spread(left, self.outputs, p), _spread(right, self.inputs, q)


def _spread(factor: Real, places: Index, signals: int) -> Real:
    """Rows (coefficient, signal) of a factor of Y, in the order of all signals."""
    order, rank = factor.shape[0] // places.size, factor.shape[1]
    out = np.zeros((order, signals, rank))
    out[:, places] = factor.reshape(order, places.size, rank)
    return out.reshape(order * signals, rank)


def parts_of(data: ConvexData) -> tuple[Part, ...]:
    """The parts of a problem, block by block; none where samples tie all entries together."""
    entries = data.sarason.entries
    if entries.single or not data.sarason.entrywise or not isinstance(data.rows.E, BlockColumns):
        return ()
    rows, count, order = data.rows, data.sarason.entries.count, data.sarason.pair.order
    size = max(rows.parameters // count, 1)
    groups = [_Group({number}) for number in range(count)]
    for part in data.rows.E.parts:
        found = _Group(set(range(part.columns.start // order, part.columns.stop // order)))
        if part.block.stored and len(found.numbers) > 1:
            seen = np.any(part.block.dense() != 0, axis=0).reshape(-1, order).any(axis=1)
            found = _Group({number for number, some in zip(sorted(found.numbers), seen, strict=True) if some})
        columns = np.flatnonzero(np.any(rows.P[part.rows] != 0, axis=0)).tolist()
        found.take(_Group({c // size for c in columns if c < rows.parameters}))
        found.transients |= {c for c in columns if c >= rows.parameters}
        for other in [group for group in groups if group.touches(found)]:
            found.take(other)
            groups.remove(other)
        groups.append(found)
    groups = _blocks(groups, entries)
    return tuple(_part(data, data.rows.E, group) for group in groups) if len(groups) > 1 else ()


@dataclasses.dataclass
class _Group:
    """Numbers of unknown entries, and columns of transients, that samples see together."""

    numbers: set[int]
    transients: set[int] = dataclasses.field(default_factory=set[int])

    def touches(self, other: _Group) -> bool:
        return bool(self.numbers & other.numbers or self.transients & other.transients)

    def take(self, other: _Group) -> None:
        self.numbers |= other.numbers
        self.transients |= other.transients


def _blocks(groups: list[_Group], entries: Entries) -> list[_Group]:
    """Groups that fill the block of their outputs and inputs, in order; of symmetric matrices single unknowns, or none."""
    if entries.symmetric and any(len(group.numbers) > 1 for group in groups):
        return []
    merged: list[_Group] = []
    while groups:
        group = groups.pop()
        if not entries.symmetric:
            outputs, inputs = zip(*(divmod(number, entries.inputs) for number in group.numbers), strict=True)
            group.numbers = {i * entries.inputs + j for i in set(outputs) for j in set(inputs)}
        others = [other for other in groups + merged if other.touches(group)]
        if not others:
            merged.append(group)
            continue
        for other in others:
            group.take(other)
            (groups if other in groups else merged).remove(other)
        groups.append(group)
    return sorted(merged, key=lambda group: min(group.numbers))


def _part(data: ConvexData, E: BlockColumns, group: _Group) -> Part:
    rows, sarason, entries, order = data.rows, data.sarason, data.sarason.entries, data.sarason.pair.order
    size, numbers = rows.parameters // entries.count, sorted(group.numbers)
    places = np.array(
        [np.argwhere(entries.basis[number])[0] for number in numbers]
    )  # above the diagonal of symmetric ones
    outputs, inputs = (np.unique(axis) for axis in places.T)
    own, factor = Entries(outputs.size, inputs.size), entries.place(*places[0].tolist())[1]
    x = np.concatenate([number * order + np.arange(order) for number in numbers])
    p = np.array([number * size + k for number in numbers for k in range(size)] + sorted(group.transients), int)
    mine = [part for part in E.parts if np.isin(_range(part), x).any()]
    columns: Columns
    samples: Index
    if factor == 1 and order >= _LONG and len(mine) == 1 and np.array_equal(_range(mine[0]), x):
        samples = np.arange(mine[0].rows.start, mine[0].rows.stop, dtype=np.intp)
        columns = mine[0].block
    else:
        stored = np.zeros((rows.y.size, x.size), complex)
        for part in mine:
            stored[part.rows, np.isin(x, _range(part))] = part.block.dense()[:, np.isin(_range(part), x)]
        samples = np.flatnonzero(np.any(stored != 0, axis=1) | np.any(rows.P[:, p] != 0, axis=1))
        columns = DenseColumns(stored[samples] / factor)
    fixed, tail, cone = _bounds(rows, samples)
    P, discs = rows.P[np.ix_(samples, p)], int(np.count_nonzero(samples < rows.discs))
    scale, ends = rows.column_scale[p], rows.ends[p]
    smaller = Rows(rows.y[samples], columns, P, fixed, tail, discs, scale, size * len(numbers), ends, cone, own.reach)
    whole = rows.y.size, entries.outputs, entries.inputs
    return Part(ConvexData(smaller, sarason.of(own)), samples, x, p, factor, outputs, inputs, whole)


def _range(part: ColumnPart) -> Index:
    """Numbers of the coefficients that it acts on."""
    return np.arange(part.columns.start, part.columns.stop, dtype=np.intp)


def _bounds(rows: Rows, samples: Index) -> tuple[Real, Real, Index | None]:
    """`fixed`, `tail` and `cone` of some samples: bounds that several share stay shared by those that are left."""
    if rows.cone is None:
        return rows.fixed[samples], rows.tail[samples], None
    cones, index = np.unique(rows.cone[samples], return_inverse=True)
    if cones.size < samples.size:
        return rows.fixed[cones], rows.tail[cones], index
    alone = rows.cone[samples]
    return rows.fixed[alone], rows.tail[alone], None

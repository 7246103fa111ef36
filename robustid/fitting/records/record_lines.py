"""Records as tangential frequency data: spectra, transients as further inputs, and the criterion that they make."""

from __future__ import annotations

import dataclasses
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from robustid.core import Complex, Real
from robustid.data import TimeRecord
from robustid.fitting.fraction.criterion import Weight
from robustid.fitting.fraction.householder import triangle
from robustid.fitting.fraction.problem import FractionProblem
from robustid.fitting.state_space.outputs import Block, Criterion, Fitted, Outputs
from robustid.fitting.state_space.state_fit import output_rows, real_rows, solution_in_units

_LEAST_LEVEL = 1e-9  # part of an output below which its residual is rounding


class Lines(NamedTuple):
    """Half of the unitary DFT of a record, Parseval's factors, and the column of its initial state."""

    angles: Real  # (F,), from 0 to at most pi
    u: Complex  # (F, nu), in units of the input
    y: Complex  # (F, ny)
    factor: Real  # (F,): sqrt(2) where a line stands for two; 0 where an offset takes it
    samples: int
    initial: str
    column: int | None  # of the directions; None where no initial state is estimated


@dataclasses.dataclass(frozen=True, eq=False)
class Experiments:
    """Records, and a frequency response beside them, in the units in which they are fitted.

    With ``z_k = exp(2 pi i k/N)`` the unitary DFTs of N samples satisfy exactly

    ``Y(k) = P(z_k) U(k) + C (z_k I - A)^{-1} z_k b``,  ``sqrt(N) b = x(0) - x(N)``

    and b is one to one with x(0), as ``I - A^N`` is regular. So a sum of squares over all samples is the same sum over all
    lines (Parseval), and a transient is one input more, of spectrum z_k. From zero initial conditions b is known:
    ``Block.samples``. In periodic steady state it is zero.

    Attributes
    ----------
    lines : tuple of Lines
    unit : (nu,) array
        Root mean square of the inputs, to a power of two: the transient's columns have that size, too.
    size : (ny,) array
        Root mean square of the outputs over all records.
    order : int
    feedthrough : bool
    response : FractionProblem or None
        Of the frequency response, in units of the outputs over those of the inputs `unit`.
    exact : bool
        Whether its weight is that of a covariance that is known.
    """

    lines: tuple[Lines, ...]
    unit: Real
    size: Real
    order: int
    feedthrough: bool
    response: FractionProblem | None = None
    exact: bool = False

    @property
    def inputs(self) -> int:
        """Number of inputs of the model with those of the initial states."""
        return self.unit.size + sum(line.column is not None for line in self.lines)

    def criterion(self, levels: Real, response_level: float) -> Criterion:
        """The residuals in units of levels (ny,) of the records' outputs, and of a level of the weighted response."""
        angles = [line.angles for line in self.lines]
        if self.response is not None:
            angles.append(np.angle(self.response.xi))
        grid, places = np.unique(np.concatenate(angles), return_inverse=True)
        at = np.split(places, np.cumsum([part.size for part in angles])[:-1])
        xi = np.exp(1j * grid)
        blocks = [self._block(line, here, xi[here], levels) for line, here in zip(self.lines, at, strict=False)]
        if self.response is not None:
            weight = self.response.weight
            weight = weight.scaled(np.full(weight.shape[0], math.sqrt(2) / response_level))
            direct = np.broadcast_to(np.eye(self.inputs, self.unit.size), (at[-1].size, self.inputs, self.unit.size))
            blocks.append(Block(at[-1], self.response.values, weight, direct.astype(complex)))
        return Criterion(xi, tuple(blocks), self.order, self.unit.size, self.feedthrough)

    def _block(self, line: Lines, at: NDArray[np.int_], xi: Complex, levels: Real) -> Block:
        directions = np.zeros((xi.size, self.inputs, 1), dtype=complex)
        directions[:, : self.unit.size, 0] = line.u
        if line.column is not None:
            directions[:, line.column, 0] = xi
        entries = line.factor[:, None, None] / levels[:, None]
        return Block(at, line.y[..., None], Weight(entries), directions, line.samples if line.initial == "rest" else 0)

    def levels(self, outputs: Outputs, fitted: Fitted) -> tuple[Real, float]:
        """Levels of the residual: of every output over all records, and of the response in its own weight."""
        residuals = outputs.residuals(fitted)
        square, count = np.zeros(self.size.size), 0
        for line, residual in zip(self.lines, residuals, strict=False):
            square += np.sum((line.factor[:, None] * np.abs(residual[..., 0])) ** 2, axis=0)
            count += line.samples
        levels = np.maximum(np.sqrt(square / count), _LEAST_LEVEL * self.size)
        if self.response is None or self.exact:
            return levels, 1.0
        weight = self.response.weight
        size = np.linalg.norm(weight.apply(self.response.values))
        level = max(float(np.linalg.norm(weight.apply(residuals[-1]))), _LEAST_LEVEL * float(size))
        return levels, level / math.sqrt(np.count_nonzero(weight.entries))

    def height(self, outputs: Outputs, fitted: Fitted) -> float:
        """Twice the negative logarithm of the likelihood, but for a constant, with the levels of the criterion."""
        first, *_ = outputs.criterion.blocks
        records = sum(line.samples for line in self.lines)
        total = fitted.cost - 2 * records * float(np.sum(np.log(np.max(first.weight.entries[:, :, 0], axis=0))))
        if self.response is None or self.exact:
            return total
        weight, own = outputs.criterion.blocks[-1].weight, self.response.weight
        ratio = np.max(weight.entries) / np.max(own.entries)
        return total - 2 * np.count_nonzero(own.entries) * 2 * math.log(ratio)


def spectra(record: TimeRecord, unit: Real, column: int | None, offset: bool) -> Lines:
    """The spectral lines of a record; where an offset is estimated, the line at zero frequency has no weight."""
    samples = len(record.u)
    u = np.fft.rfft(record.u / unit, axis=0, norm="ortho")
    y = np.fft.rfft(record.y, axis=0, norm="ortho")
    k = np.arange(len(u))
    factor = np.where((k == 0) | (2 * k == samples), 1.0, math.sqrt(2))
    if offset:
        factor[0] = 0.0
    return Lines(2 * np.pi * k / samples, u, y, factor, samples, record.initial, column)


def fit_driven(criterion: Criterion, A: Real, C: Real) -> Real:
    """The best inputs B of a model with these poles and outputs, (n, m) with the columns of the initial states.

    Linear least squares. The final state of a record from zero initial conditions is an unknown here.
    """
    n, nu = len(A), criterion.inputs
    seen = output_rows(A, C, criterion.xi)
    ended = [block.samples > 0 for block in criterion.blocks]
    equations: list[Real] = []
    count = 0
    for number, block in enumerate(criterion.blocks):
        lines, ny, c = block.values.shape
        rows, xi = seen[block.at], criterion.xi[block.at]
        directions = np.broadcast_to(np.eye(nu), (lines, nu, c)) if block.directions is None else block.directions
        count = n * directions.shape[1]
        parts = [np.einsum("foi,fjc->focji", rows, directions)]
        if criterion.feedthrough:
            parts.append(np.einsum("op,fjc->focjp", np.eye(ny), directions[:, :nu]))
        for other in np.flatnonzero(ended):
            last = rows * xi[:, None, None] if other == number else np.zeros(rows.shape)
            parts.append(np.broadcast_to(last[:, :, None], (lines, ny, c, n)))
        parts.append(block.values[..., None])
        weighted = block.weight.apply_all(np.concatenate([part.reshape(lines, ny, c, -1) for part in parts], axis=3))
        equations.append(real_rows(weighted.reshape(lines * ny * c, -1)))
    found = solution_in_units(triangle(np.concatenate(equations)))
    return found[:count].reshape(-1, n).T

"""The rows of each kind of experiment, divided by their bounds."""

# pyright: reportConstantRedefinition=false
# Matrices have capital letters.
from __future__ import annotations

import dataclasses
import functools

import numpy as np
from numpy.typing import NDArray

from robustid.core import Numbers, Real
from robustid.data import FrequencyResponse, TangentialResponse, TimeRecord, tilted
from robustid.identification.entries import Entries
from robustid.identification.formulation.columns import Columns, DenseColumns
from robustid.identification.formulation.functions import EntryColumns, Functions, filtered_by
from robustid.identification.problem import MixedProblem, excited_lines


@dataclasses.dataclass
class Block:
    """Rows of some samples of one experiment, divided by their bounds."""

    y: Numbers
    E: Columns
    columns: slice  # of x, that E acts on
    P: Numbers
    free: Real
    fixed: Real  # of the bounds, as the tail
    tail: Real
    cone: NDArray[np.intp]  # number of the bound of each sample
    complex: bool
    joins: bool = False  # shares the bounds of the block before it, and has none of its own


@dataclasses.dataclass(frozen=True)
class Assembly:
    """The rows of each kind of experiment."""

    problem: MixedProblem
    functions: Functions

    @property
    def entries(self) -> Entries:
        """Outputs and inputs."""
        return self.problem.entries

    @functools.cached_property
    def scales(self) -> Real:
        """Gain that the scaling of the prior gives every entry, (p, q)."""
        return self.problem.prior.scales(self.entries.outputs, self.entries.inputs)

    def lines(self, frf: FrequencyResponse | TangentialResponse) -> list[Block]:
        """Blocks of a frequency response."""
        angles = self.problem.plane.angles(frf.omega)
        if not isinstance(frf, FrequencyResponse):
            return self._directions(frf, angles)
        if frf.bound.joint == "matrix":
            return self._ellipsoids(frf, angles)
        make, response = self.functions.entry_columns(angles), self._responses(angles)
        blocks = [self._entry(frf, output, input, make, response) for output, input in measured_entries(frf)]
        return self._columns(frf, blocks) if frf.bound.joint == "column" else blocks

    def _entry(self, frf: FrequencyResponse, output: int, input: int, make: EntryColumns, response: Numbers) -> Block:
        """The frequency points of one entry, in discs or ellipses."""
        used = frf.bound.used[:, output, input]
        number, part = self.entries.place(output, input)
        angles, bound = self.problem.plane.angles(frf.omega[used]), frf.bound.radius[used, output, input]
        tilt = None if frf.bound.tilt is None else frf.bound.tilt[used, output, input]
        scale, n, m = float(self.scales[output, input]), self.functions.count, response.shape[1]
        E = make(used, scale, part, bound, tilt)
        P = np.zeros((angles.size, self.entries.count * m), complex)
        P[:, number * m : (number + 1) * m] = tilted(response[used] * part / bound[:, None], tilt)
        tail = self.functions.response_tail(angles) * scale / bound * (1.0 if tilt is None else 1 + np.abs(tilt))
        y = tilted(frf.values[used, output, input] / bound, tilt)
        return _complex_block(y, E, slice(number * n, (number + 1) * n), P, tail)

    def _columns(self, frf: FrequencyResponse, blocks: list[Block]) -> list[Block]:
        """The entries of a column as one cone a frequency point: the norm of a column is at most the largest singular value."""
        last = -1
        for (output, input), block in zip(measured_entries(frf), blocks, strict=True):
            measured = frf.bound.used[:, :, input]
            lines = np.flatnonzero(measured.any(axis=1))
            block.cone = np.searchsorted(lines, np.flatnonzero(measured[:, output]))
            block.joins = input == last
            largest = (self.scales[:, input] / frf.bound.radius[lines, :, input]).max(axis=1)
            tail = largest * self.functions.response_tail(self.problem.plane.angles(frf.omega[lines]))
            block.tail = np.zeros(0) if block.joins else tail
            block.fixed, last = np.ones(block.tail.size), input
        return blocks

    def _directions(self, frf: TangentialResponse, angles: Real) -> list[Block]:
        """Every sample sees a combination of the entries."""
        blocks: list[Block] = []
        for row, column in measured_entries(frf):
            used = frf.bound.used[:, row, column]
            bound, weights = frf.bound.radius[used, row, column], frf.weights[used, row, column]
            tail = np.linalg.svd(weights * self.scales, compute_uv=False).sum(axis=1) / bound
            tail = tail * self.functions.response_tail(angles[used])
            y = frf.values[used, row, column] / bound
            blocks.append(self._combined(y, weights / bound[:, None, None], angles[used], tail))
        return blocks

    def _ellipsoids(self, frf: FrequencyResponse, angles: Real) -> list[Block]:
        """Blocks, whitened, so that each frequency point is one cone: with E = LL', the norm of L^-1 vec(error)."""
        lines, p, q = frf.values.shape
        whiten = frf.bound.whitening
        y = whiten @ frf.values.transpose(0, 2, 1).reshape(lines, p * q, 1)
        scales = self.scales.T.ravel()
        tail = (
            np.linalg.norm(whiten * scales, 2, axis=(1, 2)) * self.entries.reach * self.functions.response_tail(angles)
        )
        weights = whiten.reshape(lines, p * q, q, p).transpose(0, 1, 3, 2)
        blocks = [self._combined(y[:, r, 0], weights[:, r], angles, tail) for r in range(p * q)]
        for block in blocks[1:]:
            block.joins, block.tail, block.fixed = True, np.zeros(0), np.zeros(0)
        return blocks

    def _combined(self, y: Numbers, weights: Numbers, angles: Real, tail: Real) -> Block:
        """Samples that are sums of weights (N, p, q) times the entries."""
        inside = np.tensordot(weights * self.scales, self.entries.basis, ([1, 2], [1, 2]))
        outside = np.tensordot(weights, self.entries.basis, ([1, 2], [1, 2]))
        E = _times(inside, self.functions.responses(angles))
        return _complex_block(y, DenseColumns(E), slice(0, E.shape[1]), _times(outside, self._responses(angles)), tail)

    def transient(self, record: TimeRecord, output: int) -> Block:
        """One output of a record from zero initial conditions or from an unknown state."""
        used = np.flatnonzero(record.bound.used[:, output])
        count, basis = int(used[-1]) + 1, self.problem.parametric
        u = record.u[:count]
        inside = self.problem.weighting.filtered(u)
        E = np.stack([self.functions.time_responses(one)[used] for one in inside.T], axis=1)
        none = np.zeros((used.size, u.shape[1], 0))
        impulse = None if basis is None else basis.impulse(count)
        P = none if impulse is None else np.stack([filtered_by(one, impulse)[used] for one in u.T], axis=1)
        free, widen = initial_state(self.problem, record, used, output)
        tail = self.functions.time_tail(inside * self.scales[output])[used]
        return self._row(record.y[used, output], E, P, record.bound.radius[used, output], widen, free, tail, output)

    def periodic(self, record: TimeRecord, output: int) -> Block:
        """One output in steady state."""
        samples, basis = record.u.shape[0], self.problem.parametric
        used = np.flatnonzero(record.bound.used[:, output])
        lines = excited_lines(record)
        angles = 2 * np.pi * lines / samples
        twice = np.where((lines == 0) | (2 * lines == samples), 1.0, 2.0)[:, None] / samples
        drive = twice * np.fft.rfft(record.u, axis=0)[lines]
        wave = np.exp(1j * (2 * np.pi / samples) * (np.outer(used, lines) % samples))
        values = self.functions.responses(angles)
        E = np.stack([((wave * one) @ values).real for one in drive.T], axis=1)
        P = np.zeros((used.size, drive.shape[1], 0))
        if basis is not None:
            P = np.stack([((wave * one) @ basis.response(angles)).real for one in drive.T], axis=1)
        size = np.linalg.norm(drive * self.scales[output], axis=1)
        tail = np.abs(wave) @ (size * self.functions.response_tail(angles))
        none, bound = np.zeros((used.size, 0)), record.bound.radius[used, output]
        return self._row(record.y[used, output], E, P, bound, np.zeros(used.size), none, tail, output)

    def _row(self, y: Real, E: Real, P: Real, bound: Real, widen: Real, free: Real, tail: Real, output: int) -> Block:
        """Samples of one output: E (N, q, n) and P (N, q, m) of what each input does."""
        total, n, q = bound + widen, E.shape[2], self.entries.inputs
        E, P = E * self.scales[output][:, None], self._placed(P, output)
        if self.entries.symmetric:
            columns, E = slice(0, self.entries.count * n), self._placed(E, output)
        else:
            columns, E = slice(output * q * n, (output + 1) * q * n), E.reshape(y.size, -1)
        unit = 1 / total
        y, E, P, free = (a * unit.reshape(-1, *(1,) * (a.ndim - 1)) for a in (y, E, P, free))
        return Block(y, DenseColumns(E), columns, P, free, bound / total, tail / total, np.arange(y.size), False)

    def _placed(self, row: Real, output: int) -> Real:
        """(N, q, k) of one row of the matrix, in all unknowns, (N, count k)."""
        full = np.zeros((row.shape[0], self.entries.count, row.shape[2]))
        for input in range(row.shape[1]):
            number, part = self.entries.place(output, input)
            full[:, number] += part * row[:, input]
        return full.reshape(row.shape[0], -1)

    def _responses(self, angles: Real) -> Numbers:
        """Values of the parametric functions at exp(j angle), (F, m)."""
        basis = self.problem.parametric
        return np.zeros((angles.size, 0)) if basis is None else basis.response(angles)


def measured_entries(frf: FrequencyResponse | TangentialResponse) -> list[tuple[int, int]]:
    """The entries of a frequency response that have a sample, column by column."""
    used = frf.bound.used.any(axis=0)
    return [(int(i), int(j)) for j, i in np.argwhere(used.T)]


def bounded_points(frf: FrequencyResponse | TangentialResponse) -> NDArray[np.intp]:
    """Number of the frequency point of every bound, in the order of the rows, (M,)."""
    used = frf.bound.used
    if frf.bound.joint == "matrix":
        return np.arange(len(used))
    if frf.bound.joint == "column":
        columns = sorted({column for _, column in measured_entries(frf)})
        return np.concatenate([np.flatnonzero(used[:, :, column].any(axis=1)) for column in columns])
    return np.concatenate([np.flatnonzero(used[:, row, column]) for row, column in measured_entries(frf)])


def _complex_block(y: Numbers, E: Columns, columns: slice, P: Numbers, tail: Real) -> Block:
    return Block(y, E, columns, P, np.zeros((y.size, 0)), np.ones(y.size), tail, np.arange(y.size), True)


def _times(weights: Numbers, values: Numbers) -> Numbers:
    """Kronecker products of the rows, (N, a b)."""
    return (weights[:, :, None] * values[:, None, :]).reshape(weights.shape[0], -1)


def initial_state(
    problem: MixedProblem, record: TimeRecord, used: NDArray[np.intp], output: int = 0
) -> tuple[Real, Real]:
    """Effect of an unknown state before the record on the samples `used` of an output: columns that span the free responses of
    the parametric part; and, for the non-parametric part, how much the past input can add.
    """
    # sum_{j>k} |g_j| u_max <= u_max K rho^-k / (rho - 1), g_j and u rows and vectors for MIMO; K times the peak of the weight,
    # where the class has one.
    if record.initial != "free":
        return np.zeros((used.size, 0)), np.zeros(used.size)
    rho = problem.prior.decay_rate
    K = problem.prior.gain_bound * problem.weighting.peak(rho)
    scales = problem.prior.scales(problem.entries.outputs, problem.entries.inputs)[output]
    if record.past_input_bound is None:
        past = float(np.linalg.norm(record.u * scales, axis=1).max())
    else:
        past = record.past_input_bound * float(np.linalg.norm(scales))
    widen = past * K * rho ** -used.astype(float) / (rho - 1)
    if problem.parametric is None:
        return np.zeros((used.size, 0)), widen
    return problem.parametric.transients(used[-1] + 1)[used], widen

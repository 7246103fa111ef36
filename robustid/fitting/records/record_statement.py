"""The question of a fit of records: the arguments of fit_records, checked, as tangential data with the criterion that they make.

Spectral lines take the place of samples, transients are further inputs.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from robustid.core import Complex, Real, StateMatrices, as_array, counted, real_rows
from robustid.data import FrequencyResponse, TimeRecord, as_frequency_response, as_records
from robustid.errors import InputError
from robustid.fitting.fraction.criterion import Weight
from robustid.fitting.fraction.default_weight import exact_covariance
from robustid.fitting.fraction.fit_statement import stated
from robustid.fitting.fraction.fraction_problem import FractionProblem
from robustid.fitting.fraction.householder import triangle
from robustid.fitting.state_space.given_poles import output_rows, solution_in_units
from robustid.fitting.state_space.projected_outputs import Block, Criterion, Fitted, Outputs
from robustid.identification import check_model

Noise = Callable[[StateMatrices, Real], Complex]  # filter of the noise that goes with a model, at angles: (F, ny, ny)

_SAME_DT = 1e-9
_LEAST_LEVEL = 1e-9  # part of an output below which its residual is rounding


def checked_records(records: object) -> tuple[TimeRecord, ...]:
    """The records, if they belong together and every sample of them counts."""
    given = tuple(as_records("records", records))
    for number, record in enumerate(given):
        if abs(record.dt - given[0].dt) > _SAME_DT * given[0].dt:
            raise InputError(
                f"`records` must have one sample time; got dt = {given[0].dt:g} s, and {record.dt:g} s at position {number}"
            )
        for axis in ("inputs", "outputs"):
            names, first = ([signal.name for signal in getattr(one, axis)] for one in (record, given[0]))
            if names != first:
                raise InputError(
                    f"`records` must have the same {axis}, in one order; got {first}, and {names} at position {number}"
                )
        if not np.all(record.used):
            raise InputError(
                f"`records` has samples that are not used (an infinite bound) at position {number}; cut them off:"
                ' record.window(start, stop, past="unknown")'
            )
    return given


def checked_response(frf: object, record: TimeRecord) -> FrequencyResponse:
    """The response, if it belongs to the records."""
    frf = as_frequency_response("frf", frf)
    if frf.dt is None or abs(frf.dt - record.dt) > _SAME_DT * record.dt:
        raise InputError(f"`frf` must have the sample time of `records`, dt = {record.dt:g} s; got dt = {frf.dt}")
    for axis in ("inputs", "outputs"):
        here, wanted = len(getattr(frf, axis)), len(getattr(record, axis))
        if here != wanted:
            raise InputError(f"`frf` must have the {wanted} {axis} of `records`; got {here}")
    return frf


def posed(
    records: tuple[TimeRecord, ...], frf: FrequencyResponse | None, order: int, feedthrough: bool, offset: bool
) -> Experiments:
    """The experiments that are fitted; InputError where the data can't carry the order."""
    nu, ny = records[0].u.shape[1], records[0].y.shape[1]
    unknowns, equations = order * (nu + ny) + feedthrough * nu * ny, 0
    for number, record in enumerate(records):
        if len(record.u) <= order:
            raise InputError(
                f"`records` has {len(record.u)} samples at position {number}, no more than `order` = {order}; lower the order or"
                " leave the record out"
            )
        unknowns += order * (record.initial == "free") + offset * ny
        equations += ny * len(record.u)
    if frf is not None:
        equations += 2 * int(np.sum(~frf.missing))
    if unknowns >= equations:
        raise InputError(
            f"`order` = {order} has {unknowns} unknowns, with those of the initial states, but the data give only {equations}"
            " equations; lower the order or give longer records"
        )
    everything = np.concatenate([record.u for record in records]), np.concatenate([record.y for record in records])
    moved, size = (np.sqrt(np.mean(part**2, axis=0)) for part in everything)
    for name, level, names in (("u", moved, records[0].inputs), ("y", size, records[0].outputs)):
        if not np.all(level):
            what = names[int(np.argmin(level))]
            raise InputError(f"`records` have `{name}` = 0 throughout in signal {what}; leave that signal out")
    unit = np.asarray(2.0 ** np.round(np.log2(moved)), dtype=float)
    columns = nu
    lines: list[Lines] = []
    for record in records:
        free = record.initial == "free"
        lines.append(spectra(record, unit, columns if free else None, offset))
        columns += free
    if frf is None:
        return Experiments(tuple(lines), unit, size, order, feedthrough)
    question = stated(frf, min(order, 1), "z", "right", None, feedthrough, None)
    problem = dataclasses.replace(question.problem, values=question.problem.values * unit)
    problem = dataclasses.replace(problem, weight=_per_unit(problem.weight, unit))
    return Experiments(tuple(lines), unit, size, order, feedthrough, problem, exact_covariance(frf))


def _per_unit(weight: Weight, unit: Real) -> Weight:
    """The weight of a response whose inputs are counted in units."""
    if weight.matrix is None:
        return weight.scaled(np.broadcast_to(1 / unit, weight.shape))
    ny = weight.shape[1]
    return dataclasses.replace(weight, matrix=weight.matrix / np.repeat(unit, ny))


def given_levels(weight: object, ny: int) -> Real:
    """Levels that a weight per output says."""
    weight = as_array("weight", weight, ndim=1)
    if weight.shape != (ny,) or not np.all(weight > 0):
        raise InputError(f"`weight` must hold one number > 0 for each of the {ny} outputs; got {weight.tolist()}")
    return 1 / np.asarray(weight, dtype=np.float64)


def given_start(start: object, order: int, record: TimeRecord) -> tuple[Real, Real]:
    """A and C of a model that was given."""
    model = check_model("start", start)
    shape = (model.nstates, model.noutputs, model.ninputs)
    wanted = (order, record.y.shape[1], record.u.shape[1])
    if shape != wanted or not model.isdtime(strict=True):
        raise InputError(
            f"`start` must be a discrete model of {counted(wanted[0], 'state')}, {counted(wanted[1], 'output')} and"
            f" {counted(wanted[2], 'input')}; got"
            f" {shape[0]}, {shape[1]} and {shape[2]}, dt = {model.dt}"
        )
    return np.asarray(model.A, dtype=float), np.asarray(model.C, dtype=float)


class Lines(NamedTuple):
    """Half of the unitary DFT of a record, Parseval's factors, and the column of its initial state."""

    angles: Real  # (F,), from 0 to at most pi
    u: Complex  # (F, nu), in units of the input
    y: Complex  # (F, ny)
    factor: Real  # (F,): sqrt(2) where a line stands for two; 0 where an offset takes it
    samples: int
    initial: str
    column: int | None  # of the directions; None where no initial state is estimated
    white: Complex | None = None  # (F, ny, ny): undoes the colour of the noise; None where it is taken for white


@dataclasses.dataclass(frozen=True, eq=False)
class Experiments:
    """Records, and a frequency response beside them, in the units in which they are fitted. With ``z_k = exp(2 pi i k/N)`` the
    unitary DFTs satisfy exactly ``Y(k) = P(z_k) U(k) + C (z_k I - A)^{-1} z_k b``, ``sqrt(N) b = x(0) - x(N)``: a sum of
    squares over samples is that over lines (Parseval), and a transient is one input more, of spectrum z_k.
    """

    # b is one to one with x(0), as I - A^N is regular. From zero initial conditions it is known (`Block.samples`); in periodic
    # steady state it is zero.
    lines: tuple[Lines, ...]
    unit: Real  # (nu,) rms of the inputs, to a power of two: the transient's columns have that size, too
    size: Real  # (ny,) rms of the outputs over all records
    order: int
    feedthrough: bool
    response: FractionProblem | None = None  # of the frequency response, in units of the outputs over `unit`
    exact: bool = False  # its weight is that of a covariance that is known

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
        weight = Weight(entries, output=line.white)
        if line.white is not None and len(levels) == 1:  # of one output its size alone counts
            weight = Weight(entries * np.abs(line.white))
        return Block(at, line.y[..., None], weight, directions, line.samples if line.initial == "rest" else 0)

    def whitened(self, noise: Noise, fitted: Fitted, levels: Real) -> Experiments:
        """With the noise of the outputs that goes with a model, of sources of such levels, in place of white noise."""
        filters = functools.partial(noise, self.plant(fitted))
        lines = [line._replace(white=whitening(filters, line, levels)) for line in self.lines]
        return dataclasses.replace(self, lines=tuple(lines))

    def plant(self, fitted: Fitted) -> StateMatrices:
        """A fitted model in the units of the data, without the columns of the initial states."""
        A, B, C, D = fitted.state_space(1.0)
        return StateMatrices(A, B[:, : self.unit.size] / self.unit, C, D / self.unit)

    def levels(self, outputs: Outputs, fitted: Fitted) -> tuple[Real, float]:
        """Levels of the residual: of every output over all records, and of the response in its own weight."""
        residuals = outputs.residuals(fitted)
        square, count = np.zeros(self.size.size), 0
        for line, residual in zip(self.lines, residuals, strict=False):
            residual = residual if line.white is None else line.white @ residual
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


def whitening(filters: Callable[[Real], Complex], line: Lines, levels: Real) -> Complex:
    """Matrices that turn filtered noise at the lines of a record into its white sources: exactly so in variance, with the leakage
    that a record of this length has into the notches of the filter; in phase as near to its inverse as that allows.
    """
    samples = line.samples
    E = filters(np.pi * np.arange(samples + 1) / samples) * levels
    covariance = np.fft.irfft(E @ E.conj().swapaxes(1, 2), 2 * samples, axis=0)
    lag = np.minimum(np.arange(2 * samples), np.arange(2 * samples, 0, -1))
    variance = np.fft.rfft((1 - lag / samples)[:, None, None] * covariance, axis=0)[::2][: line.angles.size]
    power, basis = np.linalg.eigh(variance)
    root = basis / np.sqrt(power)[:, None, :] @ basis.conj().swapaxes(1, 2)
    left, _, right = np.linalg.svd(root @ E[::2][: line.angles.size])
    return np.asarray(levels[:, None] * ((left @ right).conj().swapaxes(1, 2) @ root), dtype=complex)


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
    """The best inputs B of a model with these poles and outputs, (n, m) with the columns of the initial states: linear least
    squares, in which the final state of a record from zero initial conditions is an unknown.
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

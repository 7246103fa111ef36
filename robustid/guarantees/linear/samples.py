"""Samples as they see one entry: functionals of the non-parametric part and of the coefficients, with bounds."""

# pyright: reportConstantRedefinition=false
# Matrices have capital letters.
from __future__ import annotations

import dataclasses
import functools
from typing import NamedTuple, TypeVar

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from robustid.core import Array, Complex, Frozen, Real
from robustid.data import TimeRecord
from robustid.guarantees.linear.functions import Functions
from robustid.identification import MixedProblem, excited_lines
from robustid.identification.formulation import initial_state, measured_entries

Entry = tuple[int, int]
KEPT = 4096  # angles of which the last answers are kept: charts, verdicts and loops ask at the same ones
_ROWS = 256  # samples of the records of an entry that are used
_MEAN = 1e-12  # rounding of a mean

Number = TypeVar("Number", bound=np.generic)


@dataclasses.dataclass(frozen=True, eq=False)
class RecordRows(Frozen):
    """Samples of one output from a record: inputs, what the class sees of them, and what the functions do."""

    output: int
    time: Real  # (T,), s
    y: Real  # (T,)
    bound: Real  # (T,)
    # (T, N), for every component the Toeplitz matrix of its input, filtered by the weight of the class, columns times rho^-k.
    blocks: dict[int, Real]
    functions: Complex  # (T, m), what all functions of all components do
    left_out: Real  # (T, amplitudes)


@dataclasses.dataclass(frozen=True, eq=False)
class Samples(Frozen):
    r"""Functionals f_k of the entries that samples of one of them tie together: y_k = f_k(F) + an error of at most bound_k.

    A point sees sum_c v_c F_c at exp(j angle); every point stands with its conjugate, at -angle. F_c = sum_i p_ci P_i + K s_c W
    phi_c, with |phi|_2 <= `reach` over the components: 1 where they are in one row or one column.
    """

    problem: MixedProblem
    functions: Functions
    entry: Entry
    components: tuple[Entry, ...]
    angles: Real  # (N,)
    v: Complex  # (N, C)
    y: Complex  # (N,)
    bound: Real  # (N,)
    records: tuple[RecordRows, ...]
    # Columns of `records` beyond those of the components, of unknown initial states: amplitudes of their own.
    transients: int

    @property
    def target(self) -> int:
        """Number of the entry among the components."""
        return self.components.index(self.entry)

    @property
    def own_amplitudes(self) -> slice:
        """Numbers of the amplitudes of the entry among those of all components."""
        count = self.functions.amplitudes
        return slice(self.target * count, (self.target + 1) * count)

    @functools.cached_property
    def reach(self) -> float:
        """Largest norm of the components of a matrix whose singular values are at most 1."""
        rows, columns = (len({one[axis] for one in self.components}) for axis in (0, 1))
        return float(np.sqrt(min(rows, columns)))

    @functools.cached_property
    def gains(self) -> Real:
        """K times reach times the scale of every component, (C,)."""
        prior, entries = self.problem.prior, self.problem.entries
        scales = prior.scales(entries.outputs, entries.inputs)
        return prior.gain_bound * self.reach * np.array([scales[one] for one in self.components])

    @functools.cached_property
    def nodes(self) -> Complex:
        """Zeta of every point, (N,)."""
        return self.problem.region.points(self.angles)

    @functools.cached_property
    def weights(self) -> Complex:
        """Weights of the components of phi in every point, (N, C)."""
        return self.v * self.problem.weighting.values(self.angles)[:, None] * self.gains

    @functools.cached_property
    def values(self) -> Complex:
        """Functions of all components at every point, (N, m), zeros for transients."""
        return self._of_components(self.v, self.functions.values(self.angles))

    @functools.cached_property
    def left_out(self) -> Real:
        """Most that the series leave out of every point, (N, amplitudes)."""
        return self._of_components(np.abs(self.v), self.functions.left_out(self.angles))

    def _of_components(self, weights: Array, own: Array) -> Array:
        """Weights (N, C) of the components times columns (N, k) that each has, and zeros for transients."""
        every = (weights[:, :, None] * own[:, None, :]).reshape(len(own), weights.shape[1] * own.shape[1])
        return np.concatenate([every, np.zeros((len(own), self.transients), every.dtype)], axis=1)

    @property
    def amplitudes(self) -> int:
        """Number of amplitudes of all components and transients."""
        return len(self.components) * self.functions.amplitudes + self.transients

    @functools.cached_property
    def amplitude_of(self) -> NDArray[np.intp]:
        """Numbers of the amplitudes that the coefficients belong to, (m,)."""
        own, count = self.functions.amplitude_of, self.functions.amplitudes
        every = [own + k * count for k in range(len(self.components))]
        return np.concatenate([*every, len(self.components) * count + np.arange(self.transients)]).astype(int)

    def _every(self, own: NDArray[Number], transient: float) -> NDArray[Number]:
        return np.concatenate([np.tile(own, len(self.components)), np.full(self.transients, transient)])

    @functools.cached_property
    def powers(self) -> Real:
        """Largest size of every coefficient for an amplitude of 1, (m,)."""
        return self._every(self.functions.powers, 1.0)

    @functools.cached_property
    def first(self) -> NDArray[np.bool_]:
        """Mask of the coefficients that are their amplitude, or the conjugate of it, (m,)."""
        return self._every(self.functions.first, True)

    @functools.cached_property
    def conjugate(self) -> NDArray[np.bool_]:
        """Mask of the coefficients that belong to the conjugate of their amplitude, (m,)."""
        return self._every(self.functions.conjugate, False)

    @property
    def rows(self) -> int:
        """Number of samples of records."""
        return sum(one.y.size for one in self.records)

    @functools.cached_property
    def record_y(self) -> Real:
        """Samples of all records, (T,)."""
        return np.concatenate([np.zeros(0), *(one.y for one in self.records)])

    @functools.cached_property
    def record_bound(self) -> Real:
        """Their bounds, (T,)."""
        return np.concatenate([np.zeros(0), *(one.bound for one in self.records)])

    @functools.cached_property
    def record_functions(self) -> Complex:
        """Responses of all functions in them, (T, m)."""
        none = np.zeros((0, self.amplitude_of.size), complex)
        return np.concatenate([none, *(one.functions for one in self.records)])

    @functools.cached_property
    def record_left_out(self) -> Real:
        """Most that the series leave out of them, (T, amplitudes)."""
        return np.concatenate([np.zeros((0, self.amplitudes)), *(one.left_out for one in self.records)])

    @functools.cached_property
    def blocks(self) -> list[Real]:
        """For every component the matrix (T, n) on its Taylor coefficients, in all records, gain included."""
        size = max((b.shape[1] for one in self.records for b in one.blocks.values()), default=1)
        found = [np.zeros((self.rows, size)) for _ in self.components]
        start = 0
        for one in self.records:
            for c, block in one.blocks.items():
                found[c][start : start + one.y.size, : block.shape[1]] = block * self.gains[c]
            start += one.y.size
        return found

    @functools.cached_property
    def shifted(self) -> tuple[Real, Real, Real]:
        """U U', U S U' and U D U' over all components, S the shift (ones at (k+1, k)), D = diag(0, 1, 1, ...)."""
        plain, later, shift = (np.zeros((self.rows, self.rows)) for _ in range(3))
        for U in self.blocks:
            plain += U @ U.T
            later += U[:, 1:] @ U[:, 1:].T
            shift += U[:, 1:] @ U[:, :-1].T
        return plain, shift, later

    @functools.cached_property
    def mixed(self) -> tuple[Complex, Complex]:
        """U_c w^*n and U_c w^*(n-1) for the nodes w, times the conjugate weights, summed over the components, (T, N) each."""
        size = self.blocks[0].shape[1] if self.blocks else 1
        powers = self.nodes.conj()[None, :] ** np.arange(size)[:, None]
        first = sum((U @ powers) * w.conj() for U, w in zip(self.blocks, self.weights.T, strict=True))
        second = sum((U[:, 1:] @ powers[:-1]) * w.conj() for U, w in zip(self.blocks, self.weights.T, strict=True))
        shape = self.rows, self.angles.size
        return np.zeros(shape, complex) + first, np.zeros(shape, complex) + second

    def target_weight(self, angles: Real) -> Complex:
        """K reach s W of the entry at angles, (B,)."""
        return self.gains[self.target] * self.problem.weighting.values(angles)

    def target_values(self, angles: Real) -> Complex:
        """Functions of the entry at angles, zeros for those of the others, (B, m)."""
        return self.of_target(self.functions.values(angles), self.amplitude_of.size)

    def target_left_out(self, angles: Real) -> Real:
        """Most that the series leave out of the entry, (B, amplitudes)."""
        return self.of_target(self.functions.left_out(angles), self.amplitudes).real

    def of_target(self, own: Real | Complex, columns: int) -> Complex:
        """Columns of the entry among so many of all components and transients, zeros elsewhere."""
        found = np.zeros((len(own), columns), complex)
        found[:, self.target * own.shape[1] : (self.target + 1) * own.shape[1]] = own
        return found


class Seen(NamedTuple):
    """Samples at frequencies that see the same entries: places, angles (N,), weights (N, places), values and radii (N,)."""

    places: tuple[Entry, ...]
    angles: Real
    v: Complex
    y: Complex
    bound: Real


def samples_of(problem: MixedProblem, functions: Functions, entry: Entry, seen: list[Seen] | None = None) -> Samples:
    """The samples that see an entry, alone or together with others; `seen` is `seen_in` of the problem, where it is known."""
    seen = seen_in(problem) if seen is None else seen
    components = _tied(problem, entry, seen)
    index = {place: c for c, place in enumerate(components)}
    own = [_converging(one, functions) for one in seen if set(one.places) <= set(components)]
    v = [np.zeros((one.angles.size, len(components)), complex) for one in own]
    for weights, one in zip(v, own, strict=True):
        weights[:, [index[place] for place in one.places]] = one.v
    none, lines = np.zeros(0), np.zeros((0, len(components)), complex)
    angles, y, bound = (
        np.concatenate([none, *(getattr(one, name) for one in own)]) for name in ("angles", "y", "bound")
    )
    records, transients = _records(problem, functions, components)
    return Samples(
        problem,
        functions,
        _canonical(problem, entry),
        components,
        np.concatenate([angles, -angles]),
        np.concatenate([lines, *v, *(one.conj() for one in v)]),
        np.concatenate([y, np.conj(y)]).astype(complex),
        np.concatenate([bound, bound]),
        records,
        transients,
    )


def _converging(one: Seen, functions: Functions) -> Seen:
    """The samples at which the series of the modes say something."""
    use = np.isfinite(functions.left_out(one.angles)).all(axis=1)
    return one if use.all() else Seen(one.places, one.angles[use], one.v[use], one.y[use], one.bound[use])


def _canonical(problem: MixedProblem, entry: Entry) -> Entry:
    return (min(entry), max(entry)) if problem.entries.symmetric else entry


def seen_in(problem: MixedProblem) -> list[Seen]:
    """All samples at frequencies, those of records in steady state as their spectral lines among them."""
    found: list[Seen] = []
    for item in problem.frequency:
        angles, radius = problem.plane.angles(item.omega), item.bound.outer_radius
        weights = getattr(item, "weights", None)
        for i, j in measured_entries(item):
            used = item.bound.used[:, i, j]
            if weights is None:
                places, v = (_canonical(problem, (i, j)),), np.ones((int(used.sum()), 1), complex)
            else:
                places, v = _gathered(problem, weights[used, i, j])
            found.append(Seen(places, angles[used], v, item.values[used, i, j], radius[used, i, j]))
    for record in problem.time:
        if record.initial == "periodic":
            found += _lines_of(problem, record)
    return found


def _gathered(problem: MixedProblem, weights: Complex) -> tuple[tuple[Entry, ...], Complex]:
    """Entries with a weight somewhere, and the weights (N, places) of (N, ny, nu)."""
    columns: dict[Entry, Complex] = {}
    for a, b in np.argwhere((weights != 0).any(axis=0)).tolist():
        place = _canonical(problem, (a, b))
        columns[place] = columns.get(place, 0) + weights[:, a, b]
    return tuple(columns), np.stack(list(columns.values()), axis=1)


def _lines_of(problem: MixedProblem, record: TimeRecord) -> list[Seen]:
    """The spectral lines of a record in steady state: each at most the mean of its bounds away."""
    found: list[Seen] = []
    samples, lines = record.u.shape[0], excited_lines(record)
    drive = np.fft.rfft(record.u, axis=0)[lines] / samples
    for output in range(record.y.shape[1]):
        if not np.all(record.bound.used[:, output]):
            continue
        weights = np.zeros((lines.size, *problem.entries.shape), complex)
        weights[:, output] = drive
        places, v = _gathered(problem, weights)
        radius = np.full(lines.size, record.bound.radius[:, output].mean() * (1 + _MEAN))
        y = np.fft.rfft(record.y[:, output])[lines] / samples
        found.append(Seen(places, 2 * np.pi * lines / samples, v, y, radius))
    return found


def _tied(problem: MixedProblem, entry: Entry, seen: list[Seen]) -> tuple[Entry, ...]:
    """The entries that samples tie to one, itself among them."""
    groups = {frozenset(one.places) for one in seen}
    inputs = range(problem.entries.inputs)
    for record in problem.time:
        if record.initial != "periodic":
            used = np.flatnonzero(record.bound.used.any(axis=0))
            groups |= {frozenset(_canonical(problem, (int(a), j)) for j in inputs) for a in used}
    tied = {_canonical(problem, entry)}
    while True:
        more = set[Entry]().union(*(g for g in groups if g & tied)) - tied
        if not more:
            return tuple(sorted(tied))
        tied |= more


def _records(
    problem: MixedProblem, functions: Functions, components: tuple[Entry, ...]
) -> tuple[tuple[RecordRows, ...], int]:
    """The rows of all records that are not periodic, and how many transients they have."""
    pieces: list[tuple[TimeRecord, int, NDArray[np.intp]]] = []
    outputs = sorted({a for a, _ in components})
    for record in problem.time:
        # What poles in a box do to an unknown initial state is not bounded: such records are left out beside one.
        left_out = record.initial == "periodic" or (record.initial == "free" and functions.modes is not None)
        left_out = left_out or (functions.modes is not None and bool(np.any(functions.modes.reach > 0)))
        for output in () if left_out else outputs:
            used = np.flatnonzero(record.bound.used[:, output])
            if used.size:
                pieces.append((record, output, used))
    each = max(_ROWS // max(len(pieces), 1), 1)
    built = [_rows(problem, functions, components, record, output, used[:each]) for record, output, used in pieces]
    total, start = sum(free.shape[1] for _, free in built), 0
    found: list[RecordRows] = []
    for rows, free in built:
        columns = np.zeros((rows.y.size, total), complex)
        columns[:, start : start + free.shape[1]] = free
        start += free.shape[1]
        both = np.concatenate([rows.functions, columns], axis=1)
        padded = np.concatenate([rows.left_out, np.zeros((rows.y.size, total))], axis=1)
        found.append(dataclasses.replace(rows, functions=both, left_out=padded))
    return tuple(found), total


def _rows(
    problem: MixedProblem,
    functions: Functions,
    components: tuple[Entry, ...],
    record: TimeRecord,
    output: int,
    used: NDArray[np.intp],
) -> tuple[RecordRows, Real]:
    """Rows of one output of a record, and the columns of its transients."""
    count = int(used[-1]) + 1
    u = record.u[:count]
    inside = problem.weighting.filtered(u)
    decay = problem.prior.decay_rate ** -np.arange(count, dtype=float)
    m, g = functions.amplitude_of.size, functions.amplitudes
    columns, rest = np.zeros((used.size, len(components) * m), complex), np.zeros((used.size, len(components) * g))
    blocks: dict[int, Real] = {}
    for j in range(u.shape[1]):
        c = components.index(_canonical(problem, (output, j)))
        blocks[c] = scipy.linalg.toeplitz(inside[:, j], np.zeros(count))[used] * decay
        columns[:, c * m : (c + 1) * m] = functions.responses(u[:, j])[used]
        rest[:, c * g : (c + 1) * g] = functions.left_out_in_time(u[:, j])[used]
    free, widen = initial_state(problem, record, used, output)
    y, bound = record.y[used, output], record.bound.radius[used, output] + widen
    return RecordRows(output, record.time[used], y, bound, blocks, columns, rest), free

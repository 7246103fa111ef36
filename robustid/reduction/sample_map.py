"""The samples of a problem as a linear map of what a model puts out, in units of their bounds.

A model is seen from its side with fewer signals: its heads; the others are its tails. With fewer inputs than outputs that is
the transposed model: its heads are the inputs. Every entry is then c_i (zI - A)^-1 x_j of a head i and a tail j.
"""

# pyright: reportConstantRedefinition=false
# Matrices have capital letters.
from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable
from typing import Any

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from robustid.core import Complex, Real
from robustid.data import FrequencyResponse, TangentialResponse, TimeRecord, tilted
from robustid.identification import MixedProblem, excited_lines
from robustid.identification.formulation import initial_state, measured_entries

Samples = NDArray[np.float64 | np.complex128]  # real in time, complex at frequency points and spectral lines
Signals = list[Samples]
Triangular = tuple[Complex, Complex]  # T and Q of a complex Schur form Q T Q*


def triangular(A: Real) -> Triangular:
    """The complex Schur form of a matrix."""
    T, Q = scipy.linalg.schur(A, output="complex")[:2]
    return T, Q


@dataclasses.dataclass(frozen=True)
class Track:
    """One experiment: the signals that enter the model, and how the samples are read from what comes out."""

    # (L, q): ones at frequency points, the spectrum of periodic inputs at their spectral lines, or inputs in time
    signal: Samples
    points: Complex | None  # (L,) z of the points or lines; None: signals of time, from zero initial conditions
    # from what the entry (output, input) puts out, (L, m), to samples (N, m), divided by the bounds
    rows: Callable[[int, int, Samples], Samples]
    y: Samples  # (N,) measured samples, divided by the bounds
    free: Real  # (N, k) free responses that an unknown initial state allows, divided by the bounds
    cone: NDArray[np.intp]  # (N,) number of the bound of every sample

    def behind(self, signals: Samples, pole: complex) -> Samples:
        """The responses of 1/(z - pole), (L, m)."""
        if self.points is None:
            import scipy.signal

            return scipy.signal.lfilter([0.0, 1.0], [1.0, -pole], signals, axis=0)
        return signals / (self.points - pole)[:, None]

    def states(self, A: Triangular, c: Real, signals: Samples) -> Samples:
        """The responses of the row c (zI - A)^-1 to each signal, (L, m, n), by forward substitution."""
        T, Q = A
        into = c @ Q
        v = np.empty((*signals.shape, into.size), complex)
        for j in range(into.size):
            v[..., j] = self.behind(into[j] * signals + v[..., :j] @ T[:j, j], T[j, j])
        v = v @ Q.conj().T
        return v.real if self.points is None else v

    def integrals(self, count: int) -> Samples:
        """The signals and their responses of 1/(z - 1), 1/(z - 1)^2, ..., (L, q, 1 + count)."""
        out = [self.signal]
        for _ in range(count):
            out.append(self.behind(out[-1], 1.0))
        return np.stack(out, axis=2)


@dataclasses.dataclass(frozen=True)
class SampleMap:
    """All experiments of a problem, frequency points first; `integrators` poles at z = 1 belong to every entry of a model."""

    tracks: tuple[Track, ...]
    discs: int
    dt: float
    integrators: int
    outputs: int
    inputs: int

    @property
    def flipped(self) -> bool:
        """True if the heads are the inputs."""
        return self.inputs < self.outputs

    @property
    def heads(self) -> int:
        """Number of signals on the side with fewer."""
        return min(self.outputs, self.inputs)

    @property
    def tails(self) -> int:
        """Number of signals on the other side."""
        return max(self.outputs, self.inputs)

    @functools.cached_property
    def y(self) -> Complex:
        """Samples in units of their bounds, (N,) complex."""
        return np.concatenate([track.y for track in self.tracks]).astype(complex)

    @functools.cached_property
    def cone(self) -> NDArray[np.intp]:
        """Number of the bound of every sample, (N,)."""
        starts = np.cumsum([0, *(track.cone.max() + 1 for track in self.tracks)])
        return np.concatenate([start + t.cone for start, t in zip(starts, self.tracks, strict=False)])

    @functools.cached_property
    def fixed(self) -> Samples:
        """Columns that no pole changes, (N, k): feed-through by entry, integrators by power and entry, free responses."""
        direct: Signals = []
        for track in self.tracks:
            parts = track.integrals(self.integrators)
            each = [
                track.rows(output, input, parts[:, input])
                for output in range(self.outputs)
                for input in range(self.inputs)
            ]
            direct.append(np.stack(each, axis=2).reshape(track.y.size, -1))
        return np.hstack([np.vstack(direct), scipy.linalg.block_diag(*(t.free for t in self.tracks))])

    @functools.cached_property
    def weights(self) -> Real:
        """Size (heads,) of a unit at each head, in units of the bounds."""
        found = np.zeros((self.heads, self.tails))
        for track in self.tracks:
            ones = np.ones((track.signal.shape[0], 1))
            for i, j in np.ndindex(found.shape):
                found[i, j] = np.hypot(found[i, j], np.linalg.norm(self.read(track, i, j, ones)))
        return found.max(axis=1)

    def read(self, track: Track, head: int, tail: int, out: Samples) -> Samples:
        """Samples (N, m) of what the entry of a head and a tail puts out, (L, m)."""
        return track.rows(tail, head, out) if self.flipped else track.rows(head, tail, out)

    def into(self, track: Track, head: int) -> Samples:
        """The signals that enter the entries of a head, (L, tails)."""
        if self.flipped:
            return np.broadcast_to(track.signal[:, head : head + 1], (track.signal.shape[0], self.tails))
        return track.signal

    def states(self, A: Real, C: Real) -> Signals:
        """Responses of C_k (zI - A)^-1 to the signals of the entries (i, j), by experiment, (heads i, heads k, L, tails j, n).
        With the inputs as tails all heads i have the same signals: (1, heads k, L, tails j, n).
        """
        form, found = triangular(A), range(self.heads if self.flipped else 1)
        return [np.array([[t.states(form, c, self.into(t, i)) for c in C] for i in found]) for t in self.tracks]

    def columns(self, states: Signals) -> Complex:
        """Samples of the entries C (zI - A)^-1 x_j for unit vectors x_j, one tail after the other, (N, tails n)."""
        parts: list[Complex] = []
        for track, found in zip(self.tracks, states, strict=True):
            each = np.zeros((track.y.size, self.tails, found.shape[-1]), complex)
            for i, j in np.ndindex(self.heads, self.tails):
                each[:, j] += self.read(track, i, j, found[i % len(found), i, :, j])
            parts.append(each.reshape(track.y.size, -1))
        return np.vstack(parts)

    def outputs_of(self, states: Signals, X: Real) -> Signals:
        """Responses of C_k (zI - A)^-1 x_j to the signals of the entries (i, j), by experiment, (heads i, L, heads k, tails j).
        With the inputs as tails all heads i have the same signals: (1, L, heads k, tails j).
        """
        return [np.einsum("iklja,aj->ilkj", found, X) for found in states]

    def samples_of(self, outputs: Signals) -> Samples:
        """The samples of what the entries put out, (N,)."""
        found: list[Any] = []
        for track, out in zip(self.tracks, outputs, strict=True):
            entries = np.ndindex(self.heads, self.tails)
            found.append(sum(self.read(track, i, j, out[i % len(out), :, i, j, None])[:, 0] for i, j in entries))
        return np.concatenate(found)

    def sizes(self, error: Samples) -> Real:
        """The norm of the errors under each bound."""
        return np.sqrt(np.bincount(self.cone, np.abs(error) ** 2))

    def real(self, a: Samples) -> Real:
        """Real rows of complex ones: real parts of all samples, then imaginary parts of the discs."""
        return np.concatenate([np.real(a), np.imag(a[: self.discs])])

    @functools.cached_property
    def band(self) -> tuple[float, float]:
        """Lowest and highest angle in rad that the samples see."""
        low: list[float] = []
        high: list[float] = []
        for track in self.tracks:
            if track.points is None:
                low.append(np.pi / max(track.signal.shape[0], 2))
                high.append(np.pi)
            elif np.any(turn := np.abs(np.angle(track.points)) > 0):
                angles = np.abs(np.angle(track.points[turn]))
                low.append(float(angles.min()))
                high.append(float(angles.max()))
        return (min(low), max(high)) if low else (np.pi / 100, np.pi)


def sample_map(problem: MixedProblem, integrators: int) -> SampleMap:
    """The samples of a problem as the judge `largest_ratio` takes them."""
    lines = [_line_track(f, problem) for f in problem.frequency]
    records = [
        _periodic_track(record) if record.initial == "periodic" else _time_track(record, problem)
        for record in problem.time
    ]
    discs = sum(track.y.size for track in lines)
    size = problem.entries.outputs, problem.entries.inputs
    return SampleMap((*lines, *records), discs, problem.dt, integrators, *size)


def with_lines(samples: SampleMap, frf: FrequencyResponse, problem: MixedProblem) -> SampleMap:
    """The map with further frequency points."""
    track = _line_track(frf, problem)
    return dataclasses.replace(samples, tracks=(track, *samples.tracks), discs=samples.discs + track.y.size)


def _line_track(frf: FrequencyResponse | TangentialResponse, problem: MixedProblem) -> Track:
    """A sample is sum_ij W_ij G_ij at its line, tilted where its bound is an ellipse."""
    lines, points = int(frf.omega.size), np.exp(1j * frf.omega * problem.dt)
    p, q = problem.entries.outputs, problem.entries.inputs
    if not isinstance(frf, FrequencyResponse):
        at, W, y, tilt = _directions(frf)
        cone = np.arange(y.size)
    elif frf.bound.joint == "matrix":
        white = frf.bound.whitening
        W = white.reshape(lines * p * q, q, p).swapaxes(1, 2)
        y = (white @ frf.values.swapaxes(1, 2).reshape(lines, p * q, 1)).ravel()
        at = cone = np.repeat(np.arange(lines), p * q)
        tilt = None
    else:
        at, i, j = np.nonzero(frf.bound.used)
        bound = frf.bound.radius[at, i, j]
        W = np.zeros((at.size, p, q))
        W[np.arange(at.size), i, j] = 1 / bound
        tilt = None if frf.bound.tilt is None else frf.bound.tilt[at, i, j]
        y = tilted(frf.values[at, i, j] / bound, tilt)
        cone = np.unique(at * q + j, return_inverse=True)[1] if frf.bound.joint == "column" else np.arange(at.size)

    def rows(output: int, input: int, out: Samples) -> Samples:
        return tilted(out[at] * W[:, output, input, None], tilt)

    return Track(np.ones((lines, q), complex), points, rows, y, np.zeros((y.size, 0)), cone)


def _directions(frf: TangentialResponse) -> tuple[NDArray[np.intp], Complex, Complex, None]:
    """Points, weights and values of tangential samples, divided by their bounds."""
    parts: list[tuple[NDArray[np.intp], Complex, Complex]] = []
    for row, column in measured_entries(frf):
        used = np.flatnonzero(frf.bound.used[:, row, column])
        bound = frf.bound.radius[used, row, column]
        parts.append(
            (used, frf.weights[used, row, column] / bound[:, None, None], frf.values[used, row, column] / bound)
        )
    at, W, y = (np.concatenate(part) for part in zip(*parts, strict=True))
    return at, W, y, None


def _time_track(record: TimeRecord, problem: MixedProblem) -> Track:
    used = _used(record)
    parts = {i: initial_state(problem, record, at, i) for i, at in used.items()}
    bounds = {i: record.bound.radius[at, i] + parts[i][1] for i, at in used.items()}
    free = scipy.linalg.block_diag(*(parts[i][0] / bounds[i][:, None] for i in used))
    last = max(at[-1] for at in used.values())
    return _record_track(record, record.u[: last + 1], None, bounds, lambda v: v, free)


def _periodic_track(record: TimeRecord) -> Track:
    used, lines = _used(record), excited_lines(record)
    samples = record.u.shape[0]

    def in_time(v: Samples) -> Samples:
        spectrum = np.zeros((samples // 2 + 1, v.shape[1]), complex)
        spectrum[lines] = v
        return np.fft.irfft(spectrum, samples, axis=0)

    signal, points = np.fft.rfft(record.u, axis=0)[lines], np.exp(2j * np.pi * lines / samples)
    bounds = {i: record.bound.radius[at, i] for i, at in used.items()}
    free = np.zeros((sum(at.size for at in used.values()), 0))
    return _record_track(record, signal, points, bounds, in_time, free)


def _used(record: TimeRecord) -> dict[int, NDArray[np.intp]]:
    """The samples that have a bound, of each output that has any."""
    found = {i: np.flatnonzero(np.isfinite(bound)) for i, bound in enumerate(record.bound.radius.T)}
    return {i: at for i, at in found.items() if at.size}


def _record_track(
    record: TimeRecord,
    signal: Samples,
    points: Complex | None,
    bounds: dict[int, Real],
    in_time: Callable[[Samples], Samples],
    free: Real,
) -> Track:
    """One output after the other."""
    used = _used(record)
    starts = dict(zip(used, np.cumsum([0, *(at.size for at in used.values())]), strict=False))
    count = sum(at.size for at in used.values())

    def rows(output: int, input: int, out: Samples) -> Samples:
        found = np.zeros((count, out.shape[1]))
        if output in used:
            at = used[output]
            found[starts[output] :][: at.size] = in_time(out)[at] / bounds[output][:, None]
        return found

    y = np.concatenate([record.y[at, i] / bounds[i] for i, at in used.items()])
    return Track(signal, points, rows, y, free, np.arange(count))

"""The samples of a problem as a linear map of what a model puts out, in units of their bounds."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable

import numpy as np
import scipy.linalg

from robustid.data import FrequencyResponse, TimeRecord
from robustid.data.ellipses import tilted
from robustid.interpolation import MixedProblem
from robustid.interpolation.assembly import initial_state
from robustid.interpolation.problem import excited_lines


@dataclasses.dataclass(frozen=True)
class Track:
    """One experiment: the signal that enters the model, and how the samples are read from what comes out.

    Attributes
    ----------
    signal : (L,) array
        Ones at the lines, the spectrum of a periodic input at its lines, or the input in time.
    points : (L,) complex array or None
        The z of the lines; None: the signal is one of time, from rest.
    rows : callable
        From outputs (L, m) to samples (N, m), divided by the bounds.
    y : (N,) complex array
        The measured samples, divided by the bounds.
    free : (N, k) array
        Free responses that an unknown initial state allows, divided by the bounds.
    """

    signal: np.ndarray
    points: np.ndarray | None
    rows: Callable[[np.ndarray], np.ndarray]
    y: np.ndarray
    free: np.ndarray

    def behind(self, signal: np.ndarray, pole: complex) -> np.ndarray:
        """The response of 1/(z - pole), (L,)."""
        if self.points is None:
            import scipy.signal

            return np.asarray(scipy.signal.lfilter([0.0, 1.0], [1.0, -pole], signal))
        return signal / (self.points - pole)

    def states(self, A: np.ndarray, c: np.ndarray, signal: np.ndarray) -> np.ndarray:
        """The responses of the row c (zI - A)^-1, (L, n): complex Schur form, forward substitution."""
        T, Q = scipy.linalg.schur(A, output="complex")[:2]
        into = c @ Q
        v = np.empty((signal.size, into.size), complex)
        for j in range(into.size):
            v[:, j] = self.behind(into[j] * signal + v[:, :j] @ T[:j, j], T[j, j])
        v = v @ Q.conj().T
        return v.real if self.points is None else v

    def integrals(self, count: int) -> np.ndarray:
        """The responses of 1/(z - 1), 1/(z - 1)^2, ..., (L, count)."""
        out = np.empty((self.signal.size, count), self.signal.dtype)
        signal = self.signal
        for k in range(count):
            out[:, k] = signal = self.behind(signal, 1.0)
        return out


@dataclasses.dataclass(frozen=True)
class SampleMap:
    """All experiments of a problem, frequency lines first; `integrators` poles at z = 1 belong to every model."""

    tracks: tuple[Track, ...]
    discs: int
    dt: float
    integrators: int

    @functools.cached_property
    def y(self) -> np.ndarray:
        """Samples in units of their bounds, (N,) complex."""
        return np.concatenate([track.y for track in self.tracks]).astype(complex)

    @functools.cached_property
    def fixed(self) -> np.ndarray:
        """Columns that no pole changes, (N, k): feed-through, integrators, free responses."""
        direct = [t.rows(np.column_stack([t.signal, t.integrals(self.integrators)])) for t in self.tracks]
        return np.hstack([np.vstack(direct), np.asarray(scipy.linalg.block_diag(*(t.free for t in self.tracks)))])

    def signals(self) -> list[np.ndarray]:
        """What enters the model, by experiment."""
        return [t.signal for t in self.tracks]

    def columns(self, A: np.ndarray, c: np.ndarray, signals: list[np.ndarray]) -> np.ndarray:
        """Samples of c (zI - A)^-1 driven by these signals, (N, n)."""
        states = [t.rows(t.states(A, c, s)) for t, s in zip(self.tracks, signals, strict=True)]
        return np.vstack(states)

    def real(self, a: np.ndarray) -> np.ndarray:
        """Real rows of complex ones: real parts of all samples, then imaginary parts of the discs."""
        return np.concatenate([np.real(a), np.imag(a[: self.discs])])

    @functools.cached_property
    def band(self) -> tuple[float, float]:
        """Lowest and highest angle in rad that the samples see."""
        low, high = [], []
        for track in self.tracks:
            if track.points is None:
                low.append(np.pi / max(track.signal.size, 2))
                high.append(np.pi)
            elif np.any(turn := np.abs(np.angle(track.points)) > 0):
                angles = np.abs(np.angle(track.points[turn]))
                low.append(float(angles.min()))
                high.append(float(angles.max()))
        return (min(low), max(high)) if low else (np.pi / 100, np.pi)


def sample_map(problem: MixedProblem, integrators: int) -> SampleMap:
    """The samples of a problem as the judge `largest_ratio` takes them."""
    tracks = [_line_track(f, problem) for f in problem.frequency]
    for record in problem.time:
        tracks.append(_periodic_track(record) if record.initial == "periodic" else _time_track(record, problem))
    discs = sum(f.omega.size for f in problem.frequency)
    return SampleMap(tuple(tracks), discs, problem.dt, integrators)


def _line_track(frf: FrequencyResponse, problem: MixedProblem) -> Track:
    bound = frf.bound[:, 0, 0]
    tilt = None if frf.tilt is None else frf.tilt[:, 0, 0]
    points = np.exp(1j * frf.omega * problem.dt)
    y = tilted(frf.values[:, 0, 0], tilt) / bound
    none = np.zeros((points.size, 0))
    return Track(np.ones(points.size, complex), points, lambda v: tilted(v, tilt) / bound[:, None], y, none)


def _time_track(record: TimeRecord, problem: MixedProblem) -> Track:
    used = np.flatnonzero(np.isfinite(record.bound[:, 0]))
    free, widen = initial_state(problem, record, used)
    bound = record.bound[used, 0] + widen
    signal = record.u[: used[-1] + 1, 0]
    return Track(signal, None, lambda v: v[used] / bound[:, None], record.y[used, 0] / bound, free / bound[:, None])


def _periodic_track(record: TimeRecord) -> Track:
    used, lines = np.flatnonzero(np.isfinite(record.bound[:, 0])), excited_lines(record)
    samples, bound = record.u.shape[0], record.bound[used, 0]

    def rows(v: np.ndarray) -> np.ndarray:
        spectrum = np.zeros((samples // 2 + 1, v.shape[1]), complex)
        spectrum[lines] = v
        return np.fft.irfft(spectrum, samples, axis=0)[used] / bound[:, None]

    signal, points = np.fft.rfft(record.u[:, 0])[lines], np.exp(2j * np.pi * lines / samples)
    return Track(signal, points, rows, record.y[used, 0] / bound, np.zeros((used.size, 0)))

"""Bounds from a record without excitation: the noise levels of outputs and of frequency responses."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from robustid.core import Frozen, Signal, as_array, as_count, as_float, as_kind, counted, freeze
from robustid.data import Bound, FrequencyResponse, TimeRecord
from robustid.errors import InputError
from robustid.estimation.frf import checked_records
from robustid.estimation.periodic import by_block, dft, inverse_spectra

# Lines around the one in question, and windows, whose largest noise is taken: with the factor 1.5 one line of normal noise
# goes beyond it with probability 8e-5.
_POOL = 100
_STILL = 0.05  # part of the experiment's input that may be left without excitation: noise of its measurement
_ON_LINE = 1e-6


@dataclasses.dataclass(frozen=True, eq=False)
class NoiseFloor(Frozen):
    """Outputs without excitation, ready to bound the noise of records with it; from `bounds_from_noise_floor`.

    Attributes
    ----------
    deviation : (T, ny) array
        Output minus its mean.
    mean : (ny,) array
        The offset of the sensors.
    level : (ny,) array
        ``factor * max_t |deviation|``: the bound on a sample.
    factor : float
    dt : float, s
    input_size : (nu,) array
        Largest deviation of the input from its mean: how still it was.
    outputs : tuple of Signal
    """

    deviation: np.ndarray
    mean: np.ndarray
    level: np.ndarray
    factor: float
    dt: float
    input_size: np.ndarray
    outputs: tuple[Signal, ...]

    def __post_init__(self) -> None:
        for name in ("deviation", "mean", "level", "input_size"):
            self._set(**{name: freeze(as_array(name, getattr(self, name)))})

    def probability(self, samples: int) -> float:
        """Probability that `samples` further ones of each output all stay within its largest deviation, for exchangeable noise.

        ``T/(T + samples)`` for one output: the largest of all T + samples lies anywhere with the same probability. Several
        outputs by adding what is missing to 1. It leaves the factor out: the probability of the bound is larger.
        """
        samples = as_count("samples", samples, least=1)
        return max(0.0, 1 - len(self.outputs) * samples / (len(self.deviation) + samples))

    def bound_record(self, record: TimeRecord) -> TimeRecord:
        """The record with the sensors' offset without excitation removed, and `level` as the bound of every used sample.

        ``|y[k] - mean - (response)[k]| <= factor * max |deviation|``, output by output; unused samples (``bound=inf``) stay so.

        Examples
        --------
        >>> import robustid as rid
        >>> noise = rid.prepare.bounds_from_noise_floor(rid.TimeRecord([0, 0, 0, 0], [5.1, 4.9, 5.0, 5.0], dt=0.1))
        >>> record = noise.bound_record(rid.TimeRecord([1, 1], [5.5, 6.0], dt=0.1))
        >>> record.y.ravel().round(9).tolist(), record.bound.ravel().round(9).tolist(), record.bound.kind
        ([0.5, 1.0], [0.15, 0.15], 'noise_floor')
        """
        self._check(record)
        level = np.broadcast_to(self.level, record.y.shape)
        samples = int(record.used.sum(axis=0).max())
        bound = Bound(level, kind="noise_floor").only(record.used)
        note = (
            f"{self.factor:g} times the largest deviation in {len(self.deviation)} samples without excitation,"
            f" whose mean is removed; {samples} further ones stay within the largest itself with probability"
            f" {self.probability(samples):.3g} if the noise is exchangeable"
        )
        return dataclasses.replace(record, y=record.y - self.mean, bound=bound, note=note)

    def bound_response(
        self, frf: FrequencyResponse, record: TimeRecord | Sequence[TimeRecord], *, period: int | None = None
    ) -> FrequencyResponse:
        """The response with the noise floor, divided by the input of the experiments, as its bound.

        ``|e_ij| <= sum_l N_i |U^-1|_lj``, ``e = Y_noise U^-1``: N_i (F,) is the factor times the largest DFT amplitude of output i
        without excitation, in windows as long as the experiment (as several of its periods, where the record is shorter),
        over the 100 values nearest to the line; U (nu, nu) holds the inputs of nu experiments side by side.

        Parameters
        ----------
        frf : FrequencyResponse
            Estimated from `record` with the same `period`; its frequency points are spectral lines of a period.
        record, period
            As for `estimate_frf`. Several blocks of experiments: the mean of their bounds, since errors may add up.

        Returns
        -------
        FrequencyResponse
            With a bound of kind "noise_floor", and the note with the probability that normal noise stays inside on all of them.

        Raises
        ------
        InputError
            A noise-floor record shorter than one period, an input that moved in it, points off the DFT grid, other signals.

        Notes
        -----
        For normal noise |Y_noise|^2 is exponentially distributed, and a new value exceeds f times the largest of m with the
        probability ``prod_{i=1..m} i/(i + f^2)``; all lines and outputs by adding up. Assumes an input that is known
        (its own noise is not in the bound), an open loop, and the same noise with and without excitation.
        """
        records = checked_records(record)
        for one in records:
            self._check(one)
        samples, nu = len(records[0].u), records[0].u.shape[1]
        if len(records) % nu:
            raise InputError(
                f"`record`: the noise is divided by what {nu} inputs hold in {nu} experiments, or a multiple of that; got"
                f" {len(records)}"
            )
        period = samples if period is None else as_count("period", period, least=2)
        index = self._lines(frf, samples, period)
        periods = min(samples, len(self.deviation)) // period
        if periods == 0:
            raise InputError(
                f"the noise-floor record has {len(self.deviation)} samples, fewer than one period of {period}; record"
                " longer without excitation"
            )
        peak, pool = _largest_nearby(dft(self._whole(periods * period)[None], periods * period), index * periods)
        spectra = dft(np.stack([r.u for r in records]), period)[:, :, index]
        u = by_block(spectra, nu).mean(axis=2)
        gain = np.abs(inverse_spectra(u, index, period, self.dt)).sum(axis=2).mean(axis=1)  # (F, nu)
        if frf.values.shape[1:] != (peak.shape[1], gain.shape[1]):
            raise InputError(
                f"`frf` has values of shape {frf.values.shape}, the records {counted(peak.shape[1], 'output')} and"
                f" {counted(gain.shape[1], 'input')}"
            )
        radius = self.factor * peak[:, :, None] * gain[:, None, :]
        bound = Bound(radius, kind="noise_floor", excitations=len(records) // gain.shape[1])
        beyond = np.exp(-np.log1p(self.factor**2 / np.arange(1, pool + 1)).sum())
        note = (
            f"{self.factor:g} times the largest of {pool} DFT values without excitation around each spectral line,"
            f" in windows of {periods} of the {samples // period} periods, divided by the input; normal noise stays inside on all"
            f" {index.size} spectral lines with probability {max(0.0, 1 - peak.size * beyond):.3g}"
        )
        return frf.with_bound(bound, note)

    def _whole(self, window: int) -> np.ndarray:
        """The deviation of whole windows."""
        return self.deviation[: len(self.deviation) // window * window]

    def _lines(self, frf: FrequencyResponse, samples: int, period: int) -> np.ndarray:
        as_kind("frf", frf, FrequencyResponse, "a FrequencyResponse")
        if samples % period:
            raise InputError(f"`period` = {period} must divide the {samples} samples of `record`")
        exact = frf.omega * (period * self.dt) / (2 * np.pi)
        index = np.round(exact).astype(int)
        if np.abs(exact - index).max() > _ON_LINE * max(1, index.max()):
            raise InputError(
                f"`frf` has frequency points between the spectral lines of `period` = {period} samples (every"
                f" {1 / (period * self.dt):g} Hz);"
                " give the period it was estimated with"
            )
        return index

    def _check(self, record: TimeRecord) -> None:
        as_kind("record", record, TimeRecord, "a TimeRecord")
        if abs(record.dt - self.dt) > 1e-9 * self.dt:
            raise InputError(
                f"`record` has dt = {record.dt:g} s, the noise-floor record {self.dt:g} s; they must agree"
            )
        if record.y.shape[1] != len(self.outputs) or record.u.shape[1] != self.input_size.size:
            raise InputError(
                f"`record` has {counted(record.y.shape[1], 'output')} and {counted(record.u.shape[1], 'input')}, the"
                " noise-floor record"
                f" {len(self.outputs)} and {self.input_size.size}"
            )
        moved = np.abs(record.u).max(axis=0)
        if np.any((self.input_size > _STILL * moved) & (moved > 0)):
            raise InputError(
                f"the input of the noise-floor record moves by up to {self.input_size.max():g}, where that of `record` reaches"
                f' {moved.max():g}: it was not still. Take a stretch without excitation: .window(start, stop, past="unknown")'
            )


def bounds_from_noise_floor(record: TimeRecord, *, factor: float = 1.5) -> NoiseFloor:
    """Noise levels of the outputs from a record without excitation, as bounds for records and frequency responses.

    Parameters
    ----------
    record : TimeRecord
        The noise-floor record, with the input at zero (or constant): a record of its own, or a stretch of one,
        ``record.window(start, stop, past="unknown")``. Only its used samples count.
    factor : float
        Safety factor over the largest noise that was seen, at least 1. For white normal noise and as many samples again 1 holds
        in 50 % of the records, 1.5 in more than 99 % (from 1000 samples on).

    Returns
    -------
    NoiseFloor
        Its `bound_record` and `bound_response` give data with a bound of kind "noise_floor". A bound of your own always wins:
        ``with_bound``.

    Raises
    ------
    InputError, InputTypeError
        A factor below 1, fewer than two used samples, something that isn't a TimeRecord.

    Notes
    -----
    Such a bound says what was seen, with a margin; it is not a proof. Without assuming a distribution, exchangeable noise
    stays within the largest of T samples for N further ones with probability T/(T + N) (`NoiseFloor.probability`).
    Drift, friction and what the excitation itself disturbs are not seen in it. As in `inanc2001`, section III, where
    the output without driving signal gave the noise levels in time and frequency.

    Examples
    --------
    >>> import numpy as np, robustid as rid
    >>> rng = np.random.default_rng(0)
    >>> silent = rid.TimeRecord(np.zeros(400), 0.1 * rng.standard_normal(400), dt=0.01)
    >>> u = np.tile(np.cos(2 * np.pi * 3 * np.arange(50) / 50), 4)
    >>> record = rid.TimeRecord(u, 2 * u + 0.1 * rng.standard_normal(200), dt=0.01, initial="periodic")
    >>> noise = rid.prepare.bounds_from_noise_floor(silent)
    >>> frf = noise.bound_response(rid.estimate_frf(record, period=50), record, period=50)
    >>> frf.bound.kind, bool(abs(frf.values[0, 0, 0] - 2) < frf.bound[0, 0, 0])
    ('noise_floor', True)
    """
    as_kind("record", record, TimeRecord, "a TimeRecord")
    factor = as_float("factor", factor)
    if factor < 1:
        raise InputError(f"`factor` must be at least 1, which is the largest noise that was seen; got {factor:g}")
    used = np.all(record.used, axis=1)
    u, y = record.u[used], record.y[used]
    if len(y) < 2:
        raise InputError(f"`record` has {len(y)} used sample; noise needs at least two, and better hundreds")
    deviation = y - y.mean(axis=0)
    level = factor * np.abs(deviation).max(axis=0)
    if not np.all(level > 0):
        name = record.outputs[int(np.argmin(level))].name
        raise InputError(
            f"`record`: output {name} is exactly constant: it bounds nothing; give the bound by `with_bound`"
        )
    return NoiseFloor(
        deviation, y.mean(axis=0), level, factor, record.dt, np.abs(u - u.mean(axis=0)).max(axis=0), record.outputs
    )


def _largest_nearby(spectra: np.ndarray, lines: np.ndarray) -> tuple[np.ndarray, int]:
    """The largest |value| among the `_POOL` nearest to each line, (F, ny), of (1, windows, bins, ny); and how many they are."""
    size = np.abs(spectra[0, :, 1:-1]).max(axis=0)  # without the mean, and without the last, which may be real
    width = min(-(-_POOL // spectra.shape[1]), len(size))
    if width == 0:
        raise InputError("the noise-floor record has too few samples for a DFT; record longer without excitation")
    start = np.clip(lines - 1 - width // 2, 0, len(size) - width)
    nearby = np.lib.stride_tricks.sliding_window_view(size, width, axis=0)[start]
    return nearby.max(axis=2), width * spectra.shape[1]

"""Records made ready: offsets and drifts, lower sample rates.

Every operation says what it does to the bound, so that a hard bound stays hard.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from robustid.core import Real, as_array, as_count, as_float, as_positive
from robustid.data.time_record import TimeRecord
from robustid.errors import InputError, InputTypeError, Remedy

# Lines up to this part of the new Nyquist frequency pass the filter; from the new Nyquist frequency on it blocks.
PASSBAND = 0.8
_UNIFORM = 1e-6  # relative difference of steps that are called the same
_NEAREST = 0.5  # part of a step: no instant is nearer to that of another sample, and none was lost
_SCATTER = 0.05  # part of a step by which instants of a uniform clock may be off: logs that a computer writes
# Of instants that were rounded: the unit of their last place at most, in steps (a lost sample is half of one off the line), and in
# lengths of the record, of which the step has a small part as its error; and most digits.
_LAST_PLACE, _OF_LENGTH, _DIGITS = 0.4, 1e-3, 12
_GAP, FEW = 1.5, 100  # median steps from which on samples are missing; samples of a part that is worth a word
_REACH = 26  # samples of the new rate that the filter reaches to either side: what 80 dB need over that transition
_BLOCKED_DB = 80.0  # what aliases into the new band is 1e-4 of what was there before


def sample_time(time: ArrayLike) -> float:
    """Sample time of a vector of sample instants in s; InputError says where they are not uniform.

    Examples
    --------
    >>> import robustid as rid
    >>> rid.prepare.sample_time([0.0, 0.5, 1.0])
    0.5
    """
    instants = as_array("time", time, ndim=1)
    return uniform_step(instants, instants.size)


def detrend(record: TimeRecord, *, kind: str = "mean", until: float | None = None) -> TimeRecord:
    """Remove the offset or the straight drift of the sensors, and nothing of the plant's response.

    Parameters
    ----------
    record : TimeRecord
        In periodic steady state: the mean of input, output and reference over the record (whole periods) is removed, which
        touches spectral line 0 only. From zero initial conditions: what is fitted to the output before `until`, while the input is
        still zero, is removed from the whole output. From an unknown state (and without a bound): a fit to all samples of
        every signal.
    kind : {"mean", "linear"}
        A straight line can't be told from the response over a period: "linear" is refused for periodic records.
    until : float, s
        From zero initial conditions only: the input is zero before it.

    Returns
    -------
    TimeRecord
        The bound grows by what the bound allows the fit to be wrong: it stays what it was, hard or not.

    Raises
    ------
    InputError
        No stretch to fit, an input that acts in it, a record from an unknown state with a bound (what is left of a transient
        in the fit is not bounded by it).

    Notes
    -----
    The fit is linear in the samples, ``fit[k] = sum_i x_i[k] (l_i' y)``, so that its error is at most
    ``sum_i |x_i[k]| |l_i|' bound``. Assumes an offset (a straight drift) of the sensors that is the same over the record.

    Examples
    --------
    >>> import robustid as rid
    >>> record = rid.TimeRecord([0, 0, 1, 1], [5.1, 4.9, 6.0, 7.0], dt=1.0, bound=0.2)
    >>> level = rid.prepare.detrend(record, until=2.0)
    >>> level.y.ravel().round(9).tolist(), level.bound.ravel().round(9).tolist()
    ([0.1, -0.1, 1.0, 2.0], [0.4, 0.4, 0.4, 0.4])
    """
    _check_record(record)
    if kind not in ("mean", "linear"):
        raise InputError(f'`kind` must be "mean" or "linear"; got {kind!r}')
    fitted = _fitted_stretch(record, kind, until)
    rows, weights = _line(record.u.shape[0], fitted, 1 if kind == "mean" else 2)
    changed = {"y": record.y}
    if record.initial != "rest":
        changed["u"] = record.u
        if record.reference is not None:
            changed["reference"] = record.reference
    changed = {name: signal - rows @ (weights @ signal[:fitted]) for name, signal in changed.items()}
    bound = record.bound
    if bound is not None:
        if not np.all(bound.used[:fitted]):
            raise InputError(
                "`record` has unused samples (an infinite `bound`) where the trend is fitted; detrend first"
            )
        bound = bound.widened(np.abs(rows) @ (np.abs(weights) @ bound.radius[:fitted]))
    past = record.largest_past_input + np.abs(record.u - changed["u"]).max() if record.initial == "free" else None
    return dataclasses.replace(record, **changed, bound=bound, past_input_bound=past)


def decimate(record: TimeRecord, factor: int) -> TimeRecord:
    """Keep every `factor`-th sample, after the same zero-phase low-pass filter on input, output and reference.

    ``y'[k] = sum_j h[j] y[factor k - j]``, h symmetric; likewise u': one filter on both leaves their ratio as it was.

    Parameters
    ----------
    record : TimeRecord
    factor : int
        At least 2; of a periodic record it must divide the number of samples.

    Returns
    -------
    TimeRecord
        With `dt` times `factor`, its input not `held`. Lines up to 0.8 of the new Nyquist frequency are kept (to 1e-4), those
        above are filtered out: leave them out of what is estimated. The bound is filtered by ``|h|``: no error within the old
        bound leaves the new one, and the worst one attains it. Samples whose filter reaches outside the record are dropped at
        both ends and the record is then one from an unknown state; a periodic record is continued by itself and stays whole.

    Raises
    ------
    InputError
        Fewer samples than the filter has (52 times `factor`), or a `factor` that does not divide the period.

    Notes
    -----
    Meant for `estimate_frf`: the response at a frequency point is that of the fast record, G(exp(j omega dt)). As time data of an
    identification a decimated record is approximate, since the filtered input is no staircase between its samples.
    A Kaiser window gives 80 dB: what aliases is below 1e-4 of what was filtered out.

    Examples
    --------
    >>> import numpy as np, robustid as rid
    >>> u = np.cos(2 * np.pi * 3 * np.arange(400) / 400)
    >>> record = rid.TimeRecord(u, 2 * u, dt=0.01, bound=0.1, initial="periodic")
    >>> slow = rid.prepare.decimate(record, 4)
    >>> slow
    <TimeRecord: 100 samples, 1x1, bound, periodic, dt=0.04 s>
    >>> bool(np.allclose(slow.y, 2 * u[::4, None], rtol=0, atol=3e-4))
    True
    """
    _check_record(record)
    factor = as_count("factor", factor, least=2)
    taps = _low_pass(factor)
    samples, reach = record.u.shape[0], taps.size // 2
    periodic = record.initial == "periodic"
    if periodic and samples % factor:
        raise InputError(f"`factor` = {factor} must divide the {samples} samples of a periodic record")
    if samples < taps.size:
        raise InputError(
            f"`record` has {samples} samples, fewer than the filter of `factor` = {factor}, which has {taps.size}"
        )

    long = {name: getattr(record, name) for name in ("u", "y", "reference")}
    long = {name: signal for name, signal in long.items() if signal is not None}
    if record.bound is not None:
        long["bound"] = record.bound.radius
    if periodic:
        long = {name: np.concatenate([signal[-reach:], signal, signal[:reach]]) for name, signal in long.items()}
    bound = long.pop("bound", None)
    slow = {name: _slowed(signal, taps, factor) for name, signal in long.items()}
    slow_bound = record.bound
    if slow_bound is not None and bound is not None:
        used = np.isfinite(bound)
        unused = _slowed((~used).astype(float), np.ones(taps.size), factor) > 0.5
        radius = np.where(unused, np.inf, _slowed(np.where(used, bound, 0.0), np.abs(taps), factor))
        if not np.any(np.isfinite(radius)):
            raise InputError(
                "`record` has too few used samples in a row (a finite `bound`) for the filter; decimate first"
            )
        slow_bound = dataclasses.replace(slow_bound, radius=radius)
    if periodic:
        return dataclasses.replace(record, **slow, bound=slow_bound, dt=factor * record.dt, held=False)
    past = np.abs(taps).sum() * max(np.abs(record.u).max(), record.largest_past_input)
    return dataclasses.replace(
        record, **slow, bound=slow_bound, dt=factor * record.dt, initial="free", past_input_bound=past, held=False
    )


def _fitted_stretch(record: TimeRecord, kind: str, until: float | None) -> int:
    """Number of samples from the start on that the trend is fitted to."""
    if record.initial != "rest":
        if until is not None:
            raise InputError(
                f'`until` is for records from zero initial conditions; this one is initial="{record.initial}"'
            )
        if record.initial == "periodic" and kind == "linear":
            raise InputError(
                '`kind` = "linear": a drift can\'t be told from the response in a periodic record; use "mean"'
            )
        if record.initial == "free" and record.bound is not None:
            raise InputError(
                "`record` has a bound and an unknown initial state: what its transient leaves in a fit is not bounded;"
                " detrend first and bound then, or fit before the input starts, from zero initial conditions"
            )
        return record.u.shape[0]
    if until is None:
        raise InputError(
            "`until` is needed for a record from zero initial conditions: the time in s before which its input is zero"
        )
    still = record.window(0.0, as_float("until", until), past="unknown")
    if np.any(still.u):
        first = int(np.flatnonzero(np.any(still.u, axis=1))[0])
        raise InputError(f"`until` = {until:g} s: the input acts from {first * record.dt:g} s on")
    if len(still.u) < 2:
        raise InputError(f"`until` = {until:g} s holds {len(still.u)} sample; give at least two")
    return len(still.u)


def _line(samples: int, fitted: int, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Rows x (samples, count), 1 and a centred time, and the weights l (count, fitted) of the least-squares fit."""
    time = np.arange(samples) - (fitted - 1) / 2
    rows = np.stack([np.ones(samples), time], axis=1)[:, :count]
    near = rows[:fitted]
    return rows, (near / (near**2).sum(axis=0)).T  # the two columns are orthogonal over the fitted samples


def _low_pass(factor: int) -> np.ndarray:
    """The taps of a symmetric low-pass filter with gain 1 at zero: a sinc under Kaiser's window."""
    middle = (1 + PASSBAND) / 2 / factor
    reach = _REACH * factor
    taps = np.sinc(middle * np.arange(-reach, reach + 1)) * np.kaiser(2 * reach + 1, 0.1102 * (_BLOCKED_DB - 8.7))
    return taps / taps.sum()


def _slowed(signal: np.ndarray, taps: np.ndarray, factor: int) -> np.ndarray:
    """Every `factor`-th sample of the convolution, where the filter lies inside the signal."""
    import scipy.signal

    # The full convolution is inside from 2 reach on, which `factor` divides.
    return scipy.signal.upfirdn(taps, signal, 1, factor, axis=0)[2 * _REACH : (signal.shape[0] - 1) // factor + 1]


def _check_record(record: object) -> None:
    if not isinstance(record, TimeRecord):
        raise InputTypeError(f"`record` must be a TimeRecord; got {type(record).__name__}")


def _rounded(time: Real, step: float) -> bool:
    """True of uniform instants that were rounded to so many decimal places or digits, as in files: 0.000488, 0.000977 of 1/2048 s.

    Each is within half a unit of its last place of what it was, and so are the first and the last one, which give the step: all
    are within a whole unit of the straight line between these.
    """
    size: Real = np.abs(time)
    sizes: Real = np.floor(np.log10(np.where(size > 0, size, size.max())))
    top = float(sizes.max())
    line: Real = time[0] + step * np.arange(time.size)
    off, length = float(np.max(np.abs(time - line))), float(time[-1] - time[0])
    unit = 10.0 ** math.floor(math.log10(min(_LAST_PLACE * step, _OF_LENGTH * length)))
    while off <= unit * (1 + _UNIFORM) and unit > 10.0 ** (top - _DIGITS):
        if any(_are_multiples(time, place) for place in (unit, unit * 10.0 ** (sizes - top))):
            return True
        unit /= 10
    return False


def _are_multiples(values: Real, unit: Real | float) -> bool:
    count: Real = np.abs(values) / unit
    return bool(np.all(np.abs(count - np.round(count)) <= 4 * np.finfo(float).eps * count))


def named_part(first: int, end: int) -> Remedy:
    """Words for the samples from `first` to before `end` of all arrays of a record."""
    return Remedy({}, f"`fields`, as u[{first}:{end}], of the time and all signals")


def uniform_step(
    time: np.ndarray, samples: int, part: Callable[[int, int], Remedy] = named_part, unit: float = 1.0
) -> float:
    """Sample time in s of instants that are uniform, in a unit of so many s; else a sentence.

    It has what names the samples from one to before another.
    """
    if time.shape != (samples,):
        words = f"the time has shape {time.shape} where `u` has {samples} samples; give "
        if time.ndim == 1 and 1 < time.size != samples and samples > 1:
            step = uniform_step(time, time.size, unit=unit)
            raise InputError(
                words, Remedy({"dt": float(f"{step:.9g}")}), ", the step of that time, instead", argument="time"
            )
        raise InputError(f"{words}`dt` instead")
    if samples < 2:
        raise InputError("one sample gives no sample time; give `dt`")
    steps = np.diff(as_array("time", time))
    step = as_positive("time step", (time[-1] - time[0]) / (samples - 1))
    if _uniform(time, step):
        return float(step) * unit
    off = clock_scatter(time)
    if off > _SCATTER and not _rounded(time, step):
        usual = float(np.median(steps))
        k = int(np.argmax(np.abs(steps - usual)))
        found = float(f"{_least_squares_step(time) * unit:.6g}")
        clock: list[str | Remedy] = ["give ", Remedy({"dt": found}), " to take it as uniform"]
        raise InputError(
            f"the time is not uniform: from {time[k] * unit:.9g} s (sample {k}) to {time[k + 1] * unit:.9g} s the step is"
            f" {steps[k] * unit:.6g} s, the median step {usual * unit:.6g} s; ",
            *_without_gap(time, steps > _GAP * usual, part),
            "resample the record, or ",
            *(clock if off < _NEAREST else ["give `dt`"]),
        )
    return _least_squares_step(time) * unit  # as all were rounded, or scatter


def clock_scatter(time: Real) -> float:
    """Largest distance of instants from a uniform clock, that of least squares, as a part of its step."""
    step = _least_squares_step(time)
    off = time - time.mean() - step * (np.arange(time.size) - (time.size - 1) / 2)
    return float(np.max(np.abs(off)) / step) if step > 0 else np.inf


def _least_squares_step(time: Real) -> float:
    places = np.arange(time.size) - (time.size - 1) / 2
    return float(places @ (time - time.mean()) / (places @ places))


def _uniform(time: Real, step: float) -> bool:
    return bool(np.max(np.abs(np.diff(time) - step)) <= _UNIFORM * step)


def _without_gap(time: Real, gap: NDArray[np.bool_], named: Callable[[int, int], Remedy]) -> list[str | Remedy]:
    """Advice to use the longest stretch without a gap, where it is uniform; none where there is none."""
    ends = np.concatenate([[0], np.flatnonzero(gap) + 1, [time.size]])
    k = int(np.argmax(np.diff(ends)))
    first, end = ends[k : k + 2].tolist()
    part = time[first:end]
    if not gap.any() or part.size < FEW:
        return []
    step = float(part[-1] - part[0]) / (part.size - 1)
    if not _uniform(part, step) and not _rounded(part, step):
        return []
    return ["samples are missing there; ", *longest_part(first, end, named), ", "]


def longest_part(first: int, end: int, named: Callable[[int, int], Remedy]) -> list[str | Remedy]:
    """Advice to use the samples from `first` to before `end`."""
    words = f"the longest part without a gap are the samples {first} to {end - 1}: name it by "
    return [words, named(first, end)]

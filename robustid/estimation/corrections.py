"""correct(): the data as they would be without a mistake of unit, sign, phase, order of axes, or delay."""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import math
from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from robustid.core import Options, as_float, as_kind, hz_words
from robustid.data import ENTRIES, LEVELS, SAME_FREQUENCY, Bound, FrequencyResponse, TimeRecord, detrend, points_at
from robustid.errors import InputError

_DEGREE = math.pi / 180
_MOST_DECIBELS = 400.0
_SEVERAL = "X ..."  # of a correction that takes one number or more
_STILL = 2  # samples before the input moves
_MOVED, _ROUNDED = (
    4.0,
    1e-12,
)  # standard deviations, and part of the values, that means of an output at rest may be apart
_Data = TypeVar("_Data", FrequencyResponse, TimeRecord)

# Mistakes in a response that corrections undo, in words.
MISTAKES = {
    "negate": "the response has the opposite sign",
    "exchange": "input and output of the response are exchanged",
    "times 0.001": "the response is in a unit 1000 times smaller (mm for m)",
    "times 1000": "the response is in a unit 1000 times larger (m for mm)",
    "times 0.5": "the response is twice too large (a one-sided spectrum, or peak for amplitude)",
    "times 2": "the response is half too small (a two-sided spectrum)",
    "times 57.29578": "the response is per degree, or in rad for degrees",
    "times 0.017453293": "the response is in degrees for rad",
    "times 1e-06": "the response is in a unit 10^6 times smaller (µm for m)",
    "times 1e+06": "the response is in a unit 10^6 times larger",
    "conjugate": "the phase has the wrong sign (the response is conjugated)",
    "transpose": "the matrices are transposed (rows are inputs)",
    "frequency in Hz": "the frequencies are in Hz and were taken as rad/s",
    "frequency in rad/s": "the frequencies are in rad/s and were taken as Hz",
    "frequency times 1000": "the frequencies are in kHz",
    "phase in radians": "the phase is in radians and was taken as degrees",
    "advance 1": "the response has one sample of delay too much",
    "delay 1": "one sample of delay was taken out of the response that it doesn't have",
    "integrate": "the response is the derivative of what was measured elsewhere (velocity for position)",
    "differentiate": "the response is the integral (position for velocity)",
    "integrate twice": "the response is of an acceleration, not of a position",
    "magnitude linear": "the magnitude is a plain number and was taken as decibels",
    "magnitude in dB": "the magnitude is in decibels and was taken as a plain number",
}


def correct(data: _Data, *corrections: str) -> _Data:
    """Undo mistakes of unit, sign, phase, order of axes or delay in measured data, one after the other.

    Of a response G: ``"conjugate"`` (another sign of the phase), ``"negate"``, ``"transpose"`` (rows were inputs), ``"exchange"``
    (the input was taken for the output: one over G), ``"times X"``, ``"differentiate"`` and ``"integrate"`` (times and over
    ``j omega``), ``"frequency in Hz"`` (numbers in Hz were taken as rad/s), ``"frequency in rad/s"``, ``"frequency times X"``,
    ``"phase in radians"`` (taken as degrees), ``"magnitude linear"`` (taken as decibels), ``"magnitude in dB"`` (taken as linear,
    all above 1), ``"advance X"`` and ``"delay X"`` (by X samples), ``"bound times X"``, ``"leave out X ..."`` (the frequency points
    at so many Hz), ``"leave out above X"``, ``"leave out below X"`` (Hz). Of a record: ``"negate"``, ``"times X"`` (outputs),
    ``"exchange"``, ``"time times X"``, ``"advance X"`` (outputs are X samples late), ``"delay X"``, ``"bound times X"``,
    ``"detrend"`` (input and output are about a point of operation, from which both are counted then), ``"detrend linear"`` (outputs
    drift along a straight line).

    Parameters
    ----------
    data : FrequencyResponse or TimeRecord
    *corrections : str

    Returns
    -------
    FrequencyResponse or TimeRecord
        Bounds go with the values: they turn, and are scaled with them. Where phase or magnitude had another unit they stay as
        they were stated. Of an exchanged record the bound keeps its part of the rms of the output.

    Raises
    ------
    InputError
        Words that are none of these, or none for such data; frequencies that would pass pi/dt; a response that is not 1x1, or has
        no sample time, where that is needed; a frequency point to leave out that isn't there.

    Examples
    --------
    >>> import robustid as rid
    >>> frf = rid.FrequencyResponse([1.0, 2.0], [1 + 1j, 0.5j], bound=0.01)
    >>> rid.prepare.correct(frf, "conjugate", "times 0.001").values.ravel().tolist()
    [(0.001-0.001j), -0.0005j]
    """
    as_kind("data", data, (FrequencyResponse, TimeRecord), "a FrequencyResponse or a TimeRecord")
    known = _OF_RESPONSES if isinstance(data, FrequencyResponse) else _OF_RECORDS
    for words in corrections:
        name, number = _parsed(words, known)
        changed: Any = known[name][0](data, *number)
        data = changed
    return data


def _parsed(words: str, known: dict[str, tuple[Callable[..., Any], str]]) -> tuple[str, tuple[float, ...]]:
    """Name of a correction, and its numbers if it has any."""
    parts = str(words).split()
    for count in range(len(parts), 0, -1):
        name, rest = " ".join(parts[:count]), parts[count:]
        if name not in known:
            continue
        wanted = known[name][1]
        if len(rest) == len(wanted.split()) or (wanted == _SEVERAL and rest):
            with contextlib.suppress(ValueError):
                return name, tuple(as_float("number", float(number)) for number in rest)
    spelled = ", ".join(f'"{name} {numbers}"' if numbers else f'"{name}"' for name, (_, numbers) in known.items())
    raise InputError(f"a correction of such data must be one of {spelled}; got {' '.join(parts)!r}")


# --- of responses ---------------------------------------------------------------------------------------------------------------


def _scaled(frf: FrequencyResponse, factor: ArrayLike) -> FrequencyResponse:
    """The response times a number, or one for every frequency point, with all that has its unit."""
    by: NDArray[np.complex128] = np.broadcast_to(np.asarray(factor, complex), frf.omega.shape)[:, None, None]
    if np.any(by == 0) or not np.all(np.isfinite(by)):
        raise InputError(
            "a correction makes values 0 or infinite; leave out the frequency 0, and give a factor above 0"
        )
    size = np.abs(by)
    bound = frf.bound
    if isinstance(bound, Bound):
        ellipsoid = None if bound.ellipsoid is None else size**2 * bound.ellipsoid
        radius = None if bound.radius is None else size * bound.radius
        bound = dataclasses.replace(bound, radius=radius, ellipsoid=ellipsoid).turned(by / size)
    levels = {name: size * level for name in LEVELS if (level := getattr(frf, name)) is not None}
    covariance = None if frf.covariance is None else size**2 * frf.covariance
    doubt = None if frf.doubt is None else by * frf.doubt
    return dataclasses.replace(frf, values=by * frf.values, bound=bound, covariance=covariance, doubt=doubt, **levels)


def _differentiated(frf: FrequencyResponse) -> FrequencyResponse:
    return _scaled(frf, 1j * frf.omega)


def _integrated(frf: FrequencyResponse) -> FrequencyResponse:
    if np.any(frf.omega == 0):
        raise InputError('"integrate" divides by omega, which is 0 at one frequency point; leave it out')
    return _scaled(frf, 1 / (1j * frf.omega))


def _conjugated(frf: FrequencyResponse) -> FrequencyResponse:
    changes: Options = {"values": frf.values.conj(), "doubt": None if frf.doubt is None else frf.doubt.conj()}
    if frf.covariance is not None:
        changes["covariance"] = frf.covariance.conj()
    if isinstance(frf.bound, Bound):
        parts = {name: part.conj() for name in ("tilt", "ellipsoid") if (part := getattr(frf.bound, name)) is not None}
        changes["bound"] = dataclasses.replace(frf.bound, **parts)
    return dataclasses.replace(frf, **changes)


def _transposed(frf: FrequencyResponse) -> FrequencyResponse:
    if isinstance(frf.bound, Bound) and frf.bound.joint != "entry":
        raise InputError(f'"transpose" needs a bound of every entry; this one is of the {frf.bound.joint}')
    arrays = {name: getattr(frf, name) for name in ENTRIES}
    changes: Options = {name: part.transpose(0, 2, 1) for name, part in arrays.items() if part is not None}
    if isinstance(frf.bound, Bound):
        tilt = None if frf.bound.tilt is None else frf.bound.tilt.transpose(0, 2, 1)
        changes["bound"] = dataclasses.replace(frf.bound, radius=frf.bound.radius.transpose(0, 2, 1), tilt=tilt)
    if frf.covariance is not None:
        ny, nu = len(frf.outputs), len(frf.inputs)
        order = np.add.outer(np.arange(ny), ny * np.arange(nu)).ravel()
        changes["covariance"] = frf.covariance[:, order[:, None], order]
    if frf.values.shape[1] != frf.values.shape[2]:
        changes |= {"inputs": frf.outputs, "outputs": frf.inputs}
    return dataclasses.replace(frf, coherence=None, **changes)


def _inverted(frf: FrequencyResponse) -> FrequencyResponse:
    """One over the response: the disc around 1/v is the image of the disc around v."""
    if frf.values[0].size > 1:
        raise InputError(f'"exchange" needs one input and one output; the response is {frf.values.shape[1:]}')
    v, bound = frf.values, frf.bound
    if bound is None and not np.all(v):
        raise InputError('"exchange" takes one over values that are 0 at one frequency point; leave it out')
    changes: Options = {"inputs": frf.outputs, "outputs": frf.inputs}
    if bound is None:
        return dataclasses.replace(_bare(frf), values=1 / v, **changes)
    r = bound.outer_radius
    if np.any(r >= np.abs(v)):
        raise InputError('"exchange" takes one over values that may be 0: their bound is larger than they are')
    room = np.abs(v) ** 2 - r**2
    disc = dataclasses.replace(bound, radius=r / room, tilt=None, joint="entry", ellipsoid=None)
    return dataclasses.replace(_bare(frf), values=v.conj() / room, bound=disc, **changes)


def _bare(frf: FrequencyResponse) -> FrequencyResponse:
    return dataclasses.replace(frf, bound=None, covariance=None, **dict.fromkeys((*LEVELS, "doubt")))


def _stretched(frf: FrequencyResponse, factor: float) -> FrequencyResponse:
    if factor <= 0:
        raise InputError(f'"frequency times X" needs X > 0; got {factor:g}')
    return dataclasses.replace(frf, omega=factor * frf.omega)


def _radians(frf: FrequencyResponse) -> FrequencyResponse:
    angle = np.angle(frf.values) / _DEGREE
    return dataclasses.replace(frf, values=np.abs(frf.values) * np.exp(1j * angle), covariance=None)


def _linear(frf: FrequencyResponse) -> FrequencyResponse:
    """20 log10 |G|, with the sign that a negative one takes into the phase."""
    size = np.abs(frf.values)
    if np.any(size <= 0):
        raise InputError('"magnitude linear" takes the logarithm of the magnitude, which is 0 at one frequency point')
    values = 20 * np.log10(size) * np.exp(1j * np.angle(frf.values))
    return dataclasses.replace(frf, values=values, covariance=None)


def _from_decibels(frf: FrequencyResponse) -> FrequencyResponse:
    size = np.abs(frf.values)
    if size.max() > _MOST_DECIBELS:
        raise InputError(f'"magnitude in dB" would make a gain of {size.max():.4g} dB; these are no decibels')
    values = 10 ** (size / 20) * np.exp(1j * np.angle(frf.values))
    return dataclasses.replace(frf, values=values, covariance=None)


def _bound_times(data: _Data, factor: float) -> _Data:
    if data.bound is None or factor <= 0:
        raise InputError(f'"bound times X" needs data with a bound, and X > 0; got {factor:g}')
    return data.with_bound(data.bound.inflated(factor), data.note)


def _advanced(frf: FrequencyResponse, samples: float) -> FrequencyResponse:
    if frf.dt is None:
        raise InputError('"advance N" and "delay N" count samples; this response has no sample time')
    return frf.without_delay(samples * frf.dt)


def _delayed(frf: FrequencyResponse, samples: float) -> FrequencyResponse:
    return _advanced(frf, -samples)


def leaving_out(frf: FrequencyResponse, lines: Sequence[int]) -> str:
    """The correction that leaves out these frequency points, by their number."""
    return "leave out " + " ".join(written_hz(frf, line) for line in lines)


def written_hz(frf: FrequencyResponse, line: int) -> str:
    """Frequency in Hz with as many digits as tell the point from its neighbours, five at least."""
    hz, text = frf.freq_hz, ""
    for digits in range(5, 18):
        text = f"{hz[line]:.{digits}g}"
        if hz[int(np.argmin(np.abs(hz - float(text))))] == hz[line]:
            break
    return text


def _left_out(frf: FrequencyResponse, *left_out_hz: float) -> FrequencyResponse:
    kept = np.ones(frf.omega.size, bool)
    for hz in left_out_hz:
        at = points_at(frf.omega, 2 * np.pi * hz)
        if not at.size:
            nearest = frf.freq_hz[int(np.argmin(np.abs(frf.freq_hz - hz)))]
            raise InputError(
                f'"leave out {hz:.6g}": no frequency point is there; the nearest one is at {hz_words(nearest, 6)}'
            )
        kept[at] = False
    return _kept(frf, kept)


def _left_out_above(frf: FrequencyResponse, hz: float) -> FrequencyResponse:
    return _kept(frf, frf.freq_hz <= hz * (1 + SAME_FREQUENCY))


def _left_out_below(frf: FrequencyResponse, hz: float) -> FrequencyResponse:
    return _kept(frf, frf.freq_hz >= hz * (1 - SAME_FREQUENCY))


def _kept(frf: FrequencyResponse, kept: NDArray[np.bool_]) -> FrequencyResponse:
    if not kept.any():
        raise InputError('"leave out" leaves no frequency point of the response; leave one in')
    return frf.select(kept)


# --- of records -----------------------------------------------------------------------------------------------------------------


def _outputs_times(record: TimeRecord, factor: float) -> TimeRecord:
    if factor == 0:
        raise InputError('"times X" needs another number than 0')
    bound = None if record.bound is None else record.bound.inflated(abs(factor))
    return dataclasses.replace(record, y=factor * record.y, bound=bound)


def _exchanged(record: TimeRecord) -> TimeRecord:
    bound = record.bound
    if bound is not None:
        if record.u.shape != record.y.shape:
            raise InputError('"exchange" of a record with a bound needs as many inputs as outputs')
        size = np.sqrt(np.mean(record.u**2, axis=0)) / np.sqrt(np.mean(record.y**2, axis=0))
        bound = dataclasses.replace(bound, radius=bound.radius * size)
    return dataclasses.replace(
        record, u=record.y, y=record.u, bound=bound, inputs=record.outputs, outputs=record.inputs
    )


def _slower(record: TimeRecord, factor: float) -> TimeRecord:
    if factor <= 0:
        raise InputError(f'"time times X" needs X > 0; got {factor:g}')
    return dataclasses.replace(record, dt=factor * record.dt)


def _outputs_advanced(record: TimeRecord, samples: float) -> TimeRecord:
    """Outputs moved earlier: as without a delay of so many samples."""
    if samples >= 0 or record.initial == "periodic":
        return record.without_delay(samples * record.dt)
    late = round(-samples)
    if late != -samples or not late < len(record.u):
        raise InputError(f'"delay N" of a record needs a whole number of samples; got {-samples:g}')
    # Outputs before the record are not known: the first samples are not used.
    y = np.concatenate([np.zeros((late, record.y.shape[1])), record.y[:-late]])
    bound = record.bound
    if bound is not None:
        radius = np.concatenate([np.full((late, record.y.shape[1]), np.inf), bound.radius[:-late]])
        bound = dataclasses.replace(bound, radius=radius)
    return dataclasses.replace(record, y=y, bound=bound)


def _detrended(record: TimeRecord) -> TimeRecord:
    """Record about its point of operation: by what is measured before the input moves, else by its means."""
    if record.initial != "rest":
        return detrend(record)
    moves = np.flatnonzero(np.any(record.u != record.u[0], axis=1))
    still = int(moves[0]) if moves.size else 0
    if still < _STILL or not _stands_still(record, still):
        return detrend(dataclasses.replace(record, initial="free"))
    reference = None if record.reference is None else record.reference - record.reference[0]
    return detrend(dataclasses.replace(record, u=record.u - record.u[0], reference=reference), until=still * record.dt)


def _stands_still(record: TimeRecord, still: int) -> bool:
    """Return whether the first outputs stay within their bounds of one level; or both halves, to what neighbours scatter."""
    y = record.y[:still]
    if record.bound is not None:
        return bool(np.all(np.ptp(y, axis=0) <= 2 * record.bound.radius[:still].max(axis=0)))
    half, size = still // 2, np.abs(y).max(axis=0)
    noise = np.diff(y, axis=0).std(axis=0) / np.sqrt(2)
    apart = np.abs(y[:half].mean(axis=0) - y[-half:].mean(axis=0))
    return bool(np.all(apart <= _MOVED * noise * np.sqrt(2 / half) + _ROUNDED * size))


def _without_line(record: TimeRecord) -> TimeRecord:
    """Record without the straight lines of its signals, from an unknown state."""
    return detrend(dataclasses.replace(record, initial="free"), kind="linear")


def _outputs_delayed(record: TimeRecord, samples: float) -> TimeRecord:
    return _outputs_advanced(record, -samples)


_OF_RESPONSES: dict[str, tuple[Callable[..., FrequencyResponse], str]] = {
    "conjugate": (_conjugated, ""),
    "negate": (functools.partial(_scaled, factor=-1.0), ""),
    "transpose": (_transposed, ""),
    "exchange": (_inverted, ""),
    "times": (_scaled, "X"),
    "differentiate": (_differentiated, ""),
    "integrate": (_integrated, ""),
    "frequency in Hz": (functools.partial(_stretched, factor=2 * math.pi), ""),
    "frequency in rad/s": (functools.partial(_stretched, factor=1 / (2 * math.pi)), ""),
    "frequency times": (_stretched, "X"),
    "phase in radians": (_radians, ""),
    "magnitude linear": (_linear, ""),
    "magnitude in dB": (_from_decibels, ""),
    "advance": (_advanced, "X"),
    "delay": (_delayed, "X"),
    "bound times": (_bound_times, "X"),
    "leave out": (_left_out, _SEVERAL),
    "leave out above": (_left_out_above, "X"),
    "leave out below": (_left_out_below, "X"),
}
_OF_RECORDS: dict[str, tuple[Callable[..., TimeRecord], str]] = {
    "negate": (functools.partial(_outputs_times, factor=-1.0), ""),
    "times": (_outputs_times, "X"),
    "exchange": (_exchanged, ""),
    "time times": (_slower, "X"),
    "advance": (_outputs_advanced, "X"),
    "delay": (_outputs_delayed, "X"),
    "bound times": (_bound_times, "X"),
    "detrend": (_detrended, ""),
    "detrend linear": (_without_line, ""),
}

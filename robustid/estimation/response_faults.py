"""Faults of measured responses before any class is assumed: phase, magnitude, frequency axis, scatter."""

from __future__ import annotations

import dataclasses
import weakref

import numpy as np

from robustid.core import Complex, Real
from robustid.data import Fault, FaultKind, FrequencyResponse, as_frequency_response
from robustid.errors import InputError
from robustid.estimation.corrections import MISTAKES, correct
from robustid.estimation.line_faults import line_faults
from robustid.estimation.outlying_lines import noise_in_bounds, related
from robustid.estimation.pole_fit import PoleFit
from robustid.estimation.roughness import roughness

_POLES, _POINTS, _FEWEST, _ENTRIES = 20, 400, 16, 4
_ALIKE = 3  # lines of overlapping windows that say as much as one: such a window has about three for each unknown
# A correction is believed when a stable model then leaves a third of what it left, and at most so much of the response.
_BETTER, _GOOD, _BAD = 3.0, 0.2, 0.05
_JUMPS, _SMOOTH = (
    0.5,
    0.15,
)  # median change of the phase in rad, and of the logarithm of the magnitude, from point to point
_FLAT = 1.2 * np.pi**2 / 180  # rad: the phase of -pi to pi rad that was taken as degrees
_WHOLE = 1e-4  # a number of samples so near to a whole one is whole
_MOST_SAMPLES = 10**6
_LESS = 0.7  # of the part of each value that is left, which a correction must reach too
_SMALL = 1e-9  # part of the largest value, below which no part of it makes sense
_CONSTANT = 1e-6  # part of a response that varies, below which it is a constant
_OUTSIDE = 1.5  # noise in units of its bound, rms, that no bound holds
_EVEN = 0.4  # times the rms, that noise has in the median: .83 where it is as large everywhere
_FAR = 3.0  # bounds in the median, of scatter that is uneven: modes between the points leave up to 2.1
_DECIBELS, _DYNAMIC = 6.0, 160.0  # by which a magnitude in decibels varies at least, and at most in any measurement
_FOUND: weakref.WeakKeyDictionary[FrequencyResponse, tuple[Fault, ...]] = weakref.WeakKeyDictionary()
_OF_STABLE = {
    "conjugate": FaultKind.PHASE_SIGN,
    "phase in radians": FaultKind.PHASE_UNIT,
    "magnitude linear": FaultKind.MAGNITUDE_UNIT,
    "magnitude in dB": FaultKind.MAGNITUDE_UNIT,
    "exchange": FaultKind.EXCHANGED,
}


def response_faults(frf: FrequencyResponse) -> tuple[Fault, ...]:
    """Faults of a response that no class has to be assumed for, with the correction, the most telling first.

    A response of a stable plant is close to a stable rational function; that of its conjugate, of its inverse, or with a phase or a
    magnitude in another unit, is not. Frequencies of a DFT are whole multiples of 1/(N dt) Hz. What a smooth model leaves, if
    it is unrelated from one frequency point to the next, is noise, and has to be below the bound.

    Parameters
    ----------
    frf : FrequencyResponse

    Returns
    -------
    tuple of Fault
        Empty where nothing is wrong, fewer than 16 frequency points say nothing, or the response was `judged` before.

    Raises
    ------
    InputTypeError
        Something that isn't a FrequencyResponse.

    Examples
    --------
    >>> import numpy as np, robustid as rid
    >>> s = 1j * np.linspace(1, 20, 60)
    >>> G = 1 / (s**2 + 0.2 * s + 100)
    >>> rid.prepare.response_faults(rid.FrequencyResponse(s.imag, G))
    ()
    >>> wrong = rid.FrequencyResponse(s.imag, G.conj())
    >>> (fault,) = rid.prepare.response_faults(wrong)
    >>> fault.words, fault.correction
    ('the phase has the wrong sign (the response is conjugated)', 'conjugate')
    """
    frf = as_frequency_response("frf", frf)
    if frf.judged:
        return ()
    if (known := _FOUND.get(frf)) is None:
        known = _FOUND[frf] = _found(frf)
    return known


def all_faults(frf: FrequencyResponse) -> list[Fault]:
    """Faults that a response brings with it, and those that it shows, of kinds that it doesn't bring: each fault once."""
    known = {fault.kind for fault in frf.faults}
    if FaultKind.UNSTABLE in known:  # poles outside the circle are those of the conjugate inside
        known.add(FaultKind.PHASE_SIGN)
    return [*frf.faults, *(fault for fault in response_faults(frf) if fault.kind not in known)]


def _found(frf: FrequencyResponse) -> tuple[Fault, ...]:
    axis = _axis(frf)
    cleaned = line_faults(frf)
    whole = _stable(cleaned.rest)
    if whole:  # what is in another unit is off its neighbours too
        return (*axis, *whole)
    return (*axis, *cleaned.faults, *([] if axis else _scattered(cleaned.joined) or _beyond(cleaned.beyond)))


def _axis(frf: FrequencyResponse) -> list[Fault]:
    """Numbers of an axis that are those of a DFT in the other unit."""
    omega = frf.omega[frf.omega > 0]
    if frf.dt is None or omega.size < _FEWEST:
        return []
    steps = np.diff(frf.omega)
    step = float(np.min(steps[steps > 0], initial=np.inf))
    if not np.isfinite(step) or not _multiples(omega, step):
        return []
    found: list[Fault] = []
    for correction, of, other in (("frequency in Hz", 1.0, "Hz"), ("frequency in rad/s", 4 * np.pi**2, "rad/s")):
        samples, given = of / (step * frf.dt), 2 * np.pi / (step * frf.dt)
        if _is_whole(samples) and not _is_whole(given) and (of > 1 or omega[-1] * frf.dt * 2 <= 1 + _WHOLE):
            evidence = (
                f"as numbers in {other} they are those of a DFT of {round(samples)} samples of {frf.dt:g} s; as they were taken, of"
                f" {given:.6g}, which is none; they are right after the correction"
            )
            found.append(Fault(FaultKind.FREQUENCY_UNIT, MISTAKES[correction], evidence, correction, size=given))
    return found


def _multiples(omega: Real, step: float) -> bool:
    """True where all frequencies are whole multiples of the smallest step."""
    return bool(np.all(np.abs(omega / step - np.round(omega / step)) < _WHOLE * np.maximum(omega / step, 1)))


def _is_whole(samples: float) -> bool:
    return 2 <= samples <= _MOST_SAMPLES and abs(samples - round(samples)) < _WHOLE


def _stable(frf: FrequencyResponse) -> list[Fault]:
    """Corrections after which a stable model fits, where none does before."""
    whole = ~frf.missing.any(axis=(1, 2))
    if frf.bound is not None:  # what may as well be zero is no shape
        size, bound = (np.linalg.norm(one, axis=(1, 2)) for one in (frf.values, frf.bound.outer_radius))
        whole &= size > bound
    alike = _ALIKE if related(frf) else 1
    if int(whole.sum()) < _FEWEST * alike or not np.any(frf.values[whole]):
        return []
    part = _representative(frf.select(whole))
    before, poles = misfit(part, alike=alike)
    if jumping := _jumping(part, before):
        return jumping
    if before < _BAD:
        return []
    after: dict[str, float] = {}
    for correction in _OF_STABLE:
        if correction == "phase in radians" and np.abs(np.angle(part.values)).max() > _FLAT:
            continue
        # A magnitude is 0 or more, and so many decibels are a factor of 1 or more.
        if correction == "magnitude linear" and np.abs(part.values).min() < 1 - _WHOLE:
            continue
        if correction == "magnitude in dB" and not _DECIBELS <= np.ptp(np.abs(part.values)) <= _DYNAMIC:
            continue
        try:
            changed = [correct(one, correction) for one in _entries(part)]
        except InputError:
            continue
        left = max(misfit(one, alike=alike)[0] for one in changed)
        # In parts of each value too: a few large values, of an inverse or of what isn't in decibels, make all else small.
        if left <= min(_GOOD, before / _BETTER):
            own, *each = (misfit(one, relative=True, alike=alike)[0] for one in (part, *changed))
            others = max(each)
            # Of values that are powers, or logarithms, of others the largest say nothing of the rest.
            less = 1 / _BETTER if correction.startswith("magnitude") else _LESS
            after |= {correction: left} if others <= less * own else {}
    best = min(after, key=lambda name: after[name], default=None)
    if best is None or not _contradicted(_representative(frf.select(whole), bounded=True), best, alike):
        return []
    words = f"a stable model of {poles} poles leaves {100 * before:.2g} % of it, {100 * after[best]:.2g} % after the correction"
    return [Fault(_OF_STABLE[best], MISTAKES[best], words, best, size=before)]


def _contradicted(frf: FrequencyResponse, correction: str, alike: int) -> bool:
    """Return whether a correction leaves a third in units of the bounds too; what is large and unsure says little."""
    if frf.bound is None or np.any(frf.bound.outer_radius == 0) or correction.startswith("magnitude"):
        return True  # bounds of a magnitude stay as they were stated
    entries = _entries(frf)
    before, after = (
        max(_in_bounds(one, alike) for one in each) for each in (entries, [correct(one, correction) for one in entries])
    )
    return after <= before / _BETTER


def _in_bounds(frf: FrequencyResponse, alike: int) -> float:
    """Root mean square, in units of the bound, of what the best stable model leaves of an entry."""
    fit, bound = PoleFit(dataclasses.replace(frf, bound=None), feedthrough=True), frf.bound.outer_radius
    fit.weight = 1 / (bound.reshape(fit.values.shape) * np.sqrt(bound.size))
    return float(np.sqrt(fit.search(_poles(frf, alike), np.zeros(1), decades=False)[0][0]))


def _poles(frf: FrequencyResponse, alike: int) -> int:
    """Poles of a model: at most one for four lines that are not alike."""
    return min(_POLES, frf.omega.size // (4 * alike)) // 2 * 2


def _jumping(frf: FrequencyResponse, before: float) -> list[Fault]:
    """A phase that jumps where the magnitude is smooth."""
    phase = np.abs(np.angle(frf.values[1:] * frf.values[:-1].conj()))
    size = np.abs(np.diff(np.log(np.maximum(np.abs(frf.values), np.finfo(float).tiny)), axis=0))
    jump, smooth = float(np.median(phase)), float(np.median(size))
    if before < _GOOD or jump < _JUMPS or smooth > _SMOOTH:
        return []
    words = (
        f"from one frequency point to the next it changes by {jump:.2g} rad, the magnitude by {100 * smooth:.2g} %. Read the file"
        " again with the phase as phase_deg"
    )
    return [Fault(FaultKind.PHASE_UNIT, "the phase is in degrees and was taken as radians", words, size=jump)]


def _scattered(frf: FrequencyResponse) -> list[Fault]:
    """A bound that is smaller than the scatter around a smooth model, where what that leaves is white from point to point."""
    if frf.bound is None or len(frf.omega) < 2 * _FEWEST or np.any(frf.missing):
        return []
    judged: list[tuple[bool, float, float]] = []
    for one in _entries(_representative(frf, bounded=True)):
        if noise_in_bounds(one) <= 1:
            continue
        found = roughness(one)
        bound: Real = one.bound.outer_radius
        left = np.abs(found.residual) / bound.reshape(-1)
        size = float(np.sqrt(np.mean(left**2)))
        # Modes narrower than the points are apart look like noise, in a part of the axis.
        even = bool(np.median(left) >= min(_EVEN * size, _FAR))
        if size >= _OUTSIDE and found.white and (even or not found.falling):
            judged.append((even, size, float(left.max())))
    if not judged:
        return []
    _, worst, times = max(judged)
    factor = float(f"{1.2 * times:.3g}")
    words = (
        f"around a smooth model the values scatter by {worst:.2g} times their bound (rms), unrelated from one frequency point to"
        " the next, so that it is noise; it is covered after the correction"
    )
    said = "the bounds are smaller than the noise of the response"
    return [Fault(FaultKind.SMALL_BOUND, said, words, f"bound times {factor:g}", size=worst)]


def _beyond(times: float) -> list[Fault]:
    """A bound that is smaller than what one model of many lines leaves, of several of them."""
    if not times:
        return []
    words = (
        f"one model of many lines leaves several of them outside their bounds, by up to {times:.3g} times them; they are inside"
        " after the correction"
    )
    said = "the bounds are smaller than the noise of the response"
    return [Fault(FaultKind.SMALL_BOUND, said, words, f"bound times {1.2 * times:.3g}", size=times)]


def _representative(frf: FrequencyResponse, *, bounded: bool = False) -> FrequencyResponse:
    """At most 400 frequency points, without what a fit of plain least squares doesn't use."""
    points = np.unique(np.linspace(0, frf.omega.size - 1, _POINTS).astype(int))
    chosen = frf.select(points)
    return dataclasses.replace(chosen, covariance=None, bound=chosen.bound if bounded else None)


def _entries(frf: FrequencyResponse) -> list[FrequencyResponse]:
    """The largest entries, each alone."""
    nu = len(frf.inputs)
    size = np.linalg.norm(frf.values, axis=0).ravel()
    largest = np.argsort(size)[::-1][:_ENTRIES]
    return [frf.entry(*divmod(int(k), nu)) for k in largest if size[k] > 0]


def misfit(frf: FrequencyResponse, *, relative: bool = False, alike: int = 1) -> tuple[float, int]:
    """Part that the best stable model of up to 20 poles leaves of each of the largest entries, and the number of poles.

    The largest part, rms, of what varies: a constant says nothing; or of each value. So many lines that are `alike` say as much as
    one.
    """
    poles = _poles(frf, alike)
    left = [0.0]
    for one in _entries(frf):
        fit = PoleFit(one, feedthrough=True)
        values: Complex = one.values
        varies = float(np.linalg.norm(values - np.mean(np.real(values))))
        if varies <= _CONSTANT * float(np.linalg.norm(values)):
            continue
        size: Real = np.maximum(np.abs(fit.values), _SMALL * float(np.abs(fit.values).max())) * np.sqrt(values.size)
        fit.weight = 1 / size if relative else np.full(fit.values.shape, 1 / varies)
        # Real poles over decades follow an improper response too, with which those of the band have trouble: that is to be seen.
        costs, _ = fit.search(poles, np.zeros(1), decades=False)
        left.append(float(np.sqrt(costs[0])))
    return max(left), poles

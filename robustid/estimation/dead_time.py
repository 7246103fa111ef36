"""Dead time of a response in whole samples, behind which fewer poles describe it: the question whose it is; or its lead."""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import numpy as np

from robustid.core import Real, counted
from robustid.data import Fault, FaultKind, FrequencyResponse
from robustid.estimation.pole_fit import PoleFit

_LATEST = 100  # samples
_POINTS = 200  # frequency points that stand for all
_HIGHEST, _PATIENCE = 16, 3  # order; orders in a row that don't pay
_FEWEST = 16
_STEP = 0.5  # in units of pi over the highest omega: delays that are tried first
_OUTPUTS = 4  # that are looked at
_LEAST = 2  # samples: one may be that of the hold
_EARLIEST = 10  # samples of lead,
_CLEARER = 1.0  # with which the description is shorter by so much a frequency point
_SURE = float(np.log(1e4))  # nats by which the description is shorter: odds of one in so many that it is chance
_EXACT = 1e-24
_ALIKE = 0.5  # of the noise: independent errors of a point leave more
_NOISE = 2.0  # squares that a description leaves, in those of the noise: what leaves less has nothing to describe


def most_delay(frf: FrequencyResponse, dt: float) -> int:
    """Largest delay in samples to try: the mean slope of the phase of an entry, which lags behind a dead time of its own accord."""
    used = ~frf.missing.any(axis=(1, 2))
    if used.sum() < 2:
        return 0
    omega, phase = frf.omega[used], np.unwrap(np.angle(frf.values[used]), axis=0)
    slope = (phase[0] - phase[-1]).max() / (omega[-1] - omega[0])
    return int(np.clip(slope / dt, 0, _LATEST))


def delay_fault(frf: FrequencyResponse, read: bool, held: bool = False) -> Fault | None:
    """The question whose a delay is that a response holds, or an output that comes before its input; None without either.

    Of a response that was not `read` the records are late. Leads are sought where inputs are known to be `held` between samples.

    The largest entry of every output is looked at; outputs with different delays have no correction that is of all.
    """
    size = np.linalg.norm(np.where(frf.missing, 0, frf.values), axis=0)
    names = [one.name for one in frf.outputs]
    late = {
        i: dead_time(frf.entry(i, int(np.argmax(size[i])))) for i in np.argsort(-size.max(axis=1))[:_OUTPUTS].tolist()
    }
    found = {i: late[i] for i in sorted(late) if late[i]}
    if frf.dt is None or not (found or held):
        return None
    if not found:
        early = {i: lead(frf.entry(i, int(np.argmax(size[i])))) for i in sorted(late)}
        return _early(early, names, read) if any(early.values()) else None
    samples, of = max(found.values()), f"output{'s' * (len(found) > 1)} {', '.join(names[i] for i in found)}"
    verb, seconds = "answers" if len(found) == 1 else "answer", samples * frf.dt
    words = (
        f"{of} {verb} about {counted(samples, 'sample')} ({seconds:.4g} s) late, and nobody stated a delay: it is the"
        " plant's, or a channel"
        " comes late"
    )
    evidence = (
        "fewer poles describe the response behind this delay than without it, and the data cannot tell the two apart. If it"
        f" is the plant's, state delay = {samples} in [modes] (--delay {samples}), or seconds = {seconds:.6g} in [delay], which"
        " takes it out of the data; if not, undo it"
    )
    correction = f"advance {samples}" if len(set(late.values())) == 1 else ""
    return Fault(FaultKind.DELAY, words, evidence, correction, "" if read else of, size=float(samples))


def _early(each: dict[int, int], names: list[str], read: bool) -> Fault:
    """Outputs that come before their input, all as many samples or some of them."""
    samples, which = max(each.values()), [names[i] for i in each if each[i]]
    of = f"output{'s' * (len(which) > 1)} {', '.join(which)}"
    verb = "comes" if len(which) == 1 else "come"
    words = f"{of} {verb} {counted(samples, 'sample')} before what the input can cause: no stable plant does that"
    evidence = "fewer poles describe the response ahead of its input, which is held between samples, than behind it"
    correction = f"delay {samples}" if len(set(each.values())) == 1 else ""
    return Fault(FaultKind.LATE, words, evidence, correction, "" if read else of, size=-float(samples))


def lead(frf: FrequencyResponse) -> int:
    """Samples by which a response comes before its held input, 2 at least; 0 where one that does not is about as short, or leaves
    no more than the noise.

    As `dead_time`. Without a hold mobilities, whose size rises with the frequency, would be told of a lead. Errors of a response
    from few windows are alike at neighbouring points: what comes on both sides of the input describes them too.
    """
    seen = _seen(frf)
    if seen.omega.size < _FEWEST or not seen.dt:
        return 0
    points = np.unique(np.linspace(0, seen.omega.size - 1, _POINTS).astype(int))
    fit = PoleFit(dataclasses.replace(seen.select(points), bound=None), feedthrough=True)
    found = _lengths(fit, list(range(-_EARLIEST, 2)))
    best, plain = min(found, key=lambda d: found[d].length), min(found[0], found[1])
    noise = seen.covariance is not None and plain.left <= _NOISE * fit.samples
    clearly = plain.length > found[best].length + _SURE + _CLEARER * fit.samples
    return -best if best <= -_LEAST and clearly and not noise else 0


def dead_time(frf: FrequencyResponse) -> int:
    """Samples of delay that a response holds, 2 at least; 0 where a plant without any is as short a description.

    To the sample where the frequency points reach far enough; a few poles take over a part of it where they don't.

    Partial fractions of rising order behind every delay up to the slope of the phase, by the shortest description (MDL); those
    behind at most one sample must be longer by ``ln 10^4``.
    """
    seen = _seen(frf)
    most = most_delay(seen, seen.dt) if seen.dt else 0
    if most < _LEAST or seen.omega.size < _FEWEST:
        return 0
    points = np.unique(np.linspace(0, seen.omega.size - 1, _POINTS).astype(int))
    fit = PoleFit(dataclasses.replace(seen.select(points), bound=None), feedthrough=True)
    step = max(1, int(_STEP * np.pi / (float(fit.omega[-1]) * float(fit.dt or 1))))
    least = 0.0 if seen.covariance is None else _ALIKE
    lengths = _lengths(fit, sorted({0, 1, *range(_LEAST, most + 1, step)}), least)
    best = min(lengths, key=lambda d: lengths[d].length)
    lengths |= _lengths(
        fit, [d for d in range(best - step + 1, best + step) if _LEAST <= d <= most and d not in lengths], least
    )
    best = min(lengths, key=lambda d: lengths[d].length)
    return best if best >= _LEAST and min(lengths[0], lengths[1]).length > lengths[best].length + _SURE else 0


class Description(NamedTuple):
    """A description: its length in nats, and the sum of squares that it leaves, in units of the deviations."""

    length: float
    left: float


def _lengths(fit: PoleFit, delays: list[int], least: float = 0.0) -> dict[int, Description]:
    """The shortest description behind each delay, where a point leaves so much at least."""
    found = dict.fromkeys(delays, Description(np.inf, np.inf))
    seconds: Real = np.array(delays) * float(fit.dt or 1)
    worse = 0
    for order in range(1, _HIGHEST + 1) if delays else ():
        if worse == _PATIENCE or fit.unknowns(order) >= 2 * fit.samples:
            break
        before = min(found.values()).length
        costs, _ = fit.search(order, seconds)
        for delay, cost in zip(delays, costs.tolist(), strict=True):
            # What is far less than the noise of points is of errors that are alike at neighbouring ones.
            left = np.log(max(cost / fit.samples, least) + _EXACT)
            length = fit.samples * left + fit.unknowns(order) / 2 * np.log(2 * fit.samples)
            found[delay] = min(found[delay], Description(float(length), cost))
        worse = 0 if min(found.values()).length < before else worse + 1
    return found


def _seen(frf: FrequencyResponse) -> FrequencyResponse:
    """The frequency points that say something: measured, and larger than their bound."""
    size = np.linalg.norm(frf.values, axis=(1, 2))
    least = np.zeros(size.size) if frf.bound is None else np.linalg.norm(frf.bound.outer_radius, axis=(1, 2))
    seen = ~frf.missing.any(axis=(1, 2)) & (size > least)
    return frf.select(seen) if seen.any() else frf.select(slice(0, 1))

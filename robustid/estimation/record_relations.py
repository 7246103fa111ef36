"""Relations within records: between records, halves of a record, output and input; by a rational model of the records."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence

import numpy as np

from robustid.core import Complex, Real, counted
from robustid.data import Fault, FaultKind, TimeRecord
from robustid.estimation.innovations import own_continuation
from robustid.estimation.record_model import Fitted, Piece, predictions_with, without_transient
from robustid.estimation.record_parts import (
    FEW,
    GOOD,
    LEAST,
    RATIO,
    Compared,
    Signals,
    compared_parts,
    fit,
    of_all_poles,
    percent,
    shifted,
    stretch_of,
)
from robustid.estimation.stretch import stretch_length

_LOOKED = 3  # records and outputs of which the halves are looked at
_SUSPECT, _BETTER = 1.5, 5.0  # ratio from which a clock is tried; times by which it must leave less
_LATE, _LONGEST, _AHEAD = 8, 960, (3, 10, 30)  # samples
_EARLY = 10.0  # how many times less an output that comes earlier must leave
_ALIKE, _CLOSE = 2.0, 1.3  # parts that are the same
# Times less that is left from the output to the input: noise of the input leaves less there, too. By half the poles, this suffices.
_EXCHANGED, _SIMPLER = 100.0, 5.0
_UNITS = (1e-6, 1e-3, 0.01, np.pi / 180, 0.5, 1.0, 2.0, 180 / np.pi, 100.0, 1e3, 1e6)
_SAME, _NOTHING = 0.02, 1e-9
_COMPUTED = 1e-3  # part of the input that the output leaves open: a controller makes it, no model of the plant is there
# With these no model of the records can be judged.
_BROKEN = {
    FaultKind.CONSTANT,
    FaultKind.SATURATED,
    FaultKind.STUCK,
    FaultKind.WRONG_PERIOD,
    FaultKind.LOST,
    FaultKind.HELD,
    FaultKind.QUANTISED,
    FaultKind.NO_RESPONSE,
    FaultKind.UNSTABLE,
}


def with_relations(found: list[Fault], records: Sequence[TimeRecord], period: int | None) -> list[Fault]:
    """Faults of relations, then those found before that they don't explain."""
    computed = any(fault.kind is FaultKind.FEEDBACK and (fault.size or 0) < _COMPUTED for fault in found)
    if computed or any(fault.kind in _BROKEN for fault in found):
        return found
    more = relation_faults(records, period)
    kinds = {fault.kind for fault in more}
    explained = {FaultKind.FEEDBACK} if kinds & {FaultKind.EXCHANGED, FaultKind.LATE} else set[FaultKind]()
    if kinds & {
        FaultKind.UNIT,
        FaultKind.SIGN,
        FaultKind.OTHER_PLANT,
        FaultKind.CLOCK,
        FaultKind.VARYING,
        FaultKind.LOST,
    }:
        explained |= {FaultKind.DISTURBED}
    if FaultKind.EXCHANGED in kinds:
        explained |= {FaultKind.NOISY_INPUT, FaultKind.DISTURBED}
    return more + [fault for fault in found if fault.kind not in explained]


def relation_faults(records: Sequence[TimeRecord], period: int | None) -> list[Fault]:
    """Faults that a rational model of the records shows: records, or halves of them, unlike; late, early and exchanged signals.

    With a transient of each, spectra of whole records need no windows. Records of the same length only.
    """
    given = [_whole(one, period) for one in records]
    found, long = list[Fault](), stretch_length(len(records[0].inputs), len(records[0].outputs))
    for i, channel in enumerate(records[0].outputs):
        where = f"output {channel.name}"
        signals = [
            Signals(one.u, one.y[:, i], record.initial == "periodic")
            for one, record in zip(given, records, strict=True)
            if np.ptp(one.y[:, i]) > 0 and np.any(np.ptp(one.u, axis=0) > 0)
        ]
        if len(signals) < len(given) or len(given[0].u) < 4 * FEW:
            continue
        used = [stretch_of(one, long) for one in signals]
        base = fit(used[:1], ())
        if base is None:
            continue
        own = _unlike(used, base, where)
        if not own and records[0].reference is None:
            own = _placed(used, fit(used[:2], (base.poles,)) or base, records, where)
        if not own:
            step = max(1, len(signals) * len(records[0].outputs) // _LOOKED)
            for k in range(0, len(signals), step):
                own = _varying(signals[k], base, where, period, long)
                if own:
                    own = [fault._replace(record=k + 1 if len(signals) > 1 else 0) for fault in own]
                    break
        found += own
    return found


def _whole(record: TimeRecord, period: int | None) -> TimeRecord:
    """Whole periods."""
    if period is None or len(record.u) < 2 * period or len(record.u) % period == 0:
        return record
    samples = len(record.u) // period * period
    return TimeRecord(record.u[:samples], record.y[:samples], dt=record.dt, initial="free")


# --- records against each other -------------------------------------------------------------------------------------------------


def _unlike(signals: list[Signals], base: Fitted, where: str) -> list[Fault]:
    """Record of another sign, unit, or plant than the others."""
    if len(signals) < 2:
        return []
    compared = compared_parts(signals, base)
    if compared is None or not compared.different:
        return []
    count = len(signals)
    rests = [_by_others(compared, k) for k in range(count)]
    # The odd one is the worst by the others' model, though they fit together without it; of two, the first.
    odd = 0
    if count > 2:
        without = [compared_parts(signals[:k] + signals[k + 1 :], base) for k in range(count)]
        odd = int(np.argmin([one.ratio if one is not None else np.inf for one in without]))
    gain, plain, rest = rests[odd]
    against = f"record {2 - odd}" if count == 2 else "the other records"
    evidence = (
        f"one model of the records leaves {percent(compared.together)} of it, models of each {percent(compared.alone)}"
    )
    limit = max(RATIO * compared.alone, min(LEAST, plain / RATIO))
    if gain != 0 and (factor := _exact(gain) if rest < limit else _joining(signals, odd, gain, base)):
        gain = gain if rest < limit else 1 / factor
        if factor == -1:
            words = f"{where} has the opposite sign of that of {against}"
            return [Fault(FaultKind.SIGN, words, evidence, "negate", where, odd + 1, -1.0)]
        words = (
            f"{where} answers its input {gain:.4g} times as much as that of {against}: another unit, or another range"
        )
        return [Fault(FaultKind.UNIT, words, evidence, f"times {factor:.8g}", where, odd + 1, gain)]
    if not of_all_poles(compared).different:
        return []
    words = (
        f"{where} answers the input in another way than that of {against}: of another plant, or the same one at another point of"
        " operation; estimate the response of each record alone"
    )
    return [Fault(FaultKind.OTHER_PLANT, words, evidence, "", where, odd + 1, float(np.sqrt(compared.together)))]


def _exact(gain: float) -> float:
    """Factor that undoes a gain: that of a unit where it is one."""
    usual = [one for one in _UNITS if abs(abs(gain) * one - 1) < _SAME]
    return float(np.copysign(usual[0] if usual else float(f"{1 / abs(gain):.4g}"), gain))


def _joining(signals: list[Signals], odd: int, gain: float, base: Fitted) -> float:
    """Factor with which a record is one of the others, by what a model of all leaves; 0 where none is.

    Of a plant of several inputs the others may predict a record poorly, and its gain: that of a unit nearby is tried first.
    """
    near, one = min(_UNITS, key=lambda unit: abs(np.log(abs(gain) * unit))), signals[odd]
    for factor in (float(np.copysign(near, gain)), _exact(gain)):
        if factor == 1:
            continue
        # Of the input: an output made small would be left by no model, whatever it is.
        joined = compared_parts([*signals[:odd], one._replace(u=one.u / factor), *signals[odd + 1 :]], base)
        if joined is not None and not joined.different:
            return factor
    return 0.0


def _by_others(compared: Compared, k: int) -> tuple[float, float, float]:
    """Gain of a record by the model of the others, and what that leaves of it without the gain and with it."""
    one, others = compared.pieces[k], [of for number, of in enumerate(compared.pieces) if number != k]
    poles = compared.models[k - 1].poles
    predicted = without_transient(one.z, poles, _predicted(others, one, poles))
    output = without_transient(one.z, poles, one.output)
    gain = float(predicted @ output / max(float(predicted @ predicted), 1e-300))
    power = float(np.sum(np.abs(one.output) ** 2))
    plain, rest = (float(np.sum((output - g * predicted) ** 2)) / power for g in (1.0, gain))
    return gain, plain, rest


def _predicted(others: Sequence[Piece], one: Piece, poles: Complex) -> Complex:
    """Output of a piece by the model of others."""
    weightless = Piece(one.z, _NOTHING * one.inputs, np.zeros_like(one.output))
    return predictions_with([*others, weightless], poles)[-1] / _NOTHING


# --- output and input ------------------------------------------------------------------------------------------------------------


def _placed(signals: list[Signals], base: Fitted, records: Sequence[TimeRecord], where: str) -> list[Fault]:
    """Output that comes before its input, or long after it; input and output exchanged. Where a reference tells that the loop
    is closed only what comes late is told: a plant that is not stable makes an output that stable models have from later inputs.
    """
    used, closed = signals[:2], any(one.reference is not None for one in records)

    @functools.cache
    def model(shift: int) -> Fitted | None:
        return fit(used, (), shift=shift)

    def part(shift: int) -> float:
        return _part(model(shift))

    # What comes too early is followed worse by models that answer later: else the first of them was a poor one.
    least = min(base.part, part(3)) if base.part > LEAST / 10 else base.part
    ahead = part(-_AHEAD[1]) if least > LEAST / 10 and not closed else np.inf
    if ahead < least / _ALIKE:
        ahead = min(part(-shift) for shift in _AHEAD)
    turned = None
    continued = any(own_continuation(one) for one in used[0].u.T)
    single = len(records[0].outputs) == len(records[0].inputs) == 1 and not continued
    if least > LEAST / 10 and single and not closed:
        turned = fit([Signals(one.y[:, None], one.u[:, 0]) for one in used], ())
    swapped, times = _part(turned), _SIMPLER if _simpler(turned, base) else _EXCHANGED
    if swapped < least / times and swapped < ahead / _ALIKE and swapped < GOOD:
        names = f"input {records[0].inputs[0].name} and {where}"
        words = f"{names} are exchanged: a stable model from the output to the input leaves {percent(swapped)} of it"
        evidence = f"from the input to the output {percent(base.part)}"
        return [Fault(FaultKind.EXCHANGED, words, evidence, "exchange", names, 0, float(np.sqrt(base.part / swapped)))]
    if continued:  # the answer of any time is as good
        return []
    if ahead < least / _EARLY and ahead < GOOD and records[0].held:
        first = next(shift for shift in _AHEAD if part(-shift) < max(_ALIKE * ahead, base.part / _EARLY**2))
        # A search may find poles after one shift, by chance, that it does not find after another: they are tried, too.
        others = [model(shift) for shift in (_AHEAD[0], *(-early for early in _AHEAD))]
        tried = [one.poles for one in others if one is not None]
        if ahead < _part(fit(used, [*tried, *(np.concatenate([base.poles, one]) for one in tried)])) / _EARLY:
            return [_early(where, -_largest(part, -first, _ALIKE * part(-first)), base.part, ahead)]
    # A shift by less than the delay leaves a simpler plant, one by more leaves what no stable model predicts.
    if part(_LATE + 1) > _CLOSE * max(base.part, 1e-12) or min(base.part, part(20), part(40)) > GOOD / 5:
        return []
    limit = _CLOSE * max(min(base.part, part(_LATE + 1), part(20), part(40)), 1e-12)
    if not (reach := max((s for s in (_LATE + 1, 20, 40, 80) if part(s) <= limit), default=0)):
        return []
    count = _largest(part, reach, limit) - 1  # one is that of the hold
    if count < _LATE or (with_ := model(count)) is None:
        return []
    # A search may find few poles at one shift, by chance, that it does not find at another: half of a delay costs poles, too.
    without, half = (fit(used, (with_.poles,), shift=shift) for shift in (0, count // 2))
    if without is None or (half is not None and half.criterion < with_.criterion):
        return []
    far = with_.part < min(least, without.part) / _EARLY and without.part > LEAST / 10
    if not (far or _simpler(with_, without)):
        return []
    words = f"{where} comes at least {counted(count, 'sample')} after its input: a delay, which costs a model an order a sample"
    evidence = f"with it a model leaves {percent(with_.part)}, without it {percent(without.part)}"
    return [Fault(FaultKind.LATE, words, evidence, f"advance {count}", where, 0, float(count))]


def _early(where: str, count: int, plain: float, ahead: float) -> Fault:
    """The fault of an output that comes so many samples early, by what models leave of it before the correction and after."""
    words = f"{where} comes {count} sample{'s' * (count > 1)} before what its input can cause: no plant does that,"
    words += (
        " but one that is not stable, in its loop: of that one give the reference and the controller instead ([loop])"
    )
    evidence = f"a stable model leaves {percent(plain)} of it, {percent(ahead)} after the correction"
    return Fault(FaultKind.LATE, words, evidence, f"delay {count}", where, 0, -float(count))


def _simpler(one: Fitted | None, other: Fitted) -> bool:
    """Return whether a model has at most half the poles of another one."""
    return one is not None and 2 * _order(one) <= _order(other)


def _order(model: Fitted) -> int:
    return model.poles.size + int(np.sum(np.imag(model.poles) != 0))


def _part(model: Fitted | None) -> float:
    return np.inf if model is None else model.part


def _largest(part: Callable[[int], float], good: int, limit: float) -> int:
    """Largest shift at which no more than the limit is left, from one at which that is so."""
    step = 1
    while part(good + step) <= limit and step < _LONGEST:
        good, step = good + step, 2 * step
    while step > 1:
        step //= 2
        if part(good + step) <= limit:
            good += step
    return good


# --- halves of a record ----------------------------------------------------------------------------------------------------------


def _varying(one: Signals, base: Fitted, where: str, period: int | None, long: int) -> list[Fault]:
    """Halves of a record that are of two plants; or of one, with a clock, or with samples that were lost."""
    halves = _halves(one, period, long)
    compared = None if halves is None else compared_parts(halves, base)
    if (
        halves is None
        or compared is None
        or compared.ratio < _SUSPECT
        or compared.together - compared.alone < LEAST / 10
    ):
        return []
    compared = of_all_poles(compared)
    evidence = f"a model of both halves leaves {percent(compared.together)} of it"
    shift = _delay_between(compared)
    length = len(halves[0].u)
    later = length if len(one.u) <= long else len(one.u) - length
    lost = round(shift)
    moved = None
    if lost and abs(lost) < length // 4:
        late = shifted(halves[1], lost)
        moved = compared_parts([Signals(halves[0].u[: len(late.u)], halves[0].y[: len(late.u)]), late], base)
        moved = None if moved is None else of_all_poles(moved)
    clock, ticking = _clock(one, base, halves, shift / later, long) if shift else (0.0, None)
    left = np.inf if ticking is None else of_all_poles(ticking).together
    if left < min(compared.together / _BETTER, np.inf if moved is None else moved.together / _ALIKE):
        words = (
            f"{where} has another clock than the input: it is {abs(clock):.3g} {'slower' if clock > 0 else 'faster'}, so that the"
            f" delay changes by {abs(clock) * len(one.y):.2g} samples over the record; resample it, or take one clock"
        )
        after = f"{evidence}, {percent(left)} with one clock"
        return [Fault(FaultKind.CLOCK, words, after, where=where, size=clock)]
    if moved is not None and moved.together < compared.together / _BETTER:
        word = "earlier" if lost < 0 else "later"
        words = f"{where} comes {abs(lost)} sample{'s' * (abs(lost) > 1)} {word} in the second half of the record than in the first"
        words += ": samples were lost; use the two parts as two records"
        after = f"{evidence}, {percent(moved.together)} without that"
        return [Fault(FaultKind.LOST, words, after, where=where, size=float(lost))]
    if not compared.different:
        return []
    words = f"{where} answers the input in the second half of the record in another way than in the first: the plant changes"
    words += "; use shorter records"
    after = f"{evidence}, models of each {percent(compared.alone)}"
    return [Fault(FaultKind.VARYING, words, after, where=where, size=float(np.sqrt(compared.together)))]


def _halves(one: Signals, period: int | None, long: int) -> list[Signals] | None:
    """First and second half, of whole periods; of a very long record as much of them as a stretch has, at its ends."""
    half, step = len(one.u) // 2, period or 1
    half = min(half // step, max(long // 2 // step, 1)) * step
    return [Signals(one.u[:half], one.y[:half]), Signals(one.u[-half:], one.y[-half:])] if half >= 4 * FEW else None


def _delay_between(compared: Compared) -> float:
    """Delay in samples of the second half against the first, by the phase of what the model of the first predicts."""
    first, second = compared.pieces
    predicted = _predicted([first], second, compared.models[0].poles)
    cross, angle = second.output * predicted.conj(), np.angle(second.z)
    most = min(60.0, 0.5 * np.pi / float(np.median(np.diff(np.sort(angle)))))
    delays = np.arange(-most, most, 0.1 * np.pi / float(angle.max()))
    fit = np.real(np.exp(1j * delays[:, None] * angle) @ cross)
    best = float(delays[np.argmax(fit)])
    fine = best + np.linspace(-1, 1, 201) * 0.1 * np.pi / float(angle.max())
    return float(fine[np.argmax(np.real(np.exp(1j * fine[:, None] * angle) @ cross))])


def _clock(
    one: Signals, base: Fitted, halves: Sequence[Signals], start: float, long: int
) -> tuple[float, Compared | None]:
    """Clock of the output, in part of that of the input, with which the halves are alike."""
    import scipy.interpolate

    samples, length = len(one.y), len(halves[0].y)
    beside = samples if samples <= long else length  # of a very long record around its ends
    ends: list[tuple[Signals, Real, Real, Callable[[Real], Real]]] = []
    for half, first in zip(halves, (0, samples - length), strict=True):
        place = np.arange(max(first - beside, 0), min(first + length + beside, samples), dtype=float)
        spline = scipy.interpolate.CubicSpline(place, one.y[int(place[0]) : int(place[-1]) + 1])
        ends.append((half, np.arange(first, first + length, dtype=float), place, spline))

    def tried(slow: float) -> Compared | None:
        moved = [
            half._replace(y=np.asarray(spline(np.clip(n * (1 + slow), place[0], place[-1]))))
            for half, n, place, spline in ends
        ]
        return compared_parts(moved, base)

    best, found, width = start, tried(start), 0.3
    for _ in range(4):
        for way in (-1, 1):
            slow = best * (1 + way * width)
            one_ = tried(slow)
            if one_ is not None and (found is None or one_.together < found.together):
                best, found = slow, one_
                break
        width /= 2.5
    return best, found

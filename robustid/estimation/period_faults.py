"""Faults that whole periods show: transients, drifts, noise of a record or of the input, tones, sample instants that are off."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from robustid.core import Complex, Real
from robustid.data import Fault, FaultKind, TimeRecord
from robustid.estimation.events import without_period
from robustid.estimation.noise_in_inputs import WITHOUT_CONTROLLER
from robustid.estimation.periodic import EXCITED, dft, transient_periods, without_drift
from robustid.estimation.synchronous_tones import synchronous_tones
from robustid.estimation.tone_faults import amplitudes, keeps_on, tone_fault, tones_beside

_NOISY = 2.0  # times the median of the records
_DRIFTS = 0.05  # part of the rms of an output
_INPUT_NOISE = 0.05  # of the input at the lines that carry it
_CARRYING = 0.2  # of its largest line
_DECAYS = 1.4  # times the power by which any later period differs from the late ones
_CHANCE = 1e-4

_FEWEST = 4  # periods of all records

_SHARE = 0.3  # of the scatter that grows with the slope

_SHIFTED = 0.5  # of the scatter that the slope itself explains: another clock

_GROUP, _GROUPS = 10, 4  # neighbouring lines that are taken together, and groups at least

_COHERENT = 0.3  # of the groups

_WORSE = 2.0  # times what is left where the response is taken for the relation of the scatter

_ROUNDING = 1e-20  # of the power of a signal


def period_faults(records: list[TimeRecord], period: int, told: set[tuple[int, str]]) -> list[Fault]:
    """Faults of whole periods; nothing of the signals of a record of which enough is told, (record from 0, where)."""
    periods = len(records[0].u) // period
    # Of the later half, where transients have died out.
    kept = slice(min(periods // 2, periods - 2) * period, periods * period)
    y, drift = without_drift(np.stack([r.y[kept] for r in records]), period)
    u, _ = without_drift(np.stack([r.u[kept] for r in records]), period)
    several = len(records) > 1
    names = [f"output {one.name}" for one in records[0].outputs]
    transient = _transients(records, period, told)
    found = list(transient)
    unsteady = {(max(fault.record - 1, 0), fault.where) for fault in transient}
    size = drift / np.maximum(y.std(axis=1), np.finfo(float).tiny)
    for k, i in np.argwhere(size > _DRIFTS):
        if (int(k), names[i]) in told | unsteady:
            continue
        words = f"{names[i]} drifts by {100 * size[k, i]:.2g} % of its rms; the drift over whole periods is removed"
        number = int(k) + 1 if several else 0
        found.append(Fault(FaultKind.DRIFT, words, where=names[i], record=number, size=float(size[k, i])))
    tones = _tones(records, period, told | unsteady)
    found += tones
    if several:
        found += _noisy(u, y, period, names, told | {(k, fault.where) for fault in tones for k in range(len(records))})
    known = told | {(k, fault.where) for fault in found for k in range(len(records))}
    part = _steady(records, period)
    all_u, all_y = (
        without_drift(np.stack([one[part] for one in signals]), period)[0]
        for signals in ([r.u for r in records], [r.y for r in records])
    )
    jitter = jitter_faults(records, all_y, period, known)
    return found + jitter + (loop_faults(records, all_u, all_y, period) or _input_noise(records, u, period))


def _steady(records: list[TimeRecord], period: int) -> slice:
    """Samples of whole periods: all of records in steady state, else the later half of them."""
    periods = len(records[0].u) // period
    first = 0 if all(r.initial == "periodic" for r in records) else min(periods // 2, periods - 2)
    return slice(first * period, periods * period)


def _noisy(u: Real, y: Real, period: int, names: list[str], told: set[tuple[int, str]]) -> list[Fault]:
    """Noise of one record unlike that of the others, and not because its input is larger too."""
    # standard deviation between the periods
    cut = y.reshape(len(y), -1, period, y.shape[2])
    noise = np.sqrt(cut.var(axis=1, ddof=1).mean(axis=1))
    level: Real = np.sqrt(np.mean(np.var(u, axis=1), axis=1))[:, None]
    part = noise / np.where(level > 0, level, np.inf)
    usual, usual_part = (
        np.sort(one, axis=0)[(len(noise) - 1) // 2] for one in (noise, part)
    )  # of two, the quieter one's
    noisy = (noise > _NOISY * np.where(usual > 0, usual, np.inf)) & (noise > _NOISY * usual_part * level)
    found: list[Fault] = []
    for k, i in np.argwhere(noisy):
        if (int(k), names[i]) in told:
            continue
        times = float(noise[k, i] / usual[i])
        words = (
            f"{names[i]} differs from period to period {times:.2g} times as much as in the other records: something disturbed"
            " it; leave the record out, or measure it again"
        )
        found.append(Fault(FaultKind.DISTURBED, words, where=names[i], record=int(k) + 1, size=times))
    return found


def _transients(records: list[TimeRecord], period: int, told: set[tuple[int, str]]) -> list[Fault]:
    """First periods that differ from later ones, of records that are stated to be in periodic steady state."""
    found: list[Fault] = []
    whole = len(records[0].u) // period * period
    for k, record in enumerate(records):
        if record.initial != "periodic" or whole < 4 * period:
            continue
        y, _ = without_drift(record.y[None, :whole], period)
        u = record.u[None, :whole]
        size = np.abs(dft(u, period).mean(axis=(0, 1)))
        size[0] = 0
        index = np.flatnonzero(np.all(size >= EXCITED * size.max(axis=0), axis=1) & np.all(size.max(axis=0) > 0))
        if index.size == 0:
            continue
        for i, channel in enumerate(record.outputs):
            where = f"output {channel.name}"
            if (k, where) in told:
                continue
            late, _ = transient_periods(dft(y[:, :, i : i + 1], period), index)
            if late == 0:
                continue
            cut = y[0, :, i].reshape(-1, period)
            settled = cut[cut.shape[0] // 2 :].mean(axis=0)
            away = np.sqrt(np.mean((cut - settled) ** 2, axis=1))
            # In parts of what noise would give: the mean follows the periods that it is of.
            count = cut.shape[0] - cut.shape[0] // 2
            usual = np.where(np.arange(cut.shape[0]) < cut.shape[0] // 2, 1 + 1 / count, 1 - 1 / count)
            power = away**2 / usual
            if power[0] < _DECAYS * power[1:].max():
                continue  # periods that differ, but not because of how the record began
            part = float(away[0] / max(float(cut.std()), np.finfo(float).tiny))
            first = "period differs" if late == 1 else f"{late} periods differ"
            words = (
                f"{where} is not in steady state from the start: its first {first} from the later ones, the first by"
                f" {100 * part:.2g} % of the rms; leave {late} periods out, or state another initial state than periodic"
            )
            number = k + 1 if len(records) > 1 else 0
            found.append(Fault(FaultKind.TRANSIENT, words, where=where, record=number, size=part))
    return found


def _tones(records: list[TimeRecord], period: int, told: set[tuple[int, str]]) -> list[Fault]:
    """Tones that do not repeat with the period, and those that do."""
    kept = _steady(records, period)
    y, _ = without_drift(np.stack([r.y[kept] for r in records]), period)
    dt, found = records[0].dt, list[Fault]()
    names = [f"output {one.name}" for one in records[0].outputs]
    for i, where in enumerate(names):
        heard = [
            (k, tones)
            for k, one in enumerate(y[:, :, i])
            if (k, where) not in told and (tones := _sustained(without_period(one, period)))
        ]
        if heard:
            k, tones = max(heard, key=lambda pair: max(amplitude for _, amplitude, _ in pair[1]))
            hz = [cycles / dt for cycles, _, _ in tones]
            how = "not the same from period to period" + _in_records(len(heard), len(records), k)
            largest = amplitudes(without_period(y[k, :, i], period), [cycles for cycles, _, _ in tones], period).max()
            remedy = "leave these frequencies out, or average over whole periods of the tone too"
            fault = tone_fault(hz, float(largest), float(y[k, :, i].std()), where, how, remedy)
            found += [] if fault is None else [fault]
    sound = [k for k in range(len(records)) if all((k, where) not in told for where in names)]
    if len(sound) == len(records):
        u = np.stack([r.u[kept] for r in records])
        known = {fault.where for fault in found}
        found += [fault for fault in synchronous_tones(u, y, period, dt, names) if fault.where not in known]
    return found


def _sustained(left: Real) -> list[tuple[float, float, float]]:
    """Tones of what differs from period to period, but for modes that ring."""
    return [one for one in tones_beside(left, np.zeros((left.size, 0))) if keeps_on(left, one[0])]


def _in_records(heard: int, records: int, largest: int) -> str:
    """Say in how many records, and in which it is largest."""
    return "" if records == 1 else f" (in {heard} of {records} records, most in record {largest + 1})"


def _input_noise(records: list[TimeRecord], u: Real, period: int) -> list[Fault]:
    """Noise of a measured input at the lines that carry it: it makes the response too small."""
    spectra = np.fft.rfft(u.reshape(len(u), -1, period, u.shape[2]), axis=2)
    size, noise = np.abs(spectra.mean(axis=1)), spectra.std(axis=1, ddof=1)
    found: list[Fault] = []
    for j, channel in enumerate(records[0].inputs):
        level: Real = size[:, 1:, j]
        carrying = level >= _CARRYING * level.max()
        if level.max() == 0:
            continue
        own: Real = noise[:, 1:, j]
        share = float(np.sqrt(np.mean(own[carrying] ** 2) / np.mean(level[carrying] ** 2)))
        if share > _INPUT_NOISE:
            one = share**2 / (len(records[0].u) // period)
            words = (
                f"input {channel.name} is measured with noise: {100 * share:.2g} % of its amplitude at the lines that carry it, in"
                f" one period. The mean over the periods leaves a response about {100 * one:.2g} % too small; give a reference,"
                " which has no noise"
            )
            found.append(Fault(FaultKind.NOISY_INPUT, words, where=f"input {channel.name}", size=share))
    return found


def jitter_faults(records: list[TimeRecord], y: Real, period: int, told: set[tuple[int, str]]) -> list[Fault]:
    """Outputs whose scatter from period to period grows with the square of their slope: (records, samples, outputs).

    A sample instant that is off by t adds t times the slope. Every period gives an estimate of the mean square of t; by Student's t
    they are above zero together.
    """
    from scipy.special import stdtrit

    found: list[Fault] = []
    for i, channel in enumerate(records[0].outputs):
        where = f"output {channel.name}"
        if any((k, where) in told for k in range(len(records))):
            continue
        cut = y[:, :, i].reshape(len(y), -1, period)
        periods = cut.shape[1]
        mean: Real = np.asarray(cut.mean(axis=1, keepdims=True), dtype=float)
        left = (cut - mean) * np.sqrt(periods / (periods - 1))
        slope: Real = np.broadcast_to((np.roll(mean, -1, axis=2) - np.roll(mean, 1, axis=2)) / 2, left.shape)
        power = float(np.mean(np.asarray(left, dtype=float) ** 2))
        square = slope**2 - np.mean(slope**2, axis=2, keepdims=True)
        steep: Real = np.sum(square**2, axis=2)
        if left[..., 0].size < _FEWEST or power <= _ROUNDING * float(np.mean(mean**2)) or not np.all(steep > 0):
            continue
        each = (np.sum(square * left**2, axis=2) / steep).ravel()
        sure = float(stdtrit(each.size - 1, 1 - _CHANCE)) * float(each.std(ddof=1)) / np.sqrt(each.size)
        instant = float(each.mean())
        shifted = float(np.sum(np.sum(left * slope, axis=2) ** 2 / np.sum(slope**2, axis=2))) / (power * left.size)
        if instant > sure and instant * float(np.mean(slope**2)) > _SHARE * power and shifted < _SHIFTED:
            samples = float(np.sqrt(instant))
            words = (
                f"{where} scatters where it moves fast: its sample instants are off by {samples:.2g} samples"
                f" ({samples * records[0].dt:.2g} s) rms; sample it by the clock of the input"
            )
            found.append(Fault(FaultKind.JITTER, words, where=where, size=samples))
    return found


def loop_faults(records: list[TimeRecord], u: Real, y: Real, period: int) -> list[Fault]:
    """Input of which what changes from period to period follows the output: one input, one output, and no reference.

    Where the input moves the output, both changes have the ratio of the response; where a controller makes the input from the
    output, that of -1/controller.
    """
    if u.shape[2] != 1 or y.shape[2] != 1 or records[0].reference is not None:
        return []
    U, Y = (np.fft.rfft(x[:, :, 0].reshape(len(x), -1, period), axis=2)[:, :, 1 : (period + 1) // 2] for x in (u, y))
    mean_u, mean_y = U.mean(axis=1), Y.mean(axis=1)
    changes_u, changes_y = U - mean_u[:, None], Y - mean_y[:, None]
    groups = changes_u.shape[2] // _GROUP
    dof = _GROUP * len(u) * (U.shape[1] - 1)
    if groups < _GROUPS or dof < 2 or np.sum(np.abs(changes_u) ** 2) <= _ROUNDING * np.sum(np.abs(U) ** 2):
        return []
    both, of_u, of_y = (
        _grouped(np.sum(one, axis=(0, 1)), groups)
        for one in (changes_u.conj() * changes_y, np.abs(changes_u) ** 2, np.abs(changes_y) ** 2)
    )
    tiny = np.finfo(float).tiny
    coherence: Real = np.abs(both) ** 2 / np.maximum(np.real(of_u * of_y), tiny)
    # By chance it is above x with probability (1 - x)^(dof - 1).
    coherent: NDArray[np.bool_] = coherence > 1 - _CHANCE ** (1 / (dof - 1))
    if coherent.mean() < _COHERENT:
        return []
    size: Real = np.sum(np.abs(mean_u) ** 2, axis=0)
    lines = np.flatnonzero(
        (size >= EXCITED**2 * size.max())
        & np.append(np.repeat(coherent, _GROUP), np.zeros(size.size - groups * _GROUP, bool))
    )
    if lines.size < _GROUP:
        return []
    response = np.sum(mean_u.conj() * mean_y, axis=0)[lines] / size[lines]
    own = (both / np.maximum(np.real(of_u), tiny))[lines // _GROUP]
    by_response, by_own = (
        float(np.sum(np.abs(changes_y[:, :, lines] - ratio * changes_u[:, :, lines]) ** 2)) for ratio in (response, own)
    )
    if by_response < _WORSE * by_own:
        return []
    pair = f"input {records[0].inputs[0].name} and output {records[0].outputs[0].name}"
    words = (
        f"{pair}: what changes from period to period in the input goes with the output (coherence"
        f" {float(np.median(coherence[coherent])):.2g}), but not by the response: a controller computes the input, and the loop is"
        f" closed. {WITHOUT_CONTROLLER}"
    )
    return [Fault(FaultKind.FEEDBACK, words, where=pair, size=float(np.median(coherence[coherent])))]


def _grouped(lines: Complex | Real, groups: int) -> Complex:
    """Sums over neighbouring lines."""
    return np.asarray(lines[: groups * _GROUP].reshape(groups, _GROUP).sum(axis=1), dtype=complex)

"""Scatter of periods: sample instants that are off, and inputs that follow outputs."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from robustid.core import Complex, Real
from robustid.data import Fault, FaultKind, TimeRecord
from robustid.estimation.noise_in_inputs import WITHOUT_CONTROLLER
from robustid.estimation.periodic import EXCITED

_CHANCE = 1e-4
_FEWEST = 4  # periods of all records
_SHARE = 0.3  # of the scatter that grows with the slope
_SHIFTED = 0.5  # of the scatter that the slope itself explains: another clock
_GROUP, _GROUPS = 10, 4  # neighbouring lines that are taken together, and groups at least
_COHERENT = 0.3  # of the groups
_WORSE = 2.0  # times what is left where the response is taken for the relation of the scatter
_ROUNDING = 1e-20  # of the power of a signal


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

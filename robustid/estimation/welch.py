"""Responses of any excitation by averaged Hann windows: a first look."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from robustid.core import counted, hz_words
from robustid.data import Caveat, TimeRecord
from robustid.errors import InputError
from robustid.estimation.divided import divided
from robustid.estimation.estimate import Estimate, pooled
from robustid.estimation.excited_lines import checked_lines, excited_lines

_SEGMENTS = 8  # of half overlap, per record


def welch(records: list[TimeRecord], lines: ArrayLike | None) -> Estimate:
    """``G = S_yu S_uu^{-1}`` of averaged periodograms; the covariance knows noise and leakage as scatter, not the smearing.

    In closed loop, by the reference.
    """
    first = records[0]
    samples, nu, ny = len(first.u), first.u.shape[1], first.y.shape[1]
    loop = first.reference is not None and first.reference.shape[1] == nu
    length = 2 * samples // (_SEGMENTS + 1)
    count = _SEGMENTS * len(records)
    # Half-overlapping Hann windows: averages worth 1/(1 + 2/36) of independent ones (Welch 1967).
    dof = int(count / (1 + 2 / 36 * (1 - 1 / _SEGMENTS))) - nu
    if length < 16 or dof < 1:
        raise InputError(
            f"`record` has {counted(samples, 'sample')}, too few for {_SEGMENTS} segments with {counted(nu, 'input')}"
        )
    parts = {name: _segments(records, name, length) for name in ("u", "y")}
    x = _segments(records, "reference", length) if loop else parts["u"]
    z = np.concatenate([parts["y"], parts["u"]], axis=2) if loop else parts["y"]
    last = (length - 1) // 2
    index = excited_lines(x, 1, last, 1) if lines is None else checked_lines(lines, last)
    x, z = (part[:, index].transpose(1, 2, 0) for part in (x, z))  # (f, n, count)
    gram = np.linalg.pinv(x @ x.conj().swapaxes(1, 2))
    values = z @ x.conj().swapaxes(1, 2) @ gram
    left = z - values @ x
    spread = left @ left.conj().swapaxes(1, 2) / (count - nu)
    covariance = np.einsum("fji,fkl->fikjl", gram, spread).reshape(len(index), values[0].size, -1)
    covariance = covariance * (count - nu) / dof
    if loop:
        values, covariance = divided(values, covariance, ny)
    power = np.mean(np.abs(z[:, :ny]) ** 2, axis=2)
    residual = np.einsum("fii->fi", spread).real[:, :ny]
    found = Estimate(
        index=index,
        step=2 * np.pi / (length * first.dt),
        values=values,
        covariance=covariance,
        dof=float(dof),
        excitations=len(records) // nu or 1,
        coherence=np.clip(1 - residual / np.where(power > 0, power, 1), 0, 1),
        rounding=np.full(values.shape, np.finfo(float).tiny),
        source=f"Welch: what changes within {hz_words(2 / (length * first.dt), 3)} is smeared, and the bound does not know it",
        caveats=(Caveat.SMEARED,),
    )
    shared = pooled(found)
    # Neighbouring lines of Hann windows have correlations of 2/3 and 1/6: 1 + 2 (4/9 + 1/36) of them are worth one.
    return shared._replace(dof=np.maximum(shared.dof / (1 + 2 * (4 / 9 + 1 / 36)), dof))


def _segments(records: list[TimeRecord], name: str, length: int) -> np.ndarray:
    """Transforms of all segments of all records, (count, length//2+1, n)."""
    from scipy.signal.windows import hann

    signals = np.stack([np.asarray(getattr(r, name)) for r in records])
    starts = np.arange(_SEGMENTS) * (length // 2)
    cut = np.stack([signals[:, s : s + length] for s in starts], axis=1).reshape(-1, length, signals.shape[2])
    cut = cut - cut.mean(axis=1, keepdims=True)
    return np.fft.rfft(cut * hann(length, sym=False)[:, None], axis=1)

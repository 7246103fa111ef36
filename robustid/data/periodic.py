"""Frequency responses of periodic experiments, with a statistical bound that holds for all lines jointly."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from robustid._arrays import as_array, as_count, as_float
from robustid.data.frequency_response import FrequencyResponse
from robustid.data.time_record import TimeRecord
from robustid.errors import InputError, InputTypeError

# A line counts as excited from a fifth of the largest line on: measured inputs carry disturbance lines of
# 10-15 % (drives, mains), while a multisine meant for identification is flat to a factor of 2 or 3.
EXCITED = 0.2
_MAX_CONDITION = 1e6


def estimate_frf(
    record: TimeRecord | Sequence[TimeRecord],
    *,
    method: str = "periodic",
    period: int | None = None,
    lines: Any = None,
    probability: float = 0.95,
) -> FrequencyResponse:
    """Frequency response at the excited lines of periodic experiments, with covariance and a joint bound.

    ``G = Y U^{-1}`` at every line: Y (ny, nu) and U (nu, nu) hold the DFT of nu experiments side by side,
    averaged over the periods. ``bound`` holds for all lines and entries at once with the probability asked.

    Parameters
    ----------
    record : TimeRecord or sequence of TimeRecord
        One experiment, or several with the same `dt`, channels and length. With nu inputs each nu records in
        a row make a block (independent inputs, such as an orthogonal multisine); further blocks are further
        realisations.
    method : {"periodic"}
        The only one so far.
    period : int, optional
        Period in samples; every record must be a whole number of periods. Default: each record is one period,
        and then several blocks are needed.
    lines : sequence of int, optional
        DFT lines k, at frequency ``k/(period*dt)`` Hz. Default: those, 0 and Nyquist left out (offsets are no
        response), where every channel of the `reference` (of `u` where a record has none) reaches a fifth of
        its largest line in one of the experiments.
    probability : float
        Of the bound, jointly for all lines and entries; between 0 and 1.

    Returns
    -------
    FrequencyResponse
        With `bound` (F, ny, nu), `covariance` (F, ny*nu, ny*nu) of the estimate itself, and a note on the
        bound.

    Raises
    ------
    InputError
        No whole number of periods, fewer than two periods (or blocks) in total, experiments that are not
        independent at a line, another method.
    InputTypeError
        Something that isn't a TimeRecord.

    Notes
    -----
    One block of P periods: the errors are the scatter of ``(Y_p - G U_p) U^{-1}`` over the periods, input and
    output noise together to first order, with dof = P - 1. B > 1 blocks: G is the mean over the blocks, the
    errors are the scatter of G_b from block to block, dof = B - 1, because it also holds what differs between
    realisations (nonlinear distortion); the bound of 2 or 3 blocks is therefore wide. With s² the estimated
    variance of the mean, |e|²/s² is F(2, 2 dof) distributed, ``P(|e|² > x s²) = (1 + x/dof)^(-dof)``, so that

        ``bound = s sqrt(dof (alpha^(-1/dof) - 1))``,  ``alpha = (1 - probability)/(lines ny nu)``
        (Bonferroni)

    (at the real lines 0 and Nyquist Student's t instead). The bound is never below the rounding errors of the
    DFT.

    Assumes the plant in steady state (drop the periods of the transient first), and noise that is independent
    from period to period with normal DFT values, small against the input at the lines used. Source:
    `pintelon2012`, chapters 2 and 7 (periodic excitation).

    Examples
    --------
    >>> import numpy as np
    >>> from robustid.data import TimeRecord, estimate_frf
    >>> rng = np.random.default_rng(0)
    >>> u = np.tile(np.cos(2 * np.pi * 3 * np.arange(50) / 50), 10)
    >>> y = 2 * u + 0.1 * rng.standard_normal(u.size)
    >>> frf = estimate_frf(TimeRecord(u, y, dt=0.01, initial="periodic"), period=50)
    >>> frf.freq_hz, bool(abs(frf.values[0, 0, 0] - 2) < frf.bound[0, 0, 0])
    (array([6.]), True)
    """
    if method != "periodic":
        raise InputError(f'`method` must be "periodic", the only one so far; got {method!r}')
    probability = as_float("probability", probability)
    if not 0 < probability < 1:
        raise InputError(f"`probability` must be between 0 and 1; got {probability:g}")
    records = _checked_records(record)
    first = records[0]
    samples, nu, ny = len(first.u), first.u.shape[1], first.y.shape[1]
    period = samples if period is None else as_count("period", period, least=2)
    if samples % period:
        raise InputError(
            f"`record` has {samples} samples, not a whole number of periods of {period}; cut it to"
            f" {samples // period * period} samples or correct `period`"
        )
    periods, blocks = samples // period, len(records) // nu
    if periods * blocks < 2:
        raise InputError(
            f"`record` holds one period of {period} samples for each of the {nu} experiments: nothing"
            " to estimate the noise from; give at least two periods (`period` in samples), or further"
            " realisations"
        )
    if lines is None:
        use_reference = all(r.reference is not None for r in records)
        excitation = [r.reference if use_reference else r.u for r in records]
        index = _excited(_dft(np.stack(excitation), period).mean(axis=1), period)
    else:
        index = _checked_lines(lines, period)

    # (F, blocks, periods, channels, experiments)
    u, y = (_by_block(_dft(np.stack([getattr(r, s) for r in records]), period)[:, :, index], nu) for s in ("u", "y"))
    inverse = _inverse(u.mean(axis=2), index, period, first.dt)
    per_block = y.mean(axis=2) @ inverse
    values = per_block.mean(axis=1)
    if blocks == 1:
        errors = (y[:, 0] - values[:, None] @ u[:, 0]) @ inverse
    else:
        errors = per_block - values[:, None]
    errors = errors.transpose(0, 1, 3, 2).reshape(len(index), -1, ny * nu)  # vec: columns stacked
    dof = errors.shape[1] - 1
    covariance = np.einsum("fpi,fpj->fij", errors, errors.conj()) / (dof * (dof + 1))
    variance = np.einsum("fii->fi", covariance).real.reshape(-1, nu, ny).transpose(0, 2, 1)
    radius = _quantile((1 - probability) / values.size, dof, (2 * index) % period == 0)[:, None, None]
    bound = np.maximum(radius * np.sqrt(variance), _rounding(records, values, inverse))
    if not np.all(bound > 0):
        raise InputError("`record`: an output is zero in every period; leave that channel out")
    source = f"{periods} periods" if blocks == 1 else f"{blocks} blocks of experiments ({periods} periods each)"
    return FrequencyResponse(
        2 * np.pi * index / (period * first.dt),
        values,
        bound=bound,
        covariance=covariance,
        dt=first.dt,
        inputs=first.inputs,
        outputs=first.outputs,
        note=f"statistical: joint {100 * probability:g} % over {len(index)} lines, scatter over {source}",
    )


def _checked_records(record: Any) -> list[TimeRecord]:
    records = [record] if isinstance(record, TimeRecord) else list(record) if isinstance(record, Sequence) else []
    if not records or not all(isinstance(r, TimeRecord) for r in records):
        raise InputTypeError(f"`record` must be a TimeRecord or a sequence of them; got {type(record).__name__}")
    first = records[0]
    for k, other in enumerate(records):
        for what, a, b in (
            ("sample time", first.dt, other.dt),
            ("shape of u", first.u.shape, other.u.shape),
            ("shape of y", first.y.shape, other.y.shape),
        ):
            if a != b:
                raise InputError(f"`record`: all experiments must have the same {what}; got {a} and {b} (number {k})")
    nu = first.u.shape[1]
    if len(records) % nu:
        raise InputError(
            f"`record`: {nu} inputs need {nu} experiments, or a multiple of that; got {len(records)}."
            " One experiment can't tell the inputs apart"
        )
    return records


def _checked_lines(lines: Any, period: int) -> np.ndarray:
    index = as_array("lines", lines, ndim=1)
    if index.size == 0 or np.any(index != np.round(index)) or index.min() < 0 or index.max() > period // 2:
        raise InputError(f"`lines` must be whole numbers from 0 to period//2 = {period // 2}; got {lines!r}")
    if len(np.unique(index)) != index.size:
        raise InputError(f"`lines` must be all different; got {lines!r}")
    return np.sort(index).astype(int)


def _dft(signals: np.ndarray, period: int) -> np.ndarray:
    """(R, T, n) real -> (R, periods, period//2+1, n): amplitudes per period."""
    cut = signals.reshape(len(signals), -1, period, signals.shape[-1])
    return np.fft.rfft(cut, axis=2) / period


def _by_block(spectra: np.ndarray, nu: int) -> np.ndarray:
    """(R, P, F, n) -> (F, blocks, P, n, nu): the experiments of a block side by side."""
    split = spectra.reshape(-1, nu, *spectra.shape[1:])
    return split.transpose(3, 0, 2, 4, 1)


def _excited(spectra: np.ndarray, period: int) -> np.ndarray:
    amplitude = np.abs(spectra).max(axis=0)
    amplitude[0] = 0
    if period % 2 == 0:
        amplitude[-1] = 0
    largest = amplitude.max(axis=0)
    index = np.flatnonzero(np.all(amplitude >= EXCITED * largest, axis=1) & np.all(largest > 0))
    if index.size == 0:
        raise InputError("`record`: no line is excited in every input; check the input signals, or give `lines`")
    return index


def _inverse(u: np.ndarray, index: np.ndarray, period: int, dt: float) -> np.ndarray:
    # Rows scaled to unit size first: the units of the inputs must not decide on independence.
    size = np.abs(u).max(axis=(0, 1, 3), keepdims=True)
    if np.all(size > 0) and np.all(np.abs(u).max(axis=(2, 3)) > 0):
        condition = np.linalg.cond(u / size).max(axis=1)
        if condition.max() < _MAX_CONDITION:
            return np.linalg.inv(u / size) / size.swapaxes(-1, -2)
        worst = index[np.argmax(condition)] / (period * dt)
        raise InputError(
            f"`record`: the inputs of the experiments are not independent at {worst:g} Hz (condition"
            f" {condition.max():.1g}); use other inputs, such as an orthogonal multisine, or leave the line"
            " out"
        )
    raise InputError("`record`: an input is zero at a line that is asked for; correct `lines` or leave the input out")


def _quantile(alpha: float, dof: int, real: np.ndarray) -> np.ndarray:
    """Radius over standard deviation that an error exceeds with probability `alpha`, at each line."""
    from scipy.special import stdtrit

    # expm1 keeps the digits where alpha**(-1/dof) is close to 1 (many periods).
    circular = np.sqrt(dof * np.expm1(-np.log(alpha) / dof))
    return np.where(real, stdtrit(dof, 1 - alpha / 2), circular)


def _rounding(records: list[TimeRecord], values: np.ndarray, inverse: np.ndarray) -> np.ndarray:
    """Rounding error of the estimate: the DFT's is relative to the largest sample, not to the line."""
    u_size, y_size = (np.max([np.abs(getattr(r, s)).max(axis=0) for r in records], axis=0) for s in ("u", "y"))
    numerator = y_size[:, None] + np.abs(values) @ u_size[:, None]
    gain = np.abs(inverse).sum(axis=2).max(axis=1)
    return 16 * np.finfo(float).eps * numerator * gain[:, None, :]

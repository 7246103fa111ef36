"""Bounds where nobody states one: from repeated periods, a rest, the coherence, or the roughness of a response."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from robustid.core import Real, as_count, hz_words, one_thread
from robustid.data import Bound, FrequencyResponse, TimeRecord, as_frequency_response, as_probability, joint_radius
from robustid.errors import InputError
from robustid.estimation.noise_floor import bounds_from_noise_floor
from robustid.estimation.repetition import found_period
from robustid.estimation.roughness import FEWEST, roughness

BOUND_SOURCES = ("periods", "rest", "coherence", "scatter")
_FACTOR = 1.5  # over the largest difference that was seen, as for the noise floor
_BEYOND = 1.2  # over a residual that is larger than its bound
_REST = 50  # samples of a rest from which a noise floor is taken
_ROUGH = 0.25  # scatter in parts of the response, from which on a bound for all points together is as large as it
_LEAST = 1e-4  # part of a value, below which nobody measures


@one_thread()
def estimate_bound(
    data: Any, source: str | None = None, *, averages: int | None = None, probability: float = 0.95
) -> Any:
    """Bound the errors of data by what they themselves show, where nobody states a bound; the note says from what.

    An estimate of the noise, not a proof; what changes from one experiment to the next is not in it. A bound of your own, or that
    of `estimate_frf` from several records, is better.

    Parameters
    ----------
    data : FrequencyResponse, control.FRD or TimeRecord
        A bound that it has is replaced.
    source : {"periods", "rest", "coherence", "scatter"}, optional
        What the bound is taken from; default: the first that the data have. "periods" of a record: 1.5 times the largest deviation
        from the mean over its periods, in their later half. "rest" of a record: `bounds_from_noise_floor` of the stretch before
        the input first moves, of 50 samples or more, whose mean is removed. "coherence" of a response with one input, with
        `averages`: ``s^2 = |G|^2 (1 - c)/(c (n - 1))``. "scatter" of a response with 24 frequency points or more: what the
        smooth model of the best order leaves, pooled over 21 neighbouring points.
    averages : int, optional
        Number n of averaged blocks without overlap behind a coherence c.
    probability : float
        Of the bound for all frequency points and entries together, where normal errors are assumed (Bonferroni).

    Returns
    -------
    FrequencyResponse or TimeRecord

    Raises
    ------
    InputError, InputTypeError
        Data from which no bound can be taken, with what to do instead.

    Notes
    -----
    The coherence of an H1 estimate: |e|^2/s^2 is F distributed with 2 and 2(n - 1) degrees of freedom (`pintelon2012`, section
    2.6). A frequency point whose residual is beyond the radius gets 1.2 times its residual.

    Examples
    --------
    >>> import numpy as np, robustid as rid
    >>> omega, rng = np.linspace(1, 20, 100), np.random.default_rng(0)
    >>> G = 1 / (100 - omega**2 + 1j * omega)
    >>> noise = 1e-3 * (rng.standard_normal(100) + 1j * rng.standard_normal(100))
    >>> frf = rid.estimate_bound(rid.FrequencyResponse(omega, G + noise))
    >>> frf.bound.kind, bool(np.all(abs(noise) < frf.bound.ravel()))
    ('confidence', True)
    >>> frf.note
    'from the scatter of the response around a smooth model of 4 poles: its noise; 34 % of the response (median)'
    """
    return default_bound(data, source, averages=averages, probability=probability)[0]


def default_bound(
    data: Any, source: str | None = None, *, averages: int | None = None, probability: float = 0.95
) -> tuple[Any, str]:
    """As `estimate_bound`, and what the bound was taken from."""
    probability = as_probability(probability)
    record = isinstance(data, TimeRecord)
    data = data if record else as_frequency_response("data", data)
    averages = None if averages is None else as_count("averages", averages, least=2)
    possible = BOUND_SOURCES[:2] if record else BOUND_SOURCES[2:]
    if source is not None and source not in possible:
        what = "a record" if record else "a frequency response"
        raise InputError(f'`source` of the bound of {what} must be "{possible[0]}" or "{possible[1]}"; got {source!r}')
    why: list[str] = []
    for name in possible if source is None else (source,):
        try:
            if record:
                return (_of_periods(data) if name == "periods" else _of_rest(data)), name
            if name == "coherence":
                return _of_coherence(data, averages, probability), name
            return _of_scatter(data, probability), name
        except InputError as error:
            why.append(str(error))
    other = ", or take it from a record without excitation" if record else ""
    said = "no error bound can be taken from the data: " + "; ".join(why) + f". Give `bound`{other}"
    raise InputError(said, argument="bound")


def _of_periods(record: TimeRecord) -> TimeRecord:
    """The largest deviation from the mean over the periods."""
    period = len(record.u) if record.initial == "periodic" else None
    found = found_period(record)
    period = found if found is not None else period
    if period is None or len(record.u) < 2 * period:
        raise InputError("the input doesn't repeat")
    count = len(record.u) // period
    later = min(count // 2, count - 2) * period
    y = record.y[later : count * period].reshape(-1, period, record.y.shape[1])
    deviation: Real = (y - y.mean(axis=0)) * np.sqrt(len(y) / (len(y) - 1))
    level = _FACTOR * np.abs(deviation).max(axis=(0, 1))
    if not np.all(level > 0):
        name = record.outputs[int(np.argmin(level))].name
        raise InputError(f"output {name} shows no noise at all")
    bound = Bound(np.broadcast_to(level, record.y.shape), kind="noise_floor").only(record.used)
    return record.with_bound(
        bound,
        f"{_FACTOR:g} times the largest deviation from the mean over the last {len(y)} periods of {period} samples",
    )


def _of_rest(record: TimeRecord) -> TimeRecord:
    """The noise floor of the stretch before the input first moves."""
    moves = np.flatnonzero(np.any(record.u != record.u[0], axis=1))
    rest = int(moves[0]) if moves.size else 0
    if rest < _REST or np.any(record.u[0]):
        raise InputError(f"there is no rest of {_REST} samples or more before the input moves")
    still = TimeRecord(record.u[:rest], record.y[:rest], dt=record.dt, outputs=record.outputs, inputs=record.inputs)
    return bounds_from_noise_floor(still).bound_record(record)


def _of_coherence(frf: FrequencyResponse, averages: int | None, probability: float) -> FrequencyResponse:
    """Errors that the part of the outputs' power leaves which the input doesn't explain."""
    if frf.coherence is None:
        raise InputError("there is no coherence beside the response")
    if averages is None:
        raise InputError("a coherence bounds the errors only with the number of averages behind it, `averages`")
    if len(frf.inputs) > 1:
        raise InputError("the coherence bounds the errors of responses to one input; this one has several")
    c: Real = frf.coherence[:, :, None]
    if np.any(c <= 0):
        raise InputError(
            f"the coherence is zero at {hz_words(frf.freq_hz[int(np.argmin(c.min(axis=(1, 2))))])}: nothing is known there"
        )
    s = np.abs(frf.values) * np.sqrt((1 - c) / (c * (averages - 1)))
    return _bounded(frf, s, float(averages - 1), probability, f"from the coherence of {averages} averages", None)


def _of_scatter(frf: FrequencyResponse, probability: float) -> FrequencyResponse:
    """Remainders of smooth models of the entries."""
    there = ~frf.missing
    fewest = int(there.sum(axis=0).min())
    if fewest < FEWEST:
        raise InputError(f"scatter is seen at {FEWEST} frequency points or more; there are {fewest}")
    plain = dataclasses.replace(frf, covariance=None)
    s, left, dof, orders, white = (
        np.full(frf.values.shape, np.inf),
        np.zeros(frf.values.shape),
        np.inf,
        set[int](),
        True,
    )
    for i, j in np.ndindex(*frf.values.shape[1:]):
        k = there[:, i, j]
        if not np.any(frf.values[k, i, j]):
            raise InputError(f"the response from {frf.inputs[j].name} to {frf.outputs[i].name} is zero")
        found = roughness(plain.entry(i, j).select(k))
        s[k, i, j], left[k, i, j] = found.deviation, np.abs(found.residual)
        dof, white = min(dof, found.dof), white and found.white
        orders.add(found.poles)
        rough = float(np.median(found.deviation / np.maximum(np.abs(frf.values[k, i, j]), np.finfo(float).tiny)))
        if rough > _ROUGH and not found.white:
            raise InputError(
                "the frequency points are too few for the modes between them: a smooth model of"
                f" {found.poles} poles leaves {100 * rough:.0f} % of the response"
            )
    poles = f"{min(orders)} poles" if len(orders) == 1 else f"{min(orders)} to {max(orders)} poles"
    words = f"from the scatter of the response around a smooth model of {poles}: its noise"
    words += (
        ""
        if white
        else ", and what such a model doesn't describe, since it isn't white: the bound is too large rather than too small"
    )
    return _bounded(frf, s, dof, probability, words, left)


def _bounded(
    frf: FrequencyResponse, s: Real, dof: float, probability: float, words: str, left: Real | None
) -> FrequencyResponse:
    """The response with the joint confidence bound of a deviation that was estimated with dof degrees of freedom."""
    radius = joint_radius(probability, int(np.sum(~frf.missing)), dof, frf.all_real) * s
    if left is not None:
        radius = np.where(left > radius, _BEYOND * left, radius)
    size = np.abs(np.where(frf.missing, 0, frf.values))
    floor = _LEAST * np.maximum(size, _LEAST * size.max(axis=0))
    low = bool(np.any(radius < floor))
    bound = Bound(np.maximum(radius, floor), kind="confidence", probability=probability, dof=dof, excitations=1)
    part = np.median((bound.radius / np.maximum(size, np.finfo(float).tiny))[~frf.missing])
    note = f"{words}; {100 * part:.2g} % of the response (median)"
    note += f", at least {100 * _LEAST:g} % of each value" if low else ""
    return frf.with_bound(bound, note)

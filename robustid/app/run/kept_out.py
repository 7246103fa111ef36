"""Data that a run keeps out of the identification: which, and what they say of the band."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from robustid.app.run.checks import AUTO
from robustid.app.run.run_file import RunFile
from robustid.core import Plane, Real
from robustid.data import FrequencyResponse, TimeRecord
from robustid.errors import InputError
from robustid.estimation import estimate_frf, response_alone
from robustid.guarantees import Band, Coverage, Family, WorstCaseError, coverage

_DENSE = 60  # frequency points from which on some are withheld
_EVERY = 4  # one of so many then
_PERIODS = 8  # periods of a single excitation from which on the last quarter is withheld
_LOOKED_AT = 12  # withheld frequency points at which the band is bounded, besides those next to the poles


class Split(NamedTuple):
    """Records that are used, and estimates of those that aren't, of one kind."""

    used: list[TimeRecord]
    withheld: tuple[FrequencyResponse, ...]
    kind: str


def split(run: RunFile, records: list[TimeRecord]) -> tuple[RunFile, Split]:
    """Keep out some of the records for a response, or the last periods of the only one, as stated or as many as can be spared:
    of the blocks (as many records as inputs) half from four on, one of three; of two both are needed to see that they differ.
    """
    asked, nothing = run.withheld, Split(records, (), "records")
    count = len(records[0].inputs)
    blocks = len(records) // count
    spared = (blocks // 2 if blocks >= 4 else int(blocks == 3)) if asked.records == AUTO else int(asked.records)
    if spared >= max(blocks, 1):
        raise InputError(
            f"[withheld] records = {spared}: there are {blocks} blocks of records, and one at least must be used"
        )
    if spared:
        used = records[: (blocks - spared) * count]
        parts = [records[k * count : (k + 1) * count] for k in range(blocks - spared, blocks)]
        found = _estimated(run, parts, stated=asked.records != AUTO)
        if found:
            return run.changed("withheld", records=spared, periods=0, every=0), Split(used, found, "records")
    run = run.changed("withheld", records=0)
    periods = 0 if run.estimate.period is None else len(records[0].u) // run.estimate.period
    usual = periods // 4 if blocks == 1 and periods >= _PERIODS else 0
    spared = usual if asked.periods == AUTO else int(asked.periods)
    if not spared:
        return run.changed("withheld", periods=0), nothing
    if spared > periods - 2:
        raise InputError(
            f"[withheld] periods = {spared}: the record has {periods} of them, and two at least must be used"
        )
    length = (periods - spared) * int(run.estimate.period or 0)
    used, late = ([_part(r, piece) for r in records] for piece in (slice(None, length), slice(length, None)))
    found = _estimated(run, [late], stated=asked.periods != AUTO) if spared > 1 else ()
    if not found:
        return run.changed("withheld", periods=0), nothing
    return run.changed("withheld", periods=spared, every=0), Split(used, found, "periods")


def estimate_of(run: RunFile) -> Callable[..., FrequencyResponse]:
    """The estimate of a response; of records that were opened faults are looked for before."""
    return response_alone if run.loop.is_stated else estimate_frf


def _estimated(run: RunFile, parts: Sequence[list[TimeRecord]], stated: bool) -> tuple[FrequencyResponse, ...]:
    """The response of each part by itself; none where a part alone gives none, unless it was asked for."""
    how = run.estimate
    try:
        return tuple(
            estimate_of(run)(p, method=how.method, period=how.period, probability=how.probability) for p in parts
        )
    except InputError:
        if stated:
            raise
        return ()


def _part(record: TimeRecord, piece: slice) -> TimeRecord:
    """Some samples of a record in steady state."""
    arrays = {name: None if (a := getattr(record, name)) is None else a[piece] for name in ("u", "y", "reference")}
    bound = None if record.bound is None else record.bound.select(piece)
    return dataclasses.replace(record, bound=bound, **arrays)


def split_points(run: RunFile, frf: FrequencyResponse) -> tuple[RunFile, FrequencyResponse, FrequencyResponse | None]:
    """Keep out one frequency point of so many, where they are dense and nothing else was kept out."""
    asked = run.withheld.every
    every = (_EVERY if frf.omega.size >= _DENSE else 0) if asked == AUTO else int(asked)
    run = run.changed("withheld", every=every)
    if every < 2 or frf.omega.size <= every:
        return run, frf, None
    out = np.arange(frf.omega.size) % every == every // 2
    return run, frf.select(~out), frf.select(out)


def with_frequencies(
    run: RunFile, grid: Real, poles: Sequence[complex] | np.ndarray, plane: Plane, withheld: Sequence[FrequencyResponse]
) -> RunFile:
    """The frequencies of the worst case: as stated, or those of a grid and some that were kept out."""
    if run.worst_case.at_hz is not None:
        return run
    omega = looked_at(grid, poles, plane, withheld)
    return run.changed("worst_case", at_hz=tuple((omega / (2 * np.pi)).tolist()))


def looked_at(
    grid: Real, poles: Sequence[complex] | np.ndarray, plane: Plane, withheld: Sequence[FrequencyResponse]
) -> Real:
    """The frequencies of a band, and some withheld ones: the nearest to each pole, and others over the whole range."""
    if not withheld:
        return grid
    lines = np.unique(np.concatenate([frf.omega for frf in withheld]))
    spread = np.linspace(0, lines.size - 1, _LOOKED_AT).round().astype(int)
    angles = np.abs(np.angle(np.asarray(poles, complex)))
    at = plane.omega(np.unique(np.round(angles[angles > 0], 12)).astype(float))
    near = [int(np.argmin(np.abs(lines - omega))) for omega in at]
    return np.unique(np.concatenate([grid, lines[np.unique([*spread, *near])]]))


def compared(band: Band | WorstCaseError | Family, withheld: Sequence[FrequencyResponse], kind: str) -> Coverage | None:
    """Compare a band with the withheld responses; None where there are none, or they have no frequency in common."""
    if not withheld:
        return None
    if isinstance(band, Band):  # at every withheld line
        low, high = band.range
        lines = np.unique(np.concatenate([frf.omega for frf in withheld]))
        lines = lines[(lines >= low) & (lines <= high)]
        said = dataclasses.replace(band, omega=lines).bounded if lines.size else np.zeros(0, bool)
        if not said.any():  # lines at which nothing is said support nothing
            return None
        band = dataclasses.replace(band, omega=lines[said])
    known = np.maximum(band.omega, np.finfo(float).tiny)
    near = any(np.min(np.abs(frf.omega[:, None] / known - 1)) < 1e-9 for frf in withheld)
    return coverage(band, withheld, kind=kind) if near else None

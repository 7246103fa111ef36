"""coverage(): a band against records that it was not made from, and the probability with which it holds the next one."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from robustid.core import Real, as_kind, time_words
from robustid.data import FrequencyResponse
from robustid.errors import InputError
from robustid.guarantees.band_result import Band
from robustid.guarantees.coverage_result import UNITS, Coverage
from robustid.guarantees.power import shown
from robustid.guarantees.response_discs import Discs, ResponseDiscs

Withheld = FrequencyResponse | Sequence[FrequencyResponse]
_SAME = 1e-9  # relative distance up to which two frequencies are one


def coverage(band: Discs, withheld: Withheld, *, kind: str = "records", names: Sequence[str] | None = None) -> Coverage:
    """Withheld responses against a band that was not made from them, and the probability with which it holds the next record.

    Parameters
    ----------
    band : WorstCaseError, WorstCaseOverPoles, Family or FrequencyResponse
        Discs around the nominal with the guaranteed errors as radii; of a response its values with their bounds.
    withheld : FrequencyResponse or sequence of them
        One for each record (or block of records) that is independent of the others, with the bound of its own noise. Frequencies
        that the band does not have are left out.
    kind : {"records", "periods", "lines"}
        What they are: excitations of their own, further periods of the same ones, or further lines of the same estimate. Only
        "records" allow a statement about the next one.
    names : sequence of str, optional
        Default: numbers.

    Returns
    -------
    Coverage

    Raises
    ------
    InputError, InputTypeError
        Responses of other signals or another sample time; no frequency in common.

    Notes
    -----
    The score of a record is the smallest factor on the band at which the whole of it, its own bound included, is inside at all
    common frequencies and entries. The largest of R scores holds the next record's response with probability R/(R + 1)
    (`ranked`), where records are exchangeable, less the probability that the bound of a withheld record fails. Where the
    order of the scores contradicts that, no probability is given. Source: `lei2018`.

    What the data could have shown is computed beside what they do show (`Coverage.shown`): a test that a band three times too
    narrow would have passed as well supports nothing, and is called none.

    Examples
    --------
    >>> import numpy as np, robustid as rid
    >>> omega, rng = np.array([1.0, 2.0]), np.random.default_rng(0)
    >>> band = rid.FrequencyResponse(omega, [1.0, 0.5], bound=0.1, dt=1.0)
    >>> further = [rid.FrequencyResponse(omega, [1.0, 0.5 + d], bound=0.01, dt=1.0) for d in (0.03, -0.09, 0.12, 0.05)]
    >>> found = rid.coverage(band, further)
    >>> found.contradicted, found.next_record.probability, round(found.next_record.factor, 6)
    (True, 0.8, 1.3)
    >>> rid.coverage(band, further[:2]).judgement.value, rid.coverage(band, further[0].with_bound(0.1)).judgement.value
    ('supported', 'not tested')
    """
    discs = ResponseDiscs.of(band)
    items = [withheld] if isinstance(withheld, FrequencyResponse) else list(withheld)
    if kind not in UNITS:
        raise InputError(f"`kind` must be one of {tuple(UNITS)}; got {kind!r}")
    if not items:
        raise InputError("`withheld` is empty; give at least one response that the band was not made from")
    for item in items:
        as_kind("withheld", item, FrequencyResponse, "a FrequencyResponse or a sequence of them")
    labels = list(names) if names is not None else _numbered(kind, len(items))
    if len(labels) != len(items):
        raise InputError(f"`names` must be one for each of {len(items)} withheld responses; got {len(labels)}")
    for item, name in zip(items, labels, strict=True):
        _check_fits(discs, item, name)
    found = [matched(discs.omega, item.omega) for item in items]
    shared = np.any([mask for mask, _ in found], axis=0)
    if not shared.any():
        raise InputError(
            "`withheld` and `band` have no frequency in common: bound the errors at frequencies of the withheld lines, with `omega`"
        )
    error, noise, seen = np.full((3, len(items), *discs.radius.shape), np.nan)
    for r, (item, (mask, at)) in enumerate(zip(items, found, strict=True)):
        away = np.where(item.missing[at], np.nan, np.abs(item.values[at] - discs.centre[mask]))
        own = np.zeros(away.shape) if item.bound is None else item.bound.outer_radius[at]
        with np.errstate(divide="ignore", invalid="ignore"):
            error[r, mask] = away / discs.radius[mask]
            noise[r, mask] = np.where(np.isnan(away), np.nan, own / discs.radius[mask])
        seen[r, mask] = shown(discs.radius[mask], item.select(at))
    signals = tuple(str(s.name) for s in items[0].outputs), tuple(str(s.name) for s in items[0].inputs)
    return Coverage(
        omega=discs.omega[shared],
        names=tuple(map(str, labels)),
        error=error[:, shared],
        noise=noise[:, shared],
        shown=seen[:, shared],
        false_alarm=_false_alarm(items),
        kind=kind,
        signals=signals,
    )


def on_lines(band: Discs, responses: Sequence[FrequencyResponse]) -> Discs:
    """The band at the frequencies of responses, where it holds at every frequency; else as it is."""
    if not isinstance(band, Band) or not responses:
        return band
    return dataclasses.replace(band, omega=np.unique(np.concatenate([one.omega for one in responses])))


def _false_alarm(items: Sequence[FrequencyResponse]) -> float | None:
    """Probability at most that the bound of a withheld response fails; None where it isn't stated."""
    total = 0.0
    for bound in (item.bound for item in items):
        if bound is None or (bound.kind != "hard" and bound.probability is None):
            return None
        total += 0.0 if bound.kind == "hard" else 1 - bound.probability
    return min(total, 1.0)


def _numbered(kind: str, count: int) -> list[str]:
    """Names of withheld responses: record 1, ...; those of lines hold many of them."""
    if kind == "lines":
        return ["withheld lines" + f" {k}" * (count > 1) for k in range(1, count + 1)]
    return [f"{kind.removesuffix('s')} {k}" for k in range(1, count + 1)]


def _check_fits(band: ResponseDiscs, item: FrequencyResponse, name: str) -> None:
    """Refuse a response of another size or sample time than the band."""
    if item.values.shape[1:] != band.radius.shape[1:]:
        sizes = "{} x {}".format(*item.values.shape[1:]), "{} x {}".format(*band.radius.shape[1:])
        raise InputError(
            f"`withheld`: {name} is a {sizes[0]} response, the band is about {sizes[1]}; take the same entries"
        )
    if abs((item.dt or 0.0) - band.dt) > _SAME * band.dt:
        raise InputError(
            f"`withheld`: {name} is of {time_words(item.dt)}, the band of {time_words(band.dt)}; they must be of one sample time"
        )


def matched(wanted: Real, have: Real) -> tuple[NDArray[np.bool_], NDArray[np.intp]]:
    """Mask of the wanted frequencies that are there, and their places."""
    at = np.clip(np.searchsorted(have, wanted), 1, max(have.size - 1, 1))
    pair = np.stack([at - 1, np.minimum(at, have.size - 1)])
    nearest = pair[np.argmin(np.abs(have[pair] - wanted), axis=0), np.arange(wanted.size)]
    mask = np.abs(have[nearest] - wanted) <= _SAME * np.maximum(wanted, have[nearest])
    return mask, nearest[mask]

"""coverage(): a band against records that it was not made from, and the probability with which it holds the next one."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from robustid.core import Complex, Frozen, Real, as_array, as_kind, freeze, plane_of, time_words
from robustid.data import FrequencyResponse
from robustid.errors import InputError, InputTypeError
from robustid.guarantees.band_result import Band
from robustid.guarantees.over_cells import WorstCase

Discs = Band | WorstCase | FrequencyResponse
Withheld = FrequencyResponse | Sequence[FrequencyResponse]
UNITS = {  # one of them, and several
    "records": ("withheld record", "withheld records"),
    "periods": ("withheld period of the same excitation", "withheld periods of the same excitation"),
    "lines": ("withheld spectral line of the same records", "withheld spectral lines of the same records"),
}
_SAME = 1e-9  # relative distance up to which two frequencies are one
_IN_ORDER = 0.1  # probability below which the order of the scores is no chance


class Ranked(NamedTuple):
    """Factor on a band, and the probability with which it then holds one more record; None: none worth stating."""

    factor: float
    probability: float | None


def ranked(scores: ArrayLike, rank: int | None = None) -> Ranked:
    r"""Factor that holds the next record with a probability, whatever the distribution of the records is.

    With scores :math:`s_1 \dots s_R` of R records that the band was not made from, exchangeable with the next one,

    .. math:: P(s_{R+1} \le s_{(k)}) \ge \frac{k}{R + 1}

    for the k-th smallest of them: each of the R + 1 places is as likely as any other.

    Parameters
    ----------
    scores : (R,) array
    rank : int, optional
        k, from 1; default R, the largest score.

    Returns
    -------
    Ranked
        One score gives a factor and no probability: that the next score is the smaller one is worth a coin.

    Notes
    -----
    Source: split conformal prediction, `lei2018` Theorem 2.1.

    Examples
    --------
    >>> from robustid.guarantees import ranked
    >>> ranked([0.7, 1.31, 0.9, 1.1])
    Ranked(factor=1.31, probability=0.8)
    """
    sizes = np.sort(as_array("scores", scores, ndim=1))
    rank = sizes.size if rank is None else rank
    if not sizes.size or not 1 <= rank <= sizes.size:
        raise InputError(f"`rank` must be from 1 to the number of scores; got {rank} of {sizes.size}")
    return Ranked(float(sizes[rank - 1]), rank / (sizes.size + 1) if sizes.size > 1 else None)


def chance_of_order(scores: ArrayLike) -> float:
    """Probability that scores in random order rise, or fall, at least as steadily as these do: Kendall's test, exact.

    Counts the pairs that stand in the wrong order; equal scores count half. 1 where there is nothing to order.

    Examples
    --------
    >>> from robustid.guarantees import chance_of_order
    >>> round(chance_of_order([1.0, 1.1, 1.3, 1.4, 1.7]), 4)  # 2 of the 120 orders
    0.0167
    """
    sizes = as_array("scores", scores, ndim=1)
    count = sizes.size
    pairs = count * (count - 1) // 2
    upper = np.triu_indices(count, 1)
    falls = float(np.sum(np.sign(sizes[:, None] - sizes[None, :])[upper] + 1) / 2)
    orders = np.ones(1)
    for size in range(2, count + 1):
        orders = np.convolve(orders, np.ones(size) / size)  # how often so many pairs are in the wrong order
    nearest = int(np.ceil(min(falls, pairs - falls) - 1e-9))
    return float(min(1.0, 2 * orders[: nearest + 1].sum()))


class ResponseDiscs(NamedTuple):
    """Discs that are said to hold the response: `omega` (F,) rad/s, `centre` and `radius` (F, ny, nu), `dt` in s or 0."""

    omega: Real
    centre: Complex
    radius: Real
    dt: float

    @classmethod
    def of(cls, thing: object) -> ResponseDiscs:
        """The band of a worst-case error, of a family, or of a response with its bound."""
        if isinstance(thing, FrequencyResponse):
            if thing.bound is None:
                raise InputError("`band` is a response without a bound; use with_bound(...), or estimate_frf")
            return cls(thing.omega, thing.values, thing.bound.outer_radius, float(thing.dt or 0.0))
        if isinstance(thing, Band):
            radius = dataclasses.replace(thing, model=None).upper  # about the centres, polygons included
            return cls(thing.omega, thing.centre, radius, thing.problem.dt)
        if isinstance(thing, WorstCase):
            model, omega = thing.model, thing.omega
            return cls(omega, plane_of(model.dt, omega).values_at(model, omega), thing.upper, float(model.dt))
        raise InputTypeError(
            "`band` must be a Band, a WorstCaseError, a WorstCaseOverPoles, a Family or a FrequencyResponse; got"
            f" {type(thing).__name__}"
        )


def band_of_others(bands: Sequence[ResponseDiscs], scores: ArrayLike) -> tuple[Complex, Real, float]:
    r"""ResponseDiscs from leave-one-out scores over all R records: centre and radius (F, ny, nu), and its probability.

    `bands[i]` is made without record i, whose score against it is `scores[i]`. The next record lies in one of the bands times its
    score as a whole with probability at least :math:`1 - 2/(R + 1)`, hence at every frequency in the disc
    that is returned, which holds all of them.

    Notes
    -----
    Source: `barber2021`, Theorem 4 with every fold one record, at :math:`\alpha = 1/(R + 1)`: for sets as for intervals.
    """
    sizes = as_array("scores", scores, ndim=1)
    if len(bands) != sizes.size or sizes.size < 2:
        raise InputError(f"`bands` and `scores` must be one of each, at least two; got {len(bands)} and {sizes.size}")
    centres = np.stack([band.centre for band in bands])
    radii = np.stack([s * band.radius for s, band in zip(sizes, bands, strict=True)])
    real, imag = (
        ((part + radii).max(axis=0) + (part - radii).min(axis=0)) / 2 for part in (centres.real, centres.imag)
    )
    centre = np.asarray(real + 1j * imag, dtype=complex)
    return centre, np.max(np.abs(centres - centre) + radii, axis=0), 1 - 2 / (sizes.size + 1)


@dataclasses.dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Coverage(Frozen):
    """Withheld responses in units of a band that was not made from them.

    Attributes
    ----------
    omega : (F,) array, rad/s
        The frequencies that band and withheld responses have in common.
    names : tuple of str
        Of the withheld responses.
    error : (R, F, ny, nu) array
        |response - centre of the band| over the half-width of the band; NaN where nothing was measured.
    noise : (R, F, ny, nu) array
        The stated bound of the withheld response itself, likewise; 0 where it has none.
    kind : {"records", "periods", "lines"}
        What was withheld: only records of excitations of their own say anything about the next record.
    signals : pair of tuples of str
        Names of outputs and inputs.
    """

    omega: Real
    names: tuple[str, ...]
    error: Real
    noise: Real
    kind: str
    signals: tuple[tuple[str, ...], tuple[str, ...]]

    def __post_init__(self) -> None:
        self._set(**{name: freeze(getattr(self, name)) for name in ("omega", "error", "noise")})

    @functools.cached_property
    def excess(self) -> Real:
        """Error less the withheld response's own bound, (R, F, ny, nu): above 1 it contradicts the band."""
        return freeze(np.maximum(self.error - self.noise, 0.0))

    @property
    def share(self) -> float:
        """Share of the withheld samples that lie inside the band but for their own bounds."""
        used = np.isfinite(self.error)
        return float(np.mean(self.excess[used] <= 1))

    @property
    def largest(self) -> float:
        """Largest `excess`: the factor on the band that is needed at least."""
        return float(np.nanmax(self.excess))

    @property
    def contradicted(self) -> bool:
        """Return whether a withheld sample lies outside the band by more than its own bound."""
        return self.largest > 1

    @property
    def where(self) -> str:
        """Record, frequency and entry of the largest excess, in words."""
        r, k, i, j = np.unravel_index(int(np.nanargmax(self.excess)), self.excess.shape)
        outputs, inputs = self.signals
        entry = "" if len(outputs) == len(inputs) == 1 else f" ({outputs[i]} / {inputs[j]})"
        return f"{self.names[r]}, {self.omega[k] / (2 * np.pi):.5g} Hz{entry}"

    @property
    def scores(self) -> Real:
        """Smallest factor at which the band holds each withheld response with the whole of its own bound, (R,)."""
        return np.nanmax(self.error + self.noise, axis=(1, 2, 3))

    @property
    def in_order(self) -> float:
        """Probability of scores that rise or fall so steadily by chance: small where the records are not exchangeable."""
        return chance_of_order(self.scores)

    @property
    def exchangeable(self) -> bool:
        """False where the order of the scores contradicts that every order of the records is as likely."""
        return self.in_order > _IN_ORDER

    @property
    def next_record(self) -> Ranked:
        """Factor at which the band holds the next record, and with which probability; none where nothing supports one."""
        found = ranked(self.scores)
        sure = self.kind == "records" and self.exchangeable
        return found if sure else found._replace(probability=None)

    def __repr__(self) -> str:
        said = "contradicted" if self.contradicted else "not contradicted"
        return f"<Coverage: {len(self.names)} withheld, {100 * self.share:.4g} % inside, {said}, largest {self.largest:.4g}>"

    @property
    def verdict(self) -> str:
        """Sentence on what the withheld data say of the band."""
        return f"{self.heading}: {self.finding}"

    @property
    def heading(self) -> str:
        """Verdict on the band, in few words."""
        return "Contradicted by withheld data" if self.contradicted else "Not contradicted by withheld data"

    @property
    def finding(self) -> str:
        """Rest of the verdict: how many samples lie inside the band, and how far the farthest one is from its middle."""
        count = self.omega.size if self.kind == "lines" else len(self.names)
        inside = f"{_percent(self.share)} % of the samples of {count} {UNITS[self.kind][count > 1]} lie inside the band"
        found = f"{self.largest:.4g} of its half-width ({self.where})"
        return f"only {inside}, one at {found}." if self.contradicted else f"{inside}, up to {found}."

    @property
    def sentences(self) -> tuple[str, ...]:
        """The verdict, what is needed, and what holds the next record with which probability."""
        said = [self.verdict]
        if self.contradicted:
            said.append(
                f"Needed: a band at least {self.largest:.4g} times as wide; or poles in a pole-uncertainty box, where the excess"
                " is at a resonance; or another record with an excitation of its own, so that what changes from record to"
                " record is measured and not assumed."
            )
        factor, probability = self.next_record
        count, scores = len(self.names), ", ".join(f"{size:.3g}" for size in self.scores)
        if self.kind != "records":
            said.append(
                f"These are {UNITS[self.kind][True]}: they say nothing of the next record, and no probability follows."
            )
        elif not self.exchangeable:
            said.append(
                f"No probability follows: the {count} scores stand in the order of the records ({scores}; by chance"
                f" with probability {self.in_order:.2g}): the plant or the setup drifts, and the next record will be farther"
                " off. Measure in random order, or make the drift a condition of a family."
            )
        elif probability is None:
            said.append(
                f"One withheld record gives the factor {factor:.4g} and no probability: two records in all say that there is a"
                " difference, not how large the next one is."
            )
        else:
            said.append(
                f"The band times {factor:.4g} holds the next record with probability at least {count}/{count + 1}, if the records"
                " are exchangeable: measured in the same way, in any order."
            )
        return tuple(said)

    def summary(self) -> str:
        """The sentences, and the scores."""
        rows = [f"{name}: {score:.4g}" for name, score in zip(self.names, self.scores, strict=True)]
        return "\n".join([*self.sentences, "scores: " + ", ".join(rows)])


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

    Examples
    --------
    >>> import numpy as np, robustid as rid
    >>> omega, rng = np.array([1.0, 2.0]), np.random.default_rng(0)
    >>> band = rid.FrequencyResponse(omega, [1.0, 0.5], bound=0.1, dt=1.0)
    >>> further = [rid.FrequencyResponse(omega, [1.0, 0.5 + d], bound=0.01, dt=1.0) for d in (0.03, -0.09, 0.12, 0.05)]
    >>> found = rid.coverage(band, further)
    >>> found.contradicted, found.next_record.probability, round(found.next_record.factor, 6)
    (True, 0.8, 1.3)
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
    found = [_found(discs.omega, item.omega) for item in items]
    shared = np.any([mask for mask, _ in found], axis=0)
    if not shared.any():
        raise InputError(
            "`withheld` and `band` have no frequency in common: bound the errors at frequencies of the withheld lines, with `omega`"
        )
    error, noise = np.full((2, len(items), *discs.radius.shape), np.nan)
    for r, (item, (mask, at)) in enumerate(zip(items, found, strict=True)):
        away = np.where(item.missing[at], np.nan, np.abs(item.values[at] - discs.centre[mask]))
        own = np.zeros(away.shape) if item.bound is None else item.bound.outer_radius[at]
        with np.errstate(divide="ignore", invalid="ignore"):
            error[r, mask] = away / discs.radius[mask]
            noise[r, mask] = np.where(np.isnan(away), np.nan, own / discs.radius[mask])
    signals = tuple(str(s.name) for s in items[0].outputs), tuple(str(s.name) for s in items[0].inputs)
    return Coverage(
        omega=discs.omega[shared],
        names=tuple(map(str, labels)),
        error=error[:, shared],
        noise=noise[:, shared],
        kind=kind,
        signals=signals,
    )


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


def _found(wanted: Real, have: Real) -> tuple[NDArray[np.bool_], NDArray[np.intp]]:
    """Mask of the wanted frequencies that are there, and their places."""
    at = np.clip(np.searchsorted(have, wanted), 1, max(have.size - 1, 1))
    pair = np.stack([at - 1, np.minimum(at, have.size - 1)])
    nearest = pair[np.argmin(np.abs(have[pair] - wanted), axis=0), np.arange(wanted.size)]
    mask = np.abs(have[nearest] - wanted) <= _SAME * np.maximum(wanted, have[nearest])
    return mask, nearest[mask]


def _percent(share: float) -> str:
    """A share in per cent that is 100 only where it is all."""
    return f"{100 * share:.4g}" if share in (0.0, 1.0) else f"{min(100 * share, 99.99):.4g}"

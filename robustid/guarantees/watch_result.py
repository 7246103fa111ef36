"""Watch: a band, the records of a machine since it was made, and the alarms that follow."""

from __future__ import annotations

import dataclasses
import functools
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from robustid.core import Complex, Frozen, Real, Savable, StateMatrices, Tabular, as_kind, freeze, plane_of
from robustid.data import FrequencyResponse
from robustid.errors import InputError
from robustid.figures import Drawable
from robustid.guarantees.band_result import Band
from robustid.guarantees.coverage import coverage, matched, on_lines
from robustid.guarantees.coverage_result import Coverage
from robustid.guarantees.drift import Drift, drift, fewest_to_alarm
from robustid.guarantees.family_result import Family
from robustid.guarantees.response_discs import Discs, ResponseDiscs, discs_by_condition
from robustid.guarantees.scope import scope_of
from robustid.guarantees.value_set import norm_of_bounds

SURE = 1 - 1e-6  # probability with which the bound of a record holds that refutes


class Place(NamedTuple):
    """A frequency of one entry: rad/s, and the numbers of output and input."""

    omega: float
    output: int
    input: int


class Sensitivity(NamedTuple):
    """Peak of the sensitivity with a record: the least and largest that its bound leaves, and the limit of the band."""

    least: float
    most: float
    limit: float

    @property
    def kept(self) -> bool | None:
        """True where the record keeps what the band promises, False where it breaks it, None where its bound leaves both."""
        return True if self.most <= self.limit else False if self.least > self.limit else None


class Watched(NamedTuple):
    """One record of a watch.

    `score`: smallest factor on the band and its own bound together that holds it, `at`: where; `e_value` and `evidence`: of a
    drift, see `drift`; `drifted`: the alarm; `refuted`: where no plant of the class explains the data of the band and this
    record, None: nowhere; `excess`: its distance from the middle of the band there, in half-widths, less its own bound;
    `sensitivity`: with the controller, None without one; `member`: of a family the one whose score this is, the smallest.
    """

    name: str
    score: float
    at: Place
    e_value: float
    evidence: float
    drifted: bool
    refuted: Place | None
    excess: float
    sensitivity: Sensitivity | None
    member: str


@dataclasses.dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Watch(Frozen, Tabular, Drawable, Savable):
    """Band, records of the machine since, and two alarms: refuted, a proof, and drifted, with a stated rate of false alarms.

    Attributes
    ----------
    band : Band, WorstCaseError, WorstCaseOverPoles, Family or FrequencyResponse
        What is promised.
    usual : tuple of FrequencyResponse
        Records that the band was not made from, of the machine as it should be.
    records : tuple of FrequencyResponse
        Those that are watched, in their order.
    names : tuple of str
        Of the records.
    rate : float
        False alarms of a drift in a record, at most, on average.
    controller : StateMatrices or None
        Of the loop ``u = -C y``.
    conditions : tuple of str
        Of the records, those that were stated: names of members of a family; empty where a record may be of any.
    """

    band: Discs
    usual: tuple[FrequencyResponse, ...]
    records: tuple[FrequencyResponse, ...]
    names: tuple[str, ...]
    rate: float
    controller: StateMatrices | None = None
    conditions: tuple[str, ...] = ()

    INDEX = "record"

    def update(self, record: FrequencyResponse, name: str | None = None, *, condition: str | None = None) -> Self:
        """Watch with one more record.

        Parameters
        ----------
        record : FrequencyResponse
            With the bound of its noise, see `estimate_frf`; of the signals and the sample time of the band.
        name : str, optional
            Default: its number.
        condition : str, optional
            Of a band that is a family: the name of the member in whose condition (temperature, load) it was measured, which is
            then the one that must explain it. Default: any member may.

        Returns
        -------
        Watch
            A new one; the verdicts on earlier records stay.

        Raises
        ------
        InputError, InputTypeError
            Another object, other signals or sample time, no frequency in common with the band, a name that stands already, a
            condition that is no member.
        """
        as_kind("record", record, FrequencyResponse, "a FrequencyResponse; estimate_frf makes one of a time record")
        name = f"record {len(self.records) + 1}" if name is None else name
        if name in self.names:
            raise InputError(
                f"`name` {name!r} is watched already; give the new record a name of its own", argument="name"
            )
        if condition is not None and condition not in (known := [one for one in discs_by_condition(self.band) if one]):
            of = f"must be one of {', '.join(known)}" if known else "is a member of a family, and the band is none"
            raise InputError(f"`condition` {of}; got {condition!r}", argument="condition")
        coverage(on_lines(self.band, [record]), record, names=[name])  # refuses what does not belong to the band
        before = self.conditions or ("",) * len(self.records)
        return dataclasses.replace(
            self, records=(*self.records, record), names=(*self.names, name), conditions=(*before, condition or "")
        )

    @functools.cached_property
    def coverage(self) -> Coverage | None:
        """All records in units of the band, of a family in those of its first member, those from before first; None without any."""
        return next(iter(self._coverages.values()), None)

    @functools.cached_property
    def _coverages(self) -> dict[str, Coverage]:
        """All records in units of the band of every member; of a band that is no family, in those of its own."""
        everything = [*self.usual, *self.records]
        if not everything:
            return {}
        names = [*(f"before {k + 1}" for k in range(len(self.usual))), *self.names]
        bands = discs_by_condition(self.band)
        return {name: coverage(on_lines(one, everything), everything, names=names) for name, one in bands.items()}

    @functools.cached_property
    def _nearest(self) -> tuple[NDArray[np.intp], Real]:
        """The member with the smallest score of every record, (U + R,), and the shares with it."""
        if not self._coverages:
            return np.zeros(0, dtype=np.intp), np.zeros((0, 0, 1, 1))
        shares = np.stack([one.error / (1 + one.noise) for one in self._coverages.values()])
        member = np.argmin(np.nanmax(shares, axis=(2, 3, 4), initial=0.0), axis=0)
        return member, shares[member, np.arange(member.size)]

    @property
    def shares(self) -> Real:
        """Distance from the middle of the band over the sum of its half-width and the record's own bound, (U + R, F, ny, nu).

        Of a family that of the member with which the record has the smallest score.
        """
        return freeze(self._nearest[1])

    @functools.cached_property
    def _scores(self) -> Real:
        return np.nanmax(self.shares, axis=(1, 2, 3), initial=0.0)

    @property
    def scores(self) -> Real:
        """Smallest factors on the band and the bounds of the records, together, that hold these, (R,)."""
        return freeze(self._scores[len(self.usual) :])

    @property
    def usual_scores(self) -> Real:
        """Scores of the records from before the watch, (U,)."""
        return freeze(self._scores[: len(self.usual)])

    @functools.cached_property
    def drift(self) -> Drift:
        """Evidence of a drift, record by record."""
        return drift(self.usual_scores, self.scores, self.rate)

    @functools.cached_property
    def history(self) -> tuple[Watched, ...]:
        """Verdicts on the records, in their order."""
        found = self.coverage
        if found is None:
            return ()
        first = len(self.usual)
        shares, proved, members = self.shares[first:], self._proved_excess, list(self._coverages)
        return tuple(
            Watched(
                name=name,
                score=float(self.scores[r]),
                at=self._place(shares[r]),
                e_value=float(self.drift.e_values[r]),
                evidence=float(self.drift.sums[r]),
                drifted=bool(self.drift.alarms[r]),
                refuted=self._place(proved[r]) if np.nanmax(proved[r], initial=0.0) > 1 else None,
                excess=float(np.nanmax(proved[r], initial=0.0)),
                sensitivity=self._sensitivities[r],
                member=members[int(self._nearest[0][first + r])],
            )
            for r, name in enumerate(self.names)
        )

    @property
    def refuted(self) -> tuple[Watched, ...]:
        """Records that no plant of the class explains together with the data of the band."""
        return tuple(one for one in self.history if one.refuted is not None)

    @property
    def drifted(self) -> tuple[Watched, ...]:
        """Records at which the alarm of a drift was given."""
        return tuple(one for one in self.history if one.drifted)

    @property
    def fewest_to_alarm(self) -> int | None:
        """Number of records in a row, each with a larger score than all before it, that give the alarm of a drift."""
        return fewest_to_alarm(len(self.usual) + len(self.records), self.rate)

    def table(self) -> dict[str, list[object]]:
        """Columns of the history: a row a record."""
        return {
            "record": [one.name for one in self.history],
            "score": [one.score for one in self.history],
            "frequency [Hz]": [one.at.omega / (2 * np.pi) for one in self.history],
            "e-value": [one.e_value for one in self.history],
            "evidence": [one.evidence for one in self.history],
            "drifted": [one.drifted for one in self.history],
            "refuted at [Hz]": [
                np.nan if one.refuted is None else one.refuted.omega / (2 * np.pi) for one in self.history
            ],
            "excess": [one.excess for one in self.history],
        }

    @functools.cached_property
    def _proved_excess(self) -> Real:
        """Excess of the records over the band by bounds that are as good as sure, (R, F, ny, nu); NaN where nothing gives one.

        Of a family over the band of the member whose condition was stated, else of the one with which it is smallest.
        """
        found = self.coverage
        if found is None:
            return np.zeros(0)
        sure = [_surely_bounded(one) for one in self.records]
        sizes = np.full(found.error.shape, np.nan)[len(self.usual) :]
        if known := [r for r, one in enumerate(sure) if one is not None]:
            everything = [*self.usual, *(one or other for one, other in zip(sure, self.records, strict=True))]
            bands = discs_by_condition(self.band)
            each = np.stack([coverage(on_lines(one, everything), everything).excess for one in bands.values()])
            each = each[:, len(self.usual) :]
            largest = np.nanmax(each, axis=(2, 3, 4), initial=0.0)
            for r in known:
                stated = self.conditions[r] if self.conditions else ""
                member = list(bands).index(stated) if stated else int(np.argmin(largest[:, r]))
                sizes[r] = each[member, r]
        return sizes

    @functools.cached_property
    def _sensitivities(self) -> tuple[Sensitivity | None, ...]:
        """Peaks of the sensitivity with every record, and what the band allows at the same frequencies."""
        if self.controller is None:
            return (None,) * len(self.records)
        discs = ResponseDiscs.of(on_lines(self.band, self.records))
        through = plane_of(discs.dt, discs.omega).values_at(self.controller.model(discs.dt), discs.omega)
        found: list[Sensitivity] = []
        for record in self.records:
            there, at = matched(discs.omega, record.omega)
            used = np.isfinite(discs.radius[there]).all(axis=(1, 2)) & ~record.missing[at].any(axis=(1, 2))
            own = record.select(at[used])
            gain, radius = (
                through[there][used],
                np.zeros(own.values.shape) if own.bound is None else own.bound.outer_radius,
            )
            least, most = _peaks(own.values, radius, gain)
            limit = _peaks(discs.centre[there][used], discs.radius[there][used], gain)[1]
            found.append(Sensitivity(least, most, limit))
        return tuple(found)

    def _place(self, sizes: Real) -> Place:
        found = self.coverage
        k, i, j = np.unravel_index(int(np.nanargmax(sizes)), sizes.shape)
        return Place(float(np.nan if found is None else found.omega[k]), int(i), int(j))

    @property
    def verdict(self) -> str:
        """Sentence on the last record, and on what came before it."""
        return " ".join(self.sentences[:1])

    @property
    def sentences(self) -> tuple[str, ...]:
        """Sentences on the records: the alarms, the controller, and what the rate means."""
        return (*self._alarm_words, *self._controller_words, self._rate_words)

    @property
    def _alarm_words(self) -> list[str]:
        if not self.history:
            return ["Nothing is watched yet: no record has come since the band was made."]
        last, said = self.history[-1], list[str]()
        for one in self.refuted[:1]:
            said.append(
                f"Refuted by {one.name} at {self.where(one.refuted)}: {self._no_plant}; it lies {one.excess:.3g}"
                " half-widths from the middle of the band, its own bound deducted."
            )
        for one in self.drifted[:1]:
            more = f", and {len(self.drifted) - 1} times since" if len(self.drifted) > 1 else ""
            said.append(
                f"Drifted: alarm at {one.name}{more}; the scores are larger than those of the records before"
                f" ({one.score:.3g} of what band and bound leave, at {self.where(one.at)})."
            )
        if said:
            return said
        return [
            f"No alarm in {len(self.history)} record{'s' * (len(self.history) > 1)}; the last one uses {100 * last.score:.3g} % of"
            f" what the band and its own bound leave it ({self.where(last.at)}), evidence {last.evidence:.3g} of the"
            f" {1 / self.rate:.4g} at which an alarm is given."
        ]

    @property
    def _no_plant(self) -> str:
        """Words on what a record that is refuted shows, and what that rests on."""
        if isinstance(self.band, FrequencyResponse):
            return "no plant keeps both the bound of the band and that of this record"
        if isinstance(self.band, Family):
            return "no member explains it, or not the one whose condition was stated: no plant of the class has its data and this"
        scope = scope_of([self.band]) if isinstance(self.band, Band) else ""
        return f"no plant of the class explains the data of the band and this record{scope}"

    @property
    def _controller_words(self) -> list[str]:
        last = self.history[-1].sensitivity if self.history else None
        if last is None:
            return []
        found = f"between {last.least:.4g} and {last.most:.4g}, where the band allows {last.limit:.4g}"
        if last.kept:
            return [f"With the controller the peak of S of {self.names[-1]} is kept: {found}."]
        if last.kept is False:
            return [f"With the controller the peak of S of {self.names[-1]} is larger than what was proved: {found}."]
        return [f"Whether {self.names[-1]} keeps the proved peak of S its own bound leaves open: {found}."]

    @property
    def _rate_words(self) -> str:
        count, usual = self.fewest_to_alarm, len(self.usual) + len(self.records)
        needs = "more than 1000" if count is None else f"at least {count}"
        return (
            "While the machine stays as it was, and its records are measured in the same way, there is on average at most one"
            f" false alarm of a drift in {1 / self.rate:.4g} records. After {usual} of them an alarm takes {needs} in a row."
        )

    def where(self, at: Place | None) -> str:
        """A place in words: frequency, and entry where there are several."""
        if at is None:
            return "no frequency"
        first = [*self.records, *self.usual][0]
        hertz = f"{at.omega / (2 * np.pi):.5g} Hz"
        if first.values.shape[1:] == (1, 1):
            return hertz
        return f"{hertz} ({first.outputs[at.output].name} / {first.inputs[at.input].name})"

    def summary(self) -> str:
        """The sentences, and a row a record for the last ten."""
        rows = [f"{one.name}: score {one.score:.4g}, evidence {one.evidence:.3g}" for one in self.history[-10:]]
        return "\n".join([*self.sentences, *rows])

    def __repr__(self) -> str:
        return (
            f"<Watch: {len(self.records)} records after {len(self.usual)}, {len(self.refuted)} refuted,"
            f" {len(self.drifted)} alarms of a drift>"
        )


def _surely_bounded(record: FrequencyResponse) -> FrequencyResponse | None:
    """The record with a bound that is hard, or fails once in a million records; None where nothing gives one."""
    if record.bound is not None and record.bound.kind == "hard":
        return record
    return None if record.covariance is None else record.with_joint_bound(SURE)


def _peaks(values: Complex, radius: Real, through: Complex) -> tuple[float, float]:
    """Least and largest peak of the largest singular value of (I + P C)^-1 over discs of P, at the frequencies given."""
    back = np.eye(values.shape[1]) + values @ through
    size = np.linalg.svd(back, compute_uv=False)[:, -1]
    reach = norm_of_bounds(radius) * np.linalg.norm(through, ord=2, axis=(1, 2))
    with np.errstate(divide="ignore"):
        most = float(np.max(1 / np.maximum(size - reach, 0.0), initial=0.0))
    return float(np.max(1 / (size + reach), initial=0.0)), most

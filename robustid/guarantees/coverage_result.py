"""Coverage: withheld data in units of a band, what they could have shown, and what follows."""

from __future__ import annotations

import dataclasses
import functools
from typing import Any

import numpy as np
from numpy.typing import NDArray

from robustid.core import Frozen, Real, Tabular, freeze, hz_words
from robustid.guarantees.next_record import Ranked, chance_of_order, ranked
from robustid.guarantees.power import NARROW, SURE, Judgement

UNITS = {  # one of them, and several
    "records": ("withheld record", "withheld records"),
    "periods": ("withheld period of the same excitation", "withheld periods of the same excitation"),
    "lines": ("withheld spectral line of the same records", "withheld spectral lines of the same records"),
}
_IN_ORDER = 0.1  # probability below which the order of the scores is no chance
_NARROW = {3.0: "three"}[NARROW]


@dataclasses.dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Coverage(Frozen, Tabular):
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
    shown : (R, F, ny, nu) array
        Probability at least with which a sample would have contradicted the band, had the true response been three half-widths
        from its centre there, see `guarantees.shown`; NaN where nothing was measured or the band says nothing.
    false_alarm : float or None
        Probability at most with which a band that holds is contradicted: that a bound of the withheld data fails. None where
        their bounds state none.
    kind : {"records", "periods", "lines"}
        What was withheld: only records of excitations of their own say anything about the next record.
    signals : pair of tuples of str
        Names of outputs and inputs.
    """

    omega: Real
    names: tuple[str, ...]
    error: Real
    noise: Real
    shown: Real
    false_alarm: float | None
    kind: str
    signals: tuple[tuple[str, ...], tuple[str, ...]]

    def __post_init__(self) -> None:
        self._set(**{name: freeze(getattr(self, name)) for name in ("omega", "error", "noise", "shown")})

    def table(self) -> dict[str, list[Any]]:
        """Columns of distances from the middle of the band, in half-widths: a row for every record, frequency and entry."""
        places = list(np.ndindex(*self.error.shape))
        outputs, inputs = self.signals
        return {
            "withheld": [self.names[r] for r, *_ in places],
            "frequency [Hz]": [self.omega[k] / (2 * np.pi) for _, k, *_ in places],
            "output": [outputs[i] for *_, i, _ in places],
            "input": [inputs[j] for *_, j in places],
            "error": self.error.ravel().tolist(),
            "own bound": self.noise.ravel().tolist(),
            "excess": self.excess.ravel().tolist(),
        }

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

    @functools.cached_property
    def power_at(self) -> Real:
        """Probability at least with which a band that is three times too narrow at a place would have shown, (F, ny, nu).

        By any of the R responses, whose errors are independent; NaN where there is nothing to test.
        """
        known = np.isfinite(self.shown)
        hidden = np.prod(np.where(known, 1 - self.shown, 1.0), axis=0)
        return freeze(np.where(known.any(axis=0), 1 - hidden, np.nan))

    @property
    def counts(self) -> NDArray[np.bool_]:
        """Mask of the places (F, ny, nu) that count: others have errors of their own as large as the band, and support nothing."""
        return np.nan_to_num(self.power_at, nan=0.0) > 0

    @property
    def power(self) -> float:
        """Probability at least with which a band three times too narrow would have shown.

        That is: at one of the places, each as likely, the true response lies three half-widths from the centre of the band. Places
        that do not count would have shown nothing.
        """
        known = np.isfinite(self.power_at)
        return float(np.mean(self.power_at[known])) if known.any() else 0.0

    @property
    def judgement(self) -> Judgement:
        """Supported, contradicted, or not tested: inside, and so it would be with a band three times too narrow."""
        if self.contradicted:
            return Judgement.CONTRADICTED
        return Judgement.SUPPORTED if self.power >= SURE else Judgement.NOT_TESTED

    @property
    def farthest(self) -> float:
        """Largest distance from the centre of the band of a sample that counts, in half-widths; NaN where none does."""
        sizes = self.error[:, self.counts]
        return float(np.nanmax(sizes)) if np.isfinite(sizes).any() else np.nan

    @property
    def where(self) -> str:
        """Record, frequency and entry of the largest excess, in words."""
        return self._place(self.excess)

    def _place(self, sizes: Real) -> str:
        """Record, frequency and entry of the largest of some sizes, in words."""
        r, k, i, j = np.unravel_index(int(np.nanargmax(sizes)), sizes.shape)
        outputs, inputs = self.signals
        entry = "" if len(outputs) == len(inputs) == 1 else f" ({outputs[i]} / {inputs[j]})"
        return f"{self.names[r]}, {hz_words(self.omega[k] / (2 * np.pi))}{entry}"

    @property
    def scores(self) -> Real:
        """Smallest factor at which the band holds each withheld response with the whole of its own bound, (R,)."""
        return np.nanmax(self.error + self.noise, axis=(1, 2, 3))

    @property
    def scored(self) -> bool:
        """True where the scores say something: of records, and not of the own bound of a single one alone."""
        return self.kind == "records" and (len(self.names) > 1 or self.contradicted or bool(self.scores[0] <= 1))

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
        said = f"{self.judgement.value}, power {self.power:.4g}, largest {self.largest:.4g}"
        return f"<Coverage: {len(self.names)} withheld, {100 * self.share:.4g} % inside, {said}>"

    @property
    def verdict(self) -> str:
        """Sentence on what the withheld data say of the band."""
        return f"{self.heading}: {self.finding}"

    @property
    def heading(self) -> str:
        """Verdict on the band, in few words."""
        return f"{self.judgement.value.capitalize()} by withheld data"

    @property
    def finding(self) -> str:
        """Rest of the verdict: what lies inside the band, how far away the farthest is, and what would have shown."""
        count = self.omega.size if self.kind == "lines" else len(self.names)
        of = f"{count} {UNITS[self.kind][count > 1]}"
        if self.contradicted:
            found = f"{self.largest:.4g} of its half-width ({self.where})"
            return f"only {_percent(self.share)} % of the samples of {of} lie inside the band, one at {found}."
        could = f"a band {_NARROW} times too narrow"
        counted, places = int(self.counts.sum()), int(np.isfinite(self.power_at).sum())
        if not counted:
            own = "have errors of their own as large as the band, and none counts"
            return f"{could} could not be told from it. The samples of {of} {own}."
        some = "" if counted == places else f" at the {counted} of {places} places that count"
        inside = f"but for their own bounds the samples of {of} lie inside the band{some}, {self._reach}"
        if self.judgement is Judgement.SUPPORTED:
            share = "every such test" if self.power == 1 else f"at least {_least(self.power)} % of such tests"
            return f"{inside}; {could} would have shown in {share}."
        return (
            f"{could} would surely have shown in only {_least(self.power)} % of such tests."
            f" {inside[0].upper()}{inside[1:]}; at the others their own errors are as large as the band."
        )

    @property
    def _reach(self) -> str:
        """Words on the sample that counts and is farthest from the centre."""
        sizes = np.where(self.counts, self.error, np.nan)
        return f"the farthest {self.farthest:.3g} of its half-width from the middle ({self._place(sizes)})"

    @property
    def sentences(self) -> tuple[str, ...]:
        """The verdict, what is needed, and what holds the next record with which probability."""
        return (self.verdict, *self._about_the_test, *self._about_the_next)

    @property
    def _about_the_test(self) -> list[str]:
        """Sentences on what a test is, how often it errs, and what is needed after it."""
        if self.contradicted:
            said = [
                f"Needed: a band at least {self.largest:.4g} times as wide; or poles in a pole-uncertainty box, where the excess"
                " is near one of them; or another record with an excitation of its own, so that what changes from record to"
                " record is measured and not assumed."
            ]
        else:
            said = [
                f"{_NARROW.capitalize()} times too narrow: the true response lies {_NARROW} half-widths from the middle of the band"
                " at one place, a frequency of one entry, each as likely."
            ]
        if self.false_alarm:
            rate = f"with a probability of at most {_percent(self.false_alarm)} %, that of a withheld bound that fails"
            said[0] += f" A band that holds is contradicted {rate}."
        if self.judgement is Judgement.NOT_TESTED and (wanted := self.missing_precision) > 1:
            much = f"{wanted**2:.2g}" if wanted < 3 else f"{wanted**2:.0f}"
            said.append(
                f"Withheld data with bounds {wanted:.3g} times smaller would test it; of averages about {much} times as much data."
            )
        return said

    @property
    def missing_precision(self) -> float:
        """Factor by which the bounds of the withheld data would have to be smaller for a test that is sure to have power."""
        known = np.isfinite(self.power_at)
        least = np.min(np.where(np.isnan(self.noise), np.inf, self.noise), axis=0)[known]
        return float(np.quantile(least, SURE, method="higher")) if least.size else np.nan

    @property
    def _about_the_next(self) -> list[str]:
        """Sentences on the next record."""
        factor, probability = self.next_record
        count, scores = len(self.names), ", ".join(f"{size:.3g}" for size in self.scores)
        if self.kind != "records":
            return [
                f"These are {UNITS[self.kind][True]}: they say nothing of the next record, and no probability follows."
            ]
        if not self.exchangeable:
            said = [
                f"No probability follows: the {count} scores stand in the order of the records ({scores}; by chance"
                f" with probability {self.in_order:.2g}): the plant or the setup drifts, and the next record will be farther"
                " off. Measure in random order, or make the drift a condition of a family."
            ]
        elif probability is None:
            gives = f"gives the factor {factor:.4g} and" if self.scored else "gives"
            return [
                f"One withheld record {gives} no probability: two records in all say that there is a difference, not how large"
                " the next one is."
            ]
        else:
            said = [
                f"The band times {factor:.4g} holds the next record with probability at least {count}/{count + 1}, if the records"
                " are exchangeable: measured in the same way, in any order."
            ]
        if factor > 1 and not self.contradicted:
            said.append(
                "The factor is above 1 although nothing was seen outside the band: it holds the records with the whole of their"
                f" own bounds, which are up to {np.nanmax(self.noise):.3g} half-widths."
            )
        return said

    def summary(self) -> str:
        """The sentences, and the scores where they say something."""
        rows = [f"{name}: {score:.4g}" for name, score in zip(self.names, self.scores, strict=True)]
        return "\n".join([*self.sentences, *(["scores: " + ", ".join(rows)] if self.scored else [])])


def _least(share: float) -> str:
    """A share in per cent that is not above it, to a tenth."""
    return f"{np.floor(1000 * share) / 10:g}"


def _percent(share: float) -> str:
    """A share in per cent that is 100 only where it is all."""
    return f"{100 * share:.4g}" if share in (0.0, 1.0) else f"{min(100 * share, 99.99):.4g}"

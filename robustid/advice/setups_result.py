"""Modes of one machine in several setups: the intervals that all leave, and which setups contradict each other at which mode."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from robustid.core import Frozen, Real, Savable, Tabular, freeze, keep, rounded_down, rounded_up
from robustid.errors import InputError

Interval = tuple[float, float]
_WORDS = {"frequency": ("higher", "lower"), "damping": ("more", "less")}


class Disagreement(NamedTuple):
    """Two setups whose boxes of one mode have no point in common: the proof that no mode is in both.

    `mode`: its number from 0; `quantity`: in which the intervals are disjoint; `setups`: names, of the smaller values first;
    `intervals`: theirs, in Hz or of the damping ratio; `level`: the larger factor on the bounds of both with which these boxes
    hold, above 1 evidence and no proof.
    """

    mode: int
    quantity: Literal["frequency", "damping"]
    setups: tuple[str, str]
    intervals: tuple[Interval, Interval]
    level: float


class Moved(NamedTuple):
    """A mode of one setup beside the same mode of the others, in Hz or of the damping ratio.

    `before`: what the others leave in common, or the range of all of them where they contradict each other; `change`: the smallest
    and the largest relative change that both intervals leave.
    """

    mode: int
    quantity: Literal["frequency", "damping"]
    before: Interval
    after: Interval

    @property
    def change(self) -> Interval:
        """Ends of `after / before - 1`."""
        return self.after[0] / self.before[1] - 1, self.after[1] / self.before[0] - 1

    @property
    def shown(self) -> bool:
        """True where the intervals are disjoint: whatever the mode was, it is not any more."""
        return self.change[0] > 0 or self.change[1] < 0

    @property
    def words(self) -> str:
        """Sentence without its end, of a mode that is shown to have moved: from where to where, and by how much at least."""
        unit = " Hz" if self.quantity == "frequency" else ""
        low, high = self.change
        least, gap = (low, self.after[0] - self.before[1]) if low > 0 else (high, self.before[0] - self.after[1])
        was, now = ends_words(self.before, gap), ends_words(self.after, gap)
        size = f"{rounded_down(abs(100 * least), 2):.2g} % {_WORDS[self.quantity][least < 0]}"
        return f"mode {self.mode + 1}: {self.quantity} from {was}{unit} to {now}{unit}, at least {size}"


@dataclasses.dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class CommonModes(Frozen, Tabular, Savable):
    """Modes of one machine by several setups: of each mode the box of every setup that shows it, and what all leave together.

    Attributes
    ----------
    names : tuple of str
        Of the S setups.
    omega_intervals, damping_intervals : (M, S, 2) arrays, rad/s and 1
        Boxes of the poles, modes by rising frequency; NaN where a setup does not show the mode.
    used : (M, S) array of bool
        Boxes that hold the pole with the stated probability, and of which is known to which mode they belong. Others stand in a
        row of their own and take no part.
    level : (M, S) array
        Factor on the bounds at which the box was taken: 1, or more where no local fit keeps to them (`KautzSuggestion`).
    fails : (M, S) array
        Probability at most that the box does not hold the pole: 0 of hard bounds, NaN where nothing says it.
    estimates : (M, S, 2, 2) array
        Of the logarithms of natural frequency and damping, in turn, the estimate of a setup and the half-width of the interval
        around it that fails as rarely as the box; NaN where the errors are not known to be normal.
    """

    names: tuple[str, ...]
    omega_intervals: Real
    damping_intervals: Real
    used: NDArray[np.bool_]
    level: Real
    fails: Real
    estimates: Real

    INDEX = "mode"

    def __post_init__(self) -> None:
        for name in ("omega_intervals", "damping_intervals", "used", "level", "fails", "estimates"):
            self._set(**{name: freeze(getattr(self, name))})

    @property
    def freq_hz_intervals(self) -> Real:
        """The natural frequencies in Hz, (M, S, 2)."""
        return freeze(self.omega_intervals / (2 * np.pi))

    @property
    def omega_interval(self) -> Real:
        """Natural frequencies that all setups leave, rad/s, (M, 2); NaN of a mode in which they contradict each other."""
        return self._joint[0]

    @property
    def freq_hz_interval(self) -> Real:
        """The same in Hz, (M, 2)."""
        return freeze(self._joint[0] / (2 * np.pi))

    @property
    def damping_interval(self) -> Real:
        """Damping ratios that all setups leave, (M, 2); NaN of a mode in which they contradict each other."""
        return self._joint[1]

    @property
    def probability(self) -> Real:
        """Probability at least with which the interval of each mode holds its pole, (M,); NaN where nothing says it."""
        fails = np.where(self.used, self.fails, 0.0)
        more = np.where(self.averaged.any(axis=(1, 2)), fails.max(axis=1), 0.0)
        return freeze(1 - np.minimum(fails.sum(axis=1) + more, 1.0))

    @property
    def false_alarm(self) -> float:
        """Probability at most of any contradiction where there is none; NaN where nothing says it."""
        return float(min(np.sum(1 - self.probability), 1.0))

    @functools.cached_property
    def _joint(self) -> tuple[Real, Real]:
        omega, damping = (_common(ends, self.used) for ends in (self.omega_intervals, self.damping_intervals))
        empty = (omega[:, 0] > omega[:, 1]) | (damping[:, 0] > damping[:, 1])
        omega[empty] = damping[empty] = np.nan
        for quantity, ends in enumerate((omega, damping)):
            place, half = _mean(self.estimates[:, :, quantity], self.averaged[:, :, quantity])
            low, high = np.maximum(ends[:, 0], np.exp(place - half)), np.minimum(ends[:, 1], np.exp(place + half))
            some = low < high  # a mean outside the boxes says nothing
            ends[some] = np.stack([low, high], axis=1)[some]
        return freeze(omega), freeze(damping)

    @functools.cached_property
    def averaged(self) -> NDArray[np.bool_]:
        """Estimates that take part in the mean of their mode, of frequency and of damping, (M, S, 2): two of a mode, or none.

        None of them where one is farther from the mean than its own half-width.
        """
        able = self.used[:, :, None] & np.isfinite(self.estimates).all(axis=3)
        for quantity in range(2):
            place, _ = _mean(self.estimates[:, :, quantity], able[:, :, quantity])
            far = np.abs(self.estimates[:, :, quantity, 0] - place[:, None]) > self.estimates[:, :, quantity, 1]
            mine = able[:, :, quantity]
            mine[(mine.sum(axis=1) < 2) | np.any(mine & far, axis=1)] = False
        return freeze(able)

    @property
    def compared(self) -> int:
        """Number of modes that two setups show, or more."""
        return int(np.sum(self.used.sum(axis=1) > 1))

    @functools.cached_property
    def disagreements(self) -> tuple[Disagreement, ...]:
        """Two setups for every mode in which no point is in all boxes: those farthest apart, in frequency and in damping."""
        found: list[Disagreement] = []
        for mode, used in enumerate(self.used):
            for quantity, ends in self._quantities:
                if used.any():
                    low = int(np.argmin(np.where(used, ends[mode, :, 1], np.inf)))
                    high = int(np.argmax(np.where(used, ends[mode, :, 0], -np.inf)))
                    if ends[mode, low, 1] < ends[mode, high, 0]:
                        pair = (_pair(ends[mode, low]), _pair(ends[mode, high]))
                        level = float(self.level[mode, [low, high]].max())
                        found.append(Disagreement(mode, quantity, (self.names[low], self.names[high]), pair, level))
        return tuple(found)

    @property
    def odd(self) -> str | None:
        """Name of the one setup without which no two contradict each other; None where there is none, or more than one."""
        if not self.disagreements:
            return None
        alone = [name for name in self.names if not self.without(name).disagreements]
        return alone[0] if len(alone) == 1 else None

    def without(self, setup: str) -> CommonModes:
        """The same with the boxes of one setup, by its name, left out."""
        used = self.used.copy()
        used[:, self._number(setup)] = False
        return dataclasses.replace(self, used=used)

    def _number(self, setup: str) -> int:
        if setup not in self.names:
            raise InputError(f"`setup` must be one of {', '.join(self.names)}; got {setup!r}", argument="setup")
        return self.names.index(setup)

    def moved(self, setup: str) -> tuple[Moved, ...]:
        """Modes of one setup beside those of the others, in frequency and damping.

        Parameters
        ----------
        setup : str
            Its name.

        Returns
        -------
        tuple of Moved
            Of every mode that the setup and at least one other show.
        """
        at = self._number(setup)
        others = self.used.copy()
        others[:, at] = False
        found: list[Moved] = []
        for mode in np.flatnonzero(self.used[:, at] & others.any(axis=1)).tolist():
            for quantity, ends in self._quantities:
                theirs = ends[mode, others[mode]]
                before = float(theirs[:, 0].max()), float(theirs[:, 1].min())
                if before[0] > before[1]:
                    before = float(theirs[:, 0].min()), float(theirs[:, 1].max())
                found.append(Moved(mode, quantity, before, _pair(ends[mode, at])))
        return tuple(found)

    @property
    def _quantities(self) -> tuple[tuple[Literal["frequency", "damping"], Real], ...]:
        return ("frequency", self.freq_hz_intervals), ("damping", self.damping_intervals)

    def table(self) -> dict[str, list[object]]:
        """Columns of the modes: what all setups leave, and by how many each is shown."""
        hz, damping = self.freq_hz_interval, self.damping_interval
        return {
            "mode": list(range(1, len(hz) + 1)),
            "frequency from [Hz]": hz[:, 0].tolist(),
            "frequency to [Hz]": hz[:, 1].tolist(),
            "damping from": damping[:, 0].tolist(),
            "damping to": damping[:, 1].tolist(),
            "probability": self.probability.tolist(),
            "setups": self.used.sum(axis=1).tolist(),
        }

    @property
    def verdict(self) -> str:
        """Sentence on agreement."""
        if not self.compared:
            return "No mode is shown by two setups: nothing is compared."
        if not self.disagreements:
            return (
                f"{self.compared} modes are shown by two setups or more, and in each of them all boxes have a part in common."
                " It is no proof that nothing moved: smaller changes than the boxes stay hidden."
            )
        modes = _listed(sorted({one.mode + 1 for one in self.disagreements}))
        of = f"mode{'s' * (',' in modes or 'and' in modes)} {modes}"
        if self.odd is not None:
            return f"{self.odd} contradicts the others in {of}; without it all setups agree."
        pairs = sorted({tuple(sorted(one.setups)) for one in self.disagreements})
        return f"Setups contradict each other in {of}: {'; '.join(' and '.join(pair) for pair in pairs)}."

    @property
    def assumed(self) -> tuple[str, ...]:
        """Sentences on what joint intervals and contradictions stand on."""
        said = [
            "one machine, linear and unchanged while it was measured; modes that lie nearest to each other are one mode: at most a"
            " fifth apart, and at most a third as far as the next mode"
        ]
        chance = self.false_alarm
        if np.any(self.used & (self.level > 1)):
            said.append(
                "no fit keeps to some of the bounds: of a machine that isn't linear, or noise that is larger than it was estimated;"
                " boxes with bounds times a factor are evidence, no proof"
            )
        elif np.isnan(chance):
            said.append("the bounds of the responses hold; nothing says with which probability")
        elif chance:
            said.append(
                f"the bounds of the responses: each interval holds its mode with probability {self.probability.min():.4g} or more,"
                f" and with one machine any contradiction is found with {chance:.2g} at most"
            )
        else:
            said.append("the bounds of the responses hold, as stated")
        if self.averaged.any():
            said.append(
                "errors of different setups are normal and independent of each other: intervals are then those of the mean of the"
                " estimates, within all boxes; records of one moment, or of one disturbance, are no different setups"
            )
        said.append("around each mode the response is its pair, its neighbours and a smooth remainder")
        return tuple(said)

    def summary(self) -> str:
        """The verdict, a line a mode, and the assumptions."""
        lines = [self.verdict]
        for mode, used in enumerate(self.used):
            lines.append(
                f"mode {mode + 1:<6}{self.mode_words(mode)} ({_listed([*np.array(self.names)[used]]) or 'not used'})"
            )
        return "\n".join([*lines, *(f"assumed    {one}" for one in self.assumed)])

    def mode_words(self, mode: int) -> str:
        """Words for the part of a mode that all setups leave, or for the two that contradict each other."""
        mine = [one for one in self.disagreements if one.mode == mode]
        if mine:
            return "; ".join(disagreement_words(one) for one in mine)
        ends = self.freq_hz_interval[mode], self.damping_interval[mode]
        if np.isnan(ends[0]).any():
            setup = int(np.flatnonzero(np.isfinite(self.omega_intervals[mode, :, 0]))[0])
            where = ends_words(_pair(self.freq_hz_intervals[mode, setup]))
            return f"{self.names[setup]} leaves {where} Hz open, too wide a box or no single mode"
        return f"{ends_words(_pair(ends[0]))} Hz, damping {ends_words(_pair(ends[1]))}"

    def __repr__(self) -> str:
        count = len({one.mode for one in self.disagreements})
        return f"<CommonModes: {len(self.used)} modes of {len(self.names)} setups, {count} contradicted>"


def disagreement_words(one: Disagreement) -> str:
    """The two disjoint intervals with the names of their setups."""
    unit = " Hz" if one.quantity == "frequency" else ""
    gap = one.intervals[1][0] - one.intervals[0][1]
    first, second = (
        f"{name} leaves {ends_words(ends, gap)}{unit}" for name, ends in zip(one.setups, one.intervals, strict=True)
    )
    more = f", with bounds times {one.level:.3g}" * (one.level > 1)
    return f"nothing in common in {one.quantity}: {first}, {second}{more}"


def _common(ends: Real, used: NDArray[np.bool_]) -> Real:
    """Largest of the lower ends and smallest of the upper ones, (M, 2); NaN where none is used."""
    low = np.where(used, ends[..., 0], -np.inf).max(axis=1, initial=-np.inf)
    high = np.where(used, ends[..., 1], np.inf).min(axis=1, initial=np.inf)
    return np.where(np.any(used, axis=1, keepdims=True), np.stack([low, high], axis=1), np.nan)


def _mean(estimates: Real, part: NDArray[np.bool_]) -> tuple[Real, Real]:
    """Mean of those of each mode, weighted by the squares of their half-widths, and its half-width, (M,) each; infinite of none."""
    place, half = np.where(part[:, :, None], estimates, [0.0, np.inf]).transpose(2, 0, 1)
    weights = half**-2.0
    whole = weights.sum(axis=1)
    with np.errstate(divide="ignore"):
        return (weights * place).sum(axis=1) / np.where(whole > 0, whole, 1.0), whole**-0.5


def _pair(ends: Real) -> Interval:
    return float(ends[0]), float(ends[1])


def ends_words(ends: Interval, gap: float = np.inf) -> str:
    """Both ends, rounded outwards to where they differ, and by less than the `gap` to another interval."""
    width = min(ends[1] - ends[0], gap)
    digits = int(np.clip(np.ceil(np.log10(abs(ends[1]) / width)) + 1, 3, 9)) if width > 0 else 4
    return f"{rounded_down(ends[0], digits):.{digits}g} to {rounded_up(ends[1], digits):.{digits}g}"


def _listed(things: Sequence[object]) -> str:
    *most, last = [str(one) for one in things] or [""]
    return f"{', '.join(most)} and {last}" if most else last


keep(CommonModes, "common modes", words="modes of several setups")

"""Two measurements beside each other: where they differ by more than their noise, and how probable that is by chance."""

from __future__ import annotations

import dataclasses
import functools
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from robustid.core import Complex, Frozen, Real, Savable, Tabular, as_kind, freeze, hz_span, hz_words
from robustid.data import FrequencyResponse, as_probability, chance_beyond, joint_radius, variances
from robustid.errors import InputError
from robustid.figures import Drawable

_KNOWN = 1e9  # degrees of freedom of a variance that is known
_ROUNDING = 1e-12  # part of the largest value of an entry: two computations of one number
_LEAST = 20  # frequency points, from which on all of them together are a test of their own


class Differing(NamedTuple):
    """Neighbouring frequency points at which an entry differs, and the one where it differs most."""

    output: int
    input: int
    low: float  # Hz
    high: float
    points: int
    worst: int  # frequency point
    times: float  # |difference| over what noise alone explains


class _Noise(NamedTuple):
    """Errors of a response as far as they are known: variance with degrees of freedom, and a bound that is no noise."""

    variance: Real
    dof: Real
    slack: Real


@dataclasses.dataclass(frozen=True, eq=False)
class Comparison(Frozen, Drawable, Tabular, Savable):
    """Two responses at their common frequencies, held against the noise of both.

    The difference ``d = second - first`` of one plant has the variance ``s^2 = s1^2 + s2^2``: ``|d|^2/s^2`` is exponential where
    both are known and F(2, 2 dof) where they were estimated (dof of the sum after Welch and Satterthwaite; Student's t where all
    is real). A bound without a probability is subtracted first: it explains whatever it allows.

    Attributes
    ----------
    first, second : FrequencyResponse
        At the frequencies that both have.
    probability : float
        One plant is told apart from itself with probability 1 - `probability` at most.
    """

    first: FrequencyResponse
    second: FrequencyResponse
    probability: float = 0.95

    def __post_init__(self) -> None:
        for name in ("first", "second"):
            as_kind(name, getattr(self, name), FrequencyResponse, "a FrequencyResponse")
            _noise(name, getattr(self, name))
        if self.first.values.shape != self.second.values.shape:
            raise InputError(
                f"`second` must have the shape of `first`, {self.first.values.shape}; got {self.second.values.shape}"
            )
        self._set(probability=as_probability(self.probability))
        if not self.compared.any():
            raise InputError("`second` has no value at a frequency and entry where `first` has one")

    @property
    def omega(self) -> Real:
        """Frequencies in rad/s, (F,)."""
        return self.first.omega

    @property
    def freq_hz(self) -> Real:
        """Frequencies in Hz, (F,)."""
        return self.first.freq_hz

    @functools.cached_property
    def compared(self) -> NDArray[np.bool_]:
        """True where both were measured, (F, ny, nu)."""
        return ~(self.first.missing | self.second.missing)

    @functools.cached_property
    def difference(self) -> Complex:
        """Second less first, (F, ny, nu); NaN where one of them was not measured."""
        return freeze(np.where(self.compared, self.second.values - self.first.values, np.nan))

    @functools.cached_property
    def _both(self) -> _Noise:
        """Variance of the difference, its degrees of freedom, and what bounds explain beside it."""
        first, second = _noise("first", self.first), _noise("second", self.second)
        variance = first.variance + second.variance
        with np.errstate(divide="ignore", invalid="ignore"):
            dof = variance**2 / (first.variance**2 / first.dof + second.variance**2 / second.dof)
        size = np.nanmax(np.abs([self.first.values, self.second.values]), axis=(0, 1), where=self.compared, initial=0)
        dof = np.where(np.isfinite(dof), np.minimum(dof, _KNOWN), _KNOWN)
        return _Noise(variance, dof, first.slack + second.slack + _ROUNDING * size)

    @functools.cached_property
    def chance(self) -> Real:
        """Probability at most of such a difference by chance at each place alone, (F, ny, nu); NaN where nothing is compared."""
        variance, dof, slack = self._both
        beyond, s = np.maximum(np.abs(self.difference) - slack, 0.0), np.sqrt(variance)
        ratio = np.divide(beyond, s, out=np.where(beyond > 0, np.inf, 0.0), where=s > 0)
        found = chance_beyond(np.where(self.compared, ratio, 0.0), dof, self.first.all_real)
        return freeze(np.where(self.compared, found, np.nan))

    @property
    def largest(self) -> float:
        """Probability at most of the largest difference by chance, whatever the dependence of the places (Bonferroni)."""
        return float(min(1.0, np.sum(self.compared) * np.nanmin(self.chance)))

    @functools.cached_property
    def together(self) -> float | None:
        """Probability of differences that are so large in all by chance; None of fewer than 20 frequency points.

        The sum of -log(chance) over all places, of known variances the sum of ``|d|^2/s^2``: a gamma variable of independent places
        (Fisher). Neighbouring frequency points may depend on each other: the mean over blocks of them, as many as the root of their
        number, has Student's t. The larger of both probabilities counts.
        """
        from scipy.special import gammaincc, stdtr

        lines = self.compared.any(axis=(1, 2))
        count = int(lines.sum())
        if count < _LEAST:
            return None
        with np.errstate(divide="ignore"):
            size = -np.log(np.where(self.compared, self.chance, 1.0)[lines])
        if np.isinf(size).any():
            return 0.0
        places = int(self.compared.sum())
        independent = float(gammaincc(places, size.sum()))
        of_lines = size.sum(axis=(1, 2)) / self.compared[lines].sum(axis=(1, 2))
        means = np.array([block.mean() for block in np.array_split(of_lines, int(np.sqrt(count)))])
        scatter = means.std(ddof=1) / np.sqrt(means.size)
        excess = means.mean() - 1
        if not scatter:
            return independent
        return max(independent, float(stdtr(means.size - 1, -excess / scatter)))

    @property
    def by_chance(self) -> float:
        """Probability at most with which noise alone makes two measurements of one plant differ so, from both tests."""
        if self.together is None:
            return self.largest
        return min(1.0, 2 * min(self.largest, self.together))

    @property
    def differ(self) -> bool:
        """True where the difference is more than noise: `by_chance` is at most 1 - `probability`."""
        return self.by_chance <= 1 - self.probability

    @functools.cached_property
    def limit(self) -> Real:
        """Size of a difference that noise alone reaches nowhere, with the `probability` for all places together, (F, ny, nu)."""
        variance, dof, slack = self._both
        level = 1 - (1 - self.probability) / (1 if self.together is None else 2)
        radius = joint_radius(level, int(self.compared.sum()), dof, self.first.all_real)
        return freeze(np.where(self.compared, radius * np.sqrt(variance) + slack, np.nan))

    @functools.cached_property
    def beyond(self) -> NDArray[np.bool_]:
        """True where the difference is larger than `limit`, (F, ny, nu)."""
        return self.compared & (np.abs(self.difference) > self.limit)

    def table(self) -> dict[str, list[Any]]:
        """Differences with the limit of noise, a row for every frequency and entry that both have."""
        places = list(zip(*np.nonzero(self.compared), strict=True))
        return {
            "frequency [Hz]": [self.freq_hz[k] for k, *_ in places],
            "output": [str(self.first.outputs[i]) for _, i, _ in places],
            "input": [str(self.first.inputs[j]) for *_, j in places],
            "difference": np.abs(self.difference)[self.compared].tolist(),
            "limit": self.limit[self.compared].tolist(),
            "chance": self.chance[self.compared].tolist(),
        }

    @property
    def where(self) -> tuple[Differing, ...]:
        """Neighbouring frequency points beyond the limit, by entry; those farthest beyond it first."""
        found: list[Differing] = []
        for i, j in np.ndindex(self.beyond.shape[1:]):
            points = np.flatnonzero(self.beyond[:, i, j])
            for part in np.split(points, np.flatnonzero(np.diff(points) > 1) + 1) if points.size else ():
                times = np.abs(self.difference[part, i, j]) / self.limit[part, i, j]
                at, low, high = int(np.argmax(times)), float(self.freq_hz[part[0]]), float(self.freq_hz[part[-1]])
                found.append(Differing(i, j, low, high, part.size, int(part[at]), float(times[at])))
        return tuple(sorted(found, key=lambda one: -one.times))

    @property
    def most(self) -> tuple[int, int, int]:
        """Frequency point, output and input of the smallest `chance`."""
        k, i, j = np.unravel_index(np.nanargmin(self.chance), self.chance.shape)
        return int(k), int(i), int(j)

    @property
    def hz(self) -> float:
        """Frequency in Hz of the smallest `chance`."""
        return float(self.freq_hz[self.most[0]])

    def entry(self, output: int, input: int) -> str:
        """Name of an entry, "displacement [mm] / force [N]"."""
        return f"{self.first.outputs[output]} / {self.first.inputs[input]}"

    @property
    def verdict(self) -> str:
        """Sentence on what noise explains."""
        points = f"{self.omega.size} frequency points"
        if not self.differ:
            return (
                f"Noise explains every difference at the {points}: two measurements of one plant differ so with probability"
                f" {self.by_chance:.2g}. It is no proof that both are the same: smaller differences than the noise stay hidden."
            )
        _, i, j = self.most
        which = "" if self.chance.shape[1:] == (1, 1) else f" in {self.entry(i, j)}"
        return (
            f"More than noise: two measurements of one plant differ so with probability {self.by_chance:.2g} at most. Among"
            f" {points} the difference stands out most at {hz_words(self.hz)}{which}."
        )

    @property
    def assumed(self) -> tuple[str, ...]:
        """Sentences on what the probabilities stand on."""
        sides = {"first": self.first, "second": self.second}
        said = [f"{name}: {_source(frf)}" for name, frf in sides.items()]
        said.append(
            "errors of the two are independent of each other and normal; of neighbouring points they may depend"
        )
        single = [name for name, frf in sides.items() if frf.bound is not None and frf.bound.of_one_excitation]
        if single:
            said.append(
                f"{' and '.join(single)}: from one excitation; a plant that isn't linear differs from excitation to excitation by"
                " more than this noise knows"
            )
        return tuple(said)

    def summary(self) -> str:
        """A few lines of text for people."""
        k, i, j = self.most
        size, at = np.abs(self.difference[k, i, j]), np.abs(self.first.values[k, i, j])
        share = f", {100 * size / at:.3g} % of the first" if at else ""
        lines = [
            f"{'differ' if self.differ else 'alike':<11}{self.verdict}",
            f"largest    at {hz_words(self.hz)} ({self.entry(i, j)}): |difference| {size:.4g}{share},"
            f" {size / self.limit[k, i, j]:.3g} of the limit of noise; by chance {self.largest:.2g}",
        ]
        if self.together is not None:
            lines.append(f"together   all differences at once: by chance {self.together:.2g}")
        for one in self.where[:5]:
            span = hz_words(one.low) if one.points == 1 else hz_span(one.low, one.high)
            lines.append(f"beyond     {span} ({self.entry(one.output, one.input)}): {one.times:.3g} times the limit")
        lines += [f"beyond     and {len(self.where) - 5} more places"] if len(self.where) > 5 else []
        faults = [f"{name}: {fault}" for name in ("first", "second") for fault in getattr(self, name).faults]
        return "\n".join(
            [*lines, *(f"fault      {one}" for one in faults), *(f"assumed    {one}" for one in self.assumed)]
        )

    def __repr__(self) -> str:
        said = "differ" if self.differ else "alike"
        return f"<Comparison: {self.omega.size} frequency points, {said}, by chance {self.by_chance:.2g}>"


def _noise(name: str, frf: FrequencyResponse) -> _Noise:
    """Return the noise of a response: of its covariance, else of a bound with its probability, else what a bound allows."""
    bound, shape = frf.bound, frf.values.shape
    none, known = np.zeros(shape), np.full(shape, _KNOWN)
    if frf.covariance is not None:
        dof = known if frf.dof is None else np.full(shape, min(frf.dof, _KNOWN))
        return _Noise(np.where(frf.missing, 0.0, np.maximum(variances(frf.covariance, shape), 0.0)), dof, none)
    if bound is None:
        raise InputError(
            f"`{name}` has neither a covariance nor a bound, so that nothing says what its noise explains; take"
            " rid.estimate_bound(frf), or give the bound that you know"
        )
    radius = np.where(frf.missing, 0.0, bound.outer_radius)
    if bound.probability is None:
        return _Noise(none, known, radius)
    dof = known if bound.dof is None else np.full(shape, bound.dof)
    deviations = joint_radius(bound.probability, int(np.sum(bound.used)), dof, frf.all_real)
    return _Noise((radius / deviations) ** 2, dof, none)


def _source(frf: FrequencyResponse) -> str:
    """Words for what is known of the errors."""
    if frf.covariance is not None:
        return "noise from its covariance" + (
            "" if frf.dof is None else f", estimated with {frf.dof:.3g} degrees of freedom"
        )
    if frf.bound.probability is not None:
        return f"noise from its {frf.bound.words()}, errors as large as it says for all its points"
    return f"its {frf.bound.words()} holds, and explains whatever it allows"

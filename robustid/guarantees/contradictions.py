"""contradiction(): samples that no system of the class explains, found by sums before any semidefinite program."""

from __future__ import annotations

import dataclasses
import functools

import numpy as np
from numpy.typing import NDArray

from robustid.core import (
    Arrays,
    Budget,
    Complex,
    Frozen,
    Interruptible,
    Progress,
    Record,
    Savable,
    as_flag,
    as_kind,
    freeze,
    hz_words,
    one_thread,
)
from robustid.errors import InputError
from robustid.guarantees.consistent_set import independent_entries, which
from robustid.guarantees.linear.amplitudes import Extraction, extract
from robustid.guarantees.linear.certificate import choose, discs
from robustid.guarantees.linear.entry_band import extraction_fits, multipliers_fit
from robustid.guarantees.linear.functions import Box, BoxLike, ends_of, functions_of
from robustid.guarantees.linear.predictions import lines_of, nothing, predicted_lines, predicted_rows
from robustid.guarantees.linear.samples import Samples, samples_of, seen_in
from robustid.guarantees.linear.search import POINTS, nearest_points, reweighted
from robustid.identification import MixedProblem

_MOST = 4 * POINTS  # points of a combination of all samples together
_STEPS = 30
_TRIED = 3  # predictions from which such combinations start
_LINES = 0.5  # of the time that is left, where it is limited: the records come after
_HOPE = 0.5  # ratio of the worst prediction below which they are not tried: they are seldom twice as large
_INSIDE = 1.0, 0.9  # times the zeta of these: from farther inside more of the circle counts
_BELOW = 1 - 1e-9  # the factor on the bounds: what is proved, just below where the combination is as large as allowed


@dataclasses.dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Contradiction(Frozen, Savable):
    """Proof that no system of the class keeps all samples within their bounds: one of them, and what the others leave there.

    With ``|F - centre| <= radius`` for the value of every system that keeps the other samples, ``|centre - measured| > radius +
    bound``: an assumption is wrong, the class or a bound; the data cannot say which. The proof is multipliers d of the samples, -1
    for that one: a sum of functionals, d_k f_k, is bounded for all systems by its norm and what it sees of the functions; the sum
    of the samples is no farther from it than sum |d_k| bound_k.

    Attributes
    ----------
    problem : MixedProblem
    box : pair of (M, 2) arrays, or None
        Pole-uncertainty box that is covered; None: poles exactly as stated.
    extraction : Extraction
        Of the samples of an entry, with multipliers that bound the amplitudes of the parametric part.
    base : complex
        zeta from which the harmonic measure is seen.
    points : (n,) array of int
        Numbers of the lines that are combined: those from the number of lines on are conjugates.
    multipliers : (n + T,) complex array
        Of these lines and of all samples of records: -1 for the sample in question.
    sample : int
        Its number among them.
    """

    problem: MixedProblem
    box: Box | None
    extraction: Extraction
    base: complex
    points: NDArray[np.intp]
    multipliers: Complex
    sample: int

    def __post_init__(self) -> None:
        self._set(**{name: freeze(np.asarray(getattr(self, name))) for name in ("points", "multipliers")})
        if self.box is not None:
            self._set(box=tuple(freeze(ends) for ends in self.box))

    @property
    def samples(self) -> Samples:
        """All samples of the entry."""
        return self.extraction.samples

    @functools.cached_property
    def _own(self) -> tuple[complex, float]:
        """The sample that is predicted, and its bound with what the series leave out."""
        chosen = choose(self.samples, nothing(self.samples, np.array([self.base])), self.points[None])
        bound = chosen.bound + chosen.left_out @ self.extraction.known.largest
        return complex(chosen.y[0, self.sample]), float(bound[0, self.sample])

    @functools.cached_property
    def _disc(self) -> tuple[complex, float]:
        """Centre and radius of the disc that holds zero, if any system keeps all bounds."""
        targets, d = nothing(self.samples, np.array([self.base])), self.multipliers[None]
        parts = self.samples, choose(self.samples, targets, self.points[None]), targets, d, self.extraction.known
        centre, radius = discs(*parts)
        return complex(centre[0]), float(radius[0])

    @property
    def excess(self) -> float:
        """Distance |centre - measured| over radius + bound: above 1."""
        centre, radius = self._disc
        return float(np.abs(centre) / radius)

    def _at_bounds(self, factor: float) -> Contradiction:
        """The same multipliers with every bound times a factor."""
        samples = self.samples
        records = tuple(dataclasses.replace(one, bound=factor * one.bound) for one in samples.records)
        wider = dataclasses.replace(samples, bound=factor * samples.bound, records=records)
        return dataclasses.replace(self, extraction=dataclasses.replace(self.extraction, samples=wider))

    @functools.cached_property
    def factor(self) -> float:
        """Factor on all bounds up to which this proof holds: a lower bound of the margin of `identify`."""
        # Radii are affine in it, as those of the amplitudes are.
        size, radius = abs(self._disc[0]), self._disc[1]
        slope = self._at_bounds(2.0)._disc[1] - radius
        if not slope > 0:
            return np.inf  # all bounds are zero
        found = max(_BELOW * (1 + (size - radius) / slope), 1.0)
        return found if self._at_bounds(found).excess > 1 else 1.0

    @property
    def _place(self) -> tuple[int, int] | None:
        """Numbers of the record and of its sample; None of a line."""
        row = self.sample - self.points.size
        if row < 0:
            return None
        ends = np.cumsum([one.y.size for one in self.samples.records])
        number = int(np.searchsorted(ends, row, side="right"))
        return number, row - int(ends[number] - self.samples.records[number].y.size)

    @property
    def entry(self) -> tuple[int, int | None]:
        """Output and input of the sample; the input is None where it sees several."""
        samples, place = self.samples, self._place
        if place is not None:
            one = samples.records[place[0]].output
            return one, None if self.problem.entries.inputs > 1 else 0
        seen = np.flatnonzero(samples.v[self.points[self.sample]])
        output, own = samples.components[int(seen[0])]
        return output, own if seen.size == 1 else None

    @property
    def omega(self) -> float | None:
        """Frequency of the sample, rad/s; None of a sample of a record."""
        if self._place is not None:
            return None
        angle = self.samples.angles[self.points[self.sample]]
        return float(self.problem.plane.omega(np.abs(np.atleast_1d(angle)))[0])

    @property
    def time(self) -> float | None:
        """Time of the sample, s; None of a line."""
        place = self._place
        return None if place is None else float(self.samples.records[place[0]].time[place[1]])

    @property
    def measured(self) -> complex:
        """The sample; of a record in steady state its spectral line."""
        return self._true(self._own[0])

    @property
    def bound(self) -> float:
        """Bound of the sample, with what a series over the box leaves out."""
        return self._own[1]

    @property
    def centre(self) -> complex:
        """Centre of the disc that the other samples leave to it."""
        return self._true(self._disc[0] + self._own[0])

    @property
    def radius(self) -> float:
        """Radius of that disc."""
        return self._disc[1] - self.bound

    def _true(self, value: complex) -> complex:
        """A value at a line, and not its conjugate."""
        mirrored = self._place is None and self.points[self.sample] >= self.samples.angles.size // 2
        return value.conjugate() if mirrored else value

    def verify(self, exact: bool = False) -> bool:
        """Evaluate the proof again from multipliers and data alone.

        `exact` in ball arithmetic, by code of its own (`robustid[exact]`).
        """
        from robustid.guarantees.linear.verification import contradicts_exactly

        exact = as_flag("exact", exact)
        with one_thread():
            again = dataclasses.replace(self, extraction=dataclasses.replace(self.extraction))
            proof = again.extraction, again.base, again.points, again.multipliers
            return again.excess > 1 and (not exact or contradicts_exactly(*proof))

    def __repr__(self) -> str:
        return f"<Contradiction: {self._where}, excess {self.excess:.4g}, bounds at least {self.factor:.4g} times as large>"

    @property
    def _where(self) -> str:
        place = f"{self.time:.5g} s" if self.omega is None else hz_words(self.omega / (2 * np.pi))
        return place + which(self.problem, self.entry)

    def summary(self) -> str:
        """The result in two sentences."""
        centre, measured = self.centre, self.measured
        if centre.imag == measured.imag == 0 or self.omega is None:
            centre, measured = centre.real, measured.real
        poles = "" if self.box is None else ", wherever in their box the poles are"
        return (
            f"No system of the class explains the data{poles}: the other samples leave {centre:.4g} ± {self.radius:.2g} at"
            f" {self._where}, where {measured:.4g} ± {self.bound:.2g} was measured. All bounds would have to be at least"
            f" {self.factor:.4g} times as large."
        )


def contradiction(
    problem: MixedProblem,
    *,
    box: BoxLike | None = None,
    time_limit: float | None = None,
    progress: Progress | None = None,
) -> Contradiction | None:
    r"""Search a proof that no system of the class explains the data, from linear certificates: in seconds at most.

    For any numbers d_k, -1 for one sample and others for the rest, every system that keeps the bounds has

    .. math::
        |\sum_k d_k y_k - \sum_i q_i \sum_k d_k P_i(z_k)| \le \sum_k |d_k| \varepsilon_k + K \|\sum_k d_k \delta_{z_k}\|
        + \sum_i \Delta_i |\sum_k d_k P_i(z_k)|,

    with coefficients that are proved to be within Delta_i of q_i, and the norm of functionals in H2 of a harmonic measure. Where
    the left side is larger there is no such system.

    Parameters
    ----------
    problem : MixedProblem
    box : KautzSuggestion or pair of (M, 2) arrays, optional
        Pole-uncertainty box, as in `band`: then no poles in it explain the data. Default: poles exactly as stated.
    time_limit : float, optional
        Seconds; then, and on Ctrl-C, what the entries so far have shown is returned.
    progress : callable (text, done, count), optional
        Entries.

    Returns
    -------
    Contradiction or None
        The one with the largest excess. None says nothing: `identify` decides whether the data are consistent.

    Raises
    ------
    InputError, InputTypeError
        A passive class without a gain bound, a box that does not hold the poles, another object.

    Notes
    -----
    Every line and some samples of records are predicted by the others; from the worst ones all samples are combined. Entries
    whose modes have an amplitude that the data do not bound refute nothing. Source:
    `micchelli1977`; model validation, `inanc2001` section II.

    Examples
    --------
    The response is smooth, and one line is not:

    >>> import numpy as np, robustid as rid
    >>> omega = np.linspace(1.0, 30.0, 20)
    >>> values = 1 / (2 - np.exp(-0.1j * omega))
    >>> prior = rid.Prior(gain_bound=2.0, decay_rate=1.5)
    >>> good = rid.MixedProblem(frequency=rid.FrequencyResponse(omega, values, bound=0.01, dt=0.1), prior=prior)
    >>> rid.guarantee.contradiction(good) is None
    True
    >>> values[7] += 0.2
    >>> bad = rid.MixedProblem(frequency=rid.FrequencyResponse(omega, values, bound=0.01, dt=0.1), prior=prior)
    >>> found = rid.guarantee.contradiction(bad)
    >>> bool(11.6 < found.omega < 11.7), found.excess > 1, found.factor <= rid.identify(bad).margin, found.verify()
    (True, True, True, True)
    """
    as_kind("problem", problem, MixedProblem, "a MixedProblem")
    budget = Budget(time_limit, progress, "looking for samples that no system explains")
    if problem.prior.positive_real:
        raise InputError(
            f"`problem` is of a {problem.prior.passive} class, which has no gain bound: identify decides whether it is consistent"
        )
    functions, seen = functions_of(problem, box), seen_in(problem)
    known: dict[tuple[tuple[int, int], ...], Extraction] = {}  # of entries that samples tie together it is the same
    found: list[Contradiction] = []
    stated = None if box is None else ends_of(box)
    entries = list(independent_entries(problem.entries))
    with one_thread(), Interruptible(lambda: bool(found)):
        for done, entry in enumerate(entries):
            if budget.over:
                break
            budget.tell(done, len(entries))
            samples, mine = samples_of(problem, functions, entry, seen), budget.share(1 / (len(entries) - done))
            if samples.components not in known:
                known[samples.components] = extract(samples, mine)
            one = _largest(problem, stated, dataclasses.replace(known[samples.components], samples=samples), mine)
            found += [one] if one is not None and one.excess > 1 else []
        else:
            budget.tell(len(entries), len(entries))
    return max(found, key=lambda one: one.excess, default=None)


def _largest(problem: MixedProblem, box: Box | None, extraction: Extraction, budget: Budget) -> Contradiction | None:
    """The combination that is largest against what systems and bounds allow; None where nothing is known of the amplitudes.

    At first every line, and some samples of the records, as the others predict it; then, unless all of them agree well, all samples
    together, from the worst ones on.
    """
    samples = extraction.samples
    if not np.all(np.isfinite(extraction.known.radius)) or samples.angles.size + samples.rows < 2:
        return None
    lines = predicted_lines(extraction, lines_of(samples), budget=budget.share(_LINES))
    each = [*lines, *predicted_rows(extraction, budget)]
    worst = [(float(part.ratio[k]), part.proof(k)) for part in each for k in np.argsort(-part.ratio)[:_TRIED].tolist()]
    worst = sorted(worst, key=lambda one: -one[0])[:_TRIED]
    found = [Contradiction(problem=problem, box=box, extraction=extraction, **proof) for _, proof in worst]
    if worst and worst[0][0] > _HOPE and not budget.over:
        starts = [dataclasses.replace(one, base=part * one.base) for one in found for part in _INSIDE]
        found += [_together(one, budget) for one in starts if not budget.over]
    return max(found, key=lambda one: one.excess, default=None)


def _together(start: Contradiction, budget: Budget) -> Contradiction:
    """Search the combination of all samples that is 1 and of the smallest radius, from a prediction on."""
    extraction, samples = start.extraction, start.samples
    count, base = start.points.size, np.array([start.base])
    far = nearest_points(samples, base, _MOST)[0]
    points = np.concatenate([start.points, far[~np.isin(far, start.points)]])
    added = np.zeros(points.size - count, complex)
    d = np.concatenate([start.multipliers[:count], added, start.multipliers[count:]])
    targets = nothing(samples, base)
    chosen = choose(samples, targets, points[None])
    middle, _ = extraction.known.coefficients(samples)
    seen = chosen.y - chosen.values @ middle
    size = complex(seen[0] @ d)
    if size == 0:
        return start
    d = reweighted(
        samples, chosen, targets, extraction.known, steps=_STEPS, start=d[None] / size, one=seen, budget=budget
    )[0]
    sample = int(np.argmax(np.abs(d) * chosen.bound[0]))
    if d[sample] == 0:
        return start
    d = -d / d[sample]
    d[sample] = -1
    return dataclasses.replace(start, points=points, multipliers=d, sample=sample)


def contradiction_of_multipliers(
    problem: MixedProblem, box: Box | None, entry: tuple[int, int], proof: Record, amplitudes: Arrays
) -> Contradiction:
    """Make the contradiction of known multipliers: the its fields from `base` on, and those of an `Extraction` but for the samples.

    ValueError for arrays that do not belong to the problem, or contradict nothing.
    """
    if entry not in independent_entries(problem.entries):
        raise ValueError("its entry is not one of the problem")
    samples = samples_of(problem, functions_of(problem, box), entry)
    extraction = Extraction(samples, **amplitudes)
    points, d, sample = proof["points"], proof["multipliers"], proof["sample"]
    fits = multipliers_fit(samples, points[None], d[None], 1) and 0 <= sample < d.size and abs(proof["base"]) < 1
    if not (fits and extraction_fits(extraction)):
        raise ValueError("its multipliers do not belong to the samples of the problem")
    found = Contradiction(problem=problem, box=box, extraction=extraction, **proof)
    if not found.verify():
        raise ValueError("its multipliers contradict nothing")
    return found

"""contradiction(): samples that no system of the class explains, found by sums before any semidefinite program."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from robustid.core import Arrays, Complex, Frozen, Record, Savable, as_flag, as_kind, freeze, one_thread
from robustid.errors import InputError
from robustid.guarantees.consistent_set import independent_entries, which
from robustid.guarantees.linear.amplitudes import Extraction, extract
from robustid.guarantees.linear.clash import Clash, clash_of
from robustid.guarantees.linear.entry_band import extraction_fits, multipliers_fit
from robustid.guarantees.linear.functions import Box, BoxLike, ends_of, functions_of
from robustid.guarantees.linear.samples import samples_of, seen_in
from robustid.identification import MixedProblem


@dataclasses.dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Contradiction(Frozen, Savable):
    """Proof that no system of the class keeps all samples within their bounds: one of them, and what the others leave there.

    With ``|F - centre| <= radius`` for the value of every system that keeps the other samples, ``|centre - measured| > radius +
    bound``: an assumption is wrong, the class or a bound; the data cannot say which.

    Attributes
    ----------
    problem : MixedProblem
    box : pair of (M, 2) arrays, or None
        Pole-uncertainty box that is covered; None: poles exactly as stated.
    clash : Clash
        The multipliers of the samples, and those that bound the amplitudes of the parametric part.
    """

    problem: MixedProblem
    box: Box | None
    clash: Clash

    def __post_init__(self) -> None:
        if self.box is not None:
            self._set(box=tuple(freeze(ends) for ends in self.box))

    @property
    def _place(self) -> tuple[int, int] | None:
        """Numbers of the record and of its sample; None of a line."""
        row = self.clash.sample - self.clash.points.size
        if row < 0:
            return None
        ends = np.cumsum([one.y.size for one in self.clash.samples.records])
        number = int(np.searchsorted(ends, row, side="right"))
        return number, row - int(ends[number] - self.clash.samples.records[number].y.size)

    @property
    def entry(self) -> tuple[int, int | None]:
        """Output and input of the sample; the input is None where it sees several."""
        samples, place = self.clash.samples, self._place
        if place is not None:
            one = samples.records[place[0]].output
            return one, None if self.problem.entries.inputs > 1 else 0
        seen = np.flatnonzero(samples.v[self.clash.points[self.clash.sample]])
        output, own = samples.components[int(seen[0])]
        return output, own if seen.size == 1 else None

    @property
    def omega(self) -> float | None:
        """Frequency of the sample, rad/s; None of a sample of a record."""
        if self._place is not None:
            return None
        angle = self.clash.samples.angles[self.clash.points[self.clash.sample]]
        return float(self.problem.plane.omega(np.abs(np.atleast_1d(angle)))[0])

    @property
    def time(self) -> float | None:
        """Time of the sample, s; None of a line."""
        place = self._place
        return None if place is None else float(self.clash.samples.records[place[0]].time[place[1]])

    @property
    def measured(self) -> complex:
        """The sample; of a record in steady state its spectral line."""
        return complex(self._true(self.clash.own[0]))

    @property
    def bound(self) -> float:
        """Bound of the sample, with what a series over the box leaves out."""
        return float(self.clash.own[1])

    @property
    def centre(self) -> complex:
        """Centre of the disc that the other samples leave to it."""
        return complex(self._true(self.clash.disc[0] + self.clash.own[0]))

    @property
    def radius(self) -> float:
        """Radius of that disc."""
        return float(self.clash.disc[1]) - self.bound

    def _true(self, value: Complex) -> Complex:
        """A value at a line, and not its conjugate."""
        sample, points = self.clash.sample, self.clash.points
        mirrored = sample < points.size and points[sample] >= self.clash.samples.angles.size // 2
        return np.conj(value) if mirrored else value

    @property
    def points(self) -> NDArray[np.intp]:
        """Numbers of the lines that are combined, (n,): those from the number of lines on are conjugates."""
        return self.clash.points

    @property
    def multipliers(self) -> Complex:
        """Multipliers d of these lines and of all samples of records, (n + T,): -1 for the sample in question."""
        return self.clash.multipliers

    @property
    def excess(self) -> float:
        """Distance |centre - measured| over radius + bound: above 1."""
        return self.clash.excess

    @property
    def factor(self) -> float:
        """Factor on all bounds up to which this proof holds: a lower bound of the margin of `identify`."""
        return self.clash.factor

    def verify(self, exact: bool = False) -> bool:
        """Evaluate the proof again from multipliers and data alone.

        `exact` in ball arithmetic, by code of its own (`robustid[exact]`).
        """
        from robustid.guarantees.linear.verification import clashes_exactly

        exact = as_flag("exact", exact)
        with one_thread():
            again = dataclasses.replace(self.clash, extraction=dataclasses.replace(self.clash.extraction))
            return again.excess > 1 and (not exact or clashes_exactly(again))

    def __repr__(self) -> str:
        return f"<Contradiction: {self._where}, excess {self.excess:.4g}, bounds at least {self.factor:.4g} times as large>"

    @property
    def _where(self) -> str:
        place = f"{self.time:.5g} s" if self.omega is None else f"{self.omega / (2 * np.pi):.5g} Hz"
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


def contradiction(problem: MixedProblem, *, box: BoxLike | None = None) -> Contradiction | None:
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
    >>> rid.contradiction(good) is None
    True
    >>> values[7] += 0.2
    >>> bad = rid.MixedProblem(frequency=rid.FrequencyResponse(omega, values, bound=0.01, dt=0.1), prior=prior)
    >>> found = rid.contradiction(bad)
    >>> bool(11.6 < found.omega < 11.7), found.excess > 1, found.factor <= rid.identify(bad).margin, found.verify()
    (True, True, True, True)
    """
    as_kind("problem", problem, MixedProblem, "a MixedProblem")
    if problem.prior.positive_real:
        raise InputError(
            f"`problem` is of a {problem.prior.passive} class, which has no gain bound: identify decides whether it is consistent"
        )
    functions, seen = functions_of(problem, box), seen_in(problem)
    known: dict[tuple[tuple[int, int], ...], Extraction] = {}  # of entries that samples tie together it is the same
    found: list[Clash] = []
    with one_thread():
        for entry in independent_entries(problem.entries):
            samples = samples_of(problem, functions, entry, seen)
            if samples.components not in known:
                known[samples.components] = extract(samples)
            clash = clash_of(dataclasses.replace(known[samples.components], samples=samples))
            found += [clash] if clash is not None and clash.excess > 1 else []
    if not found:
        return None
    worst = max(found, key=lambda one: one.excess)
    return Contradiction(problem=problem, box=None if box is None else ends_of(box), clash=worst)


def contradiction_of_multipliers(
    problem: MixedProblem, box: Box | None, entry: tuple[int, int], proof: Record, amplitudes: Arrays
) -> Contradiction:
    """Make the contradiction of known multipliers: the fields of a `Clash` and of an `Extraction`, but for the samples.

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
    found = Contradiction(problem=problem, box=box, clash=Clash(extraction, **proof))
    if not found.verify():
        raise ValueError("its multipliers contradict nothing")
    return found

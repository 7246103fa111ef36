"""Band: discs around every consistent system at every frequency, and what follows from them."""

from __future__ import annotations

import dataclasses
import functools
from typing import TYPE_CHECKING, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from robustid.core import Budget, Progress, Real, Savable, as_array, as_flag, as_kind, freeze, hz_words, one_thread
from robustid.errors import InputError
from robustid.figures import Drawable
from robustid.guarantees.candidates import candidates_of
from robustid.guarantees.circle import CircleBound
from robustid.guarantees.linear.entry_band import EntryBands
from robustid.guarantees.linear.proved_discs import ProvedDiscs
from robustid.guarantees.linear.solved_nodes import JoinedBands
from robustid.guarantees.nominal import as_frequencies, as_nominal, check_nominal
from robustid.guarantees.over_cells import AroundModel
from robustid.guarantees.over_poles import Bounded
from robustid.guarantees.placement import refined
from robustid.guarantees.refinement import (
    BY_CELLS,
    BY_PROGRAMS,
    SAME,
    Directed,
    check_polygons,
    check_same,
    directed_bands,
    joined_bands,
    narrowed,
    narrowed_norm,
    narrowing_words,
    polygons_hold,
    smaller_discs,
)
from robustid.guarantees.relative_error import RelativeErrors, relative_errors
from robustid.guarantees.scope import pole_words
from robustid.guarantees.sweep import Folder, Means, Processes
from robustid.guarantees.value_set import norm_of_bounds
from robustid.guarantees.whole_axis import largest_error, largest_words, whole_axis
from robustid.identification import Identification, identify

if TYPE_CHECKING:
    import control

_AS_GOOD = 1.01  # times the bound of sums that use a polygon: its own
_DIRECTED = 0.3  # of the time of a refinement: for sums of one direction each, over the samples alone


@dataclasses.dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Band(AroundModel, ProvedDiscs, Drawable, Savable):
    """Discs that hold the response of every consistent system, proved at every frequency by sums.

    At each frequency ``|F - centre| <= radius`` for every F of the class that keeps the samples within their bounds: the centre is
    a combination of the samples, the radius what this combination leaves. Between frequencies combinations are mixed, which gives
    combinations again. Assumed: gain bound, decay, the number of modes, their poles (exact where `box` is None, anywhere in it
    else), bounds of the samples.

    Attributes
    ----------
    problem : MixedProblem
    omega : (F,) array, rad/s
        Frequencies that were asked for; `at` takes any other.
    bands : tuple of EntryBand
        Of every entry, row by row; of symmetric matrices the upper triangle.
    box : pair of (M, 2) arrays, or None
        Pole-uncertainty box that is covered: ends of the natural frequencies in rad/s, and of the damping ratios.
    model : control.StateSpace or None
        The nominal that errors are measured from; None: the centres.
    polygons : WorstCaseError, WorstCaseOverPoles or None
        Bounds at some frequencies, of `refine`: where they are smaller, they are those of the band.
    directed : tuple of EntryBand or DirectedBand
        As `bands`, by sums of one direction each, and with the polygons among the samples; empty before `refine`. Of both the
        smaller bound holds.
    """

    omega: Real
    model: control.StateSpace | None = None
    polygons: Bounded | None = None
    directed: Directed = ()

    def __post_init__(self) -> None:
        super().__post_init__()
        self._set(omega=freeze(self.omega))
        if self.polygons is not None:
            check_polygons(self.polygons, self.problem, self.box)

    @functools.cached_property
    def _entries(self) -> EntryBands:
        return JoinedBands(self.problem, self.directed, self._plain) if self.directed else self._plain

    @functools.cached_property
    def _plain(self) -> EntryBands:
        """The discs of the samples alone."""
        return EntryBands(self.problem, self.bands)

    def at(self, omega: ArrayLike) -> tuple[NDArray[np.complex128], Real]:
        """Centres and radii of the discs at any frequencies, (F, ny, nu) each; at exactly those of polygons discs around these.

        See `ProvedDiscs.at`.
        """
        centre, radius = super().at(omega)
        return smaller_discs(centre, radius, self.polygons, np.atleast_1d(as_array("omega", omega)))

    @functools.cached_property
    def _here(self) -> tuple[NDArray[np.complex128], Real]:
        return self.at(self.omega)

    @property
    def centre(self) -> NDArray[np.complex128]:
        """Centres of the discs at `omega`, (F, ny, nu): estimates with the smallest worst case that linear methods reach."""
        return freeze(self._here[0])

    @property
    def radius(self) -> Real:
        """Radii of the discs at `omega`, (F, ny, nu)."""
        return freeze(self._here[1])

    @functools.cached_property
    def upper(self) -> Real:
        """Proved bound of |F - model| over all consistent F at `omega`, (F, ny, nu); of |F - centre| without a model."""
        return freeze(self.error_at(self.omega))

    @property
    def sigma_upper(self) -> Real:
        """Proved bound of the largest singular value of F - model, (F,): the norm of the matrix `upper`, or that of polygons."""
        return freeze(narrowed_norm(norm_of_bounds(self.upper), self.polygons, self.omega, self.model))

    @property
    def order(self) -> int:
        """Order of the model; 0 without one."""
        return 0 if self.model is None else self.model.nstates

    @property
    def nominal(self) -> NDArray[np.complex128]:
        """Response of the model at `omega`, (F, ny, nu); the centres without one."""
        return self.centre if self.model is None else self.problem.plane.values_at(self.model, self.omega)

    @property
    def relative(self) -> RelativeErrors:
        """Bounds at the frequencies of the data as shares of the response of the model (or of the centre), with their median."""
        return relative_errors(self.problem, self.omega, self.sigma_upper, self.nominal, self.bounded)

    def error_at(self, omega: ArrayLike, model: control.StateSpace | None = None) -> Real:
        """Proved bound of |F - model| at any frequencies, (F, ny, nu): distance from the centre, and the radius.

        At the frequencies of `polygons` (there exactly) the distance of their farthest corner, if it is less.
        """
        return narrowed(*self._discs_about(model, omega))

    def _discs_about(
        self, model: control.StateSpace | None, omega: ArrayLike
    ) -> tuple[Real, Bounded | None, Real, NDArray[np.complex128]]:
        """Bounds by the discs, with polygons, frequencies and nominal values by which they may be narrowed."""
        omega = np.atleast_1d(as_array("omega", omega))
        model = self.model if model is None else check_nominal(model, self.problem)
        if model is None:
            centre, radius = self.at(omega)
            return radius, self.polygons, omega, centre
        nominal = self.problem.plane.values_at(model, omega)
        with one_thread():
            return self._entries.errors(nominal, self._angles(omega)).bound, self.polygons, omega, nominal

    def with_model(self, model: control.StateSpace) -> Band:
        """Return the same band with errors measured from another nominal; nothing is searched."""
        return dataclasses.replace(self, model=check_nominal(model, self.problem))

    def refine(
        self,
        identification: Identification | None = None,
        *,
        omega: ArrayLike | None = None,
        time_limit: float | None = None,
        progress: Progress | None = None,
        executor: Processes = None,
        resume: Folder | None = None,
    ) -> Band:
        """Return the band with polygons at some frequencies, and the smaller bound of both there.

        Those of semidefinite programs, as of `worst_case_error`; over a box of sums over its cells, halved where the error
        is largest. By default at up to 40 frequencies in the range of the data, where they are estimated to gain most over the
        discs, if that is 5 % at least.

        Parameters
        ----------
        identification : Identification, optional
            Of the problem of the band, where one is at hand. Default: `identify` of it.
        omega : (F,) array, rad/s, optional
            These, all of them. Default: where polygons gain.
        time_limit : float, optional
            Seconds; the discs stand at frequencies that are not finished then.
        progress, executor, resume : optional
            As in `worst_case_error`.

        Returns
        -------
        Band

        Raises
        ------
        InconsistentDataError
            No system of the class fits the data.
        InputError
            An identification of another problem; a box that `worst_case_over_poles` can't take.

        Examples
        --------
        >>> import numpy as np, robustid as rid
        >>> omega = np.linspace(1.0, 30.0, 20)
        >>> frf = rid.FrequencyResponse(omega, 1 / (2 - np.exp(-0.1j * omega)), bound=0.01, dt=0.1)
        >>> result = rid.identify(rid.MixedProblem(frequency=frf, prior=rid.Prior(gain_bound=2.0, decay_rate=1.5)))
        >>> plain = rid.band(result, omega=[5.0, 20.0])
        >>> found = plain.refine(result, omega=[5.0])
        >>> bool(found.upper[0] < plain.upper[0]), bool(found.upper[1] == plain.upper[1]), found.certified
        (True, True, True)
        """
        budget, (low, high) = Budget(time_limit), self.range
        means = Means(executor, progress, resume, budget)
        if omega is not None:
            omega = as_frequencies(omega, self.problem)
            omega = omega[(omega >= low) & (omega <= high)]
            if not omega.size:
                raise InputError(
                    f"`omega` must lie between {low:g} and {high:g} rad/s, where the band stands; none does"
                )
        if identification is None:
            identification = identify(self.problem, time_limit=time_limit)
        thing = as_kind("identification", identification, Identification, "an Identification")
        check_same(thing.problem, self.problem)
        plain = self.by_directions(budget.share(_DIRECTED))
        about = as_nominal(self.model, thing)
        grid = candidates_of(self, self.problem, self.omega, self.box) if omega is None else omega
        return refined(self, plain, thing, about, grid, means, stated=omega is not None)

    def with_polygons(self, polygons: Bounded) -> Self:
        """Return the band with the polygons of a worst-case error that is known, at their frequencies too.

        Parameters
        ----------
        polygons : WorstCaseError or WorstCaseOverPoles
            At exact poles the former, over the box of the band the latter; about any model.

        Raises
        ------
        InputError
            Polygons of another problem, of exact poles beside a box, over a box that does not hold that of the band.
        """
        return self.between(polygons, Budget())

    def between(self, polygons: Bounded, budget: Budget | None) -> Self:
        """As `with_polygons`, with a search between them within a budget; without one a short search, after Ctrl-C none."""
        check_polygons(polygons, self.problem, self.box)
        low, high = self.range
        added = polygons.omega[(polygons.omega >= low) & (polygons.omega <= high)]
        near = np.abs(self.omega[:, None] - added) <= SAME * self.omega[:, None]
        omega = np.union1d(self.omega[~near.any(axis=1)], added)
        directed = joined_bands(self.bands, self.directed if self.polygons is None else (), polygons, budget)
        about = polygons.identification.problem
        return dataclasses.replace(self, problem=about, omega=omega, polygons=polygons, directed=directed)

    def by_directions(self, budget: Budget) -> Self:
        """The band without polygons, by sums of one direction each, of the samples alone."""
        if self.polygons is None and self.directed:
            return self
        return dataclasses.replace(self, polygons=None, directed=directed_bands(self.bands, budget))

    @property
    def circle(self) -> CircleBound:
        """Bound of |F - model| on the whole axis, arc by arc, up to pi/dt or infinity.

        Raises
        ------
        InputError
            There is no model, or the band is of a class that nothing bounds at infinity.
        """
        if self.model is None:
            raise InputError("`model` is missing: the whole axis is bounded about a model; use with_model(...)")
        return self._arcs

    @functools.cached_property
    def _arcs(self) -> CircleBound:
        return whole_axis(self._entries, self.model, self._corners)

    @property
    def _corners(self) -> tuple[Real, Real] | None:
        """Angles of the polygons, and the bounds of the error there; None without any."""
        if self.polygons is None:
            return None
        low, high = self.range
        omega = self.polygons.omega[(self.polygons.omega >= low) & (self.polygons.omega <= high)]
        return self.problem.plane.angles(omega), self.error_at(omega)

    @property
    def bounded(self) -> NDArray[np.bool_]:
        """Mask of the frequencies `omega` at which something is said, (F,)."""
        return np.isfinite(self.sigma_upper) & (~self.is_open(self.omega) | self.narrowed)

    @functools.cached_property
    def narrowed(self) -> NDArray[np.bool_]:
        """Mask of the frequencies `omega` of polygons at which these bound the error by less than the samples' discs do, (F,)."""
        sums, polygons, omega, nominal = self._discs_about(self.model, self.omega)
        solved = narrowed(np.full_like(sums, np.inf), polygons, omega, nominal)
        return (self._narrowing < 1) & np.any(solved <= _AS_GOOD * sums, axis=(1, 2))

    @functools.cached_property
    def _narrowing(self) -> Real:
        """Bounds with all that `refine` adds over those of the discs of samples alone, at `omega`, (F,)."""
        discs = norm_of_bounds(dataclasses.replace(self, polygons=None, directed=()).upper)
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.nan_to_num(self.sigma_upper / discs, nan=1.0)

    @property
    def narrowing_words(self) -> str:
        """Words on what `refine` adds to the discs; empty where there is nothing."""
        solved = None if self.polygons is None else np.isin(self.omega, self.polygons.omega)
        by = BY_PROGRAMS if self.box is None else BY_CELLS
        return narrowing_words(self.omega, self._narrowing, solved, self.narrowed, by)

    def verify(self, exact: bool = False) -> bool:
        """Evaluate all certificates again: discs of the amplitudes and of the values, from multipliers and data alone; polygons.

        `exact` in ball arithmetic, of discs at the knots, by code of its own (`robustid[exact]`).
        """
        from robustid.guarantees.linear.directed_verification import holds_exactly

        exact = as_flag("exact", exact)

        with one_thread():
            every = (*self.bands, *self.directed)
            again = [dataclasses.replace(one) for one in every]  # nothing that was computed before is taken over
            same = [np.array_equal(a.radius, b.radius) for a, b in zip(again, every, strict=True)]
            discs = all(same) and (not exact or all(map(holds_exactly, again)))
        return discs and (self.polygons is None or polygons_hold(self.polygons, exact))

    @property
    def unfinished(self) -> str:
        """Sentence on what a time limit, or Ctrl-C, has left out of the search; empty where nothing is missing."""
        count = len(self.bands)
        done, without = sum(one.complete for one in self.bands), sum(not one.searched for one in self.bands)
        if done == count:
            return ""
        rest = "the discs of the others are proved, and wider than they need be"
        if without:
            held = "only the class bounds them" if self.problem.parametric is None else "nothing bounds their modes"
            rest += f"; for {without} of them there was no time at all, and {held}"
        return f"The search was ended early: {done} of {count} entries are finished; {rest}."

    @property
    def searched(self) -> bool:
        """Return whether the search had time for every entry."""
        return all(one.searched for one in self.bands)

    @property
    def why_nothing(self) -> str:
        """Words on why nothing is proved at any frequency, where it is so."""
        if self.searched:
            return "the data do not tell the amplitudes of the modes apart"
        return "the search was ended before every entry had its turn"

    def __repr__(self) -> str:
        poles = "poles taken as exact" if self.box is None else "poles anywhere in a box"
        known = self.radius[np.isfinite(self.radius)]
        radius = f"radius up to {known.max():.4g}" if known.size else "nothing is proved"
        return f"<Band: {self.omega.size} frequencies, {poles}, {radius}>"

    def summary(self) -> str:
        """The result in plain text."""
        return f"guarantee  {self.claim}"

    @property
    def claim(self) -> str:
        """The summary without its first word."""
        about = "the centre of the band" if self.model is None else "the model"
        poles = pole_words([self])
        known = self.bounded
        where = "at every frequency" + (f" but from {self.open_words}" if self.open_ranges else "")
        lines = [f"none: {self.why_nothing}{poles}"]
        if known.any():
            largest = largest_error(self)
            lines = [
                f"every consistent system is within {largest_words(largest)} of {about}, proved {where}{poles}{self.problem.scope}",
                f"           (median {self.relative.words}; largest at {hz_words(largest.omega / (2 * np.pi))})",
            ]
        if known.any() and self.open_ranges:
            lines.append(
                f"open       nothing is proved from {self.open_words}: the box of a mode there reaches the undamped ones; measure"
                " frequency points there"
            )
        if self.unfinished:
            lines.append(f"unfinished {self.unfinished}")
        if self.narrowing_words:
            lines.append(f"refined    {self.narrowing_words}")
        lines.append(
            "assumed    gain bound, decay rate, number of modes, bounds of the samples: data can refute them, never prove them"
        )
        return "\n".join(lines)

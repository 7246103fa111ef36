"""band(): a proved disc around every consistent system, at every frequency, from sums; and its result."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from robustid.core import (
    Budget,
    Complex,
    Frozen,
    Progress,
    Real,
    Savable,
    as_array,
    as_count,
    as_flag,
    as_kind,
    freeze,
    one_thread,
)
from robustid.errors import InputError, InputTypeError
from robustid.figures import Drawable
from robustid.guarantees.circle import CircleBound
from robustid.guarantees.consistent_set import independent_entries
from robustid.guarantees.linear.arcs import arc_bounds, centre_and_radius
from robustid.guarantees.linear.entry_band import EntryBand, entry_band, quick_band
from robustid.guarantees.linear.functions import ends_of, functions_of
from robustid.guarantees.linear.in_time import response_discs, step_tails
from robustid.guarantees.linear.samples import samples_of, seen_in
from robustid.guarantees.nominal import as_frequencies, check_nominal, default_grid
from robustid.guarantees.pole_cells import AMPLITUDE
from robustid.guarantees.refinement import (
    SAME,
    Spent,
    check_polygons,
    narrowed,
    narrowed_norm,
    polygons_hold,
    polygons_of,
)
from robustid.guarantees.stability_margin import RobustStabilityMargin, margin_of_circle
from robustid.guarantees.sweep import Folder, Processes
from robustid.guarantees.value_set import norm_of_bounds
from robustid.guarantees.weight import UncertaintyWeight, uncertainty_weight
from robustid.identification import Identification, MixedProblem

_BEYOND = 4.0  # times the highest frequency point of continuous data: the last knot before infinity
_COARSE = 64  # knots of the uniform grid from end to end
_MOST_SAMPLES = 512  # of a step response whose peak is bounded
_LITTLE = 0.01  # of the static gain: what a step response leaves when its samples end


@dataclasses.dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Band(Frozen, Drawable, Savable):
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
        Bounds by semidefinite programs at some frequencies, of `refine`: where they are smaller, they are those of the band.
    """

    problem: MixedProblem
    omega: Real
    bands: tuple[EntryBand, ...]
    box: Any = None
    model: Any = None
    polygons: Any = None

    def __post_init__(self) -> None:
        self._set(omega=freeze(self.omega))
        if self.box is not None:
            self._set(box=tuple(freeze(ends) for ends in self.box))
        if self.polygons is not None:
            check_polygons(self.polygons, self.problem, self.box)

    @functools.cached_property
    def _by_entry(self) -> dict[tuple[int, int], EntryBand]:
        return dict(zip(independent_entries(self.problem.entries), self.bands, strict=True))

    @functools.cached_property
    def _here(self) -> tuple[Complex, Real]:
        return self.at(self.omega)

    @property
    def centre(self) -> Complex:
        """Centres of the discs at `omega`, (F, ny, nu): estimates with the smallest worst case that linear methods reach."""
        return freeze(self._here[0])

    @property
    def radius(self) -> Real:
        """Radii of the discs at `omega`, (F, ny, nu)."""
        return freeze(self._here[1])

    @property
    def upper(self) -> Real:
        """Proved bound of |F - model| over all consistent F at `omega`, (F, ny, nu); of |F - centre| without a model."""
        return freeze(self.error_at(self.omega))

    @property
    def sigma_upper(self) -> Real:
        """Proved bound of the largest singular value of F - model, (F,): the norm of the matrix `upper`, or that of polygons."""
        return freeze(narrowed_norm(norm_of_bounds(self.upper), self.polygons, self.omega, self.model))

    @property
    def nominal(self) -> Complex:
        """Response of the model at `omega`, (F, ny, nu); the centres without one."""
        return self.centre if self.model is None else self.problem.plane.values_at(self.model, self.omega)

    def at(self, omega: Any) -> tuple[Complex, Real]:
        """Centres and radii of the discs at any frequencies, (F, ny, nu) each.

        Parameters
        ----------
        omega : (F,) array, rad/s
            Between 0 (the first frequency point, where the plant has an integrator) and pi/dt; in continuous time up to the last
            knot, at `last`.

        Raises
        ------
        InputError
            Frequencies outside of that range.
        """
        omega = np.atleast_1d(as_array("omega", omega))
        angles, first = self.problem.plane.angles(omega), self.bands[0].angles
        slack = 1e-12 * max(float(first[-1]), 1.0)
        if angles.size and (angles.min() < first[0] - slack or angles.max() > first[-1] + slack):
            low, high = self.problem.plane.omega(first[[0, -1]]).tolist()
            bad = omega[(angles < first[0] - slack) | (angles > first[-1] + slack)][0]
            raise InputError(f"`omega` must lie between {low:g} and {high:g} rad/s, where the band stands; got {bad:g}")
        with one_thread():
            return centre_and_radius(self._by_entry, self.problem, np.clip(angles, first[0], first[-1]))

    @property
    def range(self) -> tuple[float, float]:
        """The frequencies between which `at` answers, rad/s."""
        low, high = self.problem.plane.omega(self.bands[0].angles[[0, -1]]).tolist()
        return low, high

    def error_at(self, omega: Any, model: Any = None) -> Real:
        """Proved bound of |F - model| at any frequencies, (F, ny, nu): distance from the centre, and the radius.

        At the frequencies of `polygons` (there exactly) the distance of their farthest corner, if it is less.
        """
        return narrowed(*self._discs_about(model, omega))

    def _discs_about(self, model: Any, omega: Any) -> tuple[Real, Any, Real, Complex]:
        """Bounds by the discs, with polygons, frequencies and nominal values by which they may be narrowed."""
        omega = np.atleast_1d(as_array("omega", omega))
        centre, radius = self.at(omega)
        model = self.model if model is None else check_nominal(model, self.problem)
        if model is None:
            return radius, self.polygons, omega, centre
        nominal = self.problem.plane.values_at(model, omega)
        return np.abs(centre - nominal) * (1 + 1e-15) + radius, self.polygons, omega, nominal

    def with_model(self, model: Any) -> Band:
        """Return the same band with errors measured from another nominal; nothing is searched."""
        return dataclasses.replace(self, model=check_nominal(model, self.problem))

    def refine(
        self,
        identification: Identification | None = None,
        *,
        omega: Any = None,
        time_limit: float | None = None,
        progress: Progress | None = None,
        executor: Processes = None,
        resume: Folder | None = None,
    ) -> Band:
        """Return the band with polygons of semidefinite programs at some frequencies, and the smaller bound of both there.

        Of poles that are exact those of `worst_case_error`, over a box those of `worst_case_over_poles`, which assume that
        amplitudes of modes are at most twice those of the identified model. Frequencies come first at which the discs are estimated
        to be twice as large as need be. Polygons that the band has are replaced.

        Parameters
        ----------
        identification : Identification, optional
            Of the problem of the band, where one is at hand. Default: `identify` of it.
        omega : (F,) array, rad/s, optional
            Default: those of the band.
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
        grid = self.omega if omega is None else as_frequencies(omega, self.problem)
        low, high = self.range
        grid = grid[(grid >= low) & (grid <= high)]
        if not grid.size:
            raise InputError(f"`omega` must lie between {low:g} and {high:g} rad/s, where the band stands; none does")
        budget = Budget(time_limit)
        thing = self.problem
        if identification is not None:
            thing = as_kind("identification", identification, Identification, "an Identification")
        means = Spent(executor, progress, resume, budget)
        return self.with_polygons(polygons_of(thing, self.box, self.model, grid, self, means))

    def with_polygons(self, polygons: Any) -> Band:
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
        check_polygons(polygons, self.problem, self.box)
        low, high = self.range
        added = polygons.omega[(polygons.omega >= low) & (polygons.omega <= high)]
        near = np.abs(self.omega[:, None] - added) <= SAME * self.omega[:, None]
        omega = np.union1d(self.omega[~near.any(axis=1)], added)
        return dataclasses.replace(self, problem=polygons.identification.problem, omega=omega, polygons=polygons)

    @functools.cached_property
    def circle(self) -> CircleBound:
        """Bound of |F - model| on the whole axis, arc by arc, up to pi/dt or infinity.

        Raises
        ------
        InputError
            There is no model, or the band is of a class that nothing bounds at infinity.
        """
        if self.model is None:
            raise InputError("`model` is missing: the whole axis is bounded about a model; use with_model(...)")
        with one_thread():
            angles, entries = arc_bounds(self._by_entry, self.model, self.problem, self._corners)
        edges = np.where(angles < np.pi, self.problem.plane.omega(np.minimum(angles, 3.0)), self.problem.plane.top)
        inside = angles < np.pi
        edges[inside] = self.problem.plane.omega(angles[inside])
        return CircleBound(edges, norm_of_bounds(entries), 0.0, True, (), entries)

    @property
    def _corners(self) -> tuple[Real, Real] | None:
        """Angles of the polygons, and the bounds of the error there; None without any."""
        if self.polygons is None:
            return None
        low, high = self.range
        omega = self.polygons.omega[(self.polygons.omega >= low) & (self.polygons.omega <= high)]
        return self.problem.plane.angles(omega), self.error_at(omega)

    @property
    def hinf(self) -> float:
        """Proved bound of the H-infinity norm of F - model (with an integrator: over |omega| >= the first frequency point)."""
        return self.circle.largest

    def weight(
        self, *, kind: str = "additive", order: int | None = None, below: float | None = None
    ) -> UncertaintyWeight:
        """Stable minimum-phase W above the error on the whole axis; see `uncertainty_weight`."""
        circle = self.circle
        return uncertainty_weight(self.model, circle.edges, circle.bound, kind=kind, order=order, below=below)

    def robust_stability_margin(self, controller: Any, *, kind: str = "additive") -> RobustStabilityMargin:
        """`robust_stability_margin` of a controller for `model` against every consistent system; see there."""
        circle = self.circle
        return margin_of_circle(self.model, controller, (circle.edges, circle.bound, circle.entries), kind)

    @property
    def amplitudes(self) -> tuple[tuple[Complex, Real], ...]:
        r"""Proved discs of the amplitudes of the parametric part: of every entry, as in `bands`, centres and radii, (g,) each.

        Without a box they are intervals of the real coefficients of the parametric functions, in their order. With one come the
        functions that the box does not hold, then for every mode c n(x)/(1 - a x) + conj., x the delay, the complex
        c (1 - \|a_1\|^2)/(1 - a_1* a), by rising frequency: a is the pole anywhere in the box, a_1 its middle
        (``bands[0].samples.functions.modes.middle``). Infinite where the data do not tell them apart; of `assumed_modes` assumed.
        """
        found: list[tuple[Complex, Real]] = []
        for one in self.bands:
            count, target = one.samples.functions.amplitudes, one.samples.target
            own = slice(target * count, (target + 1) * count)
            found.append((freeze(one.extraction.known.centre[own]), freeze(one.extraction.known.radius[own])))
        return tuple(found)

    @property
    def static_gain(self) -> tuple[Real, Real]:
        """Centres and radii of the intervals that hold the static gain of every consistent system, (ny, nu) each.

        Raises
        ------
        InputError
            The plant has an integrator.
        """
        self._without_integrator()
        centre, radius = self.at([0.0])
        return freeze(centre[0].real), freeze(radius[0])

    def impulse_response(self, count: int) -> tuple[Real, Real]:
        """Centres and radii of the first samples of the response to a unit pulse at t = 0, (count, ny, nu) each.

        Every consistent system is within the radii; each is at most what the class and the amplitudes say, K rho^-t of the
        non-parametric part. From zero initial conditions.

        Raises
        ------
        InputError
            A count below 1, or continuous time.
        """
        return self._response(np.eye(1, as_count("count", count, least=1))[0])

    def step_response(self, count: int) -> tuple[Real, Real]:
        """Centres and radii of the first samples of the response to a unit step, (count, ny, nu) each; as `impulse_response`."""
        return self._response(np.ones(as_count("count", count, least=1)))

    def _response(self, u: Real) -> tuple[Real, Real]:
        self._sampled()
        with one_thread():
            discs = [response_discs(one.extraction, u) for one in self.bands]
        centre, radius = (self._of_entries([disc[k] for disc in discs]) for k in range(2))
        return freeze(centre), freeze(radius)

    def peak_step(self, count: int | None = None) -> Real:
        """Proved bound of the largest |step response| of every consistent system over all t >= 0, (ny, nu).

        The first `count` samples are bounded one by one; from there on, |static gain| and what class and modes still leave.
        Default: as many samples as leave little, 512 at most.

        Raises
        ------
        InputError
            A count below 1, continuous time, or a plant with an integrator, whose step response has no bound.
        """
        self._sampled()
        self._without_integrator()
        most = _MOST_SAMPLES if count is None else as_count("count", count, least=1)
        static, off = self.static_gain
        end = np.abs(static) + off
        with one_thread():
            later = end + self._of_entries([step_tails(one.extraction, most) for one in self.bands])
        if count is None:
            little = np.all(later <= (1 + _LITTLE) * end, axis=(1, 2))
            most = max(int(np.argmax(little)), 1) if little.any() else most
        centre, radius = self.step_response(most)
        first = np.minimum(np.abs(centre) + radius, later[:most])
        return freeze(np.maximum(first.max(axis=0), later[most]))

    def _of_entries(self, values: Sequence[Real]) -> Real:
        """Values (T,) of the entries in `bands`, as matrices (T, ny, nu)."""
        places = list(self._by_entry)
        found = np.empty((len(values[0]), *self.problem.entries.shape))
        for place in np.ndindex(*found.shape[1:]):
            own = (min(place), max(place)) if self.problem.entries.symmetric else place
            found[:, *place] = values[places.index(own)]
        return found

    def _sampled(self) -> None:
        if not self.problem.dt:
            raise InputError(
                "`problem` is of continuous time, whose responses have no samples: take at(...), or static_gain"
            )

    def _without_integrator(self) -> None:
        basis = self.problem.parametric
        if basis is not None and basis.has_integrator:
            raise InputError("`problem` has an integrator, so that nothing bounds its static gain: take at(...)")

    @functools.cached_property
    def open_ranges(self) -> tuple[tuple[float, float], ...]:
        """Ranges of frequencies, rad/s, in which nothing is said: the box of a mode there reaches undamped ones.

        Where a radius is infinite, and beside that as long as it exceeds the largest response.
        """
        ends: list[tuple[float, float]] = []
        for one in self.bands:
            endless = np.isinf(one.radius)
            if not endless.any():
                continue
            lost = one.radius > np.abs(one.centre[~endless]).max(initial=0.0)
            starts = np.flatnonzero(lost & ~np.r_[False, lost[:-1]])
            stops = np.flatnonzero(lost & ~np.r_[lost[1:], False])
            last = one.angles.size - 1
            ends += [
                (float(one.angles[max(a - 1, 0)]), float(one.angles[min(b + 1, last)]))
                for a, b in zip(starts.tolist(), stops.tolist(), strict=True)
                if endless[a : b + 1].any()
            ]
        found: list[tuple[float, float]] = []
        for low, high in sorted(ends):
            if found and low <= found[-1][1]:
                found[-1] = found[-1][0], max(high, found[-1][1])
            else:
                found.append((low, high))
        omega = self.problem.plane.omega(np.array(found).reshape(-1, 2))
        return tuple((float(low), float(high)) for low, high in omega)

    @property
    def bounded(self) -> NDArray[np.bool_]:
        """Mask of the frequencies `omega` at which something is said, (F,)."""
        inside = [(low <= self.omega) & (self.omega <= high) for low, high in self.open_ranges]
        open_there = np.any([np.zeros(self.omega.size, bool), *inside], axis=0)
        return np.isfinite(self.sigma_upper) & (~open_there | self.narrowed)

    @functools.cached_property
    def narrowed(self) -> NDArray[np.bool_]:
        """Mask of the frequencies `omega` at which polygons bound the error by less than the discs do, (F,)."""
        return self._narrowing < 1

    @functools.cached_property
    def _narrowing(self) -> Real:
        """Bounds with polygons over those of the discs, at `omega`, (F,)."""
        discs = norm_of_bounds(self._discs_about(None, self.omega)[0])
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.nan_to_num(self.sigma_upper / discs, nan=1.0)

    @property
    def polygon_words(self) -> str:
        """Words on what polygons add to the discs; empty where there are none."""
        if self.polygons is None:
            return ""
        asked, count = int(np.isin(self.omega, self.polygons.omega).sum()), int(self.narrowed.sum())
        if not count:
            return f"Semidefinite programs at {asked} of {self.omega.size} frequencies narrow the band nowhere: that of sums stands"
        part = self._narrowing[self.narrowed]
        least = float(self.omega[np.argmin(self._narrowing)]) / (2 * np.pi)
        sizes = f"to {100 * np.median(part):.3g} % of its width in the median, to {100 * part.min():.3g} % at {least:.5g} Hz"
        return (
            f"At {count} of {self.omega.size} frequencies a semidefinite program narrows the band ({sizes}); everywhere else the"
            " band of sums stands"
        )

    @property
    def assumes_amplitudes(self) -> bool:
        """Return whether polygons over a box narrow it: these assume amplitudes of at most twice those of the identified model."""
        return self.polygons is not None and self.box is not None and bool(self.narrowed.any())

    @property
    def open_words(self) -> str:
        """The open ranges in words, in Hz; empty where there are none."""
        hz = [f"{low / (2 * np.pi):.5g} to {high / (2 * np.pi):.5g} Hz" for low, high in self.open_ranges]
        return " and ".join(hz)

    @property
    def assumed_modes(self) -> tuple[int, ...]:
        """Numbers of modes, from 0, whose box is too wide for a proof of their amplitude.

        In some entry it is assumed to be at most twice that of a fit.
        """
        if self.box is None:
            return ()
        found: set[int] = set()
        for one in self.bands:
            samples = one.samples
            count, first = samples.functions.amplitudes, samples.functions.fixed_count
            found |= {int(g) % count - first for g in np.flatnonzero(np.isfinite(one.extraction.assumed))}
        return tuple(sorted(found))

    @property
    def certified(self) -> bool:
        """Return whether every disc holds when it is evaluated anew from its multipliers and the data."""
        return self.verify()

    def verify(self, exact: bool = False) -> bool:
        """Evaluate all certificates again: discs of the amplitudes and of the values, from multipliers and data alone; polygons.

        `exact` in ball arithmetic, of discs at the knots, by code of its own (`robustid[exact]`).
        """
        from robustid.guarantees.linear.verification import holds_exactly

        exact = as_flag("exact", exact)

        with one_thread():
            again = [dataclasses.replace(one) for one in self.bands]  # nothing that was computed before is taken over
            same = [np.array_equal(a.radius, b.radius) for a, b in zip(again, self.bands, strict=True)]
            discs = all(same) and (not exact or all(holds_exactly(one) for one in again))
        return discs and (self.polygons is None or polygons_hold(self.polygons, exact))

    def __repr__(self) -> str:
        poles = "poles as stated" if self.box is None else "poles anywhere in a box"
        known = self.radius[np.isfinite(self.radius)]
        return f"<Band: {self.omega.size} frequencies, {poles}, radius up to {known.max(initial=0.0):.4g}>"

    def summary(self) -> str:
        """The result in plain text."""
        return f"guarantee  {self.claim}"

    @property
    def claim(self) -> str:
        """The summary without its first word."""
        centre, upper = self.centre, self.sigma_upper
        size = np.maximum(np.linalg.norm(centre, 2, axis=(1, 2)), np.finfo(float).tiny)
        about = "the centre of the band" if self.model is None else "the model"
        poles = ""
        if self.problem.parametric is not None:
            poles = ", poles of the parametric part exactly as stated"
        if self.box is not None:
            poles = f", poles of {len(self.box[0])} mode{'s' * (len(self.box[0]) > 1)} anywhere in their box"
        known = self.bounded
        where = "at every frequency" + (f" but from {self.open_words}" if self.open_ranges else "")
        lines = ["none: the data do not tell the amplitudes of the modes apart" + poles]
        if known.any():
            k = int(np.argmax(np.where(known, upper, -1.0)))
            lines = [
                f"every consistent system is within {upper[k]:.4g} of {about}, proved {where}{poles}",
                f"           (median {100 * np.median(upper[known] / size[known]):.3g} % of the response at {known.sum()}"
                f" frequencies; largest at {self.omega[k] / (2 * np.pi):.5g} Hz)",
            ]
        if known.any() and self.open_ranges:
            lines.append(
                f"open       nothing is proved from {self.open_words}: the box of a mode there reaches the undamped ones; measure"
                " frequency points there"
            )
        if self.polygons is not None:
            lines.append(f"refined    {self.polygon_words}")
        if self.assumes_amplitudes:
            lines.append(
                f"           there amplitudes are assumed of at most {AMPLITUDE:g} times the identified model's"
            )
        lines.append(
            "assumed    gain bound, decay rate, number of modes, bounds of the samples: data can refute them, never prove them"
        )
        if self.box is not None and self.assumed_modes:
            names = ", ".join(
                f"{self.box[0].mean(axis=1).tolist()[k] / (2 * np.pi):.4g} Hz" for k in self.assumed_modes
            )
            lines.append(f"           amplitudes of the modes at {names} at most twice those of a fit")
        return "\n".join(lines)


def band(thing: Any, *, omega: Any = None, box: Any = None, model: Any = None, knots: int | None = None) -> Band:
    r"""Proved band of all consistent systems at every frequency, from linear certificates: milliseconds a frequency.

    For any numbers d_k,

    .. math::
        |F(z_0) - \sum_k d_k y_k| \le \sum_k |d_k| \varepsilon_k + K \|r_d\| + \sum_i \Delta_i |\sum_k d_k P_i(z_k) - P_i(z_0)|,
        \qquad r_d(g) = g(z_0) - \sum_k d_k g(z_k),

    with the norm of H2 of the harmonic measure seen from z_0, whose unit ball contains the class, and Delta_i proved radii of the
    coefficients (measured from their centres). Good d come from reweighted least squares; whatever they are, the sum is a proof.

    Parameters
    ----------
    thing : Identification or MixedProblem
        The statement: data with bounds, class, parametric part. Of an identification `model` is the nominal.
    omega : (F,) array, rad/s, optional
        Frequencies to report; the band holds at all others too. Default: as in `worst_case_error`.
    box : KautzSuggestion or pair of (M, 2) arrays, optional
        Pole-uncertainty box: ends of the natural frequencies in rad/s and of the damping ratios of the `kautz` pairs of the
        parametric part, by rising frequency. Poles that were taken from the same data need it. Default: poles exactly as stated.
    model : control.StateSpace, optional
        The nominal that errors are measured from.
    knots : int, optional
        Most frequencies of an entry at which certificates are searched, but at least 50 and 19 for every mode: sooner, and a
        wider band. 400 leave it at most half as wide again in most cases. Default: as many as interpolation between them asks for.

    Returns
    -------
    Band

    Raises
    ------
    InconsistentDataError
        An identification that isn't consistent.
    InputError
        A passive class without a gain bound, a box that does not hold the poles, frequencies above pi/dt, less than 2 knots.

    Notes
    -----
    Linear methods reach the smallest worst case over all data [`micchelli1977`]; what these data say beyond that is left to
    `worst_case_error`, which takes a hundred times as long. Records are used up to 256 samples an entry, those of an unknown
    initial state only where there is no box; ellipses as the discs around them. Source: theorem 1 of `micchelli1977` for the
    optimality, Szego kernels of the disc for the norm.

    Examples
    --------
    >>> import numpy as np, robustid as rid
    >>> omega = np.linspace(1.0, 30.0, 20)
    >>> frf = rid.FrequencyResponse(omega, 1 / (2 - np.exp(-0.1j * omega)), bound=0.01, dt=0.1)
    >>> problem = rid.MixedProblem(frequency=frf, prior=rid.Prior(gain_bound=2.0, decay_rate=1.5))
    >>> found = rid.band(problem)
    >>> centre, radius = found.at([7.5])
    >>> bool(abs(centre[0, 0, 0] - 1 / (2 - np.exp(-0.75j))) <= radius[0, 0, 0] < 0.02), found.certified
    (True, True)
    """
    problem, model = _statement(thing, model)
    functions = functions_of(problem, box)
    low, high = _range(problem)
    grid = default_grid(problem) if omega is None else as_frequencies(omega, problem)
    if not problem.dt:
        high = max(high, float(grid.max()))
    grid = grid[grid >= low] if omega is None else grid
    ends: list[float] = problem.plane.angles(np.array([low, high])).tolist()
    wanted = np.concatenate([problem.plane.angles(grid), np.linspace(ends[0], ends[1], _COARSE)])
    wanted = np.clip(wanted, ends[0], ends[1])
    most = None if knots is None else as_count("knots", knots, least=2)
    seen = seen_in(problem)
    with one_thread():
        every = [samples_of(problem, functions, entry, seen) for entry in independent_entries(problem.entries)]
        if most is None:
            bands = [entry_band(one, wanted, ends[0], ends[1]) for one in every]
        else:
            bands = [quick_band(one, ends[0], ends[1], most) for one in every]
    stated = None if box is None else ends_of(box)
    return Band(problem=problem, omega=grid, bands=tuple(bands), box=stated, model=model)


def _statement(thing: Any, model: Any) -> tuple[MixedProblem, Any]:
    """The problem and the nominal."""
    if isinstance(thing, Identification):
        thing.require()
        problem, model = thing.problem, thing.model if model is None else model
    elif isinstance(thing, MixedProblem):
        problem = thing
    else:
        raise InputTypeError(f"`thing` must be an Identification or a MixedProblem; got {type(thing).__name__}")
    if problem.prior.positive_real:
        raise InputError(
            f"`thing` is of a {problem.prior.passive} class, which has no gain bound: its band comes from worst_case_error"
        )
    return problem, None if model is None else check_nominal(model, problem)


def _range(problem: MixedProblem) -> tuple[float, float]:
    """The frequencies between which there are knots, rad/s."""
    lines = np.concatenate([np.zeros(0), *(f.omega for f in problem.frequency)])
    basis = problem.parametric
    low = 0.0
    if basis is not None and basis.has_integrator:
        low = float(lines[lines > 0].min()) if np.any(lines > 0) else 1e-3 * problem.plane.top
    return low, problem.plane.top if problem.dt else _BEYOND * float(lines.max())

"""band(): a proved disc around every consistent system, at every frequency, from sums; and its result."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from robustid.core import Complex, Frozen, Real, Savable, as_array, as_count, as_flag, freeze, one_thread
from robustid.errors import InputError, InputTypeError
from robustid.figures import Drawable
from robustid.guarantees.circle import CircleBound
from robustid.guarantees.consistent_set import independent_entries
from robustid.guarantees.linear.amplitudes import Extraction, wide_modes
from robustid.guarantees.linear.arcs import arc_bounds, centre_and_radius
from robustid.guarantees.linear.entry_band import EntryBand, entry_band, quick_band
from robustid.guarantees.linear.functions import Functions, fixed_functions, functions_over, pairs_of
from robustid.guarantees.linear.samples import samples_of, seen_in
from robustid.guarantees.nominal import as_frequencies, check_nominal, default_grid
from robustid.guarantees.stability_margin import RobustStabilityMargin, margin_of_circle
from robustid.guarantees.value_set import norm_of_bounds
from robustid.guarantees.weight import UncertaintyWeight, uncertainty_weight
from robustid.identification import Identification, MixedProblem

_BEYOND = 4.0  # times the highest frequency point of continuous data: the last knot before infinity
_NEAR = 3.0  # half-widths around a mode in which its resonance is looked for
_COARSE = 64  # knots of the uniform grid from end to end


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
    """

    problem: MixedProblem
    omega: Real
    bands: tuple[EntryBand, ...]
    box: Any = None
    model: Any = None

    def __post_init__(self) -> None:
        self._set(omega=freeze(self.omega))
        if self.box is not None:
            self._set(box=tuple(freeze(ends) for ends in self.box))

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
        """Proved bound of the largest singular value of F - model, (F,): the norm of the matrix `upper`."""
        return freeze(norm_of_bounds(self.upper))

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
        """Proved bound of |F - model| at any frequencies, (F, ny, nu): distance from the centre, and the radius."""
        centre, radius = self.at(omega)
        model = self.model if model is None else check_nominal(model, self.problem)
        if model is None:
            return radius
        nominal = self.problem.plane.values_at(model, np.atleast_1d(np.asarray(omega, dtype=float)))
        return np.abs(centre - nominal) * (1 + 1e-15) + radius

    def with_model(self, model: Any) -> Band:
        """Return the same band with errors measured from another nominal; nothing is searched."""
        return dataclasses.replace(self, model=check_nominal(model, self.problem))

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
            angles, entries = arc_bounds(self._by_entry, self.model, self.problem)
        edges = np.where(angles < np.pi, self.problem.plane.omega(np.minimum(angles, 3.0)), self.problem.plane.top)
        inside = angles < np.pi
        edges[inside] = self.problem.plane.omega(angles[inside])
        return CircleBound(edges, norm_of_bounds(entries), 0.0, True, (), entries)

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
    def amplitudes(self) -> Any:
        """Proved discs of the amplitudes of the parametric part: of every entry its centres and radii."""
        return tuple((one.extraction.known.centre, one.extraction.known.radius) for one in self.bands)

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
        return np.isfinite(self.sigma_upper) & ~np.any([np.zeros(self.omega.size, bool), *inside], axis=0)

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
        """Evaluate all certificates again: discs of the amplitudes and of the values, from multipliers and data alone.

        `exact` in ball arithmetic, at the knots, by code of its own (`robustid[exact]`).
        """
        from robustid.guarantees.linear.verification import holds_exactly

        exact = as_flag("exact", exact)

        with one_thread():
            again = [dataclasses.replace(one) for one in self.bands]  # nothing that was computed before is taken over
            same = [np.array_equal(a.radius, b.radius) for a, b in zip(again, self.bands, strict=True)]
            return all(same) and (not exact or all(holds_exactly(one) for one in again))

    def __repr__(self) -> str:
        poles = "poles as stated" if self.box is None else "poles anywhere in a box"
        known = self.radius[np.isfinite(self.radius)]
        return f"<Band: {self.omega.size} frequencies, {poles}, radius up to {known.max(initial=0.0):.4g}>"

    def summary(self) -> str:
        """The result in plain text."""
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
        lines = ["guarantee  none: the data do not tell the amplitudes of the modes apart" + poles]
        if known.any():
            k = int(np.argmax(np.where(known, upper, -1.0)))
            lines = [
                f"guarantee  every consistent system is within {upper[k]:.4g} of {about}, proved {where}{poles}",
                f"           (median {100 * np.median(upper[known] / size[known]):.3g} % of the response at {known.sum()}"
                f" frequencies; largest at {self.omega[k] / (2 * np.pi):.5g} Hz)",
            ]
        if known.any() and self.open_ranges:
            lines.append(
                f"open       nothing is proved from {self.open_words}: the box of a mode there reaches the undamped ones; measure"
                " frequency points there"
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
    functions = _functions(problem, box)
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
    stated = None if box is None else _ends(box)
    return Band(problem=problem, omega=grid, bands=tuple(bands), box=stated, model=model)


def has_box(basis: Any, modes: int) -> bool:
    """Return whether functions are single pairs of so many modes, besides others: a pole-uncertainty box can hold these."""
    return basis is not None and len(pairs_of(basis)) == modes


def band_of_multipliers(
    problem: MixedProblem,
    box: tuple[Real, Real] | None,
    omega: Real,
    model: Any,
    multipliers: Sequence[tuple[Real, NDArray[Any], NDArray[Any], dict[str, NDArray[Any]]]],
) -> Band:
    """Make the band of known multipliers; all that it claims follows from them.

    Of every entry angles, points and multipliers of the knots, and the fields of an `Extraction` but for its samples.

    Raises
    ------
    ValueError
        Arrays that do not belong to the problem.
    """
    functions, seen = _functions(problem, box), seen_in(problem)
    places = independent_entries(problem.entries)
    if len(places) != len(multipliers):
        raise ValueError("its entries are not those of the problem")
    bands: list[EntryBand] = []
    for place, (angles, points, d, proof) in zip(places, multipliers, strict=True):
        samples = samples_of(problem, functions, place, seen)
        extraction = Extraction(samples, **proof)
        count, rows, g = samples.angles.size, samples.rows, samples.amplitudes
        own = [(points, d, angles.size), (extraction.points, extraction.multipliers, g)]
        fits = all(
            p.shape[:1] == (n,) == m.shape[:1]
            and m.shape[1] == p.shape[1] + rows
            and (not p.size or (p.min() >= 0 and p.max() < count))
            and np.all(np.isfinite(m))
            for p, m, n in own
        )
        ordered = angles.ndim == 1 and angles.size > 1 and bool(np.all(np.diff(angles) > 0))
        if not (fits and ordered and extraction.assumed.shape == (g,) == extraction.about.shape):
            raise ValueError("its multipliers do not belong to the samples of the problem")
        if np.any(np.isfinite(extraction.assumed) & ~wide_modes(samples)) or np.any(extraction.assumed < 0):
            raise ValueError("it assumes amplitudes of modes that can be proved")
        bands.append(EntryBand(samples, extraction, angles, points, d))
    grid = as_frequencies(omega, problem)
    return Band(problem=problem, omega=grid, bands=tuple(bands), box=box, model=model)


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


def _ends(box: Any) -> tuple[Real, Real]:
    """The intervals of a box."""
    omega, damping = getattr(box, "omega_interval", None), getattr(box, "damping_interval", None)
    if omega is None or damping is None:
        try:
            omega, damping = box
        except (TypeError, ValueError):
            raise InputTypeError(
                "`box` must be a KautzSuggestion or a pair of (M, 2) arrays: natural frequencies in rad/s, damping ratios;"
                f" got {type(box).__name__}"
            ) from None
    omega, damping = as_array("box", omega, ndim=2), as_array("box", damping, ndim=2)
    for name, ends in (("frequencies", omega), ("damping ratios", damping)):
        if ends.shape[1:] != (2,) or np.any(ends[:, 0] > ends[:, 1]) or np.any(ends <= 0):
            raise InputError(f"`box` must hold positive ends (low, high) of the {name}; got {ends.tolist()}")
    if omega.shape != damping.shape:
        raise InputError(
            f"`box` must have one row (low, high) a mode in both parts; got {omega.shape} for the frequencies and"
            f" {damping.shape} for the damping ratios"
        )
    if np.any(damping >= 1):
        raise InputError(f"`box` must hold damping ratios below 1; got {damping.max():g}")
    return omega, damping


def _functions(problem: MixedProblem, box: Any) -> Functions:
    """The parametric part, with its poles in the box."""
    if box is None:
        return fixed_functions(problem.parametric)
    omega, damping = _ends(box)
    return functions_over(problem.parametric, problem.plane, omega, damping, _peaks(problem, omega, damping))


def _peaks(problem: MixedProblem, omega: Real, damping: Real) -> Real:
    """Largest samples around every mode, in units of their bounds, (M,): so exactly its series must be."""
    found = np.zeros(len(omega))
    for points in problem.frequency:
        size = np.abs(np.where(points.bound.used, points.values, 0)) / points.bound.outer_radius
        size = size.max(axis=(1, 2))
        for k, ((low, high), (_, most)) in enumerate(zip(omega.tolist(), damping.tolist(), strict=True)):
            near = np.abs(points.omega - (low + high) / 2) <= (high - low) / 2 + _NEAR * most * high
            near[np.argmin(np.abs(points.omega - (low + high) / 2))] = True
            found[k] = max(found[k], float(size[near].max()))
    for record in problem.time:
        size = np.abs(np.where(record.bound.used, record.y, 0)) / record.bound.radius
        found = np.maximum(found, float(size.max()))
    return found


def _range(problem: MixedProblem) -> tuple[float, float]:
    """The frequencies between which there are knots, rad/s."""
    lines = np.concatenate([np.zeros(0), *(f.omega for f in problem.frequency)])
    basis = problem.parametric
    low = 0.0
    if basis is not None and basis.has_integrator:
        low = float(lines[lines > 0].min()) if np.any(lines > 0) else 1e-3 * problem.plane.top
    return low, problem.plane.top if problem.dt else _BEYOND * float(lines.max())

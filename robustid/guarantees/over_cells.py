"""The worst case over cells, of whatever kind: what holds around a model of every system of any of them."""

from __future__ import annotations

import abc
import dataclasses
import functools
from collections.abc import Iterator
from typing import TYPE_CHECKING, Self

import numpy as np

from robustid.core import Budget, Complex, Frozen, Progress, Real, Savable, as_flag, as_positive, freeze, threads_for
from robustid.figures import Drawable
from robustid.guarantees.circle import CircleBound, Remembered, joined
from robustid.guarantees.consistent_set import Entry
from robustid.guarantees.covers import cover_bound
from robustid.guarantees.linear.entry_band import EntryBands
from robustid.guarantees.linear.functions import Box
from robustid.guarantees.nominal import check_nominal
from robustid.guarantees.pole_proofs import Cell, Claim, hulls_of, union_of
from robustid.guarantees.relative_error import RelativeErrors, relative_errors
from robustid.guarantees.stability_margin import RobustStabilityMargin, margin_of_circle
from robustid.guarantees.sweep import Folder, Means, Processes
from robustid.guarantees.value_set import norm_of_bounds
from robustid.guarantees.weight import UncertaintyWeight, uncertainty_weight
from robustid.guarantees.whole_axis import discs_of_entries, whole_axis, without_long_records
from robustid.identification import MixedProblem, check_gain

if TYPE_CHECKING:
    import control

_KNOTS = 400  # of the sums of every entry: in most cases bounds are at most half as large again as need be


class AroundModel(abc.ABC):
    """Conclusions from a bound of F - model on the whole circle, whatever proves it."""

    model: control.StateSpace

    @property
    @abc.abstractmethod
    def relative(self) -> RelativeErrors:
        """Bounds at the frequencies of the data as shares of the response, with their median."""

    @property
    @abc.abstractmethod
    def circle(self) -> CircleBound:
        """The bound on the whole circle, arc by arc."""

    @abc.abstractmethod
    def verify(self, exact: bool = False) -> bool:
        """Evaluate all proofs again, from their numbers and those of the problem; no solver is involved."""

    @property
    def certified(self) -> bool:
        """Return whether every bound has its certificate and every certificate, evaluated anew, supports it."""
        return self.verify()

    @property
    def hinf(self) -> float:
        """Guaranteed bound of the H-infinity norm of F - model (with an integrator: from the first line on); see `circle`."""
        return self.circle.largest

    def cover(self, kind: str = "additive") -> tuple[Real, Real]:
        """Edges (C + 1,) in rad/s, and the bound (C,) of the uncertainty of a kind on every arc between them."""
        circle = self.circle
        return circle.edges, cover_bound(self.model, circle.edges, circle.bound, circle.entries, kind)

    def weight(
        self, *, kind: str = "additive", order: int | None = None, below: float | None = None
    ) -> UncertaintyWeight:
        """Stable minimum-phase W above the error on the whole circle, of the smallest order that follows it.

        See `uncertainty_weight`; the bound is `circle`, its arcs joined where it hardly changes.
        """
        edges, bound = joined(self.circle)
        return uncertainty_weight(self.model, edges, bound, kind=kind, order=order, below=below)

    def robust_stability_margin(
        self, controller: control.StateSpace, *, kind: str = "additive"
    ) -> RobustStabilityMargin:
        """`robust_stability_margin` of a controller for `model` against every system that the guarantee is about.

        From the bounds of `circle`; MIMO: those of the largest singular value and of the entries at the same time.

        Parameters
        ----------
        controller : control.StateSpace
            From the outputs to the inputs, ``u = -K y``.
        kind : {"additive", "multiplicative", "input_multiplicative", "inverse"}

        Raises
        ------
        InputError
            As `circle`.
        """
        circle = self.circle
        return margin_of_circle(self.model, controller, (circle.edges, circle.bound, circle.entries), kind)


@dataclasses.dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class WorstCase(AroundModel, Frozen, Drawable, Savable):
    """Largest distance of all systems of some cells from a model: proved from above, at frequencies and on the whole circle.

    Poles that are exactly as stated make one cell; a pole-uncertainty box those that may contain the poles; a family of plants the
    cells of all its members.

    Attributes
    ----------
    model : control.StateSpace
        The nominal that the errors are measured from.
    omega : (F,) array, rad/s
    kept : tuple of Cell
        With the values of their systems at every frequency.
    """

    model: control.StateSpace
    omega: Real
    kept: tuple[Cell, ...]
    _circle: Remembered = dataclasses.field(init=False, default_factory=Remembered)

    @property
    @abc.abstractmethod
    def problem(self) -> MixedProblem:
        """Statement with the signals, the plane and the class of all cells."""

    @abc.abstractmethod
    def claims(self) -> Iterator[Claim]:
        """Every inequality that is stated, with its certificate."""

    @property
    @abc.abstractmethod
    def claim_count(self) -> int:
        """Number of `claims`."""

    @property
    @abc.abstractmethod
    def supported(self) -> bool:
        """Return whether the claims are about all that is stated: every entry, frequency, part of a box, and arc of the circle."""

    @abc.abstractmethod
    def _refined(self, rtol: float, everywhere: bool, means: Means) -> CircleBound:
        """The bound on the circle, refined from what is known."""

    def not_relaxed_enough(self) -> list[str]:
        """Cells whose relaxed problem can't be shown in ball arithmetic to cover all their poles; needs `robustid[exact]`."""
        return []

    def verify(self, exact: bool = False) -> bool:
        """Evaluate all proofs again, from their numbers and those of the problem; no solver is involved.

        `exact` evaluates the certificates in ball arithmetic too, and what the problems of cells are relaxed by, for all poles
        between their ends (`robustid[exact]`); the arrays of the problems, and the polygons of the certificates, are taken as they
        are in double precision.
        """
        exact = as_flag("exact", exact)
        if not self.supported or (exact and self.not_relaxed_enough()):
            return False
        with threads_for(self.problem.coefficients):
            return all(claim.verify(exact) for claim in self.claims())

    @functools.cached_property
    def _nominal(self) -> Complex:
        return self.problem.plane.values_at(self.model, self.omega)

    @functools.cached_property
    def _union(self) -> tuple[Real, Real]:
        upper, magnitude = union_of(self.kept, self._nominal, self.omega)
        return freeze(upper), freeze(self.problem.entries.as_given(magnitude))

    @functools.cached_property
    def nominal(self) -> Complex:
        """Response of the model at the frequencies, (F,) complex; MIMO: (F, ny, nu)."""
        return freeze(self.problem.entries.as_given(self._nominal))

    @property
    def upper(self) -> Real:
        """Guaranteed bound of |F - model| over all systems F, of every entry, (F, ny, nu); inf where a cell is too wide for one."""
        return self._union[0]

    @property
    def lower(self) -> Real:
        """Error of systems that were found, (F, ny, nu): no bound can be smaller; 0 where none was."""
        return freeze(np.zeros(self.upper.shape))

    @property
    def sigma_lower(self) -> Real:
        """Largest singular value of F - model of systems that were found, (F,); 0 where none was."""
        return freeze(np.zeros(self.omega.size))

    @property
    def magnitude(self) -> Real:
        """Guaranteed range of |F|, (F, 2); MIMO: of every entry, (F, ny, nu, 2)."""
        return self._union[1]

    @property
    def sigma_upper(self) -> Real:
        """Guaranteed bound of the largest singular value of F - model, (F,): the norm of the matrix `upper`."""
        return freeze(norm_of_bounds(self.upper))

    @property
    def relative(self) -> RelativeErrors:
        """Bounds at the frequencies of the data as shares of the response of the model, with their median."""
        upper = self.sigma_upper
        return relative_errors(self.problem, self.omega, upper, self._nominal, np.isfinite(upper))

    def hull(self, entry: Entry = (0, 0)) -> list[Complex] | None:
        """At every frequency, points whose convex hull holds an entry of every system; None where a cell is too wide for it."""
        return hulls_of(self.kept, self.omega, entry)

    def with_model(self, model: control.StateSpace) -> Self:
        """Return the same guarantees around another nominal; nothing is solved anew."""
        return dataclasses.replace(self, model=check_nominal(model, self.problem))

    @property
    def known_circle(self) -> CircleBound | None:
        """The smallest bound on the circle that has been found so far; None as long as there is none."""
        return self._circle.bound

    @property
    def circle(self) -> CircleBound:
        """The smallest bound on the whole circle that `on_circle` has found; before, that of sums, narrowed by the polygons."""
        return self._by_sums if self.known_circle is None else self.known_circle

    @property
    def _box(self) -> Box | None:
        """Pole-uncertainty box of all cells, modes by rising frequency; None: poles as stated."""
        return None

    @functools.cached_property
    def _by_sums(self) -> CircleBound:
        """The bound on the whole circle by linear certificates, without a solver, and by the polygons where they are smaller."""
        plane, bands = self.problem.plane, self._discs(without_long_records(self.problem))
        if not all(np.all(np.isfinite(one.radius)) for one in bands.bands):
            bands = self._discs(self.problem)
        low, high = bands.bands[0].angles[[0, -1]]
        angles = plane.angles(self.omega)
        inside = (angles >= low) & (angles <= high)
        bounds = np.minimum(self.upper[inside], bands.errors_at(self.model, angles[inside]).bound)
        corners = (angles[inside], bounds) if inside.sum() > 1 else None
        return whole_axis(bands, self.model, corners, float(self.sigma_lower.max()))

    def _discs(self, problem: MixedProblem) -> EntryBands:
        """Discs by sums over the samples of a problem."""
        return EntryBands(problem, discs_of_entries(problem, self._box, self.omega, _KNOTS, Budget()))

    def weight(
        self, *, kind: str = "additive", order: int | None = None, below: float | None = None
    ) -> UncertaintyWeight:
        """Stable minimum-phase W above the error on the whole circle, of the smallest order that follows it.

        See `uncertainty_weight`; the bound is `circle`, its arcs joined where it hardly changes. Of classes without a gain bound
        that of ``on_circle(0.3, everywhere=True)``, unless one is known.
        """
        self._without_sums()
        return super().weight(kind=kind, order=order, below=below)

    def _without_sums(self) -> None:
        """Bound the circle for a weight where the class has no gain bound, and so no sums."""
        if not self.problem.dt:
            check_gain(self.problem, "a weight up to infinity")
        if self.problem.prior.positive_real and self.known_circle is None:
            self.on_circle(0.3, everywhere=True)

    def on_circle(
        self,
        rtol: float = 0.05,
        *,
        everywhere: bool = False,
        executor: Processes = None,
        progress: Progress | None = None,
        resume: Folder | None = None,
        time_limit: float | None = None,
    ) -> CircleBound:
        """Rigorous bound of |F - model| on the whole circle, by adaptive refinement; MIMO: of its singular values.

        Between two frequencies |E| is at most the larger of its bounds there plus h^2/8 max|E''|, h the arc between them; arcs
        that set the maximum are halved. For bounds of the second derivative see `Curvature`. Of several cells, each by itself, with
        what the relaxation of its problem leaves out: the largest on every arc. Where cells are wide beside the damping that is far
        above the bounds at the frequencies: bound the box with more `cells` then.

        Parameters
        ----------
        rtol : float
            Tolerance of the largest bound, relative to the largest error at a frequency.
        everywhere : bool
            Hold every arc to the tolerance, relative to the bounds at its own ends: for a weight that follows the error.
        executor, progress, resume : optional
            As in `worst_case_error`; of several cells `progress` counts these.
        time_limit : float, optional
            Seconds; then, and on Ctrl-C, the bound so far is returned: it holds, and says that it has not converged. A further
            call goes on from there.

        Returns
        -------
        CircleBound

        Raises
        ------
        InputError
            If a time limit has left parameters without intervals (see `completed`), or a cell is so wide that no sample says
            anything of all its poles at once.
        """
        rtol, everywhere = as_positive("rtol", rtol), as_flag("everywhere", everywhere)
        found = self._refined(rtol, everywhere, Means(executor, progress, resume, Budget(time_limit)))
        self._circle.take(found)  # for `hinf` and `save`, from now on
        return found

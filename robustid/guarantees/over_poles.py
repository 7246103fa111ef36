"""worst_case_over_poles(): the guarantee where the poles themselves are known up to a pole-uncertainty box only."""

from __future__ import annotations

import dataclasses
import logging
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from robustid.core import (
    Budget,
    Complex,
    Frozen,
    Progress,
    Real,
    Savable,
    as_count,
    as_flag,
    as_kind,
    as_positive,
    freeze,
    threads_for,
)
from robustid.errors import InconsistentDataError, InputError, InputTypeError
from robustid.figures import Drawable
from robustid.guarantees.circle import CircleBound, Remembered
from robustid.guarantees.consistent_set import which
from robustid.guarantees.exact_cells import relaxed_enough
from robustid.guarantees.nominal import as_frequencies, as_nominal
from robustid.guarantees.pole_cells import AMPLITUDE, PoleCell, box_of
from robustid.guarantees.pole_proofs import KeptCell, RefutedCell, union_of
from robustid.guarantees.pole_sweep import affordable, bounded, default_frequencies, searched
from robustid.guarantees.sweep import Folder, Known, Processes
from robustid.guarantees.value_set import RefutationClaim, SupportClaim, gap_of, norm_of_bounds
from robustid.identification import Identification

if TYPE_CHECKING:
    import control

_log = logging.getLogger("robustid")

_SEARCH = 1 / 3  # of a time limit, after which cells are split no further
_AGAIN = 1 + 1e-9  # what bounds may differ by, relatively, when they are computed again elsewhere


@dataclasses.dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class WorstCaseOverPoles(Frozen, Drawable, Savable):
    """Largest distance from a model, and magnitudes, of all consistent systems whose poles lie anywhere in a pole-uncertainty box.

    Attributes
    ----------
    identification : Identification
    model : control.StateSpace
    omega : (F,) array, rad/s
    upper : (F, ny, nu) array
        Proved bound of |F - model|, of every entry; inf where the pole-uncertainty box is too wide for a bound.
    magnitude : (F, 2) array; MIMO: (F, ny, nu, 2)
        Proved range of |F|, of every entry.
    box : PoleCell
        As it was stated, with the amplitudes that are assumed.
    kept : tuple of KeptCell
        The parts of it that may contain the poles, with the certificates of their bounds.
    refuted : tuple of RefutedCell
        Those that are proved not to.
    """

    identification: Identification
    model: control.StateSpace
    omega: Real
    upper: Real
    magnitude: Real
    box: PoleCell
    kept: tuple[KeptCell, ...]
    refuted: tuple[RefutedCell, ...]
    _circle: Remembered = dataclasses.field(init=False, default_factory=Remembered)

    def __post_init__(self) -> None:
        self._set(
            **{name: freeze(getattr(self, name)) for name in ("omega", "upper", "magnitude")}, _circle=Remembered()
        )

    @property
    def cells(self) -> tuple[PoleCell, ...]:
        """Cells that may contain the poles."""
        return tuple(item.cell for item in self.kept)

    @property
    def certified(self) -> bool:
        """Return whether every bound has its certificate and every certificate, evaluated anew, supports it."""
        return self.verify()

    def verify(self, exact: bool = False) -> bool:
        """Evaluate all proofs again, from their numbers and those of the problem; no solver is involved.

        The cells must leave out no part of the box, the certificates of each must hold for its relaxed problem, made anew, and the
        bounds follow from them. `exact` evaluates the certificates in ball arithmetic too, and what the problems are relaxed by,
        for all poles between the ends of each cell (`robustid[exact]`); the arrays of the problems, and the polygons of the
        certificates, are taken as they are in double precision.
        """
        if not (self.covered and self.supported) or (exact and self.not_relaxed_enough()):
            return False
        with threads_for(self.identification.problem.coefficients):
            return all(claim.verify(exact) for claim in self.claims())

    def not_relaxed_enough(self) -> list[str]:
        """Cells whose relaxed problem can't be shown in ball arithmetic to cover all their poles; needs `robustid[exact]`."""
        cells = [item.cell for item in (*self.kept, *self.refuted)]
        problem = self.identification.problem
        return [
            f"cell {number}, expansion about its middle"
            for number, cell in enumerate(cells, start=1)
            if not relaxed_enough(cell, problem, self.omega)
        ]

    def claims(self) -> Iterator[SupportClaim | RefutationClaim]:
        """Every inequality that is stated of a cell, with its certificate."""
        for number, item in enumerate((*self.kept, *self.refuted), start=1):
            yield from item.claims(self.identification.problem, f"cell {number}")

    @property
    def claim_count(self) -> int:
        """Number of `claims`."""
        return len(self.refuted) + sum(len(v.certificates) for item in self.kept for v in item.values)

    @property
    def covered(self) -> bool:
        """Return whether the cells, kept and refuted, cover the box, and assume no smaller amplitudes than are stated."""
        box, cells = self.box, [*self.cells, *(item.cell for item in self.refuted)]
        try:
            stated = box_of(self.identification, box.omega, box.damping, box.delay)
        except (InputError, InputTypeError):
            return False
        alike = all(c.delay == box.delay and c.dt == stated.dt for c in (box, *cells))
        enough = all(np.all(stated.amplitude <= c.amplitude * _AGAIN) for c in cells)
        return alike and enough and box.covered_by(cells)

    @property
    def supported(self) -> bool:
        """Return whether the polygons of the kept cells give the stated bounds, and there are data that can refute the others."""
        problem = self.identification.problem
        if not self.kept or not all(item.is_about(problem, self.omega) for item in (*self.kept, *self.refuted)):
            return False
        upper, magnitude = _bounds(self.kept, self.model, self.omega, self.identification)
        if (self.upper.shape, self.magnitude.shape) != (upper.shape, magnitude.shape):
            return False
        below = np.all(upper <= self.upper * _AGAIN) and np.all(magnitude[..., 1] <= self.magnitude[..., 1] * _AGAIN)
        return bool(below and np.all(self.magnitude[..., 0] <= magnitude[..., 0] * _AGAIN))

    @property
    def sigma_upper(self) -> Real:
        """Proved bound of the largest singular value of F - model, (F,): the norm of the matrix `upper`."""
        return norm_of_bounds(self.upper)

    @property
    def nominal(self) -> Complex:
        """Response of the model, (F, ny, nu)."""
        return self.identification.problem.plane.values_at(self.model, self.omega)

    @property
    def next_line(self) -> float:
        """Frequency with the largest bound, rad/s: a frequency point there shrinks it most."""
        return float(self.omega[int(np.argmax(self.sigma_upper))])

    @property
    def poles(self) -> tuple[Real, Real]:
        """Smallest box around the cells that are left: natural frequencies (M, 2) in rad/s and damping ratios (M, 2)."""
        return tuple(
            np.stack(
                [
                    np.min([getattr(c, name)[:, 0] for c in self.cells], axis=0),
                    np.max([getattr(c, name)[:, 1] for c in self.cells], axis=0),
                ],
                axis=1,
            )
            for name in ("omega", "damping")
        )  # type: ignore[return-value]

    @property
    def too_wide(self) -> str:
        """Modes, in words, whose cells are too wide for a bound at some frequency; empty where none is."""
        rest = sum(cell.remainder(self.omega) for cell in self.cells)
        away = ~np.isfinite(rest).reshape(*np.shape(rest)[:2], -1).all(axis=(0, 2))
        numbers = [str(mode) for mode in np.flatnonzero(away) + 1]
        return "" if not numbers else f"mode{'s' * (len(numbers) > 1)} {' and '.join(numbers)}"

    def with_model(self, model: control.StateSpace) -> WorstCaseOverPoles:
        """Return the same guarantees around another nominal; nothing is solved anew."""
        model = as_nominal(model, self.identification)
        upper, magnitude = _bounds(self.kept, model, self.omega, self.identification)
        return dataclasses.replace(self, model=model, upper=upper, magnitude=magnitude)

    def on_circle(
        self,
        rtol: float = 0.05,
        *,
        everywhere: bool = False,
        executor: Processes = None,
        progress: Progress | None = None,
        time_limit: float | None = None,
    ) -> CircleBound:
        """Rigorous bound of |F - model| on the whole circle over all poles in the box; MIMO: of its singular values.

        For every cell that may contain the poles the bound of its relaxed problem, as of `WorstCaseError.on_circle`, and what
        the relaxation leaves out; the largest over the cells. Where cells are wide beside the damping, far above the bounds at
        the frequencies: bound the box with more `cells` then.

        Parameters
        ----------
        rtol, everywhere, executor, time_limit : optional
            As in `WorstCaseError.on_circle`.
        progress : callable (text, done, count), optional
            Cells.

        Raises
        ------
        InputError
            A cell is so wide that no sample says anything of all its poles at once.
        """
        from robustid.guarantees.pole_sweep import circle_over_poles

        rtol, everywhere = as_positive("rtol", rtol), as_flag("everywhere", everywhere)
        budget, problem = (
            Budget(time_limit, progress, "bounding the error between the frequencies"),
            self.identification.problem,
        )
        found = circle_over_poles(
            problem, self.kept, self.model, self.omega, rtol, everywhere=everywhere, executor=executor, budget=budget
        )
        self._circle.take(found)
        return found

    @property
    def circle(self) -> CircleBound:
        """The smallest bound that `on_circle` has found."""
        if self._circle.bound is None:
            raise InputError("nothing is known of the whole circle yet: call `on_circle`, which takes a while, before")
        return self._circle.bound

    def __repr__(self) -> str:
        return (
            f"<WorstCaseOverPoles: {self.omega.size} frequencies, {len(self.cells)} cells of poles left,"
            f" {len(self.refuted)} refuted>"
        )

    def summary(self) -> str:
        """The result in plain text."""
        problem, largest = self.identification.problem, self.sigma_upper
        known, relative = np.isfinite(largest), largest / np.linalg.norm(self.nominal, 2, axis=(1, 2))
        lines: list[str] = []
        if known.any():
            part = "" if known.all() else f" at {known.sum()} of {known.size} frequencies"
            lines.append(
                "guarantee  every consistent system with poles in the pole-uncertainty box is within"
                f" {largest[known].max():.4g} of the model{part} (median {100 * np.median(relative[known]):.3g} % of the response)"
            )
        if not known.all():
            ends = dict.fromkeys(f"{w / (2 * np.pi):.5g}" for w in self.omega[~known][[0, -1]])
            lines.append(
                f"open       nothing is guaranteed at {(~known).sum()} of {known.size} frequencies, {' to '.join(ends)} Hz: a cell"
                f" of the box{self.too_wide and f' ({self.too_wide})'} is too wide there; it takes more cells, more time, or a"
                " measurement there"
            )
        if not problem.entries.single:
            _, output, input = map(int, np.unravel_index(np.argmax(self.upper), self.upper.shape))
            lines.append("norm       largest singular value of F - model, from the bounds of its entries")
            if known.all():
                lines.append(f"entry      at most {self.upper.max():.4g}{which(problem, (output, input))}")
        lines.append(f"poles      {len(self.cells)} cells may contain them, {len(self.refuted)} are proved not to")
        stated = self.box.omega, self.box.damping
        for number, (w, d, *whole) in enumerate(zip(*self.poles, *stated, strict=True), start=1):
            lines.append(f"mode {number}     {_interval(w, d)}; the box: {_interval(*whole)}")
        lines += [
            f"next       measure around {self.next_line / (2 * np.pi):.5g} Hz: the bound is largest there",
            "assumed    gain bound, decay rate, the number of modes, poles inside the box, amplitudes of the modes at most"
            f" {AMPLITUDE:g} times the model's, bounds of the samples: data can refute them, never prove them",
        ]
        return "\n".join(lines)


def _bounds(
    kept: tuple[KeptCell, ...], model: control.StateSpace, omega: Real, identification: Identification
) -> tuple[Real, Real]:
    """Error and magnitude over all cells, around a model, as they are stated."""
    problem = identification.problem
    upper, magnitude = union_of(kept, problem.plane.values_at(model, omega), omega)
    return upper, problem.entries.as_given(magnitude)


def _interval(omega: Real, damping: Real) -> str:
    low, high = omega / (2 * np.pi)
    return f"{low:.6g} to {high:.6g} Hz, damping {damping[0]:.5g} to {damping[1]:.5g}"


def worst_case_over_poles(
    identification: Identification,
    omega_interval: ArrayLike,
    damping_interval: ArrayLike,
    *,
    delay: int = 1,
    model: control.StateSpace | None = None,
    omega: ArrayLike | None = None,
    directions: int = 8,
    rtol: float = 0.1,
    cells: int = 32,
    executor: Processes = None,
    progress: Progress | None = None,
    resume: Folder | None = None,
    time_limit: float | None = None,
    known: Known | None = None,
) -> WorstCaseOverPoles:
    """Guaranteed error of a model over all consistent systems whose poles lie in a pole-uncertainty box: the union over its cells.

    Poles that were taken from data carry a pole-uncertainty box: what the data leave to them (`suggest_kautz`). A margin below 1
    does not validate them, and the band at the suggested poles does not cover the others. Here each cell of the box is relaxed to a
    convex problem that every system with poles inside solves (`PoleCell`); cells that are proved inconsistent are left out.

    In continuous time too. MIMO: all entries have the poles in common, each has its own residues; every entry is bounded, and with
    them the largest singular value of F - model (`sigma_upper`).

    Parameters
    ----------
    identification : Identification
        Of a problem whose parametric part is one `kautz` pair per mode, poles in the pole-uncertainty box.
    omega_interval, damping_interval : (M, 2) arrays
        Ends per mode, rad/s and 1; `KautzSuggestion.omega_interval` and `.damping_interval`.
    delay : int, samples
        Of the pairs, in discrete time.
    model, omega, directions, rtol, executor, progress, resume, known
        As in `worst_case_error`. Default `omega`: 24 frequencies, and the modes.
    cells : int
        Cells at most.
    time_limit : float, optional
        Seconds; cells are split no further after a third of it, nor where so many can't be bounded at 24 frequencies. At the end
        the result has the frequencies that are finished in all cells, spread over the range. So it has on Ctrl-C without `resume`.

    Returns
    -------
    WorstCaseOverPoles

    Raises
    ------
    InputError
        Intervals that are empty, not of the number of modes or do not hold the poles of the identification, pairs of another delay,
        time records with other than zero initial conditions.
    InconsistentDataError
        No system with poles in the pole-uncertainty box fits the data: all cells are refuted.

    Notes
    -----
    Assumes the number of modes, and amplitudes at most twice those of the identified model. MIMO: of every entry; in an entry where
    the model hardly has a mode, at most what its other entries, as a matrix of rank one, suggest.

    Examples
    --------
    >>> import robustid as rid
    >>> data = rid.datasets.flexible_structure(lines=5, samples=2, extra_hz=[17.6, 17.7])
    >>> modes = rid.kautz(*data.modes.T, dt=0.01, delay=1)
    >>> prior = rid.Prior(gain_bound=0.1, decay_rate=1.3)
    >>> result = rid.identify(rid.MixedProblem(frequency=data.frequency, prior=prior, parametric=modes))
    >>> box = data.modes[:, :1] * [0.999, 1.001], data.modes[:, 1:] * [0.95, 1.05]
    >>> band = rid.guarantee.worst_case_over_poles(result, *box, omega=[30.0], directions=4, cells=1)
    >>> bool(rid.worst_case_error(result, omega=[30.0]).lower[0, 0, 0] <= band.upper[0, 0, 0] < 0.5), band.certified
    (True, True)
    """
    as_kind("identification", identification, Identification, "an Identification")
    whole = box_of(identification, omega_interval, damping_interval, as_count("delay", delay))
    problem, model = identification.problem, as_nominal(model, identification)
    cells, directions = as_count("cells", cells, least=1), as_count("directions", directions, least=3)
    gap = gap_of(as_positive("rtol", rtol), directions, problem.entries.single)
    grid = default_frequencies(problem, whole) if omega is None else as_frequencies(omega, problem)
    budget = Budget(time_limit)
    with threads_for(problem.coefficients):
        sets, refuted = searched(problem, whole, grid, cells, budget.share(_SEARCH))
        most = affordable(sets, grid, (directions, gap), budget, model)
        if most < sum(consistent is not None for _, consistent in sets):
            sets, refuted = searched(problem, whole, grid, most, budget.share(_SEARCH))
    if not sets:
        raise InconsistentDataError(
            f"no system with poles in the pole-uncertainty box fits the data: all {len(refuted)} cells of it are refuted; loosen"
            " the bounds, the prior or the box"
        )
    kept, grid = bounded(sets, grid, (directions, gap), (executor, progress, resume), budget, model, known)
    upper, magnitude = _bounds(kept, model, grid, identification)
    return WorstCaseOverPoles(
        identification=identification,
        model=model,
        omega=grid,
        upper=upper,
        magnitude=magnitude,
        box=whole,
        kept=kept,
        refuted=tuple(refuted),
    )

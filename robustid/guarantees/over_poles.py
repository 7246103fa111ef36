"""worst_case_over_poles(): the guarantee where the poles themselves are known up to a pole-uncertainty box only."""

from __future__ import annotations

import contextlib
import dataclasses
import logging
import pathlib
from collections.abc import Iterator
from typing import Any

import numpy as np

from robustid.core import (
    Frozen,
    Progress,
    Real,
    Savable,
    as_count,
    as_kind,
    as_positive,
    freeze,
    response,
    threads_for,
    worker_pool,
)
from robustid.errors import InconsistentDataError, InputError, InputTypeError
from robustid.figures import Drawable
from robustid.guarantees.consistent_set import ConsistentSet, SupportClaim, set_of
from robustid.guarantees.nominal import as_frequencies, as_nominal, check_siso
from robustid.guarantees.pole_cells import AMPLITUDE, PoleCell, box_of
from robustid.guarantees.pole_proofs import KeptCell, RefutationClaim, RefutedCell, posed_relaxation, union_of
from robustid.guarantees.spread import Spread
from robustid.guarantees.sweep import Folder, value_sets
from robustid.identification import Identification, MixedProblem, prove_margin

_log = logging.getLogger("robustid")

_MATTERS = 0.25  # part of the smallest bound that the relaxation may cost before a cell is split
_AGAIN = 1 + 1e-9  # what bounds may differ by, relatively, when they are computed again elsewhere


@dataclasses.dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class WorstCaseOverPoles(Frozen, Drawable, Savable):
    """Largest distance from a model, and magnitudes, of all consistent systems whose poles lie anywhere in a pole-uncertainty box.

    Attributes
    ----------
    identification : Identification
    model : control.StateSpace
    omega : (F,) array, rad/s
    upper : (F, 1, 1) array
        Proved bound of |F - model|; inf where the pole-uncertainty box is too wide for a bound.
    magnitude : (F, 2) array
        Proved range of |F|.
    box : PoleCell
        As it was stated, with the amplitudes that are assumed.
    kept : tuple of KeptCell
        The parts of it that may contain the poles, with the certificates of their bounds.
    refuted : tuple of RefutedCell
        Those that are proved not to.
    """

    identification: Identification
    model: Any
    omega: Real
    upper: Real
    magnitude: Real
    box: PoleCell
    kept: tuple[KeptCell, ...]
    refuted: tuple[RefutedCell, ...]

    def __post_init__(self) -> None:
        self._set(**{name: freeze(getattr(self, name)) for name in ("omega", "upper", "magnitude")})

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
        bounds follow from them. `exact` evaluates the certificates in ball arithmetic too (`robustid[exact]`).
        """
        if not (self.covered and self.supported):
            return False
        with threads_for(self.identification.problem.coefficients):
            return all(claim.verify(exact) for claim in self.claims())

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
        angles = self.omega * problem.dt
        upper, magnitude = union_of(self.kept, response(self.model, angles), angles)
        if (self.upper.shape, self.magnitude.shape) != ((*upper.shape, 1, 1), magnitude.shape):
            return False
        above = upper <= self.upper[:, 0, 0] * _AGAIN, magnitude[:, 1] <= self.magnitude[:, 1] * _AGAIN
        return bool(np.all(above) and np.all(self.magnitude[:, 0] <= magnitude[:, 0] * _AGAIN))

    @property
    def next_line(self) -> float:
        """Frequency with the largest bound, rad/s: a frequency point there shrinks it most."""
        return float(self.omega[int(np.argmax(self.upper[:, 0, 0]))])

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

    def with_model(self, model: Any) -> WorstCaseOverPoles:
        """Return the same guarantees around another nominal; nothing is solved anew."""
        model, angles = as_nominal(model, self.identification), self.omega * self.identification.problem.dt
        upper, magnitude = union_of(self.kept, response(model, angles), angles)
        return dataclasses.replace(self, model=model, upper=upper.reshape(-1, 1, 1), magnitude=magnitude)

    def __repr__(self) -> str:
        return (
            f"<WorstCaseOverPoles: {self.omega.size} frequencies, {len(self.cells)} cells of poles left,"
            f" {len(self.refuted)} refuted>"
        )

    def summary(self) -> str:
        """The result in plain text."""
        response_size = np.abs(response(self.model, self.omega * self.identification.problem.dt))
        relative = self.upper[:, 0, 0] / response_size
        lines = [
            f"guarantee  every consistent system with poles in the pole-uncertainty box is within {self.upper.max():.4g} of the"
            f" model (median {100 * np.median(relative):.3g} % of the response)",
            f"poles      {len(self.cells)} cells may contain them, {len(self.refuted)} are proved not to",
        ]
        stated = self.box.omega, self.box.damping
        for number, (w, d, *whole) in enumerate(zip(*self.poles, *stated, strict=True), start=1):
            lines.append(f"mode {number}     {_interval(w, d)}; the box: {_interval(*whole)}")
        lines += [
            f"next       measure around {self.next_line / (2 * np.pi):.5g} Hz: the bound is largest there",
            "assumed    gain bound, decay rate, the number of modes, poles inside the box, amplitudes of the modes at most"
            f" {AMPLITUDE:g} times the model's, bounds of the samples: data can refute them, never prove them",
        ]
        return "\n".join(lines)


def _interval(omega: Real, damping: Real) -> str:
    low, high = omega / (2 * np.pi)
    return f"{low:.6g} to {high:.6g} Hz, damping {damping[0]:.3g} to {damping[1]:.3g}"


def worst_case_over_poles(
    identification: Identification,
    omega_interval: Any,
    damping_interval: Any,
    *,
    delay: int = 1,
    model: Any = None,
    omega: Any = None,
    directions: int = 8,
    rtol: float = 0.1,
    cells: int = 32,
    executor: Spread = None,
    progress: Progress | None = None,
    resume: Folder | None = None,
) -> WorstCaseOverPoles:
    """Guaranteed error of a model over all consistent systems whose poles lie in a pole-uncertainty box: the union over its cells.

    Poles that were taken from data carry a pole-uncertainty box: what the data leave to them (`suggest_kautz`). A margin below 1
    does not validate them, and the band at the suggested poles does not cover the others. Here each cell of the box is relaxed to a
    convex problem that every system with poles inside solves (`PoleCell`); cells that are proved inconsistent are left out.

    Parameters
    ----------
    identification : Identification
        Of a problem whose parametric part is one `kautz` pair per mode, poles in the pole-uncertainty box.
    omega_interval, damping_interval : (M, 2) arrays
        Ends per mode, rad/s and 1; `KautzSuggestion.omega_interval` and `.damping_interval`.
    delay : int, samples
        Of the pairs.
    model, omega, directions, rtol, executor, progress, resume
        As in `worst_case_error`. Default `omega`: 24 frequencies, and the modes.
    cells : int
        Cells at most.

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
    Assumes the number of modes, and amplitudes at most twice those of the identified model.

    Examples
    --------
    >>> import robustid as rid
    >>> data = rid.flexible_structure(lines=5, samples=2, extra_hz=[17.6, 17.7])
    >>> modes = rid.kautz(*data.modes.T, dt=0.01, delay=1)
    >>> prior = rid.Prior(gain_bound=0.1, decay_rate=1.3)
    >>> result = rid.identify(rid.MixedProblem(frequency=data.frequency, prior=prior, parametric=modes))
    >>> box = data.modes[:, :1] * [0.999, 1.001], data.modes[:, 1:] * [0.95, 1.05]
    >>> band = rid.worst_case_over_poles(result, *box, omega=[30.0], directions=4, cells=1)
    >>> bool(rid.worst_case_error(result, omega=[30.0]).lower[0, 0, 0] <= band.upper[0, 0, 0] < 0.5), band.certified
    (True, True)
    """
    as_kind("identification", identification, Identification, "an Identification")
    check_siso(identification.problem, "worst_case_over_poles")
    whole = box_of(identification, omega_interval, damping_interval, as_count("delay", delay))
    problem, model = identification.problem, as_nominal(model, identification)
    cells, directions = as_count("cells", cells, least=1), as_count("directions", directions, least=3)
    gap = min(as_positive("rtol", rtol) / 5, 0.5 * (1 / np.cos(np.pi / directions) - 1))
    grid = default_frequencies(problem, whole) if omega is None else as_frequencies(omega, problem)
    with threads_for(problem.coefficients):
        sets, refuted = _search(problem, whole, grid, cells)
    if not sets:
        raise InconsistentDataError(
            f"no system with poles in the pole-uncertainty box fits the data: all {len(refuted)} cells of it are refuted; loosen"
            " the bounds, the prior or the box"
        )
    kept = _bounded(sets, grid, (directions, gap), executor, progress, resume)
    upper, magnitude = union_of(kept, response(model, grid * problem.dt), grid * problem.dt)
    return WorstCaseOverPoles(
        identification=identification,
        model=model,
        omega=grid,
        upper=upper.reshape(-1, 1, 1),
        magnitude=magnitude,
        box=whole,
        kept=kept,
        refuted=tuple(refuted),
    )


def default_frequencies(problem: MixedProblem, whole: PoleCell) -> Real:
    """Over the range of the frequency points, and at the modes."""
    top = np.pi / problem.dt
    lines = np.concatenate([np.zeros(0), *(f.omega for f in problem.frequency)])
    low, high = (lines.min(), lines.max()) if lines.size else (top / 200, top)
    return np.unique(np.clip(np.concatenate([np.linspace(low, high, 24), whole.omega.mean(axis=1)]), 0, top))


def _search(
    problem: MixedProblem, whole: PoleCell, grid: Real, limit: int
) -> tuple[list[tuple[PoleCell, ConsistentSet | None]], list[RefutedCell]]:
    """Split cells until their relaxation costs little; leave out what is refuted."""
    smallest = min([float(f.bound.inner_radius.min()) for f in problem.frequency] + _time_bounds(problem))
    waiting = [whole]
    kept: list[tuple[PoleCell, ConsistentSet | None]] = []
    refuted: list[RefutedCell] = []
    angles = np.concatenate([grid * problem.dt, *(f.omega * problem.dt for f in problem.frequency)])
    while waiting:
        # The widest cell first, so that the number of cells that are allowed goes where it matters.
        costs = [float(c.remainder(angles).sum(axis=1).max()) for c in waiting]
        widest = int(np.argmax(costs))
        cell = waiting.pop(widest)
        posed = posed_relaxation(cell, problem)
        claim, passed = (None, []) if posed is None else prove_margin(posed.data, "structured", 1e-3)
        if claim is not None and claim.certificate.value > 1:
            refuted.append(RefutedCell(cell, claim.certificate))
            continue
        if costs[widest] > _MATTERS * smallest and len(waiting) + len(kept) + 2 <= limit:
            waiting += cell.split(problem, grid)
            continue
        consistent = None
        if posed is not None and claim is not None:
            consistent = set_of(posed, max(1.0, claim.margin * (1 + 1e-3)), passed)
        kept.append((cell, consistent))
        _log.info("%d cells kept, %d refuted, %d waiting", len(kept), len(refuted), len(waiting))
    return kept, refuted


def _bounded(
    sets: list[tuple[PoleCell, ConsistentSet | None]],
    grid: Real,
    settings: tuple[int, float],
    executor: Spread,
    progress: Progress | None,
    resume: Folder | None,
) -> tuple[KeptCell, ...]:
    """The values of every cell; one pool of processes, one count and one folder for all of them."""
    count = grid.size * sum(consistent is not None for _, consistent in sets)
    kept: list[KeptCell] = []

    def counted(done: int, _: int) -> None:
        if progress is not None:
            progress(sum(len(item.values) for item in kept) + done, count)

    with contextlib.ExitStack() as stack:
        if isinstance(executor, int):
            executor = stack.enter_context(worker_pool(as_count("executor", executor, least=1)))
        for number, (cell, consistent) in enumerate(sets, start=1):
            folder = None if resume is None else pathlib.Path(resume) / f"cell-{number}"
            found = [] if consistent is None else value_sets(consistent, grid, *settings, executor, counted, folder)
            kept.append(KeptCell(cell, tuple(found)))
    return tuple(kept)


def _time_bounds(problem: MixedProblem) -> list[float]:
    return [float(t.bound.radius.min()) / max(float(np.abs(t.u).max()), np.finfo(float).tiny) for t in problem.time]

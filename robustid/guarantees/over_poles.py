"""worst_case_over_poles(): the guarantee where the poles themselves are known up to a pole-uncertainty box only."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from robustid.core import (
    Budget,
    Progress,
    Real,
    as_count,
    as_kind,
    as_positive,
    counted,
    freeze,
    hz_span,
    hz_words,
    one_thread,
    rounded_up,
    threads_for,
)
from robustid.errors import InconsistentDataError, InputError, InputTypeError
from robustid.guarantees.amplitude_bounds import amplitudes_proved
from robustid.guarantees.circle import CircleBound
from robustid.guarantees.consistent_set import which
from robustid.guarantees.exact_cells import relaxed_enough
from robustid.guarantees.linear.functions import Box
from robustid.guarantees.nominal import as_frequencies, as_nominal
from robustid.guarantees.over_cells import WorstCase
from robustid.guarantees.pole_cells import PoleCell, box_of
from robustid.guarantees.pole_proofs import Claim, KeptCell, RefutedBySums, RefutedCell, SummedCell
from robustid.guarantees.pole_sweep import affordable, bounded, circle_over_poles, default_frequencies, searched
from robustid.guarantees.stated_box import checked_box
from robustid.guarantees.sweep import Folder, Known, Means, Processes
from robustid.guarantees.value_set import gap_of
from robustid.guarantees.worst_case_result import WorstCaseError
from robustid.identification import Identification, MixedProblem

if TYPE_CHECKING:
    import control

_SEARCH = 1 / 3  # of a time limit, after which cells are split no further


@dataclasses.dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class WorstCaseOverPoles(WorstCase):
    """Largest distance from a model, and magnitudes, of all consistent systems whose poles lie anywhere in a pole-uncertainty box.

    Attributes
    ----------
    identification : Identification
    model : control.StateSpace
    omega : (F,) array, rad/s
    box : PoleCell
        As it was stated, with proved bounds of the amplitudes of its modes.
    kept : tuple of KeptCell or SummedCell
        The parts of it that may contain the poles, with the certificates of their bounds, of programs or sums. Those that have
        values at a frequency cover the box, with those that are refuted; at another one they may be others.
    refuted : tuple of RefutedCell or RefutedBySums
        Those that are proved not to.
    """

    identification: Identification
    kept: tuple[KeptCell | SummedCell, ...]
    box: PoleCell
    refuted: tuple[RefutedCell | RefutedBySums, ...]

    def __post_init__(self) -> None:
        self._set(omega=freeze(self.omega))

    @property
    def problem(self) -> MixedProblem:
        """Statement that the systems are consistent with, but for its poles."""
        return self.identification.problem

    @property
    def cells(self) -> tuple[PoleCell, ...]:
        """Cells that may contain the poles: at the frequency with most of them."""
        return tuple(item.cell for item in max(self._covers, key=len))

    @functools.cached_property
    def _covers(self) -> tuple[tuple[KeptCell | SummedCell, ...], ...]:
        """Cells that stand together at a frequency, each way once."""
        every = (tuple(k for k, item in enumerate(self.kept) if not item.values or w in item.omega) for w in self.omega)
        return tuple(tuple(self.kept[k] for k in ways) for ways in dict.fromkeys(every))

    def not_relaxed_enough(self) -> list[str]:
        """Cells whose relaxed problem can't be shown in ball arithmetic to cover all their poles; needs `robustid[exact]`.

        Named too are entries whose amplitudes are not proved.
        """
        found: list[str] = []
        for number, item in enumerate((*self.kept, *self.refuted), start=1):
            proofs = item.cell.proofs
            found += [f"cell {number}, entry {one.samples.entry}" for one in proofs if not amplitudes_proved(one)]
            if isinstance(item, KeptCell | RefutedCell) and not relaxed_enough(item.cell, self.problem, self.omega):
                found.append(f"cell {number}, expansion about its middle")
        return found

    def claims(self) -> Iterator[Claim]:
        """Every inequality that is stated of a cell, with its certificate."""
        for number, item in enumerate((*self.kept, *self.refuted), start=1):
            yield from item.claims(self.problem, f"cell {number}")

    @property
    def claim_count(self) -> int:
        """Number of `claims`."""
        return sum(item.claim_count for item in (*self.kept, *self.refuted))

    @property
    def covered(self) -> bool:
        """Return whether cells of every frequency and those refuted cover the box.

        With no smaller amplitudes than are proved; of sums over cells their claims see to that.
        """
        box, problem = self.box, self.problem
        try:
            checked_box(self.identification, box.omega, box.damping, box.delay)
        except (InputError, InputTypeError):
            return False
        items, gone = (*self.kept, *self.refuted), [item.cell for item in self.refuted]
        relaxed = [item.cell for item in items if isinstance(item, KeptCell | RefutedCell)]
        alike = all(c.delay == box.delay and c.dt == problem.dt for c in (box, *(item.cell for item in items)))
        return (
            alike
            and all(cell.proved_again(problem) is not None for cell in relaxed)
            and all(box.covered_by([*(item.cell for item in cover), *gone]) for cover in self._covers)
        )

    @property
    def supported(self) -> bool:
        """Return whether the cells cover the box, those kept with closed polygons, and with data that can refute the others."""
        items = *self.kept, *self.refuted
        return bool(self.kept) and self.covered and all(item.is_about(self.problem, self.omega) for item in items)

    @property
    def next_line(self) -> float:
        """Frequency with the largest bound, rad/s: a frequency point there shrinks it most."""
        return float(self.omega[int(np.argmax(self.sigma_upper))])

    @property
    def poles(self) -> tuple[Real, Real]:
        """Smallest box around the cells that are left: natural frequencies (M, 2) in rad/s and damping ratios (M, 2)."""
        every = [np.array([getattr(cell, name) for cell in self.cells]) for name in ("omega", "damping")]
        omega, damping = (np.stack([ends[..., 0].min(axis=0), ends[..., 1].max(axis=0)], axis=1) for ends in every)
        return omega, damping

    @property
    def too_wide(self) -> str:
        """Modes, in words, whose cells are too wide for a bound at some frequency; empty where none is."""
        rest = sum(cell.remainder(self.omega) for cell in self.cells)
        away = ~np.isfinite(rest).reshape(*np.shape(rest)[:2], -1).all(axis=(0, 2))
        numbers = [str(mode) for mode in np.flatnonzero(away) + 1]
        return "" if not numbers else f"mode{'s' * (len(numbers) > 1)} {' and '.join(numbers)}"

    @property
    def _box(self) -> Box | None:
        order = np.argsort(self.box.omega.mean(axis=1), kind="stable")
        return self.box.omega[order], self.box.damping[order]

    def _refined(self, rtol: float, everywhere: bool, means: Means) -> CircleBound:
        return circle_over_poles(self.problem, self.cells, self.model, self.omega, rtol, everywhere, means)

    def __repr__(self) -> str:
        return (
            f"<WorstCaseOverPoles: {counted(self.omega.size, 'frequency')}, {counted(len(self.cells), 'cell')} of poles left,"
            f" {len(self.refuted)} refuted>"
        )

    def summary(self) -> str:
        """The result in plain text."""
        problem, largest = self.problem, self.sigma_upper
        known = np.isfinite(largest)
        lines: list[str] = []
        if known.any():
            part = "" if known.all() else f" at {known.sum()} of {known.size} frequencies"
            lines.append(
                "guarantee  every consistent system with poles in the pole-uncertainty box is within"
                f" {rounded_up(largest[known].max()):.4g} of the model{part} (median {self.relative.words})"
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
        lines.append(
            f"poles      {counted(len(self.cells), 'cell')} may contain them, {len(self.refuted)} are proved not to"
        )
        stated = self.box.omega, self.box.damping
        for number, (w, d, *whole) in enumerate(zip(*self.poles, *stated, strict=True), start=1):
            lines.append(f"mode {number}     {_interval(w, d)}; the box: {_interval(*whole)}")
        lines += [
            f"next       measure around {hz_words(self.next_line / (2 * np.pi))}: the bound is largest there",
            "assumed    gain bound, decay rate, the number of modes, poles inside the box, bounds of the samples: data can refute"
            " them, never prove them",
        ]
        return "\n".join(lines)


Bounded = WorstCaseError | WorstCaseOverPoles  # the worst case of one plant


def _interval(omega: Real, damping: Real) -> str:
    low, high = omega / (2 * np.pi)
    return f"{hz_span(low, high, 6)}, damping {damping[0]:.5g} to {damping[1]:.5g}"


@one_thread()
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
        time records with other than zero initial conditions; samples that bound no amplitude of some mode by itself (modes whose
        boxes are close), where the discs of `band` stand alone.
    InconsistentDataError
        No system with poles in the pole-uncertainty box fits the data: all cells are refuted.

    Notes
    -----
    Assumes the number of modes. Their amplitudes over every cell, in every entry, are bounded first, by sums over the samples that
    extract them, as those of `band`.

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
    grid = default_frequencies(problem, whole.omega) if omega is None else as_frequencies(omega, problem)
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
    means = Means(executor, progress, resume, budget)
    kept, grid = bounded(sets, grid, (directions, gap), means, model, known)
    return WorstCaseOverPoles(
        identification=identification, model=model, omega=grid, box=whole, kept=kept, refuted=tuple(refuted)
    )

"""worst_case_over_poles(): the guarantee where the poles themselves are known up to a box only."""

from __future__ import annotations

import concurrent.futures
import dataclasses
import logging
from typing import Any

import numpy as np

from robustid._arrays import Frozen, as_array, as_count, as_positive, freeze
from robustid.certify.consistent_set import set_of
from robustid.certify.pole_cells import PoleCell
from robustid.certify.sweep import Progress, value_sets
from robustid.certify.worst_case import as_frequencies, as_nominal
from robustid.errors import InputError, InputTypeError
from robustid.identification import Identification
from robustid.identification.forms import Posed, pose, sections_of
from robustid.identification.margin import prove_margin
from robustid.identification.simulation import response
from robustid.interpolation import MarginCertificate, MixedProblem

_log = logging.getLogger("robustid")

_AMPLITUDE = 2.0  # largest amplitude of a mode over that of the identified model: the stated safety factor
_MATTERS = 0.25  # part of the smallest bound that the relaxation may cost before a cell is split


@dataclasses.dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class PoleBand(Frozen):
    """What all consistent systems can do whose poles lie anywhere in a box.

    Attributes
    ----------
    identification : Identification
    model : control.StateSpace
    omega : (F,) array, rad/s
    upper : (F, 1, 1) array
        Proved bound of |F - model|; inf where the box is too wide for a bound.
    magnitude : (F, 2) array
        Proved range of |F|.
    cells : tuple of PoleCell
        That may contain the poles.
    refuted : tuple of (PoleCell, MarginCertificate)
        Proved not to.
    """

    identification: Identification
    model: Any
    omega: np.ndarray
    upper: np.ndarray
    magnitude: np.ndarray
    cells: tuple[PoleCell, ...]
    refuted: tuple[tuple[PoleCell, MarginCertificate], ...]

    def __post_init__(self) -> None:
        self._set(**{name: freeze(getattr(self, name)) for name in ("omega", "upper", "magnitude")})

    @property
    def next_line(self) -> float:
        """Frequency with the largest bound, rad/s: a line there shrinks it most."""
        return float(self.omega[int(np.argmax(self.upper[:, 0, 0]))])

    @property
    def poles(self) -> tuple[np.ndarray, np.ndarray]:
        """Box of the cells that are left: natural frequencies (M, 2) in rad/s and damping ratios (M, 2)."""
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

    def __repr__(self) -> str:
        return f"<PoleBand: {self.omega.size} frequencies, {len(self.cells)} cells of poles left, {len(self.refuted)} refuted>"

    def summary(self) -> str:
        """The result in plain text."""
        response_size = np.abs(response(self.model, self.omega * self.identification.problem.dt))
        relative = self.upper[:, 0, 0] / response_size
        lines = [
            f"guarantee  every consistent system with poles in the box is within {self.upper.max():.4g} of the model"
            f" (median {100 * np.median(relative):.3g} % of the response)",
            f"poles      {len(self.cells)} cells may contain them, {len(self.refuted)} are proved not to",
        ]
        for number, (w, d) in enumerate(zip(*self.poles, strict=True)):
            low, high = w / (2 * np.pi)
            lines.append(f"mode {number + 1}     {low:.6g} to {high:.6g} Hz, damping {d[0]:.3g} to {d[1]:.3g}")
        lines += [
            f"next       measure around {self.next_line / (2 * np.pi):.5g} Hz: the bound is largest there",
            "assumed    gain bound, decay rate, the number of modes, poles inside the box, amplitudes of the modes at most"
            f" {_AMPLITUDE:g} times the model's, bounds of the samples: data can refute them, never prove them",
        ]
        return "\n".join(lines)


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
    executor: concurrent.futures.Executor | None = None,
    progress: Progress | None = None,
) -> PoleBand:
    """Guaranteed error of a model over all consistent systems whose poles lie in a box: the union of the bands of its cells.

    Poles that were taken from data carry the box that the data leave (`suggest_kautz`). Margin below 1 does not validate them, and
    the band at the suggested poles does not cover the others. Here each cell of the box is relaxed to a convex problem that
    every system with poles inside solves (`PoleCell`); cells that are proved inconsistent are left out.

    Parameters
    ----------
    identification : Identification
        Of a problem whose parametric part is one `kautz` basis, poles in the box.
    omega_interval, damping_interval : (M, 2) arrays
        Ends per mode, rad/s and 1; `KautzSuggestion.omega_interval` and `.damping_interval`.
    delay : int, samples
        Of the pairs.
    model, omega, directions, rtol, executor, progress
        As in `worst_case_error`. Default `omega`: 24 frequencies.
    cells : int
        Cells at most.

    Returns
    -------
    PoleBand

    Raises
    ------
    InputError
        Intervals that are empty or not of the number of modes, time records that do not start at rest.

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
    >>> bool(rid.worst_case_error(result, omega=[30.0]).lower[0, 0, 0] <= band.upper[0, 0, 0] < 0.5)
    True
    """
    if not isinstance(identification, Identification):
        raise InputTypeError(f"`identification` must be an Identification; got {type(identification).__name__}")
    whole = _whole(identification, omega_interval, damping_interval, as_count("delay", delay))
    problem, model = identification.problem, as_nominal(model, identification)
    cells, directions = as_count("cells", cells, least=1), as_count("directions", directions, least=3)
    gap = min(as_positive("rtol", rtol) / 5, 0.5 * (1 / np.cos(np.pi / directions) - 1))
    grid = default_frequencies(problem, whole) if omega is None else as_frequencies(omega, problem)
    kept, refuted = _search(identification, whole, grid, cells)
    nominal = response(model, grid * problem.dt)
    upper = np.zeros(grid.size)
    magnitude = np.stack([np.full(grid.size, np.inf), np.zeros(grid.size)], axis=1)
    for cell, consistent in kept:
        slack = cell.remainder(grid * problem.dt).sum(axis=1)
        found = value_sets(consistent, grid, directions, gap, executor, progress) if consistent is not None else None
        for k in range(grid.size):
            far = found[k].farthest(nominal[k])[0] if found is not None else np.inf
            low, high = found[k].magnitude if found is not None else (0.0, np.inf)
            upper[k] = max(upper[k], far + slack[k])
            magnitude[k] = min(magnitude[k, 0], max(0.0, low - slack[k])), max(magnitude[k, 1], high + slack[k])
    return PoleBand(
        identification=identification,
        model=model,
        omega=grid,
        upper=upper.reshape(-1, 1, 1),
        magnitude=magnitude,
        cells=tuple(cell for cell, _ in kept),
        refuted=tuple(refuted),
    )


def default_frequencies(problem: MixedProblem, whole: PoleCell) -> np.ndarray:
    """Over the range of the lines, and at the modes."""
    top = np.pi / problem.dt
    lines = np.concatenate([np.zeros(0), *(f.omega for f in problem.frequency)])
    low, high = (lines.min(), lines.max()) if lines.size else (top / 200, top)
    return np.unique(np.clip(np.concatenate([np.linspace(low, high, 24), whole.omega.mean(axis=1)]), 0, top))


def _whole(identification: Identification, omega: Any, damping: Any, delay: int) -> PoleCell:
    """The box as one cell, with the amplitudes of the model."""
    problem = identification.problem
    basis = problem.parametric
    if basis is None:
        raise InputError("`identification` has no parametric part, hence no poles that could lie in a box")
    omega, damping = as_array("omega_interval", omega, ndim=2), as_array("damping_interval", damping, ndim=2)
    modes = basis.size // 2
    for name, ends in (("omega_interval", omega), ("damping_interval", damping)):
        if ends.shape != (modes, 2):
            raise InputError(
                f"`{name}` must have one row (low, high) for each of the {modes} modes of `parametric` (one kautz pair each);"
                f" got shape {ends.shape}"
            )
        if np.any(ends[:, 0] > ends[:, 1]) or np.any(ends <= 0):
            raise InputError(f"`{name}` must hold positive ends, low <= high; got {ends.tolist()}")
    if np.any(damping >= 1) or np.any(omega * problem.dt >= np.pi):
        raise InputError("`damping_interval` must lie below 1 and `omega_interval` below pi/dt")
    for record in problem.time:
        if record.initial != "rest":
            raise InputError(
                f'`identification` has a time record with initial="{record.initial}": what poles in a box do to its initial state'
                " is not bounded here; use lines (`estimate_frf`) or a record from rest"
            )
    poles = basis.poles
    poles = poles[np.imag(poles) > 0]
    if poles.size != modes:
        raise InputError("`identification` must have one single `kautz` pair per mode in its parametric part")
    weights = identification.parameters.reshape(modes, 2)
    impulse = basis.impulse(delay + 2).reshape(delay + 2, modes, 2)
    # Functions Re a^k/n_1 and Im a^k/n_2 from k = delay on.
    norms = np.stack([1 / impulse[delay, :, 0], np.imag(poles) / impulse[delay + 1, :, 1]], axis=1)
    amplitude = np.linalg.norm(weights / norms, axis=1) / 2
    floor = 1e-3 * amplitude.max(initial=0.0)
    return PoleCell(omega, damping, _AMPLITUDE * np.maximum(amplitude, floor), delay, problem.dt)


def _search(identification: Identification, whole: PoleCell, grid: np.ndarray, limit: int) -> tuple[list, list]:
    """Split cells until their relaxation costs little; leave out what is refuted."""
    problem = identification.problem
    smallest = min([float(f.inner_radius.min()) for f in problem.frequency] + _time_bounds(problem))
    waiting, kept, refuted = [whole], [], []
    angles = np.concatenate([grid * problem.dt, *(f.omega * problem.dt for f in problem.frequency)])
    while waiting:
        # The widest cell first, so that the number of cells that are allowed goes where it matters.
        cell = waiting.pop(int(np.argmax([c.remainder(angles).sum(axis=1).max() for c in waiting])))
        relaxed = cell.relaxed(problem)
        consistent = None
        if relaxed is not None:
            claim, passed = prove_margin(_posed(relaxed), "structured", 1e-3)
            if claim.certificate.value > 1:
                refuted.append((cell, claim.certificate))
                continue
            consistent = set_of(_posed(relaxed), max(1.0, claim.margin * (1 + 1e-3)), passed)
        cost = float(cell.remainder(angles).sum(axis=1).max())
        if cost > _MATTERS * smallest and len(waiting) + len(kept) + 2 <= limit:
            waiting += cell.split(problem, grid)
            continue
        kept.append((cell, consistent))
        _log.info("%d cells kept, %d refuted, %d waiting", len(kept), len(refuted), len(waiting))
    return kept, refuted


def _time_bounds(problem: MixedProblem) -> list[float]:
    return [float(t.bound.min()) / max(float(np.abs(t.u).max()), np.finfo(float).tiny) for t in problem.time]


def _posed(problem: MixedProblem) -> Posed:
    return pose(problem, sections_of(problem, "auto", 1e-4))

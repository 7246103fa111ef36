"""Classes ranked by the guaranteed error that they give: one candidate, and the table of all."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from robustid.advice.kautz import KautzSuggestion
from robustid.core import Budget, Frozen, Options, Real, freeze
from robustid.errors import InputError
from robustid.guarantees import PoleCell, norm_of_bounds, worst_case_error, worst_case_over_poles
from robustid.identification import Identification, MixedProblem, Prior, identify

_CELLS, _DIRECTIONS = 8, 6
_AS_GOOD = 1.05  # errors that differ by less do not decide


@dataclasses.dataclass(frozen=True, eq=False, kw_only=True)
class ClassCandidate(Frozen):
    """A parametric part with a prior, and the guaranteed error that it gives.

    Attributes
    ----------
    pairs, repeat : int
        Number of modes and multiplicity of each.
    problem : MixedProblem or None
        Ready for `identify`; None where no gain bound makes the data consistent. Repeated pairs that cover a pole-uncertainty
        box have wider bounds of the samples, and intervals for the coefficients of the terms beyond `repeat`.
    modes : KautzSuggestion or None
        Poles that come from the data with the pole-uncertainty box that the error covers; None for poles that were given.
    cell : PoleCell or None
        Repeated pairs that cover a pole-uncertainty box: ``cell.slack(omega)`` is what the entries of the systems of the box
        can differ from those of `problem`, on top of their worst case. Single pairs: see `worst_case_over_poles`.
    margin : float
    upper : (F,) array; MIMO: (F, ny, nu)
        Proved bound of |F - model|, of every entry.
    error : (F,) array
        `upper` relative to the response of the model; inf where there is no bound, NaN where it was not computed. MIMO: largest
        singular values of both, entries in units of the prior's scaling.
    note : str
        Why it was not computed, or not everywhere.
    late : bool
        Whether that is because the time was over.
    """

    pairs: int
    repeat: int
    problem: MixedProblem | None
    modes: KautzSuggestion | None
    cell: PoleCell | None
    margin: float
    upper: Real
    error: Real
    note: str
    late: bool = False

    def __post_init__(self) -> None:
        self._set(upper=freeze(self.upper), error=freeze(self.error))

    @property
    def prior(self) -> Prior | None:
        """Prior of the problem: gain bound and decay rate."""
        return None if self.problem is None else self.problem.prior

    @property
    def mean(self) -> float:
        """Mean error over the frequencies, by which candidates are ranked. A median would not see a single resonance.

        NaN where some were left out: the others alone are not those of the other candidates.
        """
        return float(np.mean(self.error))

    @property
    def median(self) -> float:
        """Median error over the frequencies."""
        return float(np.median(self.error))

    @property
    def worst(self) -> float:
        """Largest error over the frequencies."""
        return float(np.max(self.error))

    @property
    def covers_box(self) -> bool:
        """Return whether the error holds for all poles in a pole-uncertainty box; else for these poles only (given, or none)."""
        return self.modes is not None and self.pairs > 0

    def guaranteed(self, omega: Real, *, time_limit: float | None = None) -> tuple[Identification, Real]:
        """Identification of `problem` and proved bound of |F - model| at frequencies in rad/s, for all poles covered.

        The bound is (F,); MIMO: (F, ny, nu), that of every entry. It is NaN where `time_limit` seconds, or Ctrl-C, left it out.
        """
        if self.problem is None:
            raise InputError(f"this candidate has no problem: {self.note}")
        budget = Budget(time_limit)
        result, entries = identify(self.problem, time_limit=time_limit), self.problem.entries
        grid, place = np.unique(omega, return_inverse=True)
        upper = np.full((grid.size, *entries.shape), np.nan)
        options: Options = {"omega": grid, "directions": _DIRECTIONS, "rtol": 0.1, "time_limit": budget.seconds}
        if result.consistent:
            if self.modes is not None and self.pairs and self.cell is None:
                box = self.modes.omega_interval, self.modes.damping_interval
                found = worst_case_over_poles(result, *box, delay=self.modes.delay, cells=_CELLS, **options)
            else:
                found = worst_case_error(result, **options)
            upper[np.isin(grid, found.omega)] = found.upper
        if self.cell is not None:
            upper = upper + self.cell.slack(grid)
        return result, entries.as_given(upper[place])

    def evaluated(self, omega: Real, *, time_limit: float | None = None) -> ClassCandidate:
        """The candidate with its margin and its errors at frequencies in rad/s."""
        result, upper = self.guaranteed(omega, time_limit=time_limit)
        if not result.consistent:
            return dataclasses.replace(self, margin=result.margin)
        entries, model = result.problem.entries, result.problem.plane.values_at(result.model, omega)
        scaled = model / result.problem.prior.scales(*entries.shape)
        size = np.abs(model[:, 0, 0]) if entries.single else np.linalg.norm(scaled, 2, axis=(1, 2))
        found = dataclasses.replace(self, margin=result.margin, upper=upper)
        return dataclasses.replace(found, error=found.largest / np.maximum(size, np.finfo(float).tiny))

    @property
    def largest(self) -> Real:
        """Proved bound of the largest singular value of F - model, in units of the prior's scaling, (F,)."""
        if self.upper.ndim == 1 or self.problem is None:
            return self.upper
        found, known = np.full(len(self.upper), np.nan), ~np.isnan(self.upper).any(axis=(1, 2))
        found[known] = norm_of_bounds(self.upper[known] / self.problem.prior.scales(*self.problem.entries.shape))
        return found


@dataclasses.dataclass(frozen=True, eq=False, kw_only=True)
class ClassSuggestion(Frozen):
    """Candidate classes ranked by the guaranteed error that results.

    Attributes
    ----------
    omega : (F,) array, rad/s
        Where the errors are evaluated.
    candidates : tuple of ClassCandidate
        Smallest mean error first; those without an error last.
    next_line : float or None, rad/s
        Where the bound of the best one is largest: a frequency point there shrinks it most. None where none has an error.
    """

    omega: Real
    candidates: tuple[ClassCandidate, ...]
    next_line: float | None

    def __post_init__(self) -> None:
        self._set(omega=freeze(self.omega))

    @property
    def recommended(self) -> ClassCandidate | None:
        """The simplest candidate within 5 % of the smallest error; None where none has an error."""
        return choice(self.candidates)

    @property
    def problem(self) -> MixedProblem | None:
        """Problem of the recommended candidate, ready for `identify`."""
        return None if self.recommended is None else self.recommended.problem

    def summary(self) -> str:
        """The table, then what is recommended, what it rests on and what to measure next."""
        head = f"{'pairs':>5}{'repeat':>8}{'K':>10}{'rho':>9}{'margin':>9}{'mean':>9}{'median':>9}{'worst':>9}"
        lines = ["guaranteed error of the model, relative to the response:", head]
        for row in self.candidates:
            mark = "  <- recommended" if row is self.recommended else ""
            lines.append(
                f"{row.pairs:5d}{row.repeat:8d}" + _numbers(row) + (f"  {row.note}" if row.note else "") + mark
            )
        if (best := self.recommended) is None or self.next_line is None:
            return "\n".join(
                [
                    *lines,
                    "no candidate has a guaranteed error: no problem is recommended (`diagnose` says what inconsistent data need)",
                ]
            )
        if best.covers_box and best.modes is not None:
            lines += [
                "The errors hold for all poles in the pole-uncertainty box that the data leave:",
                best.modes.summary(),
            ]
            if (open_at := self.omega[np.isinf(best.error)]).size:
                where = ", ".join(f"{w / (2 * np.pi):.5g}" for w in open_at)
                lines.append(
                    f"There is no bound at {where} Hz: the poles that the frequency points leave there are too many."
                )
        elif best.pairs:
            lines.append("The errors hold for the poles that were given, as prior knowledge.")
        lines.append(f"next       measure around {self.next_line / (2 * np.pi):.5g} Hz: the bound is largest there")
        assumed = "number of modes, poles inside the pole-uncertainty box"
        return "\n".join(
            [
                *lines,
                "assumed    K (twice the smallest that the data allow), rho, bounds of the samples, "
                + (assumed if best.covers_box else "the poles")
                + ": data can refute them, never prove them",
            ]
        )


def _numbers(row: ClassCandidate) -> str:
    prior = row.prior
    text = f"{prior.gain_bound:10.4g}{prior.rate:9.5g}" if prior is not None else f"{'-':>10}{'-':>9}"
    text += f"{row.margin:9.3g}" if np.isfinite(row.margin) else f"{'-':>9}"
    if np.any(np.isnan(row.error)):
        return text + 3 * f"{'-':>9}"
    return text + "".join(
        f"{100 * e:8.3g}%" if np.isfinite(e) else f"{'none':>9}" for e in (row.mean, row.median, row.worst)
    )


def rank(row: ClassCandidate) -> tuple[bool, int, float]:
    """Sort key: fewest frequencies without a bound or left out, then the mean over the others; those without any error last."""
    bounded = row.error[np.isfinite(row.error)]
    return (
        bool(np.all(np.isnan(row.error))),
        row.error.size - bounded.size,
        float(bounded.mean()) if bounded.size else 0.0,
    )


def choice(rows: Sequence[ClassCandidate]) -> ClassCandidate | None:
    """The simplest that is as good as the best: small differences come from where in its set each model lies."""
    unknown, unbounded, mean = min(map(rank, rows))
    if unknown:
        return None
    near = [row for row in rows if rank(row) <= (False, unbounded, _AS_GOOD * mean)]
    return min(near, key=lambda row: (row.pairs * row.repeat, rank(row)))

"""sensitivity(): the guaranteed error under other assumptions and with fewer frequency points."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike

from robustid.core import Budget, Frozen, Interruptible, Progress, Real, Stops, as_kind, one_thread, pass_on
from robustid.errors import InputError, SolverError
from robustid.guarantees import as_frequencies, norm_of_bounds, worst_case_error
from robustid.identification import MixedProblem, identify

_POINTS, _DIRECTIONS = 7, 6
_ABSCISSA = {"gain": "gain_bound", "decay": "decay_rate", "lines": "lines"}
_FACTORS = (0.5, 2.0)  # of the gain bound, and of how far the decay rate is above 1


@dataclasses.dataclass(frozen=True)
class Variation:
    """One row of the table.

    Attributes
    ----------
    what : str
    kind : {"stated", "gain", "decay", "lines"}
        Which assumption is changed.
    gain_bound, decay_rate : float
    lines : int
        Of all frequency responses together.
    margin : float
    median, worst : float
        Half-width of the set of consistent values relative to the response, over the frequencies; NaN where the data are not
        consistent.
    """

    what: str
    kind: str
    gain_bound: float
    decay_rate: float
    lines: int
    margin: float
    median: float
    worst: float


@dataclasses.dataclass(frozen=True, eq=False)
class Sensitivity(Frozen):
    """The guaranteed error under other assumptions: what it rests on.

    Attributes
    ----------
    omega : (F,) array, rad/s
    variations : tuple of Variation
        As stated first.
    left_out : tuple of str
        Variations for which there was no time.
    """

    omega: Real
    variations: tuple[Variation, ...]
    left_out: tuple[str, ...] = ()

    def curve(self, kind: str) -> tuple[Real, Real]:
        """Abscissa, ascending, and median half-width: of what was stated and the variations of one kind.

        `kind`: "gain" (abscissa K), "decay" (rho) or "lines" (their number).
        """
        if kind not in _ABSCISSA:
            raise InputError(f"`kind` must be one of {', '.join(map(repr, _ABSCISSA))}; got {kind!r}")
        rows = [row for row in self.variations if row.kind in ("stated", kind)]
        rows.sort(key=lambda row: getattr(row, _ABSCISSA[kind]))
        return np.array([getattr(row, _ABSCISSA[kind]) for row in rows]), np.array([row.median for row in rows])

    def summary(self) -> str:
        """The table, and how to read it."""
        lines = [f"{'':34}{'margin':>9}{'median':>10}{'worst':>10}"]
        for row in self.variations:
            band = f"{100 * row.median:9.3g}%{100 * row.worst:9.3g}%" if row.margin <= 1 else f"{'refuted':>20}"
            lines.append(f"{row.what:34}{row.margin:9.4g}{band}")
        if self.left_out:
            lines.append(f"No time was left for: {', '.join(self.left_out)}.")
        lines.append(
            "Half-width of the guaranteed band relative to the response. A bound that moves much with an assumption rests on"
            " it: data can refute assumptions, never prove them."
        )
        return "\n".join(lines)


@one_thread()
def sensitivity(
    problem: MixedProblem,
    *,
    omega: ArrayLike | None = None,
    time_limit: float | None = None,
    progress: Progress | None = None,
) -> Sensitivity:
    """Guaranteed error with half and twice the gain bound, slower and faster decay, and fewer frequency points.

    Parameters
    ----------
    problem : MixedProblem
    omega : (F,) array, rad/s, optional
        Where the error is evaluated; default 7 frequencies over the range of the frequency points.
    time_limit : float, optional
        Seconds after which no further variation is evaluated; the first one always is. So it is on Ctrl-C.
    progress : callable (text, done, count), optional
        Variations.

    Returns
    -------
    Sensitivity

    Notes
    -----
    Each variation is identified anew. The half-width is approximately the error of the best nominal.

    Examples
    --------
    >>> import numpy as np, robustid as rid
    >>> record = rid.TimeRecord(np.eye(1, 4)[0], [0.5, 0.25, 0.12, 0.06], dt=1.0, bound=0.01)
    >>> problem = rid.MixedProblem(time=record, prior=rid.Prior(gain_bound=1.0, decay_rate=1.5))
    >>> table = rid.advise.sensitivity(problem, omega=[0.5])
    >>> [row.what for row in table.variations][:3]
    ['as stated', 'gain bound x 0.5', 'gain bound x 2']
    """
    as_kind("problem", problem, MixedProblem, "a MixedProblem")
    grid = default_points(problem) if omega is None else as_frequencies(omega, problem)
    budget, asked = (
        Budget(time_limit, progress, "bounding the error under other assumptions"),
        list(_variations(problem)),
    )
    rows: list[Variation] = []
    stops = Stops()
    with Interruptible(lambda: bool(rows)), stops.listening():
        for what, kind, changed in asked:
            if rows and budget.over:
                break
            prior, lines = changed.prior, sum(f.omega.size for f in changed.frequency)
            found = guaranteed(changed, grid)
            pass_on(stops.interrupted)  # an error at some of the frequencies says nothing beside the others
            rows.append(Variation(what, kind, prior.gain_bound, prior.rate, lines, *found))
            budget.tell(len(rows), len(asked))
    return Sensitivity(grid, tuple(rows), tuple(what for what, _, _ in asked[len(rows) :]))


def guaranteed(problem: MixedProblem, omega: Real) -> tuple[float, float, float]:
    """Margin, and median and largest half-width of the sets of values relative to the response; NaN where nothing fits.

    MIMO: the norms of the matrices of both.
    """
    try:
        result = identify(problem)
        if not result.consistent:
            return result.margin, np.nan, np.nan
        error = worst_case_error(result, omega=omega, directions=_DIRECTIONS, rtol=0.1)
    except SolverError:
        return np.nan, np.nan, np.nan
    # Half the largest width of each set: of nested sets the larger has the larger one, whatever the models.
    widths = np.zeros(error.upper.shape)
    for entry in np.ndindex(widths.shape[1:]):
        widths[:, *entry] = [half_width(v.support) for v in error.of_entry(*entry)]
    size = np.linalg.norm(error.nominal.reshape(widths.shape), 2, axis=(1, 2))
    relative = norm_of_bounds(widths) / np.maximum(size, np.finfo(float).tiny)
    return result.margin, float(np.median(relative)), float(relative.max())


def half_width(support: Real) -> float:
    """Half the largest width of a set from its support function in an even number of directions."""
    half = support.size // 2
    return float((support[:half] + support[half:]).max() / 2)


def _variations(problem: MixedProblem) -> Iterator[tuple[str, str, MixedProblem]]:
    K, rate = problem.prior.gain_bound, problem.prior.rate
    yield "as stated", "stated", problem
    for factor in () if problem.prior.physical else _FACTORS:
        yield f"gain bound x {factor:g}", "gain", problem.with_prior(gain_bound=factor * K)
    for factor in _FACTORS:
        words, changed = ("decay rate", 1 + factor * (rate - 1)) if problem.dt else ("decay", factor * rate)
        yield f"{words} {changed:.5g} (was {rate:.5g})", "decay", problem.with_prior(rate=changed)
    for step in (2, 4):
        if problem.frequency and min(f.omega.size for f in problem.frequency) >= 4 * step:
            thinned = tuple(f.select(slice(0, None, step)) for f in problem.frequency)
            yield (
                f"every {'second' if step == 2 else 'fourth'} frequency point",
                "lines",
                dataclasses.replace(problem, frequency=thinned),
            )


def default_points(problem: MixedProblem) -> Real:
    """Frequencies over the range of the frequency points, in rad/s."""
    top = problem.plane.top
    lines = np.concatenate([np.zeros(0), *(f.omega for f in problem.frequency)])
    low, high = (lines.min(), lines.max()) if lines.size else (top / 100, top / 2)
    return np.linspace(max(low, 1e-3 * high), high, _POINTS)

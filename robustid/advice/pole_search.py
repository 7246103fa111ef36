"""improve_kautz(): Kautz pairs that the data refute, repaired: repeated pairs first, then moved poles."""

from __future__ import annotations

import dataclasses
import logging
from typing import Any, NamedTuple

import numpy as np

from robustid.advice.kautz import KautzSuggestion
from robustid.advice.moving_pairs import MovingPairs, moved_samples, pairs_of, units
from robustid.advice.pole_fit import line_data
from robustid.advice.pole_interval import mode_intervals, pole_interval
from robustid.core import (
    Budget,
    Choice,
    Complex,
    Frozen,
    Interruptible,
    Progress,
    Real,
    Source,
    as_flag,
    as_kind,
    as_positive,
    freeze,
    hz_words,
    one_thread,
    threads_for,
)
from robustid.data import FrequencyResponse
from robustid.errors import InputError, SolverError
from robustid.identification import Claim, Identification, MixedProblem, identify, prove_margin
from robustid.identification.formulation import ConvexData, Formulation, formulate

_log = logging.getLogger("robustid")

_DIGITS = 1e-3  # relative width of the proven interval of every margin
_MOST_STEPS = 40
# Trust region, in `units`: at the start; where it is given up; what a step must keep of what it promised
# to be taken, and to widen the region.
_RADIUS, _SMALLEST, _TAKEN, _GOOD = 1.0, 1e-4, 0.1, 0.7
# Part of the margin that a step must promise: twice what margins are known to. Not more: in a small region good steps promise
# little.
_WORTH = 2e-3


class PoleTrial(NamedTuple):
    """Poles that were tried (rad/s, 1), the proven interval of the margin there, and whether the search went on from them."""

    change: str
    omega: Real
    damping: Real
    margin: float
    margin_lower: float
    kept: bool


@dataclasses.dataclass(frozen=True, eq=False, kw_only=True)
class KautzImprovement(Frozen):
    """A problem whose Kautz pairs suit the data, what was tried on the way, and what that costs.

    Attributes
    ----------
    problem : MixedProblem
        The same data and prior with the pairs that were found; the given one where nothing was better.
    margin, margin_lower : float
        Proven interval of its margin, 0.1 % wide.
    omega_before, damping_before, omega, damping : (M,) arrays, rad/s and 1
        Poles of the pairs, before and after.
    repeated : bool
        Whether the pairs of `problem` are repeated once more, at the poles that were given.
    slope : (M, 2) array
        Derivative of the margin to the log of frequency and of damping, from the multipliers of its certificate: what an error of
        a pole costs. Where the margin has a kink, that of one side or between the two.
    box : KautzSuggestion or None
        The intervals that the frequency points leave to the moved poles; None where no pole was moved, or there are too few
        frequency points.
    trials : tuple of PoleTrial
        All, in their order.
    reason : str
        What was done and why it stopped, in words.
    note : str
        What this assumes, for `Identification.choices`; empty where the problem is the given one.
    """

    problem: MixedProblem
    margin: float
    margin_lower: float
    omega_before: Real
    damping_before: Real
    omega: Real
    damping: Real
    repeated: bool
    slope: Real
    box: KautzSuggestion | None
    trials: tuple[PoleTrial, ...]
    reason: str
    note: str

    def __post_init__(self) -> None:
        names = ("omega_before", "damping_before", "omega", "damping", "slope")
        self._set(**{name: freeze(getattr(self, name)) for name in names})

    @property
    def margins(self) -> Real:
        """Margins of the trials that the search went on from: falling."""
        return np.array([trial.margin for trial in self.trials if trial.kept])

    @property
    def moved(self) -> bool:
        """Return whether poles were moved: they are then no longer knowledge from elsewhere."""
        return bool(np.any(self.omega != self.omega_before) or np.any(self.damping != self.damping_before))

    def identify(self, **options: Any) -> Identification:
        """`identify` of the problem found, with `note` among its choices, so that bounds and reports say where poles come from."""
        result = identify(self.problem, **options)
        found: dict[str, Choice] = {}
        if self.note:
            name, source = ("modes", Source.DATA) if self.moved else ("repeat", Source.PROGRAM)
            found[name] = Choice({"omega": self.omega.tolist(), "damping": self.damping.tolist()}, source, self.note)
        return dataclasses.replace(result, choices=result.choices | found)

    def summary(self) -> str:
        """One line per pair, then the reason and the note."""
        lines: list[str] = []
        for k, (w, z) in enumerate(zip(self.omega / (2 * np.pi), self.damping, strict=True)):
            before = f"{hz_words(self.omega_before[k] / (2 * np.pi))}, damping {self.damping_before[k]:.3g}"
            lines.append(f"pair {k + 1}: {before}" + (f" -> {hz_words(w)}, damping {z:.3g}" if self.moved else ""))
        return "\n".join([*lines, self.reason, *([self.note] if self.note else [])])


@one_thread()
def improve_kautz(
    problem: MixedProblem,
    *,
    target: float = 1.0,
    repeat: bool = True,
    time_limit: float | None = None,
    progress: Progress | None = None,
) -> KautzImprovement:
    """Repair Kautz pairs with which the data are inconsistent: repeat them, then move their poles until the margin is small.

    Tried in this order, up to the first margin <= `target`: the pairs as given; each repeated once more (terms k a^k absorb
    errors of the poles to first order, and the poles stay what they were: an assumption from elsewhere); the pairs as often as
    given, with their poles moved. The margin

        s(theta) = min over x, p of max_k |y - E x - P(theta) p|_k / bound_k,   ||X(x)|| <= 1,

    is convex in (x, p) and made small over the logs theta of frequency and damping.

    Parameters
    ----------
    problem : MixedProblem
        With pairs made by `kautz` in its parametric part; other functions stay as they are.
    target : float
        Margin at which the search ends. Below 1 the poles follow the errors of the measurement more and more.
    repeat : bool
        False: move the poles at once, without repeated pairs.
    time_limit : float, optional
        Seconds; then, and on Ctrl-C, the best pairs found so far are returned, and `reason` says so.
    progress : callable (text, done, count), optional
        Steps of the search; all are seldom needed.

    Returns
    -------
    KautzImprovement

    Raises
    ------
    InputError
        No pairs to move; intervals of coefficients; a target that is not positive.
    InputTypeError
        Something that isn't a MixedProblem.

    Notes
    -----
    The margin is the largest of many smooth functions: at its minimum, and in the valleys that lead there, it has kinks, where
    methods for smooth functions (BFGS) stall. So each step solves the convex problem with the pairs linearised in their
    poles, ``P(theta + d) p ~ P p + sum_i d_i dP/dtheta_i p``, for p, x and d together, d in a trust region: quadratically
    convergent where the active constraints of the margin determine the poles. By the envelope theorem
    ``ds/dtheta_i = -Re <l, dP/dtheta_i p>``, with the multipliers l of the certificate. Every margin is proved from both sides.
    It ends at a local minimum: poles that are off by a tenth may need a better start.

    Poles that were fitted to the data at hand are not prior knowledge. The data leave them a pole-uncertainty box, `box`, often
    much wider than the steps made here, and a guarantee must cover it (`worst_case_over_poles`).

    Source: trust region for minimax problems, `madsen1975`; class of `inanc2001`.

    Examples
    --------
    >>> import numpy as np, robustid as rid
    >>> data = rid.datasets.flexible_structure(lines=6, extra_hz=np.linspace(17.2, 18.1, 10))
    >>> wrong = rid.kautz(data.modes[:, 0] * [1, 1.01], data.modes[:, 1], dt=0.01, delay=1)
    >>> prior = rid.Prior(gain_bound=0.2, decay_rate=1.1)
    >>> found = rid.advise.improve_kautz(rid.MixedProblem(frequency=data.frequency, parametric=wrong, prior=prior))
    >>> found.trials[0].margin > 100, found.margin < 1, np.round(found.omega[1] / (2 * np.pi), 2)
    (True, True, np.float64(17.67))
    """
    as_kind("problem", problem, MixedProblem, "a MixedProblem")
    target, pairs, repeat = as_positive("target", target), pairs_of(problem), as_flag("repeat", repeat)
    formulation = formulate(problem, accuracy=_DIGITS)
    with threads_for(formulation.count):
        search = _Search(formulation, pairs, target, Budget(time_limit, progress, "moving the poles"))
        best, reason = search.run(repeat)
        return _result(search, best, reason)


@dataclasses.dataclass(frozen=True)
class _Point:
    """Pairs, their poles (log frequency, log damping), and the margin with them."""

    pairs: MovingPairs
    poles: Real
    formulation: Formulation
    claim: Claim

    @property
    def margin(self) -> float:
        return self.claim.margin


class _Search:
    """The trials of one problem."""

    def __init__(self, formulation: Formulation, pairs: MovingPairs, target: float, budget: Budget) -> None:
        self.problem, self.formulation, self.target = formulation.problem, formulation, target
        self.budget = budget
        self.given = self._point(formulation.problem, pairs, pairs.start)
        self.trials: list[PoleTrial] = []

    def run(self, repeat: bool) -> tuple[_Point, str]:
        """The first point with the margin wanted, or the best one, and why it is that."""
        best = given = self.given
        self._note("as given", given, kept=True)
        done = [f"as given the margin is {given.margin:.4g}"]
        if given.claim.stopped:
            return best, f"{done[0]}: {given.claim.stopped}"
        if repeat and best.margin > self.target:
            try:
                doubled = self._at(given.pairs.repeated(), given.poles)
            except (InputError, SolverError) as error:
                _log.info("each pair repeated once more: left out (%s)", error)
                done.append("the data can't tell repeated pairs apart")
            else:
                best = min(given, doubled, key=lambda point: point.margin)
                self._note("each pair repeated once more", doubled, kept=doubled.margin <= self.target)
                done.append(f"with each pair repeated once more {doubled.margin:.4g}")
        if best.margin > self.target:
            moved, why = self._move(given)
            best = min(best, moved, key=lambda point: point.margin)
            done.append(f"with poles moved {moved.margin:.4g}: {why}")
        return best, "; ".join(done)

    def _move(self, at: _Point) -> tuple[_Point, str]:
        """Steps of the minimax problem with linearised pairs, in a trust region."""
        radius, slopes = _RADIUS, None
        step = 1
        with Interruptible():
            for step in range(1, _MOST_STEPS + 1):
                unit = units(self.problem, at.poles)
                if self.budget.over:
                    return at, f"the time was over after {step - 1} steps"
                self.budget.tell(step, _MOST_STEPS)
                if slopes is None:
                    slopes = moved_samples(at.pairs, at.formulation, at.claim.p, at.poles) * unit.ravel()
                try:
                    claim = _linearised(at.formulation.data, slopes, radius, self._limit)
                    d, promised = claim.p[-slopes.shape[1] :], claim.margin
                    if claim.stopped:
                        return at, f"{claim.stopped} in step {step}"
                    if promised > (1 - _WORTH) * at.margin:
                        reach = 100 * radius * float(unit[:, 0].max())
                        return at, f"no step of up to {reach:.2g} % in frequency promises {100 * _WORTH:g} % less"
                    new = self._at(at.pairs, at.pairs.inside(at.poles + unit * d.reshape(-1, 2)))
                    if new.claim.stopped:
                        return at, f"{new.claim.stopped} in step {step}"
                except (InputError, SolverError) as error:  # poles that meet, or that the samples don't feel
                    _log.info("step %d: shortened (%s)", step, error)
                    radius /= 4
                else:
                    kept = at.margin - new.margin
                    taken = kept > _TAKEN * (at.margin - promised)
                    self._note(f"step {step}", new, taken)
                    length = float(np.abs(d).max())
                    if not taken:
                        radius = min(radius, length) / 4
                    else:
                        if kept > _GOOD * (at.margin - promised) and length > 0.9 * radius:
                            radius *= 2
                        at, slopes = new, None
                if at.margin <= self.target:
                    return at, f"the margin wanted, {self.target:.4g}, is reached"
                if radius < _SMALLEST:
                    return at, "no further step makes it smaller"
            return at, f"after {_MOST_STEPS} steps"
        return at, f"interrupted in step {step}"

    def _at(self, pairs: MovingPairs, poles: Real) -> _Point:
        return self._point(dataclasses.replace(self.problem, parametric=pairs.at(poles)), pairs, poles)

    def _point(self, problem: MixedProblem, pairs: MovingPairs, poles: Real) -> _Point:
        formulation = self.formulation.of(problem)
        return _Point(pairs, poles, formulation, prove_margin(formulation.data, "structured", _DIGITS, self._limit)[0])

    @property
    def _limit(self) -> Budget:
        """The time that is left, without the receiver: it counts steps."""
        return Budget(self.budget.seconds)

    def _note(self, change: str, point: _Point, kept: bool) -> None:
        omega, damping = freeze(np.exp(point.poles[:, 0])), freeze(np.exp(point.poles[:, 1]))
        trial = PoleTrial(change, omega, damping, point.margin, point.claim.certificate.value, kept)
        self.trials.append(trial)
        _log.info("%s: margin %.6g%s", change, point.margin, "" if kept else " (not taken)")


def _linearised(data: ConvexData, D: Complex, radius: float, budget: Budget) -> Claim:
    """The smallest margin of y - E x - P p - D d, d in [-radius, radius]: d are the last parameters."""
    rows, more = data.rows, D.shape[1]
    ends = np.vstack([rows.ends, np.tile([-radius, radius], (more, 1))])
    scale = np.concatenate([rows.column_scale, np.ones(more)])
    wider = dataclasses.replace(rows, P=np.hstack([rows.P, D]), ends=ends, column_scale=scale)
    return prove_margin(ConvexData(wider, data.sarason), "structured", _DIGITS, budget)[0]


def _result(search: _Search, best: _Point, reason: str) -> KautzImprovement:
    given, problem = search.given, best.formulation.problem
    repeated, moved = best.pairs is not given.pairs, best.poles is not given.poles
    (omega_before, damping_before), (omega, damping) = np.exp(given.poles).T, np.exp(best.poles).T
    box = _box(problem, best.pairs, best.poles) if moved else None
    # by the envelope theorem
    D = moved_samples(best.pairs, best.formulation, best.claim.p, best.poles)
    return KautzImprovement(
        problem=problem,
        margin=best.margin,
        margin_lower=best.claim.certificate.value,
        omega_before=omega_before,
        damping_before=damping_before,
        omega=omega,
        damping=damping,
        repeated=repeated,
        slope=-np.real(best.claim.certificate.samples.conj() @ D).reshape(-1, 2),
        box=box,
        trials=tuple(search.trials),
        reason=reason,
        note=_moved_note(given.margin, best.margin, box) if moved else _repeated_note(given.margin) * repeated,
    )


def _repeated_note(before: float) -> str:
    return (
        f"Pairs repeated once more after these data had given the margin {before:.4g} with single ones: a larger class, chosen from"
        " the data; the poles are those that were given"
    )


def _moved_note(before: float, after: float, box: KautzSuggestion | None) -> str:
    said = (
        "Modes taken from the data: poles moved until the margin, "
        f"{before:.4g} with those that were given, was {after:.4g}. Fitted to these data they are not prior knowledge: a guarantee"
        " must cover all poles that the data leave (worst_case_over_poles)"
    )
    if box is None:
        return said + "; the frequency points are too few to say which, so take intervals from elsewhere"
    return f"{said}. By a local fit of the frequency points these are:\n{box.summary()}"


def _box(problem: MixedProblem, pairs: MovingPairs, poles: Real) -> KautzSuggestion | None:
    """Pole-uncertainty box that the frequency points leave, in the order of the pairs."""
    lines = [f for f in problem.frequency if isinstance(f, FrequencyResponse)]
    if not lines:
        return None
    data = line_data(lines, problem.plane)
    if data.room < len(poles):
        return None
    turns = (
        poles + np.log([problem.dt, 1.0]) if problem.dt else np.log(np.stack(problem.plane.turned(*np.exp(poles).T), 1))
    )
    ends, levels, reached, share, linear = zip(*(pole_interval(data, turns, i) for i in range(len(poles))), strict=True)
    edges, (omega, damping) = mode_intervals(np.array(ends), problem.plane), np.exp(poles).T
    return KautzSuggestion(
        omega=omega,
        damping=damping,
        omega_interval=edges[:, 0],
        damping_interval=edges[:, 1],
        level=np.array(levels),
        reached=np.array(reached, bool),
        share=np.array(share),
        linear=np.array(linear),
        basis=problem.parametric,
        repeat=pairs.pairs[0].repeat,
        delay=pairs.pairs[0].delay,
        reason="the intervals of poles with which a local fit keeps all frequency points within their bounds",
    )

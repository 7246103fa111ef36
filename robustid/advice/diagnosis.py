"""diagnose(): causes of a contradiction between data and class, and the margin that each remedy would bring."""

from __future__ import annotations

import contextlib
import dataclasses
import logging
from collections.abc import Sequence

import numpy as np

from robustid.advice.causes import (
    HELPS,
    SLIGHTLY,
    Cause,
    Kind,
    bound_cause,
    causes_without_class,
    class_cause,
    judged_margin,
    tried_causes,
    unit_cause,
)
from robustid.advice.class_changes import changes_of, found_modes, mode_options
from robustid.advice.experiment_corrections import Experiment
from robustid.advice.pole_search import improve_kautz
from robustid.core import Budget, Frozen, Interruptible, Progress, as_kind, hz_words, one_thread
from robustid.data import Fault
from robustid.errors import InputError, SolverError
from robustid.identification import Identification, MixedProblem, contradictions
from robustid.identification.formulation import QUICK_EXACT

_log = logging.getLogger("robustid")
_MOVED = "poles moved"
_ELSEWHERE = "the poles of the modes are not where they were stated"
_AN_ORDER = 30.0  # margin up to which bounds alone may be the cause
_MOST_NAMED = 3  # causes in a summary
_ASKS_LESS = (
    "More pairs add assumptions that the data can test; a larger K or a slower decay only asks less, and its guarantee between the"
    " samples is weaker."
)
_NO_KNOWLEDGE = (
    "Poles that were moved to suit the data are no prior knowledge: improve_kautz says which intervals the frequency points leave"
    " to them."
)


@dataclasses.dataclass(frozen=True, eq=False, kw_only=True)
class Diagnosis(Frozen):
    """Active constraints of an identification, and the margin that each change of the class would bring.

    Attributes
    ----------
    inflation : float
        The margin: the factor on all bounds with which the data are consistent.
    active : tuple of (kind, experiment, rad/s or s, weight)
        Active constraints: samples with their dual weight in the proof, largest first; all weights sum to one.
    causes : tuple of Cause
        What may be wrong, the most likely first, each with the change to make; of consistent data what they show by themselves.
    corrections : tuple of Cause
        Those of the class that were tried, each with the margin that it brings.
    left_out : tuple of str
        Changes for which there was no time.
    notes : tuple of str
        How single frequency points contradict a passive class.
    passive : bool
        Whether the class is a passive one: data are changed too, in their sign, phase or derivative.
    """

    inflation: float
    active: tuple[tuple[str, int, float, float], ...]
    causes: tuple[Cause, ...]
    corrections: tuple[Cause, ...]
    left_out: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    passive: bool = False

    def best(self) -> Cause | None:
        """The correction with the smallest margin."""
        return min(self.corrections, key=_margin, default=None)

    def __str__(self) -> str:
        return self.summary()

    def summary(self) -> str:
        """Plain sentences, one change a line."""
        return "\n".join(self._lines())

    def _lines(self) -> list[str]:
        consistent = self.inflation <= 1
        head = (
            f"The data are consistent: the bounds could shrink to {self.inflation:.3g} times their size."
            if consistent
            else f"The data contradict the class: they are consistent once every bound is {self.inflation:.4g} times as large."
        )
        names = [
            f"{hz_words(at / (2 * np.pi))} ({100 * weight:.0f} %)"
            if kind == "frequency"
            else f"{at:.5g} s ({100 * weight:.0f} %)"
            for kind, _, at, weight in self.active[:8]
        ]
        lines = [*self._first(), head, *self.notes]
        if names:
            lines.append("Active constraints, with their dual weight in the proof: " + ", ".join(names) + ".")
        changed = "classes and data" if self.passive else "classes"
        if self.corrections or self.left_out:
            lines.append(f"What other {changed} would bring, all else equal (margin = factor on the bounds):")
        lines += [
            f"  {one.name}: margin {one.margin:.3g}, {_effect(_margin(one), self.inflation)}"
            for one in self.corrections
        ]
        if self.left_out:
            lines.append(f"  no time was left for: {', '.join(self.left_out)}")
        if self.corrections and not self.passive:
            lines.append(_ASKS_LESS)
            lines += [] if consistent else [_NO_KNOWLEDGE]
        return [*lines, *self._last()]

    @property
    def next_steps(self) -> list[str]:
        """The likely cause and the change to make: the first and the last sentence of the summary."""
        lines = self._lines()
        return list(dict.fromkeys([lines[0], lines[-1]]))

    def _first(self) -> list[str]:
        """The most likely cause, and others."""
        if not self.causes:
            return []
        first, *others = self.causes
        lines = [f"Most likely cause: {first.cause} ({first.evidence})."]
        if others:
            named = "; ".join(f"{one.cause} ({one.evidence})" for one in others[: _MOST_NAMED - 1])
            lines.append(f"It may also be that {named}.")
        return lines

    def _last(self) -> list[str]:
        """The change to make."""
        return [f"Change to make: {one}." for cause in self.causes[:1] if (one := cause.sentence)]


@one_thread()
def diagnose(
    identification: Identification, *, time_limit: float | None = 60.0, progress: Progress | None = None
) -> Diagnosis:
    """Name the active constraints of a result, what inflation of the bounds makes the data consistent, and what else would.

    Solves for the margin with the class changed in one respect at a time: each pair of the parametric part repeated (terms
    k a^k, which absorb errors of the poles to first order), one more pair where the frequency points show what the others lack
    most, the gain bound times 2 and times 10, half the decay (rho - 1), and the intervals of the coefficients left out.
    Of a passive class: half the decay, and the data with the opposite sign, phase, and as derivative or integral.
    Inconsistent data with up to 100 coefficients: also the poles of the pairs moved (`improve_kautz`).

    Parameters
    ----------
    identification : Identification
        Usually of inconsistent data.
    time_limit : float, optional
        Seconds after which no further change is tried; margins that were reached by then are kept. So it is on Ctrl-C. None: no
        limit.
    progress : callable (text, done, count), optional
        Changes.

    Returns
    -------
    Diagnosis

    Raises
    ------
    InputTypeError
        Something that isn't an Identification.

    Notes
    -----
    The margins of the corrections are reached by systems of the changed classes (upper ends, not certified from below).
    Source: dual weights from the dual of Theorem 1 of `inanc2001`.

    Examples
    --------
    >>> import robustid as rid
    >>> from robustid.advice import diagnose
    >>> record = rid.TimeRecord([1.0, 0.0], [0.5, 2.0], dt=1.0, bound=0.1)
    >>> prior = rid.Prior(gain_bound=1.0, decay_rate=1.1)
    >>> found = diagnose(rid.identify(rid.MixedProblem(time=record, prior=prior)))
    >>> found.inflation > 1, [one.name for one in found.corrections]
    (True, ['K times 2', 'K times 10', 'rho - 1 halved'])
    """
    as_kind("identification", identification, Identification, "an Identification")
    problem, inconsistent = identification.problem, not identification.consistent
    budget, active = Budget(time_limit), tuple(identification.conflicting_samples())
    changes, causes, tried = changes_of(problem), list[Cause](), list[Cause]()
    waiting = [*(change.name for change in changes), *([_MOVED] * _may_move(identification))]
    count = len(waiting)
    tell = Budget(None, progress, "what would help").tell
    with Interruptible() as search:
        causes += causes_of_experiments(problem, problem.faults, identification.margin, budget)
        causes += causes_without_class(problem, identification.margin, budget)
        if inconsistent and not (problem.prior.physical or any(one.solves for one in causes)):
            causes += tried_causes(problem, identification.margin, active, budget)
            if not any(one.solves for one in causes):
                beside = causes_of_experiments(problem, problem.record_faults, identification.margin, budget)
                causes += [one for one in beside if one.solves]
        if any(one.solves for one in causes) and inconsistent:  # another class would only suit the mistake
            changes, waiting = [], []
        for change in changes:
            if budget.over:
                break
            try:
                margin = judged_margin(change.problem, np.inf, budget)
            except InputError as error:  # functions that the samples can't tell apart
                _log.info("%s: left out (%s)", change.name, error)
            else:
                if np.isinf(margin):  # no system was reached in time, or the problem is too large
                    if budget.over:
                        break
                    continue
                tried.append(change._replace(margin=margin))
            waiting.remove(change.name)
            tell(count - len(waiting), count)
        if waiting == [_MOVED] and not budget.over:
            if (moved := _moved_poles(problem, budget)) is not None:
                tried.append(moved)
            waiting.remove(_MOVED)
            tell(count, count)
        unsolved = inconsistent and not any(one.solves for one in causes) and not any(one.solves for one in tried)
        if unsolved and not budget.over and (others := found_modes(problem)) is not None:
            margin = judged_margin(others.problem, np.inf, budget)
            tried += [others._replace(margin=margin)] if np.isfinite(margin) else []
            unsolved = margin > 1
        if unsolved:
            causes += unit_cause(problem, identification.margin, budget)
    if search.interrupted:
        _log.warning("interrupted: the changes that were tried so far are returned")
    return Diagnosis(
        inflation=identification.margin,
        active=active,
        causes=tuple(_ranked(identification, causes, tried) if inconsistent else causes),
        corrections=tuple(tried),
        left_out=tuple(waiting),
        notes=contradictions(problem) if problem.prior.physical and inconsistent else (),
        passive=bool(problem.prior.physical),
    )


def _may_move(identification: Identification) -> bool:
    """Return whether moving the poles is tried."""
    problem = identification.problem
    return not (identification.consistent or problem.prior.physical) and problem.coefficients <= QUICK_EXACT


def _margin(cause: Cause) -> float:
    return np.inf if cause.margin is None else cause.margin


def _ranked(identification: Identification, causes: list[Cause], tried: list[Cause]) -> list[Cause]:
    """Causes, the most likely first: the data alone, corrections without freedom, bounds a little too small, then the class."""
    problem, margin = identification.problem, identification.margin
    bounds = bound_cause(problem, margin)
    of_class = [
        one._replace(evidence=f"with this change the margin is {one.margin:.3g} in place of {margin:.4g}")
        for one in sorted(tried, key=lambda one: one.kind)
        if _margin(one) <= max(1.0, margin / HELPS)
    ]
    sure = [one for one in causes if (one.margin is None or one.solves) and not one.unsure]
    solving, helping = ([one for one in of_class if one.solves is which] for which in (True, False))
    rest = [] if sure else [one for one in causes if one not in sure]
    of_reference = class_cause(identification)
    if of_reference is not None:  # the bounds that it needs say nothing of those that are right
        return [*sure, *solving, of_reference, *helping, *rest, bounds]
    # Bounds that are off by an order are an error of judgement; by two, of something else.
    if margin <= SLIGHTLY:
        return [*sure, bounds, *solving, *helping, *rest]
    if margin <= _AN_ORDER:
        return [*sure, *solving, bounds, *helping, *rest]
    return [*sure, *solving, *helping, *rest, bounds]


def _moved_poles(problem: MixedProblem, budget: Budget) -> Cause | None:
    """The poles of the pairs moved, where there are pairs and that helps."""
    try:
        found = improve_kautz(problem, repeat=False, time_limit=budget.seconds)
    except (InputError, SolverError) as error:
        _log.info("poles moved: left out (%s)", error)
        return None
    poles = zip(found.omega / (2 * np.pi), found.damping, strict=True)
    places = ", ".join(f"{hz_words(hz)} with damping {damping:.3g}" for hz, damping in poles)
    if not found.moved:
        return None
    options = mode_options(found.problem)
    change, name = f"rid.kautz(...) with {places}", f"{_MOVED}, to {places}"
    return Cause(_ELSEWHERE, change, options, found.problem, Kind.POLES, name, margin=found.margin)


def _effect(margin: float, before: float) -> str:
    if margin <= 1 < before:
        return "consistent"
    if margin > 0.95 * before:
        return "next to nothing gained"
    return f"{before / margin:.3g} times smaller" + (", still inconsistent" if margin > 1 else "")


def causes_of_experiments(problem: MixedProblem, faults: Sequence[Fault], margin: float, budget: Budget) -> list[Cause]:
    """Causes that are faults of single experiments; their corrections are tried together."""
    if not faults:
        return []
    changed: MixedProblem | None = problem
    for fault in faults:
        if fault.correction and changed is not None:
            changed = _place(fault).corrected(changed, fault.correction)
    after = None
    if changed is not None and changed is not problem:
        with contextlib.suppress(InputError):
            after = judged_margin(changed, 1.0, budget)
    causes: list[Cause] = []
    for fault in faults:
        if not fault.correction or changed is None or after is None:
            causes.append(Cause(fault.cause, "", "", problem, evidence=fault.evidence))
            continue
        change, option = _place(fault).change(problem, fault.correction)
        shown = f"with the correction the margin is {after:.3g} in place of {margin:.4g}"
        causes.append(Cause(fault.cause, change, option, changed, evidence=shown, margin=after))
    return causes


def _place(fault: Fault) -> Experiment:
    """The experiment that a fault is of."""
    return (
        Experiment("frequency", fault.response - 1) if fault.response else Experiment("time", max(fault.record - 1, 0))
    )

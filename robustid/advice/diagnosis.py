"""diagnose(): causes of a contradiction between data and class, and the margin that each remedy would bring."""

from __future__ import annotations

import dataclasses
import logging
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from robustid.advice.kautz import further_mode
from robustid.advice.pole_search import improve_kautz
from robustid.bases import ParametricBasis, as_basis, kautz
from robustid.core import Budget, Complex, Frozen, Plane, Progress, Real, as_kind, one_thread
from robustid.data import FrequencyResponse
from robustid.errors import InputError, SolverError
from robustid.identification import Identification, MixedProblem, contradictions
from robustid.identification.formulation import QUICK_EXACT, formulate
from robustid.identification.solver import margin_path

_log = logging.getLogger("robustid")

_MOVED = "poles moved"
_UNWEIGHTED = "a bound that does not fall with the frequency"
_DIGITS = 1e-3  # relative gap at which the margin of a trial is taken
_SAME_POLE = 1e-2  # of the distance to the circle: eigenvalue routines split repeated poles, by far less


# What a response may be in the place of that of a passive plant.
_TURNED = (
    "the phase with the opposite sign (exp(-j omega t))",
    "the response with the opposite sign",
    "the response times j omega (of a displacement the velocity)",
    "the response over j omega (of an acceleration the velocity)",
)


class Trial(NamedTuple):
    """One change of the class, the margin that it brings (to 0.1 %), and the changed problem."""

    change: str
    margin: float
    problem: MixedProblem


@dataclasses.dataclass(frozen=True, eq=False, kw_only=True)
class Diagnosis(Frozen):
    """Active constraints of an identification, and the margin that each change of the class would bring.

    Attributes
    ----------
    inflation : float
        The margin: the factor on all bounds with which the data are consistent.
    active : tuple of (kind, experiment, rad/s or s, weight)
        Active constraints: samples with their dual weight in the proof, largest first; all weights sum to one.
    trials : tuple of Trial
    left_out : tuple of str
        Changes for which there was no time.
    notes : tuple of str
        How single frequency points contradict a passive class.
    passive : bool
        Whether the class is a passive one: data are changed too, in their sign, phase or derivative.
    """

    inflation: float
    active: tuple[tuple[str, int, float, float], ...]
    trials: tuple[Trial, ...]
    left_out: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    passive: bool = False

    def best(self) -> Trial | None:
        """The change with the smallest margin."""
        return min(self.trials, key=lambda trial: trial.margin, default=None)

    def summary(self) -> str:
        """Plain sentences, one change a line."""
        consistent = self.inflation <= 1
        head = (
            f"The data are consistent: the bounds could shrink to {self.inflation:.3g} times their size."
            if consistent
            else f"The data contradict the class: they are consistent once every bound is {self.inflation:.4g} times as large."
        )
        names = [
            f"{at / (2 * np.pi):.5g} Hz ({100 * weight:.0f} %)"
            if kind == "frequency"
            else f"{at:.5g} s ({100 * weight:.0f} %)"
            for kind, _, at, weight in self.active[:8]
        ]
        lines = [head, *self.notes]
        if names:
            lines.append("Active constraints, with their dual weight in the proof: " + ", ".join(names) + ".")
        changed = "classes and data" if self.passive else "classes"
        lines.append(f"What other {changed} would bring, all else equal (margin = factor on the bounds):")
        lines += [
            f"  {trial.change}: margin {trial.margin:.3g}, {_effect(trial.margin, self.inflation)}"
            for trial in self.trials
        ]
        if self.left_out:
            lines.append(f"  no time was left for: {', '.join(self.left_out)}")
        if self.passive:
            return "\n".join(lines)
        lines.append(
            "More pairs add assumptions that the data can test; a larger K or a slower decay only asks less, and its guarantee"
            " between the samples is weaker."
        )
        if not consistent:
            lines.append(
                "Poles that were moved to suit the data are no prior knowledge: improve_kautz says which intervals the frequency"
                " points leave"
                " to them."
            )
        return "\n".join(lines)


@one_thread()
def diagnose(
    identification: Identification, *, time_limit: float | None = None, progress: Progress | None = None
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
        Seconds after which no further change is tried; margins that were reached by then are kept. So it is on Ctrl-C.
    progress : callable (done, all), optional
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
    The margins of the trials are reached by systems of the changed classes (upper ends, not certified from below).
    Source: dual weights from the dual of Theorem 1 of `inanc2001`.

    Examples
    --------
    >>> import robustid as rid
    >>> from robustid.advice import diagnose
    >>> record = rid.TimeRecord([1.0, 0.0], [0.5, 2.0], dt=1.0, bound=0.1)
    >>> prior = rid.Prior(gain_bound=1.0, decay_rate=1.1)
    >>> found = diagnose(rid.identify(rid.MixedProblem(time=record, prior=prior)))
    >>> found.inflation > 1, [trial.change for trial in found.trials]
    (True, ['K times 2', 'K times 10', 'rho - 1 halved'])
    """
    as_kind("identification", identification, Identification, "an Identification")
    problem = identification.problem
    K, rate = problem.prior.gain_bound, problem.prior.rate
    physical = bool(problem.prior.physical)
    changes: list[tuple[str, MixedProblem]] = []
    if not physical and (terms := _further_terms(problem)) is not None:
        changes.append(("each pair repeated once more", _with_functions(problem, terms)))
    if not physical and (pair := _missing_pair(problem)) is not None:
        changes.append((pair[0], _with_functions(problem, pair[1])))
    if physical:
        changes += _other_data(problem)
    else:
        changes += [(f"K times {factor}", problem.with_prior(gain_bound=factor * K)) for factor in (2, 10)]
    slower = ("rho - 1 halved", 1 + (rate - 1) / 2) if problem.dt else ("decay halved", rate / 2)
    changes.append((slower[0], problem.with_prior(rate=slower[1])))
    if problem.prior.weighted:
        changes.append((_UNWEIGHTED, problem.with_prior(roll_off=None, corner=None, weight=None)))
    if problem.parameter_bounds is not None and not physical:
        changes.append(("coefficients without intervals", dataclasses.replace(problem, parameter_bounds=None)))
    moving = not (identification.consistent or physical) and problem.coefficients <= QUICK_EXACT
    budget, count = Budget(time_limit, progress), len(changes) + moving
    trials: list[Trial] = []
    waiting = [*(text for text, _ in changes), *([_MOVED] * moving)]
    try:
        for text, changed in changes:
            if budget.over:
                break
            try:
                margin = _reachable_margin(changed, budget)
            except InputError as error:  # functions that the samples can't tell apart
                _log.info("%s: left out (%s)", text, error)
            else:
                if np.isinf(margin):  # no system was reached in time
                    break
                trials.append(Trial(text, margin, changed))
            waiting.remove(text)
            budget.tell(count - len(waiting), count)
        if moving and not budget.over:
            trials += _moved_poles(problem, budget)
            waiting.remove(_MOVED)
            budget.tell(count, count)
    except KeyboardInterrupt:
        _log.warning("interrupted: the changes that were tried so far are returned")
    return Diagnosis(
        inflation=identification.margin,
        active=tuple(identification.conflicting_samples()),
        trials=tuple(trials),
        left_out=tuple(waiting),
        notes=contradictions(problem) if physical and not identification.consistent else (),
        passive=physical,
    )


def _other_data(problem: MixedProblem) -> list[tuple[str, MixedProblem]]:
    """Data as they may have been measured in the place of those of a passive plant: another sign, phase, or derivative."""
    turns: list[tuple[str, Callable[[Real], Any], bool]] = [(_TURNED[0], np.ones_like, True)]
    if problem.prior.passive == "negative imaginary":
        turns += [
            (_TURNED[1], _minus_one, False),
            ("the response over j omega (of a velocity the displacement)", _integral, False),
        ]
    elif problem.prior.positive_real:
        factors: tuple[Callable[[Real], Any], ...] = (_minus_one, _derivative, _integral)
        turns += [(words, factor, False) for words, factor in zip(_TURNED[1:], factors, strict=True)]
    if any(np.any(frf.omega == 0) for frf in problem.frequency):
        turns = turns[:2]
    if any(frf.bound.joint != "entry" or frf.bound.tilt is not None for frf in problem.frequency):
        turns = []
    changes: list[tuple[str, MixedProblem]] = []
    for words, factor, conjugated in turns:
        changed: list[FrequencyResponse] = []
        for frf in problem.frequency:
            by = factor(frf.omega)[:, None, None]
            values = frf.values.conj() if conjugated else frf.values * by
            bound = dataclasses.replace(frf.bound, radius=np.asarray(frf.bound.radius) * np.abs(by))
            changed.append(dataclasses.replace(frf, values=values, bound=bound))
        prior = problem.prior
        if prior.positive_real:
            prior = dataclasses.replace(prior, gain_bound=None)
        modes = problem.parametric if problem.functions else None
        posed = MixedProblem(frequency=changed, prior=prior, parametric=modes, symmetric=problem.symmetric)
        changes.append((words, posed))
    return changes


def _minus_one(omega: Real) -> Real:
    return -np.ones(omega.size)


def _derivative(omega: Real) -> Complex:
    return np.asarray(1j * omega, dtype=complex)


def _integral(omega: Real) -> Complex:
    return np.asarray(-1j / omega, dtype=complex)


def _moved_poles(problem: MixedProblem, budget: Budget) -> list[Trial]:
    """The trial with the poles of the pairs moved, where there are pairs and that helps."""
    try:
        found = improve_kautz(problem, repeat=False, time_limit=budget.seconds)
    except (InputError, SolverError) as error:
        _log.info("poles moved: left out (%s)", error)
        return []
    poles = zip(found.omega / (2 * np.pi), found.damping, strict=True)
    places = ", ".join(f"{hz:.5g} Hz with damping {damping:.3g}" for hz, damping in poles)
    return [Trial(f"poles moved, to {places}", found.margin, found.problem)] if found.moved else []


def _effect(margin: float, before: float) -> str:
    if margin <= 1 < before:
        return "consistent"
    if margin > 0.95 * before:
        return "next to nothing gained"
    return f"{before / margin:.3g} times smaller" + (", still inconsistent" if margin > 1 else "")


def _reachable_margin(problem: MixedProblem, budget: Budget) -> float:
    """A margin that some system reaches, within 0.1 % (or 0.001) of the smallest, or as near as there is time for."""
    margin = np.inf
    for _, margin, gap in margin_path(formulate(problem, accuracy=_DIGITS).data):
        if gap <= _DIGITS * max(margin, 1.0) or budget.over:
            break
    return float(margin)


def _with_functions(problem: MixedProblem, basis: ParametricBasis) -> MixedProblem:
    parts = (basis,) if problem.parametric is None else (problem.parametric, basis)
    bounds = problem.parameter_bounds
    if bounds is not None:
        free = np.broadcast_to([-np.inf, np.inf], (basis.size, *bounds.shape[1:]))
        bounds = np.concatenate([bounds, free])
    return dataclasses.replace(problem, parametric=parts, parameter_bounds=bounds)


def _mode_of(poles: Complex, plane: Plane) -> tuple[Real, Real]:
    """Natural frequency in rad/s and damping ratio of complex poles."""
    logs = np.log(poles)
    size = np.abs(logs)
    return plane.modes(size, -np.log(np.abs(poles)) / size)


def _modes(problem: MixedProblem) -> list[tuple[Complex, int]]:
    """Complex poles of the parametric part, upper half, each with its multiplicity."""
    poles = np.zeros(0) if problem.parametric is None else problem.parametric.poles
    left = list(poles[poles.imag > 0])
    modes: list[tuple[Complex, int]] = []
    while left:
        same = [a for a in left if abs(a - left[0]) <= _SAME_POLE * (1 - abs(left[0]))]
        left = [a for a in left if a not in same]
        modes.append((np.array([np.mean(same)], complex), len(same)))
    return modes


def _further_terms(problem: MixedProblem) -> ParametricBasis | None:
    """The next derivative terms k^j a^k of every complex pole pair of the parametric part."""
    parts: list[ParametricBasis] = []
    for pole, count in _modes(problem):
        chain = kautz(*_mode_of(pole, problem.plane), dt=problem.dt, repeat=count + 1, delay=int(problem.dt > 0))
        parts.append(dataclasses.replace(chain, C=chain.C[-2:], D=chain.D[-2:], labels=chain.labels[-2:]))
    return as_basis(parts, problem.plane) if parts else None


def _missing_pair(problem: MixedProblem) -> tuple[str, ParametricBasis] | None:
    """The pair that the frequency points ask for most, beside those that are there."""
    lines = [f for f in problem.frequency if isinstance(f, FrequencyResponse)]
    if not lines:
        return None
    omega, value, bound = (
        np.concatenate(parts) for parts in zip(*((f.omega, f.values, f.bound.outer_radius) for f in lines), strict=True)
    )
    poles = np.concatenate([pole for pole, _ in _modes(problem)] or [np.zeros(0, complex)])
    if 2 * omega.size < 4 * (poles.size + 1) + 4:
        return None
    data = FrequencyResponse(omega, value, bound=bound, dt=problem.dt or None)
    new = further_mode(data, *_mode_of(poles, problem.plane))
    text = f"one more pair, at {new[0] / (2 * np.pi):.4g} Hz with damping {new[1]:.2g}"
    return text, kautz(*new, dt=problem.dt, delay=int(problem.dt > 0))

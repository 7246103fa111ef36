"""identify(): consistency, its proof, and a model from the consistent set."""

from __future__ import annotations

import dataclasses
import logging
import time

import numpy as np

from robustid.core import (
    Budget,
    Choice,
    Interruptible,
    Progress,
    Source,
    Stops,
    as_positive,
    one_thread,
    pass_on,
    threads_for,
)
from robustid.data import FrequencyPoints, TimeRecord
from robustid.errors import InputError, InputTypeError, SolverError
from robustid.identification.formulation.base import Formulation
from robustid.identification.formulation.choice import FORMS, formulate
from robustid.identification.formulation.convex import Candidate, ConvexData
from robustid.identification.margin import LATE, check_conic_size, margin_without_steps, prove_margin, wants_conic
from robustid.identification.model import level_of, nominal_model
from robustid.identification.problem import MixedProblem
from robustid.identification.result import Identification
from robustid.identification.solver.cvxpy_backend import solve_conic
from robustid.identification.solver.paths import analytic_center, gain_path
from robustid.identification.verification import Claim, verify

_log = logging.getLogger("robustid")

OBJECTIVES = ("center", "margin", "gain", "order")
_PROOF = 0.6  # part of a time limit after which the margin must do; the rest is for the model


@one_thread()
def identify(
    problem: MixedProblem,
    *,
    objective: str = "center",
    solver: str = "auto",
    accuracy: float = 1e-4,
    form: str = "auto",
    time_limit: float | None = None,
    progress: Progress | None = None,
) -> Identification:
    """Decide whether the data fit the class, with a proof either way, and return a model.

    The margin is the smallest s for which a system F = p'P + G of the class keeps ``|residual| <= s * bound`` at every
    sample. Its upper end is a system, its lower end a certificate; both are recomputed from the numbers, and the data
    are consistent iff it is at most 1. The model is a central interpolant, in closed form.

    Parameters
    ----------
    problem : MixedProblem
        What was measured and assumed.
    objective : {"center", "margin", "gain", "order"}
        Which consistent system: the analytic centre of the set with bounds max(1, margin (1 + 1e-6)) * bound (the default);
        the smallest residuals (bounds margin + accuracy); the smallest gain bound K (to 1e-4); the smallest nuclear norm of a
        Hankel (Loewner) matrix of G, which favours models that reduce well.
    solver : str
        "structured" (our own interior-point method), "cvxpy" (Clarabel), the name of any installed cvxpy solver for semidefinite
        programs, or "auto": Clarabel up to 24 coefficients, the structured one above or where a solver's numbers don't hold.
    accuracy : float
        Largest ``margin - margin_lower`` (relative where the margin exceeds 1).
    form : {"auto", "orthonormal", "classical", "taylor", "sections"}
        The finite problem. "orthonormal": exact, one coefficient per datum, up to 200; "classical": the same in the basis of
        Theorem 1 of `inanc2001`, for small data. "taylor": the first L Taylor coefficients of G, L so large that what is left
        out changes no sample by more than a tenth of `accuracy`, in units of its bound, whatever the number of samples; the
        tails are part of the proof on both sides, and the model is the central interpolant of the L coefficients without the
        states that do not matter. "sections": the same with the powers of an all-pass function of low degree in place of those
        of the delay, chosen so that the tails are small at the frequency points: several times fewer coefficients where these
        fill a part of the circle only (oversampled data, rho near 1); with time samples that are not periodic it is "taylor".
        "auto": exact up to 100 coefficients, then the one with the least work.
    time_limit : float, optional
        Seconds. When they are over the step at hand is finished, and what is proved by then is returned, verified, with the width
        of the interval as its `accuracy` and a note; so it is on Ctrl-C. Of a matrix of which one step would take longer than
        that, it is what least squares of the parametric part alone say. A margin of at most 1 decides by itself, however wide
        the interval; the model keeps it, if it isn't the centre.
    progress : callable (text, done, count), optional
        Parts of the proof of the margin.

    Returns
    -------
    Identification
        Status, margin with its proof, model, residuals and what was verified. Inconsistent data are a result, not an
        exception; ``result.require()`` raises.

    Raises
    ------
    SizeError
        More than 200 coefficients in the exact form (two per frequency point, one per time sample), 2000 Taylor coefficients and
        1000 coefficients of repeated sections; 100 for a solver that is not ours.
    SolverError
        No solver returned usable numbers.

    Notes
    -----
    Source: `inanc2001` Theorem 1 and Problem 1; the certificate is the dual of that LMI.

    Examples
    --------
    >>> import numpy as np, robustid as rid
    >>> record = rid.TimeRecord(np.eye(1, 2)[0], [0.5, 0.7], dt=1.0, bound=1e-3)
    >>> prior = rid.Prior(gain_bound=1.0, decay_rate=1.01)
    >>> result = rid.identify(rid.MixedProblem(time=record, prior=prior))
    >>> result.consistent, result.model.nstates
    (True, 1)
    """
    _check_arguments(problem, objective, form)
    accuracy, budget = as_positive("accuracy", accuracy), Budget(time_limit, progress, "margin and model")
    formulation = formulate(problem, form, accuracy)
    formulation.check_memory()
    if formulation.is_late(budget.seconds) and not problem.prior.positive_real:
        return _without_steps(formulation, objective, accuracy)
    with threads_for(formulation.count * max(1, problem.entries.count // 2)):
        return _identify(formulation, objective, solver, accuracy, budget)


def _identify(formulation: Formulation, objective: str, solver: str, accuracy: float, budget: Budget) -> Identification:
    clock, data = _Clock(), formulation.data
    if objective == "order":
        check_conic_size(max(data.sarason.blocks))
    clock.lap("assembly")
    stops = Stops()
    with stops.listening():
        claim, passed = prove_margin(data, solver, accuracy, budget.share(_PROOF))
    clock.lap("margin")
    _log.info("margin between %.6g and %.6g", claim.certificate.value, claim.margin)
    level = level_of(objective, claim.margin, claim.accuracy, formulation.problem.prior)
    chosen: tuple[Candidate, Formulation, dict[str, Choice]] | None = None
    with Interruptible():
        pass_on(stops.interrupted and bool(passed))  # a point of the way is there: nobody waits for the centre
        chosen = _choose_point(formulation, level, objective, solver, passed, budget)
    point, used, choices = chosen or _interrupted(formulation, level, objective, passed)
    clock.lap("centre")
    return _result(formulation, used, point, claim, objective, accuracy, choices, clock)


def _without_steps(formulation: Formulation, objective: str, accuracy: float) -> Identification:
    """Identification by the parametric part alone, known before the first step, which would take longer than there is time."""
    clock, data = _Clock(), formulation.data
    claim = margin_without_steps(data, accuracy)
    clock.lap("margin")
    point = Candidate(claim.x, claim.p, claim.certificate.samples, claim.certificate.ball, claim.solver)
    words = f"{LATE}: the model is the parametric part alone, by least squares, not that of objective {objective!r}"
    choices = {"objective": Choice(None, Source.STOPPED, words)}
    return _result(formulation, formulation, point, claim, objective, accuracy, choices, clock)


def _result(
    formulation: Formulation,
    used: Formulation,
    point: Candidate,
    claim: Claim,
    objective: str,
    accuracy: float,
    choices: dict[str, Choice],
    clock: _Clock,
) -> Identification:
    """The model of a point of the formulation that is `used`, and everything verified."""
    level = level_of(objective, claim.margin, claim.accuracy, formulation.problem.prior)
    nominal = nominal_model(used, point, level)
    clock.lap("model")
    checks = verify(used, point, nominal, claim, formulation.data, level)
    clock.lap("verification")
    return Identification(
        formulation=formulation,
        objective=objective,
        claim=claim,
        prior=used.problem.prior,
        coefficients=point.x,
        scaled_parameters=point.p,
        model=nominal.model,
        verification=checks,
        timing=clock.laps,
        choices=_proof(claim, accuracy) | choices,
    )


def _proof(claim: Claim, asked: float) -> dict[str, Choice]:
    """The interval of the margin, where it is wider than was asked for."""
    ends = claim.certificate.value, claim.margin
    if claim.stopped:
        return {"margin": Choice(ends, Source.STOPPED, claim.stopped)}
    if claim.accuracy <= asked:
        return {}
    words = (
        f"the margin is known to {claim.width:.2g} only, as far as the digits of the solver go ({asked:g} was asked for): it is"
        f" proved to lie between {ends[0]:.6g} and {ends[1]:.6g}"
    )
    return {"margin": Choice(ends, Source.PROGRAM, words)}


def _check_arguments(problem: object, objective: str, form: str) -> None:
    if not isinstance(problem, MixedProblem):
        kind, others = type(problem).__name__, ""
        if isinstance(problem, FrequencyPoints | TimeRecord | list | tuple):
            others = ". Of data alone identify_reduced(data) chooses the class; MixedProblem(frequency=..., prior=...) states it"
        raise InputTypeError(f"`problem` must be a MixedProblem; got {kind}{others}")
    if objective not in OBJECTIVES:
        raise InputError(f"`objective` must be one of {OBJECTIVES}; got {objective!r}")
    if problem.prior.positive_real and objective in ("gain", "order"):
        raise InputError(
            f"`objective` = {objective!r} needs a gain bound, which a PositiveReal class has not; take 'center' or 'margin'"
        )
    if form not in FORMS:
        raise InputError(f"`form` must be one of {FORMS}; got {form!r}")


def _choose_point(
    formulation: Formulation, level: float, objective: str, solver: str, passed: list[Candidate], budget: Budget
) -> tuple[Candidate, Formulation, dict[str, Choice]]:
    """The point that the objective asks for, the formulation it belongs to, and the choice of another in its place."""
    data = formulation.data
    center = analytic_center(data, level, passed, budget)
    if budget.over:
        words = f"{LATE}: the model is consistent with the margin, but not that of objective {objective!r}"
        return center, formulation, {"objective": Choice("center", Source.STOPPED, words)}
    if objective in ("center", "margin") or not data.sarason.pair.order:
        return center, formulation, {}
    if objective == "order":
        try:
            found = solve_conic(data, "order", solver=solver, factor=level, seconds=budget.left)
        except SolverError as problem:
            words = f"{problem}: the model is the analytic centre, not that of objective 'order'"
            return center, formulation, {"objective": Choice("center", Source.PROGRAM, words)}
        return _step_inside(found, center, data, level), formulation, {}
    K = formulation.problem.prior.gain_bound
    gain, growth = _smallest_gain(data, center, level, solver, budget), 1e-3
    while gain < 1:
        smaller = formulation.with_gain(K * gain)
        try:
            return analytic_center(smaller.data, level), smaller, {}
        except SolverError:  # the solver's gain was too small
            gain, growth = gain * (1 + growth), 4 * growth
    return center, formulation, {}


def _interrupted(
    formulation: Formulation, level: float, objective: str, passed: list[Candidate]
) -> tuple[Candidate, Formulation, dict[str, Choice]]:
    """The first point on the way to the margin that is inside the set, after Ctrl-C; which is passed on where there is none."""
    inside = [point for point in passed if formulation.data.margin(point.x, point.p) <= level]
    pass_on(not inside)
    words = f"interrupted: the model is consistent with the margin, but not that of objective {objective!r}"
    return inside[0], formulation, {"objective": Choice(None, Source.STOPPED, words)}


def _smallest_gain(data: ConvexData, center: Candidate, level: float, solver: str, budget: Budget) -> float:
    """Smallest kappa for which gain kappa K is consistent at `level`, from above, to 1e-4."""
    if wants_conic(data.sarason, solver):
        try:
            found = solve_conic(data, "gain", solver=solver, factor=level, seconds=budget.left)
            return data.sarason.norm(found.x) * (1 + 1e-4) + 1e-9
        except SolverError as problem:
            _log.warning("%s; using the structured solver", problem)
    kappa = 1.0
    for _, kappa, gap in gain_path(data, center, level):
        if gap <= 1e-4 * kappa or kappa < 1e-9 or budget.over:
            break
    return kappa + 1e-9


def _step_inside(found: Candidate, center: Candidate, data: ConvexData, level: float) -> Candidate:
    """The nearest point to `found`, towards the centre, that is strictly inside the set."""
    for t in (0.0, *np.logspace(-9, 0, 28)):
        x, p = (1 - t) * found.x + t * center.x, (1 - t) * found.p + t * center.p
        if data.margin(x, p) <= level and data.sarason.norm(x) <= 1 - 1e-9:
            return dataclasses.replace(found, x=x, p=p)
    return center


class _Clock:
    """Seconds per stage."""

    def __init__(self) -> None:
        self.laps: dict[str, float] = {}
        self._last = time.perf_counter()

    def lap(self, name: str) -> None:
        now = time.perf_counter()
        self.laps[name] = now - self._last
        self._last = now

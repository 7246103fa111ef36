"""identify(): consistency, its proof, and a model from the consistent set."""

from __future__ import annotations

import dataclasses
import logging
import time
from typing import Any

import numpy as np

from robustid._arrays import as_positive
from robustid.errors import InputError, InputTypeError, SizeError, SolverError, Status
from robustid.identification.exact import exact_data, level_of
from robustid.identification.model import join_model
from robustid.identification.result import Identification
from robustid.identification.verification import verify
from robustid.interpolation import (
    ClassicalForm,
    MarginCertificate,
    MixedProblem,
    SarasonMap,
    certify_margin,
    classical_form,
    interpolants,
)
from robustid.solve import Candidate, ConvexData, analytic_center, gain_path, margin_path, solve_conic

_log = logging.getLogger("robustid")

OBJECTIVES = ("center", "margin", "gain", "order")
# A general semidefinite solver needs n^4 memory and n^6 work: "auto" asks it while it is quick, and never above the last.
QUICK_CONIC, LARGEST_CONIC = 24, 100
_SPARE = 0.01  # part of the accuracy that is aimed at: digits are cheap at the end of the path


def identify(
    problem: MixedProblem,
    *,
    objective: str = "center",
    solver: str = "auto",
    accuracy: float = 1e-4,
    form: str = "orthonormal",
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
        "cvxpy" (Clarabel), the name of any installed cvxpy solver for semidefinite programs, or "auto": Clarabel while it is
        quick, our own central path above 24 coefficients or where the solver's numbers don't hold.
    accuracy : float
        Largest ``margin - margin_lower`` (relative where the margin exceeds 1).
    form : {"orthonormal", "classical"}
        Basis of the linear matrix inequality; "classical" is Theorem 1 of `inanc2001`, for small data.

    Returns
    -------
    Identification
        Status, margin with its proof, model, residuals and what was verified. Inconsistent data are a result, not an
        exception; ``result.require()`` raises.

    Raises
    ------
    SizeError
        More than 200 real coefficients (two per frequency line, one per time sample); 100 for a named solver.
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
    accuracy = as_positive("accuracy", accuracy)
    clock = _Clock()
    exact = _exact_form(problem, form)
    clock.lap("assembly")
    margin, certificate = _margin(exact, solver, accuracy)
    clock.lap("margin")
    _log.info("margin between %.6g and %.6g", certificate.value, margin[0])
    level = level_of(objective, margin[0], accuracy)
    point, used = _choose_point(exact, level, objective, solver, form)
    clock.lap("model")
    family = interpolants(used.data.sarason, point.x)
    realised = join_model(used.problem, used.data.rows, family.realise(), point.p)
    status = _status(margin[0], certificate.value, accuracy)
    checks = verify(used.problem, used.data, point, realised, certificate, exact.data, level, (margin[0], accuracy))
    clock.lap("verification")
    return Identification(
        problem=problem,
        status=status,
        objective=objective,
        margin=margin[0],
        margin_lower=certificate.value,
        accuracy=accuracy,
        prior=used.problem.prior,
        coefficients=point.x,
        scaled_parameters=point.p,
        certificate=certificate,
        model=realised,
        verification=checks,
        solver=margin[1],
        timing=clock.laps,
    )


@dataclasses.dataclass(frozen=True)
class _Exact:
    """The exact form of a problem: its arrays, and the basis of the inequality."""

    problem: MixedProblem
    data: ConvexData
    classical: ClassicalForm | None


def _exact_form(problem: MixedProblem, form: str) -> _Exact:
    data = exact_data(problem)
    classical = None
    if form == "classical" and problem.coefficients:
        classical = classical_form(data.sarason.pair, problem.angles, problem.prior.decay_rate, problem.taylor)
    return _Exact(problem, data, classical)


def _check_arguments(problem: Any, objective: str, form: str) -> None:
    if not isinstance(problem, MixedProblem):
        raise InputTypeError(f"`problem` must be a MixedProblem; got {type(problem).__name__}")
    if objective not in OBJECTIVES:
        raise InputError(f"`objective` must be one of {OBJECTIVES}; got {objective!r}")
    if form not in ("orthonormal", "classical"):
        raise InputError(f'`form` must be "orthonormal" or "classical"; got {form!r}')


def _margin(exact: _Exact, solver: str, accuracy: float) -> tuple[tuple[float, str], MarginCertificate]:
    """The proven interval of the margin; our own central path takes over where the solver's numbers don't hold."""
    best: MarginCertificate | None = None
    reached, used = np.inf, ""
    candidates = []
    if _conic(exact, solver):
        try:
            candidates = [solve_conic(exact.data, "margin", solver=solver, classical=exact.classical)]
        except SolverError as problem:
            _log.warning("%s; using the central path", problem)
    path = margin_path(exact.data)
    while True:
        if not candidates:
            step = next(path, None)
            if step is None:
                break
            candidates = [step[0]]
        candidate = candidates.pop()
        x = _into_ball(candidate.x, exact.data.sarason)
        upper = exact.data.margin(x, candidate.p)
        if upper < reached:
            reached, used = upper, candidate.solver
        certificate = certify_margin(candidate.samples, candidate.ball, reached, exact.data.rows, exact.data.sarason)
        if best is None or certificate.value > best.value:
            best = certificate
        if _close(reached, best.value, _SPARE * accuracy):
            break
    if best is None:
        raise SolverError("no solver returned usable numbers; rescale the problem or loosen the bounds")
    return (reached, used), best


def _into_ball(x: np.ndarray, sarason: SarasonMap) -> np.ndarray:
    """The coefficients, shrunk into the ball by what a solver left outside."""
    norm = sarason.norm(x) * (1 + 1e-13)
    return x / norm if norm > 1 else x


def _close(upper: float, lower: float, accuracy: float) -> bool:
    return upper - lower <= accuracy * max(1.0, upper)


def _status(upper: float, lower: float, accuracy: float) -> Status:
    if upper <= 1:
        return Status.CONSISTENT
    if lower > 1:
        return Status.INCONSISTENT
    return Status.UNDECIDED if _close(upper, lower, accuracy) else Status.FAILED


def _choose_point(exact: _Exact, level: float, objective: str, solver: str, form: str) -> tuple[Candidate, _Exact]:
    """The point that the objective asks for, and the problem it belongs to."""
    center = analytic_center(exact.data, level)
    if objective in ("center", "margin") or not exact.problem.coefficients:
        return center, exact
    if objective == "order":
        found = solve_conic(
            exact.data, "order", solver=_conic_name(exact, solver), factor=level, classical=exact.classical
        )
        return _step_inside(found, center, exact.data, level), exact
    K = exact.problem.prior.gain_bound
    gain = _smallest_gain(exact, center, level, solver)
    while gain < 1:
        smaller = _exact_form(exact.problem.with_prior(gain_bound=K * gain), form)
        try:
            return analytic_center(smaller.data, level), smaller
        except SolverError:  # the solver's gain was a little too small
            gain = gain * (1 + 1e-3)
    return center, exact


def _smallest_gain(exact: _Exact, center: Candidate, level: float, solver: str) -> float:
    """Smallest kappa for which gain kappa K is consistent at `level`, from above, to 1e-4."""
    if _conic(exact, solver):
        try:
            found = solve_conic(exact.data, "gain", solver=solver, factor=level, classical=exact.classical)
            return exact.data.sarason.norm(found.x) * (1 + 1e-4) + 1e-9
        except SolverError as problem:
            _log.warning("%s; using the central path", problem)
    kappa = 1.0
    for _, kappa, gap in gain_path(exact.data, center, level):
        if gap <= 1e-4 * kappa or kappa < 1e-9:
            break
    return kappa + 1e-9


def _conic(exact: _Exact, solver: str) -> bool:
    """Whether a general conic solver is asked."""
    n = exact.problem.coefficients
    if solver == "auto" and exact.classical is None:
        return n <= QUICK_CONIC
    if n > LARGEST_CONIC:
        raise SizeError(
            f"`problem` has {n} coefficients; a general semidefinite solver takes up to {LARGEST_CONIC}"
            ' in reasonable time and memory. Use solver="auto", or thin the data'
        )
    return True


def _conic_name(exact: _Exact, solver: str) -> str:
    _conic(exact, "cvxpy" if solver == "auto" else solver)
    return solver


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

"""The proven interval of the margin."""

from __future__ import annotations

import dataclasses
import logging

import numpy as np

from robustid.errors import SizeError, SolverError
from robustid.identification.exact import Claim, exact_data
from robustid.interpolation import (
    ClassicalForm,
    MarginCertificate,
    MixedProblem,
    SarasonMap,
    certify_margin,
    classical_form,
)
from robustid.solve import Candidate, ConvexData, margin_path, solve_conic

_log = logging.getLogger("robustid")

# A general semidefinite solver needs n^4 memory and n^6 work: "auto" asks it while it is quick, and never above the last.
QUICK_CONIC, LARGEST_CONIC = 24, 100
_SPARE = 0.01  # part of the accuracy that is aimed at: digits are cheap at the end of the path


@dataclasses.dataclass(frozen=True)
class ExactForm:
    """The exact form of a problem: its arrays, and the basis of the inequality."""

    problem: MixedProblem
    data: ConvexData
    classical: ClassicalForm | None


def exact_form(problem: MixedProblem, form: str) -> ExactForm:
    """Arrays of a problem in the orthonormal or the paper's basis."""
    data = exact_data(problem)
    classical = None
    if form == "classical" and problem.coefficients:
        classical = classical_form(data.sarason.pair, problem.angles, problem.prior.decay_rate, problem.taylor)
    return ExactForm(problem, data, classical)


def prove_margin(exact: ExactForm, solver: str, accuracy: float) -> tuple[Claim, Candidate | None]:
    """The proven interval, and the last point of our own central path where that was asked.

    The path takes over where a solver's numbers don't hold.
    """
    data = exact.data
    candidates, last = [], None
    if wants_conic(exact, solver):
        try:
            candidates = [solve_conic(data, "margin", solver=solver, classical=exact.classical)]
        except SolverError as problem:
            _log.warning("%s; using the central path", problem)
    path = margin_path(data)
    best: MarginCertificate | None = None
    reached, point = np.inf, None
    while True:
        if not candidates:
            step = next(path, None)
            if step is None:
                break
            last = step[0]
            candidates = [last]
        candidate = candidates.pop()
        candidate = dataclasses.replace(candidate, x=_into_ball(candidate.x, data.sarason))
        upper = data.margin(candidate.x, candidate.p)
        if upper < reached:
            reached, point = upper, candidate
        certificate = certify_margin(candidate.samples, candidate.ball, reached, data.rows, data.sarason)
        if best is None or certificate.value > best.value:
            best = certificate
        if reached - best.value <= _SPARE * accuracy * max(1.0, reached):
            break
    if best is None or point is None:
        raise SolverError("no solver returned usable numbers; rescale the problem or loosen the bounds")
    return Claim(reached, accuracy, point.x, point.p, best, point.solver), last


def _into_ball(x: np.ndarray, sarason: SarasonMap) -> np.ndarray:
    """The coefficients, shrunk into the ball by what a solver left outside."""
    norm = sarason.norm(x) * (1 + 1e-12)
    return x / norm if norm > 1 else x


def wants_conic(exact: ExactForm, solver: str) -> bool:
    """Whether a general conic solver is asked; refused where it would take hours."""
    if solver == "auto" and exact.classical is None:
        return exact.problem.coefficients <= QUICK_CONIC
    check_conic_size(exact.problem)
    return True


def check_conic_size(problem: MixedProblem) -> None:
    """Refuse what a general semidefinite solver can't do in reasonable time and memory."""
    n = problem.coefficients
    if n > LARGEST_CONIC:
        raise SizeError(
            f"`problem` has {n} coefficients; a general semidefinite solver takes up to {LARGEST_CONIC} in reasonable time and"
            ' memory. Use solver="auto" with objective "center", "margin" or "gain", or thin the data'
        )

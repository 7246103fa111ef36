"""The proven interval of the margin."""

from __future__ import annotations

import dataclasses
import logging
from collections.abc import Iterator

import numpy as np

from robustid.core import Budget, Interruptible, Real
from robustid.errors import Remedy, SizeError, SolverError
from robustid.identification.certificate import MarginCertificate, certify_margin
from robustid.identification.formulation.convex import LEAST_SQUARES, Candidate, ConvexData
from robustid.identification.formulation.sarason import SarasonMap
from robustid.identification.solver.cvxpy_backend import solve_conic, solver_name
from robustid.identification.solver.paths import margin_path
from robustid.identification.verification import Claim

_log = logging.getLogger("robustid")

# A general semidefinite solver needs n^4 memory and n^6 work: "auto" asks it while it is quick, and never above the last.
QUICK_CONIC, LARGEST_CONIC = 24, 100
LATE = "stopped at the time limit"
_SPARE = 0.01  # part of the accuracy that is aimed at: digits are cheap at the end of the path
_NEAR_ENOUGH = 10.0  # times the accuracy: a margin that is known as well as that is known, if it decides nothing
_STEPS = 100  # of the progress


def prove_margin(
    data: ConvexData, solver: str, accuracy: float, budget: Budget | None = None
) -> tuple[Claim, list[Candidate]]:
    """The proven interval, and the points of our own path, where that was asked, without their multipliers.

    The path takes over where a solver's numbers don't hold. The end of the budget, or Ctrl-C, on the way ends with the best
    interval proved so far, and the claim says so.
    """
    budget = Budget() if budget is None else budget
    passed: list[Candidate] = []
    best: MarginCertificate | None = None
    reached, point, stopped = np.inf, None, ""
    with Interruptible(lambda: point is not None) as path:
        for candidate, near, done in _candidates(data, solver, _SPARE * accuracy):
            budget.tell(done, _STEPS)
            upper = data.margin(candidate.x, candidate.p)
            if candidate.solver == "structured":
                passed.append(dataclasses.replace(candidate, ball=np.zeros((0, 0))))
            if near:
                candidate = dataclasses.replace(candidate, x=_into_ball(candidate.x, data.sarason))
                upper = data.margin(candidate.x, candidate.p)
            if upper < reached:
                reached, point = upper, candidate
            if not near and not budget.over:
                continue
            certificate = certify_margin(candidate.samples, candidate.ball, reached, data.rows, data.sarason)
            if best is None or certificate.value > best.value:
                best = certificate
            tails = float(data.rows.tail.max(initial=0.0))
            if reached - best.value <= 2 * tails + _SPARE * accuracy * max(1.0, reached):
                break
            if budget.over:
                stopped = LATE
                break
    if path.interrupted and point is not None:
        stopped = "interrupted"
        _log.warning("interrupted; the best point found so far is verified")
        if best is None:
            best = certify_margin(point.samples, point.ball, reached, data.rows, data.sarason)
    if best is None or point is None:
        raise SolverError("no solver returned usable numbers; rescale the problem or loosen the bounds")
    # A point of the path that was not near may have been the best: rounding can leave it outside too.
    x = _into_ball(point.x, data.sarason)
    claim = Claim(max(reached, data.margin(x, point.p)), accuracy, x, point.p, best, point.solver)
    if claim.width <= accuracy or not np.isfinite(claim.width):
        return claim, passed
    if stopped:
        return _cut_short(claim, stopped), passed
    if claim.decided or claim.width <= _NEAR_ENOUGH * accuracy:  # the digits end there
        return dataclasses.replace(claim, accuracy=claim.width), passed
    return claim, passed


def margin_without_steps(data: ConvexData, accuracy: float) -> Claim:
    """Margin of least squares of the parameters alone, G = 0: no matrix of the coefficients is factorised."""
    x, p = np.zeros(data.sarason.size), data.least_squares
    reached = data.margin(x, p)
    nothing = certify_margin(np.zeros(data.rows.y.size), np.zeros(data.sarason.shape), reached, data.rows, data.sarason)
    claim = Claim(reached, accuracy, x, p, nothing, LEAST_SQUARES)
    return claim if claim.width <= accuracy else _cut_short(claim, LATE)


def _cut_short(claim: Claim, why: str) -> Claim:
    """The claim with the accuracy that was reached."""
    words = f"{why}: the margin is proved to lie between {claim.certificate.value:.6g} and {claim.margin:.6g} only"
    return dataclasses.replace(claim, accuracy=claim.width, stopped=words)


def decide_margin(data: ConvexData, inside: float, above: float) -> Candidate | MarginCertificate | None:
    """Return what the path shows first: a point whose margin is at most `inside`, or a certificate of one `above`.

    None where neither is: a margin between the two takes `prove_margin`.
    """
    for candidate, margin, gap in margin_path(data):
        reached = data.margin(candidate.x, candidate.p)
        if reached <= inside:
            return candidate
        if margin - gap > above:
            certificate = certify_margin(candidate.samples, candidate.ball, reached, data.rows, data.sarason)
            if certificate.value > above:
                return certificate
    return None


def _candidates(data: ConvexData, solver: str, accuracy: float) -> Iterator[tuple[Candidate, bool, int]]:
    """The point of a conic solver, then our own path; whether the optimum is so near that a certificate is worth its time.

    And how far it is: the gap falls by about the same factor at every step of the path.
    """
    if wants_conic(data.sarason, solver):
        try:
            yield solve_conic(data, "margin", solver=solver), True, _STEPS
        except SolverError as problem:
            _log.warning("%s; using the structured solver", problem)
    late, least, first = list[Candidate](), np.inf, 0.0
    for candidate, margin, gap in margin_path(data):
        aim = accuracy * max(1.0, margin)
        near, first = gap <= aim, first or gap
        if gap < least:
            late, least = [], gap
        late += [] if near else [candidate]
        left = np.log(max(least / aim, 1.0)) / max(np.log(first / aim), 1.0)
        yield candidate, near, round(_STEPS * (1 - min(left, 1.0)))
    # At the limit of precision the estimate of the gap says little, and multipliers get worse again: the best are among the last.
    for candidate in late:
        yield candidate, True, _STEPS


def _into_ball(x: Real, sarason: SarasonMap) -> Real:
    """The coefficients, shrunk into the ball by what a solver left outside."""
    room = 1e-12
    while (norm := sarason.norm(x)) > 1:  # of passive classes other eigenvalues, and with them rounding, may be large
        x, room = x / (norm * (1 + room)), 10 * room
    return x


def wants_conic(sarason: SarasonMap, solver: str) -> bool:
    """Say whether a general conic solver is asked; refuse it where it would take hours."""
    if solver == "structured":
        return False
    n = max(sarason.blocks)
    if solver != "auto":
        solver_name(solver)
    if solver == "auto" and not sarason.conic:
        return n <= QUICK_CONIC
    check_conic_size(n)
    return True


def check_conic_size(rows: int) -> None:
    """Refuse what a general semidefinite solver can't do in reasonable time and memory."""
    if rows > LARGEST_CONIC:
        raise SizeError(
            f"`problem` has a matrix inequality of {rows} coefficients a side; a general semidefinite solver takes up to"
            f" {LARGEST_CONIC} in reasonable time and memory. ",
            Remedy({}, 'Use solver="auto" with objective "center", "margin" or "gain", or thin the data'),
        )

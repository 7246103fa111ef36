"""The question of a proof file: class, lines, records, and numbers as text that means exactly what it says."""

from __future__ import annotations

import hashlib
from typing import TYPE_CHECKING

import numpy as np

from robustid.core import Record, ZPlane
from robustid.errors import InputError
from robustid.identification import MixedProblem, Prior

if TYPE_CHECKING:
    from robustid.bases import ParametricBasis

NOT_YET = (
    "`result` has no proof file yet: {}; this package alone checks it (docs/proof_format.rst says what is expressed)"
)


def question_of(problem: MixedProblem, statements: list[Record]) -> Record:
    """Return what a file is about; InputError where version 1 can't state it."""
    check_expressed(problem)
    prior = problem.prior
    return {
        "class": {
            "gain_bound": repr(float(prior.gain_bound)),
            "decay_rate": repr(float(prior.decay_rate)),
            "functions": _functions(problem.parametric),
        },
        "sample_time": repr(float(problem.dt)),
        "units": {"frequency": "rad/s", "time": "s", "response": "that of the data"},
        "level": "1",
        "data": lines_of(problem),
        "records": records_of(problem),
        "statements": statements,
    }


def digest_of(question: str) -> str:
    """Return the SHA-256 of the text of a question, in hexadecimal digits."""
    return hashlib.sha256(question.encode()).hexdigest()


def check_expressed(problem: MixedProblem) -> None:
    """Refuse problems that version 1 of the format cannot state."""
    bounds = [one.bound for one in problem.frequency]
    reasons = {
        "the problem is in continuous time": not isinstance(problem.plane, ZPlane),
        "it has several inputs or outputs": problem.entries.shape != (1, 1),
        "it has records that do not begin at rest": any(one.initial != "rest" for one in problem.time),
        "its class is not the ball of one gain bound": type(problem.prior) is not Prior
        or not problem.weighting.trivial,
        "its parameters have intervals": problem.parameter_bounds is not None,
        "bounds are ellipses, or joint": any(one.tilt is not None or one.joint != "entry" for one in bounds),
        "it has tangential data": any(getattr(one, "weights", None) is not None for one in problem.frequency),
    }
    for reason, holds in reasons.items():
        if holds:
            raise InputError(NOT_YET.format(reason))


def lines_of(problem: MixedProblem) -> list[list[str]]:
    """Return frequency, value and bound of every line that is used."""
    rows: list[list[str]] = []
    for item in problem.frequency:
        used = item.bound.used[:, 0, 0]
        values, radius = item.values[used, 0, 0], item.bound.outer_radius[used, 0, 0]
        for omega, value, bound in zip(item.omega[used].tolist(), values.tolist(), radius.tolist(), strict=True):
            rows.append([repr(omega), *decimal(value), repr(bound)])
    return rows


def _functions(basis: ParametricBasis | None) -> Record:
    if basis is None:
        return {"A": [], "B": [], "C": [], "D": []}
    A, B, C, D = (np.asarray(one).tolist() for one in basis.matrices)
    columns = {"B": [dyadic(row[0]) for row in B], "D": [dyadic(row[0]) for row in D]}
    return {
        "A": [[dyadic(one) for one in row] for row in A],
        "C": [[dyadic(one) for one in row] for row in C],
    } | columns


def records_of(problem: MixedProblem) -> list[Record]:
    """Return the input of every record, and its samples that are used: number, value and bound."""
    found: list[Record] = []
    for item in problem.time:
        used = np.flatnonzero(item.bound.used[:, 0])
        rows = zip(used.tolist(), item.y[used, 0].tolist(), item.bound.radius[used, 0].tolist(), strict=True)
        inputs = [dyadic(one) for one in item.u[: int(used.max(initial=-1)) + 1, 0].tolist()]
        found.append({"input": inputs, "samples": [[t, repr(y), repr(bound)] for t, y, bound in rows]})
    return found


def decimal(value: complex) -> list[str]:
    """Real and imaginary part of a number, in the fewest digits that name the doubles."""
    return [repr(float(value.real)), repr(float(value.imag))]


def pair(value: complex) -> list[str]:
    """Real and imaginary part of a number, as dyadic numbers."""
    return [dyadic(value.real), dyadic(value.imag)]


def dyadic(value: float) -> str:
    """The double as an integer times a power of two, exactly."""
    above, below = float(value).as_integer_ratio()
    return f"{above}p-{below.bit_length() - 1}" if below > 1 else f"{above}p+0"

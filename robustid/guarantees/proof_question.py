"""The question of a proof file: class, lines, records, and numbers as text that means exactly what it says."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from robustid.core import Complex, Real, Record, SPlane
from robustid.errors import InputError
from robustid.identification import BoundedReal, MixedProblem, Prior

if TYPE_CHECKING:
    from robustid.bases import ParametricBasis
    from robustid.guarantees.linear.functions import Functions
    from robustid.guarantees.linear.pole_discs import PoleDiscs

NOT_YET = (
    "`result` has no proof file yet: {}; this package alone checks it (docs/proof_format.rst says what is expressed)"
)


_LARGER = 1 + 1e-9  # reaches of poles over those that are computed: their middles are exact in a file


def question_of(problem: MixedProblem, statements: list[Record], functions: Functions | None = None) -> Record:
    """Return what a file is about; InputError where version 1 can't state it. `functions`: with the poles of modes in a box."""
    check_expressed(problem)
    prior, plane = problem.prior, problem.plane
    rate = [repr(float(prior.decay or 0)), repr(plane.corner)] if isinstance(plane, SPlane) else repr(prior.decay_rate)
    over = {} if functions is None or functions.modes is None else {"modes": list(_modes(functions.modes))}
    return {
        "class": {
            "gain_bound": repr(float(prior.gain_bound)),
            "decay_rate": rate,
            "functions": _functions(problem.parametric if functions is None else functions.fixed),
            **over,
        },
        "sample_time": repr(float(problem.dt)) if problem.dt else "continuous",
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
        "it bounds a passive class without a gain bound": problem.prior.positive_real,
        "it has several inputs or outputs": problem.entries.shape != (1, 1),
        "it has records that do not begin at rest": any(one.initial != "rest" for one in problem.time),
        "its class is not the ball of one gain bound": type(problem.prior) not in (Prior, BoundedReal)
        or not problem.weighting.trivial,
        "its parameters have intervals": problem.parameter_bounds is not None,
        "bounds are ellipses, or joint": any(one.tilt is not None or one.joint != "entry" for one in bounds),
        "it has tangential data": any(getattr(one, "weights", None) is not None for one in problem.frequency),
    }
    for reason, holds in reasons.items():
        if holds:
            raise InputError(NOT_YET.format(reason))


def _modes(modes: PoleDiscs) -> Iterator[Record]:
    """Numerator in the delay, poles, and how far a pole may be from the first of them, from the first two, and so on."""
    numerator = ["1", "1"] if modes.delay < 0 else ["0"] * modes.delay + ["1"]
    if len(modes.sizes) < modes.middle.size:
        raise InputError(NOT_YET.format("modes of its pole-uncertainty box are so close that they are one"))
    if np.any(modes.reach > 0):
        raise InputError(NOT_YET.format("its pole-uncertainty box reaches the border of stability"))
    for poles, sizes, first, rest in zip(modes.poles, modes.sizes, modes.distance, modes.rest, strict=True):
        reach = _reaches(poles, sizes[:, 0], float(first), float(rest))
        yield {
            "numerator": numerator,
            "poles": [pair(one) for one in poles.tolist()],
            "reach": [dyadic(one * _LARGER) for one in reach.tolist()],
        }


def _reaches(poles: Complex, sizes: Real, first: float, rest: float) -> Real:
    """Bounds of |tau_1 ... tau_j|, j = 1 to J, from those of the coefficients of the series, and from that of its remainder."""
    inside: Real = (1 - np.abs(poles)) * (1 + np.abs(poles))
    later = sizes[1:] * np.sqrt((1 - first) * (1 + first) * inside[0] / inside[1:])
    return np.append(later, rest * (1 - first))


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

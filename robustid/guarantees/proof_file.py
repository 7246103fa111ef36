"""A proof as a file that others can check: the question in full, its digest, and the evidence (`docs/proof_format.rst`).

The claims are those of this package, widened by a billionth; the multipliers, in double precision, are dyadic numbers.
"""

from __future__ import annotations

import hashlib
import json
from typing import TYPE_CHECKING, Any

import numpy as np

from robustid.core import Complex, Real, ZPlane
from robustid.errors import InputError, Status
from robustid.guarantees.band_result import Band
from robustid.guarantees.contradictions import Contradiction, contradiction
from robustid.guarantees.linear.amplitudes import Extraction, base_of
from robustid.guarantees.linear.certificate import targets_at
from robustid.guarantees.linear.entry_band import EntryBand, evaluate
from robustid.identification import Identification, MixedProblem, Prior

if TYPE_CHECKING:
    from robustid.bases import ParametricBasis

VERSION = 1
_WIDER = 1 + 1e-9  # a stated radius of a parameter over the proved one; claims are widened by ten times as much
_KEPT, _MOST = 1e9, 4096  # of a bound, what reflection coefficients leave out; how many of them
_NOT_YET = (
    "`result` has no proof file yet: {}; this package alone checks it (docs/proof_format.rst says what is expressed)"
)


def proof_text(result: object) -> str:
    """Return the proof of a result, in the JSON of `docs/proof_format.rst`.

    Parameters
    ----------
    result : Band, Identification or Contradiction
        Of one input and one output in discrete time, from frequency points only, with exact poles and a class without a weight. Of
        a band the discs of its sums at its frequencies; of an identification the system that fits, or that none does.

    Returns
    -------
    str

    Raises
    ------
    InputError
        The format does not express the problem or the result yet.
    """
    if isinstance(result, Identification):
        return _of_identification(result)
    if isinstance(result, Contradiction):
        return _of_contradiction(result)
    if not isinstance(result, Band):
        raise InputError(_NOT_YET.format("only bands of sums and identifications have"))
    if result.box is not None:
        raise InputError(_NOT_YET.format("it is over a pole-uncertainty box"))
    return _of_band(result)


def _of_band(band: Band) -> str:
    """Discs at the frequencies of a band where its sums say something."""
    _check(band.problem)
    omega, one = np.asarray(band.omega), band.bands[0]
    statements: list[Any] = []
    evidence: list[Any] = []
    known = one.extraction.known
    size = float(np.abs(known.largest).max(initial=0.0))
    for frequency, angle in zip(omega.tolist(), band.problem.plane.angles(omega).tolist(), strict=True):
        points, d = _multipliers(one, angle)
        (centre,), (radius,) = evaluate(one.samples, one.extraction, np.array([angle]), points[None], d[None])
        if not np.isfinite(radius):
            continue
        base = targets_at(one.samples, np.array([angle])).base[0]
        stated = repr(float(radius * (1 + 1e-8) + 1e-15 * (abs(centre) + size)))
        statements.append({"kind": "disc", "omega": repr(frequency), "centre": _decimal(centre), "radius": stated})
        evidence.append(_sums(base, points, d))
    if not statements:
        raise InputError(_NOT_YET.format("its sums say nothing at its frequencies"))
    return _file(band.problem, one.extraction, statements, evidence)


def _multipliers(band: EntryBand, angle: float) -> tuple[Any, Complex]:
    """Points and multipliers at an angle: those of a knot, or of both beside it, in proportion."""
    last = band.angles.size - 2
    before = int(np.clip(np.searchsorted(band.angles, angle, side="right") - 1, 0, last))
    part = float((angle - band.angles[before]) / (band.angles[before + 1] - band.angles[before]))
    low, high = (band.of_knots(np.array([knot])) for knot in (before, before + 1))
    sides = [(points[0], weight * d[0]) for weight, (points, d) in ((1 - part, low), (part, high)) if weight]
    points, d = (np.concatenate(both) for both in zip(*sides, strict=True))
    return points, d


def _of_contradiction(found: Contradiction) -> str:
    if found.box is not None:
        raise InputError(_NOT_YET.format("it is over a pole-uncertainty box"))
    evidence = _sums(found.base, found.points, found.multipliers)
    return _file(found.problem, found.extraction, [{"kind": "inconsistent"}], [evidence])


def _of_identification(result: Identification) -> str:
    """The values of a system at the samples, or sums that refute the class."""
    _check(result.problem)
    if result.status is Status.INCONSISTENT:
        found = contradiction(result.problem)
        if found is None:
            raise InputError(_NOT_YET.format("sums do not refute the class, which its semidefinite certificate does"))
        return _of_contradiction(found)
    if result.status is not Status.CONSISTENT:
        raise InputError(_NOT_YET.format("it is undecided"))
    gains = _reflections(result)
    parameters = [_dyadic(one) for one in np.ravel(result.parameters).tolist()]
    evidence = {"reflections": [_dyadic(one) for one in gains.tolist()], "parameters": parameters}
    return _file(result.problem, None, [{"kind": "consistent"}], [evidence])


def _reflections(result: Identification) -> Real:
    """Reflection coefficients of the model's phi, as many as its values at the samples ask for (Schur's algorithm)."""
    prior, data = result.problem.prior, result.formulation.data
    least = min(float(one.bound.inner_radius[one.bound.used].min()) for one in result.problem.frequency)
    count = int(np.log(_KEPT * prior.gain_bound / least) / np.log(prior.decay_rate)) + 2
    count = min(max(count, 1), _MOST)
    alpha, beta, gamma, delta = (np.asarray(one) for one in data.sarason.interpolants(result.coefficients).realise())
    u, v, state = np.zeros(count), np.eye(1, count)[0], beta.ravel()
    u[0] = delta.ravel()[0]
    for k in range(1, count):
        u[k], state = float(gamma.ravel() @ state), alpha @ state
    found = np.zeros(count)
    for k in range(count):  # u/v is what is left of phi
        found[k] = u[0] / v[0]
        if not abs(found[k]) < 1:
            raise InputError(_NOT_YET.format("its system is at the border of the class"))
        scale = np.sqrt((1 - found[k]) * (1 + found[k]))
        u, v = (u - found[k] * v)[1:] / scale, (v - found[k] * u)[:-1] / scale
    return found


def _file(problem: MixedProblem, extraction: Extraction | None, statements: list[Any], evidence: list[Any]) -> str:
    _check(problem)
    parametric, prior = problem.parametric, problem.prior
    question = {
        "class": {
            "gain_bound": repr(float(prior.gain_bound)),
            "decay_rate": repr(float(prior.decay_rate)),
            "functions": _functions(parametric),
        },
        "sample_time": repr(float(problem.dt)),
        "units": {"frequency": "rad/s", "time": "s", "response": "that of the data"},
        "level": "1",
        "data": _data(problem),
        "statements": statements,
    }
    text = json.dumps(question)
    proof = json.dumps({"parameters": _parameters(extraction), "statements": evidence})
    head = f'"format": "robustid-proof", "version": {VERSION}, "digest": "{digest_of(text)}"'
    return f'{{{head},\n"question": {text},\n"evidence": {proof}}}\n'


def digest_of(question: str) -> str:
    """Return the SHA-256 of the text of a question, in hexadecimal digits."""
    return hashlib.sha256(question.encode()).hexdigest()


def _check(problem: MixedProblem) -> None:
    """Refuse problems that version 1 of the format cannot state."""
    bounds = [one.bound for one in problem.frequency]
    reasons = {
        "the problem is in continuous time": not isinstance(problem.plane, ZPlane),
        "it has several inputs or outputs": problem.entries.shape != (1, 1),
        "it has records": bool(problem.time),
        "its class is not the ball of one gain bound": type(problem.prior) is not Prior
        or not problem.weighting.trivial,
        "its parameters have intervals": problem.parameter_bounds is not None,
        "bounds are ellipses, or joint": any(one.tilt is not None or one.joint != "entry" for one in bounds),
        "it has tangential data": any(getattr(one, "weights", None) is not None for one in problem.frequency),
    }
    for reason, holds in reasons.items():
        if holds:
            raise InputError(_NOT_YET.format(reason))


def _data(problem: MixedProblem) -> list[list[str]]:
    rows: list[list[str]] = []
    for item in problem.frequency:
        used = item.bound.used[:, 0, 0]
        values, radius = item.values[used, 0, 0], item.bound.outer_radius[used, 0, 0]
        for omega, value, bound in zip(item.omega[used].tolist(), values.tolist(), radius.tolist(), strict=True):
            rows.append([repr(omega), *_decimal(value), repr(bound)])
    return rows


def _functions(basis: ParametricBasis | None) -> dict[str, Any]:
    if basis is None:
        return {"A": [], "B": [], "C": [], "D": []}
    A, B, C, D = (np.asarray(one).tolist() for one in basis.matrices)
    columns = {"B": [_dyadic(row[0]) for row in B], "D": [_dyadic(row[0]) for row in D]}
    return {
        "A": [[_dyadic(one) for one in row] for row in A],
        "C": [[_dyadic(one) for one in row] for row in C],
    } | columns


def _parameters(extraction: Extraction | None) -> dict[str, Any]:
    """Evidence on the parameters: their discs, a combination each."""
    known = None if extraction is None else extraction.known
    if extraction is None or known is None or not np.all(np.isfinite(known.radius)):
        return {"centre": [], "radius": [], "combinations": []}
    rows = zip(base_of(extraction.samples).tolist(), extraction.points, extraction.multipliers, strict=True)
    return {
        "centre": [_dyadic(one.real) for one in known.centre.tolist()],
        "radius": [_dyadic(one * _WIDER) for one in known.radius.tolist()],
        "combinations": [_sums(base, points, d) for base, points, d in rows],
    }


def _sums(base: complex, points: Any, d: Complex) -> dict[str, Any]:
    rows = zip(np.asarray(points).tolist(), np.asarray(d, complex).tolist(), strict=True)
    return {"base": _pair(complex(base)), "factors": [], "multipliers": [[k, *_pair(one)] for k, one in rows if one]}


def _decimal(value: complex) -> list[str]:
    return [repr(float(value.real)), repr(float(value.imag))]


def _pair(value: complex) -> list[str]:
    return [_dyadic(value.real), _dyadic(value.imag)]


def _dyadic(value: float) -> str:
    """The double as an integer times a power of two, exactly."""
    above, below = float(value).as_integer_ratio()
    return f"{above}p-{below.bit_length() - 1}" if below > 1 else f"{above}p+0"

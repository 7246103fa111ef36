"""A proof as a file that others can check: the question in full, its digest, and the evidence (`docs/proof_format.rst`).

The claims are those of this package, widened by a billionth; the multipliers, in double precision, are dyadic numbers.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from robustid.core import Complex, Real, ZPlane
from robustid.errors import InputError, Status
from robustid.guarantees.band_result import Band
from robustid.guarantees.consistent_set import ConsistentSet
from robustid.guarantees.contradictions import Contradiction, contradiction
from robustid.guarantees.linear.amplitudes import Extraction, base_of, extract
from robustid.guarantees.linear.certificate import targets_at
from robustid.guarantees.linear.entry_band import EntryBand, evaluate
from robustid.guarantees.linear.functions import functions_of
from robustid.guarantees.linear.samples import samples_of, seen_in
from robustid.guarantees.proof_factors import Kernels, real_node
from robustid.guarantees.value_set import ValueSet
from robustid.guarantees.worst_case_result import WorstCaseError
from robustid.identification import Identification, MixedProblem, Prior
from robustid.identification.formulation import ExactFormulation, Formulation

if TYPE_CHECKING:
    from robustid.bases import ParametricBasis

VERSION = 1
_WIDER = 1 + 1e-9  # a stated radius of a parameter over the proved one; claims are widened by ten times as much
_ROOM = 1e-9  # of the gain bound, and of the value: what a support by multipliers in double precision is widened by
_DROPPED = 1e-12  # singular values of multipliers, relative, that are left out: they cost their part of the residual
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
    if isinstance(result, WorstCaseError):
        return _of_polygons(result)
    if not isinstance(result, Band):
        raise InputError(_NOT_YET.format("only bands, polygons and identifications have"))
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


def _of_polygons(found: WorstCaseError) -> str:
    """Supports of the values at every frequency, by multipliers of the matrix inequality."""
    _check(found.problem)
    statements: list[Any] = []
    evidence: list[Any] = []
    for one in found.values:
        for statement, sums in _supports(found.consistent_set, one):
            statements.append(statement)
            evidence.append(sums)
    return _file(found.problem, _extraction(found.problem), statements, evidence)


def _supports(consistent: ConsistentSet, one: ValueSet) -> Iterator[tuple[dict[str, Any], dict[str, Any]]]:
    """Statement and evidence of every side of a polygon."""
    posed = consistent.posed_at(one.omega)
    kernels, nodes = _kernels(posed, (one.omega,))
    for angle, support, proof in zip(one.directions.tolist(), one.support.tolist(), one.certificates, strict=True):
        value = support + _ROOM * (abs(support) + posed.problem.prior.gain_bound)
        turn = complex(np.exp(-1j * angle))
        yield (
            {"kind": "support", "omega": repr(one.omega), "direction": _decimal(turn), "value": repr(value)},
            _with_factors(posed, kernels, nodes, proof.samples, (proof.left, proof.right)),
        )


def _of_margin(result: Identification) -> str:
    """Multipliers of the samples and of the matrix inequality that refute the class."""
    posed, proof = result.formulation, result.certificate
    kernels, nodes = _kernels(posed, ())
    A = posed.sarason.pair.A
    left, size, right = np.linalg.svd(A @ proof.ball @ A.T - proof.ball)
    few = size > _DROPPED * size.max(initial=0.0)
    factors = left[:, few] * np.sqrt(size[few]), right[few].T * np.sqrt(size[few])
    evidence = _with_factors(posed, kernels, nodes, proof.samples, factors)
    return _file(result.problem, _extraction(result.problem), [{"kind": "inconsistent"}], [evidence])


def _extraction(problem: MixedProblem) -> Extraction:
    return extract(samples_of(problem, functions_of(problem, None), (0, 0), seen_in(problem)))


def _kernels(posed: Formulation, further: tuple[float, ...]) -> tuple[Kernels, list[int]]:
    """The functions of the coefficients of the exact form, and the nodes of the file in the order of theirs."""
    if not isinstance(posed, ExactFormulation):
        raise InputError(
            _NOT_YET.format(f"its semidefinite certificates are in the {posed.name} form, not the exact one")
        )
    problem = posed.problem
    omega = np.array([float(row[0]) for row in _data(problem)])
    lines = [int(np.argmin(np.abs(problem.plane.angles(omega) - angle))) for angle in problem.angles]
    count, order = omega.size, [*lines[0::2], *lines[1::2]]
    # A node at the frequency of the statement stands at the head of the cascade where no line is there.
    head = list(further[: len(posed.first)])
    nodes: list[int] = []
    turns = [*head, *omega[order].tolist()]
    for turn, node, conjugate in zip(
        turns,
        [*(2 * count for _ in head), *order],
        [*(2 * count + 1 for _ in head), *(count + k for k in order)],
        strict=True,
    ):
        nodes += [node] if real_node(turn * problem.dt) else [conjugate, node]
    return Kernels([(turn, problem.dt) for turn in turns], problem.prior.decay_rate), nodes


def _with_factors(
    posed: Formulation, kernels: Kernels, nodes: list[int], samples: Complex, factors: tuple[Real, Real]
) -> dict[str, Any]:
    """Sums of Re<l, F> with l in units of the bounds, half of it for the conjugates, and of the pairs left right' of Y."""
    bound = np.array([float(row[3]) for row in _data(posed.problem)])
    d = samples.conj() / (2 * bound)
    rows = [[k, *_pair(one)] for k, one in enumerate(np.concatenate([d, d.conj()]).tolist()) if one]
    gain = posed.problem.prior.gain_bound
    pairs = [
        {name: _terms(nodes, kernels.of(vector)) for name, vector in (("f", right / gain), ("g", left))}
        for left, right in zip(*(one.T for one in factors), strict=True)
    ]
    return {"base": ["0", "0"], "factors": pairs, "multipliers": rows}


def _terms(nodes: list[int], values: list[list[str]]) -> list[Any]:
    return [[node, *value] for node, value in zip(nodes, values, strict=True)]


def _of_identification(result: Identification) -> str:
    """The values of a system at the samples, or sums that refute the class."""
    _check(result.problem)
    if result.status is Status.INCONSISTENT:
        found = contradiction(result.problem)
        return _of_margin(result) if found is None else _of_contradiction(found)
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

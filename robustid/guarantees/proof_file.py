"""A proof as a file that others can check: the question in full, its digest, and the evidence (`docs/proof_format.rst`).

The claims are those of this package, widened by a billionth, and by what a form leaves out in the norm of the file; the
multipliers, in double precision, are dyadic numbers.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

import numpy as np

from robustid.core import Complex, Real, Record, StateMatrices
from robustid.errors import InputError, Status
from robustid.guarantees.band_result import Band
from robustid.guarantees.consistent_set import ConsistentSet
from robustid.guarantees.contradictions import Contradiction, contradiction
from robustid.guarantees.linear.amplitudes import Extraction, base_of, extract
from robustid.guarantees.linear.certificate import targets_at
from robustid.guarantees.linear.entry_band import EntryBand, evaluate
from robustid.guarantees.linear.functions import functions_of
from robustid.guarantees.linear.samples import Samples, samples_of, seen_in
from robustid.guarantees.loop_bounds import LoopBounds
from robustid.guarantees.proof_arcs import MOST_STATES, Arcs, Known, arcs_of
from robustid.guarantees.proof_entries import band_of_entry, contradiction_of_entry, words_of
from robustid.guarantees.proof_factors import MOST_POWERS, InKernels, in_kernels
from robustid.guarantees.proof_loop import BEYOND, statements_of
from robustid.guarantees.proof_passive import scattering_of
from robustid.guarantees.proof_question import (
    NOT_YET,
    check_expressed,
    decimal,
    digest_of,
    dyadic,
    lines_of,
    pair,
    question_of,
    records_of,
)
from robustid.guarantees.value_set import ValueSet
from robustid.guarantees.worst_case_result import WorstCaseError
from robustid.identification import Identification, MixedProblem, SupportCertificate, identify
from robustid.identification.formulation import Formulation

VERSION = 1
_WIDER = 1 + 1e-9  # a stated radius of a parameter over the proved one; claims are widened by ten times as much
_ROOM = 1e-9  # of the gain bound, and of the value: what a support by multipliers in double precision is widened by
_SHORT = (
    'its form leaves out functions that cost {:.1g} of its bounds in a file; take `form="auto"`, which leaves out less'
)
_DROPPED = 1e-12  # singular values of multipliers, relative, that are left out: they cost their part of the residual
_KEPT, _MOST = 1e9, 4096  # of a bound, what reflection coefficients leave out; how many of them


def proof_text(result: object) -> str:
    """Return the proof of a result, in the JSON of `docs/proof_format.rst`.

    Parameters
    ----------
    result : Band, WorstCaseError, LoopBounds, Identification or Contradiction
        Of one input and one output (of more a contradiction between samples of one entry), of a class without a weight; records
        from rest, in discrete time and beside exact poles. Of a band, over a pole-uncertainty box too, the discs of its sums at its
        frequencies and, in discrete time around a model of at most 64 states, bounds of its error on the whole axis; of bounds at
        exact poles the supports of their polygons; of a loop in discrete time with a controller that every consistent plant is
        stabilised, and peaks and margins on the whole axis (of a plant measured in a loop peaks with the controller that ran,
        stability with others); of an identification the system that fits, or that none does, of passive classes that of
        S = (F - r)/(F + r).

    Returns
    -------
    str

    Raises
    ------
    InputError
        The format does not express the problem or the result yet.
    """
    if isinstance(result, Identification):
        return _of_passive(result) if result.problem.prior.positive_real else _of_identification(result)
    if isinstance(result, Contradiction):
        return _of_contradiction(result)
    if isinstance(result, LoopBounds):
        return _of_loop(result)
    if isinstance(result, WorstCaseError):
        return _of_polygons(result)
    if not isinstance(result, Band):
        raise InputError(NOT_YET.format("only bands, polygons, loops and identifications have"))
    if (count := len(texts := proof_texts(result))) > 1:
        raise InputError(
            f"`result` has a proof file for each of its {count} entries; `proof_texts` returns all of them"
        )
    return texts[0]


def proof_texts(result: Any) -> list[str]:
    """Return the proof files of a result: one a band of a design, a member of a family, an entry of a matrix."""
    if not isinstance(result, Band):
        return [proof_text(one) for one in getattr(result, "proofs", ()) or (result,)]
    words = [words_of(one.samples) for one in result.bands]
    return [_of_band(band_of_entry(result, k), response) for k, response in enumerate(words)]


def _of_band(band: Band, response: str | None = None) -> str:
    """Discs at the frequencies of a band where its sums say something."""
    check_expressed(band.problem)
    omega, one = np.asarray(band.omega), band.bands[0]
    statements: list[Record] = []
    evidence: list[Record] = []
    known = one.extraction.known
    size = float(np.abs(known.largest).max(initial=0.0))
    for frequency, angle in zip(omega.tolist(), band.problem.plane.angles(omega).tolist(), strict=True):
        points, d = _multipliers(one, angle)
        (centre,), (radius,) = evaluate(one.samples, one.extraction, np.array([angle]), points[None], d[None])
        if not np.isfinite(radius):
            continue
        base = targets_at(one.samples, np.array([angle])).base[0]
        stated = repr(float(radius * (1 + 1e-8) + 1e-15 * (abs(centre) + size)))
        statements.append({"kind": "disc", "omega": repr(frequency), "centre": decimal(centre), "radius": stated})
        evidence.append(_sums(one.samples, base, points, d))
    if band.problem.dt and band.model is not None and band.model.nstates <= MOST_STATES:
        for axis in _on_axis(band, StateMatrices.of(band.model)):
            statements.append(axis[0])
            evidence.append(axis[1])
    if not statements:
        raise InputError(NOT_YET.format("its sums say nothing at its frequencies"))
    return _file(band.problem, one.extraction, statements, evidence, response)


def _on_axis(band: Band, model: StateMatrices) -> Iterator[tuple[Record, Record]]:
    """Statement and evidence of a bound of the error of the model on every arc of the axis, where the sums bound all of them."""
    circle, one = band.circle, band.bands[0]
    angles = band.problem.plane.angles(circle.edges)

    def asked(middle: Real) -> Real:
        return circle.entries[np.clip(np.searchsorted(angles, middle) - 1, 0, len(circle.bound) - 1), 0, 0]

    known = Known.error_of(model)
    arcs = arcs_of(one, known, circle.edges, asked, loop=False)
    if arcs is not None:
        yield _arcs(one, known, arcs, "arcs")


def _of_loop(found: LoopBounds) -> str:
    check_expressed(found.band.problem)
    one = found.band.bands[0]
    proofs = [_arcs(one, *said) for said in statements_of(found)]
    statements, evidence = map(list, zip(*proofs, strict=True))
    return _file(found.band.problem, one.extraction, statements, evidence)


def _arcs(one: EntryBand, known: Known, arcs: Arcs, kind: str) -> tuple[Record, Record]:
    bases = targets_at(one.samples, arcs.angles).base.tolist()
    places = zip(bases, arcs.angles.tolist(), strict=True)
    knots = [_sums(one.samples, base, *_multipliers(one, angle)) for base, angle in places]
    return {"kind": kind, "functions": known.text, "edges": arcs.edges, "bounds": arcs.bounds}, {"knots": knots}


def _multipliers(band: EntryBand, angle: float) -> tuple[Any, Complex]:
    """Points and multipliers at an angle: those of a knot, or of both beside it, in proportion."""
    last = band.angles.size - 2
    before = int(np.clip(np.searchsorted(band.angles, angle, side="right") - 1, 0, last))
    part = float((angle - band.angles[before]) / (band.angles[before + 1] - band.angles[before]))
    low, high = (band.of_knots(np.array([knot])) for knot in (before, before + 1))
    sides = [(points[0], weight * d[0]) for weight, (points, d) in ((1 - part, low), (part, high)) if weight]
    points, d = (np.concatenate(both) for both in zip(*sides, strict=True))
    return points, d


def _of_contradiction(given: Contradiction, response: str | None = None) -> str:
    found, response = contradiction_of_entry(given), response or words_of(given.samples)
    evidence = _sums(found.samples, found.base, found.points, found.multipliers)
    return _file(found.problem, found.extraction, [{"kind": "inconsistent"}], [evidence], response)


def _of_passive(result: Identification) -> str:
    """The same statement about S = (F - r)/(F + r), with a proof that is searched anew."""
    problem, words = scattering_of(result.problem, inside=result.status is Status.CONSISTENT)
    found = identify(problem)
    if found.status is not result.status:
        raise InputError(NOT_YET.format("it is at the border of its passive class"))
    return _of_identification(found, words)


def _of_polygons(found: WorstCaseError) -> str:
    """Supports of the values at every frequency, by multipliers of the matrix inequality."""
    check_expressed(found.problem)
    statements: list[Record] = []
    evidence: list[Record] = []
    for one in found.values:
        for statement, sums in _supports(found.consistent_set, one):
            statements.append(statement)
            evidence.append(sums)
    return _file(found.problem, _extraction(found.problem), statements, evidence)


def _supports(consistent: ConsistentSet, one: ValueSet) -> Iterator[tuple[Record, Record]]:
    """Statement and evidence of every side of a polygon."""
    posed = consistent.posed_at(one.omega)
    functions = in_kernels(posed, (one.omega,))
    most = BEYOND * float(np.abs(one.support).max())
    for angle, support, proof in zip(one.directions.tolist(), one.support.tolist(), one.certificates, strict=True):
        turn = complex(np.exp(-1j * angle))
        beyond = _beyond(posed, one, turn, proof)
        if beyond > most:
            raise InputError(NOT_YET.format(_SHORT.format(beyond / most * BEYOND)))
        value = support + _ROOM * (abs(support) + posed.problem.prior.gain_bound) + beyond
        yield (
            {"kind": "support", "omega": repr(one.omega), "direction": decimal(turn), "value": repr(value)},
            _with_factors(posed, functions, proof.samples, proof.left @ proof.right.T),
        )


def _beyond(posed: Formulation, one: ValueSet, turn: complex, proof: SupportCertificate) -> float:
    """Cost of the functions that a form leaves out, in the norm of H2, above what the proof paid for them by Cauchy's formula.

    Those of records are in that norm already.
    """
    problem, form = posed.problem, posed.repeated
    if form is None:
        return 0.0
    lines = lines_of(problem)
    weights = -proof.samples[: len(lines)].conj() / [float(row[-1]) for row in lines]
    weights, omega = np.append(weights, turn), np.array([*(float(row[0]) for row in lines), one.omega])
    angles = problem.plane.angles(omega)
    zeta = problem.region.points(angles)
    left = (
        weights / 2 * form.all_pass(zeta) ** form.repeats
    )  # of the rest, which is all_pass^repeats times a function of H2
    left, zeta = (np.concatenate([each, each.conj()]) for each in (left, zeta))
    square = np.real(left @ (left.conj() / (1 - np.outer(zeta, zeta.conj()))).sum(axis=1))
    paid = np.abs(weights) @ posed.response_tail(angles)
    return max(problem.prior.gain_bound * float(np.sqrt(square)) - float(paid), 0.0)


def _of_margin(result: Identification, response: str | None) -> str:
    """Multipliers of the samples and of the matrix inequality that refute the class."""
    posed, proof = result.formulation, result.certificate
    functions = in_kernels(posed, ())
    A = posed.sarason.pair.A
    evidence = _with_factors(posed, functions, proof.samples, A @ proof.ball @ A.T - proof.ball)
    return _file(result.problem, _extraction(result.problem), [{"kind": "inconsistent"}], [evidence], response)


def _extraction(problem: MixedProblem) -> Extraction:
    return extract(samples_of(problem, functions_of(problem, None), (0, 0), seen_in(problem)))


def _with_factors(posed: Formulation, functions: InKernels, samples: Complex, Y: Real) -> Record:
    """Sums of Re<l, e> with l in units of the bounds, and of the pairs of Y that cost least: their norms add up to ||Y||_*."""
    lines, records = lines_of(posed.problem), records_of(posed.problem)
    bound = np.array([float(row[-1]) for row in lines + [row for one in records for row in one["samples"]]])
    d, count = samples.conj() / bound, len(lines)
    # Half of what a line has is that of its conjugate: the sum is real.
    every = np.concatenate([d[:count] / 2, d[:count].conj() / 2, d[count:].real])
    left, size, right = np.linalg.svd(Y / posed.problem.prior.gain_bound)
    few, root = size > _DROPPED * size.max(initial=0.0), np.sqrt(size)
    pairs = [
        {"f": functions(v), "g": functions(u)}
        for u, v in zip((left * root).T[few], (root[:, None] * right)[few], strict=True)
    ]
    rows = [[k, *pair(one)] for k, one in enumerate(every.tolist()) if one]
    return {"base": ["0", "0"], "factors": pairs, "multipliers": rows}


def _of_identification(result: Identification, response: str | None = None) -> str:
    """The values of a system at the samples, or sums that refute the class."""
    if result.problem.entries.shape == (1, 1):
        check_expressed(result.problem)
    if result.status is Status.INCONSISTENT and (found := contradiction(result.problem)) is not None:
        return _of_contradiction(found, response)
    check_expressed(result.problem)
    if result.status is Status.INCONSISTENT:
        return _of_margin(result, response)
    if result.status is not Status.CONSISTENT:
        raise InputError(NOT_YET.format("it is undecided"))
    gains = _reflections(result)
    parameters = [dyadic(one) for one in np.ravel(result.parameters).tolist()]
    evidence = {"reflections": [dyadic(one) for one in gains.tolist()], "parameters": parameters}
    return _file(result.problem, None, [{"kind": "consistent"}], [evidence], response)


def _reflections(result: Identification) -> Real:
    """Reflection coefficients of the model's phi, as many as its values at the samples ask for (Schur's algorithm)."""
    prior, data = result.problem.prior, result.formulation.data
    problem = result.problem
    bounds = [one.bound.inner_radius[one.bound.used] for one in problem.frequency]
    least = min(float(one.min()) for one in [*bounds, *(one.bound.radius[one.bound.used] for one in problem.time)])
    angles = problem.plane.angles(np.array([0.0, *(float(row[0]) for row in lines_of(problem))]))
    rate = -np.log1p(-problem.region.inside(angles).min()) / 2  # of the decay of powers of zeta
    count = int(np.log(_KEPT * prior.gain_bound / least) / rate) + 2
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
            raise InputError(NOT_YET.format("its system is at the border of the class"))
        scale = np.sqrt((1 - found[k]) * (1 + found[k]))
        u, v = (u - found[k] * v)[1:] / scale, (v - found[k] * u)[:-1] / scale
    return found


def _file(
    problem: MixedProblem,
    extraction: Extraction | None,
    statements: list[Record],
    evidence: list[Record],
    response: str | None = None,
) -> str:
    functions = None if extraction is None else extraction.samples.functions
    question = question_of(problem, statements, functions)
    if response is not None:
        question["units"]["response"] = response
    text = json.dumps(question)
    used = [one[name] for sums in evidence for one in sums.get("factors", []) for name in ("f", "g")]
    nodes = 2 * len(lines_of(problem)) + 2
    powers = max((int(term[0]) - nodes + 1 for terms in used for term in terms), default=0)
    if powers > MOST_POWERS:
        raise InputError(
            NOT_YET.format(f"its multipliers have {powers} Taylor coefficients, of {MOST_POWERS} possible")
        )
    proof = json.dumps(
        {"powers": max(powers, 0), "parameters": _parameters(extraction), "statements": evidence}, separators=(",", ":")
    )
    head = f'"format": "robustid-proof", "version": {VERSION}, "digest": "{digest_of(text)}"'
    return f'{{{head},\n"question": {text},\n"evidence": {proof}}}\n'


def _parameters(extraction: Extraction | None) -> Record:
    """Evidence on the parameters: their discs, a combination each."""
    known = None if extraction is None else extraction.known
    if extraction is None or known is None or not np.all(np.isfinite(known.radius)):
        return {"centre": [], "radius": [], "combinations": []}
    rows = zip(base_of(extraction.samples).tolist(), extraction.points, extraction.multipliers, strict=True)
    fixed = extraction.samples.functions.fixed_count
    return {
        "centre": [dyadic(one.real) for one in known.centre[:fixed].tolist()]
        + [pair(one) for one in known.centre[fixed:].tolist()],
        "radius": [dyadic(one * _WIDER) for one in known.radius.tolist()],
        "combinations": [_sums(extraction.samples, base, points, d) for base, points, d in rows],
    }


def _sums(samples: Samples, base: complex, points: Any, d: Complex) -> Record:
    numbers = [*np.asarray(points).tolist(), *_places(samples)]
    rows = zip(numbers, np.asarray(d, complex).tolist(), strict=True)
    return {"base": pair(complex(base)), "factors": [], "multipliers": [[k, *pair(one)] for k, one in rows if one]}


def _places(samples: Samples) -> list[int]:
    """Numbers in the file of the samples of records that sums use: the first ones of every record."""
    start, found = samples.angles.size, list[int]()
    for rows, record in zip(samples.records, records_of(samples.problem), strict=True):
        found += range(start, start + rows.y.size)
        start += len(record["samples"])
    return found

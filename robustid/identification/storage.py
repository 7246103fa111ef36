"""Registers the identification and its parts: stored are the problem and the evidence, from which all else follows anew."""

from __future__ import annotations

import dataclasses

from robustid.bases import Function, FunctionKind, ParametricBasis, Sections
from robustid.core import Choice, Complex, Real, Record, fields_of, keep, stored
from robustid.identification.certificate import MarginCertificate
from robustid.identification.comparison import Comparison
from robustid.identification.formulation.choice import formulate_in
from robustid.identification.formulation.convex import Candidate
from robustid.identification.model import level_of, nominal_model
from robustid.identification.passive_prior import BoundedReal, NegativeImaginary, PositiveReal
from robustid.identification.prior import Prior
from robustid.identification.problem import MixedProblem
from robustid.identification.result import Identification
from robustid.identification.verification import Claim, verify
from robustid.identification.weighting import PriorWeight


def _evidence(result: Identification) -> Record:
    return {
        "problem": result.problem,
        "sections": result.formulation.repeated,
        "objective": result.objective,
        "claim": result.claim,
        "prior": result.prior,
        "coefficients": result.coefficients,
        "scaled_parameters": result.scaled_parameters,
        "timing": result.timing,
        "choices": result.choices,
    }


def _make(
    problem: MixedProblem,
    sections: Sections | None,
    objective: str,
    claim: Claim,
    prior: Prior,
    coefficients: Real,
    scaled_parameters: Real,
    timing: dict[str, float],
    choices: dict[str, Choice],
) -> Identification:
    """The identification of this evidence; every claim is verified again."""
    formulation = formulate_in(problem, sections)
    if formulation.count * problem.entries.count != coefficients.size:
        raise ValueError("its sections do not belong to its coefficients")
    formulation.check_size(claim.accuracy)
    used = formulation.of(dataclasses.replace(problem, prior=prior))
    certificate = claim.certificate
    center = Candidate(coefficients, scaled_parameters, certificate.samples, certificate.ball, claim.solver)
    level = level_of(objective, claim.margin, claim.accuracy, prior)
    nominal = nominal_model(used, center, level)
    return Identification(
        formulation=formulation,
        objective=objective,
        claim=claim,
        prior=prior,
        coefficients=coefficients,
        scaled_parameters=scaled_parameters,
        model=nominal.model,
        verification=verify(used, center, nominal, claim, formulation.data, level),
        timing=timing,
        choices=choices,
    )


def _functions(basis: ParametricBasis) -> Record:
    """The functions as they were given: those of s are written in z by the problem."""
    fields = fields_of(basis.in_s())
    return {name: fields[name] for name in ("A", "B", "C", "D", "dt", "functions", "poles")}


def _basis(
    A: Real, B: Real, C: Real, D: Real, dt: float, functions: tuple[Function, ...], poles: Complex
) -> ParametricBasis:
    return ParametricBasis(A, B, C, D, dt, functions, poles)


stored(BoundedReal, Claim, Function, FunctionKind, MarginCertificate, MixedProblem, NegativeImaginary, PositiveReal)
stored(Prior, PriorWeight, Sections)
stored(ParametricBasis, evidence=_functions, make=_basis)
keep(Identification, "identification", evidence=_evidence, make=_make)
keep(Comparison, "comparison")

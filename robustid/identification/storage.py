"""Saving an identification as numbers and text, and making it from them again: every claim is verified anew."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from robustid.bases import ParametricBasis, Sections
from robustid.core import Arrays, Choice, Record, Source, digest, keep, text_array
from robustid.data import FrequencyResponse, TangentialResponse, TimeRecord
from robustid.formats import flat_fields, from_fields
from robustid.identification.certificate import MarginCertificate
from robustid.identification.formulation.choice import formulate_in
from robustid.identification.formulation.convex import Candidate
from robustid.identification.model import level_of, nominal_model
from robustid.identification.passive_prior import prior_from
from robustid.identification.prior import prior_fields
from robustid.identification.problem import MixedProblem
from robustid.identification.result import Identification
from robustid.identification.verification import Claim, verify

_CLASSES = {cls.__name__: cls for cls in (FrequencyResponse, TangentialResponse, TimeRecord)}


def pack(result: Identification) -> tuple[Record, Arrays]:
    """Text and numbers of a result."""
    arrays, problem = describe_problem(result.problem)
    arrays |= {
        "result/coefficients": result.coefficients,
        "result/scaled_parameters": result.scaled_parameters,
        "claim/x": result.claim.x,
        "claim/p": result.claim.p,
        "certificate/samples": result.certificate.samples,
        "certificate/ball": result.certificate.ball,
    }
    record = {
        "status": result.status.name,
        "meaning": result.status.value,
        "objective": result.objective,
        "sections": _describe_sections(result.formulation.repeated),
        "margin": result.margin,
        "margin_lower": result.margin_lower,
        "accuracy": result.accuracy,
        "prior_of_model": prior_fields(result.prior),
        "certificate": {"upper": result.certificate.upper, "value": result.certificate.value},
        "solver": result.solver,
        "timing_s": result.timing,
        "choices": {name: dataclasses.asdict(choice) for name, choice in result.choices.items()},
        "problem": problem,
        "problem_digest": digest({"text": text_array(problem)}),
        "summary": result.summary().splitlines(),
    }
    return record, arrays


def _describe_sections(sections: Sections | None) -> dict[str, Any] | None:
    if sections is None:
        return None
    return {"zeros": [[a.real, a.imag] for a in sections.zeros], "repeats": sections.repeats}


def describe_problem(problem: MixedProblem) -> tuple[Arrays, Record]:
    """Numbers and text of a problem."""
    arrays: Arrays = {}
    text: Record = {
        "prior": prior_fields(problem.prior),
        "frequency": [],
        "time": [],
        "parametric": None,
        "symmetric": problem.symmetric,
    }
    for kind in ("frequency", "time"):
        for i, item in enumerate(getattr(problem, kind)):
            described = {}
            for name, value in flat_fields(item).items():
                if isinstance(value, np.ndarray):
                    arrays[f"{kind}{i}/{name}"] = value
                else:
                    described[name] = value
            described["class"] = type(item).__name__
            text[kind].append(described)
    if problem.parametric is not None:
        basis = problem.parametric.in_s()
        arrays |= {f"parametric/{name}": getattr(basis, name) for name in ("A", "B", "C", "D", "poles")}
        text["parametric"] = {
            "dt": basis.dt,
            "functions": [dataclasses.asdict(function) for function in basis.functions],
        }
    if problem.parameter_bounds is not None:
        arrays["parameter_bounds"] = problem.parameter_bounds
    return arrays, text


def unpack(record: Record, arrays: Arrays) -> Identification:
    """The identification that was packed so; every claim is verified again."""
    if record["problem_digest"] != digest({"text": text_array(record["problem"])}):
        raise ValueError("the problem was edited (its digest differs)")
    problem = read_problem(arrays, record["problem"])
    prior = prior_from(record["prior_of_model"])
    sections = _read_sections(record["sections"])
    formulation = formulate_in(problem, sections)
    if formulation.count * problem.entries.count != arrays["result/coefficients"].size:
        raise ValueError("its sections do not belong to its coefficients")
    formulation.check_size(record["accuracy"])
    used = formulation.of(dataclasses.replace(problem, prior=prior))
    x, p = arrays["result/coefficients"], arrays["result/scaled_parameters"]
    certificate = MarginCertificate(arrays["certificate/samples"], arrays["certificate/ball"], **record["certificate"])
    point = (arrays["claim/x"], arrays["claim/p"])
    claim = Claim(record["margin"], record["accuracy"], *point, certificate, record["solver"])
    if record["status"] != claim.status.name or record["margin_lower"] != certificate.value:
        raise ValueError("its status or margin contradicts its own certificate")
    center = Candidate(x, p, certificate.samples, certificate.ball, claim.solver)
    level = level_of(record["objective"], claim.margin, claim.accuracy, prior)
    nominal = nominal_model(used, center, level)
    return Identification(
        formulation=formulation,
        objective=record["objective"],
        claim=claim,
        prior=prior,
        coefficients=x,
        scaled_parameters=p,
        model=nominal.model,
        verification=verify(used, center, nominal, claim, formulation.data, level),
        timing=record["timing_s"],
        choices=_read_choices(record),
    )


def _read_choices(record: Record) -> dict[str, Choice]:
    """The choices; of files of older versions the notes, whose source is not known."""
    if "choices" in record:
        return {name: Choice.read(choice) for name, choice in record["choices"].items()}
    return {f"note {k}": Choice(None, Source.STATED, note) for k, note in enumerate(record["notes"], start=1)}


def read_problem(arrays: Arrays, text: Record) -> MixedProblem:
    """The problem that `describe_problem` described."""
    experiments: dict[str, list[Any]] = {}
    for kind, cls in (("frequency", FrequencyResponse), ("time", TimeRecord)):
        experiments[kind] = []
        for i, described in enumerate(text[kind]):
            prefix = f"{kind}{i}/"
            fields = {name.removeprefix(prefix): value for name, value in arrays.items() if name.startswith(prefix)}
            described, name = dict(described), described.get("class", cls.__name__)
            described.pop("class", None)
            experiments[kind].append(from_fields(_CLASSES[name], fields | described))
    basis = None
    if text["parametric"] is not None:
        A, B, C, D, poles = (arrays[f"parametric/{name}"] for name in ("A", "B", "C", "D", "poles"))
        own = text["parametric"]  # older files know labels alone
        basis = ParametricBasis(A, B, C, D, own["dt"], tuple(own.get("functions") or own["labels"]), poles)
    prior = prior_from(text["prior"])
    return MixedProblem(
        frequency=experiments["frequency"],
        time=experiments["time"],
        prior=prior,
        parametric=basis,
        parameter_bounds=arrays.get("parameter_bounds"),
        symmetric=text.get("symmetric", False),
    )


def _read_sections(text: dict[str, Any] | None) -> Sections | None:
    return None if text is None else Sections(tuple(complex(*a) for a in text["zeros"]), text["repeats"])


keep(Identification, "identification", pack=pack, unpack=unpack)

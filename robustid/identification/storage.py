"""Saving an identification: numbers in .npz, the rest in readable .json; never pickle."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import os
import pathlib
from typing import TYPE_CHECKING, Any

import numpy as np

from robustid._version import __version__
from robustid.bases import Sections
from robustid.core import atomic_write
from robustid.errors import InputError
from robustid.identification.prior import prior_fields
from robustid.identification.problem import MixedProblem

if TYPE_CHECKING:
    from robustid.identification.result import Identification

FORMAT = "robustid identification 1"


def save_identification(result: Identification, path: str | os.PathLike[str]) -> None:
    """Write `path`.npz and `path`.json, both or none."""
    write(path, *describe(result))


def describe(result: Identification) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """What is written of a result: text and numbers."""
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
        "format": FORMAT,
        "version": __version__,
        "status": result.status.name,
        "meaning": result.status.value,
        "objective": result.objective,
        "sections": _describe_sections(result.sections),
        "margin": result.margin,
        "margin_lower": result.margin_lower,
        "accuracy": result.accuracy,
        "prior_of_model": prior_fields(result.prior),
        "certificate": {"upper": result.certificate.upper, "value": result.certificate.value},
        "solver": result.solver,
        "timing_s": result.timing,
        "notes": list(result.notes),
        "problem": problem,
        "problem_digest": digest({"text": text_array(problem)}),
        "summary": result.summary().splitlines(),
    }
    return record, arrays


def write(path: str | os.PathLike[str], record: dict[str, Any], arrays: dict[str, np.ndarray]) -> None:
    """Write `path`.npz and `path`.json, bound to each other by a digest; whatever happens, what was there before or both.

    Raises
    ------
    InputError
        The files can't be written.
    """
    numbers, text = paths(path)
    record = record | {"digest": digest(arrays)}
    try:
        with atomic_write(numbers, "wb") as binary, atomic_write(text, "w") as file:
            np.savez_compressed(binary, allow_pickle=False, **arrays)  # type: ignore[arg-type]
            json.dump(record, file, indent=1)
            for stream in (binary, file):  # a full disk is to show itself before anything is replaced
                stream.flush()
    except OSError as error:
        raise InputError(f"`path` = {str(path)!r} can't be written: {error.strerror}") from error


def paths(path: str | os.PathLike[str]) -> tuple[pathlib.Path, pathlib.Path]:
    """The .npz and the .json file of a saved result."""
    base = pathlib.Path(path)
    if base.suffix in (".npz", ".json"):
        base = base.with_suffix("")
    return base.with_name(base.name + ".npz"), base.with_name(base.name + ".json")


def digest(arrays: dict[str, np.ndarray]) -> str:
    """SHA-256 of all arrays: what binds the two files together."""
    total = hashlib.sha256()
    for name in sorted(arrays):
        array = np.ascontiguousarray(arrays[name])
        total.update(f"{name} {array.dtype.str} {array.shape}".encode())
        total.update(array.tobytes())
    return total.hexdigest()


def _describe_sections(sections: Sections | None) -> dict[str, Any] | None:
    if sections is None:
        return None
    return {"zeros": [[a.real, a.imag] for a in sections.zeros], "repeats": sections.repeats}


def text_array(text: Any) -> np.ndarray:
    """Text of any structure as an array, for digests."""
    return np.frombuffer(json.dumps(text, sort_keys=True).encode(), np.uint8)


def describe_problem(problem: MixedProblem) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """What is written of a problem: numbers and text."""
    arrays: dict[str, np.ndarray] = {}
    text: dict[str, Any] = {
        "prior": prior_fields(problem.prior),
        "frequency": [],
        "time": [],
        "parametric": None,
        "symmetric": problem.symmetric,
    }
    for kind in ("frequency", "time"):
        for i, item in enumerate(getattr(problem, kind)):
            described = {}
            for field in dataclasses.fields(item):
                value = getattr(item, field.name)
                if isinstance(value, np.ndarray):
                    arrays[f"{kind}{i}/{field.name}"] = value
                else:
                    described[field.name] = value
            described["class"] = type(item).__name__
            text[kind].append(described)
    if problem.parametric is not None:
        basis = problem.parametric
        arrays |= {f"parametric/{name}": getattr(basis, name) for name in ("A", "B", "C", "D", "poles")}
        text["parametric"] = {"dt": basis.dt, "labels": list(basis.labels)}
    if problem.parameter_bounds is not None:
        arrays["parameter_bounds"] = problem.parameter_bounds
    return arrays, text

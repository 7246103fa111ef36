"""Reading back a saved identification; every claim is verified again."""

from __future__ import annotations

import contextlib
import dataclasses
import json
import os
import zipfile
from collections.abc import Iterator
from typing import Any

import numpy as np

from robustid.bases import ParametricBasis, Sections
from robustid.data import FrequencyResponse, TangentialResponse, TimeRecord
from robustid.errors import FileFormatError
from robustid.identification.certificate import MarginCertificate
from robustid.identification.forms import Claim, level_of, pose
from robustid.identification.model import nominal_model
from robustid.identification.prior import Prior
from robustid.identification.problem import MixedProblem
from robustid.identification.result import Identification
from robustid.identification.solver.conic import Candidate
from robustid.identification.storage import FORMAT, digest, paths, text_array
from robustid.identification.verification import verify


def load_identification(path: str | os.PathLike[str]) -> Identification:
    """Read what `Identification.save` wrote, rebuild the model, and verify every claim again.

    Raises
    ------
    FileFormatError
        The files are missing, truncated, of another kind, or do not belong together.
    """
    record, arrays = read(path, FORMAT, "identification")
    with usable(path):
        return rebuild(record, arrays)


def read(path: str | os.PathLike[str], form: str, what: str) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Text and numbers of a saved result of a format, which belong together."""
    numbers, text = paths(path)
    try:
        record = json.loads(text.read_text(encoding="utf-8"))
        with np.load(numbers, allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
        if record["format"] != form:
            raise ValueError(f"their format is {record['format']!r}")
        intact = record["digest"] == digest(arrays)
    except FileNotFoundError as error:
        raise FileFormatError(f"`path`: {error.filename} is missing; saved {what} is a .npz and a .json file") from None
    except (OSError, ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile) as error:
        raise FileFormatError(f"`path`: {text} and {numbers.name} are not a saved {what} ({error})") from None
    if not intact:
        raise FileFormatError(f"`path`: {numbers} does not belong to {text} (its digest differs); restore both files")
    return record, arrays


@contextlib.contextmanager
def usable(path: str | os.PathLike[str]) -> Iterator[None]:
    """Say which files can't be used, where rebuilding their result fails."""
    numbers, text = paths(path)
    try:
        yield
    except KeyError as error:
        raise FileFormatError(f"`path`: {text} lacks {error}; was it edited?") from None
    except (TypeError, ValueError, np.linalg.LinAlgError) as error:
        raise FileFormatError(f"`path`: {text} and {numbers.name} can't be used: {error}") from None


_CLASSES = {cls.__name__: cls for cls in (FrequencyResponse, TangentialResponse, TimeRecord)}


def _read_problem(arrays: dict[str, np.ndarray], text: dict[str, Any]) -> MixedProblem:
    experiments: dict[str, list] = {}
    for kind, cls in (("frequency", FrequencyResponse), ("time", TimeRecord)):
        experiments[kind] = []
        for i, described in enumerate(text[kind]):
            prefix = f"{kind}{i}/"
            fields = {name.removeprefix(prefix): value for name, value in arrays.items() if name.startswith(prefix)}
            described, name = dict(described), described.get("class", cls.__name__)
            described.pop("class", None)
            experiments[kind].append(_CLASSES[name](**fields, **described))
    basis = None
    if text["parametric"] is not None:
        matrices = {name: arrays[f"parametric/{name}"] for name in ("A", "B", "C", "D", "poles")}
        basis = ParametricBasis(**matrices, dt=text["parametric"]["dt"], labels=tuple(text["parametric"]["labels"]))
    prior = Prior(**text["prior"])
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


def rebuild(record: dict[str, Any], arrays: dict[str, np.ndarray]) -> Identification:
    """The identification that was described so, verified again."""
    if record["problem_digest"] != digest({"text": text_array(record["problem"])}):
        raise ValueError("the problem was edited (its digest differs)")
    problem = _read_problem(arrays, record["problem"])
    prior = Prior(**record["prior_of_model"])
    sections = _read_sections(record["sections"])
    if sections is not None and sections.order * problem.entries.count != arrays["result/coefficients"].size:
        raise ValueError("its sections do not belong to its coefficients")
    data, posed = pose(problem, sections).data, pose(dataclasses.replace(problem, prior=prior), sections)
    x, p = arrays["result/coefficients"], arrays["result/scaled_parameters"]
    certificate = MarginCertificate(arrays["certificate/samples"], arrays["certificate/ball"], **record["certificate"])
    point = (arrays["claim/x"], arrays["claim/p"])
    claim = Claim(record["margin"], record["accuracy"], *point, certificate, record["solver"])
    if record["status"] != claim.status.name or record["margin_lower"] != certificate.value:
        raise ValueError("its status or margin contradicts its own certificate")
    center = Candidate(x, p, certificate.samples, certificate.ball, claim.solver)
    level = level_of(record["objective"], claim.margin, claim.accuracy)
    nominal = nominal_model(posed, center, level)
    return Identification(
        problem=problem,
        objective=record["objective"],
        claim=claim,
        prior=prior,
        coefficients=x,
        scaled_parameters=p,
        sections=sections,
        model=nominal.model,
        verification=verify(posed, center, nominal, claim, data, level),
        timing=record["timing_s"],
        notes=tuple(record["notes"]),
    )

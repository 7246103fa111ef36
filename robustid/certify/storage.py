"""Saving a worst-case error with everything that its proofs need, and reading it back."""

from __future__ import annotations

import os
from typing import Any

import numpy as np

from robustid._version import __version__
from robustid.certify.circle import CircleBound
from robustid.certify.packing import Arrays, pack_certificates, pack_values, part, unpack_certificates, unpack_values
from robustid.certify.parameters import ParameterIntervals
from robustid.certify.worst_case import WorstCaseError, as_nominal
from robustid.identification import Identification
from robustid.identification.loading import read, rebuild, usable
from robustid.identification.storage import describe, write

FORMAT = "robustid worst-case error 1"

_PARAMETERS, _VALUES, _CIRCLE, _MODEL = "parameters/", "values/", "circle/", "nominal/"


def save_worst_case_error(error: WorstCaseError, path: str | os.PathLike[str]) -> None:
    """Write `path`.npz and `path`.json, both or none: the identification, the bounds, their certificates."""
    described, arrays = describe(error.identification)
    found, circle = error.parameters, error.__dict__.get("circle")
    ends = {"lower": found.lower, "upper": found.upper, "attained": found.attained}
    arrays |= _under(_PARAMETERS, ends | pack_certificates(found.certificates))
    arrays |= _under(_VALUES, pack_values(error.values))
    if circle is not None:
        numbers = {"edges": circle.edges, "bound": circle.bound, "lower": np.array(circle.lower)}
        arrays |= _under(_CIRCLE, numbers | pack_values(circle.values))
    model = error.model
    if model is not error.identification.model:
        arrays |= _under(_MODEL, {name: np.asarray(getattr(model, name)) for name in "ABCD"})
    record = {
        "format": FORMAT,
        "version": __version__,
        "directions": error.directions,
        "gap": error.gap,
        "circle_converged": None if circle is None else circle.converged,
        "summary": error.summary().splitlines(),
        "identification": described,
    }
    write(path, record, arrays)


def load_worst_case_error(path: str | os.PathLike[str]) -> WorstCaseError:
    """Read what `WorstCaseError.save` wrote; `certified` and `verify` evaluate its certificates again.

    Parameters
    ----------
    path : str or path
        NAME, NAME.npz or NAME.json.

    Returns
    -------
    WorstCaseError
        With the identification, rebuilt and verified. What was attained is read as it was found: certificates are there of the
        bounds.

    Raises
    ------
    FileFormatError
        The files are missing, truncated, of another kind, or do not belong together.

    Examples
    --------
    >>> import pathlib, tempfile, numpy as np, robustid as rid
    >>> record = rid.TimeRecord(np.eye(1, 2)[0], [0.5, 0.25], dt=1.0, bound=1e-3)
    >>> result = rid.identify(rid.MixedProblem(time=record, prior=rid.Prior(gain_bound=1.0, decay_rate=1.5)))
    >>> error = rid.worst_case_error(result, omega=[0.0, 1.0])
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     error.save(pathlib.Path(folder) / "bounds")
    ...     again = rid.load_worst_case_error(pathlib.Path(folder) / "bounds")
    >>> again.certified, bool(np.all(again.upper == error.upper))
    (True, True)
    """
    record, arrays = read(path, FORMAT, "worst-case error")
    with usable(path):
        return _rebuild(record, arrays)


def _rebuild(record: dict[str, Any], arrays: Arrays) -> WorstCaseError:
    identification = rebuild(record["identification"], arrays)
    directions, dt = record["directions"], identification.problem.dt
    error = WorstCaseError(
        identification=identification,
        model=_nominal(part(arrays, _MODEL), identification),
        values=tuple(unpack_values(part(arrays, _VALUES), dt, directions)),
        parameters=_parameters(part(arrays, _PARAMETERS), identification),
        directions=directions,
        gap=record["gap"],
    )
    circle = part(arrays, _CIRCLE)
    if circle:
        if circle["edges"].size != circle["bound"].size + 1:
            raise ValueError("its bound on the circle does not fit its edges")
        values = tuple(unpack_values(circle, dt))
        error.__dict__["circle"] = CircleBound(
            circle["edges"], circle["bound"], float(circle["lower"]), record["circle_converged"], values
        )
    return error


def _under(prefix: str, arrays: Arrays) -> Arrays:
    return {prefix + name: array for name, array in arrays.items()}


def _nominal(matrices: Arrays, identification: Identification) -> Any:
    if not matrices:
        return identification.model
    import control

    return as_nominal(control.ss(*(matrices[name] for name in "ABCD"), identification.problem.dt), identification)


def _parameters(arrays: Arrays, identification: Identification) -> ParameterIntervals:
    basis = identification.problem.parametric
    count = 0 if basis is None else basis.size
    found = ParameterIntervals(arrays["lower"], arrays["upper"], arrays["attained"], unpack_certificates(arrays))
    if (found.lower.shape, found.upper.shape, found.attained.shape) != ((count,), (count,), (count, 2)):
        raise ValueError("its intervals are not those of the parameters")
    if len(found.certificates) != 2 * count:
        raise ValueError("its intervals and their certificates differ in number")
    return found

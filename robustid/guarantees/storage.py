"""Saving a worst-case error, or a band over poles, with everything that its proofs need, and reading it back."""

from __future__ import annotations

import dataclasses
import os
from typing import Any

import numpy as np

from robustid._version import __version__
from robustid.core import as_count
from robustid.guarantees.circle import CircleBound
from robustid.guarantees.nominal import as_nominal
from robustid.guarantees.packing import Arrays, pack_certificates, pack_values, part, unpack_certificates, unpack_values
from robustid.guarantees.parameters import ParameterIntervals
from robustid.guarantees.pole_band import PoleBand
from robustid.guarantees.pole_cells import PoleCell, box_of
from robustid.guarantees.pole_proofs import KeptCell, RefutedCell
from robustid.guarantees.worst_case import WorstCaseError
from robustid.identification import Identification, MarginCertificate, describe, read, rebuild, usable, write

FORMAT, FORMAT_POLES = "robustid worst-case error 1", "robustid band over poles 1"

_PARAMETERS, _VALUES, _CIRCLE, _MODEL = "parameters/", "values/", "circle/", "nominal/"
_BAND, _BOX, _KEPT, _REFUTED = "band/", "box/", "kept/{}/", "refuted/{}/"


def save_worst_case_error(error: WorstCaseError, path: str | os.PathLike[str]) -> None:
    """Write `path`.npz and `path`.json, both or none: the identification, the bounds, their certificates."""
    described, arrays = describe(error.identification)
    found, circle = error.parameters, error.__dict__.get("circle")
    ends = {"lower": found.lower, "upper": found.upper, "attained": found.attained}
    arrays |= _under(_PARAMETERS, ends | pack_certificates(found.certificates))
    arrays |= _under(_VALUES, pack_values(error.values))
    if circle is not None:
        numbers = {"edges": circle.edges, "bound": circle.bound, "lower": np.array(circle.lower)}
        numbers["entries"] = circle.entries
        arrays |= _under(_CIRCLE, numbers | pack_values(circle.values))
    arrays |= _pack_nominal(error)
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
    directions, shape = record["directions"], (identification.problem.dt, identification.problem.entries)
    error = WorstCaseError(
        identification=identification,
        model=_nominal(part(arrays, _MODEL), identification),
        values=tuple(unpack_values(part(arrays, _VALUES), *shape, directions)),
        parameters=_parameters(part(arrays, _PARAMETERS), identification),
        directions=directions,
        gap=record["gap"],
    )
    circle = part(arrays, _CIRCLE)
    if circle:
        if circle["edges"].size != circle["bound"].size + 1:
            raise ValueError("its bound on the circle does not fit its edges")
        values, lower = tuple(unpack_values(circle, *shape)), float(circle["lower"])
        bounds = circle["edges"], circle["bound"], lower, record["circle_converged"], values
        error.__dict__["circle"] = CircleBound(*bounds, circle.get("entries"))
    return error


def save_pole_band(band: PoleBand, path: str | os.PathLike[str]) -> None:
    """Write `path`.npz and `path`.json, both or none: the identification, the cells and their certificates, the bounds."""
    described, arrays = describe(band.identification)
    arrays |= _pack_nominal(band) | _under(_BOX, _pack_ends(band.box))
    arrays |= _under(_BAND, {name: getattr(band, name) for name in ("omega", "upper", "magnitude")})
    for k, item in enumerate(band.kept):
        arrays |= _under(_KEPT.format(k), _pack_ends(item.cell) | _under(_VALUES, pack_values(item.values)))
    for k, item in enumerate(band.refuted):
        proof = item.certificate
        numbers = {"samples": proof.samples, "ball": proof.ball, "limits": np.array([proof.upper, proof.value])}
        arrays |= _under(_REFUTED.format(k), _pack_ends(item.cell) | numbers)
    record = {
        "format": FORMAT_POLES,
        "version": __version__,
        "delay": band.box.delay,
        "kept": len(band.kept),
        "refuted": len(band.refuted),
        "summary": band.summary().splitlines(),
        "identification": described,
    }
    write(path, record, arrays)


def load_pole_band(path: str | os.PathLike[str]) -> PoleBand:
    """Read what `PoleBand.save` wrote; `certified` and `verify` evaluate its proofs again.

    Parameters
    ----------
    path : str or path
        NAME, NAME.npz or NAME.json.

    Returns
    -------
    PoleBand
        With the identification, rebuilt and verified, and the amplitudes that follow from it.

    Raises
    ------
    FileFormatError
        The files are missing, truncated, of another kind, or do not belong together.

    Examples
    --------
    >>> import pathlib, tempfile, robustid as rid
    >>> data = rid.flexible_structure(lines=5, samples=2, extra_hz=[17.6, 17.7])
    >>> modes = rid.kautz(*data.modes.T, dt=0.01, delay=1)
    >>> prior = rid.Prior(gain_bound=0.1, decay_rate=1.3)
    >>> result = rid.identify(rid.MixedProblem(frequency=data.frequency, prior=prior, parametric=modes))
    >>> box = data.modes[:, :1] * [0.999, 1.001], data.modes[:, 1:] * [0.95, 1.05]
    >>> band = rid.worst_case_over_poles(result, *box, omega=[30.0], directions=4, cells=1)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     band.save(pathlib.Path(folder) / "band")
    ...     again = rid.load_pole_band(pathlib.Path(folder) / "band")
    >>> again.certified, bool(again.upper == band.upper)
    (True, True)
    """
    record, arrays = read(path, FORMAT_POLES, "error over a box of poles")
    with usable(path):
        return _rebuild_band(record, arrays)


def _rebuild_band(record: dict[str, Any], arrays: Arrays) -> PoleBand:
    identification = rebuild(record["identification"], arrays)
    dt, ends = identification.problem.dt, part(arrays, _BOX)
    box = box_of(identification, ends["omega"], ends["damping"], as_count("delay", record["delay"]))
    kept, refuted = [], []
    for k in range(record["kept"]):
        mine = part(arrays, _KEPT.format(k))
        kept.append(KeptCell(_cell(box, mine), tuple(unpack_values(part(mine, _VALUES), dt))))
    for k in range(record["refuted"]):
        mine = part(arrays, _REFUTED.format(k))
        proof = MarginCertificate(mine["samples"], mine["ball"], *mine["limits"].tolist())
        refuted.append(RefutedCell(_cell(box, mine), proof))
    numbers = part(arrays, _BAND)
    count = numbers["omega"].size
    if not kept or [numbers[name].shape for name in ("upper", "magnitude")] != [(count, 1, 1), (count, 2)]:
        raise ValueError("it keeps no cell, or its bounds are not those of its frequencies")
    return PoleBand(
        identification=identification,
        model=_nominal(part(arrays, _MODEL), identification),
        **numbers,  # type: ignore[arg-type]
        box=box,
        kept=tuple(kept),
        refuted=tuple(refuted),
    )


def _pack_ends(cell: PoleCell) -> Arrays:
    return {"omega": cell.omega, "damping": cell.damping}


def _cell(box: PoleCell, arrays: Arrays) -> PoleCell:
    """A part of the box: amplitudes and delay are those of the whole."""
    cell = dataclasses.replace(box, omega=arrays["omega"], damping=arrays["damping"])
    if {cell.omega.shape, cell.damping.shape} != {box.omega.shape}:
        raise ValueError("its cells have not the modes of the box")
    return cell


def _pack_nominal(result: WorstCaseError | PoleBand) -> Arrays:
    """The model where it isn't that of the identification."""
    if result.model is result.identification.model:
        return {}
    return _under(_MODEL, {name: np.asarray(getattr(result.model, name)) for name in "ABCD"})


def _under(prefix: str, arrays: Arrays) -> Arrays:
    return {prefix + name: array for name, array in arrays.items()}


def _nominal(matrices: Arrays, identification: Identification) -> Any:
    if not matrices:
        return identification.model
    import control

    return as_nominal(control.ss(*(matrices[name] for name in "ABCD"), identification.problem.dt), identification)


def _parameters(arrays: Arrays, identification: Identification) -> ParameterIntervals:
    basis = identification.problem.parametric
    entries, size = identification.problem.entries, 0 if basis is None else basis.size
    count = (size,) if entries.single else (size, entries.outputs, entries.inputs)
    found = ParameterIntervals(arrays["lower"], arrays["upper"], arrays["attained"], unpack_certificates(arrays))
    if (found.lower.shape, found.upper.shape, found.attained.shape) != (count, count, (*count, 2)):
        raise ValueError("its intervals are not those of the parameters")
    if len(found.certificates) != 2 * size * entries.count:
        raise ValueError("its intervals and their certificates differ in number")
    return found

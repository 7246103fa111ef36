"""Worst-case errors, at fixed poles, over a pole-uncertainty box and of families, as numbers and text with all their proofs."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from robustid.core import Arrays, Record, as_count, describe, digest, keep, part, rebuild, text_array, under
from robustid.guarantees.band import band_of_multipliers
from robustid.guarantees.band_result import Band
from robustid.guarantees.circle import CircleBound
from robustid.guarantees.contradictions import Contradiction, contradiction_of_multipliers
from robustid.guarantees.family_result import Family
from robustid.guarantees.linear.amplitudes import Extraction
from robustid.guarantees.member import Member, as_members
from robustid.guarantees.nominal import as_nominal
from robustid.guarantees.over_poles import WorstCaseOverPoles
from robustid.guarantees.packing import pack_certificates, pack_values, unpack_certificates, unpack_values
from robustid.guarantees.parameters import ParameterIntervals
from robustid.guarantees.pole_cells import PoleCell, box_of
from robustid.guarantees.pole_proofs import KeptCell, RefutedCell
from robustid.guarantees.worst_case_result import WorstCaseError
from robustid.identification import Identification, MarginCertificate, describe_problem, read_problem

_PARAMETERS, _VALUES, _CIRCLE, _MODEL = "parameters/", "values/", "circle/", "nominal/"
_BAND, _BOX, _KEPT, _REFUTED = "band/", "box/", "kept/{}/", "refuted/{}/"
_MISSING, _MEMBER = "missing", "member/{}/"
_ENTRY, _AMPLITUDES, _POLYGONS, _CLASH = "entry/{}/", "amplitudes/", "polygons/", "clash/"


def _pack_error(error: WorstCaseError) -> tuple[Record, Arrays]:
    described, arrays = describe(error.identification)
    found, circle = error.parameters, error.known_circle
    ends = {"lower": found.lower, "upper": found.upper, "attained": found.attained}
    arrays |= under(_PARAMETERS, ends | pack_certificates(found.certificates))
    arrays |= under(_VALUES, pack_values(error.values)) | {_MISSING: error.missing}
    if circle is not None:
        numbers = {"edges": circle.edges, "bound": circle.bound, "lower": np.array(circle.lower)}
        numbers["entries"] = circle.entries
        arrays |= under(_CIRCLE, numbers | pack_values(circle.values))
    arrays |= _pack_nominal(error)
    record = {
        "directions": error.directions,
        "gap": error.gap,
        "circle_converged": None if circle is None else circle.converged,
        "summary": error.summary().splitlines(),
        "identification": described,
    }
    return record, arrays


def _unpack_error(record: Record, arrays: Arrays) -> WorstCaseError:
    identification = rebuild(record["identification"], arrays)
    directions, shape = record["directions"], (identification.problem.dt, identification.problem.entries)
    error = WorstCaseError(
        identification=identification,
        model=_nominal(part(arrays, _MODEL), identification),
        values=tuple(unpack_values(part(arrays, _VALUES), *shape, directions)),
        parameters=_parameters(part(arrays, _PARAMETERS), identification),
        directions=directions,
        gap=record["gap"],
        missing=arrays.get(_MISSING, np.zeros(0)),
    )
    circle = part(arrays, _CIRCLE)
    if circle:
        if circle["edges"].size != circle["bound"].size + 1:
            raise ValueError("its bound on the circle does not fit its edges")
        values, lower = tuple(unpack_values(circle, *shape)), float(circle["lower"])
        bounds = circle["edges"], circle["bound"], lower, record["circle_converged"], values
        error = error.with_circle(CircleBound(*bounds, circle.get("entries")))
    return error


def _pack_over_poles(band: WorstCaseOverPoles) -> tuple[Record, Arrays]:
    described, arrays = describe(band.identification)
    arrays |= _pack_nominal(band) | under(_BOX, _pack_ends(band.box))
    arrays |= under(_BAND, {name: getattr(band, name) for name in ("omega", "upper", "magnitude")})
    for k, item in enumerate(band.kept):
        arrays |= under(_KEPT.format(k), _pack_ends(item.cell) | under(_VALUES, pack_values(item.values)))
    for k, item in enumerate(band.refuted):
        proof = item.certificate
        numbers = {"samples": proof.samples, "ball": proof.ball, "limits": np.array([proof.upper, proof.value])}
        arrays |= under(_REFUTED.format(k), _pack_ends(item.cell) | numbers)
    record = {
        "delay": band.box.delay,
        "kept": len(band.kept),
        "refuted": len(band.refuted),
        "summary": band.summary().splitlines(),
        "identification": described,
    }
    return record, arrays


def _unpack_over_poles(record: Record, arrays: Arrays) -> WorstCaseOverPoles:
    identification = rebuild(record["identification"], arrays)
    problem, ends = identification.problem, part(arrays, _BOX)
    box = box_of(identification, ends["omega"], ends["damping"], as_count("delay", record["delay"]))
    kept: list[KeptCell] = []
    refuted: list[RefutedCell] = []
    for k in range(record["kept"]):
        mine = part(arrays, _KEPT.format(k))
        kept.append(KeptCell(_cell(box, mine), tuple(unpack_values(part(mine, _VALUES), problem.dt, problem.entries))))
    for k in range(record["refuted"]):
        mine = part(arrays, _REFUTED.format(k))
        proof = MarginCertificate(mine["samples"], mine["ball"], *mine["limits"].tolist())
        refuted.append(RefutedCell(_cell(box, mine), proof))
    numbers = part(arrays, _BAND)
    shape = numbers["omega"].size, *problem.entries.shape
    wanted = shape, ((shape[0], 2) if problem.entries.single else (*shape, 2))
    if not kept or (numbers["upper"].shape, numbers["magnitude"].shape) != wanted:
        raise ValueError("it keeps no cell, or its bounds are not those of its frequencies")
    return WorstCaseOverPoles(
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
    """Part of the pole-uncertainty box: amplitudes and delay are those of the whole."""
    cell = dataclasses.replace(box, omega=arrays["omega"], damping=arrays["damping"])
    if {cell.omega.shape, cell.damping.shape} != {box.omega.shape}:
        raise ValueError("its cells have not the modes of the pole-uncertainty box")
    return cell


def _pack_nominal(result: WorstCaseError | WorstCaseOverPoles) -> Arrays:
    """The model where it isn't that of the identification."""
    if result.model is result.identification.model:
        return {}
    return _matrices(result.model)


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
    return found


def _pack_band(band: Band) -> tuple[Record, Arrays]:
    arrays, problem = describe_problem(band.problem)
    arrays |= {"omega": band.omega}
    if band.box is not None:
        arrays |= under(_BOX, {"omega": band.box[0], "damping": band.box[1]})
    if band.model is not None:
        arrays |= _matrices(band.model)
    for k, one in enumerate(band.bands):
        numbers = {"angles": one.angles, "points": one.points.astype(np.int32), "multipliers": one.multipliers}
        arrays |= under(_ENTRY.format(k), numbers | _pack_amplitudes(one.extraction))
    polygons: Record | None = None
    if band.polygons is not None:
        polygons, numbers = describe(band.polygons)
        arrays |= under(_POLYGONS, numbers)
    record = {
        "problem": problem,
        "problem_digest": digest({"text": text_array(problem)}),
        "entries": len(band.bands),
        "polygons": polygons,
        "summary": band.summary().splitlines(),
    }
    return record, arrays


def _unpack_band(record: Record, arrays: Arrays) -> Band:
    """The band of stored multipliers: radii are not stored, but follow from them anew; certificates of polygons are evaluated."""
    if record["problem_digest"] != digest({"text": text_array(record["problem"])}):
        raise ValueError("the problem was edited (its digest differs)")
    problem, ends, model = read_problem(arrays, record["problem"]), part(arrays, _BOX), part(arrays, _MODEL)
    nominal: Any = None
    if model:
        import control

        nominal = control.ss(*(model[name] for name in "ABCD"), problem.dt)
    box = (ends["omega"], ends["damping"]) if ends else None
    parts = [part(arrays, _ENTRY.format(k)) for k in range(record["entries"])]
    multipliers = [(one["angles"], one["points"], one["multipliers"], part(one, _AMPLITUDES)) for one in parts]
    polygons = None if record.get("polygons") is None else rebuild(record["polygons"], part(arrays, _POLYGONS))
    return band_of_multipliers(problem, box, arrays["omega"], nominal, multipliers, polygons)


def _pack_amplitudes(found: Extraction) -> Arrays:
    return under(_AMPLITUDES, {name: getattr(found, name) for name in ("about", "points", "multipliers", "assumed")})


def _pack_contradiction(found: Contradiction) -> tuple[Record, Arrays]:
    arrays, problem = describe_problem(found.problem)
    clash = found.clash
    if found.box is not None:
        arrays |= under(_BOX, {"omega": found.box[0], "damping": found.box[1]})
    numbers = {"base": np.array(clash.base), "points": clash.points, "multipliers": clash.multipliers}
    arrays |= under(_CLASH, numbers | _pack_amplitudes(clash.extraction))
    record = {
        "problem": problem,
        "problem_digest": digest({"text": text_array(problem)}),
        "entry": list(clash.samples.entry),
        "sample": clash.sample,
        "summary": found.summary().splitlines(),
    }
    return record, arrays


def _unpack_contradiction(record: Record, arrays: Arrays) -> Contradiction:
    """The contradiction of stored multipliers, which are evaluated anew."""
    if record["problem_digest"] != digest({"text": text_array(record["problem"])}):
        raise ValueError("the problem was edited (its digest differs)")
    problem, ends, numbers = read_problem(arrays, record["problem"]), part(arrays, _BOX), part(arrays, _CLASH)
    box = (ends["omega"], ends["damping"]) if ends else None
    proof = {"base": complex(numbers["base"]), "points": numbers["points"], "multipliers": numbers["multipliers"]}
    first, second = record["entry"]
    return contradiction_of_multipliers(
        problem, box, (int(first), int(second)), proof | {"sample": int(record["sample"])}, part(numbers, _AMPLITUDES)
    )


def _pack_family(family: Family) -> tuple[Record, Arrays]:
    arrays = _matrices(family.model)
    members: list[Record] = []
    for k, (member, error) in enumerate(zip(family.members, family.errors, strict=True)):
        described, numbers = describe(error)  # around the nominal: with the circle, where it has been bounded
        arrays |= under(_MEMBER.format(k), numbers)
        members.append({"name": member.name, "condition": member.condition, "result": described})
    record = {
        "members": members,
        "tried": [list(pair) for pair in family.tried],
        "schedule": family.schedule,
        "interval": None if family.interval is None else list(family.interval),
        "summary": family.summary().splitlines(),
    }
    return record, arrays


def _unpack_family(record: Record, arrays: Arrays) -> Family:
    found: list[Member] = []
    for k, item in enumerate(record["members"]):
        error = rebuild(item["result"], part(arrays, _MEMBER.format(k)))
        if not isinstance(error, WorstCaseError | WorstCaseOverPoles):
            raise ValueError("a member of it is not bounded")
        found.append(Member(error, item["name"], **item["condition"]))
    if not found or any(not np.array_equal(m.result.omega, found[0].result.omega) for m in found):
        raise ValueError("its members are not bounded at the same frequencies")
    interval: tuple[float, float] | None = None
    if record["interval"] is not None:
        low, high = map(float, record["interval"])
        interval = low, high
    model = _nominal(part(arrays, _MODEL), found[0].identification)
    tried = tuple((int(order), float(size)) for order, size in record["tried"])
    family = Family(members=as_members(found), model=model, tried=tried, schedule=record["schedule"], interval=interval)
    family.__dict__["errors"] = tuple(m.result for m in found)
    return family


def _matrices(model: Any) -> Arrays:
    return under(_MODEL, {name: np.asarray(getattr(model, name)) for name in "ABCD"})


keep(WorstCaseError, "worst-case error", pack=_pack_error, unpack=_unpack_error)
keep(
    WorstCaseOverPoles,
    "band over poles",
    words="error over a pole-uncertainty box",
    pack=_pack_over_poles,
    unpack=_unpack_over_poles,
)
keep(Band, "band", words="proved band", pack=_pack_band, unpack=_unpack_band)
keep(Family, "family", words="family of plants", pack=_pack_family, unpack=_unpack_family)
keep(Contradiction, "contradiction", pack=_pack_contradiction, unpack=_unpack_contradiction)

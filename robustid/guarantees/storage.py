"""Registers what is guaranteed: worst cases, bands, families, contradictions. Proofs are stored, and claims follow from them."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypedDict

import numpy as np
from numpy.typing import NDArray

from robustid.core import Arrays, Complex, Real, Record, StateMatrices, Unfinished, as_count, fields_of, keep
from robustid.guarantees.band import Multipliers, band_of_multipliers
from robustid.guarantees.band_result import Band
from robustid.guarantees.circle import CircleBound
from robustid.guarantees.contradictions import Contradiction, contradiction_of_multipliers
from robustid.guarantees.family_result import Family
from robustid.guarantees.linear.amplitudes import Extraction
from robustid.guarantees.linear.directed import DirectedBand, directed_fit
from robustid.guarantees.linear.entry_band import EntryBand
from robustid.guarantees.member import Member, as_members
from robustid.guarantees.nominal import as_nominal
from robustid.guarantees.over_poles import Bounded, WorstCaseOverPoles
from robustid.guarantees.packing import pack_certificates, pack_values, unpack_certificates, unpack_values
from robustid.guarantees.parameters import ParameterIntervals
from robustid.guarantees.pole_cells import PoleCell, loaded_cell
from robustid.guarantees.pole_proofs import KeptCell, RefutedBySums, RefutedCell, SummedCell, sides_of
from robustid.guarantees.watch_result import Watch
from robustid.guarantees.worst_case_result import WorstCaseError
from robustid.identification import Identification, MarginCertificate, MixedProblem

if TYPE_CHECKING:
    import control

Ends = tuple[Real, Real]  # of the natural frequencies and damping ratios of a box, (M, 2) each


class _Circle(TypedDict):
    edges: Real
    bound: Real
    lower: float
    converged: bool
    values: Arrays
    entries: Real


class _Cell(TypedDict):
    ends: Ends
    amplitudes: tuple[Arrays, ...]


class _Kept(TypedDict):
    cell: _Cell
    values: Arrays


class _Sums(TypedDict):
    points: NDArray[np.int32]
    multipliers: NDArray[np.complex64]


class _Summed(TypedDict):
    cell: _Cell
    omega: Real
    sums: tuple[_Sums, ...]


class _Refuted(TypedDict):
    cell: _Cell
    certificate: MarginCertificate


class _RefutedBySums(TypedDict):
    cell: _Cell
    angle: float
    entry: int
    sums: _Sums


class _Entry(TypedDict):
    angles: Real
    points: NDArray[np.int32]
    multipliers: Complex
    amplitudes: Arrays
    complete: bool
    nodes: bool


class _Plant(TypedDict):
    name: str
    condition: dict[str, float | str]
    result: Bounded


def _error(error: WorstCaseError) -> Record:
    found, circle = error.parameters, error.known_circle
    return {
        "identification": error.identification,
        "nominal": _own_nominal(error),
        "values": pack_values(error.values),
        "parameters": {name: getattr(found, name) for name in ("lower", "upper", "attained")}
        | pack_certificates(found.certificates),
        "circle": None if circle is None else _circle(circle),
        "directions": error.directions,
        "gap": error.gap,
        "missing": error.missing,
    }


def _circle(circle: CircleBound) -> Record:
    """All but the sets, which of a worst-case error say what its bounds say."""
    return {name: value for name, value in fields_of(circle).items() if name != "sets"} | {
        "values": pack_values(circle.values)
    }


def _make_error(
    identification: Identification,
    nominal: StateMatrices | None,
    values: Arrays,
    parameters: Arrays,
    circle: _Circle | None,
    directions: int,
    gap: float,
    missing: Real,
) -> WorstCaseError:
    shape = identification.problem.dt, identification.problem.entries
    error = WorstCaseError(
        identification=identification,
        model=_nominal(nominal, identification),
        values=tuple(unpack_values(values, *shape, directions)),
        parameters=_parameters(parameters, identification),
        directions=directions,
        gap=gap,
        missing=missing,
    )
    if circle is None:
        return error
    edges, bound, around = circle["edges"], circle["bound"], tuple(unpack_values(circle["values"], *shape))
    known = CircleBound(edges, bound, circle["lower"], circle["converged"], around, circle["entries"])
    if edges.size != bound.size + 1:
        raise ValueError("its bound on the circle does not fit its edges")
    return error.with_circle(known)


def _over_poles(band: WorstCaseOverPoles) -> Record:
    return {
        "identification": band.identification,
        "nominal": _own_nominal(band),
        "box": _cell(band.box),
        "delay": band.box.delay,
        "omega": band.omega,
        "kept": tuple(_kept(item) for item in band.kept),
        "refuted": tuple(_refuted(item) for item in band.refuted),
    }


def _kept(item: KeptCell | SummedCell) -> _Kept | _Summed:
    cell = _cell(item.cell)
    if isinstance(item, KeptCell):
        return {"cell": cell, "values": pack_values(item.values)}
    return {"cell": cell, "omega": item.omega, "sums": tuple(_sums(one) for one in item.bands)}


def _refuted(item: RefutedCell | RefutedBySums) -> _Refuted | _RefutedBySums:
    cell = _cell(item.cell)
    if isinstance(item, RefutedCell):
        return {"cell": cell, "certificate": item.certificate}
    band = item.band
    entry = [one.samples.entry for one in item.cell.proofs].index(band.samples.entry)
    return {"cell": cell, "angle": float(band.angles[0]), "entry": entry, "sums": _sums(band)}


def _sums(band: DirectedBand) -> _Sums:
    return {"points": band.points.astype(np.int32), "multipliers": band.multipliers.astype(np.complex64)}


def _make_over_poles(
    identification: Identification,
    nominal: StateMatrices | None,
    box: _Cell,
    delay: int,
    omega: Real,
    kept: tuple[_Kept | _Summed, ...],
    refuted: tuple[_Refuted | _RefutedBySums, ...],
) -> WorstCaseOverPoles:
    problem, delay = identification.problem, as_count("delay", delay)

    def loaded(cell: _Cell) -> PoleCell:
        omega, damping = cell["ends"]
        return loaded_cell(problem, omega, damping, delay, cell["amplitudes"])

    def kept_cell(item: _Kept | _Summed) -> KeptCell | SummedCell:
        cell = loaded(item["cell"])
        if "values" in item:
            return KeptCell(tuple(unpack_values(item["values"], problem.dt, problem.entries)), cell)
        angles = problem.plane.angles(item["omega"])
        bands = tuple(_band_of_sums(*pair, angles) for pair in zip(cell.proofs, item["sums"], strict=True))
        return SummedCell.of(problem, cell, item["omega"], bands)

    def refuted_cell(item: _Refuted | _RefutedBySums) -> RefutedCell | RefutedBySums:
        cell = loaded(item["cell"])
        if "certificate" in item:
            return RefutedCell(cell, item["certificate"])
        return RefutedBySums(cell, _band_of_sums(cell.proofs[item["entry"]], item["sums"], np.array([item["angle"]])))

    cells = tuple(kept_cell(item) for item in kept)
    if not cells or not all(np.all(np.isin(item.omega, omega)) for item in cells):
        raise ValueError("it keeps no cell, or one that is bounded at other frequencies than it")
    return WorstCaseOverPoles(
        identification=identification,
        model=_nominal(nominal, identification),
        omega=omega,
        box=loaded(box),
        kept=cells,
        refuted=tuple(refuted_cell(item) for item in refuted),
    )


def _band_of_sums(proof: Extraction, sums: _Sums, angles: Real) -> DirectedBand:
    """The sums of an entry over a cell. ValueError for those of other samples."""
    sides, points, c = sides_of(proof), sums["points"].astype(np.intp), sums["multipliers"]
    if not directed_fit(sides, points, c, angles.size):
        raise ValueError("its sums do not belong to the samples of the problem")
    return DirectedBand(sides, angles, points, c.astype(np.complex64))


def _cell(cell: PoleCell) -> _Cell:
    return {"ends": (cell.omega, cell.damping), "amplitudes": tuple(one.stored for one in cell.proofs)}


def _own_nominal(result: Bounded) -> StateMatrices | None:
    """The model where it isn't that of the identification."""
    return None if result.model is result.identification.model else StateMatrices.of(result.model)


def _nominal(matrices: StateMatrices | None, identification: Identification) -> control.StateSpace:
    if matrices is None:
        return identification.model
    return as_nominal(matrices.model(identification.problem.dt), identification)


def _parameters(arrays: Arrays, identification: Identification) -> ParameterIntervals:
    basis = identification.problem.parametric
    entries, size = identification.problem.entries, 0 if basis is None else basis.size
    count = (size,) if entries.single else (size, entries.outputs, entries.inputs)
    found = ParameterIntervals(arrays["lower"], arrays["upper"], arrays["attained"], unpack_certificates(arrays))
    if (found.lower.shape, found.upper.shape, found.attained.shape) != (count, count, (*count, 2)):
        raise ValueError("its intervals are not those of the parameters")
    return found


def _band(band: Band) -> Record:
    return {
        "problem": band.problem,
        "omega": band.omega,
        "box": band.box,
        "nominal": None if band.model is None else StateMatrices.of(band.model),
        "entries": _entries(band.bands, band.bands),
        "polygons": band.polygons,
        "directed": _entries(band.directed, band.bands),
    }


def _entries(bands: tuple[EntryBand | DirectedBand, ...], plain: tuple[EntryBand, ...]) -> tuple[Record, ...]:
    """Multipliers of bands, and whether polygons are among their samples, as they are not among those of the plain ones."""
    return tuple(
        {"angles": one.angles, "points": one.points.astype(np.int32), "multipliers": one.multipliers}
        | {"amplitudes": one.extraction.stored, "complete": one.complete}
        | {"nodes": one.samples.angles.size > lines.samples.angles.size}
        for one, lines in zip(bands, plain, strict=False)
    )


def _multipliers(entries: tuple[_Entry, ...]) -> list[Multipliers]:
    return [Multipliers(**one) for one in entries]


def _make_band(
    problem: MixedProblem,
    omega: Real,
    box: Ends | None,
    nominal: StateMatrices | None,
    entries: tuple[_Entry, ...],
    polygons: Bounded | None,
    directed: tuple[_Entry, ...] = (),
) -> Band:
    """The band of stored multipliers: radii are not stored, but follow from them anew; certificates of polygons are evaluated."""
    model = None if nominal is None else nominal.model(problem.dt)
    return band_of_multipliers(problem, box, omega, model, _multipliers(entries), polygons, _multipliers(directed))


def _contradiction(found: Contradiction) -> Record:
    proof = {name: getattr(found, name) for name in ("sample", "base", "points", "multipliers")}
    about = {"problem": found.problem, "box": found.box, "entry": found.samples.entry}
    return about | proof | {"amplitudes": found.extraction.stored}


def _make_contradiction(
    problem: MixedProblem,
    box: Ends | None,
    entry: tuple[int, int],
    sample: int,
    base: complex,
    points: NDArray[np.intp],
    multipliers: Complex,
    amplitudes: Arrays,
) -> Contradiction:
    """The contradiction of stored multipliers, which are evaluated anew."""
    proof = {"base": complex(base), "points": points, "multipliers": multipliers, "sample": sample}
    return contradiction_of_multipliers(problem, box, entry, proof, amplitudes)


def _family(family: Family) -> Record:
    """The errors are those around the nominal: with the circle, where it has been bounded."""
    return {
        "nominal": StateMatrices.of(family.model),
        "members": tuple(
            {"name": member.name, "condition": member.condition, "result": error}
            for member, error in zip(family.members, family.errors, strict=True)
        ),
        "tried": family.tried,
        "schedule": family.schedule,
        "interval": family.interval,
        "unfinished": family.unfinished,
    }


def _make_family(
    nominal: StateMatrices,
    members: tuple[_Plant, ...],
    tried: tuple[tuple[int, float], ...],
    schedule: str | None,
    interval: tuple[float, float] | None,
    unfinished: Unfinished | None = None,
) -> Family:
    found = [Member(item["result"], item["name"], **item["condition"]) for item in members]  # type: ignore[arg-type]
    if not found or any(not np.array_equal(m.result.omega, found[0].result.omega) for m in found):
        raise ValueError("its members are not bounded at the same frequencies")
    model = _nominal(nominal, found[0].identification)
    asked: Record = {"tried": tried, "schedule": schedule, "interval": interval, "unfinished": unfinished}
    family = Family(members=as_members(found), model=model, **asked)
    object.__setattr__(family, "errors", tuple(m.result for m in found))  # with the circle, where it has been bounded
    return family


keep(WorstCaseError, "worst-case error", evidence=_error, make=_make_error)
keep(
    WorstCaseOverPoles,
    "band over poles",
    words="error over a pole-uncertainty box",
    evidence=_over_poles,
    make=_make_over_poles,
)
keep(Band, "band", words="proved band", evidence=_band, make=_make_band)
keep(Family, "family", words="family of plants", evidence=_family, make=_make_family)
keep(Contradiction, "contradiction", evidence=_contradiction, make=_make_contradiction)
keep(Watch, "watch")

"""Judge of whole runs on faulty measurements: the verdict that the page begins with, and whether its band leaves the plant."""

import tempfile
from pathlib import Path
from typing import NamedTuple

import numpy as np

import robustid as rid
from robustid.report.identification_page import identification_page
from support.fault_catalogue import Faulty
from support.fault_plants import Clean

GREEN, AMBER, RED = "green", "amber", "red"
_LEVELS = {"consistent": GREEN, "weak": AMBER, "undecided": AMBER, "inconsistent": RED, "failed": RED}
_FREQUENCIES = 1000  # in the range of the data, and on the whole axis
_ROUNDING = 1e-9


class Ran(NamedTuple):
    """Outcome of a run.

    Attributes
    ----------
    level : str
        "green", "amber" or "red": of the first verdict of the page.
    verdict : str
        Its words.
    distance : float or None
        Largest distance of the clean response from the centre of the band, in radii, in the range of the data; None where
        there is no band, or no plant.
    beyond : float or None
        The same on the whole axis.
    hz : float
        Where the first of them is reached.
    """

    level: str
    verdict: str
    distance: float | None = None
    beyond: float | None = None
    hz: float = 0.0

    @property
    def left(self) -> bool:
        """True where the clean response leaves the band, at a frequency of the range of the data."""
        return self.distance is not None and self.distance > 1 + _ROUNDING

    @property
    def outcome(self) -> str:
        return f"{self.level} and left" if self.left else self.level


def ran(faulty: Faulty, clean: Clean, *, time_limit=60.0) -> Ran:
    """The default run of what a user has, and its judgement."""
    try:
        return judged_run(run_of(faulty, time_limit=time_limit), clean)
    except rid.RobustIdError as error:  # refused: a sentence in place of a model
        return Ran(RED, f"refused: {error}")


def run_of(faulty: Faulty, *, time_limit=60.0):
    """The default run of what a user has, from files."""
    with tempfile.TemporaryDirectory() as place:
        path = _run_file(faulty, Path(place), time_limit)
        return rid.run(path, path.parent / "result", static=True)


def judged_run(result, clean: Clean) -> Ran:
    """The verdict that the page of a run begins with, and where the clean plant lies in its band."""
    found = identification_page(result.identification, None, _parts(result)).verdict
    verdict = Ran(_LEVELS[found.key], f"{found.word}: {found.words}")
    if result.band is None or clean.plant is None:
        return verdict
    plane, (low, high) = result.identification.problem.plane, _range(result)
    inside = np.linspace(low, high, _FREQUENCIES)
    whole = np.linspace(*result.band.range, _FREQUENCIES + 1)[1:]
    at, beyond = (_distances(result.band, clean.plant, plane, omega) for omega in (inside, whole))
    hz = float(inside[np.argmax(at)] / (2 * np.pi))
    return verdict._replace(distance=float(at.max()), beyond=float(max(beyond.max(), at.max())), hz=hz)


def _run_file(faulty, place, time_limit):
    lines, records = [f"time_limit = {time_limit}"], [(record, "response") for record in faulty.records]
    if faulty.step is not None:
        records.append((faulty.step, "samples"))
    for k, (record, use) in enumerate(records):
        rid.save(place / f"record{k}.npz", record)
        lines += ["[[record]]", f'file = "record{k}.npz"', f'use = "{use}"']
    if faulty.response is not None:
        rid.save(place / "response.npz", faulty.response)
        lines += ["[[frequency]]", 'file = "response.npz"']
    if faulty.period is not None:
        lines += ["[estimate]", f"period = {faulty.period}"]
    path = place / "run.toml"
    path.write_text("\n".join(lines) + "\n")
    return path


def _parts(result):
    """What stands on the page, as `IdentifiedReduced.report` has it."""
    names = "reduction", "over_poles", "diagnosis", "withheld", "content", "worth", "band", "unfinished"
    return {name: getattr(result, name) for name in names} | {"worst_case": result.error}


def _range(result):
    omega = [frf.omega for frf in result.identification.problem.frequency]
    return min(part[0] for part in omega), max(part[-1] for part in omega)


def _distances(band, plant, plane, omega):
    """Distances of the plant from the centres of the band, in radii, the largest of the entries; 0 where nothing is bounded."""
    centre, radius = band.at(omega)
    return (np.abs(plane.values_at(plant, omega) - centre) / radius).reshape(len(omega), -1).max(axis=1)


def of_clean(clean: Clean):
    """What a user has of clean measurements, by name."""
    found = {"periodic": Faulty(clean.periodic, clean.period), "response": Faulty(response=clean.response)}
    if clean.random:
        found["random"] = Faulty(clean.random)
    if clean.step is not None:
        found["step"] = Faulty(response=clean.response, step=clean.step)
    return found

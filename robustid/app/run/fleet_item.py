"""One machine of a fleet: its run, in whatever process, and its row, which tells a later call that it is done."""

from __future__ import annotations

import hashlib
import json
import threading
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np

from robustid.app.run.pipeline import run
from robustid.app.run.results import FamilyRun, IdentifiedReduced
from robustid.app.run.run_file import read_run_file
from robustid.core import Record, atomic_write, norms, paths
from robustid.errors import InputError, RobustIdError, Status
from robustid.guarantees import Band, FleetRow, FleetState, Peak, largest_error

ROW = "row.json"
_ONE = threading.Lock()  # a process of a cluster may have several threads: pictures are drawn by one at a time
_STATES = {
    Status.CONSISTENT: FleetState.CONSISTENT,
    Status.INCONSISTENT: FleetState.INCONSISTENT,
    Status.UNDECIDED: FleetState.UNDECIDED,
    Status.FAILED: FleetState.FAILED,
}


class Item(NamedTuple):
    """Name of a machine, its run file, the folder of its results, and how it is run; paths as every process sees them."""

    name: str
    path: str
    folder: str
    force: bool
    static: bool


class Kept(NamedTuple):
    """Row of a machine and the digest of what it answers: "" where the next call is to try again."""

    row: FleetRow
    digest: str

    @classmethod
    def read(cls, folder: Path) -> Kept | None:
        """The row in a folder; None where there is none, or one that was edited."""
        try:
            content: Record = json.loads((folder / ROW).read_text(encoding="utf-8"))
            cells: Record = {name: np.nan if one is None else one for name, one in content["row"].items()}
            cells["state"] = FleetState(cells["state"])
            return cls(FleetRow(**cells), content["digest"])
        except (OSError, ValueError, KeyError, TypeError, AttributeError):
            return None

    def write(self, folder: Path) -> None:
        """Keep the row in a folder."""
        folder.mkdir(parents=True, exist_ok=True)
        row = {name: None if one != one else one for name, one in self.row._asdict().items()}
        with atomic_write(folder / ROW) as file:
            json.dump({"digest": self.digest, "row": row | {"state": self.row.state.value}}, file, indent=1)


def run_item(item: Item) -> tuple[str, float]:
    """State of a machine, and the seconds that its run took now: 0 where its row answers the same run file and data already."""
    path, folder = Path(item.path), Path(item.folder)
    if not folder.parent.is_dir():
        raise InputError(
            f"a worker does not see the folder {folder.parent}: a fleet needs one that this machine and all workers share;"
            " give it with --output"
        )
    with _ONE:
        kept, asked = Kept.read(folder), _Asked.of(path)
        again = item.force and kept is not None and kept.row.state is FleetState.FAILED
        if kept is not None and kept.digest == asked.digest and not again:
            return kept.row.state.value, 0.0
        began = time.perf_counter()
        if asked.missing:
            row = waiting(item.name, asked.missing)
            found = Kept(row, asked.digest)
        else:
            found = _carried_out(item, path, folder, asked.digest)
        seconds = time.perf_counter() - began
        found._replace(row=found.row._replace(seconds=seconds)).write(folder)
        return found.row.state.value, seconds


def _carried_out(item: Item, path: Path, folder: Path, digest: str) -> Kept:
    """The run, or why it failed: for good by a sentence of the library, else to be tried again by the next call."""
    try:
        return Kept(row_of(item.name, _run(item, path, folder)), digest)
    except RobustIdError as error:
        return Kept(failed(item.name, str(error)), digest)
    except Exception as error:  # one failure is one row
        return Kept(failed(item.name, f"{type(error).__name__}: {error}"), "")


def _run(item: Item, path: Path, folder: Path) -> IdentifiedReduced | FamilyRun:
    """The run, from where it was; with `force` anew where that was another question."""
    try:
        return run(path, folder, resume=True, static=item.static)
    except InputError:
        if not item.force:
            raise
    return run(path, folder, force=True, static=item.static)


class _Asked(NamedTuple):
    """Digest of a run file and of everything that it reads, and files that are not there."""

    digest: str
    missing: tuple[str, ...] = ()

    @classmethod
    def of(cls, path: Path) -> _Asked:
        found, missing = hashlib.sha256(), list[str]()
        try:
            found.update(path.read_bytes())
            names = read_run_file(path).files
        except (OSError, RobustIdError):  # its run has the sentence
            return cls(found.hexdigest())
        for name in names:
            place = path.parent / name
            there = [one for one in dict.fromkeys([place, *paths(place)]) if one.is_file()]
            found.update(f"{name} {len(there)}\n".encode())
            for one in there:
                with one.open("rb") as file:
                    found.update(hashlib.file_digest(file, "sha256").digest())
            missing += [] if there else [name]
        return cls(found.hexdigest(), tuple(missing))


def failed(name: str, sentence: str) -> FleetRow:
    """The row of a machine without a result."""
    return FleetRow(name, FleetState.FAILED, sentence)


def waiting(name: str, missing: tuple[str, ...]) -> FleetRow:
    """The row of a machine whose files are not there yet."""
    words = f"{', '.join(missing)} {'is' if len(missing) == 1 else 'are'} not there yet"
    return FleetRow(name, FleetState.WAITING, words, waits=words)


def row_of(name: str, result: IdentifiedReduced | FamilyRun) -> FleetRow:
    """The row of a machine from the result of its run."""
    if isinstance(result, FamilyRun):
        identified, status, error = list(result.identifications.values()), result.status, result.family
        waits = ""
    else:
        identified, status = [result.identification], result.identification.verified_status
        error = result.band if result.band is not None else result.error
        waits = result.content.summary() if result.content is not None and result.content.empty else ""
    row = FleetRow(
        name,
        FleetState.CONTRADICTED if result.contradicted else _STATES[status],
        result.findings[0] if result.findings else status.value,
        margin=float(max(one.margin for one in identified)),
        faults=sum(len(one.problem.open_faults) for one in identified),
        waits=waits,
        unfinished="" if result.unfinished is None else result.unfinished.sentence,
    )
    model, problem = result.model, identified[0].problem
    if model is None:
        return row
    row = row._replace(order=model.nstates)
    if error is not None and (known := np.isfinite(error.sigma_upper)).any():
        k = int(np.nanargmax(np.where(known, error.sigma_upper, -np.inf)))
        at_points = Peak(float(error.sigma_upper[k]), float(error.omega[k]))
        largest = largest_error(error) if isinstance(error, Band) else at_points
        row = row._replace(error=largest.value, error_hz=largest.omega / (2 * np.pi))
        row = row._replace(relative=float(error.relative.median))
    omega = error.omega if error is not None else np.concatenate([np.zeros(0), *(f.omega for f in problem.frequency)])
    if omega.size:
        sizes = norms(problem.plane.values_at(model, omega))
        k = int(np.argmax(sizes))
        row = row._replace(peak=float(sizes[k]), peak_hz=float(omega[k] / (2 * np.pi)))
    return row

"""The run file of a large matrix as run files of its entries or columns, each a run of its own."""

from __future__ import annotations

import dataclasses
import math
import statistics
from collections.abc import Sequence
from pathlib import Path

from robustid.app.run.fleet_item import Item, Kept
from robustid.app.run.reading import Tables, read_source
from robustid.app.run.run_file import RunFile, read_run_file
from robustid.core import Options, atomic_write
from robustid.errors import InputError, RobustIdError

FOLDER = "entries"
THINGS = {"entries": "entry", "columns": "column"}


def split_of(path: Path) -> str | None:
    """Tell how a run file asks to be split, "entries" or "columns"; None where it is one run."""
    try:
        return read_run_file(path).split if path.is_file() else None
    except RobustIdError:  # its run has the sentence
        return None


def split_files(path: Path, folder: Path) -> list[Path]:
    """Run files of the entries, output after output, or of the columns of a matrix, in a folder beside the results."""
    run = read_run_file(path)
    for name in ("entry", "column"):
        if getattr(run, name) is not None:
            raise InputError(f"{path.name}: {name} is one, split is all of them; give one of the two")
    place = folder / FOLDER
    place.mkdir(parents=True, exist_ok=True)
    found: list[Path] = []
    moved = run.moved(path.parent, place)
    for numbers, name, how in _parts(run, path):
        one = dataclasses.replace(moved, split=None, title=f"{run.title or path.stem}, {name}", **how)
        found.append(place / f"{path.stem}-{numbers}.toml")
        with atomic_write(found[-1]) as file:
            file.write(one.text())
    return found


def _parts(run: RunFile, path: Path) -> list[tuple[str, str, Options]]:
    """Numbers, name and key of every entry or column of the matrix that a run file is about."""
    (source, *_) = *run.frequency, *run.record
    read = read_source(source, path.parent, Tables(), bounded=False).raw[0]
    if run.split == "columns":
        return [(f"{j}", f"all / {input.name}", {"column": j}) for j, input in enumerate(read.inputs)]
    return [
        (f"{k}-{j}", f"{output.name} / {input.name}", {"entry": (k, j)})
        for k, output in enumerate(read.outputs)
        for j, input in enumerate(read.inputs)
    ]


def time_words(items: Sequence[Item], workers: int | None) -> str:
    """Sentence on the time that the items without a row will take; workers None: of a cluster.

    From the rows that there are; before any is, from the limit that each keeps.
    """
    rows = [kept.row for item in items if (kept := Kept.read(Path(item.folder))) is not None]
    seconds = [row.seconds for row in rows if row.seconds > 0]
    left = len(items) - len(rows)
    if not left:
        return ""
    where = (
        "divided by the number of workers"
        if workers is None
        else f"on {workers} {'process' if workers == 1 else 'processes'}"
    )
    rounds = math.ceil(left / (workers or 1))
    if not seconds:
        limit = read_run_file(Path(items[0].path)).time_limit
        return f"{left} runs, each with a time_limit of {limit:g} s: {_minutes(rounds * limit)} at most, {where}"
    each = statistics.median(seconds)
    one = "one took" if len(seconds) == 1 else f"{len(seconds)} took in the median"
    return f"{left} of {len(items)} are left, {one} {each:.3g} s: about {_minutes(rounds * each)}, {where}"


def _minutes(seconds: float) -> str:
    """Time in minutes, or in hours where these are many."""
    minutes = seconds / 60
    return f"{max(minutes, 0.1):.2g} min" if minutes < 100 else f"{minutes / 60:.2g} h"

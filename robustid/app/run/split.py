"""The run file of a large matrix as run files of its entries, each a run of its own."""

from __future__ import annotations

import dataclasses
import statistics
from collections.abc import Sequence
from pathlib import Path

from robustid.app.run.fleet_item import Item, Kept
from robustid.app.run.reading import Tables, read_source
from robustid.app.run.run_file import read_run_file
from robustid.core import atomic_write
from robustid.errors import InputError, RobustIdError

FOLDER = "entries"


def is_split(path: Path) -> bool:
    """Tell a run file that asks for a run of every entry."""
    try:
        return path.is_file() and read_run_file(path).split is not None
    except RobustIdError:  # its run has the sentence
        return False


def split_files(path: Path, folder: Path) -> list[Path]:
    """Run files of the entries of the matrix that a run file is about, in a folder beside the results, output after output."""
    run = read_run_file(path)
    if run.entry is not None:
        raise InputError(f"{path.name}: entry is one, split is all of them; give one of the two")
    tables = Tables()
    (source, *_) = *run.frequency, *run.record
    read = read_source(source, path.parent, tables, bounded=False).raw[0]
    place = folder / FOLDER
    place.mkdir(parents=True, exist_ok=True)
    found: list[Path] = []
    moved = run.moved(path.parent, place)
    for k, output in enumerate(read.outputs):
        for j, input in enumerate(read.inputs):
            title = f"{run.title or path.stem}, {output.name} / {input.name}"
            one = dataclasses.replace(moved, entry=(k, j), split=None, title=title)
            found.append(place / f"{path.stem}-{k}-{j}.toml")
            with atomic_write(found[-1]) as file:
                file.write(one.text())
    return found


def time_words(items: Sequence[Item], workers: int | None) -> str:
    """Sentence on the time that the items without a row will take, from the rows that there are; workers None: of a cluster."""
    rows = [kept.row for item in items if (kept := Kept.read(Path(item.folder))) is not None]
    seconds = [row.seconds for row in rows if row.seconds > 0]
    left = len(items) - len(rows)
    if not left or not seconds:
        return ""
    each = statistics.median(seconds)
    minutes = left * each / (workers or 1) / 60
    said = f"about {max(minutes, 0.1):.2g} min" if minutes < 100 else f"about {minutes / 60:.2g} h"
    where = "divided by the number of workers" if workers is None else f"on {workers} processes"
    one = "one took" if len(seconds) == 1 else f"{len(seconds)} took in the median"
    return f"{left} of {len(items)} are left, {one} {each:.3g} s: {said}, {where}"

"""A fleet: the runs of many machines, on processes or on a cluster, each kept as soon as it is there."""

from __future__ import annotations

import contextlib
import dataclasses
import importlib
import os
from collections import Counter
from collections.abc import Collection, Generator, Iterator, Sequence
from concurrent.futures import Executor
from pathlib import Path
from typing import Any

from robustid.app.run.fleet_item import Item, Kept, failed, run_item
from robustid.app.run.fleet_table import write_table
from robustid.app.run.split import split_files, split_of
from robustid.core import Interruptible, Progress, Workers
from robustid.errors import InputError, SolverError
from robustid.guarantees import Fleet, FleetRow, fleet_of
from robustid.report import write_report

PAGE, TABLE = "report.html", "table.csv"
_AT_ONCE = 1000  # runs that a cluster is given at a time
_CONNECT = 20.0  # seconds


class Rows(Collection[FleetRow]):
    """The rows of the machines that have one, read from disk whenever they are gone through."""

    def __init__(self, items: Sequence[Item]) -> None:
        self._items = items

    def __iter__(self) -> Iterator[FleetRow]:
        return (kept.row for item in self._items if (kept := Kept.read(Path(item.folder))) is not None)

    def __len__(self) -> int:
        return sum(1 for _ in self)

    def __contains__(self, row: object) -> bool:
        return any(one == row for one in self)


def items_of(paths: Sequence[Path], folder: Path, *, force: bool = False, static: bool = False) -> list[Item]:
    """The machines of run files, or of folders with run files, named by these: by their folders too where names repeat.

    Of a run file with `split` each entry or column is one.
    """
    files: list[Path] = []
    for path in paths:
        found = sorted(path.glob("*.toml")) if path.is_dir() else [path]
        if not found:
            raise InputError(f"{path} is a folder without run files; give NAME.toml, or a folder that holds some")
        for one in found:
            files += [part for part in (split_files(one, folder) if split_of(one) else [one]) if part not in files]
    if missing := [path for path in files if not path.is_file()]:
        raise InputError(f"{missing[0]}: there is no such file; check the name and the folder")
    names = [path.stem for path in files]
    if len(set(names)) < len(names):
        whole = [path.resolve() for path in files]
        common = os.path.commonpath([path.parent for path in whole])
        names = ["-".join(path.with_suffix("").relative_to(common).parts) for path in whole]
    repeated = [name for name, count in Counter(names).items() if count > 1]
    if repeated:
        raise InputError(f"two run files would both write to {folder / repeated[0]}; rename one of them")
    place = folder.resolve()
    return [
        Item(name, str(path.resolve()), str(place / name), force, static)
        for name, path in zip(names, files, strict=True)
    ]


def run_fleet(
    items: Sequence[Item],
    folder: Path,
    executor: Executor | int,
    table: Path,
    *,
    static: bool = False,
    progress: Progress | None = None,
    thing: str = "machine",
) -> Fleet:
    """Run every machine whose row does not answer its run file and data already; write the table and the page of all.

    A worker that dies takes its own run only, which is tried again, three times in all. Ctrl-C ends the runs: what is finished is
    kept, and stands in table and page. `thing`: the word for one of them, "machine", "entry" or "column".
    """
    folder.mkdir(parents=True, exist_ok=True)
    most = None if isinstance(executor, int) else _AT_ONCE
    done = 0
    with Interruptible(), Workers(executor, most) as workers:
        for _ in workers.run(run_item, (), items, _named, _lost):
            done += 1
            if progress is not None:
                progress(f"running every {thing}", done, len(items))
    rows = Rows(items)
    found = dataclasses.replace(fleet_of(rows, len(items)), thing=thing)
    if found.open:
        named = {row.name for row in rows}
        found = dataclasses.replace(found, left=tuple(one.name for one in items if one.name not in named))
    write_table(table, rows)
    write_report(found, folder / PAGE, static=static, progress=progress)
    return found


def _named(item: Item) -> str:
    return f"the run of {item.name}"


def _lost(item: Item, error: SolverError) -> tuple[str, float]:
    """The row of a machine whose worker died every time; the next call tries it again."""
    row = failed(item.name, str(error))
    Kept(row, "").write(Path(item.folder))
    return row.state.value, 0.0


@contextlib.contextmanager
def cluster(address: str) -> Generator[Executor]:
    """The executor of a cluster of Dask, by the address of its scheduler or the file that names it."""
    try:
        distributed: Any = importlib.import_module("distributed")
    except ImportError:
        raise InputError(
            "`cluster` needs Dask, which is not installed: pip install 'robustid[distributed]'", argument="cluster"
        ) from None
    where = {"scheduler_file": address} if address.endswith(".json") else {"address": address}
    try:
        client = distributed.Client(**where, timeout=_CONNECT, set_as_default=False)
    except (OSError, ValueError, TypeError) as error:
        raise InputError(
            f"`cluster`: no scheduler answers at {address} ({error}); start one with `dask scheduler`, workers with `dask worker"
            f" {address} --nthreads 1`",
            argument="cluster",
            got=address,
        ) from None
    with client:
        yield client.get_executor(pure=False)

"""Fleets of small machines for tests and benchmarks: run files with their data, and what their runs gave."""

from pathlib import Path

import robustid as rid
from support.run_files import CLASS, QUICK, ask


def machines(folder, count, **parts):
    """So many run files, each with data of its own; `parts` replace those of the run file."""
    folder.mkdir(exist_ok=True)
    files = []
    for k in range(count):
        name = f"m{k:03d}"
        frf = rid.datasets.flexible_structure(seed=k, lines=5, samples=4).frequency
        rid.save(folder / f"{name}.csv", frf)
        content = {"frequency": [{"file": f"{name}.csv"}], **CLASS, **QUICK} | parts
        files.append(ask(folder, content, name=f"{name}.toml"))
    return files


def numbers(folder):
    """The numbers of a run, bit by bit: of its identification and of its small model."""
    return [(Path(folder) / f"{name}.npz").read_bytes() for name in ("identification", "small_model")]


def written(folder):
    """When the row of every machine was written."""
    return {path.parent.name: path.stat().st_mtime_ns for path in Path(folder).glob("*/row.json")}

"""Shared by the tests: example runs."""

import importlib.util
from pathlib import Path

import numpy as np

FOLDER = Path(__file__).parents[2] / "examples"


def load(name):
    spec = importlib.util.spec_from_file_location(name, FOLDER / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def check_files(folder, pictures):
    for name in pictures:
        assert (folder / name).read_bytes().startswith(b"\x89PNG")
    assert sorted(p.name for p in folder.glob("*.png")) == sorted(pictures)


def mirror_table(printed):
    """Name of every row to the (3,) numbers at its end."""
    rows = [line.rsplit(maxsplit=3) for line in printed.splitlines() if line.startswith(("not linear", "test,"))]
    return {name: np.array([float(v) for v in values]) for name, *values in rows}

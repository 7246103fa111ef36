"""State-space models in files: .npz and MATLAB .mat with A, B, C, D and dt."""

from __future__ import annotations

import os
import pathlib
from typing import Any

import numpy as np

from robustid.core import as_array, as_float, atomic_write
from robustid.data.io.readers import read_table
from robustid.data.io.table import Table
from robustid.errors import FileFormatError, InputError, InputTypeError


def save_model(model: Any, path: str | os.PathLike[str]) -> None:
    """Write A, B, C, D and dt (0: continuous) of a `control.StateSpace` to `path`, .npz or .mat."""
    import scipy.io

    path = pathlib.Path(path)
    numbers = {name: np.asarray(getattr(model, name)) for name in "ABCD"} | {"dt": np.array(float(model.dt or 0))}
    if path.suffix not in (".npz", ".mat"):
        raise InputError(f"`path` must end in .npz or .mat; got {path.name}")
    with atomic_write(path, "wb") as file:
        if path.suffix == ".npz":
            np.savez_compressed(file, **numbers)  # type: ignore[arg-type]
        else:
            scipy.io.savemat(file, numbers)


def load_model(path: str | os.PathLike[str], *, dt: float | None = None) -> Any:
    """Read a `control.StateSpace` from a .npz or .mat file with A, B, C and, optionally, D and dt.

    Parameters
    ----------
    path : str or path
    dt : float, optional
        Sample time in s, 0 for continuous time; default that of the file, else 0.

    Raises
    ------
    FileFormatError
        The file is missing, foreign, or lacks a matrix; or its matrices aren't finite numbers of sizes that belong together.
    """
    path = pathlib.Path(path)
    if not path.is_file():
        raise FileFormatError(f"`path`: there is no file {path}")
    if path.suffix.lower() not in (".npz", ".mat"):
        raise FileFormatError(
            f"{path.name} must be a model in .npz or .mat, with matrices A, B, C and, optionally, D and dt"
        )
    return model_of(read_table(path), dt)


def is_model(table: Table) -> bool:
    """Return whether a file holds the matrices of a model, by its names."""
    numbers = _numbers(table)
    return all(isinstance(numbers.get(name), np.ndarray) and numbers[name].ndim == 2 for name in "ABC")


def model_of(table: Table, dt: float | None = None) -> Any:
    """The `control.StateSpace` whose matrices a file holds; see `load_model`."""
    import control

    path, numbers = table.path, _numbers(table)
    missing = [name for name in "ABC" if name not in numbers]
    if missing:
        names = ", ".join(sorted(numbers)) or "nothing"
        raise FileFormatError(f"{path.name} has no matrix {missing[0]}: a model needs A, B, C; it holds {names}")
    A, B, C = (_matrix(path, name, numbers[name]) for name in "ABC")
    D = _matrix(path, "D", numbers["D"]) if "D" in numbers else np.zeros((C.shape[0], B.shape[1]))
    for name, matrix, shape in (
        ("A", A, (A.shape[0], A.shape[0])),
        ("B", B, (A.shape[0], B.shape[1])),
        ("C", C, (C.shape[0], A.shape[0])),
        ("D", D, (C.shape[0], B.shape[1])),
    ):
        if matrix.shape != shape:
            raise FileFormatError(
                f"matrix {name} of {path.name} must be {shape[0]} x {shape[1]}; got {matrix.shape[0]} x {matrix.shape[1]}"
            )
    return control.ss(A, B, C, D, _step(path, numbers) if dt is None else dt)


def _numbers(table: Table) -> dict[str, Any]:
    """The named matrices of a file, those without entries too: a static gain has no states."""
    return {**table.columns, **table.empty}


def _matrix(path: pathlib.Path, name: str, value: Any) -> np.ndarray:
    try:
        return as_array(name, value, ndim=2)
    except (InputError, InputTypeError) as error:
        raise FileFormatError(f"{path.name} is no model: {error}") from None


def _step(path: pathlib.Path, numbers: dict[str, Any]) -> float:
    try:
        step = as_float("dt", numbers.get("dt", 0.0))
    except (InputError, InputTypeError) as error:
        raise FileFormatError(f"{path.name} is no model: {error}") from None
    if step < 0:
        raise FileFormatError(f"{path.name} is no model: `dt` must be >= 0; got {step:g}")
    return step

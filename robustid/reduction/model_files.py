"""State-space models in files: .npz and MATLAB .mat with A, B, C, D and dt."""

from __future__ import annotations

import os
import pathlib
from typing import Any

import numpy as np

from robustid._files import atomic_write
from robustid.errors import FileFormatError, InputError


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
        The file is missing, foreign, or lacks a matrix.
    """
    import control
    import scipy.io

    path = pathlib.Path(path)
    if not path.is_file():
        raise FileFormatError(f"`path`: there is no file {path}")
    try:
        if path.suffix == ".npz":
            with np.load(path, allow_pickle=False) as archive:
                numbers = {name: archive[name] for name in archive.files}
        else:
            numbers = scipy.io.loadmat(path)
        matrices = [_dense(numbers[name]) for name in "ABC"]
        D = _dense(numbers["D"]) if "D" in numbers else np.zeros((matrices[2].shape[0], matrices[1].shape[1]))
        step = float(np.ravel(numbers.get("dt", 0.0))[0]) if dt is None else dt
        return control.ss(*matrices, D, step)
    except KeyError as error:
        names = sorted(name for name in numbers if not name.startswith("__"))
        raise FileFormatError(f"`path`: {path} has no matrix {error}; it holds {names}") from None
    except Exception as error:  # readers of foreign files raise anything
        raise FileFormatError(f"`path`: {path} is not a model in .npz or .mat ({error})") from None


def _dense(matrix: Any) -> np.ndarray:
    return np.asarray(matrix.toarray() if hasattr(matrix, "toarray") else matrix, dtype=float)

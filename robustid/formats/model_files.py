"""Models in files, .npz and .mat: A, B, C, D; a, b, c, d, or z, p, k, or num, den in structures or beside each other."""

from __future__ import annotations

import os
import pathlib
from typing import Any

import numpy as np

from robustid.core import as_array, as_float, atomic_write
from robustid.errors import FileFormatError, InputError, InputTypeError
from robustid.formats.readers import read_table
from robustid.formats.structures import STRUCTURE_TIME
from robustid.formats.table import Table
from robustid.formats.transfer_functions import of_polynomials, of_roots
from robustid.formats.units import factor

_NAMES: tuple[Any, ...] = ("abcd", "zpk", ("num", "den"), ("Z", "P", "K"), ("Numerator", "Denominator"))
_DELAYS = ("InputDelay", "OutputDelay", "IODelay", "ioDelay", "inputd", "outputd", "iodelay")


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

    Or with the numbers of a MATLAB model of one input and one output, beside each other or in one structure: a, b, c, d; z, p, k;
    num, den; with dt or Ts.

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
        raise FileFormatError(f"there is no file {path}")
    if path.suffix.lower() not in (".npz", ".mat"):
        raise FileFormatError(
            f"{path.name} must be a model in .npz or .mat, with matrices A, B, C and, optionally, D and dt"
        )
    return model_of(read_table(path), dt)


def is_model(table: Table) -> bool:
    """Return whether a file holds a model, by its names: matrices, zeros, poles and gain, or polynomials."""
    numbers = _numbers(table)
    if all(isinstance(numbers.get(name), np.ndarray) and numbers[name].ndim == 2 for name in "ABC"):
        return True
    return len(_structures(numbers)) == 1


def model_of(table: Table, dt: float | None = None) -> Any:
    """The `control.StateSpace` that a file holds; see `load_model`."""
    path, numbers = table.path, _numbers(table)
    found = _structures(numbers)
    if "A" in numbers or not found:
        return _state_space(path, numbers, "ABCD", dt)
    if len(found) > 1:
        names = ", ".join(repr(prefix.rstrip(".") or "the top level") for prefix, _ in found)
        raise FileFormatError(f"{path.name} holds several models ({names}); store one a file")
    prefix, names = found[0]
    own = {name.removeprefix(prefix): value for name, value in numbers.items() if name.startswith(prefix)}
    texts = {name.removeprefix(prefix): text for name, text in table.texts.items()}
    if delays := [name for name in _DELAYS if name in own and np.any(own[name])]:
        raise FileFormatError(f"{path.name}: {prefix}{delays[0]} isn't zero; call absorbDelay in MATLAB before storing")
    if names == "abcd":
        descriptor = own.get("e", own.get("E"))
        if descriptor is not None and descriptor.size and np.any(descriptor != np.eye(len(descriptor))):
            raise FileFormatError(
                f"{path.name}: {prefix}e isn't the identity; call ss(sys, 'explicit') in MATLAB first"
            )
        return _state_space(path, own, names, dt, texts)
    step = _step(path, own, texts) if dt is None else dt
    try:
        first, second, *gain = (_vector(name, own[name]) for name in names)
        return of_roots(first, second, gain[0].item(), step) if gain else of_polynomials(first, second, step)
    except (InputError, InputTypeError) as error:
        raise FileFormatError(f"{path.name} is no model: {error}") from None


def _structures(numbers: dict[str, Any]) -> list[tuple[str, Any]]:
    """Prefix and names of every model in a structure, or of zeros, poles and gain or polynomials at the top level."""
    found: list[tuple[str, Any]] = []
    for name in numbers:
        for names in _NAMES:
            prefix = name.removesuffix(names[0])
            own: list[Any] = [numbers.get(prefix + part) for part in names if part != "d"]
            whole = prefix + names[0] == name and (not prefix or prefix[-1] == ".")
            if whole and all(isinstance(part, np.ndarray) for part in own) and _fits(names, own):
                found.append((prefix, names))
    return found


def _fits(names: Any, own: list[Any]) -> bool:
    """Return whether arrays have the shapes of such a model: square A; or a number for a gain, vectors for all else."""
    if names == "abcd":
        return own[0].ndim == 2 and own[0].shape[0] == own[0].shape[1]
    gain = own[2].size == 1 if len(own) == 3 else True
    return gain and all(part.size == max(part.shape, default=1) or not part.size for part in own)


def _vector(name: str, value: Any) -> Any:
    return as_array(name, np.asarray(value).reshape(-1), dtype=complex if np.iscomplexobj(value) else float)


def _state_space(path: pathlib.Path, numbers: dict[str, Any], names: str, dt: float | None, texts: Any = None) -> Any:
    """The model of the matrices A, B, C and, optionally, D."""
    import control

    missing = [name for name in names[:3] if name not in numbers]
    if missing:
        held = ", ".join(sorted(numbers)) or "nothing"
        raise FileFormatError(f"{path.name} has no matrix {missing[0]}: a model needs A, B, C; it holds {held}")
    A, B, C = (_matrix(path, name, numbers[name]) for name in names[:3])
    D = _matrix(path, names[3], numbers[names[3]]) if names[3] in numbers else np.zeros((C.shape[0], B.shape[1]))
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
    return control.ss(A, B, C, D, _step(path, numbers, texts or {}) if dt is None else dt)


def _numbers(table: Table) -> dict[str, Any]:
    """The named matrices of a file, those without entries too: a static gain has no states."""
    return {**table.columns, **table.empty}


def _matrix(path: pathlib.Path, name: str, value: Any) -> np.ndarray:
    try:
        return as_array(name, value, ndim=2)
    except (InputError, InputTypeError) as error:
        raise FileFormatError(f"{path.name} is no model: {error}") from None


def _step(path: pathlib.Path, numbers: dict[str, Any], texts: dict[str, list[str]]) -> float:
    """The sample time that stands beside a model; 0 in continuous time."""
    name = next((name for name in ("dt", "Ts") if name in numbers), None)
    word = "".join(texts.get("TimeUnit", [])) or "s"
    scale = factor(STRUCTURE_TIME, word)
    try:
        step = 0.0 if name is None else as_float(name, numbers[name])
    except (InputError, InputTypeError) as error:
        raise FileFormatError(f"{path.name} is no model: {error}") from None
    if step < 0:
        raise FileFormatError(f"{path.name} is no model: `dt` must be >= 0; got {step:g}; give `dt`")
    if scale != 1.0:
        raise FileFormatError(f"{path.name}: TimeUnit is {word!r}; call chgTimeUnit(sys, 'seconds') in MATLAB first")
    return step

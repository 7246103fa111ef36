"""Models in files, .npz and .mat: A, B, C, D; a, b, c, d, or z, p, k, or num, den in structures or beside each other."""

from __future__ import annotations

import dataclasses
import os
import pathlib
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from robustid.core import (
    Complex,
    Frozen,
    StateMatrices,
    as_array,
    as_float,
    as_signals,
    atomic_write,
    counted,
    exponents_of,
    hz_words,
    labels_of,
    numbered,
    time_words,
)
from robustid.errors import FileFormatError, InputError, InputTypeError
from robustid.formats.matlab_structures import STRUCTURE_TIME
from robustid.formats.readers import read_table
from robustid.formats.table import Table
from robustid.formats.units import factor

if TYPE_CHECKING:
    import control

_Numbers = dict[str, Any]  # arrays, or why a column has none
_NAMES: tuple[str | tuple[str, ...], ...] = (
    "abcd",
    "zpk",
    ("num", "den"),
    ("Z", "P", "K"),
    ("Numerator", "Denominator"),
)
_DELAYS = ("InputDelay", "OutputDelay", "IODelay", "ioDelay", "inputd", "outputd", "iodelay")
_MOST_STATES = 2000
_SEEN_STATES = 600  # of a model whose modes are taken
_PAIR = 1e-8  # relative distance of a root from the conjugate of its partner


@dataclasses.dataclass(frozen=True, eq=False)
class StoredModel(Frozen):
    """The numbers of a model in a file, before the package control is imported for it, which takes a second."""

    matrices: StateMatrices
    dt: float  # 0 in continuous time
    signals: dict[str, list[str]] = dataclasses.field(default_factory=dict[str, list[str]])  # labels of named sides

    def model(self) -> control.StateSpace:
        """The `control.StateSpace` of them."""
        return self.matrices.model(self.dt, **self.signals)

    def words(self) -> str:
        """Its size and its least damped modes."""
        A, _, _, D = self.matrices
        size = (
            f"a model of {counted(len(A), 'state')}, {counted(D.shape[0], 'output')} and"
            f" {counted(D.shape[1], 'input')}, {time_words(self.dt)}"
        )
        if len(self.signals) == 2:
            size += f", from {', '.join(self.signals['inputs'])} to {', '.join(self.signals['outputs'])}"
        if not 0 < len(A) <= _SEEN_STATES:
            return size
        poles = exponents_of(np.linalg.eigvals(A).astype(complex), self.dt or None)
        unstable, pairs = int(np.sum(poles.real > 0)), poles[(poles.imag > 0) & np.isfinite(poles)]
        lightest = sorted(pairs, key=lambda s: -s.real / abs(s))[:3]
        size += f", {unstable} of them unstable" if unstable else ""
        modes = [f"{hz_words(abs(s) / (2 * np.pi))} (damping {-s.real / abs(s):.3g})" for s in lightest]
        return size + (f"; least damped of {pairs.size} modes: {', '.join(modes)}" if modes else "")


def save_model(model: control.StateSpace, path: str | os.PathLike[str]) -> None:
    """Write A, B, C, D, dt (0: continuous) and named signals of a `control.StateSpace` to `path`, .npz or .mat."""
    import scipy.io

    path = pathlib.Path(path)
    numbers = {name: np.asarray(getattr(model, name)) for name in "ABCD"} | {"dt": np.array(float(model.dt or 0))}
    if path.suffix not in (".npz", ".mat"):
        raise InputError(f"`path` must end in .npz or .mat; got {path.name}")
    sides = (("inputs", model.input_labels, "u"), ("outputs", model.output_labels, "y"))
    names = {side: labels for side, labels, letter in sides if not numbered(labels, letter)}
    with atomic_write(path, "wb") as file:
        if path.suffix == ".npz":
            np.savez_compressed(file, **numbers, **{side: np.array(one) for side, one in names.items()})  # type: ignore[arg-type]
        else:
            scipy.io.savemat(file, {**numbers, **{side: np.array(one, dtype=object) for side, one in names.items()}})


def load_model(path: str | os.PathLike[str], *, dt: float | None = None) -> control.StateSpace:
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
    if path.is_dir():
        raise FileFormatError(f"{path} is a folder without a saved result; a model is a .npz or .mat file")
    if not path.is_file():
        raise FileFormatError(f"there is no file {path}")
    if path.suffix.lower() not in (".npz", ".mat"):
        raise FileFormatError(
            f"{path.name} must be a model in .npz or .mat, with matrices A, B, C and, optionally, D and dt"
        )
    return model_of(read_table(path), dt).model()


def is_model(table: Table) -> bool:
    """Return whether a file holds models, by its names: matrices, zeros, poles and gain, or polynomials."""
    numbers = _numbers(table)
    if all(isinstance(numbers.get(name), np.ndarray) and numbers[name].ndim == 2 for name in "ABC"):
        return True
    return len(_structures(numbers)) > 0


def model_of(table: Table, dt: float | None = None) -> StoredModel:
    """The model that a file holds; see `load_model`."""
    path, numbers = table.path, _numbers(table)
    found = _structures(numbers)
    if "A" in numbers or not found:
        return _state_space(path, numbers, "ABCD", dt, table.texts)
    if len(found) > 1:
        names = ", ".join(repr(prefix.rstrip(".") or "the top level") for prefix, _ in found)
        raise FileFormatError(
            f"{path.name} holds several models ({names}); store one a file, or name measurements beside them by `fields`"
        )
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
        return _state_space(path, own, "abcd", dt, texts)
    step = _step(path, own, texts) if dt is None else dt
    try:
        vectors = {name: own[name].reshape(-1) for name in names}
        first, second, *gain = (
            as_array(name, vector, dtype=complex if np.iscomplexobj(vector) else float)
            for name, vector in vectors.items()
        )
        found = of_roots(first, second, gain[0].item()) if gain else of_polynomials(first, second)
    except (InputError, InputTypeError) as error:
        raise FileFormatError(f"{path.name} is no model: {error}") from None
    return StoredModel(found, step, _labels(texts, found))


def _structures(numbers: _Numbers) -> list[tuple[str, str | tuple[str, ...]]]:
    """Prefix and names of every model in a structure, or of zeros, poles and gain or polynomials at the top level."""
    found: list[tuple[str, str | tuple[str, ...]]] = []
    for name in numbers:
        for names in _NAMES:
            prefix = name.removesuffix(names[0])
            parts = [numbers.get(prefix + part) for part in names if part != "d"]
            own: list[np.ndarray] = [part for part in parts if isinstance(part, np.ndarray)]
            whole = prefix + names[0] == name and (not prefix or prefix[-1] == ".")
            if whole and len(own) == len(parts) and _fits(names, own):
                found.append((prefix, names))
    return found


def _fits(names: str | tuple[str, ...], own: list[np.ndarray]) -> bool:
    """Return whether arrays have the shapes of such a model: square A; or a number for a gain, vectors for all else."""
    if names == "abcd":
        return own[0].ndim == 2 and own[0].shape[0] == own[0].shape[1]
    gain = own[2].size == 1 if len(own) == 3 else True
    return gain and all(part.size == max(part.shape, default=1) or not part.size for part in own)


def _state_space(
    path: pathlib.Path, numbers: _Numbers, names: str, dt: float | None, texts: dict[str, list[str]]
) -> StoredModel:
    """The model of the matrices A, B, C and, optionally, D."""
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
    step = _step(path, numbers, texts) if dt is None else dt
    return StoredModel(found := StateMatrices(A, B, C, D), step, _labels(texts, found))


def _labels(texts: dict[str, list[str]], matrices: StateMatrices) -> dict[str, list[str]]:
    """Labels of the sides whose signals all have names: by `save_model`, or by MATLAB, which keeps the units apart."""
    found: dict[str, list[str]] = {}
    ny, nu = matrices.D.shape
    for side, word, letter, count in (("inputs", "Input", "u", nu), ("outputs", "Output", "y", ny)):
        names, units = (texts.get(f"{word}{part}", []) for part in ("Name", "Unit"))
        units = units if len(units) == len(names) else [""] * len(names)
        signals: Sequence[Any] = texts.get(side) or list(zip(names, units, strict=True))
        if len(signals) == count and all(signals) and all(name for name, *_ in signals):
            found[side] = labels_of(as_signals(side, signals, count, letter), letter)
    return found


def _numbers(table: Table) -> _Numbers:
    """The named matrices of a file, those without entries too: a static gain has no states."""
    return {**table.columns, **table.empty}


def _matrix(path: pathlib.Path, name: str, value: object) -> np.ndarray:
    try:
        return as_array(name, value, ndim=2)
    except (InputError, InputTypeError) as error:
        raise FileFormatError(f"{path.name} is no model: {error}") from None


def _step(path: pathlib.Path, numbers: _Numbers, texts: dict[str, list[str]]) -> float:
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


# --- transfer functions -----------------------------------------------------------------------------------------------------------


def of_polynomials(numerator: np.ndarray, denominator: np.ndarray) -> StateMatrices:
    """The matrices of b(s)/a(s), highest power first, in companion form.

    Written out here: scipy takes leading coefficients below 1e-14 for zero, whatever the units.
    """
    b, a = (np.trim_zeros(np.asarray(part, dtype=float).reshape(-1), "f") for part in (numerator, denominator))
    if not a.size:
        raise InputError("the denominator is zero")
    if b.size > a.size:
        raise InputError(f"the numerator has the degree {b.size - 1}, the denominator {a.size - 1}; a model is proper")
    order = _checked_order(a.size - 1)
    b, a = np.concatenate([np.zeros(a.size - b.size), b]) / a[0], a / a[0]
    A = np.eye(order, k=-1)
    A[:1] = -a[1:]
    return StateMatrices(A, np.eye(order, 1), (b[1:] - b[0] * a[1:])[None], b[:1, None])


def of_roots(zeros: np.ndarray, poles: np.ndarray, gain: float) -> StateMatrices:
    """The matrices of ``gain * prod(s - zeros) / prod(s - poles)``: a cascade of sections of order 2 at most.

    A cascade, since the coefficients of the whole polynomial lose lightly damped modes at high orders. Every section takes the
    zeros nearest to its poles.
    """
    zeros, poles = (np.asarray(part, dtype=complex).reshape(-1) for part in (zeros, poles))
    if zeros.size > poles.size:
        raise InputError(
            f"there are {counted(zeros.size, 'zero')} and {counted(poles.size, 'pole')}; a model is proper"
        )
    n = _checked_order(poles.size)
    A, B, seen, through = np.zeros((n, n)), np.zeros((n, 1)), np.zeros((1, n)), float(gain)
    left, at = _sections("zeros", zeros), 0
    for section in sorted(_sections("poles", poles), key=len):
        fitting = [k for k, part in enumerate(left) if len(part) <= len(section)]
        # A section of one pole takes a single zero if there is one; all others the nearest.
        near = min(fitting, key=lambda k: float(np.abs(left[k][0] - section[0])), default=None)
        part = left.pop(near) if near is not None else np.array([], dtype=complex)
        one = of_polynomials(np.poly(part).real, np.poly(section).real)
        own = slice(at, at + len(section))
        A[own, own], A[own, :at], B[own] = one.A, one.B @ seen[:, :at], one.B * through
        seen, through, at = seen * one.D.item(), through * one.D.item(), own.stop
        seen[:, own] = one.C
    return StateMatrices(A, B, seen, np.array([[through]]))


def _checked_order(order: int) -> int:
    if order > _MOST_STATES:
        raise InputError(f"a model of order {order} is too large; at most {_MOST_STATES}")
    return order


def _sections(what: str, roots: Complex) -> list[Complex]:
    """Conjugate pairs and pairs of real roots; one real root alone where their number is odd."""
    scale = np.maximum(np.abs(roots), np.finfo(float).tiny)
    real = np.sort(roots[np.abs(roots.imag) <= _PAIR * scale].real)
    upper, lower = (roots[sign * roots.imag > _PAIR * scale] for sign in (1, -1))
    pairs: list[Complex] = []
    for root in upper:
        partner = int(np.argmin(np.abs(lower - root.conj()))) if lower.size else -1
        if partner < 0 or abs(lower[partner] - root.conj()) > _PAIR * abs(root):
            raise InputError(f"the {what} of a real model come in conjugate pairs; {root:.6g} is alone")
        lower = np.delete(lower, partner)
        pairs.append(np.array([root, root.conj()]))
    if lower.size:
        raise InputError(f"the {what} of a real model come in conjugate pairs; {lower[0]:.6g} is alone")
    return pairs + [real[k : k + 2].astype(complex) for k in range(0, real.size, 2)]

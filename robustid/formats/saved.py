"""Format of the files that `save` writes and `load` gives back exactly."""

from __future__ import annotations

import csv
import dataclasses
import itertools
import json
import math
import os
from collections.abc import Iterator
from typing import Any

import numpy as np

from robustid.core import atomic_write
from robustid.data import Bound, FrequencyResponse, TangentialResponse, TimeRecord
from robustid.errors import FileFormatError, InputError
from robustid.formats.lookup import Lookup
from robustid.formats.readers import FORMAT
from robustid.formats.table import Table

_ARRAYS = {
    "frequency": ("omega", "values", "bound", "tilt", "noise", "distortion", "coherence", "covariance", "ellipsoid"),
    "tangential": ("omega", "values", "right", "left", "bound"),
    "time": ("u", "y", "bound", "reference"),
}
_OF_BOUND = {
    "bound_kind": "kind",
    "probability": "probability",
    "bound_dof": "dof",
    "excitations": "excitations",
    "caveats": "caveats",
}
_FACTS = {
    "frequency": ("dt", "note", *_OF_BOUND, "dof", "joint", "problems"),
    "tangential": ("dt", "note", *_OF_BOUND),
    "time": ("dt", "initial", "past_input_bound", "note", *_OF_BOUND),
}
_KINDS = {
    "noise_floor": "rest",
    "confidence": "statistical",
}  # names in files, which stay for as long as old ones are to load
_OLD_KINDS = {old: kind for kind, old in _KINDS.items()}
CLASSES = {"frequency": FrequencyResponse, "tangential": TangentialResponse, "time": TimeRecord}
_FACTORS = ("covariance_inputs", "covariance_outputs")
_COMPLEX = ("values", "tilt", "covariance", "ellipsoid", "right", "left", *_FACTORS)
_LARGE, _ROUNDING = 16, 1e-13  # entries from which on a covariance is stored by its factors, and their error
_ROWS = 20_000


def flat_fields(data: FrequencyResponse | TangentialResponse | TimeRecord) -> dict[str, Any]:
    """Parts of a response or record, by the names that files keep: the parts of its bound beside everything else."""
    bound = Bound(np.inf) if data.bound is None else data.bound
    fields: dict[str, Any] = {}
    for field in dataclasses.fields(data):
        fields[field.name] = getattr(data, field.name)
        if field.name == "bound" and isinstance(data, FrequencyResponse):
            fields["tilt"] = bound.tilt
    fields |= {"bound": None if data.bound is None else bound.radius, "bound_kind": _KINDS.get(bound.kind, bound.kind)}
    if bound.probability is not None or not isinstance(data, TimeRecord):
        fields["probability"] = bound.probability
    if bound.dof != _implied_dof(fields):
        fields["bound_dof"] = bound.dof
    if not fields.get("problems"):
        fields.pop("problems", None)
    if bound.excitations is not None:
        fields["excitations"] = bound.excitations
    if bound.caveats:
        fields["caveats"] = list(bound.caveats)
    return fields | ({"joint": bound.joint, "ellipsoid": bound.ellipsoid} if "tilt" in fields else {})


def _implied_dof(fields: dict[str, Any]) -> float | None:
    """Degrees of freedom of a bound where nothing is said: with a probability, those of the covariance."""
    return None if fields.get("probability") is None else fields.get("dof")


def from_fields(cls: type, fields: dict[str, Any]) -> Any:
    """The response or record that consists of this; of files of older versions too, which know fewer names."""
    fields = {"bound_dof": _implied_dof(fields)} | fields
    fields = {name: value for name, value in fields.items() if value is not None}
    parts = {part: fields.pop(name) for name, part in _OF_BOUND.items() if name in fields}
    parts |= {name: fields.pop(name) for name in ("tilt", "joint", "ellipsoid") if name in fields}
    kind = parts.get("kind", "hard")
    parts["kind"] = _OLD_KINDS.get(kind, kind)
    if parts["kind"] == "hard":  # older versions let one state a probability here too
        parts.pop("probability", None)
        parts.pop("dof", None)
    if "bound" in fields or "ellipsoid" in parts:
        fields["bound"] = Bound(fields.get("bound"), **parts)
    return cls(**fields)


def _described(data: Any, kind: str, layout: str) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """The arrays, and everything else."""
    fields = flat_fields(data)
    arrays = {name: fields[name] for name in _ARRAYS[kind] if fields[name] is not None}
    if (
        kind == "frequency"
        and "covariance" in arrays
        and (factors := _factors(arrays["covariance"], data.values.shape))
    ):
        arrays |= dict(zip(_FACTORS, factors, strict=True))
        del arrays["covariance"]
    meta = {name: fields[name] for name in (*_FACTS[kind], "inputs", "outputs") if name in fields}
    meta["shapes"] = {name: array.shape[1:] for name, array in arrays.items()}
    samples = len(next(iter(arrays.values())))
    return arrays, meta | {"robustid": FORMAT, "kind": kind, "samples": samples, "layout": layout}


def _factors(covariance: np.ndarray, shape: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray] | None:
    """R (F, nu, nu) and C (F, ny, ny) of a large covariance that is their Kronecker product to rounding; None of any other.

    That of periodic experiments is one: noise of the outputs, through the inverse of the inputs. 28 x 2 entries need a fourth.
    """
    points, ny, nu = shape
    if ny * nu < _LARGE or min(ny, nu) == 1:
        return None
    apart = covariance.reshape(points, nu, ny, nu, ny).transpose(0, 1, 3, 2, 4)
    traces = np.einsum("fabii->fab", apart)
    whole = np.einsum("faa->f", traces).real[:, None, None]
    R, C = traces, np.einsum("faaij->fij", apart) / np.where(whole > 0, whole, 1)
    again = _product(R, C)
    scale = np.abs(covariance).max(axis=(1, 2), keepdims=True)
    return (R, C) if np.all(np.abs(again - covariance) <= _ROUNDING * scale) else None


def _product(R: np.ndarray, C: np.ndarray) -> np.ndarray:
    """The Kronecker product of every frequency point."""
    size = R.shape[1] * C.shape[1]
    return np.einsum("fab,fij->faibj", R, C).reshape(len(R), size, size)


def _write_npz(path: str | os.PathLike[str], data: Any, kind: str) -> None:
    arrays, meta = _described(data, kind, ".npz")
    with atomic_write(path, "wb") as file:
        np.savez(file, allow_pickle=False, **arrays, robustid=np.array(json.dumps(meta)))


def _write_csv(path: str | os.PathLike[str], data: Any, kind: str) -> None:
    arrays, meta = _described(data, kind, ".csv")
    columns = {"time": data.time} if isinstance(data, TimeRecord) else {}
    for name, array in arrays.items():
        flat = array.reshape(meta["samples"], -1)
        for part in ("real", "imag") if np.iscomplexobj(array) else ("real",):
            names = _column_names(name, array.shape[1:], part if np.iscomplexobj(array) else "")
            columns |= dict(zip(names, getattr(flat, part).T, strict=True))
    table = np.column_stack(list(columns.values()))
    with atomic_write(path, "w") as file:
        file.write(f"# robustid {json.dumps(meta)}\n")
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        for start in range(0, len(table), _ROWS):
            writer.writerows(table[start : start + _ROWS].tolist())


def _write_mat(path: str | os.PathLike[str], data: Any, kind: str) -> None:
    import scipy.io

    arrays, meta = _described(data, kind, ".mat")
    plain: dict[str, Any] = {"dt": data.dt or 0.0, "robustid": json.dumps(meta)}
    for side in ("inputs", "outputs"):
        plain[side] = np.array([str(channel) for channel in getattr(data, side)], dtype=object)
    with atomic_write(path, "wb") as file:
        scipy.io.savemat(file, {**arrays, **plain}, oned_as="column")


WRITERS = {".npz": _write_npz, ".csv": _write_csv, ".mat": _write_mat}


def _column_names(name: str, shape: tuple[int, ...], part: str) -> Iterator[str]:
    """Names of the columns of one array, such as real, u2, real_1_2 or covariance_imag_1_1."""
    base = {"values": part}.get(name, f"{name}_{part}" if part else name)
    for index in itertools.product(*(range(1, n + 1) for n in shape)):
        alone = all(n == 1 for n in shape)
        yield base + ("" if alone else str(index[0]) if len(shape) == 1 else "".join(f"_{i}" for i in index))


def unpack(table: Table, kind: str | None, options: dict[str, Any]) -> Any:
    """Object that `save` wrote, with the arguments given to `load` in place of what is stored."""
    meta: dict[str, Any] = table.meta
    if kind not in (None, meta["kind"]):
        raise InputError(f"`kind` = {kind!r}, but the file holds {meta['kind']} data; leave `kind` out")
    arrays = {name: _array(table, meta, name, tuple(shape)) for name, shape in meta["shapes"].items()}
    if _FACTORS[0] in arrays:
        arrays["covariance"] = _product(*(arrays.pop(name) for name in _FACTORS))
    facts = {name: meta[name] for name in _FACTS[meta["kind"]] if name in meta}  # older files know fewer
    names = {side: [tuple(channel) for channel in meta[side]] for side in ("inputs", "outputs")}
    if meta["kind"] != "time":
        options.pop("initial", None)
    data = from_fields(CLASSES[meta["kind"]], {**arrays, **facts, **names})
    if len(arrays["u" if meta["kind"] == "time" else "omega"]) != meta["samples"]:
        raise FileFormatError(f"the file was written with {meta['samples']} samples and has fewer or more now")
    bound = options.pop("bound", None)
    data = data if bound is None else data.with_bound(bound)
    return dataclasses.replace(data, **options) if options else data


def _array(table: Table, meta: dict[str, Any], name: str, shape: tuple[int, ...]) -> np.ndarray:
    column: Any = table.columns.get(name)
    if meta["layout"] == ".npz":
        return column
    if meta["layout"] == ".mat":
        return column.reshape(-1, *shape)
    if math.prod(shape) > len(table.columns):
        raise FileFormatError(f"{name!r} of shape {shape} has more columns than the file; save again, or give `fields`")
    if name not in _COMPLEX:
        return _stack(table, _column_names(name, shape, "")).reshape(-1, *shape)
    real, imag = (_stack(table, _column_names(name, shape, part)) for part in ("real", "imag"))
    if np.iscomplexobj(real) or np.iscomplexobj(imag):
        raise FileFormatError(
            f"the columns of real and imaginary part of {name!r} hold complex numbers; is the file damaged?"
        )
    array: Any = np.empty(real.shape, complex)
    # Not real + 1j*imag, which loses the sign of zeros.
    array.real, array.imag = real, imag
    return array.reshape(-1, *shape)


def _stack(table: Table, names: Iterator[str]) -> np.ndarray:
    lookup = Lookup(table, {})
    return np.column_stack([lookup.column(name, name) for name in names])

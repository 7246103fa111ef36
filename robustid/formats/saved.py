"""Format of the files that `save` writes and `load` gives back exactly."""

from __future__ import annotations

import csv
import dataclasses
import itertools
import json
import math
import os
from collections.abc import Iterator
from typing import cast

import numpy as np

from robustid.core import Arrays, Complex, Options, Record, atomic_write, described, made
from robustid.data import FrequencyResponse, TangentialResponse, TimeRecord
from robustid.errors import FileFormatError, InputError
from robustid.formats.readers import FORMAT
from robustid.formats.role_lookup import Lookup
from robustid.formats.table import Table

Measured = FrequencyResponse | TangentialResponse | TimeRecord
CLASSES: dict[str, type[Measured]] = {
    "frequency": FrequencyResponse,
    "tangential": TangentialResponse,
    "time": TimeRecord,
}
_FACTORS = ("covariance_inputs", "covariance_outputs")
_COMPLEX = ("values", "doubt", "tilt", "covariance", "ellipsoid", "right", "left", *_FACTORS)
_LARGE, _ROUNDING = 16, 1e-13  # entries from which on a covariance is stored by its factors, and their error
_ROWS = 20_000


def _described(data: Measured, kind: str, layout: str) -> tuple[Arrays, Record]:
    """The arrays by their names in files, and everything else."""
    by_path: Arrays = {}
    text = described(data, "", by_path)
    arrays = {_name(path): array for path, array in by_path.items()}
    if isinstance(data, FrequencyResponse) and (factors := _factors(data.covariance, data.values.shape)) is not None:
        del arrays["covariance"]
        arrays |= dict(zip(_FACTORS, factors, strict=True))
    shapes = {name: array.shape[1:] for name, array in arrays.items()}
    samples = len(next(iter(arrays.values())))
    meta = {"robustid": FORMAT, "kind": kind, "layout": layout, "samples": samples, "shapes": shapes}
    return arrays, meta | {"paths": {path: _name(path) for path in by_path}, "data": text}


def _name(path: str) -> str:
    """Name in a file: that of the field, and `bound` of its radius."""
    field = path.rpartition("/")[2]
    return "bound" if field == "radius" else field


def _factors(covariance: np.ndarray | None, shape: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray] | None:
    """R (F, nu, nu) and C (F, ny, ny) of a large covariance that is their Kronecker product to rounding; None of any other.

    That of periodic experiments is one: noise of the outputs, through the inverse of the inputs. 28 x 2 entries need a fourth.
    """
    points, ny, nu = shape
    if covariance is None or ny * nu < _LARGE or min(ny, nu) == 1:
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


def _write_npz(path: str | os.PathLike[str], data: Measured, kind: str) -> None:
    arrays, meta = _described(data, kind, ".npz")
    with atomic_write(path, "wb") as file:
        np.savez(file, allow_pickle=False, **arrays, robustid=np.array(json.dumps(meta)))


def _write_csv(path: str | os.PathLike[str], data: Measured, kind: str) -> None:
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


def _write_mat(path: str | os.PathLike[str], data: Measured, kind: str) -> None:
    import scipy.io

    arrays, meta = _described(data, kind, ".mat")
    plain: dict[str, object] = {"dt": data.dt or 0.0, "robustid": json.dumps(meta)}
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


def unpack(table: Table, kind: str | None, options: Options) -> Measured:
    """Object that `save` wrote, with the arguments given to `load` in place of what is stored."""
    meta: Record = table.meta
    if kind not in (None, meta["kind"]):
        raise InputError(f"`kind` = {kind!r}, but the file holds {meta['kind']} data; leave `kind` out")
    arrays = {name: _array(table, meta, name, tuple(shape)) for name, shape in meta["shapes"].items()}
    if _FACTORS[0] in arrays:
        arrays["covariance"] = _product(*(arrays.pop(name) for name in _FACTORS))
    data = made(meta["data"], {path: arrays[name] for path, name in meta["paths"].items()})
    if not isinstance(data, CLASSES[meta["kind"]]):
        raise FileFormatError(f"the file holds no {meta['kind']} data, as its description says")
    if len(data.u if isinstance(data, TimeRecord) else data.omega) != meta["samples"]:
        raise FileFormatError(f"the file was written with {meta['samples']} samples and has fewer or more now")
    if not isinstance(data, TimeRecord):
        options.pop("initial", None)
    bound = options.pop("bound", None)
    data = data if bound is None else data.with_bound(bound)
    return dataclasses.replace(data, **options) if options else data


def _array(table: Table, meta: Record, name: str, shape: tuple[int, ...]) -> np.ndarray:
    column = cast("np.ndarray", table.columns.get(name))
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
    array: Complex = np.empty(real.shape, complex)
    # Not real + 1j*imag, which loses the sign of zeros.
    array.real, array.imag = real, imag
    return array.reshape(-1, *shape)


def _stack(table: Table, names: Iterator[str]) -> np.ndarray:
    lookup = Lookup(table, {})
    return np.column_stack([lookup.column(name, name) for name in names])

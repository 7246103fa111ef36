"""Measurements from and to files: .csv, .tsv, .txt, .npz (never pickle), .mat (v5 and v7.3)."""

from __future__ import annotations

import contextlib
import csv
import dataclasses
import itertools
import json
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from robustid._files import atomic_write
from robustid.data._readers import FORMAT, Table, read_table
from robustid.data._roles import NAMES, Lookup, as_frequency, as_time, time_step
from robustid.data.frequency_response import FrequencyResponse
from robustid.data.time_record import TimeRecord
from robustid.errors import FileFormatError, InputError, InputTypeError

_ARRAYS = {
    "frequency": ("omega", "values", "bound", "tilt", "covariance", "coherence", "noise", "distortion"),
    "time": ("u", "y", "bound", "reference"),
}
_FACTS = {
    "frequency": ("dt", "note", "bound_kind", "probability", "dof"),
    "time": ("dt", "initial", "past_input_bound", "note", "bound_kind"),
}
_CLASSES = {"frequency": FrequencyResponse, "time": TimeRecord}


def load(
    path: str | os.PathLike,
    *,
    kind: str | None = None,
    fields: Mapping[str, Any] | None = None,
    dt: float | None = None,
    bound: Any = None,
    frequency_unit: str = "rad/s",
    inputs: Any = None,
    outputs: Any = None,
    initial: str | None = None,
) -> FrequencyResponse | TimeRecord:
    r"""Read a measured frequency response or time record from a file.

    Parameters
    ----------
    path : str or path
        ``.csv``, ``.tsv``, ``.txt`` (first line: column names; lines that start with ``#`` are skipped),
        ``.npz`` (pickled objects are refused) or ``.mat`` (v5 or v7.3, recognised by content).
    kind : {"frequency", "time"}, optional
        What the file holds; default: by the roles in `fields`, else by the names in the file.
    fields : mapping, optional
        Role to name in the file. Frequency: ``omega`` or ``freq_hz``; ``values`` (complex), or ``real`` and
        ``imag``, or ``magnitude``/``magnitude_db`` and ``phase_deg``/``phase_rad``; ``bound``. Time:
        ``time``, ``u``, ``y``, ``reference``, ``bound``. Both: ``dt``. Fields of MATLAB structures have dots
        (``"data.u"``). Several channels: a list of names for a time signal; for a frequency role a list of
        rows (one an output) of names (one an input). Roles left out are looked for under usual names, upper
        or lower case.
    dt : float, optional
        Sample time in s. Without it, a time record takes it from its ``time`` column, which must be uniform
        to 1e-6 of a step, and ``.npz`` and ``.mat`` files may hold it as a number named ``dt``, ``Ts`` or ``T``;
        with it, neither is read.
    bound : scalar or array, optional
        Bound on the errors; goes before a ``bound`` in the file.
    frequency_unit : {"rad/s", "Hz"}
        Unit of the ``omega`` column. A ``freq_hz`` column is always in Hz.
    inputs, outputs : sequence of str or (name, unit), optional
        Channel names and units; default for time signals: the column names.
    initial : {"rest", "free", "periodic"}, optional
        State before a time record (see `TimeRecord`); default "rest", or what `save` stored.

    Returns
    -------
    FrequencyResponse or TimeRecord
        Row and column vectors of MATLAB become (N,). Other axes are taken as they are: time or frequency
        first.

    Raises
    ------
    InputError
        A name isn't in the file (the sentence lists those that are), the time isn't uniform, wrong shapes.
    FileFormatError
        A broken or foreign file, text where numbers are needed.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> from robustid.data import load
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder) / "step.csv"
    ...     _ = path.write_text("time,u,y\n0,1,0\n0.01,1,0.5\n0.02,1,0.75\n")
    ...     record = load(path, bound=0.01)
    >>> record.dt, record.y.ravel()
    (0.01, array([0.  , 0.5 , 0.75]))
    """
    if kind not in (None, "frequency", "time"):
        raise InputError(f'`kind` must be "frequency", "time" or None; got {kind!r}')
    if str(frequency_unit).lower() not in ("rad/s", "hz"):
        raise InputError(f'`frequency_unit` must be "rad/s" or "Hz"; got {frequency_unit!r}')
    if fields is not None and not isinstance(fields, Mapping):
        raise InputTypeError(f'`fields` must map roles to names, such as {{"u": "current"}}; got {fields!r}')
    if unknown := set(fields or {}) - set(NAMES):
        raise InputError(f"`fields` knows the roles {sorted(NAMES)}; got {sorted(map(str, unknown))}")
    given = {"dt": dt, "bound": bound, "inputs": inputs, "outputs": outputs, "initial": initial}
    options = {name: value for name, value in given.items() if value is not None}
    table = read_table(path)
    if table.meta is not None and not fields:
        return _loaded(lambda: _unpack(table, kind, options), table)
    lookup = Lookup(table, dict(fields or {}))
    if (kind or lookup.kind()) == "time":
        return _loaded(lambda: as_time(lookup, options), table)
    options.pop("initial", None)
    return _loaded(lambda: as_frequency(lookup, options, str(frequency_unit).lower() == "hz"), table)


class Origin(NamedTuple):
    """What a file says by itself: its kind, whether the unit of its frequencies is known, and its sample time."""

    kind: str | None
    unit_known: bool
    dt: float | None
    dt_from: str


def origin(path: str | os.PathLike, kind: str, fields: Mapping[str, Any] | None) -> Origin:
    """The `Origin` of a file, whatever `dt` and unit `load` is given."""
    table = read_table(path)
    if table.meta is not None and not fields:
        return Origin(table.meta["kind"], True, table.meta.get("dt"), "stored with the data")
    lookup = Lookup(table, dict(fields or {}))
    unit_known = kind == "time" or "freq_hz" in lookup.fields or lookup.find("omega") is None
    step, source = lookup.sample_time(), "stored in the file"
    if kind == "time":
        # A time axis that is missing, or not uniform, says nothing here.
        with contextlib.suppress(InputError, InputTypeError, FileFormatError):
            samples = len(lookup.signal("u", lookup.need("u")))
            step, source = time_step(lookup, samples), "its time axis"
    return Origin(None if fields else lookup.looks(), unit_known, step, source)


def save(path: str | os.PathLike, data: FrequencyResponse | TimeRecord) -> None:
    """Write a frequency response or time record, so that `load` gives back exactly the same.

    Parameters
    ----------
    path : str or path
        ``.npz``, or ``.csv`` with 17 digits: a first line ``# robustid {...}`` that describes it, column
        names, numbers. The file appears whole or not at all.
    data : FrequencyResponse or TimeRecord
        What to write, with its bounds, covariance, channel names and note.

    Raises
    ------
    InputError
        Another ending, or a folder that doesn't exist.
    InputTypeError
        Other data.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> from robustid.data import FrequencyResponse, load, save
    >>> frf = FrequencyResponse([1.0, 2.0], [0.1 + 0.2j, 0.3j], bound=0.01, dt=0.1)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     save(pathlib.Path(folder) / "frf.csv", frf)
    ...     again = load(pathlib.Path(folder) / "frf.csv")
    >>> bool((again.values == frf.values).all())
    True
    """
    kind = next((name for name, cls in _CLASSES.items() if isinstance(data, cls)), None)
    if kind is None:
        raise InputTypeError(f"`data` must be a FrequencyResponse or a TimeRecord; got {type(data).__name__}")
    arrays = {name: getattr(data, name) for name in _ARRAYS[kind] if getattr(data, name) is not None}
    meta = {name: getattr(data, name) for name in (*_FACTS[kind], "inputs", "outputs")}
    samples = len(next(iter(arrays.values())))
    meta["shapes"] = {name: array.shape[1:] for name, array in arrays.items()}
    suffix = Path(path).suffix.lower()
    meta |= {"robustid": FORMAT, "kind": kind, "samples": samples, "layout": suffix}
    if suffix == ".npz":
        with atomic_write(path, "wb") as file:
            np.savez(file, allow_pickle=False, **arrays, robustid=np.array(json.dumps(meta)))
    elif suffix == ".csv":
        columns = {"time": data.time} if isinstance(data, TimeRecord) else {}
        for name, array in arrays.items():
            flat = array.reshape(samples, -1)
            for part in ("real", "imag") if np.iscomplexobj(array) else ("real",):
                names = _column_names(name, array.shape[1:], part if np.iscomplexobj(array) else "")
                columns |= dict(zip(names, getattr(flat, part).T, strict=True))
        with atomic_write(path, "w") as file:
            file.write(f"# robustid {json.dumps(meta)}\n")
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(columns)
            writer.writerows(np.column_stack(list(columns.values())).tolist())
    else:
        raise InputError(f"`path` must end in .npz or .csv; got {str(path)!r}")


def _column_names(name: str, shape: tuple[int, ...], part: str) -> Iterator[str]:
    """Names of the columns of one array, such as real, u2, real_1_2 or covariance_imag_1_1."""
    base = {"values": part}.get(name, f"{name}_{part}" if part else name)
    for index in itertools.product(*(range(1, n + 1) for n in shape)):
        alone = all(n == 1 for n in shape)
        yield base + ("" if alone else str(index[0]) if len(shape) == 1 else "".join(f"_{i}" for i in index))


def _unpack(table: Table, kind: str | None, options: dict[str, Any]) -> Any:
    """What `save` wrote, with the arguments given to `load` in place of what is stored."""
    meta: dict[str, Any] = table.meta or {}
    if kind not in (None, meta["kind"]):
        raise InputError(f"`kind` = {kind!r}, but the file holds {meta['kind']} data; leave `kind` out")
    arrays = {}
    for name, shape in meta["shapes"].items():
        if meta["layout"] == ".npz":
            arrays[name] = table.columns[name]
        elif name in ("values", "tilt", "covariance"):
            real, imag = (_stack(table, _column_names(name, shape, part)) for part in ("real", "imag"))
            array = np.empty(real.shape, complex)
            # Not real + 1j*imag, which loses the sign of zeros.
            array.real, array.imag = real, imag
            arrays[name] = array.reshape(-1, *shape)
        else:
            arrays[name] = _stack(table, _column_names(name, shape, "")).reshape(-1, *shape)
    facts = {name: meta[name] for name in _FACTS[meta["kind"]] if name in meta}  # older files know fewer
    names = {side: [tuple(channel) for channel in meta[side]] for side in ("inputs", "outputs")}
    if meta["kind"] == "frequency":
        options.pop("initial", None)
    data = _CLASSES[meta["kind"]](**arrays, **facts, **names)
    if len(arrays["omega" if meta["kind"] == "frequency" else "u"]) != meta["samples"]:
        raise FileFormatError(f"the file was written with {meta['samples']} samples and has fewer or more now")
    bound = options.pop("bound", None)
    data = data if bound is None else data.with_bound(bound)
    return dataclasses.replace(data, **options) if options else data


def _stack(table: Table, names: Iterator[str]) -> np.ndarray:
    lookup = Lookup(table, {})
    return np.column_stack([lookup.column(name, name) for name in names])


def _loaded(build: Any, table: Table) -> Any:
    """Put the file's name before what is wrong with its contents."""
    try:
        return build()
    except (InputError, InputTypeError, FileFormatError) as error:
        if str(error).startswith(table.path.name):
            raise
        raise type(error)(f"{table.path.name}: {error}") from None
    except (KeyError, ValueError, TypeError, AttributeError):
        if table.meta is None:
            raise
        raise FileFormatError(
            f"{table.path.name}: the description in it doesn't fit its arrays; save again, or give `fields`"
        ) from None

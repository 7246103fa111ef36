"""Measurements from and to files: text, .npz (never pickle), .mat, .h5, universal files, Touchstone."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from robustid.data.frequency_response import FrequencyResponse
from robustid.data.io.readers import read_table
from robustid.data.io.roles import NAMES, Lookup, as_frequency, as_time, frequency_axis, time_step
from robustid.data.io.saved import CLASSES, WRITERS, unpack
from robustid.data.io.structures import from_structure
from robustid.data.io.table import Table
from robustid.data.tangential import TangentialResponse
from robustid.data.time_record import TimeRecord
from robustid.errors import FileFormatError, InputError, InputTypeError


def load(
    path: str | os.PathLike,
    *,
    kind: str | None = None,
    fields: Mapping[str, Any] | None = None,
    dt: float | None = None,
    bound: Any = None,
    frequency_unit: str | None = None,
    inputs: Any = None,
    outputs: Any = None,
    initial: str | None = None,
) -> FrequencyResponse | TangentialResponse | TimeRecord:
    r"""Read a measured frequency response or time record from a file.

    Parameters
    ----------
    path : str or path
        ``.csv``, ``.tsv``, ``.txt`` (first line: column names; lines that start with ``#`` are skipped),
        ``.npz`` (pickled objects are refused), ``.mat`` (v5 or v7.3), ``.h5`` (arrays in the axis order that h5py shows, numbers
        such as ``dt`` as attributes too, units in an attribute ``units``), universal files (data set 58: frequency responses
        and time responses, extra ``robustid[uff]``), Touchstone (``.s1p``, ``.s2p``, ...: S-parameters in continuous time,
        extra ``robustid[touchstone]``). Contents decide before the ending.
    kind : {"frequency", "time"}, optional
        What the file holds; default: by the roles in `fields`, else by the names in the file.
    fields : mapping, optional
        Role to name in the file. Frequency: ``omega`` or ``freq_hz``; ``values`` (complex), or ``real`` and
        ``imag``, or ``magnitude``/``magnitude_db`` and ``phase_deg``/``phase_rad``; ``bound``. Time:
        ``time``, ``u``, ``y``, ``reference``, ``bound``. Both: ``dt``. Fields of MATLAB structures have dots
        (``"data.u"``). Several channels: a list of names for a time signal; for a frequency role a list of
        rows (one an output) of names (one an input). Roles left out are looked for under usual names, upper
        or lower case, with or without a unit: ``frequency [Hz]``, ``f (kHz)``, ``omega [rad/s]``, ``magnitude [dB]``,
        ``phase [deg]``, ``time_ms``. Units of axes are converted; one that isn't known or isn't certain (``frequency``,
        ``phase`` alone) is refused. Structures with the fields of MATLAB's ``idfrd`` and ``frd`` (ResponseData, Frequency,
        FrequencyUnit, Ts, TimeUnit, CovarianceData, names) or ``iddata`` (OutputData, InputData, Ts) need no roles; covariances
        between different entries, of which ``idfrd`` says nothing, are zero then.
    dt : float, optional
        Sample time in s. Without it, a time record takes it from its ``time`` column, which must be uniform
        to 1e-6 of a step, and ``.npz`` and ``.mat`` files may hold it as a number named ``dt``, ``Ts`` or ``T``;
        with it, neither is read.
    bound : scalar or array, optional
        Bound on the errors; goes before a ``bound`` in the file.
    frequency_unit : {"rad/s", "Hz"}, optional
        Unit of a frequency axis whose name doesn't say it; "rad/s" is taken for names such as ``omega`` only, and a
        column ``frequency`` without a unit is refused. A contradiction with the name is refused too.
    inputs, outputs : sequence of str or (name, unit), optional
        Signal names and units; default for time signals: the column names.
    initial : {"rest", "free", "periodic"}, optional
        State before a time record (see `TimeRecord`); default "rest", or what `save` stored.

    Returns
    -------
    FrequencyResponse or TimeRecord, or a TangentialResponse that `save` wrote
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
    if frequency_unit is not None and str(frequency_unit).lower() not in ("rad/s", "hz"):
        raise InputError(f'`frequency_unit` must be "rad/s" or "Hz"; got {frequency_unit!r}')
    if fields is not None and not isinstance(fields, Mapping):
        raise InputTypeError(f'`fields` must map roles to names, such as {{"u": "current"}}; got {fields!r}')
    if unknown := set(fields or {}) - set(NAMES):
        raise InputError(f"`fields` knows the roles {sorted(NAMES)}; got {sorted(map(str, unknown))}")
    given = {"dt": dt, "bound": bound, "inputs": inputs, "outputs": outputs, "initial": initial}
    options = {name: value for name, value in given.items() if value is not None}
    table = read_table(path)
    if table.meta is not None and not fields:
        return _loaded(lambda: unpack(table, kind, options), table)
    return _loaded(lambda: _assigned(table, kind, dict(fields or {}), frequency_unit, options), table)


def _assigned(
    table: Table, kind: str | None, fields: dict[str, Any], frequency_unit: str | None, options: dict[str, Any]
) -> FrequencyResponse | TimeRecord:
    """A file of others: its arrays by their roles."""
    if not fields and (plain := from_structure(table, kind, frequency_unit)) is not table:
        table, frequency_unit = plain, None
    lookup = Lookup(table, fields)
    if (kind or lookup.kind()) == "time":
        return as_time(lookup, options)
    options.pop("initial", None)
    return as_frequency(lookup, options, frequency_unit)


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
    if not fields:
        with contextlib.suppress(InputError, FileFormatError):  # `load` has the sentence
            table = from_structure(table, kind, None)
    lookup = Lookup(table, dict(fields or {}))
    unit_known, step, source = True, lookup.sample_time(), "stored in the file"
    # An axis that is missing or of no use says nothing here: `load` has the sentence.
    with contextlib.suppress(InputError, InputTypeError, FileFormatError):
        if kind == "frequency":
            unit_known = frequency_axis(lookup, "rad/s")[1] is not None
            step = table.facts.get(kind, {}).get("dt", step)
        else:
            samples = len(lookup.signal("u", lookup.need("u")))
            step, source = time_step(lookup, samples), "its time axis"
    return Origin(None if fields else lookup.looks(), unit_known, step, source)


def save(path: str | os.PathLike, data: FrequencyResponse | TangentialResponse | TimeRecord) -> None:
    """Write a frequency response, time record or tangential response, so that `load` gives back exactly the same.

    Parameters
    ----------
    path : str or path
        ``.npz``; ``.csv`` with 17 digits: a first line ``# robustid {...}`` that describes it, column names, numbers; or
        ``.mat`` (v5): plain arrays of the same names, frequency or time first, `dt` (0 for continuous time) and the names
        of the channels. The file appears whole or not at all.
    data : FrequencyResponse, TangentialResponse or TimeRecord
        What to write, with its bounds and their meaning, covariance, channel names and note.

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
    kind = next((name for name, cls in CLASSES.items() if isinstance(data, cls)), None)
    if kind is None:
        raise InputTypeError(
            f"`data` must be a FrequencyResponse, TangentialResponse or TimeRecord; got {type(data).__name__}"
        )
    suffix = Path(path).suffix.lower()
    if suffix not in WRITERS:
        raise InputError(f"`path` must end in {', '.join(WRITERS)}; got {str(path)!r}")
    WRITERS[suffix](path, data, kind)


def _loaded(build: Any, table: Table) -> Any:
    """Put the file's name before what is wrong with its contents."""
    try:
        return build()
    except (InputError, InputTypeError, FileFormatError) as error:
        if str(error).startswith(table.path.name):
            raise
        raise type(error)(f"{table.path.name}: {error}") from None
    except (KeyError, ValueError, TypeError, AttributeError, IndexError, OverflowError):
        if table.meta is None:
            raise
        raise FileFormatError(
            f"{table.path.name}: the description in it doesn't fit its arrays; save again, or give `fields`"
        ) from None

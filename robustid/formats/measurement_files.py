"""Measurements, excitations and models from files, and measurements to files: text, .npz (never pickle), .mat, .h5 and others."""

from __future__ import annotations

import contextlib
import logging
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple, TypeVar, cast

from robustid.core import Options, as_positive, written_by
from robustid.data import FrequencyResponse, TimeRecord
from robustid.errors import FileFormatError, InputError, InputTypeError
from robustid.formats.addresses import axis_names
from robustid.formats.assembly import as_frequency, as_time, frequency_axis, time_step
from robustid.formats.excitation_files import excitation_of, is_excitation
from robustid.formats.headed_columns import from_headings
from robustid.formats.matlab_structures import from_structure
from robustid.formats.model_files import StoredModel, is_model, model_of
from robustid.formats.named_entries import from_named_entries
from robustid.formats.readers import read_table
from robustid.formats.role_lookup import Lookup
from robustid.formats.role_names import NAMES
from robustid.formats.saved import CLASSES, WRITERS, Measured, unpack
from robustid.formats.table import Table
from robustid.formats.units import FREQUENCY, factor

Loaded = TypeVar("Loaded")
_log = logging.getLogger("robustid")


def read_file(path: object, **options: Any) -> Any:
    """Measurements, an excitation or a model: `robustid.load` of a file that holds no saved result, with its arguments."""
    found = read_said(path, **options)[0]
    return found.model() if isinstance(found, StoredModel) else found


def read_said(
    path: object,
    *,
    kind: str | None = None,
    fields: Mapping[str, object] | None = None,
    frequency_unit: str | None = None,
    axes: str | None = None,
    decimal: str | None = None,
    start: float | None = None,
    step: float | None = None,
    **stated: Any,
) -> tuple[Any, str]:
    r"""Read a file as `read_file` does, and say as what.

    `stated` are its other arguments, which go before what the file says, None for none. Second come the format of the file,
    and of a text its layout, in words.
    """
    _check_words(kind, fields, frequency_unit, decimal)
    if (start is None) != (step is None):
        raise InputError("`start` and `step` of the frequencies belong together; give both")
    grid = None if start is None or step is None else (start, step)
    options = {name: value for name, value in stated.items() if value is not None}
    if (rate := options.pop("rate", None)) is not None:
        if "dt" in options:
            raise InputError("`dt` and `rate` are both given; give one")
        options["dt"] = 1 / as_positive("rate", rate)
    if type(path).__module__.startswith("control.") and hasattr(path, "frdata"):
        told = {"fields": fields, "frequency_unit": frequency_unit, "axes": axes, "start": start,
                "initial": options.get("initial")}  # fmt: skip
        if given := [name for name, value in told.items() if value is not None]:
            raise InputError(f"`{given[0]}` isn't needed: a control.FRD says this itself; leave it out")
        return FrequencyResponse.from_control(path, **options), "control.FRD"
    table = read_table(path, decimal)
    _log.info("%s: read as %s", table.path.name, table.how)
    if kind == "model" or (kind is None and table.meta is None and not fields and _is_model(table)):
        _refuse([name for name in options if name != "dt"], "a model")
        return model_of(table, options.get("dt")), table.how
    if kind is None and not fields and is_excitation(table):
        _refuse(list(options), "an excitation")
        return excitation_of(table), table.how
    if table.meta is not None and not fields:
        return _loaded(lambda: unpack(table, kind, options), table), "as it was saved"
    asked = _Asked(kind or (None if grid is None else "frequency"), dict(fields or {}), frequency_unit, axes, grid)
    return _loaded(lambda: _assigned(table, asked, options), table)


class _Asked(NamedTuple):
    """The way in which the arrays of a file are to be taken."""

    kind: str | None
    fields: dict[str, object]
    frequency_unit: str | None
    axes: str | None
    grid: tuple[float, float] | None


def _check_words(
    kind: str | None, fields: Mapping[str, object] | None, frequency_unit: str | None, decimal: str | None
) -> None:
    if kind not in (None, "frequency", "time", "model"):
        raise InputError(f'`kind` must be "frequency", "time", "model" or None; got {kind!r}')
    if frequency_unit is not None and factor(FREQUENCY, str(frequency_unit)) is None:
        raise InputError(f'`frequency_unit` must be "rad/s", "Hz" or "kHz"; got {frequency_unit!r}')
    if fields is not None and not isinstance(cast("object", fields), Mapping):
        raise InputTypeError(f'`fields` must map roles to names, such as {{"u": "current"}}; got {fields!r}')
    if unknown := set(fields or {}) - set(NAMES):
        raise InputError(f"`fields` knows the roles {sorted(NAMES)}; got {sorted(map(str, unknown))}")
    if decimal not in (None, ".", ","):
        raise InputError(f"`decimal` must be '.' or ','; got {decimal!r}")


def kind_of_file(path: str | os.PathLike[str], decimal: str | None = None) -> str | None:
    """Kind of what a file holds, "frequency", "time", "tangential" or "model", as far as its names say; else None."""
    table = read_table(path, decimal)
    if table.meta is not None:
        return str(table.meta["kind"])
    return "model" if _is_model(table) else Lookup(table, {}).looks()


def _is_model(table: Table) -> bool:
    """A model, and no measurements beside its matrices."""
    return is_model(table) and Lookup(table, {}).measured() is None


def _refuse(names: list[str], what: str) -> None:
    if names:
        raise InputError(f"`{names[0]}` is about measurements, and the file holds {what}; leave `{names[0]}` out")


def _assigned(
    table: Table, asked: _Asked, options: Options
) -> tuple[TimeRecord | list[TimeRecord] | FrequencyResponse, str]:
    """A file of others: its arrays by their roles, and as what they were read."""
    kind, frequency_unit = asked.kind, asked.frequency_unit
    if not asked.fields and (plain := from_structure(table, kind, frequency_unit)) is not table:
        table, frequency_unit = plain, None
    elif not asked.fields and asked.axes is None and asked.grid is None:
        table = _by_names(table, kind)
    named = None if asked.axes is None else axis_names(asked.axes)
    if named is not None and kind is None:
        kind = "frequency" if "frequency" in named else "time"
    lookup = Lookup(table, asked.fields, named, dt_known="dt" in options)
    if (kind or lookup.kind()) == "time":
        return as_time(lookup, options), table.how + lookup.clock
    options.pop("initial", None)
    return as_frequency(lookup, options, frequency_unit, asked.grid), table.how + lookup.turned()


def _by_names(table: Table, kind: str | None) -> Table:
    """The table with a response, where the names of its columns say one."""
    table = from_headings(table, kind)
    return from_named_entries(table) if kind in (None, "frequency") else table


class Origin(NamedTuple):
    """Facts that a file states itself: kind, whether the unit of its frequencies is known, sample time, and format.

    `continuous`: it says, or its format does, that nothing is sampled.
    """

    kind: str | None
    unit_known: bool
    dt: float | None
    dt_from: str
    how: str
    continuous: bool = False


def origin(
    path: str | os.PathLike[str] | Table, kind: str, fields: Mapping[str, object] | None, decimal: str | None = None
) -> Origin:
    """The `Origin` of a file, whatever `dt` and unit `read_file` is given."""
    table = read_table(path, decimal)
    if table.meta is not None and not fields:
        step = table.meta["data"].get("dt")
        return Origin(table.meta["kind"], True, step, "stored with the data", "as it was saved", step is None)
    if not fields:
        with contextlib.suppress(InputError, FileFormatError):  # `load` has the sentence
            table = _by_names(from_structure(table, kind, None), kind)
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
    continuous = step is None and "dt" in table.facts.get(kind, {})
    return Origin(None if fields else lookup.looks(), unit_known, step, source, table.how, continuous)


def _write(path: str | os.PathLike[str], data: Measured) -> None:
    """Write measurements in the format that the ending of the path names."""
    suffix = Path(path).suffix.lower()
    if suffix not in WRITERS:
        raise InputError(f"`path` must end in {', '.join(WRITERS)}; got {str(path)!r}")
    WRITERS[suffix](path, data, next(name for name, cls in CLASSES.items() if isinstance(data, cls)))


for _class in CLASSES.values():
    written_by(_class, _write)


def _loaded(build: Callable[[], Loaded], table: Table) -> Loaded:
    """Put the file's name before what is wrong with its contents."""
    try:
        return build()
    except (InputError, InputTypeError, FileFormatError) as error:
        raise error.at(table.path.name) from None
    except (KeyError, ValueError, TypeError, AttributeError, IndexError, OverflowError, RecursionError):
        if table.meta is None:
            raise
        raise FileFormatError(
            f"{table.path.name}: the description in it doesn't fit its arrays; save again, or give `fields`"
        ) from None

"""Excitations to and from files: what a player plays, with what `estimate_frf` needs afterwards."""

from __future__ import annotations

import csv
import json
import os
from pathlib import Path

import numpy as np

from robustid.core import Options, as_array, atomic_write, written_by
from robustid.data import Excitation
from robustid.errors import FileFormatError, InputError, InputTypeError
from robustid.formats.readers import read_table
from robustid.formats.table import Table

_MARK = "# robustid.excitation "
_FACTS = ("dt", "periods", "seed")


def write(path: str | os.PathLike[str], excitation: Excitation) -> None:
    """`Excitation.save`: whole or not at all."""
    facts: Options = {name: getattr(excitation, name) for name in _FACTS}
    suffix = Path(path).suffix.lower()
    if suffix == ".npz":
        with atomic_write(path, "wb") as file:
            np.savez(file, allow_pickle=False, u=excitation.u, lines=excitation.lines, **facts)
    elif suffix == ".csv":
        experiments, period, inputs = excitation.u.shape
        facts |= {"period": period, "lines": excitation.lines.tolist()}
        played = np.concatenate([excitation.signal(e) for e in range(experiments)], axis=1)
        time = excitation.dt * np.arange(len(played))
        with atomic_write(path) as file:
            file.write(f"{_MARK}{json.dumps(facts)}\n")
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(["time", *_names(experiments, inputs)])
            writer.writerows(np.column_stack([time, played]).tolist())
    else:
        raise InputError(f"`path` must end in .csv or .npz; got {str(path)!r}")


def load_excitation(path: str | os.PathLike[str]) -> Excitation:
    """Read an excitation that `Excitation.save` wrote, exactly as it was.

    ``.csv`` holds all periods in columns ``time, u1_exp1, u2_exp1, ...`` (input 1 of experiment 1, ...) behind a first
    line that describes it; ``.npz`` holds one period as ``u`` (experiments, samples, inputs) with ``lines``, ``dt``,
    ``periods`` and ``seed``.

    Parameters
    ----------
    path : str or path
        The file.

    Returns
    -------
    Excitation
        With the `lines` and the `period` for `estimate_frf`.

    Raises
    ------
    InputError
        No such file.
    FileFormatError
        Another file, or one that was changed or cut off.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> from robustid.data import multisine
    >>> from robustid.formats import load_excitation
    >>> play = multisine(lines=[1, 2, 5], period=100, dt=0.01, periods=4)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     play.save(pathlib.Path(folder) / "play.csv")
    ...     again = load_excitation(pathlib.Path(folder) / "play.csv")
    >>> again.period, again.lines, bool((again.u == play.u).all())
    (100, array([1, 2, 5]), True)
    """
    return excitation_of(read_table(path))


def is_excitation(table: Table) -> bool:
    """Return whether a file holds an excitation: by its first line, or the names of its arrays."""
    if set(table.columns) == {"u", "lines", *_FACTS}:
        return True
    return table.text and any(name.endswith("_exp1") for name in table.columns) and _first_line(table).startswith(_MARK)


def excitation_of(table: Table) -> Excitation:
    """The excitation that a file holds; see `load_excitation`."""
    build = _from_arrays if isinstance(table.columns.get("u"), np.ndarray) else _from_columns
    try:
        return build(table)
    except (InputError, InputTypeError, FileFormatError, KeyError, ValueError, TypeError) as error:
        said = str(error) if isinstance(error, InputError | InputTypeError | FileFormatError) else "parts are missing"
        raise FileFormatError(
            f"{table.path.name} is not an excitation as `Excitation.save` writes it ({said}); save it again"
        ) from None


def _from_arrays(table: Table) -> Excitation:
    facts = {name: table.numbers(name).item() for name in _FACTS}
    return Excitation(table.numbers("u"), lines=table.numbers("lines"), **facts)


def _from_columns(table: Table) -> Excitation:
    head = _first_line(table)
    if not head.startswith(_MARK):
        raise FileFormatError("its first line doesn't describe one")
    facts = json.loads(head[len(_MARK) :])
    period, names = facts.pop("period"), [name for name in table.columns if name != "time"]
    inputs = sum(name.endswith("_exp1") for name in names)
    if names != _names(len(names) // inputs if inputs else 0, inputs):
        raise FileFormatError("its columns are not time, u1_exp1, u2_exp1, ...")
    played = as_array("u", np.column_stack([table.numbers(name) for name in names]))
    if len(played) != period * facts["periods"]:
        raise FileFormatError(f"{len(played)} samples where it describes {facts['periods']} periods of {period}")
    cycles = played.reshape(-1, period, len(names))
    if np.any(cycles != cycles[0]):
        raise FileFormatError("its periods are not equal")
    u = cycles[0].reshape(period, -1, inputs).transpose(1, 0, 2)
    return Excitation(u, **{name: facts[name] for name in (*_FACTS, "lines")})


def _first_line(table: Table) -> str:
    with table.path.open(encoding="utf-8-sig", errors="replace") as file:
        return file.readline()


def _names(experiments: int, inputs: int) -> list[str]:
    return [f"u{i + 1}_exp{e + 1}" for e in range(experiments) for i in range(inputs)]


written_by(Excitation, write)

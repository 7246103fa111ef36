"""Contents of a file before anything is taken for anything: arrays by their addresses, texts, objects that can't be read."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from robustid.formats.readers import read_table
from robustid.formats.table import NAMELESS, Table
from robustid.formats.units import in_brackets


class Item(NamedTuple):
    """One thing in a file."""

    address: str  # as it stands in `fields`; ``"[:]"`` is the one array of a file that gives it no name
    kind: str  # {"real", "", "empty", "text", "object", "unreadable"}
    values: np.ndarray | None = None  # the numbers, for the first two kinds
    text: str = ""  # the text; the class of an object; the reason why something is unreadable

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the numbers; () for everything else."""
        return () if self.values is None else self.values.shape

    @property
    def name(self) -> str:
        """The name without its unit."""
        return in_brackets(self.address)[0]

    @property
    def unit(self) -> str:
        """The unit that the name states in brackets, or ""."""
        return "" if self.address.startswith("[") else in_brackets(self.address)[1]


class Contents(NamedTuple):
    """Items of a file, and one line that says as what it was read."""

    how: str
    items: tuple[Item, ...]


def contents(path: object) -> Contents:
    r"""List what is in a file of any format that `robustid.load` reads; nothing is taken for anything yet.

    Parameters
    ----------
    path : str, path, or a table in memory
        As for `robustid.load`.

    Returns
    -------
    Contents
        The numbers as they are stored, without units converted.

    Raises
    ------
    InputError, FileFormatError
        No such file, or none that can be read.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> from robustid.formats import contents
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder) / "step.csv"
    ...     _ = path.write_text("time,u [V],y\n0,1,0\n0.5,1,0.25\n")
    ...     found = contents(path)
    >>> [(item.address, item.kind, item.shape) for item in found.items]
    [('time', 'real', (2,)), ('u [V]', 'real', (2,)), ('y', 'real', (2,))]
    """
    table = read_table(path)
    return Contents(table.how, tuple(_items(table)))


def _items(table: Table) -> list[Item]:
    found: list[Item] = []
    for name, values in table.columns.items():
        address = "[:]" if name == NAMELESS else name
        if isinstance(values, np.ndarray):
            found.append(Item(address, "complex" if np.iscomplexobj(values) else "real", values))
        else:
            found.append(Item(address, "unreadable", text=str(values)))
    found += [Item(name, "empty", values) for name, values in table.empty.items()]
    found += [Item(name, "text", text="\n".join(lines)) for name, lines in table.texts.items()]
    return found + [Item(name, "object", text=kind) for name, kind in table.objects.items()]

"""From a file of any supported format to named arrays; nothing is executed and nothing unpickled."""

from __future__ import annotations

import dataclasses
import functools
import json
import os
import re
from collections.abc import Callable
from pathlib import Path
from typing import cast

from robustid.core import Record, saved_kind
from robustid.errors import FileFormatError, InputError, InputTypeError
from robustid.formats.diagnostics import MARK, read_diagnostics
from robustid.formats.hdf5 import read_hdf5
from robustid.formats.json_files import read_json
from robustid.formats.matlab import read_matlab4, read_matlab5
from robustid.formats.networks import read_touchstone
from robustid.formats.numpy_files import read_npy, read_npz
from robustid.formats.sound import read_sound
from robustid.formats.table import Table, said
from robustid.formats.tables_in_memory import table_of
from robustid.formats.text import read_text
from robustid.formats.universal import read_universal

FORMAT = 1
TEXTS = {".csv", ".tsv", ".txt"}
_UNIVERSAL = re.compile(rb"\s*-1\s*[\r\n]\s*\d")  # a data set begins, and its number follows
_BINARY = re.compile(rb"[\x00-\x08\x0e-\x1f]")


def read_table(path: object, decimal: str | None = None) -> Table:
    """Read a file, its format recognised by its first bytes; by its name only where these don't say.

    `decimal` is the decimal mark of a text, where its numbers don't say it. A table that was read before is given back.
    """
    if isinstance(path, Table):
        return path
    if not isinstance(path, str | os.PathLike):
        if (table := table_of(path)) is None:
            raise InputTypeError(
                f"`path` must be the name of a file; got {type(path).__name__}, which is no table of arrays either"
            )
        return _with_numbers(table)
    path = Path(cast("str", path))
    if path.is_dir():
        raise InputError(f"{path} is a folder; give the name of a file in it", place=str(path))
    try:
        with path.open("rb") as file:
            head = file.read(520)
    except FileNotFoundError:
        raise InputError(f"{path}: there is no such file; check the name and the folder", place=str(path)) from None
    except (OSError, ValueError) as error:
        raise InputError(f"{path} can't be read: {said(error)}", place=str(path)) from None
    if not head:
        raise FileFormatError(f"{path.name} is empty (0 bytes); write or copy the file again")
    if (kind := saved_kind(path)) is not None:
        raise FileFormatError(f"{path.name} belongs to a saved {kind}, not to measurements; open it with robustid.load")
    try:
        table = _reader(path, head, decimal)(path)
    except MemoryError:
        raise FileFormatError(
            f"{path.name} declares more data than this machine has memory for; is it damaged?"
        ) from None
    meta = table.meta or "".join(table.texts.get("robustid", []))
    _with_numbers(table)
    return dataclasses.replace(table, meta=_checked(path, meta) if meta else None)


def _with_numbers(table: Table) -> Table:
    if not table.columns:
        raise FileFormatError(
            f"{table.path.name} holds no numeric arrays; store plain vectors or matrices{export(table)}"
        )
    return table


def _reader(path: Path, head: bytes, decimal: str | None) -> Callable[[Path], Table]:
    signature, suffix = b"\x89HDF\r\n\x1a\n", path.suffix.lower()
    if head.startswith(signature) or head[512:520] == signature:
        return read_hdf5
    if head.startswith(b"PK"):
        return read_npz
    if head.startswith(b"\x93NUMPY"):
        return read_npy
    if head[:4] in (b"RIFF", b"RIFX", b"RF64") and head[8:12] == b"WAVE":
        return read_sound
    if head.startswith(b"MATLAB 5.0") or (suffix == ".mat" and head[126:128] in (b"IM", b"MI")):
        return read_matlab5
    if suffix == ".mat":
        return read_matlab4
    if re.fullmatch(r"\.[sgyzh]\d+p", suffix) or (suffix == ".ts" and b"[version]" in head.lower()):
        return read_touchstone
    if head.lstrip().startswith(b"<?xml") and (MARK in head):
        return read_diagnostics
    if suffix == ".json" and head.lstrip(b"\xef\xbb\xbf \t\r\n")[:1] in (b"{", b"["):
        return read_json
    if _UNIVERSAL.match(head) or suffix in {".uff", ".unv"}:
        return read_universal
    if suffix in TEXTS or head[:2] in (b"\xff\xfe", b"\xfe\xff") or not _BINARY.search(head):
        return functools.partial(read_text, decimal=decimal)
    raise FileFormatError(
        f"{path.name} isn't a file that robustid reads; give a table of text (.csv, .txt, ...),"
        " .npz (numpy.savez with names), .npy, .mat (v5 or v7.3), .h5, .json, .wav, .uff (58) or Touchstone (.s1p, .s2p, ...)"
    )


def export(table: Table) -> str:
    """End of a sentence: a way to objects that only MATLAB can read."""
    if not table.objects:
        return ""
    name, kind = next(iter(table.objects.items()))
    parts = (
        ["OutputData", "InputData", "Ts", "TimeUnit"]
        if kind == "iddata"
        else ["ResponseData", "Frequency", "FrequencyUnit", "Ts", "TimeUnit"]
    )
    pairs = ", ".join(f"'{part}', {name}.{part}" for part in parts)
    return (
        f". {name!r} is an object of the MATLAB class {kind}, which only MATLAB can read; if it is an idfrd, frd or iddata, say"
        f" there: s = struct({pairs}); save('{table.path.stem}_plain.mat', '-struct', 's')"
    )


def _checked(path: Path, meta: str) -> Record:
    try:
        said: Record = json.loads(meta)
        version, kind, _ = said["robustid"], said["kind"], said["data"].items()
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        raise FileFormatError(f"{path.name}: the description that robustid.save wrote is damaged; save again") from None
    if version != FORMAT or kind not in ("frequency", "tangential", "time"):
        raise FileFormatError(
            f"{path.name} was written in format {version!r} ({kind!r}), unknown here; use a newer robustid"
        )
    return said

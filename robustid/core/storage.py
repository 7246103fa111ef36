"""Saving and loading: one register of what can be kept, and one form in which results are kept; never pickle.

A result is two files, bound to each other by a digest: its numbers in NAME.npz and everything else as readable text in NAME.json.
The room that has a result says what of it is evidence, and how it is made from that (`keep`); the result itself knows only `save`.
Measurements, excitations and models are single files, written by a function of their room (`written_by`).
"""

from __future__ import annotations

import contextlib
import importlib
import json
import os
import pathlib
import re
import zipfile
from collections.abc import Callable, Generator
from typing import Any, NamedTuple

import numpy as np

from robustid._version import __version__
from robustid.core.choice import Choice, Source
from robustid.core.description import Arrays, Record, digest, form_of, stored
from robustid.core.files import atomic_write
from robustid.core.progress import Progress, Unfinished
from robustid.core.state_space import StateMatrices
from robustid.core.validation import Signal, as_kind
from robustid.errors import FileFormatError, InputError, InputTypeError

PathLike = str | os.PathLike[str]

_KIND = "robustid.kind"  # array that shows a saved result
_IN_FOLDERS = "result", "identification", "family", "controller", "loop"  # the result of a run within its folder
_ABOUT = ("format", "version", "summary")  # what stands beside the evidence


class _Kept(NamedTuple):
    """Name of the results of a class in files, and in messages."""

    kind: str
    words: str
    cls: type

    @property
    def format(self) -> str:
        return f"robustid {self.kind} 1"


_RESULTS: dict[type, _Kept] = {}
_FILES: dict[type, Callable[[PathLike, Any], None]] = {}


def keep(
    cls: type,
    kind: str,
    *,
    words: str | None = None,
    evidence: Callable[[Any], Record] | None = None,
    make: Callable[..., Any] | None = None,
    verify: Callable[[Any], None] | None = None,
) -> None:
    """Register how the results of a class are saved and loaded.

    Parameters
    ----------
    cls : type
    kind : str
        Its name in the files, in lower-case words: it stays what it is for as long as old files are to load.
    words : str, optional
        Its name in messages; default `kind`.
    evidence : callable, optional
        From a result to the fields that are stored: of what follows from others, nothing. Default: those from which it is made.
    make : callable, optional
        The way back, which verifies every claim again, from these fields by name and with their types. ValueError, TypeError
        and KeyError mean files that were edited. One that takes long has an argument `progress` beside them. Default: the class
        itself.
    verify : callable, optional
        Raises ValueError where a result that was made so claims more than its own numbers support.
    """
    stored(cls, evidence=evidence, make=make, verify=verify)
    _RESULTS[cls] = _Kept(kind, words or kind, cls)


def written_by(cls: type, write: Callable[[PathLike, Any], None]) -> None:
    """Register the function that writes objects of a class into a single file."""
    _FILES[cls] = write


def save(path: PathLike, thing: object) -> None:
    """Write anything whose class is registered: a result as NAME.npz and NAME.json, both or none; everything else as one file.

    Raises
    ------
    InputError
        The files can't be written, or the ending of `path` is not one for this kind of object.
    InputTypeError
        An object of another class.
    """
    importlib.import_module("robustid.formats")  # registers the writers of measurements, whichever room asked
    if (write := _of(_FILES, thing.__class__)) is not None:
        write(path, thing)
        return
    if (kept := _of(_RESULTS, thing.__class__)) is None:
        names = ", ".join(sorted(cls.__name__ for cls in (*_RESULTS, *_FILES)))
        raise InputTypeError(f"`thing` must be one of {names} or a control.StateSpace; got {type(thing).__name__}")
    numbers, text = paths(path)
    arrays: Arrays = {_KIND: np.array(kept.kind)}
    record: Record = {"format": kept.format, "version": __version__} | form_of(kept.cls).described(thing, "", arrays)
    if summary := getattr(thing, "summary", None):
        record["summary"] = summary().splitlines()
    record |= {"digest": digest(arrays, record)}
    try:
        with atomic_write(numbers, "wb") as binary, atomic_write(text, "w") as file:
            np.savez_compressed(binary, allow_pickle=False, **arrays)  # type: ignore[arg-type]
            json.dump(record, file, indent=1)
            for stream in (binary, file):  # a full disk is to show itself before anything is replaced
                stream.flush()
    except OSError as error:
        raise InputError(f"{path} can't be written: {error.strerror}") from error


class Savable:
    """Mixin of everything that `save` writes."""

    def save(self, path: PathLike) -> None:
        """Write it for `robustid.load`: a result as `path`.npz and `path`.json, all else as one file; see `robustid.save`."""
        save(path, self)


def _of(register: dict[type[Any], Any], cls: type[Any]) -> Any:
    return next((register[base] for base in cls.__mro__ if base in register), None)


def load_saved(path: PathLike, *kinds: str, progress: Progress | None = None) -> Any:
    """Read a result that `save` wrote; every claim of it is verified again.

    `path` is NAME, NAME.npz or NAME.json, or the folder of a run, for the result in it; `kinds` are those that will do, all
    by default. FileFormatError: the files are missing, truncated, edited or of another kind, or do not belong together.
    """
    formats = {kept.format: kept for kept in _RESULTS.values() if kept.kind in (kinds or [kept.kind])}
    words = next(iter(formats.values())).words if len(formats) == 1 else "result"
    numbers, text = paths(result_in(path))
    try:
        record = json.loads(text.read_text(encoding="utf-8"))
        arrays = read_arrays(numbers)
        if record["format"] not in formats:
            _check_kind(text, str(record["format"]), list(formats.values()))
            raise ValueError(f"their format is {record['format']!r}")
        intact = record.pop("digest") == digest(arrays, record)
    except FileFormatError:
        raise
    except FileNotFoundError as error:
        if pathlib.Path(path).is_dir():
            raise FileFormatError(f"{path} is a folder without a saved result") from None
        raise FileFormatError(f"{error.filename} is missing; a saved {words} is a .npz and a .json file") from None
    except (OSError, ValueError, KeyError, TypeError, EOFError, RecursionError, zipfile.BadZipFile) as error:
        raise FileFormatError(f"{text} and {numbers.name} are not a saved {words} ({error})") from None
    if not intact:
        raise FileFormatError(
            f"{numbers} does not belong to {text}, or one of them was edited (its digest differs); restore both files"
        )
    with _usable(numbers, text):
        fields = {name: item for name, item in record.items() if name not in _ABOUT}
        return form_of(formats[record["format"]].cls).made(fields, arrays, progress)


def _check_kind(text: pathlib.Path, said: str, wanted: list[_Kept]) -> None:
    """Say what a result of another kind is, and which are needed."""
    if (other := next((kept for kept in _RESULTS.values() if kept.format == said), None)) is not None:
        needed = " or ".join(kept.words for kept in wanted)
        raise FileFormatError(f"{text} holds a saved result of another kind: {other.words}; needed is: {needed}")


@contextlib.contextmanager
def _usable(numbers: pathlib.Path, text: pathlib.Path) -> Generator[None, None, None]:
    """Say which files can't be used, where rebuilding their result fails."""
    try:
        yield
    except FileFormatError as error:
        raise error.at(str(text)) from None
    except KeyError as error:
        raise FileFormatError(f"{text} lacks {error}; was it edited?") from None
    except (
        TypeError,
        ValueError,
        AttributeError,
        IndexError,
        OverflowError,
        RecursionError,
        np.linalg.LinAlgError,
    ) as error:
        raise FileFormatError(f"{text} and {numbers.name} can't be used: {error}") from None


def saved_kind(path: PathLike) -> str | None:
    """Kind of the saved result to which a file belongs, as the text beside it says; None for every other file.

    Of a result whose text is missing or damaged: "result", if its numbers show that they are those of one.
    """
    path = result_in(path)
    numbers, text = paths(path)
    if pathlib.Path(path).suffix not in (".npz", ".json") and pathlib.Path(path).is_file():
        return None
    try:
        said = str(json.loads(text.read_text(encoding="utf-8"))["format"])
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        said = ""
    if found := re.fullmatch(r"robustid ([a-z -]+) \d+", said):
        return found[1]
    try:
        with zipfile.ZipFile(numbers) as archive:
            return "result" if f"{_KIND}.npy" in archive.namelist() else None
    except Exception:  # zipfile has many for damaged bytes; a file of measurements, whose reader has the sentence
        return None


def result_in(path: PathLike) -> PathLike:
    """The result in the folder of a run; the path itself where it is no folder, or files of a result have its name."""
    if paths(path)[1].is_file() or not (folder := pathlib.Path(path)).is_dir():
        return path
    return next((folder / name for name in _IN_FOLDERS if paths(folder / name)[1].is_file()), path)


def paths(path: PathLike) -> tuple[pathlib.Path, pathlib.Path]:
    """The .npz and the .json file of a saved result."""
    as_kind("path", path, (str, os.PathLike), "the name of a file")
    base = pathlib.Path(path)
    if base.name in ("", ".."):  # a folder without its name
        base = base.resolve()
    if base.suffix in (".npz", ".json"):
        base = base.with_suffix("")
    return base.parent / f"{base.name}.npz", base.parent / f"{base.name}.json"


def read_arrays(path: PathLike) -> Arrays:
    """All arrays of a .npz file; pickled objects are refused with a ValueError."""
    with np.load(path, allow_pickle=False) as archive:
        return {name: archive[name] for name in archive.files}


def part(arrays: Arrays, prefix: str) -> Arrays:
    """The arrays whose names begin so, without that beginning."""
    return {name.removeprefix(prefix): array for name, array in arrays.items() if name.startswith(prefix)}


stored(Choice, Source, Signal, StateMatrices, Unfinished)

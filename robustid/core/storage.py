"""Saving and loading: one register of what can be kept, and one form in which results are kept; never pickle.

A result is two files, bound to each other by a digest: its numbers in NAME.npz and everything else as readable text in NAME.json.
The room that has a result says how its numbers and its text are made, and how the result is made from them (`keep`); the result
itself knows only `save`. Measurements, excitations and models are single files, written by a function of their room (`written_by`).
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import pathlib
import re
import zipfile
from collections.abc import Callable, Generator
from typing import Any, NamedTuple

import numpy as np

from robustid._version import __version__
from robustid.core.files import atomic_write
from robustid.core.validation import as_kind
from robustid.errors import FileFormatError, InputError, InputTypeError

Arrays = dict[str, np.ndarray]
Record = dict[str, Any]
PathLike = str | os.PathLike[str]

# Arrays that show a saved result: an identification, which bounds have inside too, or a fit.
_INSIDE = frozenset({"claim/x.npy", "fit/nodes/denominators.npy"})


class _Kept(NamedTuple):
    """Form of the results of one class."""

    kind: str
    words: str
    pack: Callable[[Any], tuple[Record, Arrays]]
    unpack: Callable[[Record, Arrays], Any]

    @property
    def format(self) -> str:
        return f"robustid {self.kind} 1"


_RESULTS: dict[type[Any], _Kept] = {}
_FILES: dict[type[Any], Callable[[PathLike, Any], None]] = {}


def keep(
    cls: type,
    kind: str,
    *,
    words: str | None = None,
    pack: Callable[[Any], tuple[Record, Arrays]],
    unpack: Callable[[Record, Arrays], Any],
) -> None:
    """Register how the results of a class are saved and loaded.

    Parameters
    ----------
    cls : type
    kind : str
        Its name in the files, in lower-case words: it stays what it is for as long as old files are to load.
    words : str, optional
        Its name in messages; default `kind`.
    pack : callable
        From a result to its text, which JSON can hold, and its arrays by name.
    unpack : callable
        The way back; it verifies every claim again. ValueError, TypeError and KeyError mean files that were edited.
    """
    _RESULTS[cls] = _Kept(kind, words or kind, pack, unpack)


def written_by(cls: type, write: Callable[[PathLike, Any], None]) -> None:
    """Register the function that writes objects of a class into a single file."""
    _FILES[cls] = write


def save(path: PathLike, thing: Any) -> None:
    """Write anything whose class is registered: a result as NAME.npz and NAME.json, both or none; everything else as one file.

    Raises
    ------
    InputError
        The files can't be written, or the ending of `path` is not one for this kind of object.
    InputTypeError
        An object of another class.
    """
    if (write := _of(_FILES, thing.__class__)) is not None:
        write(path, thing)
        return
    record, arrays = describe(thing)
    numbers, text = paths(path)
    record |= {"digest": digest(arrays)}
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


def describe(thing: Any) -> tuple[Record, Arrays]:
    """Text and arrays that are written of a result."""
    if (kept := _of(_RESULTS, thing.__class__)) is None:
        names = ", ".join(sorted(cls.__name__ for cls in (*_RESULTS, *_FILES)))
        raise InputTypeError(f"`thing` must be one of {names} or a control.StateSpace; got {type(thing).__name__}")
    record, arrays = kept.pack(thing)
    return {"format": kept.format, "version": __version__} | record, arrays


def rebuild(record: Record, arrays: Arrays) -> Any:
    """Make the result again that `describe` described; its claims are verified anew."""
    kept = next((kept for kept in _RESULTS.values() if kept.format == record["format"]), None)
    if kept is None:
        raise ValueError(f"their format is {record['format']!r}")
    return kept.unpack(record, arrays)


def _of(register: dict[type[Any], Any], cls: type[Any]) -> Any:
    return next((register[base] for base in cls.__mro__ if base in register), None)


def load_saved(path: PathLike, *kinds: str) -> Any:
    """Read a result that `save` wrote; every claim of it is verified again.

    Parameters
    ----------
    path : str or path
        NAME, NAME.npz or NAME.json.
    *kinds : str
        Those that will do; default: all that are registered.

    Raises
    ------
    FileFormatError
        The files are missing, truncated, edited or of another kind, or do not belong together.
    """
    formats = {kept.format: kept for kept in _RESULTS.values() if kept.kind in (kinds or [kept.kind])}
    words = next(iter(formats.values())).words if len(formats) == 1 else "result"
    numbers, text = paths(path)
    try:
        record = json.loads(text.read_text(encoding="utf-8"))
        arrays = read_arrays(numbers)
        if record["format"] not in formats:
            raise ValueError(f"their format is {record['format']!r}")
        intact = record["digest"] == digest(arrays)
    except FileNotFoundError as error:
        raise FileFormatError(f"{error.filename} is missing; saved {words} is a .npz and a .json file") from None
    except (OSError, ValueError, KeyError, TypeError, EOFError, RecursionError, zipfile.BadZipFile) as error:
        raise FileFormatError(f"{text} and {numbers.name} are not a saved {words} ({error})") from None
    if not intact:
        raise FileFormatError(f"{numbers} does not belong to {text} (its digest differs); restore both files")
    with _usable(numbers, text):
        return rebuild(record, arrays)


@contextlib.contextmanager
def _usable(numbers: pathlib.Path, text: pathlib.Path) -> Generator[None, None, None]:
    """Say which files can't be used, where rebuilding their result fails."""
    try:
        yield
    except KeyError as error:
        raise FileFormatError(f"{text} lacks {error}; was it edited?") from None
    except (TypeError, ValueError, np.linalg.LinAlgError) as error:
        raise FileFormatError(f"{text} and {numbers.name} can't be used: {error}") from None


def saved_kind(path: PathLike) -> str | None:
    """Kind of the saved result to which a file belongs, as the text beside it says; None for every other file.

    Of a result whose text is missing or damaged: "result", if its numbers show that they are those of one.
    """
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
            return "result" if _INSIDE.intersection(archive.namelist()) else None
    except Exception:  # zipfile has many for damaged bytes; a file of measurements, whose reader has the sentence
        return None


def paths(path: PathLike) -> tuple[pathlib.Path, pathlib.Path]:
    """The .npz and the .json file of a saved result."""
    as_kind("path", path, (str, os.PathLike), "the name of a file")
    base = pathlib.Path(path)
    if base.suffix in (".npz", ".json"):
        base = base.with_suffix("")
    return base.with_name(base.name + ".npz"), base.with_name(base.name + ".json")


def read_arrays(path: PathLike) -> Arrays:
    """All arrays of a .npz file; pickled objects are refused with a ValueError."""
    with np.load(path, allow_pickle=False) as archive:
        return {name: archive[name] for name in archive.files}


def digest(arrays: Arrays) -> str:
    """SHA-256 of arrays with their names, types and shapes."""
    total = hashlib.sha256()
    for name in sorted(arrays):
        array = np.ascontiguousarray(arrays[name])
        total.update(f"{name} {array.dtype.str} {array.shape}".encode())
        total.update(array.tobytes())
    return total.hexdigest()


def text_array(text: Any) -> np.ndarray:
    """Text of any structure as an array, for digests."""
    return np.frombuffer(json.dumps(text, sort_keys=True).encode(), np.uint8)


def part(arrays: Arrays, prefix: str) -> Arrays:
    """The arrays whose names begin so, without that beginning."""
    return {name.removeprefix(prefix): array for name, array in arrays.items() if name.startswith(prefix)}


def under(prefix: str, arrays: Arrays) -> Arrays:
    """Return the arrays with names that begin so."""
    return {prefix + name: array for name, array in arrays.items()}

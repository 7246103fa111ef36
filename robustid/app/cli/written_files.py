"""The files that a command may write, and those of saved results that it reads."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from robustid.errors import InputError

if TYPE_CHECKING:
    from robustid.identification import Identification


def result_files(output: Path) -> tuple[Path, Path]:
    """NAME.npz and NAME.json, which hold an identification or bounds."""
    if output.suffix.lower() in (".mat", ".csv", ".tsv", ".txt", ".html"):
        raise InputError(
            f"--output {output}: an identification is written as NAME.npz and NAME.json; leave {output.suffix} out"
        )
    if output.is_dir():
        raise InputError(f"--output {output} is a folder; give a name in it, such as {output / 'result'}")
    base = output.with_suffix("") if output.suffix in (".npz", ".json") else output
    return base.with_name(base.name + ".npz"), base.with_name(base.name + ".json")


def check_ending(output: Path, endings: Sequence[str]) -> None:
    """Refuse the name of a file of another kind."""
    if output.suffix.lower() not in endings:
        *others, last = endings
        raise InputError(f"--output {output} must end in {', '.join(others)} or {last}")


def check_outputs(outputs: Sequence[Path | None], inputs: Sequence[Path], force: bool | None) -> None:
    """Refuse, before anything is computed, what could not be written or would destroy something; `force` None: no such option."""
    read, paths = {path.resolve() for path in inputs}, [path for path in outputs if path is not None]
    for path in paths:
        if path.is_dir():
            raise InputError(f"{path} is a folder; give the name of a file in it")
        if path.resolve() in read:
            raise InputError(f"{path} is one of the files to be read; choose another name for the output")
        if [other.resolve() for other in paths].count(path.resolve()) > 1:
            raise InputError(f"{path} would be written twice; choose different names")
        if path.exists() and not force:
            words = f"{path} exists; choose another name" + (
                ", or pass --force to replace it" if force is False else ""
            )
            raise InputError(words, argument="output", got=str(path))
        if not path.parent.is_dir():
            raise InputError(f"the folder {path.parent} does not exist; create it first")
        if not os.access(path.parent, os.W_OK):
            raise InputError(f"the folder {path.parent} can't be written to; choose another one")


def check_static(report: Path | None, static: bool) -> None:
    """Refuse to write pictures into a report that isn't written."""
    if static and report is None:
        raise InputError("--static says how the report is written; give --report FILE.html too")


def write_page(report: Path | None, page: str | None) -> None:
    """Write the page, after everything was computed and drawn; nothing without one."""
    from robustid.core import atomic_write

    if report is not None and page is not None:
        with atomic_write(report) as file:
            file.write(page)


def free(wanted: Path, *endings: str) -> str:
    """The name of files that are yet to be written, or the next one with -2, -3, … under which none of the endings exists."""
    k, base = 1, wanted
    while any(base.with_name(base.name + ending).exists() for ending in endings):
        k += 1
        base = wanted.with_name(f"{wanted.name}-{k}")
    return str(base)


def stem(output: Path) -> Path:
    """The name of a result without the ending of its files; of the folder of a run the one in it."""
    from robustid.core import result_in

    return result_files(Path(result_in(output)))[0].with_suffix("")


def beside(output: Path, ending: str) -> Path:
    """NAME with an ending of its own."""
    base = result_files(output)[0].with_suffix("")
    return base.with_name(base.name + ending)


def kept_beside(source: Path, ending: str, found: Identification) -> Any:
    """The result of the same data beside an identification: that of identify under this ending, or of run in the folder."""
    from robustid.app.load_save import load_result
    from robustid.core import fingerprint, paths

    place = source / ending.removeprefix("-") if source.is_dir() else beside(source, ending)
    if not paths(place)[1].is_file():
        return None
    kept = load_result(place, "band", "loop bounds")
    problem = kept.problem if ending == "-band" else kept.band.problem
    return kept if fingerprint(problem) == fingerprint(found.problem) else None


def new_folder(wanted: Path) -> Path:
    """Create the folder, or the next free of its name with -2, -3, …"""
    folder, k = wanted, 1
    while True:
        try:
            folder.mkdir(parents=True)
            return folder
        except FileExistsError:
            k += 1
            folder = wanted.with_name(f"{wanted.name}-{k}")
        except OSError as error:
            raise InputError(f"the folder {folder} can't be created: {error.strerror}; give another --output") from None


def sources(path: Path) -> list[Path]:
    """The files that may be read for `path`."""
    from robustid.core import paths, result_in

    return [path, *paths(result_in(path))]

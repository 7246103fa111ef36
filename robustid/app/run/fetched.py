"""Run files of an object store or another machine, and the files that they name: copies of them, as local folders have them."""

from __future__ import annotations

import importlib
import json
import os
import posixpath
import re
import shutil
from pathlib import Path
from typing import Any

from robustid.app.run.run_file import read_run_file
from robustid.core import Progress, Record, atomic_write, paths
from robustid.errors import InputError, RobustIdError

_TAGS = ".fetched.json"
# Keys by which stores tell contents or times of a file, the surest first.
_VERSIONS = (
    *("ETag", "etag", "md5Hash", "Content-MD5", "Digest", "checksum"),
    *("LastModified", "Last-Modified", "last_modified", "updated", "mtime", "created"),
)


def is_url(name: str) -> bool:
    """Tell an address that fsspec opens from the name of a file."""
    return "://" in name


def fetched(url: str, place: Path, progress: Progress | None) -> Path:
    """The copy of a run file, or of a folder with run files, in a folder of copies, with the files that they name.

    A file that is there already is fetched again only where the store has another version of it, or does not tell.
    """
    store, top = _opened(url)
    place = place.resolve() / _words(url, top)
    copies = _Copies(store, place)
    try:
        store.invalidate_cache()
        if not (folder := bool(store.isdir(top))):
            asked = [top]
        elif not (asked := sorted(one for one in store.ls(top, detail=False) if one.endswith(".toml"))):
            raise InputError(f"{url} is a folder without run files; give the address of one that holds some")
        for k, one in enumerate(asked):
            if progress is not None:
                progress("fetching the run files and what they name", k, len(asked))
            path = copies.of(one)
            if path is None and not folder:
                raise InputError(f"{url}: there is no such file or folder; check the address")
            for name in () if path is None else _named(path):
                copies.of(_beside(one, name))
    except RobustIdError:
        raise
    except Exception as error:  # every store has its own
        raise InputError(f"{url} can't be read ({error}); check the address, and what the store asks of you") from None
    finally:
        copies.keep_tags()
    found = copies.place_of(asked[0])
    if not folder:
        return found
    for gone in set(found.parent.glob("*.toml")) - {copies.place_of(one) for one in asked}:
        gone.unlink()
    return found.parent


def _opened(url: str) -> tuple[Any, str]:
    """The file system of an address, and the place in it."""
    try:
        fsspec: Any = importlib.import_module("fsspec.core")
    except ImportError:
        raise InputError(f"{url} needs fsspec, which is not installed: pip install 'robustid[remote]'") from None
    try:
        return fsspec.url_to_fs(url)
    except Exception as error:  # a package that is missing, a protocol that nobody knows, an archive that is not there
        raise InputError(f"{url} can't be opened ({error}); install what it needs, or check the address") from None


def _named(path: Path) -> list[str]:
    """Names of everything that a run file may read, as seen from its folder; none where it can't be read: its run says why."""
    try:
        names = [name for name in read_run_file(path).files if not posixpath.isabs(name)]
    except RobustIdError:
        return []
    return list(dict.fromkeys(one for name in names for one in (name, *(file.as_posix() for file in paths(name)))))


def _beside(place: str, name: str) -> str:
    """The place of a file that is named beside another one."""
    start, mark, path = place.rpartition("://")
    return start + mark + posixpath.normpath(posixpath.join(posixpath.dirname(path), name))


def _words(url: str, top: str) -> str:
    """Name of a store, of what an address says beside the place in it, without who asks."""
    first, _, rest = url.partition("::")
    before = first.rstrip("/").removesuffix(top.strip("/"))
    return "-".join(re.findall(r"[\w.]+", re.sub(r"[^/@]*@", "", f"{before} {rest}")))


class _Copies:
    """Copies of files of a store, in folders named as there; each file is looked at once."""

    def __init__(self, store: Any, place: Path) -> None:
        self._store, self._place = store, place
        self._seen: set[str] = set()
        try:
            self._tags: Record = dict(json.loads((place / _TAGS).read_text(encoding="utf-8")))
        except (OSError, ValueError, TypeError):
            self._tags = {}

    def place_of(self, remote: str) -> Path:
        """The place of the copy of a file."""
        path = self._place.joinpath(*(part for part in remote.replace(":/", "/").split("/") if part))
        return Path(os.path.normpath(path))

    def of(self, remote: str) -> Path | None:
        """The copy of a file as the store has it now; None, and no copy, where it has none, or one outside of all folders."""
        copy = self.place_of(remote)
        if not copy.is_relative_to(self._place):
            return None
        if remote not in self._seen:
            self._seen.add(remote)
            self._bring(remote, copy)
        return copy if copy.is_file() else None

    def _bring(self, remote: str, copy: Path) -> None:
        """Fetch a file, if its copy is another one."""
        try:
            said: Record = self._store.info(remote)
        except FileNotFoundError:
            copy.unlink(missing_ok=True)
            return
        versions = [said[key] for key in _VERSIONS if said.get(key)]
        tag = f"{said.get('size')} {versions[0]}" if versions else None
        if said["type"] != "file" or (copy.is_file() and tag is not None and self._tags.get(remote) == tag):
            return
        self._tags.pop(remote, None)
        copy.parent.mkdir(parents=True, exist_ok=True)
        with self._store.open(remote, "rb") as source, atomic_write(copy, "wb") as file:
            shutil.copyfileobj(source, file, 2**20)
        self._tags[remote] = tag

    def keep_tags(self) -> None:
        """Keep the versions of what was fetched."""
        if self._place.is_dir():
            with atomic_write(self._place / _TAGS) as file:
                json.dump(self._tags, file, indent=1)

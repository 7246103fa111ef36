"""Files appear whole or not at all."""

from __future__ import annotations

import contextlib
import os
import secrets
from collections.abc import Generator
from pathlib import Path
from typing import IO, Any

from robustid.core.description import Record
from robustid.errors import InputError


@contextlib.contextmanager
def atomic_write(path: str | os.PathLike[str], mode: str = "w") -> Generator[IO[Any], None, None]:
    """Write to a temporary name in the same folder, renamed to `path` when the block ends well.

    If the block raises (Ctrl-C too), what was at `path` before is untouched and the temporary file is gone.

    Parameters
    ----------
    path : str or path
        The file to create or replace; its folder must exist.
    mode : {"w", "wb"}
        Text (UTF-8, newlines as written) or bytes.

    Yields
    ------
    file object

    Raises
    ------
    InputError
        If `path` is a folder, or its folder doesn't exist or can't be written to.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     target = pathlib.Path(folder) / "page.html"
    ...     with atomic_write(target) as file:
    ...         _ = file.write("<p>done</p>")
    ...     target.read_text()
    '<p>done</p>'
    """
    target = Path(path)
    if target.is_dir():
        raise InputError(f"{target} is a folder; give the name of a file in it")
    # A plain open() rather than tempfile: the file then gets the permissions that the user's umask asks for.
    temporary = target.with_name(f".{target.name}.{secrets.token_hex(4)}.tmp")
    text: Record = {} if "b" in mode else {"encoding": "utf-8", "newline": ""}
    try:
        file = open(temporary, mode.replace("w", "x"), **text)  # noqa: SIM115
    except OSError as error:
        raise InputError(f"{target} can't be written: {error.strerror}") from None
    try:
        with file:
            yield file
        os.replace(temporary, target)
    except BaseException:
        with contextlib.suppress(FileNotFoundError):
            os.unlink(temporary)
        raise

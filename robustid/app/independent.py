"""The checker of proofs in C (`proof/robustid_proof.c`), another program with numbers of its own, asked from here."""

from __future__ import annotations

import os
import shlex
import shutil
import subprocess
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from robustid.errors import InputError

_NAME, _PLACE = "robustid-proof", "ROBUSTID_PROOF"
_SOURCES = Path(__file__).with_name("robustid_proof.c"), Path(__file__).parents[2] / "proof" / "robustid_proof.c"


class Finding(NamedTuple):
    """Answer of the checker: all statements proved or not, and its lines."""

    proved: bool
    lines: tuple[str, ...]


def checker() -> str:
    """Return the path of the checker: what ROBUSTID_PROOF names, or `robustid-proof` of the PATH.

    InputError: there is none.
    """
    named = os.environ.get(_PLACE)
    found = shutil.which(named or _NAME)
    if found is None:
        source = next((one for one in _SOURCES if one.is_file()), Path("proof", "robustid_proof.c"))
        where = f"{_PLACE} names {named}, which is no program" if named else f"{_NAME} is not on the PATH"
        raise InputError(
            f"`independent` needs the checker of proofs, and {where}; build it with"
            f" cc -O2 -o {_NAME} {shlex.quote(str(source))} -lgmp (Debian: gcc, libgmp-dev), and put it"
            f" on the PATH or name it in {_PLACE}"
        )
    return found


def proved_independently(named: Mapping[str, object]) -> dict[str, bool]:
    """Ask the checker about saved results by their names: whether it proves each of them; InputError as `check_independently`."""
    from robustid.guarantees import proof_texts

    texts = {name: proof_texts(one) for name, one in named.items()}
    return {name: all(check_independently(text).proved for text in own) for name, own in texts.items()}


def check_independently(text: str) -> Finding:
    """Ask the checker about a proof; InputError where there is none, or it can't read the proof."""
    program = checker()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "proof.json"
        path.write_text(text, encoding="ascii")
        done = subprocess.run([program, str(path)], capture_output=True, text=True, check=False)
    lines = tuple(done.stdout.splitlines())
    if done.returncode not in (0, 1) or not lines:
        said = lines[-1] if lines else f"exit status {done.returncode}"
        raise InputError(
            f"`independent`: {program} did not read the proof ({said}); is it of the same version as this package?"
        )
    return Finding(done.returncode == 0, lines)

"""Touchstone files, through scikit-rf."""

from __future__ import annotations

import io
import os
import re
import warnings
from contextlib import redirect_stdout
from pathlib import Path

import numpy as np

from robustid.errors import FileFormatError
from robustid.formats.table import Table, missing, said


def _touchstone_lines(path: Path) -> int:
    """Count the lines that begin a frequency: those with an odd number of numbers. Refuses what would allocate without end."""
    size, odd, options = os.path.getsize(path), 0, 0
    ports = re.fullmatch(r"\.[sgyzh](\d+)p", path.suffix.lower())
    stated = [int(ports[1][:9])] if ports else []
    with path.open(encoding="latin-1") as file:
        for line in file:
            words = line.partition("!")[0].split()
            options += line.lstrip().startswith("#")
            if words[:3] and line.lstrip().lower().startswith(("[number of ports]", "[number of noise")):
                stated += [int(word[:9]) for word in words[-1:] if word.isdigit()]
            elif words and words[0][0] not in "#[":
                odd += len(words) % 2
    if not options:
        raise FileFormatError(
            f"{path.name} has no option line such as '# Hz S RI R 50', which says the unit of its frequencies"
        )
    if any(4 * n * n > size for n in stated[:1]) or any(n > size for n in stated):
        raise FileFormatError(f"{path.name} declares {max(stated)} ports and has {size} bytes only; is it cut off?")
    return odd


def read_touchstone(path: Path) -> Table:
    """S-parameters: outgoing waves b from incoming waves a."""
    try:
        from skrf.io.touchstone import Touchstone
    except ImportError:
        raise missing(path, "scikit-rf", "touchstone") from None
    counts = _touchstone_lines(path)
    try:
        with warnings.catch_warnings(), redirect_stdout(io.StringIO()), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            file = Touchstone(str(path))
    except Exception as error:  # scikit-rf raises whatever the broken bytes lead it to
        raise FileFormatError(
            f"{path.name} can't be read as Touchstone ({said(error)}); is it cut off, or the number of ports in its"
            " ending wrong?"
        ) from None
    if file.parameter != "s":
        raise FileFormatError(
            f"{path.name} holds {str(file.parameter).upper()}-parameters; convert them to S-parameters (scikit-rf does) first"
        )
    lines, ports = len(file.f), int(file.rank or 0)
    rows = 0 if file.noise is None else len(file.noise)
    if not lines or counts != lines + rows:
        raise FileFormatError(
            f"{path.name}: {counts} lines begin a frequency where {lines} frequencies of {ports} x {ports} parameters were"
            " read; is the file cut off, or the number of ports in its ending wrong?"
        )
    table = Table(path, {"freq_hz": np.asarray(file.f), "values": np.asarray(file.s)}, how="Touchstone, S-parameters")
    table.facts["frequency"] = {
        side: [f"{wave}{k + 1}" for k in range(ports)] for side, wave in (("inputs", "a"), ("outputs", "b"))
    }
    return table

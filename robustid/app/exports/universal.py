"""A frequency response as universal file 58: one function for every entry, in the binary form, which keeps all digits."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from robustid.core import Complex, atomic_write
from robustid.data import FrequencyResponse

_RESPONSE, _FREQUENCY, _UNKNOWN = 4, 18, 0  # kinds of functions and of axes
_COMPLEX = 6  # numbers of the ordinate: complex, double precision


def write(path: Path, frf: FrequencyResponse) -> None:
    """Write all entries; bounds have no place in the format. The text form would keep six digits of the frequencies."""
    frf.require_complete("a universal file")
    with atomic_write(path, "wb") as file:
        for output, input in np.ndindex(frf.values.shape[1:]):
            file.write(_function(frf, output, input))


def _function(frf: FrequencyResponse, output: int, input: int) -> bytes:
    """One data set 58b: a line that says what follows, 11 lines of text, then x, Re, Im of every frequency point."""
    value: Complex = frf.values[:, output, input]
    numbers = np.stack([frf.freq_hz, value.real, value.imag], axis=1).astype("<f8").tobytes()
    title = f"{frf.outputs[output]} / {frf.inputs[input]}"
    lines = [
        f"{'58b':>7}{1:6d}{2:6d}{11:12d}{len(numbers):12d}{0:6d}{0:6d}{0:12d}{0:12d}",
        *(f"{text[:80]:<80}" for text in (title, "written by robustid", "NONE", "NONE", "NONE")),
        f"{_RESPONSE:5d}{0:10d}{0:5d}{0:10d} {'NONE':<10}{output + 1:10d}{1:4d} {'NONE':<10}{input + 1:10d}{1:4d}",
        f"{_COMPLEX:10d}{value.size:10d}{0:10d}{0.0:13.5e}{0.0:13.5e}{0.0:13.5e}",
        _axis(_FREQUENCY, "Frequency", "Hz"),
        _axis(_UNKNOWN, frf.outputs[output].name, frf.outputs[output].unit),
        _axis(_UNKNOWN, frf.inputs[input].name, frf.inputs[input].unit),
        _axis(_UNKNOWN, "NONE", "NONE"),
    ]
    text = "\n".join(["    -1", *lines, ""])
    return text.encode("ascii", "replace") + numbers + b"\n    -1\n"


def _axis(kind: int, label: str, unit: str) -> str:
    return f"{kind:10d}{0:5d}{0:5d}{0:5d} {label[:20]:<20} {(unit or 'NONE')[:20]:<20}"

"""A model in numbers: its matrices as text that MATLAB and Python read, or the words on how to keep them."""

from __future__ import annotations

from typing import Any

import numpy as np

from robustid.report.document import Block, Code, Heading, Text
from robustid.report.words import number

_MOST = 400  # numbers in the matrices that are printed
_SAVE = 'rid.save("model.mat", model)'


def matrices_section(name: str, model: Any, dt: float) -> list[Block]:
    """Build the section of the matrices of a `control.StateSpace`."""
    where = f"discrete, sample time {number(dt, 6)} s" if dt else "continuous time"
    size = sum(np.size(getattr(model, part)) for part in "ABCD")
    said = f"{name[0].upper()}{name[1:]}, {where}. As a file for MATLAB or Python: {_SAVE}"
    blocks: list[Block] = [Heading("Model in numbers"), Text(said, code=(_SAVE,))]
    if size > _MOST:
        return [*blocks, Text(f"Its matrices have {size} numbers, too many to be printed here: take the file.")]
    return [
        *blocks,
        Code("\n".join(_printed(part, np.asarray(getattr(model, part))) for part in "ABCD"), id="matrices"),
    ]


def _printed(name: str, matrix: Any) -> str:
    """One matrix in full precision, as MATLAB reads it; row by row."""
    rows = ";\n     ".join(" ".join(repr(float(value)) for value in row) for row in np.atleast_2d(matrix))
    return f"{name} = [{rows}];"

"""Sound files (.wav): a signal a column, in parts of full scale, with the sample rate."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np

from robustid.errors import FileFormatError
from robustid.formats.table import Table, said


def read_sound(path: Path) -> Table:
    """The signals of a sound file, and its samples per second."""
    from scipy.io import wavfile

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", wavfile.WavFileWarning)  # of chunks with titles and notes
            rate, samples = wavfile.read(path)
    except Exception as error:  # scipy raises whatever the broken bytes lead it to
        raise FileFormatError(f"{path.name} can't be read as a sound file ({said(error)}); is it cut off?") from None
    values = np.asarray(samples)
    if not values.size:
        raise FileFormatError(f"{path.name} is a sound file without a sample; write or copy it again")
    values = values[:, None] if values.ndim == 1 else values
    if values.dtype.kind in "iu":
        middle, full = (128, 128) if values.dtype.kind == "u" else (0, 2.0 ** (8 * values.dtype.itemsize - 1))
        values = (values.astype(float) - middle) / full
    names = [f"channel {k + 1}" for k in range(values.shape[1])]
    columns: dict[str, np.ndarray | FileFormatError] = {"fs": np.array([float(rate)])}
    columns |= dict(zip(names, np.ascontiguousarray(values.T.astype(float)), strict=True))
    return Table(path, columns, how=f"sound file, {len(names)} channels in parts of full scale")

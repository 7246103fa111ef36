"""Sizes of signals, so that none dominates a prior on the largest singular value."""

from __future__ import annotations

from collections.abc import Sequence
from typing import cast

import numpy as np

from robustid.core import Real
from robustid.data import FrequencyResponse, TangentialResponse, TimeRecord
from robustid.errors import InputError, InputTypeError
from robustid.identification import MixedProblem

Measured = FrequencyResponse | TimeRecord | TangentialResponse
KINDS = ("signals", "outputs", "inputs", "entries")


def suggest_scaling(data: Measured | Sequence[Measured] | MixedProblem, *, by: str = "signals") -> Real:
    r"""The scaling of a `Prior` for MIMO plants, from the sizes of the data.

    .. math:: S_{ij} = s_i / t_j, \quad \min_{s, t} \sum_{ij} (\log m_{ij} - \log s_i + \log t_j)^2

    with m_ij the median of the response of entry (i, j) over the frequency points that have it. The gain bound K of a prior with
    this scaling is without unit: 1 is as large as the response itself.

    Parameters
    ----------
    data : FrequencyResponse, TimeRecord, a sequence of them, or MixedProblem
        Where no experiment measures entries, sizes are those of the signals: rms of the outputs over rms of the inputs.
    by : {"signals", "outputs", "inputs", "entries"}
        What gets a size of its own: every output and every input; outputs or inputs alone, with one size for the others; or
        every entry, S = m, which costs the model as many copies of its states as S has rank.

    Returns
    -------
    (ny, nu) array
        In output units per input unit.

    Raises
    ------
    InputError, InputTypeError
        Another `by`, no data, an entry that is zero or missing everywhere, tangential data alone.

    Notes
    -----
    A choice, not a measurement: any scaling is legitimate; this one makes the least extreme use of one K.

    Examples
    --------
    >>> import numpy as np, robustid as rid
    >>> values = np.array([[[100.0, 1.0], [2.0, 0.02]]])
    >>> frf = rid.FrequencyResponse([1.0], values, bound=0.01, dt=0.1)
    >>> rid.advise.suggest_scaling(frf).round(6)
    array([[1.e+02, 1.e+00],
           [2.e+00, 2.e-02]])
    """
    if by not in KINDS:
        raise InputError(f"`by` must be one of {KINDS}; got {by!r}")
    sizes = np.log(_sizes(_experiments(data)))
    mean = sizes.mean()
    rows, columns = sizes.mean(axis=1, keepdims=True), sizes.mean(axis=0, keepdims=True)
    if by == "entries":
        return np.exp(sizes)
    if by == "outputs":
        return np.exp(np.broadcast_to(rows, sizes.shape))
    if by == "inputs":
        return np.exp(np.broadcast_to(columns, sizes.shape))
    return np.exp(rows + columns - mean)


def _experiments(data: object) -> list[Measured]:
    if isinstance(data, MixedProblem):
        return [*data.frequency, *data.time]
    items: list[Measured] = []
    for item in cast("Sequence[object]", data) if isinstance(data, list | tuple) else [data]:
        if not isinstance(item, Measured):
            raise InputTypeError(
                f"`data` must be a FrequencyResponse, a TimeRecord, a sequence of them or a MixedProblem; got {type(item).__name__}"
            )
        items.append(item)
    if not items:
        raise InputError("`data` is empty; give at least one experiment")
    return items


def _sizes(items: list[Measured]) -> Real:
    """Size of every entry, (ny, nu), positive."""
    responses = [item for item in items if isinstance(item, FrequencyResponse)]
    records = [item for item in items if isinstance(item, TimeRecord)]
    if responses:
        values = np.concatenate([np.where(f.missing, np.nan, np.abs(f.values)) for f in responses])
        measured = np.isfinite(values).any(axis=0)
        if not measured.all():
            place = tuple(int(k) for k in np.argwhere(~measured)[0])
            raise InputError(
                f"`data`: entry {place} of the matrix is not measured at any frequency point; give the scaling by hand"
            )
        sizes = np.nanmedian(values, axis=0)
    elif records:
        outputs = np.sqrt(np.mean(np.concatenate([r.y for r in records]) ** 2, axis=0))
        inputs = np.sqrt(np.mean(np.concatenate([r.u for r in records]) ** 2, axis=0))
        sizes = np.divide.outer(outputs, np.maximum(inputs, np.finfo(float).tiny))
    else:
        raise InputError("`data`: tangential samples do not show the sizes of entries; give the scaling by hand")
    if not np.all((sizes > 0) & np.isfinite(sizes)):
        place = tuple(int(k) for k in np.argwhere(~((sizes > 0) & np.isfinite(sizes)))[0])
        raise InputError(f"`data`: entry {place} of the matrix is zero; give the scaling by hand")
    return sizes

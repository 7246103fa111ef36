"""The next record: a factor on a band that holds it with a probability, from the scores of records that it was not made from."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from robustid.core import Complex, Real, as_array
from robustid.errors import InputError
from robustid.guarantees.response_discs import ResponseDiscs


class Ranked(NamedTuple):
    """Factor on a band, and the probability with which it then holds one more record; None: none worth stating."""

    factor: float
    probability: float | None


def ranked(scores: ArrayLike, rank: int | None = None) -> Ranked:
    r"""Factor that holds the next record with a probability, whatever the distribution of the records is.

    With scores :math:`s_1 \dots s_R` of R records that the band was not made from, exchangeable with the next one,

    .. math:: P(s_{R+1} \le s_{(k)}) \ge \frac{k}{R + 1}

    for the k-th smallest of them: each of the R + 1 places is as likely as any other.

    Parameters
    ----------
    scores : (R,) array
    rank : int, optional
        k, from 1; default R, the largest score.

    Returns
    -------
    Ranked
        One score gives a factor and no probability: that the next score is the smaller one is worth a coin.

    Notes
    -----
    Source: split conformal prediction, `lei2018` Theorem 2.1.

    Examples
    --------
    >>> from robustid.guarantees import ranked
    >>> ranked([0.7, 1.31, 0.9, 1.1])
    Ranked(factor=1.31, probability=0.8)
    """
    sizes = np.sort(as_array("scores", scores, ndim=1))
    rank = sizes.size if rank is None else rank
    if not sizes.size or not 1 <= rank <= sizes.size:
        raise InputError(f"`rank` must be from 1 to the number of scores; got {rank} of {sizes.size}")
    return Ranked(float(sizes[rank - 1]), rank / (sizes.size + 1) if sizes.size > 1 else None)


def chance_of_order(scores: ArrayLike) -> float:
    """Probability that scores in random order rise, or fall, at least as steadily as these do: Kendall's test, exact.

    Counts the pairs that stand in the wrong order; equal scores count half. 1 where there is nothing to order.

    Examples
    --------
    >>> from robustid.guarantees import chance_of_order
    >>> round(chance_of_order([1.0, 1.1, 1.3, 1.4, 1.7]), 4)  # 2 of the 120 orders
    0.0167
    """
    sizes = as_array("scores", scores, ndim=1)
    count = sizes.size
    pairs = count * (count - 1) // 2
    upper = np.triu_indices(count, 1)
    falls = float(np.sum(np.sign(sizes[:, None] - sizes[None, :])[upper] + 1) / 2)
    orders = np.ones(1)
    for size in range(2, count + 1):
        orders = np.convolve(orders, np.ones(size) / size)  # how often so many pairs are in the wrong order
    nearest = int(np.ceil(min(falls, pairs - falls) - 1e-9))
    return float(min(1.0, 2 * orders[: nearest + 1].sum()))


def band_of_others(bands: Sequence[ResponseDiscs], scores: ArrayLike) -> tuple[Complex, Real, float]:
    r"""ResponseDiscs from leave-one-out scores over all R records: centre and radius (F, ny, nu), and its probability.

    `bands[i]` is made without record i, whose score against it is `scores[i]`. The next record lies in one of the bands times its
    score as a whole with probability at least :math:`1 - 2/(R + 1)`, hence at every frequency in the disc
    that is returned, which holds all of them.

    Notes
    -----
    Source: `barber2021`, Theorem 4 with every fold one record, at :math:`\alpha = 1/(R + 1)`: for sets as for intervals.
    """
    sizes = as_array("scores", scores, ndim=1)
    if len(bands) != sizes.size or sizes.size < 2:
        raise InputError(f"`bands` and `scores` must be one of each, at least two; got {len(bands)} and {sizes.size}")
    centres = np.stack([band.centre for band in bands])
    radii = np.stack([s * band.radius for s, band in zip(sizes, bands, strict=True)])
    real, imag = (
        ((part + radii).max(axis=0) + (part - radii).min(axis=0)) / 2 for part in (centres.real, centres.imag)
    )
    centre = np.asarray(real + 1j * imag, dtype=complex)
    return centre, np.max(np.abs(centres - centre) + radii, axis=0), 1 - 2 / (sizes.size + 1)

"""Power of withheld data: what a sample could have shown, whatever it did show."""

from __future__ import annotations

import enum

import numpy as np

from robustid.core import Real
from robustid.data import FrequencyResponse, joint_radius, variances

NARROW = 3.0  # half-widths of a band that is too narrow at which the true response lies
SURE = 0.95  # probability with which that is to show
_ESTIMATED = ("confidence", "tolerance")  # kinds of bounds beside which a covariance says how errors are distributed


class Judgement(enum.StrEnum):
    """Outcome of holding a band against withheld data."""

    SUPPORTED = "supported"  # inside, and a band three times too narrow would have shown
    CONTRADICTED = "contradicted"
    NOT_TESTED = "not tested"  # inside, and so it would be with a band three times too narrow


def shown(half_width: Real, response: FrequencyResponse) -> Real:
    r"""Probability at least with which each sample contradicts a band of that half-width that is three times too narrow there.

    That is: the true response lies :math:`3 r` from the centre of the disc of radius r. A sample y with the bound
    :math:`\varepsilon` of its own contradicts the disc where :math:`|y - c| > r + \varepsilon`; with
    :math:`y = c + 3 r u + n`, :math:`|u| = 1`, its distance is at least :math:`3 r + \mathrm{Re}(\bar u n)`, so that

    .. math:: P \ge P(\mathrm{Re}(\bar u n) > \varepsilon - 2 r) = T_{2\nu}\big(\sqrt 2\,(2 r - \varepsilon)/\sigma\big)

    for circular normal errors of variance :math:`\sigma^2`, estimated with :math:`\nu` degrees of freedom, T the distribution
    function of Student's t (where everything is real :math:`T_\nu` without the root). Of errors of which only the bound is
    known, :math:`|n| \le \varepsilon`: 1 where :math:`\varepsilon < r`, and 0 else. A sample whose own error is as large as the
    band does not count, and has 0: its bound where only that is known, else what its error alone exceeds with a probability of 5 %.

    Parameters
    ----------
    half_width : (F, ny, nu) array
        Radii r at the frequencies of the response; 0 is contradicted by nothing but a sample without error, NaN is the answer
        where it is infinite.
    response : FrequencyResponse
        With the bound and the covariance of the samples.

    Returns
    -------
    (F, ny, nu) array
        NaN where nothing was measured, or the band says nothing.

    Notes
    -----
    The power of a test in the sense of Neyman and Pearson, against one alternative, from below: neighbouring samples that would
    show the same are not counted. Quantiles are those of the bounds (`joint_radius`).

    Examples
    --------
    >>> import numpy as np, robustid as rid
    >>> from robustid.guarantees import shown
    >>> three = rid.FrequencyResponse([1.0, 2.0, 3.0], [1.0, 1.0, 1.0], bound=[0.05, 0.1, 0.2], dt=0.1)
    >>> shown(np.full((3, 1, 1), 0.1), three).ravel().tolist()
    [1.0, 0.0, 0.0]
    """
    from scipy.special import ndtr, stdtr

    bound = response.bound
    known = ~response.missing & np.isfinite(half_width)
    if bound is None:
        return np.where(known, (half_width > 0) * 1.0, np.nan)
    own = np.where(known, bound.outer_radius, 0.0)
    room = np.where(known, 2 * half_width, 0.0) - own
    if response.covariance is None or bound.kind not in _ESTIMATED:
        return np.where(known, (room > own) * 1.0, np.nan)
    real = response.all_real
    size = np.sqrt(np.maximum(variances(response.covariance, response.values.shape), 0.0))
    alone = joint_radius(SURE, 1, bound.dof, real) * size
    parts = np.where(real, 1, 2)[:, None, None]
    scaled = room / np.maximum(np.where(known, size, 1.0) / np.sqrt(parts), np.finfo(float).tiny)
    found = ndtr(scaled) if bound.dof is None else stdtr(parts * bound.dof, scaled)
    return np.where(known, np.where(alone < half_width, found, 0.0), np.nan)

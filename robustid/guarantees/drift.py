"""The alarm of a drift: ranks of scores as e-values, and the detector that adds them up; a stated rate of false alarms."""

from __future__ import annotations

import bisect
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from robustid.core import Real, as_array, freeze
from robustid.errors import InputError

POWERS = freeze(
    np.array([0.05, 0.1, 0.2, 0.3, 0.5, 0.7])
)  # of the calibrators: few records are told best by small ones
_LARGEST_RATE = 0.5


class Drift(NamedTuple):
    """Evidence against exchangeability, record by record: e-values, the detector's sums and the records at which it alarms.

    After an alarm the detector begins anew.
    """

    e_values: Real
    sums: Real
    alarms: NDArray[np.bool_]


def drift(usual: ArrayLike, scores: ArrayLike, rate: float) -> Drift:
    r"""Evidence that scores are larger than those before them, whatever their distribution: at most `rate` false alarms a record.

    While all scores are exchangeable, the rank :math:`R_n` of the n-th among the first n (1: the largest) is uniform and
    independent of the ranks before it. For a decreasing function f,

    .. math:: e_n = \frac{f(R_n/n)}{\frac1n \sum_{j=1}^n f(j/n)}, \qquad E[e_n \mid R_1 \dots R_{n-1}] = 1,
        \qquad M_n = e_n (1 + M_{n-1})

    so that :math:`M_n - n` is a martingale, and :math:`M_n \ge 1/\alpha` happens after at least :math:`1/\alpha` records on
    average. The mean of such sums over several f (:math:`f(p) = p^{\kappa - 1}`) is one again. Equal scores count as larger ones,
    which only makes the sums smaller.

    Parameters
    ----------
    usual : (U,) array
        Scores of records from before the watch, while the machine was as it should be.
    scores : (R,) array
        In the order of the records.
    rate : float
        alpha, above 0 and at most 1/2: on average at most one false alarm in 1/alpha records.

    Returns
    -------
    Drift
        Arrays (R,): e-values (mean over f of the steps), sums and alarms.

    Notes
    -----
    Source: e-detectors, `shin2024` section 2; independence of the ranks, `vovk2005` chapter 7.

    Examples
    --------
    >>> from robustid.guarantees.drift import drift
    >>> usual = [0.70, 0.81, 0.64, 0.77, 0.69, 0.83, 0.72, 0.75, 0.66, 0.79]
    >>> drift(usual, [0.74, 0.71, 1.9, 2.1, 2.0, 2.2, 2.3], rate=0.05).alarms.tolist()
    [False, False, False, True, False, False, True]
    """
    before, new = as_array("usual", usual, ndim=1), as_array("scores", scores, ndim=1)
    check_rate(rate)
    ordered = sorted(before.tolist())
    sums = np.zeros(POWERS.size)
    e_values, shown, alarms = np.empty(new.size), np.empty(new.size), np.zeros(new.size, dtype=bool)
    for n, score in enumerate(new.tolist()):
        place = bisect.bisect_left(ordered, score)
        ordered.insert(place, score)
        steps = _steps(len(ordered) - place, len(ordered))
        sums = steps * (1 + sums)
        e_values[n], shown[n] = steps.mean(), sums.mean()
        if sums.mean() >= 1 / rate:
            alarms[n], sums = True, np.zeros(POWERS.size)
    return Drift(freeze(e_values), freeze(shown), freeze(alarms))


def check_rate(rate: float) -> float:
    """Return a rate of false alarms a record, refused where it is none."""
    if not 0 < rate <= _LARGEST_RATE:
        raise InputError(
            f"`rate` must be above 0 and at most 1/2, false alarms in a record; got {rate:.4g}", argument="rate"
        )
    return rate


def fewest_to_alarm(usual: int, rate: float) -> int | None:
    """Return how many records in a row, each with a larger score than all before it, give an alarm; None: more than 1000."""
    sums = np.zeros(POWERS.size)
    for n in range(1, 1001):
        sums = _steps(1, usual + n) * (1 + sums)
        if sums.mean() >= 1 / rate:
            return n
    return None


def _steps(rank: int, count: int) -> Real:
    """e-values of a rank among so many, for every calibrator."""
    shares = np.arange(1, count + 1)[:, None] / count
    return (rank / count) ** (POWERS - 1) / np.mean(shares ** (POWERS - 1), axis=0)

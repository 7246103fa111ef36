"""Weights of a prior: from a table of frequencies and levels; a roll-off, where the data show one."""

from __future__ import annotations

import itertools
import logging
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from robustid.advice.gain_curve import representatives
from robustid.advice.prior import suggest_prior
from robustid.advice.smallest_gain import response_sizes, selected, smallest_gain, without_doubt
from robustid.core import Real, as_array, as_kind, as_positive, plane_of
from robustid.errors import InputError
from robustid.guarantees import magnitude_weight
from robustid.identification import MixedProblem, Prior, from_image

if TYPE_CHECKING:
    import control

_log = logging.getLogger("robustid")

_ORDERS = (2, 1)  # of a roll-off
_STEPS = 8  # corners from the highest frequency down, by sqrt(2)
_GROWTH = 1.25  # of the smallest gain bound: what the roll-off may cost
_LEFT = 0.5  # of the bound at the highest frequency: what falls less says nothing
_PARTS = 8  # of the interval between two rows of the table: jumps between neighbours are what the fit cannot undercut


def prior_weight(
    omega: ArrayLike, level: ArrayLike, *, dt: float | None = None, order: int | None = None, tightness: float = 1.5
) -> control.StateSpace:
    r"""Return a small stable minimum-phase W above a table, for `Prior` (`weight`).

    .. math:: |W(j\omega)| \ge \text{level}(\omega), \qquad \text{or } |W(e^{j\omega T})|, \quad \text{at all frequencies}

    Between two rows of the table straight lines in logarithms of frequency and level, before the first row and behind the last
    one their levels.

    Parameters
    ----------
    omega : (F,) array, rad/s
        Rising, from 0 or above, up to pi/dt.
    level : (F,) array
        Positive: how large the non-parametric part may be there, over the `gain_bound` of the prior.
    dt : float, s, optional
        Sample time of the data; left out for data of continuous time.
    order : int, optional
        Of W, at most. Default: the smallest that stays within `tightness` of the table, as in `magnitude_weight`; up to 12.
    tightness : float
        Above 1.

    Returns
    -------
    control.StateSpace
        Proved to be above the table on the whole circle or axis.

    Raises
    ------
    InputError
        Shapes that do not fit, fewer than two rows, frequencies that do not rise or exceed pi/dt, levels that are not positive.

    Notes
    -----
    The prior bounds the non-parametric part beyond the frequencies, on Re s = -alpha or |z| = 1/rho; the table holds there.

    Examples
    --------
    >>> import robustid as rid
    >>> weight = rid.advise.prior_weight([1.0, 10.0, 100.0], [1.0, 1.0, 0.01])
    >>> rid.Prior(gain_bound=0.2, decay=0.5, weight=weight).weighted, bool(abs(weight(100j)) >= 0.01)
    (True, True)
    """
    dt = None if dt is None else as_positive("dt", dt)
    omega, level = _table(omega, level, np.inf if dt is None else np.pi / dt)
    plane = plane_of(dt, omega)
    edges, levels = _finer(omega, level)
    edges, levels = np.concatenate([[0.0], edges, [plane.top]]), np.concatenate([levels[:1], levels, levels[-1:]])
    keep = np.append(True, np.diff(plane.angles(edges)) > 0)
    edges, levels = edges[keep], levels[keep]
    found = magnitude_weight(
        plane.angles(edges), np.maximum(levels[:-1], levels[1:]), dt=1.0, order=order, tightness=tightness
    ).model
    if dt is None:
        return from_image(found, plane)
    import control

    return control.StateSpace(found.A, found.B, found.C, found.D, dt, remove_useless_states=False)


def _finer(omega: Real, level: Real) -> tuple[Real, Real]:
    """The table with further rows, on straight lines in logarithms; up from 0 the larger one of the two levels."""
    fine: list[Real] = [omega[:1]]
    for low, high in itertools.pairwise(omega.tolist()):
        fine.append(np.asarray(np.geomspace(low, high, _PARTS + 1)[1:] if low > 0 else [high], dtype=float))
    edges = np.concatenate(fine)
    inside = omega > 0
    levels = np.exp(
        np.interp(np.log(np.maximum(edges, omega[inside][0])), np.log(omega[inside]), np.log(level[inside]))
    )
    levels[0] = level[0]
    return edges, levels


def _table(omega: ArrayLike, level: ArrayLike, top: float) -> tuple[Real, Real]:
    """Both columns, checked."""
    omega, level = as_array("omega", omega, ndim=1), as_array("level", level, ndim=1)
    if omega.shape != level.shape or omega.size < 2:
        raise InputError(
            f"`omega` and `level` must have as many rows, two at least; got {omega.size} frequencies and {level.size} levels"
        )
    if omega[0] < 0 or np.any(np.diff(omega) <= 0):
        raise InputError(
            "`omega` must rise from 0 or above, in rad/s; sort the table, and leave repeated frequencies out"
        )
    if omega[-1] > top * (1 + 1e-12):
        raise InputError(f"`omega` must not exceed pi/dt = {top:g} rad/s; got {omega[-1]:g}")
    if not np.all(level > 0):
        raise InputError(f"`level` must be positive (not in dB); got a smallest one of {level.min():g}")
    return omega, level


def suggest_roll_off(problem: MixedProblem) -> Prior | None:
    """Propose the steepest roll-off at which the non-parametric part fits the data with hardly a larger gain bound.

    At the decay of the problem's prior the smallest gain bound K is computed without and with roll-offs of order 1 and 2, their
    corner lower and lower, as long as K grows by no more than a quarter. What falls most up to the highest frequency is proposed,
    with twice the smallest K.

    Parameters
    ----------
    problem : MixedProblem
        Data of frequency responses, modes, and the class whose decay is kept; its gain bound has no meaning.

    Returns
    -------
    Prior or None
        None where no roll-off leaves less than half at the highest frequency, or the parametric part alone fits.

    Raises
    ------
    InputTypeError, InputError
        Not a problem; no frequency response; a prior that has a weight already.

    Notes
    -----
    A proposal about what lies above the data too, hence only for plants that have no modes there: data can refute it, never prove
    it.

    Examples
    --------
    >>> import numpy as np, robustid as rid
    >>> omega = np.linspace(1.0, 60.0, 10)
    >>> frf = rid.FrequencyResponse(omega, 1 / (1 + 1j * omega / 8) ** 2, bound=0.002)
    >>> found = rid.advise.suggest_roll_off(rid.MixedProblem(frequency=frf, prior=rid.Prior(gain_bound=1.0, decay=4.0)))
    >>> found.roll_off, bool(4 < found.corner < 20)
    (2, True)
    """
    as_kind("problem", problem, MixedProblem, "a MixedProblem")
    if not problem.frequency:
        raise InputError("`problem` has no frequency response, in which a roll-off could be seen")
    if problem.prior.weighted:
        raise InputError("`problem` has a prior with a roll-off or a weight already; give it one without")
    problem = without_doubt(problem)
    masks = representatives(problem)
    part = problem if masks is None else selected(problem, masks)
    rate, top = problem.prior.rate, float(max(f.omega.max() for f in problem.frequency))
    plain = smallest_gain(part, rate)
    if not response_sizes(problem)[1] < plain < np.inf:
        return None
    found, least = None, _LEFT
    for order in _ORDERS:
        for step in range(_STEPS):
            falling = part.with_prior(roll_off=order, corner=top * 2.0 ** (-step / 2))
            gain = smallest_gain(falling, rate)
            _log.info("roll-off %d above %.6g rad/s: smallest gain bound %.6g", order, falling.prior.corner, gain)
            if not gain <= _GROWTH * plain:
                break
            left = float(falling.weighting.sizes(falling.plane.angles(np.array([top])))[0])
            if left < least:
                found, least = falling.prior, left
    if found is None:
        return None
    return suggest_prior(problem.with_prior(roll_off=found.roll_off, corner=found.corner), decay_rates=[rate]).prior

"""suggest_roll_off(): a bound that falls with the frequency, where the data show one."""

from __future__ import annotations

import logging

import numpy as np

from robustid.advice.gains import response_sizes, smallest_gain
from robustid.advice.prior import representatives, suggest_prior
from robustid.advice.representatives import selected
from robustid.core import as_kind
from robustid.errors import InputError
from robustid.identification import MixedProblem, Prior

_log = logging.getLogger("robustid")

_ORDERS = (2, 1)
_STEPS = 8  # corners from the highest frequency down, by sqrt(2)
_GROWTH = 1.25  # of the smallest gain bound: what the roll-off may cost
_LEFT = 0.5  # of the bound at the highest frequency: what falls less says nothing


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
    >>> omega = np.linspace(1.0, 60.0, 30)
    >>> frf = rid.FrequencyResponse(omega, 1 / (1 + 1j * omega / 8) ** 2, bound=0.002)
    >>> found = rid.suggest_roll_off(rid.MixedProblem(frequency=frf, prior=rid.Prior(gain_bound=1.0, decay=4.0)))
    >>> found.roll_off, bool(4 < found.corner < 20)
    (2, True)
    """
    as_kind("problem", problem, MixedProblem, "a MixedProblem")
    if not problem.frequency:
        raise InputError("`problem` has no frequency response, in which a roll-off could be seen")
    if problem.prior.weighted:
        raise InputError("`problem` has a prior with a roll-off or a weight already; give it one without")
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

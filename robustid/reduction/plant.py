"""reduce_plant(): the smallest model of a plant in a loop that its controller stabilises, and whose R keeps every bound.

Right factors of a plant are stable whatever it is: the balanced truncation of normalised ones drops the states that matter least
in the gap metric (`zhou1996`, section 19.4).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from robustid.core import (
    Budget,
    Frozen,
    Interruptible,
    Progress,
    Real,
    Record,
    StateMatrices,
    closed_loop,
    decay_of,
    loop_factors,
    loop_is_stable,
    normalised_factors,
    one_thread,
    poles_of,
    right_quotient,
)
from robustid.data import FrequencyResponse
from robustid.errors import InputError, RobustIdError
from robustid.fitting import fit_mfd
from robustid.identification import Identification, Loop, largest_ratio
from robustid.reduction.balanced import balanced_truncation, balanced_truncations

if TYPE_CHECKING:
    import control

    Margin = Callable[[control.StateSpace], float]  # of an R

_CANCELS = 1e-9  # of the largest Hankel singular value: states below cancel
_SAME = 1e-6  # of its bound: what the margin of the nominal model may be exceeded by
_LARGEST_FIT, _NEAR, _ROUNDS = (
    20,
    3.0,
    8,
)  # states; times the limit at which a fit is drawn inside, by so many changes of its weights


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class PlantReduction(Frozen):
    """A small model of a plant in a loop.

    Attributes
    ----------
    model : control.StateSpace
        Of the plant, stable or not; the controller that ran stabilises it.
    residual : control.StateSpace
        Its R.
    order : int
        States of the model.
    margin : float
        Largest part of any sample's bound that R misses it by: at most 1, or what the data contradict their class by.
    loop_poles : (n,) complex array
        Of the controller and the model.
    finished : bool
        False if the time was over, or Ctrl-C came, before every smaller order was tried.
    """

    model: control.StateSpace
    residual: control.StateSpace
    order: int
    margin: float
    loop_poles: np.ndarray
    finished: bool = True

    def __repr__(self) -> str:
        return f"<PlantReduction: order {self.order}, margin {self.margin:.4g}>"


def plant_of(loop: Loop, residual: control.StateSpace) -> control.StateSpace:
    """The plant P(R) without the states that cancel, which are stable: those that neither inputs move nor outputs show."""
    return balanced_truncation(loop.plant_of(residual), tol=_CANCELS, unstable="keep").model


@one_thread()
def reduce_plant(
    identification: Identification,
    loop: Loop,
    *,
    residual: control.StateSpace | None = None,
    time_limit: float | None = None,
    progress: Progress | None = None,
) -> PlantReduction:
    """The smallest model of the plant that the controller stabilises, and whose R keeps every sample within its bound.

    Where there is a frequency response, least-squares fits of that of the plant are tried, from order one upwards, and drawn inside
    by their weights. Else, or if none is, normalised factors of P(R) are truncated, until R of what is left is stable and inside.

    Parameters
    ----------
    identification : Identification
        Of the stable system R of the loop.
    loop : Loop
        The controller that ran, with its auxiliary plant.
    residual : control.StateSpace, optional
        The model of R to begin with. Default: that of the identification.
    time_limit : float, optional
        Seconds after which the smallest one so far is taken; so does Ctrl-C.
    progress : callable (text, done, count), optional
        Of the orders that are tried.

    Returns
    -------
    PlantReduction

    Raises
    ------
    InputError
        If signals do not fit.

    References
    ----------
    `zhou1996`, section 19.4; `tay1989`.

    Examples
    --------
    >>> import control, numpy as np, robustid as rid
    >>> plant, gain = control.ss(1.1, 1.0, 1.0, 0.0, 0.01), control.ss([], [], [], 0.5, 0.01)
    >>> loop = rid.Loop(gain)
    >>> R, omega = loop.residual_of(plant), np.linspace(5.0, 300.0, 30)
    >>> closed = rid.FrequencyResponse(omega, [R(np.exp(0.01j * w)) for w in omega], bound=0.02, dt=0.01)
    >>> result = rid.identify(rid.MixedProblem(frequency=closed, prior=rid.Prior(gain_bound=10.0, decay_rate=1.4)))
    >>> found = rid.reduce_plant(result, loop)
    >>> found.order, bool(abs(found.model.poles()[0] - 1.1) < 0.02)
    (1, True)
    """
    start = identification.model if residual is None else residual
    if start.D.shape != loop.shape[::-1]:
        raise InputError(f"`identification` must be of the R of `loop`, {loop.shape[1]} x {loop.shape[0]}")
    limit = max(1.0, largest_ratio(identification.problem, start)) * (1 + _SAME)

    def margin(model: control.StateSpace) -> float:
        return largest_ratio(identification.problem, model)

    responses = [one for one in identification.problem.frequency if isinstance(one, FrequencyResponse)]
    budget, found = Budget(time_limit, progress, "searching for the smallest plant"), None
    with Interruptible() as search:
        if responses:
            found = fitted_plant(loop, responses[0], margin, limit, budget)
        if found is None or found.margin > limit:
            found = None
            found = _truncated(loop, start, margin, limit, budget)
            if responses:
                found = _below(loop, loop.plant_response(responses[0]), found, margin, limit, budget)
    if found is None:
        found = _whole(loop, start, margin)
    return dataclasses.replace(found, finished=not (search.interrupted or budget.over))


def _whole(loop: Loop, start: control.StateSpace, margin: Margin) -> PlantReduction:
    """The plant of R without the states that cancel."""
    whole = plant_of(loop, start)
    poles = poles_of(closed_loop(StateMatrices.of(whole), loop.as_controller(loop.controller)).A)
    return PlantReduction(whole, start, whole.nstates, margin(start), poles)


def _truncated(loop: Loop, start: control.StateSpace, margin: Margin, limit: float, budget: Budget) -> PlantReduction:
    """The smallest truncation of the factors of the plant that is inside."""
    whole = plant_of(loop, start)
    try:
        factors = normalised_factors(StateMatrices.of(whole), loop.dt)
    except (np.linalg.LinAlgError, InputError):  # poles that almost cancel, on or outside the stability boundary
        factors = loop_factors(StateMatrices.of(whole), loop.as_controller(loop.controller), loop.dt)
        nu = loop.shape[0]
        factors = StateMatrices(factors.A, factors.B[:, :nu], factors.C, factors.D[:, :nu])

    truncate, nu = balanced_truncations(factors.model(loop.dt)), loop.shape[0]
    for order in range(len(factors.A)):
        if budget.over:
            break
        budget.tell(order, len(factors.A))
        small = StateMatrices.of(truncate(order).model)
        if np.linalg.cond(small.D[:nu]) > 1 / _CANCELS:  # not proper
            continue
        found = _judged(loop, right_quotient(small, nu), margin)
        if found is not None and found.margin <= limit:
            return found
    return _whole(loop, start, margin)


def fitted_plant(
    loop: Loop, frf: FrequencyResponse, margin: Margin, limit: float, budget: Budget
) -> PlantReduction | None:
    """The smallest fit of the plant's response that the controller stabilises and that keeps a limit; else the best one.

    `frf` is that of R. Fits begin anew, order by order; then at truncations of the best one, below its order.
    """
    own, best = loop.plant_response(frf), None
    most = min(_LARGEST_FIT, own.omega.size // 3)
    for order in range(1, most + 1):
        if budget.over:
            break
        budget.tell(order - 1, most)
        found = _drawn(loop, own, order, None, margin, limit, budget)
        best = found if found is not None and (best is None or found.margin < best.margin) else best
        if best is not None and best.margin <= limit:
            break
    return best if best is None else _below(loop, own, best, margin, limit, budget)


def _below(
    loop: Loop, own: FrequencyResponse, best: PlantReduction, margin: Margin, limit: float, budget: Budget
) -> PlantReduction:
    """A fit of lower order that begins at a truncation of a plant, if one keeps the limit; else the plant."""
    plant = StateMatrices.of(best.model)
    try:
        factors = normalised_factors(plant, loop.dt)
    except (np.linalg.LinAlgError, InputError):
        return best
    truncate, nu = balanced_truncations(factors.model(loop.dt)), loop.shape[0]
    for order in range(1, best.order):
        if budget.over:
            break
        small = StateMatrices.of(truncate(order).model)
        if np.linalg.cond(small.D[:nu]) > 1 / _CANCELS:
            continue
        found = _drawn(loop, own, order, right_quotient(small, nu).model(loop.dt), margin, limit, budget)
        if found is not None and found.margin <= limit:
            return found
    return best


def _drawn(
    loop: Loop,
    own: FrequencyResponse,
    order: int,
    model: control.StateSpace | None,
    margin: Margin,
    limit: float,
    budget: Budget,
) -> PlantReduction | None:
    """A fit of the plant's response; near to the limit it is drawn to it by larger weights where it misses most."""
    best: PlantReduction | None = None
    weight: Real = 1 / own.bound.outer_radius
    now, first = weight, model is None
    for turn in range(_ROUNDS):
        if budget.over:
            break
        try:
            how: Record = {
                "time_limit": budget.seconds,
                "stable": False,
                "weight": now,
                "restart": first and turn == 0,
                "start": model,
            }
            fit = fit_mfd(own, order=order, **how)
            found = _judged(loop, StateMatrices.of(fit.model), margin)
        except (RobustIdError, np.linalg.LinAlgError):  # too few points for so many states
            break
        best = found if found is not None and (best is None or found.margin < best.margin) else best
        if found is None or found.margin <= limit or found.margin > _NEAR * limit:
            break
        model = fit.model
        missed = weight * np.abs(loop.response_of(fit.model, own.omega) - own.values)
        now = now * np.sqrt(missed / missed.max() + _SAME)
    return best


def _judged(loop: Loop, plant: StateMatrices, margin: Margin) -> PlantReduction | None:
    """The plant with its R, if the controller stabilises it."""
    poles = poles_of(closed_loop(plant, loop.as_controller(loop.controller)).A)
    if not loop_is_stable(poles, loop.dt):
        return None
    model = plant.model(loop.dt)
    residual = loop.residual_of(model)
    if decay_of(residual.poles(), loop.dt) <= 0:  # a state that cancels only almost
        return None
    return PlantReduction(model, residual, len(plant.A), margin(residual), poles)

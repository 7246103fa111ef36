"""fit_records(): a model from time records with their transients, alone or beside a frequency response."""

from __future__ import annotations

import functools
import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from robustid.core import (
    Budget,
    Interruptible,
    Progress,
    Real,
    StateMatrices,
    as_count,
    as_flag,
    as_float,
    one_thread,
    threads_for,
)
from robustid.data import FrequencyResponse, TimeRecord
from robustid.errors import InputError
from robustid.fitting.fraction.fraction_iteration import FitStatus, counted_steps, former, former_weight
from robustid.fitting.records.record_fit import RecordFit
from robustid.fitting.records.record_starts import starts
from robustid.fitting.records.record_statement import (
    Experiments,
    Noise,
    checked_records,
    checked_response,
    fit_driven,
    given_levels,
    given_start,
    posed,
)
from robustid.fitting.state_space.block_model import BlockModel
from robustid.fitting.state_space.projected_outputs import Outputs
from robustid.fitting.state_space.state_refinement import Refined, Report, refine
from robustid.identification import Loop, loop_noise

if TYPE_CHECKING:
    import control

_BRIEF, _STEPS = 15, 100  # steps from every start, twice, and from the best of them
_WEIGHTINGS = 3  # times that the levels of the residuals are taken anew, at most
_SAME_LEVELS = 0.05  # relative differences between levels that are not worth another refinement
_ENDED = (FitStatus.INTERRUPTED, FitStatus.TIME)


@one_thread()
def fit_records(
    records: TimeRecord | Sequence[TimeRecord],
    *,
    order: int,
    frf: FrequencyResponse | control.FRD | None = None,
    loop: Loop | None = None,
    feedthrough: bool = False,
    stable: bool = True,
    offset: bool = False,
    delay: float | None = None,
    weight: ArrayLike | None = None,
    start: control.StateSpace | None = None,
    time_limit: float | None = None,
    progress: Progress | None = None,
) -> RecordFit:
    """Fit a discrete model to records with their transients: least squares of the output error over all samples.

    The model is simulated, not its one-step prediction, from an initial state that is fitted with it. Difference equations of
    several lengths, reduced by balancing, and subspace estimates of the records' frequency response are the starts; from the
    best of them Levenberg-Marquardt as in `fit_mfd`, on the spectral lines of the records, where this criterion is the
    same (Parseval) and an initial state is one input more.

    Parameters
    ----------
    records : TimeRecord or sequence of TimeRecord
        Experiments with the same `dt` and signals, of any length. Each begins as its `initial` says: at zero initial
        conditions, from a state that is fitted ("free"), or in periodic steady state. Bounds aren't used.
    order : int
        Number of states.
    frf : FrequencyResponse or control.FRD, optional
        Fitted together with the records: same `dt`, inputs and outputs.
    loop : Loop, optional
        The controller that ran: the model is that of the stable R, and `Loop.plant_of` makes the plant of it. White noise v of the
        plant's outputs is ``(D~_x - R N~_c) v`` in those of R, and every frequency counts by that; `weight`, levels and cost are
        those of v. A response beside the records is that of R.
    feedthrough : bool
        Whether the input acts on the output in the same sample.
    stable : bool
        Keep the poles inside the unit circle.
    offset : bool
        Fit a constant for every record and output, too. Else take operating points away first, by `detrend`.
    delay : float, s, optional
        Of the inputs, in whole samples (with records in periodic steady state: any); it is taken out of the data.
    weight : (ny,) array, optional
        Weight of the records' residual, per output. Default: the inverse of the residual's level, which is found by fitting
        twice, so that every output and the frequency response count by their noise. The response has its default weight of
        `fit_mfd`, to that level, or as it is where its covariance is known.
    start : control.StateSpace, optional
        Where to start instead, a model of this order.
    time_limit : float, optional
        Seconds after which the best model so far is returned, with the status that says so; so does Ctrl-C.
    progress : callable (text, done, count), optional
        As in `fit_mfd`.

    Returns
    -------
    RecordFit

    Raises
    ------
    InputError, InputTypeError
        Records that don't belong together, with unused samples, or too short for the order; wrong arguments.

    Notes
    -----
    Source: `pintelon2012` chapter 6 for transients as inputs.

    Examples
    --------
    >>> import control, numpy as np, robustid as rid
    >>> rng = np.random.default_rng(0)
    >>> plant = control.ss([[0.8, 0.5], [-0.5, 0.8]], [[0], [1]], [[1, 0]], 0, 0.1)
    >>> u = rng.standard_normal(60)
    >>> y = control.forced_response(plant, U=u, X0=[3, 1]).outputs
    >>> fit = rid.fit_records(rid.TimeRecord(u, y, dt=0.1, initial="free"), order=2)
    >>> fit.poles.round(6), fit.fit_percent.round(3)
    (array([0.8+0.5j, 0.8-0.5j]), array([[100.]]))
    """
    budget = Budget(time_limit)
    order = as_count("order", order, least=1)
    experiments = checked_records(records)
    noise = None
    if loop is not None:
        if delay is not None:
            raise InputError("`delay` must be left out with a `loop`: a delay of the plant is none of its R")
        experiments = tuple(loop.opened(record) for record in experiments)
        noise = functools.partial(loop_noise, loop)
    response = None if frf is None else checked_response(frf, experiments[0])
    seconds = 0.0 if delay is None else as_float("delay", delay)
    if seconds:
        experiments = tuple(record.without_delay(seconds) for record in experiments)
        response = None if response is None else response.without_delay(seconds)
    feedthrough, stable = as_flag("feedthrough", feedthrough), as_flag("stable", stable)
    question = posed(experiments, response, order, feedthrough, as_flag("offset", offset))
    given = None if weight is None else given_levels(weight, question.size.size)
    if start is None:
        candidates = starts(experiments, response, order, feedthrough, budget)
    else:
        candidates = iter([given_start(start, order, experiments[0])])
    with threads_for(order * question.inputs):
        found, levels, outputs = _fitted(question, given, noise, candidates, stable, budget, counted_steps(progress))
    return _result(question, experiments, outputs, found, levels, seconds)


def _fitted(
    question: Experiments,
    given: Real | None,
    noise: Noise | None,
    candidates: Iterator[tuple[Real, Real]],
    stable: bool,
    budget: Budget,
    report: Report | None,
) -> tuple[Refined, Real, Outputs]:
    """End of the descent from the best start; the levels that its criterion has, and that criterion."""
    found, levels = _best_start(question, given, candidates, stable, budget)
    history, rounds = former(found.history, former_weight(1)), 1
    while True:
        if noise is not None:
            question = question.whitened(noise, found.fitted, levels[:-1])
            levels = _levels(question, Outputs(question.criterion(levels[:-1], float(levels[-1]))), found, given)
        outputs = Outputs(question.criterion(levels[:-1], float(levels[-1])))
        found = _descended(outputs, found, stable, budget, report)
        before, levels = levels, _levels(question, outputs, found, given)
        same = (noise is None or rounds > 1) and bool(np.all(np.abs(levels - before) <= _SAME_LEVELS * before))
        if found.status in _ENDED or same or rounds == _WEIGHTINGS:
            return found._replace(history=history + found.history), before, outputs
        history += former(found.history, former_weight(rounds + 1))
        rounds += 1


def _descended(outputs: Outputs, found: Refined, stable: bool, budget: Budget, report: Report | None) -> Refined:
    """The end of the descent from the best so far: in patience, where the first part of it ended slowly."""
    stopped = FitStatus.TIME if budget.over else None
    stopped = FitStatus.INTERRUPTED if found.status is FitStatus.INTERRUPTED else stopped
    limit = _STEPS if stopped is None else 0
    descend = functools.partial(refine, outputs.criterion, stable=stable, limit=limit, budget=budget, report=report)
    end = descend(found.fitted.model)
    if stopped is not None:
        return end._replace(status=stopped)
    if end.status is not FitStatus.SLOW or budget.over:
        return end
    more = descend(end.fitted.model, patient=True)
    return more._replace(history=end.history + more.history)


def _best_start(
    posed: Experiments, given: Real | None, candidates: Iterator[tuple[Real, Real]], stable: bool, budget: Budget
) -> tuple[Refined, Real]:
    """The lowest end of a few steps from every start, and the levels of its residual: steps with all outputs weighted by their
    size, then by the levels of their own residual. The lowest is the one of the greatest likelihood, the smallest product of
    these levels.
    """
    best, lowest = None, math.inf
    with Interruptible(lambda: best is not None) as search:
        for A, C in candidates:
            levels = np.append(posed.size if given is None else given, 1.0)
            outputs = Outputs(posed.criterion(levels[:-1], 1.0))
            model = BlockModel.of(A, fit_driven(outputs.criterion, A, C), discrete=True)
            if stable:
                inside, xi = model.reflected(), outputs.criterion.xi
                model = min(inside, inside.resolved(xi), key=lambda one: outputs.fitted(one).cost)
            first = refine(outputs.criterion, model, stable=stable, limit=_BRIEF, budget=budget)
            outputs, _ = _weighted(posed, outputs, first, given)
            limit = 0 if budget.over and first.history else _BRIEF
            one = refine(outputs.criterion, first.fitted.model, stable=stable, limit=limit, budget=budget)
            outputs, levels = _weighted(posed, outputs, one, given)
            height = posed.height(outputs, outputs.fitted(one.fitted.model))
            if best is None or height < lowest:
                best, lowest = (one._replace(history=first.history + one.history), levels), height
            if one.status is FitStatus.INTERRUPTED:
                break
    if search.interrupted and best is not None:
        best = best[0]._replace(status=FitStatus.INTERRUPTED), best[1]
    if best is None:
        raise InputError("`records` gave no first model of this `order`; lower it, or give a `start`")
    return best


def _weighted(posed: Experiments, outputs: Outputs, found: Refined, given: Real | None) -> tuple[Outputs, Real]:
    """The criterion in the levels of a residual, and these levels."""
    levels = _levels(posed, outputs, found, given)
    return Outputs(posed.criterion(levels[:-1], float(levels[-1]))), levels


def _levels(posed: Experiments, outputs: Outputs, found: Refined, given: Real | None) -> Real:
    """Levels of the residual of every output, and of the frequency response."""
    levels, response = posed.levels(outputs, found.fitted)
    return np.append(levels if given is None else given, response)


def _result(
    posed: Experiments, records: tuple[TimeRecord, ...], outputs: Outputs, found: Refined, levels: Real, delay: float
) -> RecordFit:
    """The fit in the units of the data, with the states at the first samples."""
    fitted, plant = found.fitted, posed.plant(found.fitted)
    A, B, C, _ = fitted.state_space(1.0)
    states: list[Real] = []
    offsets = np.zeros((len(records), len(C)))
    cost = 0.0
    for number, (line, record, block, residual) in enumerate(
        zip(posed.lines, records, outputs.criterion.blocks, outputs.residuals(fitted), strict=False)
    ):
        cost += float(np.linalg.norm(block.weight.apply(residual))) ** 2
        column = np.zeros(len(A)) if line.column is None else B[:, line.column]
        states.append(np.zeros(len(A)) if line.initial == "rest" else _first_state(plant, record.u, column))
        if not line.factor[0]:
            offsets[number] = residual[0, :, 0].real / math.sqrt(line.samples)
    return RecordFit(
        records, *plant, tuple(states), offsets, 1 / levels[:-1], fitted.cost, cost, found.status, found.history, delay
    )


def _first_state(plant: StateMatrices, u: Real, column: Real) -> Real:
    """x(0) with ``x(0) - x(N) = sqrt(N) column``."""
    ended = np.zeros(len(plant.A))
    for push in u @ plant.B.T:
        ended = plant.A @ ended + push
    whole = np.eye(len(plant.A)) - np.linalg.matrix_power(plant.A, len(u))
    state = np.linalg.lstsq(whole, math.sqrt(len(u)) * column + ended, rcond=None)[0]
    return np.asarray(state, dtype=np.float64)

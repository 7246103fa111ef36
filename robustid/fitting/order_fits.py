"""Fits of several orders, one after the other or spread over workers, and how well each predicts."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Generator, Mapping
from concurrent.futures import Executor, Future, as_completed
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from robustid.core import Budget, Interruptible, StateMatrices, pass_on
from robustid.data import FrequencyResponse
from robustid.fitting.fraction.fraction_iteration import FitStatus
from robustid.fitting.matrix_fraction import MatrixFraction, fit_mfd
from robustid.fitting.modal.modal_fit import modal_withheld_residual
from robustid.fitting.state_space.block_model import BlockModel
from robustid.fitting.state_space.pole_distances import RESOLVED, SEVERAL
from robustid.fitting.state_space.state_descent import blocks_of, flipped, refinable
from robustid.fitting.state_space.withheld_points import withheld, withheld_residual

Options = Mapping[str, Any]  # further arguments of `fit_mfd`

_log = logging.getLogger("robustid")

_WAVE = 4  # orders fitted before it is looked whether more are worth it: none of them predicted better by this part
_BETTER = 0.15
# A model of lower order, written with a higher one, has its cost up to the rounding of factors that cancel.
_SAME_COST = 1e-6
_FIRST = 2  # of the points that are withheld
_HELD, _ON = 1.05, 1e-3


class Found(NamedTuple):
    """Findings of a sweep so far, by order."""

    fits: dict[int, MatrixFraction]
    failures: dict[int, str]
    withheld: dict[int, float]
    interrupted: bool = False


def fit_one(frf: FrequencyResponse, options: Options, order: int) -> MatrixFraction:
    """One item of the sweep; at the top of the module so that a process pool finds it."""
    return fit_mfd(frf, order=order, **options)


def fits_of_orders(
    frf: FrequencyResponse,
    orders: list[int],
    options: Options,
    executor: Executor | None,
    budget: Budget,
    may_stop: bool,
    growing: Callable[[Found], None],
) -> Found:
    """Fits, failures and errors at withheld points; with `may_stop` none after a wave that predicts no better than those
    before. A fit that Ctrl-C ends returns its best model; only its status tells that the sweep is to end too.
    """
    fits: dict[int, MatrixFraction] = {}
    errors: dict[int, Exception] = {}
    withheld: dict[int, float] = {}
    done, best = 0, math.inf
    with Interruptible(lambda: bool(fits)) as sweep:
        try:
            budget.tell(done, len(orders))
            for first in range(0, len(orders), _WAVE):
                wave = orders[first : first + _WAVE]
                for order, outcome in _wave(frf, wave, options, executor):
                    done += 1
                    (errors if isinstance(outcome, Exception) else fits)[order] = outcome  # type: ignore[assignment]
                    pass_on(isinstance(outcome, MatrixFraction) and outcome.status is FitStatus.INTERRUPTED)
                    budget.tell(done, len(orders))
                _refit_local_minima(frf, options, fits)
                here = {order: withheld_error(fits[order]) for order in wave if order in fits}
                withheld |= here
                if fits:
                    growing(Found(fits, _sentences(errors), withheld))
                reached = min(here.values(), default=math.nan)
                if budget.over or (may_stop and reached > (1 - _BETTER) * best):
                    break
                best = min(best, reached) if math.isfinite(reached) else best
            if not fits:
                raise errors[orders[0]]
        except BaseException:
            finished = ", ".join(f"order {order}: cost {fit.cost:.6g}" for order, fit in sorted(fits.items()))
            _log.warning("the sweep over the order ended early; finished: %s", finished or "none")
            raise
    return Found(fits, _sentences(errors), withheld, sweep.interrupted)


def _sentences(errors: Mapping[int, Exception]) -> dict[int, str]:
    """Failures in words, by order."""
    return {order: f"{type(error).__name__}: {error}" for order, error in errors.items()}


def _wave(
    frf: FrequencyResponse, orders: list[int], options: Options, executor: Executor | None
) -> Generator[tuple[int, MatrixFraction | Exception], None, None]:
    """Fits of some orders as they end; one that fails is tried again in this process."""
    jobs: dict[Future[MatrixFraction], int] = {}
    if executor is not None:
        jobs = {_submitted(executor, frf, options, order): order for order in orders}
    runs = ((order, partial(fit_one, frf, options, order)) for order in orders)
    try:
        for order, run in runs if executor is None else ((jobs[job], job.result) for job in as_completed(jobs)):
            try:
                yield order, run()
            except Exception as error:
                _log.warning("order %d: %s: %s; trying again in this process", order, type(error).__name__, error)
                try:
                    yield order, fit_one(frf, options, order)
                except Exception as again:
                    yield order, again
    finally:
        for job in jobs:
            job.cancel()


def _submitted(executor: Executor, frf: FrequencyResponse, options: Options, order: int) -> Future[MatrixFraction]:
    """The job, or a failed one where the executor is broken and takes none."""
    try:
        return executor.submit(fit_one, frf, options, order)
    except RuntimeError as error:
        job: Future[MatrixFraction] = Future()
        job.set_exception(error)
        return job


def _refit_local_minima(frf: FrequencyResponse, options: Options, fits: dict[int, MatrixFraction]) -> None:
    """Fit orders that cost more than a lower one again, from its model."""
    best = None
    for order in sorted(fits):
        if best is not None and best.status is not FitStatus.EXACT and fits[order].cost > (1 + _SAME_COST) * best.cost:
            try:
                other = fit_one(frf, {**options, "start": best.model}, order)
            except Exception as error:
                _log.warning("order %d from the model of a lower one: %s", order, error)
            else:
                fits[order] = min(fits[order], other, key=lambda fit: fit.cost)
                pass_on(other.status is FitStatus.INTERRUPTED)
        if best is None or fits[order].cost <= best.cost:
            best = fits[order]


def withheld_error(fit: MatrixFraction) -> float:
    """Weighted rms error at every fourth frequency point of the fit refined on the others, relative to the data there; nan
    where constraints on coefficients don't let the state space be refined, or too few points are left.
    """
    problem, model = fit.problem, fit.fraction.matrices
    unknowns = problem.order * sum(problem.values.shape[1:])
    if not refinable(problem) or unknowns > problem.equations // 2:
        return math.nan
    tied = fit.modal if fit.modal is not None and fit.modal.tied else None
    if flipped(problem) and not (tied is not None and tied.symmetric):
        problem, model = problem.transposed(), model.transposed()
    mask = withheld(problem, _FIRST)
    size = float(np.linalg.norm(problem.weight.select(mask).apply(problem.values[mask])))
    if not size > 0:
        return math.nan
    if tied is None:
        residual = withheld_residual(problem, blocks_of(problem, model), mask, stable=fit.stable)
    else:
        residual = modal_withheld_residual(problem, model, tied, mask, stable=fit.stable)
    return float(np.linalg.norm(problem.weight.select(mask).apply(residual))) / size


def unresolved_poles(fit: MatrixFraction) -> int:
    """Number of poles, rigid-body modes left aside, that the refinement held where the frequency points resolve no damping."""
    problem, model = fit.problem, fit.fraction.matrices
    if fit.fraction.rigid_count:
        flexible = len(model.A) - 2 * fit.fraction.rigid_count
        model = StateMatrices(model.A[:flexible, :flexible], model.B[:flexible], model.C[:, :flexible], model.D)
    blocks = BlockModel.of(model.A / problem.scale, model.B / problem.scale, discrete=problem.dt is not None)
    poles = np.concatenate([blocks.poles[: 2 * blocks.centre.size : 2], blocks.single])
    inside = np.abs(np.imag(poles)) > 0  # a real pole is no mode
    part = blocks.distances / blocks.spacing(problem.xi)
    # On the limit of wide modes a pole lies exactly, but for the rounding of the fraction, or by a rare chance.
    held = inside & ((part <= _HELD * RESOLVED) | (np.abs(part / SEVERAL - 1) <= _ON))
    sizes = np.repeat([2, 1], [blocks.centre.size, blocks.single.size])
    return int(np.sum(sizes[held]))


def outside_bound(fit: MatrixFraction, frf: FrequencyResponse) -> float:
    """Largest ratio of what the fit leaves of the data to their bound; nan where they have none."""
    if frf.bound is None:
        return math.nan
    left = np.abs(np.where(frf.missing, 0, frf.values - fit.fraction.response(frf.omega)))
    known = ~frf.missing & np.isfinite(frf.bound) & (frf.bound > 0)
    return float(np.max(left[known] / frf.bound[known], initial=0.0)) if np.any(known) else math.nan

"""suggest_order(): which McMillan degree the data carry, from singular values and a sweep of fits over the order."""

from __future__ import annotations

import dataclasses
import inspect
import logging
import math
import time
from collections.abc import Callable, Generator, Iterable, Mapping
from concurrent.futures import Executor, Future, as_completed
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from robustid.core import as_count, as_function, as_kind, as_positive, one_thread
from robustid.data import FrequencyResponse, as_frequency_response
from robustid.errors import InputError, InputTypeError, RobustIdError
from robustid.fitting.fit import MatrixFraction, fit_mfd
from robustid.fitting.fraction.constraints import RollOff, as_constraints
from robustid.fitting.fraction.criterion import Weight
from robustid.fitting.fraction.default_weight import exact_covariance
from robustid.fitting.fraction.iteration import FitStatus
from robustid.fitting.fraction.statement import one_weight, stated
from robustid.fitting.modal.modal_structure import as_modal
from robustid.fitting.order_sweep import OrderSweep
from robustid.fitting.state_space.subspace import subspace_estimate
from robustid.fitting.withheld import outside_bound, unresolved_poles, withheld_error

_log = logging.getLogger("robustid")

# Orders tried around the number of singular values above the noise: all of them near it, even steps further away.
_AROUND = (-6, -4, -2, -1, 0, 1, 2, 3, 4, 6, 8, 12)
# Below them, where there are many: the error at withheld points often has its knee far below the noise.
_BELOW = (2, 4, 6, 8, 10, 12, 14, 16, 18, 20, 22, 24, 28, 32, 36, 40, 48, 56, 64, 80)
_WAVE = 4  # orders fitted before it is looked whether more are worth it: none of them predicted better by this part
_BETTER = 0.15
# A feed-through is hinted at that lowers the error at withheld points to this part of it, or leaves it with fewer states.
_FEEDTHROUGH, _AS_WELL = 0.8, 1.02
# Orders of the subspace estimate whose singular values are counted: doubled until the count is smaller.
_FIRST_PROBE, _LAST_PROBE = 10, 80
# The largest noise value of 200 noisy estimates lay at 0.94 to 1.28 times the asymptotic edge.
_EDGE_SLACK = 1.25
# Singular values of this part of the largest one are rounding.
_EXACT = 1e-10
# A model of lower order, written with a higher one, has its cost up to the rounding of factors that cancel.
_SAME_COST = 1e-6


class _Found(NamedTuple):
    """Findings of a sweep so far, by order."""

    fits: dict[int, MatrixFraction]
    failures: dict[int, str]
    withheld: dict[int, float]
    interrupted: bool = False


@one_thread()
def suggest_order(
    frf: Any,
    *,
    orders: Iterable[int] | None = None,
    weight: Weight | np.ndarray | None = None,
    domain: str | None = None,
    time_limit: float | None = 60.0,
    executor: Executor | None = None,
    progress: Callable[[int, int], Any] | None = None,
    grown: Callable[[OrderSweep], Any] | None = None,
    **options: Any,
) -> OrderSweep:
    """Fit a range of orders and find the one that the data carry.

    The smallest ``MDL = -2 ln L + p ln N``, but no order beyond the first that keeps the data inside their stated bounds; where
    no order leaves noise alone (measured machines), the smallest whose error at withheld frequency points is within a
    quarter of the best. Orders with more than half as many parameters as equations, or with modes whose damping the
    frequency points don't resolve, are not suggested.

    With the noise known, ``-2 ln L = 2 V``; with its level unknown, ``-2 ln L = N ln(V/N)``, up to constants.
    V is the cost, p the number of free coefficients, N that of real equations.

    Parameters
    ----------
    frf : FrequencyResponse or control.FRD
    orders : sequence of int, optional
        Default: a dozen around the number of singular values of the subspace estimate that lie above the noise, and a
        ladder below; they end where larger ones don't predict better.
    weight, domain
        As in `fit_mfd`, but one for all orders, so that costs can be compared: relative where the data have no covariance. The
        noise counts as known where the data have a covariance that counts as exact (no `dof` is stated) and no weight is given.
    time_limit : float, optional
        Seconds after which no further orders are tried; None: no limit.
    executor : concurrent.futures.Executor, optional
        Where the orders are fitted; default this process, one after the other. The result is the same.
    progress : callable, optional
        Called with (orders done, orders in all) in this process.
    grown : callable, optional
        Called with the sweep so far, after every few orders: to show its suggestion, or the stabilisation diagram as it grows.
    **options
        The other options of `fit_mfd`, for every order; ``restart`` is off unless given, as orders below the right one
        would all try it.

    Returns
    -------
    OrderSweep
        After Ctrl-C that of the orders finished so far (``interrupted``); where there is none, the interrupt passes.

    Raises
    ------
    InputError, InputTypeError
        Wrong arguments.
    Exception
        That of the lowest order, when no order can be fitted; one that fails alone, twice, is among `failures`.

    Notes
    -----
    Assumes circular complex Gaussian noise, independent between frequency points. Known: ``E|W e|^2 = 1`` per entry, so that V
    is the negative log-likelihood. Unknown: that times one factor, also for a covariance of stated degrees of freedom, whose
    default weight leaves room for what the model misses. With few points the latter takes single points for modes: of 8
    simulated SISO systems of order 4, MDL found 6 with 100 points, 6 with 200; compare with `OrderSweep.subspace_order`.
    MDL finds the true order as N grows; AIC keeps too much. A model error (a nonlinearity, leakage) counts as dynamics.

    An order whose cost lies above that of a lower one is fitted again, from there and from what it leaves of the data: the
    cost never rises with the order.

    Source: `pintelon2012`; for the noise level of the singular values, from their median, `gavish2014`.

    Examples
    --------
    >>> import numpy as np, robustid as rid
    >>> from robustid.fitting import suggest_order
    >>> s = 1j * np.linspace(1, 9, 60)
    >>> noise = 0.003 * np.exp(1j * np.random.default_rng(0).uniform(0, 7, 60))
    >>> frf = rid.FrequencyResponse(s.imag, (1 + noise) / (s**2 + 0.2 * s + 16))
    >>> suggest_order(frf, orders=range(1, 5)).suggested
    2
    """
    frf = as_frequency_response("frf", frf)
    if executor is not None:
        as_kind("executor", executor, Executor, "a concurrent.futures.Executor")
    for name in options:
        if name == "order" or name not in inspect.signature(fit_mfd).parameters:
            raise InputTypeError(f"`{name}` is not an option of fit_mfd that suggest_order takes; leave it out")
    if "constraints" in options:
        options["constraints"] = as_constraints(options["constraints"])  # an iterator would serve one order only
    options.setdefault("restart", False)
    noise_known = weight is None and exact_covariance(frf)
    if weight is None and not noise_known:
        weight = one_weight(frf, options.get("form"))
    singular_values, edge = subspace_singular_values(
        frf, weight, domain, noise_known, options.get("feedthrough", False), options.get("form")
    )
    step = 2 if as_modal(options.get("modal")) is not None else 1  # states of a mode
    tried = _orders(orders, int(np.sum(singular_values > edge)), frf, step)
    deadline = math.inf if time_limit is None else time.monotonic() + as_positive("time_limit", time_limit)
    settings = options | {"weight": weight, "domain": domain}
    on_wave, tell = as_function("grown", grown), as_function("progress", progress)

    def assembled(found: _Found) -> OrderSweep:
        return _assembled(frf, noise_known, singular_values, edge, found)

    def growing(found: _Found) -> None:
        if on_wave is not None:
            on_wave(assembled(found))

    sweep = assembled(_sweep(frf, tried, settings, executor, tell, orders is None, deadline, growing))
    ended = sweep.interrupted or time.monotonic() > deadline
    return sweep if ended else dataclasses.replace(sweep, hint=_hint(frf, sweep, settings))


def _assembled(
    frf: FrequencyResponse,
    noise_known: bool,
    singular_values: np.ndarray,
    edge: float,
    found: _Found,
) -> OrderSweep:
    """The sweep of these fits."""
    fits, failures, withheld, interrupted = found
    ordered = [fits[order] for order in sorted(fits)]
    return OrderSweep(
        dict(fits),
        failures,
        np.array([_parameters(fit) for fit in ordered]),
        fits[min(fits)].problem.equations,
        noise_known,
        singular_values,
        edge,
        np.array([withheld.get(order, math.nan) for order in sorted(fits)]),
        np.array([outside_bound(fit, frf) for fit in ordered]),
        np.array([unresolved_poles(fit) for fit in ordered]),
        interrupted=interrupted,
    )


def _hint(frf: FrequencyResponse, sweep: OrderSweep, settings: Mapping[str, Any]) -> str:
    """Say where a feed-through would predict as well with fewer states, or better with as many, and where a roll-off is free."""
    order = sweep.suggested
    error = float(sweep.withheld[sweep.orders == order][0])
    asked = settings.get("feedthrough") or settings.get("constraints") or settings.get("modal")
    if asked or not error > 0 or sweep.fits[order].status is FitStatus.EXACT:
        return ""
    for fewer in (2, 1, 0):
        if order - fewer < 1:
            continue
        try:
            other = withheld_error(fit_one(frf, {**settings, "feedthrough": True}, order - fewer))
        except (RobustIdError, np.linalg.LinAlgError):
            continue
        if other <= (_AS_WELL if fewer else _FEEDTHROUGH) * error:
            return (
                f"with a feed-through the error of order {order - fewer} at withheld frequency points is {100 * other:.3g} %"
                f" (order {order} without: {100 * error:.3g} %): give `feedthrough=True` (--feedthrough) and compare"
            )
    return _roll_off(frf, sweep, settings, error)


def _roll_off(frf: FrequencyResponse, sweep: OrderSweep, settings: Mapping[str, Any], error: float) -> str:
    """Say where a response that falls like 1/omega^2 describes the data in fewer words, and predicts them as well."""
    order = sweep.suggested
    free = sweep.fits[order]
    if free.problem.dt is not None:  # samples of such a machine fall like 1/z
        return ""
    try:
        fit = fit_one(frf, {**settings, "constraints": (RollOff(2),)}, order)
    except (RobustIdError, np.linalg.LinAlgError):
        return ""
    saved = free.problem.values[0].size
    rise = 2 * (fit.cost - free.cost)
    if not sweep.noise_known:
        rise = sweep.equations * math.log(fit.cost / free.cost)
    if rise > saved * math.log(sweep.equations) or not withheld_error(fit) <= _AS_WELL * error:
        return ""
    return (
        f"with a roll-off of 2, as of positions under forces, order {order} describes the data in {saved} fewer"
        f" parameter{'s' * (saved > 1)}, and beyond them the response falls as it should: where the machine has it, give"
        " `constraints=[RollOff(2)]`"
    )


def subspace_singular_values(
    frf: FrequencyResponse, weight: Any, domain: str | None, noise_known: bool, feedthrough: bool, form: Any = None
) -> tuple[np.ndarray, float]:
    """Singular values of a subspace estimate of sufficient order, and the edge of those that are noise."""
    data = stated(frf, 1, domain, "shared" if form == "shared" else "right", weight, feedthrough, None).data
    options: dict[str, Any] = {"weight": data.weight, "feedthrough": feedthrough, "domain": data.domain}
    best, probe = None, _FIRST_PROBE
    while True:
        try:
            found = subspace_estimate(data.values, data.points, probe, **options).singular_values
        except InputError:  # too few points for this order
            if best is not None:
                return best
            if probe == 1:
                raise
            probe //= 2
            continue
        edge = _noise_edge(found, data.values.shape, noise_known)
        if np.sum(found > edge) <= probe or probe >= _LAST_PROBE:
            return found, edge
        best, probe = (found, edge), 2 * probe


def _noise_edge(found: np.ndarray, shape: tuple[int, ...], noise_known: bool) -> float:
    """Marchenko-Pastur: squares of noise values end at (1 + sqrt(b))^2 and have their median at about 1 - b/3."""
    lines, ny, nu = shape
    share = max(1 - found.size / (2 * lines * ny), 1 / (2 * lines))  # of the equations, after the projection
    ratio = min(found.size / (2 * lines * nu * share), 1.0)
    level = math.sqrt(share) if noise_known else float(np.median(found)) / math.sqrt(1 - ratio / 3)
    return max(_EDGE_SLACK * level * (1 + math.sqrt(ratio)), _EXACT * float(found[0]))


def _orders(orders: Iterable[int] | None, center: int, frf: FrequencyResponse, step: int) -> list[int]:
    """The orders to try; those that are chosen here are multiples of `step`."""
    if orders is None:
        near = {-(-max(center + away, 1) // step) * step for away in _AROUND}
        most = frf.omega.size * frf.values[0].size // sum(frf.values.shape[1:])  # parameters for half the equations
        wanted = sorted(near | {order for order in _BELOW if order < min(near)})
        return [order for order in wanted if order <= most] or wanted[:1]
    try:
        chosen = sorted({as_count("orders", order, least=1) for order in orders})
    except TypeError as error:
        raise InputTypeError(f"`orders` must be a sequence of integers; {error}") from None
    if not chosen:
        raise InputError("`orders` is empty; give at least one order, or leave it out")
    return chosen


def fit_one(frf: FrequencyResponse, options: Mapping[str, Any], order: int) -> MatrixFraction:
    """One item of the sweep; at the top of the module so that a process pool finds it."""
    return fit_mfd(frf, order=order, **options)


def _sweep(
    frf: FrequencyResponse,
    orders: list[int],
    options: Mapping[str, Any],
    executor: Executor | None,
    progress: Callable[[int, int], Any] | None,
    may_stop: bool,
    deadline: float,
    growing: Callable[[_Found], None],
) -> _Found:
    """Fits, failures and errors at withheld points; with `may_stop` none after a wave that predicts no better than those before.

    A fit that Ctrl-C ends returns its best model; only its status tells that the sweep is to end too.
    """
    fits: dict[int, MatrixFraction] = {}
    errors: dict[int, Exception] = {}
    withheld: dict[int, float] = {}
    done, best, interrupted = 0, math.inf, False
    try:
        for first in range(0, len(orders), _WAVE):
            wave = orders[first : first + _WAVE]
            for order, outcome in _wave(frf, wave, options, executor):
                done += 1
                (errors if isinstance(outcome, Exception) else fits)[order] = outcome  # type: ignore[assignment]
                _pass_on(outcome)
                if progress is not None:
                    progress(done, len(orders))
            _refit_local_minima(frf, options, fits)
            here = {order: withheld_error(fits[order]) for order in wave if order in fits}
            withheld |= here
            if fits:
                growing(_Found(fits, _sentences(errors), withheld))
            reached = min(here.values(), default=math.nan)
            if time.monotonic() > deadline or (may_stop and reached > (1 - _BETTER) * best):
                break
            best = min(best, reached) if math.isfinite(reached) else best
        if not fits:
            raise errors[orders[0]]
    except BaseException as stop:
        finished = ", ".join(f"order {order}: cost {fit.cost:.6g}" for order, fit in sorted(fits.items()))
        _log.warning("the sweep over the order ended early; finished: %s", finished or "none")
        interrupted = isinstance(stop, KeyboardInterrupt)
        if not (interrupted and fits):
            raise
    return _Found(fits, _sentences(errors), withheld, interrupted)


def _pass_on(outcome: MatrixFraction | Exception) -> None:
    """Raise the interrupt that a fit has kept back."""
    if isinstance(outcome, MatrixFraction) and outcome.status is FitStatus.INTERRUPTED:
        raise KeyboardInterrupt


def _sentences(errors: Mapping[int, Exception]) -> dict[int, str]:
    """Failures in words, by order."""
    return {order: f"{type(error).__name__}: {error}" for order, error in errors.items()}


def _wave(
    frf: FrequencyResponse, orders: list[int], options: Mapping[str, Any], executor: Executor | None
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


def _submitted(
    executor: Executor, frf: FrequencyResponse, options: Mapping[str, Any], order: int
) -> Future[MatrixFraction]:
    """The job, or a failed one where the executor is broken and takes none."""
    try:
        return executor.submit(fit_one, frf, options, order)
    except RuntimeError as error:
        job: Future[MatrixFraction] = Future()
        job.set_exception(error)
        return job


def _refit_local_minima(frf: FrequencyResponse, options: Mapping[str, Any], fits: dict[int, MatrixFraction]) -> None:
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
                _pass_on(other)
        if best is None or fits[order].cost <= best.cost:
            best = fits[order]


def _parameters(fit: MatrixFraction) -> int:
    """Free coefficients."""
    problem = fit.problem
    if fit.modal is not None and fit.modal.tied:
        ny, nu = problem.values.shape[1:]
        return fit.modal.parameters(problem.order, (ny, nu), fit.fraction.rigid_count, problem.feedthrough)
    count = int(np.sum(problem.limits + 1))
    if problem.free and problem.rigid is None and not problem.tied[1].size:
        return count
    basis = problem.basis(fit.nodes.denominators, fit.nodes.response)
    return count - len(problem.forbidden(basis, fit.nodes))

"""suggest_order(): which McMillan degree the data carry, from singular values and a sweep of fits over the order."""

from __future__ import annotations

import inspect
import logging
import math
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import Executor, Future, as_completed
from functools import partial
from typing import Any

import numpy as np

from robustid.core import as_count
from robustid.data import FrequencyResponse, as_frequency_response
from robustid.errors import InputError, InputTypeError
from robustid.mfd.constraints import as_constraints
from robustid.mfd.criterion import Weight
from robustid.mfd.default_weight import exact_covariance
from robustid.mfd.fit import MatrixFraction, fit_mfd
from robustid.mfd.iteration import FitStatus
from robustid.mfd.order_sweep import OrderSweep
from robustid.mfd.statement import stated
from robustid.mfd.subspace import subspace_estimate

_log = logging.getLogger("robustid")

# Orders tried around the number of singular values above the noise: all of them near it, even steps further away.
_AROUND = (-6, -4, -2, -1, 0, 1, 2, 3, 4, 6, 8, 12)
# Orders of the subspace estimate whose singular values are counted: doubled until the count is smaller.
_FIRST_PROBE, _LAST_PROBE = 10, 160
# The largest noise value of 200 noisy estimates lay at 0.94 to 1.28 times the asymptotic edge.
_EDGE_SLACK = 1.25
# Singular values of this part of the largest one are rounding.
_EXACT = 1e-10
# A model of lower order, written with a higher one, has its cost up to the rounding of factors that cancel.
_SAME_COST = 1e-6


def suggest_order(
    frf: Any,
    *,
    orders: Iterable[int] | None = None,
    weight: Weight | np.ndarray | None = None,
    domain: str | None = None,
    executor: Executor | None = None,
    progress: Callable[[int, int], Any] | None = None,
    **options: Any,
) -> OrderSweep:
    """Fit a range of orders and find the one that the data carry: the smallest ``MDL = -2 ln L + p ln N``.

    With the noise known, ``-2 ln L = 2 V``; with its level unknown, ``-2 ln L = N ln(V/N)``, up to constants.
    V is the cost, p the number of free coefficients, N that of real equations.

    Parameters
    ----------
    frf : FrequencyResponse or control.FRD
    orders : sequence of int, optional
        Default: a dozen around the number of singular values of the subspace estimate that lie above the noise.
    weight, domain
        As in `fit_mfd`. The noise counts as known where the data have a covariance that counts as exact (no `dof` is stated) and no
        other weight is given.
    executor : concurrent.futures.Executor, optional
        Where the orders are fitted; default this process, one after the other. The result is the same.
    progress : callable, optional
        Called with (orders done, orders in all) in this process.
    **options
        The other options of `fit_mfd`, for every order; ``restart`` is off unless given, as orders below the right one
        would all try it.

    Returns
    -------
    OrderSweep

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

    An order whose cost lies above that of a lower one is fitted again, from there: it ended in a local minimum. The
    criteria are those of plain maximum likelihood, ``stable=False``, which is also faster; stable fits of too high an
    order cost more, and are chosen less often.

    Source: `pintelon2012`; for the noise level of the singular values, from their median, `gavish2014`.

    Examples
    --------
    >>> import numpy as np, robustid as rid
    >>> from robustid.mfd import suggest_order
    >>> s = 1j * np.linspace(1, 9, 60)
    >>> noise = 0.003 * np.exp(1j * np.random.default_rng(0).uniform(0, 7, 60))
    >>> frf = rid.FrequencyResponse(s.imag, (1 + noise) / (s**2 + 0.2 * s + 16))
    >>> suggest_order(frf, orders=range(1, 5)).suggested
    2
    """
    frf = as_frequency_response("frf", frf)
    if not isinstance(executor, Executor | None):
        raise InputTypeError(f"`executor` must be a concurrent.futures.Executor; got {type(executor).__name__}")
    for name in options:
        if name == "order" or name not in inspect.signature(fit_mfd).parameters:
            raise InputTypeError(f"`{name}` is not an option of fit_mfd that suggest_order takes; leave it out")
    if "constraints" in options:
        options["constraints"] = as_constraints(options["constraints"])  # an iterator would serve one order only
    options.setdefault("restart", False)
    noise_known = weight is None and exact_covariance(frf)
    singular_values, edge = subspace_singular_values(
        frf, weight, domain, noise_known, options.get("feedthrough", False)
    )
    tried = _orders(orders, int(np.sum(singular_values > edge)))
    fits, failures = _sweep(frf, tried, options | {"weight": weight, "domain": domain}, executor, progress)
    equations = fits[min(fits)].problem.equations
    parameters = np.array([_parameters(fits[order]) for order in sorted(fits)])
    return OrderSweep(fits, failures, parameters, equations, noise_known, singular_values, edge)


def subspace_singular_values(
    frf: FrequencyResponse, weight: Any, domain: str | None, noise_known: bool, feedthrough: bool
) -> tuple[np.ndarray, float]:
    """Singular values of a subspace estimate of sufficient order, and the edge of those that are noise."""
    data = stated(frf, 1, domain, "right", weight, feedthrough, None).data
    options = {"weight": data.weight, "feedthrough": feedthrough, "domain": data.domain}
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
        edge = _noise_edge(found, frf.values.shape, noise_known)
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


def _orders(orders: Iterable[int] | None, center: int) -> list[int]:
    if orders is None:
        return sorted({max(center + step, 1) for step in _AROUND})
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
) -> tuple[dict[int, MatrixFraction], dict[int, str]]:
    fits: dict[int, MatrixFraction] = {}
    errors: dict[int, Exception] = {}
    jobs = {} if executor is None else {_submitted(executor, frf, options, order): order for order in orders}
    try:
        runs = ((order, partial(fit_one, frf, options, order)) for order in orders)
        for order, run in runs if executor is None else ((jobs[job], job.result) for job in as_completed(jobs)):
            try:
                fits[order] = run()
            except Exception as error:
                _log.warning("order %d: %s: %s; trying again in this process", order, type(error).__name__, error)
                try:
                    fits[order] = fit_one(frf, options, order)
                except Exception as again:
                    errors[order] = again
            if progress is not None:
                progress(len(fits) + len(errors), len(orders))
        if not fits:
            raise errors[orders[0]]
        _refit_local_minima(frf, options, fits)
    except BaseException:
        for job in jobs:
            job.cancel()
        finished = ", ".join(f"order {order}: cost {fit.cost:.6g}" for order, fit in sorted(fits.items()))
        _log.warning("the sweep over the order ended early; finished: %s", finished or "none")
        raise
    return fits, {order: f"{type(error).__name__}: {error}" for order, error in errors.items()}


def _submitted(executor: Executor, frf: FrequencyResponse, options: Mapping[str, Any], order: int) -> Future:
    """The job, or a failed one where the executor is broken and takes none."""
    try:
        return executor.submit(fit_one, frf, options, order)
    except RuntimeError as error:
        job: Future = Future()
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
        if best is None or fits[order].cost <= best.cost:
            best = fits[order]


def _parameters(fit: MatrixFraction) -> int:
    problem = fit.problem
    basis = problem.basis(fit.nodes.denominators, fit.nodes.response)
    return int(np.sum(problem.limits + 1)) - len(problem.forbidden(basis, fit.nodes))

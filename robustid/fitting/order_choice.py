"""suggest_order(): which McMillan degree the data carry, from singular values and a sweep of fits over the order."""

from __future__ import annotations

import dataclasses
import inspect
import math
from collections.abc import Callable, Iterable
from concurrent.futures import Executor
from typing import TYPE_CHECKING, Any

import numpy as np

from robustid.core import Budget, Progress, as_count, as_function, as_kind, one_thread
from robustid.data import FrequencyResponse, as_frequency_response
from robustid.errors import InputError, InputTypeError, RobustIdError
from robustid.fitting.fraction.constraints import RollOff, as_constraints
from robustid.fitting.fraction.criterion import Weight
from robustid.fitting.fraction.default_weight import exact_covariance
from robustid.fitting.fraction.fit_statement import one_weight, stated, takes_feedthrough
from robustid.fitting.fraction.fraction_iteration import FitStatus
from robustid.fitting.matrix_fraction import MatrixFraction, fit_mfd
from robustid.fitting.modal.modal_structure import as_modal
from robustid.fitting.order_fits import (
    Found,
    Options,
    fit_one,
    fits_of_orders,
    outside_bound,
    unresolved_poles,
    withheld_error,
)
from robustid.fitting.order_sweep import OrderSweep
from robustid.fitting.state_space.subspace import subspace_estimate

if TYPE_CHECKING:
    import control

# Orders tried around the number of singular values above the noise: all of them near it, even steps further away.
_AROUND = (-6, -4, -2, -1, 0, 1, 2, 3, 4, 6, 8, 12)
# Below them, where there are many: the error at withheld points often has its knee far below the noise.
_BELOW = (2, 4, 6, 8, 10, 12, 14, 16, 18, 20, 22, 24, 28, 32, 36, 40, 48, 56, 64, 80)
# A feed-through is hinted at that lowers the error at withheld points to this part of it, or leaves it with fewer states.
_FEEDTHROUGH, _AS_WELL = 0.8, 1.02
# Orders of the subspace estimate whose singular values are counted: doubled until the count is smaller.
_FIRST_PROBE, _LAST_PROBE = 10, 80
# The largest noise value of 200 noisy estimates lay at 0.94 to 1.28 times the asymptotic edge.
_EDGE_SLACK = 1.25
# Singular values of this part of the largest one are rounding.
_EXACT = 1e-10


@one_thread()
def suggest_order(
    frf: FrequencyResponse | control.FRD,
    *,
    orders: Iterable[int] | None = None,
    weight: Weight | np.ndarray | None = None,
    domain: str | None = None,
    time_limit: float | None = 60.0,
    executor: Executor | None = None,
    progress: Progress | None = None,
    grown: Callable[[OrderSweep], object] | None = None,
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
    budget = Budget(time_limit, progress, "fitting a range of orders")
    stated = options | {"weight": weight, "domain": domain}
    sweep, settings = orders_fitted(
        frf, stated, budget, orders=orders, executor=executor, grown=as_function("grown", grown)
    )
    ended = sweep.interrupted or budget.over
    return sweep if ended else dataclasses.replace(sweep, hint=_hint(frf, sweep, settings))


def orders_fitted(
    frf: FrequencyResponse,
    options: Options,
    budget: Budget,
    *,
    orders: Iterable[int] | None = None,
    executor: Executor | None = None,
    grown: Callable[[OrderSweep], object] | None = None,
) -> tuple[OrderSweep, Options]:
    """Fit a range of orders as `suggest_order` does, without its hint; the sweep, and the options that all of its fits had."""
    options, weight, domain = dict(options), options.get("weight"), options.get("domain")
    if "constraints" in options:
        options["constraints"] = as_constraints(options["constraints"])  # an iterator would serve one order only
    options.setdefault("restart", False)
    falls = any(isinstance(constraint, RollOff) for constraint in options.get("constraints", ()))
    excluded = falls or as_modal(options.get("modal")) is not None or options.get("rigid_body") is not None
    options["feedthrough"] = takes_feedthrough(frf, options.get("feedthrough"), excluded=excluded)
    noise_known = weight is None and exact_covariance(frf)
    if weight is None and not noise_known:
        weight = one_weight(frf, options.get("form"))
    singular_values, edge = subspace_singular_values(
        frf, weight, domain, noise_known, options["feedthrough"], options.get("form")
    )
    step = 2 if as_modal(options.get("modal")) is not None else 1  # states of a mode
    tried = _orders(orders, int(np.sum(singular_values > edge)), frf, step)
    settings = options | {"weight": weight, "domain": domain}

    def assembled(found: Found) -> OrderSweep:
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

    def growing(found: Found) -> None:
        if grown is not None:
            grown(assembled(found))

    return assembled(fits_of_orders(frf, tried, settings, executor, budget, orders is None, growing)), settings


def _hint(frf: FrequencyResponse, sweep: OrderSweep, settings: Options) -> str:
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


def _roll_off(frf: FrequencyResponse, sweep: OrderSweep, settings: Options, error: float) -> str:
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
    frf: FrequencyResponse,
    weight: Weight | np.ndarray | None,
    domain: str | None,
    noise_known: bool,
    feedthrough: bool,
    form: str | None = None,
) -> tuple[np.ndarray, float]:
    """Singular values of a subspace estimate of sufficient order, and the edge of those that are noise."""
    data = stated(frf, 1, domain, "shared" if form == "shared" else "right", weight, feedthrough, None).data
    best, probe = None, _FIRST_PROBE
    while True:
        try:
            found = subspace_estimate(
                data.values, data.points, probe, weight=data.weight, feedthrough=feedthrough, domain=data.domain
            ).singular_values
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

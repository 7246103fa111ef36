"""The smallest model that keeps every sample within its bound."""

from __future__ import annotations

import contextlib
import dataclasses
import enum
import logging
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from robustid.core import Budget, Interruptible, Pieces, Progress, as_kind, one_thread
from robustid.errors import InputError
from robustid.fitting import RigidBody
from robustid.identification import Identification, from_image, image_of, in_image
from robustid.reduction import pole_starts
from robustid.reduction.balanced import Reduction, balanced_truncations
from robustid.reduction.best_models import REFINED, BestModels
from robustid.reduction.nearest_to_band import Known, move_towards

if TYPE_CHECKING:
    import control

_log = logging.getLogger("robustid")

_ONE_BY_ONE = 12  # orders tried without a gap; further on every seventh or so, then those between
_NARROWLY = 1.1  # times the limit: a miss after which the next order of a matrix is likely to suffice
_AT_ONE = 1e-7  # a pole of the parametric part so near z = 1 is an integrator
_AFTER = 3.0  # seconds of truncations after the time is over, where nothing was found within it
_LATE = "stopped at the time limit"
_LOOK = 1.3e-5  # seconds, times the states squared: responses beside the samples and two truncations (measured)


class SearchStatus(enum.Enum):
    """Status of a search; the value is the user's sentence."""

    WITHIN = (
        "every sample stays within its bound, and where nothing was measured the model stays near the identified one"
    )
    OUTSIDE = "every sample stays within its bound, but the data contradict the class: the model is none of it"
    INFLATED = "every sample stays within its bound times the margin of the data, which contradict the class"
    UNREDUCED = "no smaller model that keeps every sample within its bound was found; the model is the one identified"


@one_thread()
def reduce_within_bounds(
    identification: Identification,
    *,
    rigid_body: RigidBody | None = None,
    band: Known | None = None,
    time_limit: float | None = None,
    progress: Progress | None = None,
) -> Reduction:
    r"""The smallest order r for which a stable model with every \|residual\| within its bound was found.

    .. math:: \min_{\deg G = r} \; \max_k |y_k - (G u)_k| / \epsilon_k \le 1

    at all frequency and time samples together, order by order. At each order, first the poles of the parametric part as they are,
    with a truncated non-parametric part: what is known of the plant is kept where that suffices. Else all poles move: starts from
    balanced truncation (of the whole model; of the non-parametric part alone), from a subspace and a Sanathanan-Koerner fit, and
    from the order below; refined by least squares over the poles; then made minimax by a sequence of second-order cone programs.
    The model is judged anew, by responses and simulations, at every sample. Continuous data are taken to the circle of a bilinear
    variable z for it, exactly.

    Between and beyond the frequency points, where no sample holds a model, it may differ from the identified one by K S (the
    prior) and the largest gain that one has within a tenth of the frequency, entry by entry: no resonance that nobody measured.
    Where a model differs by more, points are added there and it is refined again.

    Of a MIMO model the order is that of the whole matrix: modes of rank one cost two states each. With the poles the directions
    of the modes move, on the side with fewer signals; the other side is linear. Samples that share a bound count together. The
    orders are doubled, and those between are halved, below what truncation leads to; each starts from a matrix fraction fitted to
    the responses (`fit_mfd`), and from all other starts where that comes near.

    Parameters
    ----------
    identification : Identification
        Its model is the start, its margin what the bounds are multiplied by where the data contradict the class.
    rigid_body : RigidBody, optional
        ``RigidBody(1)``: a rigid-body mode, two poles at z = 1 that are exact; of a MIMO model ``RigidBody(min(ny, nu))``,
        one for each on the side with fewer. Integrators of the parametric part are always kept.
    band : Band, optional
        Proved band of the same problem (`band(identification)`): of the models of the order that is found, inside every bound, one
        near its centre in units of its radius, so that the guaranteed error is near the least that any model has.
    time_limit : float, optional
        Seconds; then, and on Ctrl-C, the smallest order within the bounds that was found so far, or else by truncation; `stopped`
        says so.
    progress : callable (text, done, count), optional
        Orders on the way up to that of the identified model (of a MIMO model those known not to suffice); most searches end long
        before it.

    Returns
    -------
    Reduction
        ``margin`` is the largest \|residual\|/bound of the model, ``tried`` the pairs (order, smallest such ratio found at that
        order, or that of its difference where nothing was measured if that is larger); `hankel` are the Hankel singular values of
        the identified model's stable part, `bounds` their a-priori error bounds; `bound` is inf, as the model isn't a truncated
        one: `worst_case_error(...).with_model(model)` bounds its error.

    Raises
    ------
    InputError, InputTypeError
        No Identification; a rigid-body mode with a frequency point at omega = 0 or with a periodic record.

    Notes
    -----
    A model that was found is a proof that its order suffices; that a smaller one was not found is none that there is none: the
    problem isn't convex in the poles. Poles stay inside the circle, at most a hundred times nearer to it than those of the
    identified model. Gain bound, decay rate and intervals of parameters are asked of the identified model, not of the small one.
    A smallest model touches the bounds, so that guarantees around it are wider than around the identified one: where the order
    is no concern, truncate that one.

    Source: `lawson1961` for the question, theory of orthonormal rational bases for the coordinates.

    Examples
    --------
    >>> import robustid as rid
    >>> data = rid.datasets.flexible_structure(seed=0, lines=6, samples=6)
    >>> basis = rid.kautz(data.modes[:, 0], data.modes[:, 1], dt=0.01, delay=1)
    >>> prior = rid.Prior(gain_bound=0.2, decay_rate=1.1)
    >>> problem = rid.MixedProblem(frequency=data.frequency, time=data.time, prior=prior, parametric=basis)
    >>> small = rid.reduce_within_bounds(rid.identify(problem))
    >>> small.order, small.margin <= 1
    (4, True)
    """
    as_kind("identification", identification, Identification, "the result of identify()")
    if band is not None:
        as_kind("band", band, Known, "the result of band()")
    budget = Budget(time_limit, progress, "searching for the smallest order")
    image, plane = image_of(identification), identification.problem.plane
    integrators = _integrators(image, rigid_body)
    if _LOOK * image.order**2 > max(budget.left, _AFTER):
        found = dataclasses.replace(_unreduced(image, {}, balanced_truncations(image.model)), stopped=_stopped(_LATE))
    else:
        found = _Search(image, integrators, budget, band).reduction()
    kept = found.status is SearchStatus.UNREDUCED
    return dataclasses.replace(found, model=identification.model if kept else from_image(found.model, plane))


def near_fit(identification: Identification, model: control.StateSpace) -> control.StateSpace | None:
    """The model of the same order inside the bounds that a search finds from a model without integrators; None where it finds
    none. All poles are refined by least squares at all samples, then made minimax only until every sample is inside.
    """
    plane = identification.problem.plane
    models = BestModels(image_of(identification), 0)
    if not identification.consistent:
        models.widen()
    image = in_image(model, plane)
    A, B, C = (np.asarray(part, dtype=float) for part in (image.A, image.B, image.C))
    models.refine(pole_starts.of_model(A, B, C, models.samples))
    return from_image(models.found[model.nstates].model, plane) if models.within(model.nstates) else None


def _integrators(identification: Identification, rigid_body: RigidBody | None) -> int:
    """Number of poles at z = 1."""
    problem = identification.problem
    basis = problem.parametric
    held = 0 if basis is None else int(np.sum(np.abs(basis.poles - 1) <= _AT_ONE))
    if rigid_body is None:
        return held
    rigid_body = as_kind("rigid_body", rigid_body, RigidBody, "a RigidBody, such as RigidBody(1)")
    heads = min(problem.entries.outputs, problem.entries.inputs)
    if rigid_body.count != heads:
        raise InputError(
            f"`rigid_body` must be RigidBody({heads}), a mode for every signal on the side with fewer; got"
            f" {rigid_body.count} modes"
        )
    if np.any(problem.angles == 0) or any(record.initial == "periodic" for record in problem.time):
        raise InputError(
            "`rigid_body`: a frequency point at omega = 0, or a record in periodic steady state, leaves no finite response of a"
            " rigid body; identify without that point, or with the spectral lines of the record"
        )
    return max(held, 2)


class _TimeIsOver(Exception):
    """Ends a search."""


class _Search:
    """Orders tried, with the best model of each."""

    def __init__(self, identification: Identification, integrators: int, budget: Budget, band: Known | None):
        self.identification, self.budget, self.band = identification, budget, band
        self.models = BestModels(identification, integrators, budget)

    def reduction(self) -> Reduction:
        """The smallest order within the bounds; of inconsistent data, else, within the bounds times their margin."""
        stopped = _LATE
        with Interruptible() as search, contextlib.suppress(_TimeIsOver):
            return self._result(self._searched())
        if search.interrupted:
            stopped = "interrupted"
            _log.warning("interrupted; the smallest order found so far is returned")
        return dataclasses.replace(self._result(self._so_far()), stopped=_stopped(stopped))

    def _searched(self) -> int:
        if not self.identification.consistent:
            few = [order for order in self._ladder() if order < _ONE_BY_ONE + self.models.chains]
            first = self._first(few)
            if first is not None:
                return self._downwards(first)
            self.models.widen()
        return self._downwards(self._smallest() if self.models.samples.heads == 1 else self._smallest_of_matrix())

    def _first(self, orders: list[int]) -> int | None:
        """The first of these orders that suffices."""
        for done, order in enumerate(orders):
            self.budget.tell(done, len(orders))
            if self.suffices(order):
                self.budget.tell(len(orders), len(orders))
                return order
        return None

    def _so_far(self) -> int:
        """The smallest order found within the limit; where there is none, the first of some truncations with new numerators."""
        models = self.models
        for widen in (False, True):
            if widen and not self.identification.consistent and models.limit == 1:
                models.widen()
            within = [order for order in models.found if models.within(order)]
            if within:
                return min(within)
        after = Pieces(Budget(_AFTER))
        low = max(models.found, default=models.chains)
        return _between(low, self.identification.order, lambda order: after.begins() and models.truncate(order))

    def _smallest(self) -> int:
        """Upwards to the first order that suffices, with gaps from some order on; then the orders in the gap."""
        full, ladder = self.identification.order, self._ladder()
        first = self._first(ladder)
        high = full if first is None else first
        low = max((order for order in ladder if order < high), default=self.models.chains - 1)
        return _between(low, high, self.suffices)

    def _smallest_of_matrix(self) -> int:
        """Twice as many poles until they suffice, then the orders between by halves; after a narrow miss the next order. Below
        what truncation leads to, which takes hardly any time.
        """
        chains, low, high = self.models.chains, self.models.chains - 1, self._truncated()
        while high - low > 1:
            self.budget.tell(low + 1 - chains, self.identification.order - chains)
            order = self._next(low, high)
            low, high = (low, order) if self.suffices(order) else (order, high)
        return high

    def _truncated(self) -> int:
        """The first order of some truncations that suffices."""

        def suffices(order: int) -> bool:
            self._go_on()
            return self.models.truncate(order)

        return _between(self.models.chains, self.identification.order, suffices)

    def _next(self, low: int, high: int) -> int:
        """The order of a matrix that is tried after one that doesn't suffice, `low`, below one that does or the whole, `high`."""
        models, count = self.models, low - self.models.chains
        if low in models.found and models.found[low].judged <= _NARROWLY * models.limit:
            return low + 1
        doubled = max(2 * count, 2) if count >= REFINED else min(max(2 * count, 2), REFINED)
        return min((low + high) // 2, models.chains + doubled)

    def _ladder(self) -> list[int]:
        """Orders on the way up, with gaps from some order on."""
        orders, order = list[int](), self.models.chains
        while order < self.identification.order:
            orders.append(order)
            order += max(1, (order - _ONE_BY_ONE) // 6)
        return orders

    def _downwards(self, order: int) -> int:
        """The lowest order that truncation leads to, from a model to one of the order below, and so on."""
        while order in self.models.fits and order > self.models.chains:
            self.models.shorten(order - 1)
            if not self.suffices(order - 1):
                break
            order -= 1
        return order

    def _go_on(self) -> None:
        """End the search where its time is over."""
        if self.budget.over:
            raise _TimeIsOver

    def suffices(self, order: int) -> bool:
        """Tell whether a model of this order was found that keeps the limit."""
        self._go_on()
        if order not in self.models.found:
            self.models.search(order)
        return self.models.within(order)

    def _result(self, order: int) -> Reduction:
        identification = self.identification
        if self.band is not None:
            move_towards(self.models, order, self.band)
        tried = {k: found.judged for k, found in self.models.found.items()}
        if not self.models.within(order):
            return _unreduced(identification, tried, self.models.truncated)
        _, margin, model = self.models.found[order]
        whole = self.models.truncated(identification.order)
        return _reduction(whole, model, order, margin, np.inf, self._status(margin), tried)

    def _status(self, margin: float) -> SearchStatus:
        if self.identification.consistent:
            return SearchStatus.WITHIN
        return SearchStatus.OUTSIDE if margin <= 1 else SearchStatus.INFLATED


def _unreduced(
    identification: Identification, tried: dict[int, float], truncated: Callable[[int], Reduction]
) -> Reduction:
    """The identified model itself, with its own free responses, not refitted ones: the residuals that identify verified."""
    margin, order = max(float(r.ratio.max()) for r in identification.residuals), identification.order
    known = tried | {order: margin}
    return _reduction(truncated(order), identification.model, order, margin, 0.0, SearchStatus.UNREDUCED, known)


def _reduction(
    whole: Reduction,
    model: control.StateSpace,
    order: int,
    margin: float,
    bound: float,
    status: SearchStatus,
    tried: dict[int, float],
) -> Reduction:
    """A model of an order, beside the Hankel singular values of the `whole` identified one."""
    return Reduction(
        model,
        order=order,
        hankel=whole.hankel,
        bound=bound,
        bounds=whole.bounds,
        status=status,
        margin=margin,
        tried=tuple(sorted(tried.items())),
    )


def _stopped(why: str) -> str:
    return f"{why}: a smaller order may suffice"


def _between(low: int, high: int, suffices: Callable[[int], bool]) -> int:
    """The order that suffices after one that doesn't, by halves, between `low`, which doesn't, and `high`, which is to do so."""
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if suffices(middle) else (middle, high)
    return high

"""Balanced truncation: square-root method, Gramian factors straight from the Stein or Lyapunov equation."""

from __future__ import annotations

import dataclasses
import enum
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
import scipy.linalg

from robustid.core import Frozen, Real, as_count, as_float, balancing, freeze, threads_for
from robustid.errors import InputError
from robustid.figures import Drawable
from robustid.identification import check_model
from robustid.reduction.gramians import (
    Factors,
    Parts,
    doubtful_distance,
    gramian_factors,
    partial_gramian_factors,
    split,
)

if TYPE_CHECKING:
    import control

__all__ = [  # with what other rooms take from here
    "Reduction",
    "ReductionStatus",
    "balanced_truncation",
    "balanced_truncations",
    "doubtful_distance",
    "hankel_singular_values",
]

_EPS = np.finfo(float).eps

# Two Hankel singular values count as one in the bound only if they agree to rounding.
_EQUAL = 1e-12

# Relative bound of the default: far below any measurement, far above the rounding of the Gramians.
_DEFAULT_TOL = 1e-8


class ReductionStatus(enum.Enum):
    """Status of a truncation; the value is the user's sentence."""

    REDUCED = "reduced: the error stays within `bound`"
    FEWER = "reduced further than asked: the states above `order` are rounding noise of the model itself"
    UNBOUNDED = "reduced, and stable; no a-priori bound of the error holds for a band, a horizon or a weight"
    UNSTABLE = "reduced, but to an unstable model, as a band or a horizon can: take another order, or widen it"
    UNREDUCED = "not reduced: no lower order was asked for or meets the tolerance; the model is the one given"


@dataclasses.dataclass(frozen=True, eq=False)
class Reduction(Frozen, Drawable):
    """A smaller model, and how far it can be from the one it came from.

    Attributes
    ----------
    model : control.StateSpace
        The reduced model: same dt, same signals; kept unstable states come first.
    order : int
        Its number of states.
    hankel : (n,) array
        Hankel singular values of the stable part, descending, in output units per input unit; those of the band, the
        horizon or with the weight where one was given.
    bound : float
        Of the distance to the model that was reduced: ``bounds[order]``, unless a search took another kind of candidate or
        started from another model (then inf: unknown).
    bounds : (N + 1,) array
        For every order 0..N: twice the sum of the distinct truncated Hankel singular values, a bound of
        max over frequency of the largest singular value of the error. ``inf`` below the number of unstable
        states, which can't be truncated, and for a band, a horizon or a weight, for which no bound is known. The last
        is 0: there nothing is truncated.
    status : enum.Enum
        What happened; its value is a sentence.
    margin : float or None
        Largest residual over bound, where the reduction had data to respect.
    tried : tuple
        Orders tried, with their margins, where there was a search.
    stopped : str
        Why a search ended before it was done, in words; else empty.
    """

    model: control.StateSpace
    _: dataclasses.KW_ONLY
    order: int
    hankel: Real
    bound: float
    bounds: Real
    status: enum.Enum = ReductionStatus.REDUCED
    margin: float | None = None
    tried: tuple[tuple[int, float], ...] = ()
    stopped: str = ""

    def __post_init__(self) -> None:
        self._set(hankel=freeze(self.hankel), bounds=freeze(self.bounds))


def balanced_truncation(
    model: control.StateSpace,
    *,
    order: int | None = None,
    tol: float | None = None,
    unstable: str = "refuse",
    band_hz: tuple[float, float] | None = None,
    horizon: float | None = None,
    weight: control.StateSpace | None = None,
    match: str | None = None,
) -> Reduction:
    r"""Truncate the states that matter least between input and output, with an error bound for every order.

    .. math:: \max_\omega \bar\sigma(G - G_r) \le 2 \sum_{k > r} \sigma_k \quad\text{(distinct } \sigma_k)

    where σ are the Hankel singular values. Holds in continuous and in discrete time; the feedthrough D is
    kept, so order 0 is the static gain D, unless `match` says otherwise.

    Parameters
    ----------
    model : control.StateSpace
        n states, any number of inputs and outputs; continuous (``dt=0``) or discrete.
    order : int, optional
        Number of states to keep, unstable ones included, 0..n. Order n gives the model back as it is.
    tol : float, optional
        Instead of `order`: the smallest order with ``bound <= tol * hankel[0]``. Default 1e-8, which removes
        only what neither measurement nor simulation can show. Where no lower order meets it, the model comes
        back unreduced and `status` says so.
    unstable : {"refuse", "keep"}
        Poles on or outside the stability boundary, integrators included: refuse them, or split them off
        exactly, reduce the stable part, and put them back. A pole counts as unstable if rounding can't tell
        it from the boundary.
    band_hz : (low, high), optional
        Only these frequencies in Hz count: Gramians over the band. ``high`` may be inf.
    horizon : float, optional
        Only the first so many seconds of the impulse response count.
    weight : control.StateSpace, optional
        Stable W: W (G - G_r) is to be small, not G - G_r. SISO, or with as many inputs as `model` has outputs.
    match : {None, "static gain"}
        "static gain": the states that go take their steady state instead of zero, so that the stable part keeps
        its gain at frequency zero exactly, with the same bound.

    Returns
    -------
    Reduction
        Its `model` is the leading part of a balanced realisation of the stable part. In continuous time that
        part is itself balanced, both Gramians diag(hankel[:order]); in discrete time it isn't in general.

    Raises
    ------
    InputError, InputTypeError
        If `model` isn't a finite StateSpace with known time base, has unstable poles that are to be refused,
        or if `order` or `tol` is out of range or both are given; for more than one of `band_hz`, `horizon` and
        `weight`, or one of them without `order`.

    Notes
    -----
    The Gramians are never formed: Hammarling's method gives their factors in complex Schur form, one column a
    pole, for poles arbitrarily close to the boundary and for Gramians that are numerically singular, where a
    Cholesky factorisation of the solution fails. The bound is that of exact arithmetic. Rounding of A alone
    moves the response of a lightly damped model by about eps·|A|/(distance of the nearest pole to the
    boundary) of its peak; below that (1e-9 in mechanical benchmarks of 300 states) no bound can be seen in
    numbers. States below n·eps·hankel[0] are never kept in a truncated model.

    For a band, a horizon or a weight no a-priori bound is known: `order` must be given; `hinf_error` tells the
    error. The weight stands at the outputs only (Enns's method, one side weighted): the controllability Gramian
    is then the ordinary one and the truncated model is stable, as weights on both sides don't guarantee. Bands and
    horizons don't either: the poles are looked at, and `status` tells.

    References
    ----------
    Enns 1984 (`enns1984`; weights too) and Glover 1984 (continuous), Hinrichsen and Pritchard 1990 (discrete) for
    the bound; Tombs and Postlethwaite 1987 for the square-root method; Hammarling 1982, in the form of Sorensen and
    Zhou 2003; Gawronski and Juang 1990 (`gawronski1990`) for bands and horizons; Liu and Anderson 1989 (`liu1989`)
    for the static gain.

    Examples
    --------
    >>> import control, robustid as rid
    >>> model = control.ss([[0.9, 0.0], [0.0, 0.1]], [[1.0], [0.1]], [[1.0, 0.1]], 0.0, 0.01)
    >>> reduction = rid.balanced_truncation(model, order=1)
    >>> reduction.order, bool(reduction.bound < 0.03 * reduction.hankel[0])
    (1, True)
    >>> exact = rid.balanced_truncation(model, order=1, match="static gain").model
    >>> bool(abs(exact.dcgain() - model.dcgain()) < 1e-12)
    True
    """
    system = check_model("model", model)
    for name, value, known in (("unstable", unstable, ("refuse", "keep")), ("match", match, (None, "static gain"))):
        if value not in known:
            raise InputError(f"`{name}` must be {' or '.join(map(_quoted, known))}; got {value!r}")
    if order is not None and tol is not None:
        raise InputError(f"give `order` or `tol`, not both; got order={order!r} and tol={tol!r}")
    if order is not None:
        order = as_count("order", order)
        if order > system.nstates:
            raise InputError(f"`order` must be at most the order of the model, {system.nstates}; got {order}")
    limits = {"band_hz": band_hz, "horizon": horizon, "weight": weight}
    given = [f"`{name}`" for name, value in limits.items() if value is not None]
    if len(given) > 1:
        raise InputError(f"give one of `band_hz`, `horizon` and `weight`; got {' and '.join(given)}")
    if given and order is None:
        raise InputError(f"`order` is needed with {given[0]}: there is no a-priori bound to hold a tolerance against")
    tol = _DEFAULT_TOL if tol is None else as_float("tol", tol)
    if tol < 0:
        raise InputError(f"`tol` must be >= 0: a bound relative to the largest Hankel value; got {tol:g}")
    with threads_for(system.nstates):
        stable, kept = split(system, unstable)
        held = kept.a.shape[0]
        if order is not None and order < held:
            raise InputError(f"`order` must be at least {held}, the number of unstable states to keep; got {order}")
        factors = None
        if given:
            factors = partial_gramian_factors(system, stable, band_hz=band_hz, horizon=horizon, weight=weight)
        return _Balanced(system, stable, kept, factors, match).truncate(order, tol)


def _quoted(word: str | None) -> str:
    return "None" if word is None else f'"{word}"'


class _Balanced:
    """Balanced coordinates of one model, computed once for every order."""

    def __init__(
        self,
        system: control.StateSpace,
        stable: Parts,
        kept: Parts,
        factors: Factors | None = None,
        match: str | None = None,
    ):
        self.system, self.stable, self.kept, self.match = system, stable, kept, match
        self.held, self.bounded, states = kept.a.shape[0], factors is None, stable.a.shape[0]
        self.balancing = balancing(*(factors or gramian_factors(stable, discrete=system.dt != 0)))
        hankel = self.balancing.hankel
        self.hankel = np.concatenate([hankel, np.zeros(states - hankel.size)])
        bounds = _error_bounds(self.hankel)
        if not self.bounded:
            bounds[:-1] = np.inf
        self.bounds = np.concatenate([np.full(self.held, np.inf), bounds])

    def truncate(self, order: int | None, tol: float = _DEFAULT_TOL) -> Reduction:
        """The model of one order, or of the smallest order that meets a relative bound."""
        hankel, largest = self.hankel, np.max(self.hankel, initial=0.0)
        significant = self.held + int(np.sum(hankel > hankel.size * _EPS * largest))
        full = self.system.nstates
        status = ReductionStatus.REDUCED if self.bounded else ReductionStatus.UNBOUNDED
        if order is None:
            chosen = int(np.argmax(self.bounds <= tol * largest))  # the last bound, 0, always meets it
            if chosen > significant:
                chosen = full
        elif significant < order < full:
            chosen, status = significant, ReductionStatus.FEWER
        else:
            chosen = order
        if chosen == full:
            reduced, status = self.system, ReductionStatus.UNREDUCED
        else:
            reduced, stable = self._model(chosen - self.held)
            status = status if stable else ReductionStatus.UNSTABLE
        bound = float(self.bounds[chosen])
        return Reduction(reduced, order=chosen, hankel=hankel, bound=bound, bounds=self.bounds, status=status)

    def _model(self, keep: int) -> tuple[control.StateSpace, bool]:
        """The model with so many states of the stable part, and whether those are stable."""
        import control

        feedthrough, discrete = self.system.D, self.system.dt != 0
        if self.match is None:
            small = Parts(*self.balancing.truncated(*self.stable, keep))
        else:
            into, onto = self.balancing.projections(keep)
            small, feedthrough = _in_steady_state(self.stable, feedthrough, into, onto, discrete=discrete)
        poles = np.linalg.eigvals(small.a)
        stable = bool(np.all(np.abs(poles) < 1 if discrete else poles.real < 0))
        return control.StateSpace(
            scipy.linalg.block_diag(self.kept.a, small.a),
            np.vstack([self.kept.b, small.b]),
            np.hstack([self.kept.c, small.c]),
            feedthrough,
            self.system.dt,
            inputs=self.system.input_labels,
            outputs=self.system.output_labels,
        ), stable


def _in_steady_state(parts: Parts, feedthrough: Real, into: Real, onto: Real, *, discrete: bool) -> tuple[Parts, Real]:
    """The states that go take their steady state `liu1989`: truncation of G(1/s), with z - 1 for s in discrete time."""
    solved = np.linalg.solve(parts.a - discrete * np.eye(len(parts.a)), np.hstack([into, parts.b]))
    states, drive = np.hsplit(solved, [into.shape[1]])
    a = np.linalg.inv(onto @ states)
    b, c = a @ (onto @ drive), parts.c @ states @ a
    feedthrough = feedthrough - parts.c @ drive + parts.c @ states @ b
    return Parts(a + discrete * np.eye(len(a)), b, c), feedthrough


def balanced_truncations(model: control.StateSpace) -> Callable[[int], Reduction]:
    """Order to balanced truncation of `model`, unstable states kept: Gramians are computed once for all orders."""
    system = check_model("model", model)
    return _Balanced(system, *split(system, "keep")).truncate


def hankel_singular_values(model: control.StateSpace) -> Real:
    """Square roots of the eigenvalues of the product of both Gramians, descending, (n,).

    Parameters
    ----------
    model : control.StateSpace
        Stable, continuous or discrete.

    Raises
    ------
    InputError, InputTypeError
        If `model` isn't a finite, stable StateSpace with known time base.

    Examples
    --------
    >>> import control
    >>> from robustid.reduction import hankel_singular_values
    >>> hankel_singular_values(control.ss(-1.0, 1.0, 4.0, 0.0)).round(12)
    array([2.])
    """
    system = check_model("model", model)
    with threads_for(system.nstates):
        left, right = gramian_factors(split(system, "refuse")[0], discrete=system.dt != 0)
        return np.asarray(scipy.linalg.svdvals(left.T @ right))


def _error_bounds(hankel: Real) -> Real:
    """Twice the sum of the distinct truncated values, for every order 0..n."""
    bounds = np.zeros(hankel.size + 1)
    for r in range(hankel.size - 1, -1, -1):
        group = hankel[r + 1 :][hankel[r + 1 :] >= hankel[r] * (1 - _EQUAL)].size
        bounds[r] = bounds[r + 1 + group] + 2 * hankel[r]
    return bounds

"""Balanced truncation: square-root method, Gramian factors straight from the Stein or Lyapunov equation."""

from __future__ import annotations

import dataclasses
import enum
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.linalg as sla

from robustid._arrays import Frozen, as_count, as_float, freeze
from robustid.errors import InputError
from robustid.identification.validation import check_model
from robustid.reduction.gramians import Parts, doubtful_distance, gramian_factors, scaled, split

if TYPE_CHECKING:
    import control

__all__ = [  # with what other rooms take from here
    "Reduction",
    "ReductionStatus",
    "balanced_truncation",
    "balanced_truncations",
    "doubtful_distance",
    "hankel_singular_values",
    "scaled",
]

_EPS = np.finfo(float).eps

# Two Hankel singular values count as one in the bound only if they agree to rounding.
_EQUAL = 1e-12

# Relative bound of the default: far below any measurement, far above the rounding of the Gramians.
_DEFAULT_TOL = 1e-8


class ReductionStatus(enum.Enum):
    """What a truncation did; the value is the user's sentence."""

    REDUCED = "reduced: the error stays within `bound`"
    FEWER = "reduced further than asked: the states above `order` are rounding noise of the model itself"
    UNREDUCED = "not reduced: no lower order was asked for or meets the tolerance; the model is the one given"


@dataclasses.dataclass(frozen=True, eq=False)
class Reduction(Frozen):
    """A smaller model, and how far it can be from the one it came from.

    Attributes
    ----------
    model : control.StateSpace
        The reduced model: same dt, same channels; kept unstable states come first.
    order : int
        Its number of states.
    hankel : (n,) array
        Hankel singular values of the stable part, descending, in output units per input unit.
    bound : float
        Of the distance to the model that was reduced: ``bounds[order]``, unless a search took another kind of candidate or
        started from another model (then inf: unknown).
    bounds : (N + 1,) array
        For every order 0..N: twice the sum of the distinct truncated Hankel singular values, a bound of
        max over frequency of the largest singular value of the error. ``inf`` below the number of unstable
        states, which can't be truncated. The last is 0: there nothing is truncated.
    status : enum.Enum
        What happened; its value is a sentence.
    margin : float or None
        Largest residual over bound, where the reduction had data to respect.
    tried : tuple
        Orders tried, with their margins, where there was a search.
    """

    model: control.StateSpace
    _: dataclasses.KW_ONLY
    order: int
    hankel: np.ndarray
    bound: float
    bounds: np.ndarray
    status: enum.Enum = ReductionStatus.REDUCED
    margin: float | None = None
    tried: tuple = ()

    def __post_init__(self) -> None:
        self._set(hankel=freeze(self.hankel), bounds=freeze(self.bounds))


def balanced_truncation(
    model: control.StateSpace, *, order: int | None = None, tol: float | None = None, unstable: str = "refuse"
) -> Reduction:
    r"""Truncate the states that matter least between input and output, with an error bound for every order.

    .. math:: \max_\omega \bar\sigma(G - G_r) \le 2 \sum_{k > r} \sigma_k \quad\text{(distinct } \sigma_k)

    where σ are the Hankel singular values. Holds in continuous and in discrete time; the feedthrough D is
    kept, so order 0 is the static gain D.

    Parameters
    ----------
    model : control.StateSpace
        n states, any number of channels; continuous (``dt=0``) or discrete.
    order : int, optional
        Number of states to keep, unstable ones included, 0..n. Order n gives the model back as it is.
    tol : float, optional
        Instead of `order`: the smallest order with ``bound <= tol * hankel[0]``. Default 1e-8, which removes
        only what neither measurement nor simulation can show. Where no lower order meets it, the model comes
        back unreduced and `status` says so.
    unstable : {"refuse", "keep"}
        Poles on or outside the stability boundary, integrators included: refuse them, or split them off
        exactly, reduce the stable rest, and put them back. A pole counts as unstable if rounding can't tell
        it from the boundary.

    Returns
    -------
    Reduction
        Its `model` is the leading part of a balanced realisation of the stable part. In continuous time that
        part is itself balanced, both Gramians diag(hankel[:order]); in discrete time it isn't in general.

    Raises
    ------
    InputError, InputTypeError
        If `model` isn't a finite StateSpace with known time base, has unstable poles that are to be refused,
        or if `order` or `tol` is out of range or both are given.

    Notes
    -----
    The Gramians are never formed: Hammarling's method gives their factors in complex Schur form, one column a
    pole, for poles arbitrarily close to the boundary and for Gramians that are numerically singular, where a
    Cholesky factorisation of the solution fails. The bound is that of exact arithmetic. Rounding of A alone
    moves the response of a lightly damped model by about eps·|A|/(distance of the nearest pole to the
    boundary) of its peak; below that (1e-9 in mechanical benchmarks of 300 states) no bound can be seen in
    numbers. States below n·eps·hankel[0] are never kept in a truncated model.

    References
    ----------
    Enns 1984 and Glover 1984 (continuous), Hinrichsen and Pritchard 1990 (discrete) for the bound; Tombs and
    Postlethwaite 1987 for the square-root method; Hammarling 1982, in the form of Sorensen and Zhou 2003.

    Examples
    --------
    >>> import control, robustid as rid
    >>> model = control.ss([[0.9, 0.0], [0.0, 0.1]], [[1.0], [0.1]], [[1.0, 0.1]], 0.0, 0.01)
    >>> reduction = rid.balanced_truncation(model, order=1)
    >>> reduction.order, bool(reduction.bound < 0.03 * reduction.hankel[0])
    (1, True)
    """
    system = check_model("model", model)
    if unstable not in ("refuse", "keep"):
        raise InputError(f'`unstable` must be "refuse" or "keep"; got {unstable!r}')
    if order is not None and tol is not None:
        raise InputError(f"give `order` or `tol`, not both; got order={order!r} and tol={tol!r}")
    if order is not None:
        order = as_count("order", order)
        if order > system.nstates:
            raise InputError(f"`order` must be at most the order of the model, {system.nstates}; got {order}")
    tol = _DEFAULT_TOL if tol is None else as_float("tol", tol)
    if tol < 0:
        raise InputError(f"`tol` must be >= 0: a bound relative to the largest Hankel value; got {tol:g}")
    stable, kept = split(system, unstable)
    held = kept.a.shape[0]
    if order is not None and order < held:
        raise InputError(f"`order` must be at least {held}, the number of unstable states to keep; got {order}")

    return _Balanced(system, stable, kept).truncate(order, tol)


class _Balanced:
    """Balanced coordinates of one model, computed once for every order."""

    def __init__(self, system: Any, stable: Parts, kept: Parts):
        self.system, self.stable, self.kept = system, stable, kept
        self.held = kept.a.shape[0]
        self.left, self.right = gramian_factors(stable, discrete=system.dt != 0)
        self.rotate_left, self.hankel, self.rotate_right = sla.svd(self.left.T @ self.right)
        self.bounds = np.concatenate([np.full(self.held, np.inf), _error_bounds(self.hankel)])

    def truncate(self, order: int | None, tol: float = _DEFAULT_TOL) -> Reduction:
        """The model of one order, or of the smallest order that meets a relative bound."""
        hankel, largest = self.hankel, np.max(self.hankel, initial=0.0)
        significant = self.held + int(np.sum(hankel > hankel.size * _EPS * largest))
        full = self.system.nstates
        status = ReductionStatus.REDUCED
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
            keep = chosen - self.held
            into = self.right @ self.rotate_right[:keep].T / np.sqrt(hankel[:keep])
            onto = (self.left @ self.rotate_left[:, :keep] / np.sqrt(hankel[:keep])).T
            small = Parts(onto @ self.stable.a @ into, onto @ self.stable.b, self.stable.c @ into)
            reduced = _assemble(self.system, self.kept, small)
        bound = float(self.bounds[chosen])
        return Reduction(reduced, order=chosen, hankel=hankel, bound=bound, bounds=self.bounds, status=status)


def balanced_truncations(model: control.StateSpace) -> Callable[[int], Reduction]:
    """Order to balanced truncation of `model`, unstable states kept: Gramians are computed once for all orders."""
    system = check_model("model", model)
    return _Balanced(system, *split(system, "keep")).truncate


def hankel_singular_values(model: control.StateSpace) -> np.ndarray:
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
    left, right = gramian_factors(split(system, "refuse")[0], discrete=system.dt != 0)
    return np.asarray(sla.svdvals(left.T @ right))


def _error_bounds(hankel: np.ndarray) -> np.ndarray:
    """Twice the sum of the distinct truncated values, for every order 0..n."""
    bounds = np.zeros(hankel.size + 1)
    for r in range(hankel.size - 1, -1, -1):
        group = hankel[r + 1 :][hankel[r + 1 :] >= hankel[r] * (1 - _EQUAL)].size
        bounds[r] = bounds[r + 1 + group] + 2 * hankel[r]
    return bounds


def _assemble(model: Any, kept: Parts, small: Parts) -> control.StateSpace:
    import control

    return control.StateSpace(
        sla.block_diag(kept.a, small.a),
        np.vstack([kept.b, small.b]),
        np.hstack([kept.c, small.c]),
        model.D,
        model.dt,
        inputs=model.input_labels,
        outputs=model.output_labels,
    )

"""Models made passive or smaller with passivity kept and proved: truncation by Riccati equations, and the nearest passive gains."""

from __future__ import annotations

import dataclasses
import enum
from typing import TYPE_CHECKING

import numpy as np
import scipy.linalg

from robustid.core import Frozen, Real, StateMatrices, as_count, as_kind, balancing, one_thread, threads_for
from robustid.data import FrequencyResponse
from robustid.errors import InputError
from robustid.passivity.passive_compliance import nearest_compliances
from robustid.passivity.passive_fit import STRICT, like, nearest, radius_of, response_of, smallest_ratio
from robustid.passivity.passivity import Passivity, check_passive_input, prove_passive
from robustid.passivity.passivity_certificate import BOUNDED, NEGATIVE
from robustid.passivity.passivity_search import Popov
from robustid.reduction import hinf_error

if TYPE_CHECKING:
    import control

_LIFTS = (0.0, 1e-8, 1e-6, 1e-4, 1e-2)  # of the limit, relative to the size, until the Riccati equations have solutions
_NUDGES = 6
_FURTHER = 3  # orders below the smallest one that truncation finds in which nothing was found, before the search ends


class PassiveStatus(enum.Enum):
    """Status of a passive model; the value is the user's sentence."""

    PASSIVE = "passive, with proof"
    OUTSIDE = "passive, with proof; some samples are outside their bounds, as no passive model found keeps all"
    UNPROVED = "not proved passive: `passivity` says what was found"


@dataclasses.dataclass(frozen=True, eq=False)
class PassiveModel(Frozen):
    """A passive model, its proof, and how far it is from the one that it came from and from the data.

    Attributes
    ----------
    model : control.StateSpace
        Same ports.
    order : int
        Its number of states.
    passivity : Passivity
        The proof.
    status : PassiveStatus
    error : float
        Largest singular value of the difference to the model given, over all frequencies.
    margin : float or None
        Largest |residual| over bound, where there is a response with bounds.
    tried : tuple of (order, margin)
        Orders that were tried, where there is such a response.
    values : (n,) array
        Of a reduction: the characteristic values of the Riccati equations, descending, between 0 and 1; small ones are truncated
        at little cost. Of a bounded-real model twice their sum bounds `error`, but for what proof and data then take.
    """

    model: control.StateSpace
    _: dataclasses.KW_ONLY
    order: int
    passivity: Passivity
    status: PassiveStatus
    error: float
    margin: float | None = None
    tried: tuple[tuple[int, float], ...] = ()
    values: Real = dataclasses.field(default_factory=lambda: np.zeros(0))


@one_thread()
def reduce_passive(
    model: control.StateSpace,
    *,
    kind: str = BOUNDED,
    order: int | None = None,
    response: FrequencyResponse | None = None,
) -> PassiveModel:
    r"""Truncate the states of a passive model that matter least, and prove that what is left is passive.

    .. math:: A^T P + P A + C^T C + (P B + C^T D)(I - D^T D)^{-1}(P B + C^T D)^T = 0

    and its dual (bounded real; positive real likewise) have solutions instead of Gramians; in coordinates where both are the same
    diagonal matrix every truncation is passive again.

    Parameters
    ----------
    model : control.StateSpace
        Continuous, stable and passive; a model that isn't passive goes through `make_passive` first.
    kind : {"bounded real", "positive real"}, optional
    order : int, optional
        Number of states to keep.
    response : FrequencyResponse, optional
        Measured, without `dt`, with bounds: the smallest order found that stays inside every bound. Below the orders at which
        truncation does, C and D are fitted to the data again, among the passive ones (`make_passive`), in the truncated states.

    Returns
    -------
    PassiveModel

    Raises
    ------
    InputError, InputTypeError
        Not exactly one of `order` and `response`; a response without bounds, discrete, or of other ports; a model that isn't
        continuous, stable and square; one that isn't passive.

    Notes
    -----
    A model on the edge (lossless at a frequency) is reduced for a limit a little beyond (1 + 1e-8, ...); what is then too much is
    taken from C and D, or added to D, so that the proof holds.

    Source: `opdenacker1988` for the bounded-real, `desai1984` for the positive-real kind.

    Examples
    --------
    >>> import numpy as np, control, robustid as rid
    >>> poles = np.array([-1.0, -3.0, -10.0, -30.0])
    >>> impedance = control.StateSpace(np.diag(poles), np.ones((4, 1)), np.ones((1, 4)), 0.1, 0)
    >>> small = rid.passive.reduce_passive(impedance, kind="positive real", order=2)
    >>> small.passivity.holds, small.order, bool(small.error < 0.12)
    (True, 2, True)
    """
    if kind == NEGATIVE:
        raise InputError(
            '`kind` must be "bounded real" or "positive real" here: a truncated compliance is not negative imaginary by itself. Fit'
            ' fewer poles, and make that model negative imaginary: make_passive(model, kind="negative imaginary", response=...)'
        )
    given = check_passive_input(model, kind)
    if (order is None) == (response is None):
        raise InputError(
            "give either `order`, the number of states to keep, or `response`, data with bounds to stay inside"
        )
    data = None if response is None else _with_bounds(response, given)
    if order is not None and as_count("order", order) > given.nstates:
        raise InputError(f"`order` must be at most the order of the model, {given.nstates}; got {order}")
    with threads_for(given.nstates):
        truncated = _Truncated(given, kind)
        if data is None:
            found = truncated.of(int(order or 0))
            return _result(given, found, prove_passive(found, kind=kind), values=truncated.values)
        return _smallest(given, kind, data, truncated)


@one_thread()
def make_passive(
    model: control.StateSpace, *, kind: str = BOUNDED, response: FrequencyResponse | None = None
) -> PassiveModel:
    r"""Find the passive model of the same order that is nearest to a model, or to data, and prove that it is passive.

    .. math:: \min_{C, D, P} \sum_k \| W_k \circ (Y_k - D - C (j\omega_k I - A)^{-1} B) \|_F^2 \quad\text{such that}\quad
        P \succ 0, \quad \begin{bmatrix} A^T P + P A & P B & C^T \\ B^T P & -I & D^T \\ C & D & -I \end{bmatrix} \prec 0

    (bounded real; positive real likewise). The problem is convex, and its minimum that over all passive models with these poles
    and input directions. With a response (and at most 24 states) all four matrices are then refined, in steps that each solve such
    a program: poles outside the band, which a fit places without a reason, may stand in the way of passivity.

    Parameters
    ----------
    model : control.StateSpace
        Continuous and stable, such as ``fit_mfd(...).model`` of measured scattering parameters.
    kind : {"bounded real", "positive real", "negative imaginary"}, optional
        Of "negative imaginary" (displacement per force) only the gains are moved, ``C = -B' A^-T X`` and a symmetric D.
    response : FrequencyResponse, optional
        Measured, without `dt`: Y, with W one over its bounds if it has any, else 1. Default: the response of the model itself at
        frequencies between and beyond those of its poles.

    Returns
    -------
    PassiveModel
        The model itself where it is passive already and no response is given.

    Raises
    ------
    InputError, InputTypeError
        A discrete or unstable model, one that is not square; a discrete response or one of other ports.

    Notes
    -----
    The inequality is solved as a semidefinite program (clarabel); in the refinement in coordinates where P = I, so that it is
    linear in the matrices of the model: every step is passive, and a local minimum is reached. Beside it C and D of a fit that
    is almost passive, then all its matrices, are moved by cutting planes, to rounding, and where poles lie beyond the data a fit
    of two poles fewer is another start. A solver's word is not taken: `prove_passive` judges the results, and what it finds
    beyond the limit is taken from C and D (bounded real: by a factor) or added to D (positive real).

    Source: `coelho2004` for the convex problem, `lanzon2008` for the negative-imaginary lemma.

    Examples
    --------
    >>> import control, robustid as rid
    >>> active = control.StateSpace([[-1.0, 0.0], [0.0, -5.0]], [[1.0], [1.0]], [[1.2, -0.1]], 0.0, 0)
    >>> passive = rid.passive.make_passive(active)
    >>> rid.prove_passive(active).holds, passive.passivity.holds, bool(passive.error < 0.2)
    (False, True, True)
    """
    given = check_passive_input(model, kind)
    data = None if response is None else _matching(response, given)
    with threads_for(given.nstates):
        if (proof := prove_passive(given, kind=kind)).holds and data is None:
            return _result(given, given, proof)
        if kind == NEGATIVE:
            found = [_compliance(given, data)]
        else:
            found = [_nudged(candidate, kind) for candidate in nearest(given, kind, data)]
        if data is not None and proof.holds:
            found.append((given, proof))
        proved = [each for each in found if each[1].holds] or found[:1]
        fitted = proved[0] if data is None else min(proved, key=lambda each: _squares(each[0], data))
        return _result(given, *fitted, data=data)


def _compliance(given: control.StateSpace, data: FrequencyResponse | None) -> tuple[control.StateSpace, Passivity]:
    """The nearest negative-imaginary model that is proved to be one; else the one that came nearest to a proof."""
    best = given, prove_passive(given, kind=NEGATIVE)
    for model in nearest_compliances(given, data):
        proof = prove_passive(model, kind=NEGATIVE)
        if proof.holds:
            return model, proof
        if proof.margin > best[1].margin:
            best = model, proof
    return best


def _matching(response: FrequencyResponse, model: control.StateSpace) -> FrequencyResponse:
    data = as_kind("response", response, FrequencyResponse, "a FrequencyResponse")
    if data.dt is not None:
        raise InputError(f"`response` must be one in continuous time, without `dt`; got dt = {data.dt:g}")
    if data.values.shape[1:] != (model.noutputs, model.ninputs):
        shape = " x ".join(map(str, data.values.shape[1:]))
        raise InputError(f"`response` must have the {model.noutputs} x {model.ninputs} entries of `model`; got {shape}")
    return data


def _with_bounds(response: FrequencyResponse, model: control.StateSpace) -> FrequencyResponse:
    data = _matching(response, model)
    if data.bound is None:
        raise InputError("`response` must have bounds to stay inside: FrequencyResponse(..., bound=...)")
    return data


def _result(
    given: control.StateSpace,
    model: control.StateSpace,
    proof: Passivity,
    *,
    data: FrequencyResponse | None = None,
    tried: tuple[tuple[int, float], ...] = (),
    values: Real | None = None,
) -> PassiveModel:
    margin = None if data is None or data.bound is None else _ratio(model, data)
    status = PassiveStatus.PASSIVE if margin is None or margin <= 1 else PassiveStatus.OUTSIDE
    return PassiveModel(
        model,
        order=model.nstates,
        passivity=proof,
        status=status if proof.holds else PassiveStatus.UNPROVED,
        error=hinf_error(given, model).value,
        margin=margin,
        tried=tried,
        values=np.zeros(0) if values is None else values,
    )


def _ratio(model: control.StateSpace, data: FrequencyResponse) -> float:
    """The largest |residual| over bound, as the bound means it."""
    if data.bound is None:
        return np.nan
    return float(np.max(data.bound.ratio(data.values - response_of(model, data.omega))))


def _squares(model: control.StateSpace, data: FrequencyResponse) -> float:
    """The sum of squares of residuals over bounds."""
    error = (data.values - response_of(model, data.omega)) / radius_of(data)
    return float(np.nansum(np.abs(error) ** 2))


def _nudged(model: control.StateSpace, kind: str) -> tuple[control.StateSpace, Passivity]:
    """The model with as much less of C and D, or more of D, as its proof needs; and the proof."""
    proof = prove_passive(model, kind=kind)
    for _ in range(_NUDGES):
        if proof.holds or not np.isfinite(proof.margin):
            break
        A, B, C, D = StateMatrices.of(model)
        if kind == BOUNDED:
            less = (1 - STRICT) / (1 - proof.margin)
            model = like(model, A, B, less * C, less * D)
        else:
            more = (1 + STRICT) * -proof.margin + STRICT * float(np.max(np.abs(D), initial=0.0))
            model = like(model, A, B, C, D + more * np.eye(len(D)))
        proof = prove_passive(model, kind=kind)
    return model, proof


class _Truncated:
    """Truncations of a passive model to any order, passive themselves: both Riccati equations are solved once."""

    def __init__(self, model: control.StateSpace, kind: str) -> None:
        self.model, self.kind = model, kind
        self.popov = Popov(kind, StateMatrices.of(model))
        self.balanced, self.values = None, np.zeros(0)
        if not model.nstates:
            return
        peak = self.popov.peak()[0]
        if peak > self.popov.limit + 1e-6 * self.popov.size:
            raise InputError(
                f"`model` must be passive to be reduced; it is beyond the limit by {peak - self.popov.limit:.3g}. "
                "make_passive(model) brings it there"
            )
        for lift in _LIFTS:
            both = self.popov.gramians(self.popov.limit + lift * self.popov.size)
            if both is not None:
                self.balanced = balancing(_root(both[0]), _root(both[1]))
                self.values = self.balanced.hankel
                return
        raise InputError(
            "`model` is too near to a lossless one: its Riccati equations have no solution in double precision"
        )

    def of(self, order: int) -> control.StateSpace | None:
        """The model of one order, passive with proof as far as there is one."""
        if self.balanced is None or order == self.model.nstates:
            return self.model
        A, B, C, D = self.popov.system
        a, b, c = self.balanced.truncated(A, B, C, order)
        root = np.sqrt(self.popov.unit)
        return _nudged(like(self.model, a * self.popov.unit, b * root, c * root, D), self.kind)[0]


def _root(P: Real) -> Real:
    """A factor of a positive semidefinite matrix; what is below zero is rounding."""
    values, vectors = scipy.linalg.eigh(P)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0)), dtype=float)


def _smallest(given: control.StateSpace, kind: str, data: FrequencyResponse, truncated: _Truncated) -> PassiveModel:
    """The smallest order found that is inside every bound: by truncation, then with gains fitted to the data below that."""
    tried: dict[int, float] = {}
    best, least = None, (_ratio(given, data), given)
    for order in range(given.nstates + 1):
        model = truncated.of(order)
        tried[order] = _ratio(model, data)
        if tried[order] <= 1:
            best = model
            break
    start = given if best is None else best
    missed = 0
    for order in range(start.nstates if best is None else start.nstates - 1, -1, -1):
        fitted = _nudged(smallest_ratio(truncated.of(order), kind, data), kind)[0]
        ratio = _ratio(fitted, data)
        tried[order], least = min(tried[order], ratio), min(least, (ratio, fitted), key=lambda each: each[0])
        if tried[order] <= 1:
            best, missed = fitted, 0
            continue
        missed += 1
        if missed == _FURTHER or best is None:
            break
    chosen = least[1] if best is None else best
    proof = prove_passive(chosen, kind=kind)
    return _result(given, chosen, proof, data=data, tried=tuple(sorted(tried.items())), values=truncated.values)

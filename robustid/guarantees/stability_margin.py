"""robust_stability_margin(): the small-gain condition of one controller for every plant of a set, on whole arcs of the circle."""

from __future__ import annotations

import dataclasses
import enum
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from robustid.core import Frozen, Real, one_thread
from robustid.errors import InputError
from robustid.guarantees.cells import INPUT, KINDS, Cells, Pieces, check_plant, enclose
from robustid.identification import check_model
from robustid.reduction import doubtful_distance

if TYPE_CHECKING:
    import control

_TOLERANCE = 1e-3  # a stated margin is at most so much below the one that the condition has


class MarginStatus(enum.Enum):
    """Verdict of the small-gain condition; the value is the user's sentence."""

    GUARANTEED = "guaranteed: the controller stabilises every plant of the set"
    OPEN = "not guaranteed: the nominal loop is stable, but the small-gain condition fails; a plant of the set may be unstable"
    UNSTABLE = "unstable: the loop of the controller and the nominal model is not stable"


@dataclasses.dataclass(frozen=True, eq=False)
class RobustStabilityMargin(Frozen):
    """Factor by which the uncertainty could grow before stability is no longer guaranteed.

    Attributes
    ----------
    margin : float
        Every plant whose error stays below `margin` times the bound is stabilised; 0 where the nominal loop is unstable.
        Above 1, all plants of the set are.
    frequency : float
        Where it is smallest, in rad/s.
    status : MarginStatus
    """

    margin: float
    frequency: float
    status: MarginStatus

    def __repr__(self) -> str:
        return f"<RobustStabilityMargin: {self.status.name.lower()}, margin {self.margin:.6g} at {self.frequency:.6g} rad/s>"

    @property
    def guaranteed(self) -> bool:
        """Return whether every plant of the set is stabilised."""
        return self.status is MarginStatus.GUARANTEED


@one_thread()
def robust_stability_margin(
    nominal: control.StateSpace, controller: control.StateSpace, edges: Any, bound: Any, *, kind: str = "additive"
) -> RobustStabilityMargin:
    r"""Robust stability margin of a controller against every plant within a bound of the nominal model.

    With negative feedback ``u = -K y``, sensitivity ``S = (I + F_id K)^{-1}`` and ``T = I - S``, every loop is stable if the
    nominal one is and, for all frequencies,

    .. math:: b\,\bar\sigma(K S) < 1, \quad b\,\bar\sigma(T) < 1, \quad b\,\bar\sigma(T_u) < 1, \quad b\,\bar\sigma(S) < 1

    for an additive, multiplicative (at the outputs, at the inputs: ``T_u = K S F_id``) and inverse multiplicative bound b.
    The margin is the smallest reciprocal of the left side. For a bound per entry (additive) it is that of the spectral
    radius of :math:`[b_{ij}]\,[|KS|_{ij}]`, which does not
    depend on the units of the signals.

    Parameters
    ----------
    nominal : control.StateSpace
        F_id, discrete; it may have unstable poles, integrators too.
    controller : control.StateSpace
        K, from the outputs to the inputs of the nominal model, with its sample time.
    edges : (C + 1,) array
        Edges of the cells in rad/s, from 0 to pi/dt.
    bound : (C,) or (C, ny, nu) array
        Bound of ``|F - F_id|`` on each cell, or of the relative error (see `uncertainty_weight`).
    kind : {"additive", "multiplicative", "input_multiplicative", "inverse"}

    Returns
    -------
    RobustStabilityMargin
        `margin` is at most 0.1 % below what the condition gives.

    Raises
    ------
    InputError, InputTypeError
        If the models don't fit together, or the cells don't cover the whole circle.

    Notes
    -----
    Assumes what `identify` gives: all plants have the unstable poles of the nominal model and no others (for a bound of
    the relative error, so does ``F - F_id``). Frequencies between the edges are enclosed, not sampled. The
    stability of the nominal loop is that of its computed eigenvalues, with a first-order bound of their rounding.

    References
    ----------
    Zhou, Doyle and Glover, chapter 9 `zhou1996`; the spectral radius of non-negative matrices, `horn2013` section 8.1.

    Examples
    --------
    >>> import control
    >>> from robustid.guarantees import robust_stability_margin
    >>> nominal = control.ss(0.5, 1.0, 1.0, 0.0, 1.0)
    >>> gain = control.ss([], [], [], 0.25, 1.0)  # K S = 0.25 (z - 0.5)/(z - 0.25), at most 0.3 in modulus (z = -1)
    >>> result = robust_stability_margin(nominal, gain, [0.0, 1.0, 3.141592653589793], [0.5, 0.5])
    >>> round(result.margin, 1), result.guaranteed
    (6.7, True)
    """
    plant = check_plant(nominal)
    cells = Cells.read(edges, bound, float(plant.dt), plant)
    if kind not in KINDS:
        raise InputError(f"`kind` must be one of {KINDS}; got {kind!r}")
    if cells.angles[0] > 0:
        raise InputError(
            f"`edges` must start at 0; got {cells.edges[0]:g} rad/s, and nothing bounds the error below. Where the plant has"
            ' an integrator, take a relative bound: uncertainty_weight(..., kind="multiplicative", below=...)'
        )
    if kind != "additive" and cells.bound.ndim > 1 and cells.bound[0].size > 1:
        raise InputError(f"`bound` of kind {kind!r} must have shape (C,): one bound of the largest singular value")
    controller = _check_controller(controller, plant)
    # K F_id (I + K F_id)^-1 is what the loop with both exchanged has at its outputs.
    loop = _loop(controller, plant, "multiplicative") if kind == INPUT else _loop(plant, controller, kind)
    loop.dt = plant.dt  # a static controller may have none
    poles, doubt = doubtful_distance(loop.A)
    if np.any(1 - np.abs(poles) <= doubt):
        worst = poles[np.argmax(np.abs(poles))]
        return RobustStabilityMargin(0.0, float(np.abs(np.angle(worst)) / plant.dt), MarginStatus.UNSTABLE)
    gain, angle = _largest_gain(loop, cells)
    margin = 1 / gain if gain else np.inf
    status = MarginStatus.GUARANTEED if margin > 1 else MarginStatus.OPEN
    return RobustStabilityMargin(float(margin), float(angle / plant.dt), status)


def _check_controller(controller: Any, plant: Any) -> Any:
    system = check_model("controller", controller)
    if (system.noutputs, system.ninputs) != (plant.ninputs, plant.noutputs):
        raise InputError(
            f"`controller` must have {plant.noutputs} inputs and {plant.ninputs} outputs, those of `nominal` reversed;"
            f" got {system.ninputs} and {system.noutputs}"
        )
    if system.nstates and system.dt != plant.dt:
        raise InputError(f"`controller` must have the sample time of `nominal`, {plant.dt:g} s; got dt = {system.dt}")
    return system


def _loop(plant: Any, controller: Any, kind: str) -> Any:
    """KS, T or S as a state space, from a signal added to the output."""
    import control

    (A, B, C, D), (Ak, Bk, Ck, Dk) = ([np.asarray(getattr(m, name)) for name in "ABCD"] for m in (plant, controller))
    direct = np.eye(plant.noutputs) + D @ Dk
    if np.linalg.cond(scipy.linalg.matrix_balance(direct)[0]) > 1e12:
        raise InputError("`controller` and `nominal` form a loop that is not well-posed: I + D Dk is singular")
    seen = np.linalg.solve(direct, np.hstack([C, -D @ Ck, np.eye(plant.noutputs)]))  # y + v from x, xk and v
    given = (
        -np.hstack([np.zeros((plant.ninputs, C.shape[1])), Ck, np.zeros((plant.ninputs, plant.noutputs))]) - Dk @ seen
    )
    n = C.shape[1] + Ck.shape[1]
    drive = np.vstack([B @ given, Bk @ seen])
    state = np.block([[A, np.zeros((A.shape[0], Ak.shape[0]))], [np.zeros((Ak.shape[0], A.shape[0])), Ak]])
    out = {"additive": -given, "multiplicative": -seen, "inverse": seen}[kind]
    feed = out[:, n:] + (np.eye(plant.noutputs) if kind == "multiplicative" else 0)
    return control.StateSpace(
        state + drive[:, :n], drive[:, n:], out[:, :n], feed, plant.dt, remove_useless_states=False
    )


def _largest_gain(loop: Any, cells: Cells) -> tuple[float, float]:
    """Guaranteed maximum over the circle of the left side of the condition, and where."""
    reached = 0.0

    def coarse(pieces: Pieces) -> NDArray[np.bool_]:
        nonlocal reached
        reached = max(reached, float(_gains(pieces._replace(radius=np.zeros(pieces.radius.shape)), cells.bound).max()))
        return _gains(pieces, cells.bound) > reached * (1 + _TOLERANCE)

    pieces = enclose(loop, cells.angles, coarse)
    gains = _gains(pieces, cells.bound)
    worst = int(np.argmax(gains))
    return float(gains[worst]) * (1 + 1e-12), float(pieces.middle[worst])


def _gains(pieces: Pieces, bound: Real) -> Real:
    """Upper bound of the condition's left side on each piece."""
    here = bound[pieces.cell]
    if here.ndim == 1 or here[0].size == 1:
        size = np.linalg.norm(pieces.values, 2, axis=(1, 2)) + np.linalg.norm(pieces.radius, axis=(1, 2))
        return here.reshape(-1) * size
    product = here @ (np.abs(pieces.values) + pieces.radius)
    # Any positive x gives rho <= max (Mx)_i/x_i; the Perron vector gives equality.
    values, vectors = np.linalg.eig(product)
    leading = np.take_along_axis(vectors, np.argmax(np.real(values), axis=1)[:, None, None], axis=2)[..., 0]
    x = np.abs(leading) + 1e-9 * np.abs(leading).max(axis=1, keepdims=True)
    return (np.einsum("kij,kj->ki", product, x) / x).max(axis=1)

"""robust_stability_margin(): the small-gain condition, scaled, of one controller for every plant of a set, on whole arcs."""

from __future__ import annotations

import dataclasses
import enum
import functools
from typing import TYPE_CHECKING

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike, NDArray

from robustid.core import Frozen, Real, counted, freeze, one_thread
from robustid.errors import InputError
from robustid.figures import Drawable
from robustid.guarantees.bilinear import Image
from robustid.guarantees.cells import INPUT, KINDS, Pieces, as_bounds, check_plant, enclose_judged, structure_of
from robustid.guarantees.covers import cover_bound
from robustid.guarantees.linear.error_sets import ErrorSets
from robustid.guarantees.scaling import Scaling, best_scaling, perron_scaling
from robustid.identification import check_model
from robustid.reduction import doubtful_distance

if TYPE_CHECKING:
    import control

_TOLERANCE = 1e-3  # a stated margin is at most so much below the one that the condition has
_CURVE = 0.05  # the same for the margins on the cells, as long as
_WIDE = 1.2  # bound on a piece over the value at its middle, above which scalings are not worth their work
_LEAST = 1e-9  # of the largest bound: smaller ones are none
_NOTHING = 1e-3  # a left side that is smaller is not known better: of a controller that is 0 it is rounding
_SHOWN = 10.0  # they are at most so many times the least one


class MarginStatus(enum.Enum):
    """Verdict of the small-gain condition; the value is the user's sentence."""

    GUARANTEED = "guaranteed: the controller stabilises every plant of the set"
    OPEN = "not guaranteed: the nominal loop is stable, but the small-gain condition fails; a plant of the set may be unstable"
    UNSTABLE = "unstable: the loop of the controller and the nominal model is not stable"


@dataclasses.dataclass(frozen=True, eq=False)
class RobustStabilityMargin(Frozen, Drawable):
    """Factor by which the uncertainty could grow before stability is no longer guaranteed.

    Attributes
    ----------
    margin : float
        Every plant whose error stays below `margin` times the bound is stabilised; 0 where the nominal loop is unstable.
        Above 1, all plants of the set are.
    frequency : float
        Where it is smallest, in rad/s.
    status : MarginStatus
    structure : str
        Whose bound gives the margin there: "full", "input", "output" or "entry".
    shares : (ny, nu) array
        Part that the bound of every entry has in it there, 1 in all: a bound smaller by one per cent gives a margin larger by so
        many per cent (of a block of several entries, what its worst uncertainty has there).
    edges : (C + 1,) array
        Edges of the cells, rad/s.
    condition : Condition or None
        The left side of the condition, of which `margins` are made; None where the nominal loop is not stable.
    """

    margin: float
    frequency: float
    status: MarginStatus
    structure: str = "full"
    shares: Real = dataclasses.field(default_factory=lambda: np.ones((1, 1)))
    edges: Real = dataclasses.field(default_factory=lambda: np.zeros(1))
    condition: Condition | None = None

    def __post_init__(self) -> None:
        self._set(**{name: freeze(getattr(self, name)) for name in ("shares", "edges")})

    @functools.cached_property
    def margins(self) -> Real:
        """The margin on every cell by itself, (C,), at most 5 % below what the condition gives there, or beyond 10 times the least.

        It is found when it is asked for, which takes up to a few times as long as `margin`.
        """
        if self.condition is None:
            return freeze(np.zeros(self.edges.size - 1))
        with one_thread():
            found = self.condition.on_cells(1 / self.margin if np.isfinite(self.margin) else 0.0)
        return freeze(np.maximum(self.margin, 1 / np.maximum(found, np.finfo(float).tiny)))

    def __repr__(self) -> str:
        return f"<RobustStabilityMargin: {self.status.name.lower()}, margin {self.margin:.6g} at {self.frequency:.6g} rad/s>"

    @property
    def guaranteed(self) -> bool:
        """Return whether every plant of the set is stabilised."""
        return self.status is MarginStatus.GUARANTEED

    @property
    def entry(self) -> tuple[int, int]:
        """Output and input, from 0, of the entry with the largest share: a smaller bound there helps most."""
        output, entry = np.unravel_index(np.argmax(self.shares), self.shares.shape)
        return int(output), int(entry)


@one_thread()
def robust_stability_margin(
    nominal: control.StateSpace,
    controller: control.StateSpace,
    edges: ArrayLike,
    bound: ArrayLike,
    *,
    kind: str = "additive",
) -> RobustStabilityMargin:
    r"""Robust stability margin of a controller against every plant within a bound of the nominal model.

    With negative feedback ``u = -K y``, sensitivity ``S = (I + F_id K)^{-1}`` and ``T = I - S``, every loop is stable if the
    nominal one is and, for all frequencies,

    .. math:: b\,\bar\sigma(K S) < 1, \quad b\,\bar\sigma(T) < 1, \quad b\,\bar\sigma(T_u) < 1, \quad b\,\bar\sigma(S) < 1

    for an additive, multiplicative (at the outputs, at the inputs: ``T_u = K S F_id``) and inverse multiplicative bound b.
    The margin is the smallest reciprocal of the left side. For bounds of parts of an additive error the condition is

    .. math:: \min_{\alpha, \beta > 0} \bar\sigma(\operatorname{diag}(\beta)\, K S \operatorname{diag}(\alpha))\;
              \|\operatorname{diag}(\alpha)^{-1} [b_{ij}] \operatorname{diag}(\beta)^{-1}\|_2 < 1,

    the upper bound of the structured singular value by diagonal scaling, which does not depend on the units of the signals.

    Parameters
    ----------
    nominal : control.StateSpace
        F_id, discrete or continuous; it may have unstable poles, integrators too.
    controller : control.StateSpace
        K, from the outputs to the inputs of the nominal model, with its sample time.
    edges : (C + 1,) array
        Edges of the cells in rad/s, from 0 to pi/dt, or infinity.
    bound : (C,) or (C, ny, nu), (C, 1, nu), (C, ny, 1) array, or a tuple of such arrays
        Bound on each cell of the largest singular value of F - F_id, or of the relative error (see `uncertainty_weight`). Of
        additive errors also of every entry, of the norm of every column (the error that an input causes), or of every row (the
        error at an output). Of a tuple all bounds hold at the same time.
    kind : {"additive", "multiplicative", "input_multiplicative", "inverse"}

    Returns
    -------
    RobustStabilityMargin
        `margin` is at most 0.1 % below what the condition gives, or about a thousand.

    Raises
    ------
    InputError, InputTypeError
        If the models don't fit together, or the cells don't cover the whole circle.

    Notes
    -----
    Assumes what `identify` gives: all plants have the unstable poles of the nominal model and no others (for a bound of
    the relative error, so does ``F - F_id``). Then a loop is stable if ``I + t (F - F_id) K S`` is regular at every frequency for
    all t from 0 to 1. That is asked at each frequency by itself: of several bounds that hold, any one may answer, on every cell
    another one. For bounds of entries those of rows, columns and the whole matrix are taken too, where they are smaller.

    Frequencies between the edges are enclosed, not sampled: scalings are sought at the middle of a piece of arc and kept on all of
    it. The proof does not depend on how they were found. The stability of the nominal loop is that of its computed eigenvalues,
    with a first-order bound of their rounding.

    References
    ----------
    Zhou, Doyle and Glover, chapters 9 and 11 `zhou1996`; the spectral radius of non-negative matrices, `horn2013` section 8.1.

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
    return _margin(nominal, controller, edges, bound, kind)


def _margin(
    nominal: control.StateSpace,
    controller: control.StateSpace,
    edges: ArrayLike,
    bound: ArrayLike,
    kind: str,
    sets: ErrorSets | None = None,
) -> RobustStabilityMargin:
    if (image := Image.of(nominal, edges)) is not None:
        both = image.model("nominal", nominal), image.model("controller", controller)
        found = _margin(*both, image.edges, bound, kind, sets)
        omega = image.omega(found.frequency)
        return dataclasses.replace(found, frequency=omega, edges=np.asarray(edges, dtype=float))
    plant = check_plant(nominal)
    if kind not in KINDS:
        raise InputError(f"`kind` must be one of {KINDS}; got {kind!r}")
    cells, bounds = as_bounds(plant, edges, bound)
    if cells.angles[0] > 0:
        raise InputError(
            f"`edges` must start at 0; got {cells.edges[0]:g} rad/s, and nothing bounds the error below. Where the plant has"
            ' an integrator, take a relative bound: uncertainty_weight(..., kind="multiplicative", below=...)'
        )
    if kind != "additive" and any(b.shape[1:] != (1, 1) for b in bounds):
        raise InputError(f"`bound` of kind {kind!r} must have shape (C,): one bound of the largest singular value")
    controller = _check_controller(controller, plant)
    # K F_id (I + K F_id)^-1 is what the loop with both exchanged has at its outputs.
    loop = loop_of(controller, plant, "multiplicative") if kind == INPUT else loop_of(plant, controller, kind)
    loop.dt = plant.dt  # a static controller may have none
    poles, doubt = doubtful_distance(loop.A)
    if np.any(1 - np.abs(poles) <= doubt):
        worst = poles[np.argmax(np.abs(poles))]
        frequency, shares = float(np.abs(np.angle(worst)) / plant.dt), np.zeros((plant.noutputs, plant.ninputs))
        return RobustStabilityMargin(0.0, frequency, MarginStatus.UNSTABLE, "full", shares, cells.edges)
    condition = Condition(loop, cells.angles, bounds, sets=sets)
    gain, angle = condition.largest()
    margin = 1 / gain if gain else np.inf
    status = MarginStatus.GUARANTEED if margin > 1 else MarginStatus.OPEN
    structure, shares = condition.limit(angle)
    frequency = float(angle / plant.dt)
    return RobustStabilityMargin(float(margin), frequency, status, structure, shares, cells.edges, condition)


def margin_of_circle(
    nominal: control.StateSpace,
    controller: control.StateSpace,
    circle: tuple[Real, Real, Real],
    kind: str,
    sets: ErrorSets | None = None,
) -> RobustStabilityMargin:
    """`robust_stability_margin` against a bound (C,) of the largest singular value and bounds (C, ny, nu) of the entries at once.

    `circle`: the edges (C + 1,), in rad/s, and both bounds; of a relative kind they give one of the relative error (`cover_bound`).
    Of one entry `sets`, with 0 in them, are what may grow by the margin, where they say more than the bound.
    """
    edges, bound, entries = circle
    if kind != "additive":
        return robust_stability_margin(
            nominal, controller, edges, cover_bound(nominal, edges, bound, entries, kind), kind=kind
        )
    if entries.shape[1:] == (1, 1):
        return _margin(nominal, controller, edges, bound, kind, sets if sets is not None and sets.narrower else None)
    known = np.maximum(entries, _LEAST * entries.max())  # entries that are known exactly
    return robust_stability_margin(nominal, controller, edges, (bound, known))


def _check_controller(controller: control.StateSpace, plant: control.StateSpace) -> control.StateSpace:
    system = check_model("controller", controller)
    if (system.noutputs, system.ninputs) != (plant.ninputs, plant.noutputs):
        raise InputError(
            f"`controller` must have {counted(plant.noutputs, 'input')} and {counted(plant.ninputs, 'output')}, those"
            " of `nominal` reversed;"
            f" got {system.ninputs} and {system.noutputs}"
        )
    if system.nstates and system.dt != plant.dt:
        raise InputError(f"`controller` must have the sample time of `nominal`, {plant.dt:g} s; got dt = {system.dt}")
    return system


def loop_of(plant: control.StateSpace, controller: control.StateSpace, kind: str) -> control.StateSpace:
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


@dataclasses.dataclass(frozen=True)
class Condition:
    """The left side of the condition, on pieces of arc."""

    loop: control.StateSpace  # KS, T or S
    angles: Real  # (C + 1,), rad
    bounds: tuple[Real, ...]  # (C, p, q) each; all of them hold
    improved: bool = True  # False: the scaling of Perron is the best one already
    sets: ErrorSets | None = None  # of one entry, on the cells

    def largest(self) -> tuple[float, float]:
        """Guaranteed maximum over the circle, and where."""
        reached = _NOTHING

        def judge(pieces: Pieces) -> tuple[NDArray[np.bool_], Real]:
            nonlocal reached
            middle, arc = self.on(pieces, reached)
            reached = max(reached, float(middle.max()))
            return arc > reached * (1 + _TOLERANCE), arc

        pieces, gains = enclose_judged(self.loop, self.angles, judge)
        worst = int(np.argmax(gains))
        return float(gains[worst]) * (1 + 1e-12), float(pieces.middle[worst])

    def on_cells(self, largest: float) -> Real:
        """Guaranteed maximum on every cell, (C,)."""
        little = max(largest / _SHOWN, _NOTHING)

        def judge(pieces: Pieces) -> tuple[NDArray[np.bool_], Real]:
            middle, arc = self.on(pieces, little)
            return arc > np.maximum(middle * (1 + _CURVE), little), arc

        pieces, gains = enclose_judged(self.loop, self.angles, judge)
        largest_on = np.zeros(self.angles.size - 1)
        np.maximum.at(largest_on, pieces.cell, gains)
        return largest_on * (1 + 1e-12)

    def limit(self, angle: float) -> tuple[str, Real]:
        """Structure whose bound answers at a frequency, and the shares (ny, nu) of its blocks."""
        cell = min(int(np.searchsorted(self.angles, angle, side="right")) - 1, self.angles.size - 2)
        values = np.asarray(self.loop(np.exp(1j * angle), squeeze=False), dtype=complex)[None]
        found = [(best_scaling(values, bound[[cell]]), bound[[cell]]) for bound in self.bounds]
        gains = [np.prod(scaling.gain(values, bound)) for scaling, bound in found]
        scaling, bound = found[int(np.argmin(gains))]
        nu, ny = values.shape[1:]
        sizes = scaling.uncertainty(bound)[0]
        u, _, v = np.linalg.svd(sizes)
        blocks = np.abs(u[:, :1] * sizes * v[:1])
        left, _, right = np.linalg.svd(scaling.loop(values)[0])
        # Where a block has several entries: those of the uncertainty of norm one that closes the loop.
        within = np.outer(np.abs(right[0]), np.abs(left[:, 0])) ** 2 + np.finfo(float).tiny
        p, q = blocks.shape
        whole = within.sum(axis=tuple(axis for axis, count in enumerate((p, q)) if count == 1), keepdims=True)
        shares = blocks * (within / whole if (p, q) != (ny, nu) else 1.0)
        return structure_of(bound, (ny, nu)), shares / shares.sum()

    def on(self, pieces: Pieces, enough: float) -> tuple[Real, Real]:
        """Left side at the middle of each piece, and its upper bound on all of the piece.

        Where that is at most `enough`, scalings are not improved.
        """
        middle, arc = np.full((2, pieces.cell.size), np.inf)
        for bound in self.bounds:
            here = bound[pieces.cell]
            scaling = perron_scaling(pieces.values, here)
            size, bounded = _scaled_gain(pieces, here, scaling)
            open_ = (np.minimum(arc, bounded) > enough) & (bound.shape[1:] != (1, 1)) & self.improved
            # Pieces too wide for any scaling are halved first: what is known of their middle is that it isn't less than nothing.
            wide = open_ & (bounded > _WIDE * size)
            better = open_ & ~wide
            if better.any():
                some = pieces.of(better)
                size[better], bounded[better] = _scaled_gain(
                    some, here[better], best_scaling(some.values, here[better])
                )
            size[wide] = 0.0
            middle, arc = np.minimum(middle, size), np.minimum(arc, bounded)
        if self.sets is not None and (open_ := arc > enough).any():
            some = pieces.of(open_)
            held, M, reach = self.sets.of(some.cell), some.values[:, 0, 0], some.radius[:, 0, 0]
            middle[open_] = np.minimum(middle[open_], held.closed_by(M, 0.0 * reach))
            arc[open_] = np.minimum(arc[open_], held.closed_by(M, reach))
        return middle, arc


def _scaled_gain(pieces: Pieces, bound: Real, scaling: Scaling) -> tuple[Real, Real]:
    """Left side with given scalings at the middle of each piece, and its upper bound on all of the piece."""
    size, uncertainty = scaling.gain(pieces.values, bound)
    radius = np.linalg.norm(scaling.loop(pieces.radius), axis=(1, 2))
    return uncertainty * size, uncertainty * (size + radius)

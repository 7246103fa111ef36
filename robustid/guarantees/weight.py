"""The smallest stable minimum-phase weight above a bound, proved on the whole circle."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from robustid.core import Frozen, Options, Real, as_count, as_float, as_positive, freeze, one_thread
from robustid.errors import InputError
from robustid.guarantees.bilinear import ControlPair, Image, bilinear
from robustid.guarantees.cascade import arcs, cascade, factors, highest_ratio, lowest_ratio
from robustid.guarantees.cells import KINDS, Cells, check_plant
from robustid.guarantees.covers import check_square, smallest_gain, unbounded
from robustid.guarantees.magnitude import Magnitude, improve, raised, to_plane
from robustid.guarantees.stability_margin import RobustStabilityMargin, robust_stability_margin

if TYPE_CHECKING:
    import control

_LARGEST_ORDER = 12
_USEFUL = 1.1  # where no order is tight enough, one that leaves this factor to be gained is as good
_SPARE = 1e-10  # the gain exceeds what the proof needs by more than the proof's own rounding allowance


@dataclasses.dataclass(frozen=True, eq=False)
class UncertaintyWeight(Frozen):
    """A stable minimum-phase model whose modulus exceeds a bound on the whole circle.

    Attributes
    ----------
    model : control.StateSpace
        W, SISO, discrete as the plant, or continuous; its poles and zeros lie strictly inside the stable region.
    edges : (C + 1,) array
        Edges of the cells in rad/s; the last is pi/dt. Below the first, W is not bound to anything.
    bound : (C,) array
        What |W| exceeds on each cell.
    ratio : float
        Guaranteed largest |W|/bound over all cells; the jump between two neighbouring cells is its least possible value.
    tried : tuple
        Pairs (order, ratio), from order 0.
    kind : str
        "additive", "multiplicative" (at the outputs), "input_multiplicative" or "inverse".
    nominal : control.StateSpace or None
        The model that the uncertainty is about.
    image : UncertaintyWeight or None
        Of a continuous model: the weight in the variable z = (b + s)/(b - s), of which this is the bilinear transform.
    """

    model: control.StateSpace
    _: dataclasses.KW_ONLY
    edges: Real
    bound: Real
    ratio: float
    tried: tuple[tuple[int, float], ...] = ()
    kind: str = "additive"
    nominal: control.StateSpace | None = None
    image: UncertaintyWeight | None = None

    def __post_init__(self) -> None:
        self._set(edges=freeze(self.edges), bound=freeze(self.bound))

    def __repr__(self) -> str:
        proved = "certified" if self.certified else "not certified"
        return f"<UncertaintyWeight: {self.kind}, order {self.order}, |W|/bound up to {self.ratio:.4g}, {proved}>"

    @property
    def order(self) -> int:
        """Number of states of W."""
        return _order(self.model)

    @property
    def certified(self) -> bool:
        """Return whether |W| >= bound on every cell, W stable and minimum-phase: proved again from the numbers of `model`.

        Stability and minimum phase are decided in rational arithmetic; the modulus is enclosed on whole pieces of arc, rounding
        included.
        """
        if self.image is not None:
            return self.image.certified
        parts = factors(self.model)
        cells = Cells.read(self.edges, self.bound, _sample_time(self.model))
        return parts is not None and parts.minimum_phase and lowest_ratio(parts, *arcs(cells.angles), cells.bound) >= 1

    def to_control(self) -> ControlPair:
        """Nominal model and weight in continuous time, for `control.mixsyn` and `control.hinfsyn`.

        Those know no discrete time (and `hinfsyn` needs slycot). The bilinear transformation is exact for this purpose: every
        closed loop has the same largest gain on both sides, and ``.controller(K)`` brings the synthesised controller back.

        Raises
        ------
        InputError
            If there is no nominal model, or it has a pole at z = -1.
        """
        if self.nominal is None:
            raise InputError(
                "`nominal` is not known to this weight: make it with uncertainty_weight(nominal, edges, bound)"
            )
        if self.image is not None:
            return ControlPair(self.nominal, self.model, 0.0)
        return ControlPair(bilinear(self.nominal), bilinear(self.model), _sample_time(self.model))

    def robust_stability_margin(self, controller: control.StateSpace) -> RobustStabilityMargin:
        """`robust_stability_margin` of a controller for the nominal model and the bound (not the weight, which is larger)."""
        if self.nominal is None:
            raise InputError(
                "`nominal` is not known to this weight: use robust_stability_margin(nominal, controller, edges, bound)"
            )
        return robust_stability_margin(self.nominal, controller, self.edges, self.bound, kind=self.kind)


def _order(model: control.StateSpace) -> int:
    return model.nstates


def _sample_time(model: control.StateSpace) -> float:
    return float(model.dt)


def uncertainty_weight(
    nominal: control.StateSpace,
    edges: ArrayLike,
    bound: ArrayLike,
    *,
    kind: str = "additive",
    order: int | None = None,
    tightness: float = 1.5,
    below: float | None = None,
) -> UncertaintyWeight:
    r"""Turn a bound of the error of a model into a weight for robust control, of the smallest order that follows it.

    .. math::
        F = F_{id} + W\Delta, \quad F = (I + W\Delta) F_{id}, \quad F = F_{id} (I + W\Delta), \quad
        F = (I + W\Delta)^{-1} F_{id}, \qquad \bar\sigma(\Delta) \le 1

    for every F with ``|F - F_id| <= bound``, W one scalar model for all entries; the kinds in this order.

    Parameters
    ----------
    nominal : control.StateSpace
        F_id, discrete with its sample time, or continuous.
    edges : (C + 1,) array
        Edges of the cells in rad/s, rising, to pi/dt, or infinity. Where the plant has an integrator, the first is above 0.
    bound : (C,) or (C, ny, nu), (C, 1, nu), (C, ny, 1) array
        On each cell, of the largest singular value of ``F - F_id``, or of each entry, column or row: then the norm of the array of
        bounds is taken, which depends on the units of the signals (`entry_weights` and `structured_weight` don't).
    kind : {"additive", "multiplicative", "input_multiplicative", "inverse"}
        The relative kinds take ``bound/sigma_min(F_id)``, at the outputs or the inputs, and
        ``bound/(sigma_min(F_id) - bound)``, at the outputs; as many inputs as outputs.
    order : int, optional
        Of the weight, at most. Default: the smallest whose |W| stays within `tightness` of the bound; see `magnitude_weight`.
    tightness : float
        Above 1.
    below : float, optional
        Relative kinds, where the first edge is above 0: bound of the relative error from 0 to there (of the coefficient of
        an integrator, say), so that the whole circle is covered.

    Returns
    -------
    UncertaintyWeight

    Raises
    ------
    InputError, InputTypeError
        If shapes don't fit, or a relative error isn't bounded: `nominal` has a zero near the circle, or `bound` reaches
        the response itself. The sentence names the frequency.

    Notes
    -----
    ``sigma_min(F_id)`` is enclosed from below on every cell, at most 4 % too low.

    References
    ----------
    Zhou, Doyle and Glover, chapter 9 `zhou1996`.

    Examples
    --------
    >>> import control
    >>> from robustid.guarantees import uncertainty_weight
    >>> nominal = control.ss(0.5, 1.0, 1.0, 0.0, 1.0)
    >>> weight = uncertainty_weight(nominal, [0.0, 1.0, 3.141592653589793], [0.1, 0.2])
    >>> weight.order, weight.certified
    (0, True)
    """
    options: Options = {"kind": kind, "order": order, "tightness": tightness, "below": below}
    if (image := Image.of(nominal, edges)) is not None:
        found = uncertainty_weight(image.model("nominal", nominal), image.edges, bound, **options)
        own = image.continuous(found.model)
        return dataclasses.replace(found, model=own, edges=np.asarray(edges, float), nominal=nominal, image=found)
    plant = check_plant(nominal)
    cells = Cells.read(edges, bound, float(plant.dt), plant)
    size = cells.bound if cells.bound.ndim == 1 else np.linalg.norm(cells.bound, 2, axis=(1, 2)) * (1 + 1e-12)
    cells = cells._replace(bound=_relative(plant, cells._replace(bound=size), kind))
    edges, bound = from_zero(cells.edges, cells.bound, kind, below)
    weight = magnitude_weight(edges, bound, dt=float(plant.dt), order=order, tightness=tightness)
    return dataclasses.replace(weight, kind=kind, nominal=plant)


def from_zero(edges: Real, bound: Real, kind: str, below: float | None) -> tuple[Real, Real]:
    """Edges and bound of a kind, with the bound `below` the first edge where it is given."""
    if below is None:
        return edges, bound
    if kind == "additive" or edges[0] == 0:
        raise InputError("`below` serves the relative kinds, where `edges` start above 0; leave it out")
    return np.append(0.0, edges), np.append(as_positive("below", below), bound)


def entry_weights(
    nominal: control.StateSpace, edges: ArrayLike, bound: ArrayLike, **options: Any
) -> NDArray[np.object_]:
    """One weight for every entry of the error of a model: ``|F - F_id|_ij <= |W_ij|``, whatever the units of the signals.

    Parameters
    ----------
    nominal, edges
        As in `uncertainty_weight`.
    bound : (C, ny, nu) array
        Per entry.
    **options
        `kind`, `order`, `tightness`, `below`, as there.

    Returns
    -------
    (ny, nu) array of UncertaintyWeight
        The entry (i, j) is about ``nominal[i, j]``. For structured uncertainty, ``control.append`` of the models of
        ``weights.ravel()`` is the block-diagonal weight, rows of the plant one after the other.

    Raises
    ------
    InputError, InputTypeError
        As there.
    """
    plant = check_plant(nominal)
    cells = Cells.read(edges, bound, float(plant.dt), plant)
    if cells.bound.shape[1:] != (plant.noutputs, plant.ninputs):
        raise InputError(f"`bound` must have shape (C, ny, nu), a bound per entry; got {cells.bound.shape}")
    weights = np.empty(cells.bound.shape[1:], dtype=object)
    for i, j in np.ndindex(weights.shape):
        weights[i, j] = uncertainty_weight(plant[i, j], cells.edges, cells.bound[:, i, j], **options)
    return weights


def _relative(plant: control.StateSpace, cells: Cells, kind: str) -> Real:
    """The bound of one kind from that of the largest singular value of F - F_id."""
    if kind not in KINDS:
        raise InputError(f"`kind` must be one of {KINDS}; got {kind!r}")
    if kind == "additive":
        return cells.bound
    check_square(plant, kind)
    least, frequency = smallest_gain(plant, cells)
    room = least - (cells.bound if kind == "inverse" else 0.0)
    if np.any(room <= 0):
        worst = int(np.argmin(room))
        raise unbounded(frequency[worst], least[worst], cells.bound[worst], kind)
    return cells.bound / room * (1 + 1e-12)


@one_thread()
def magnitude_weight(
    edges: ArrayLike, bound: ArrayLike, *, dt: float, order: int | None = None, tightness: float = 1.5
) -> UncertaintyWeight:
    r"""Find the stable minimum-phase W of smallest order with ``|W| >= bound`` on the whole circle.

    .. math:: |W|^2 = n(x)/d(x), \quad x = \tan^2(\omega T/2), \qquad b^2 d \le n \le \gamma^2 b^2 d

    For every order, bisection on γ over linear programs finds the smallest γ; the roots of n and d inside the circle make W.
    Then its gain is raised by the little that the proof on whole cells needs.

    Parameters
    ----------
    edges : (C + 1,) array
        Edges of the cells in rad/s, rising, to pi/dt.
    bound : (C,) array
        Positive; constant on each cell.
    dt : float
        Sample time in s.
    order : int, optional
        At most. Default: the smallest whose |W|/bound stays below `tightness` times the largest jump between neighbouring cells,
        which no continuous |W| can undercut; up to 12, and if none is tight enough, the smallest within 10 % of the best.
    tightness : float
        Above 1. The default, 1.5, lies within 22 % of the bound on a logarithmic scale, when centred: a further order makes
        the synthesised controller longer for less than that.

    Returns
    -------
    UncertaintyWeight

    Raises
    ------
    InputError, InputTypeError
        If shapes or values don't fit.

    Notes
    -----
    Below a first edge above 0 there is nothing to follow; the fit keeps |W| within a factor 100 of the first bound. A smaller
    order exists at most where a linear program in double precision missed it: minimality is that of the numbers in `tried`,
    found by convex programs, not proved; the bound is proved.

    References
    ----------
    Boyd and Vandenberghe, exercise 4.37 and section 6.5 for quasiconvex rational fits `boyd2004`; differential correction,
    Cheney and Loeb `cheney1962`.

    Examples
    --------
    >>> import numpy as np
    >>> from robustid.guarantees import magnitude_weight
    >>> edges = np.linspace(0, np.pi, 101)
    >>> bound = 1 / np.abs(np.exp(1j * edges[:-1]) - 0.9)  # largest at the left end of each cell
    >>> weight = magnitude_weight(edges, bound, dt=1.0)
    >>> weight.order, weight.certified, bool(weight.ratio < 1.5)
    (1, True, True)
    """
    dt, tightness = as_positive("dt", dt), as_float("tightness", tightness)
    if tightness <= 1:
        raise InputError(f"`tightness` must be above 1: the largest |W|/bound that is wanted; got {tightness:g}")
    cells = Cells.read(edges, bound, dt)
    power = np.float64(np.log2(cells.bound.max())).round()
    unit = 2.0**power  # exact: nothing depends on the units
    scaled = cells._replace(bound=cells.bound / unit)
    jumps = np.abs(np.diff(np.log(cells.bound)))
    wanted = 0.0 if order is not None else tightness * float(np.exp(jumps.max(initial=0.0)))
    last = _LARGEST_ORDER if order is None else as_count("order", order)
    found: list[tuple[control.StateSpace | None, float]] = []
    magnitude = Magnitude(np.zeros(0, complex), np.zeros(0, complex))
    for degree in range(last + 1):
        if degree:
            magnitude = improve(raised(magnitude, scaled.angles), scaled.angles, scaled.bound)
        found.append(_lifted(magnitude, scaled, unit, dt))
        if found[-1][1] <= wanted:
            break
    ratios = [ratio for _, ratio in found]
    enough = max(wanted, _USEFUL * min(ratios))
    if order is not None:  # rounding may leave a longer fit behind a shorter one
        enough = min(ratios)
    model, ratio = next(pair for pair in found if pair[1] <= enough)
    if not np.isfinite(ratio):
        raise InputError(
            f"`order` = {order} gives no weight that could be verified for this `bound`; leave `order` out"
        )
    return UncertaintyWeight(model, edges=cells.edges, bound=cells.bound, ratio=ratio, tried=tuple(enumerate(ratios)))


def _lifted(magnitude: Magnitude, cells: Cells, unit: float, dt: float) -> tuple[control.StateSpace | None, float]:
    """The model of a magnitude with the smallest gain for which the bound is proved, and its ratio; inf where it isn't one."""
    zeros, poles = to_plane(magnitude.zeros), to_plane(magnitude.poles)
    y = arcs(cells.angles)
    plain = factors(cascade(zeros, poles, 1.0, dt))
    if plain is None or not plain.minimum_phase:
        return None, np.inf
    lowest = lowest_ratio(plain, *y, cells.bound)
    if not lowest > 0:
        return None, np.inf
    gain = (1 + _SPARE) / lowest
    return cascade(zeros, poles, gain * unit, dt), highest_ratio(plain._replace(gain=gain), *y, cells.bound)

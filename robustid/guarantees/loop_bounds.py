"""loop_bounds(): worst cases of a loop over every consistent plant, on the whole axis, and the margins of all of them."""

from __future__ import annotations

import dataclasses
import functools
import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from robustid.core import (
    Complex,
    Frozen,
    Real,
    StateMatrices,
    as_array,
    as_kind,
    decay_of,
    freeze,
    one_thread,
    poles_of,
    response_at,
    responses,
)
from robustid.errors import InputError
from robustid.figures import Drawable
from robustid.guarantees.band_result import Band
from robustid.guarantees.bilinear import Image
from robustid.guarantees.cells import Pieces, enclose
from robustid.guarantees.loop_values import MAPS, Balls, LoopValues, delay_of, worst_of
from robustid.guarantees.stability_margin import MarginStatus, RobustStabilityMargin
from robustid.guarantees.unstable_plant import UnstablePlant, unstable_plant
from robustid.identification import Identification, Loop, identify
from robustid.reduction import balanced_truncation

if TYPE_CHECKING:
    import control

_TOLERANCE = 2e-3  # of peaks and margins on the whole axis: how far they are above what they have at single frequencies
_LOST, _GRID, _BALANCING = 1e-6, 400, 4  # what a smaller model may lose, points and steps for the units of its signals
_FEW = 200_000  # pieces of arc, beyond which the bounds are left as they are
_FLOORS = {"gain_above": 1e-3, "gain_below": 1e-3, "phase": 1e-2, "delay": 0.0}  # smaller ones limit nothing
# Peaks of the sensitivity up to which a bearing is in zone A, B, C of ISO 14839-3 (first edition, 2006): 9.5, 12 and 14 dB.
_ZONES = (("A", 3.0), ("B", 4.0), ("C", 5.0))


class Peak(NamedTuple):
    """Largest value that a map of the loop has for any consistent plant: an upper bound, and the frequency near which it is."""

    value: float
    omega: float  # rad/s


class LoopMargins(NamedTuple):
    """Margins that every consistent plant has with the controller, at least; at the outputs of the plant.

    Attributes
    ----------
    modulus : float
        Distance of the open loop from -1: the reciprocal of the peak of the sensitivity.
    gain : (float, float)
        Factors of the gain between which every loop is stable.
    phase : float
        In rad, on both sides.
    delay : float
        In s.
    disk : float
        alpha: gain and phase in all loops may change at the same time within the disc ``|f - 1|/|f + 1| < alpha/2``.
    """

    modulus: float
    gain: tuple[float, float]
    phase: float
    delay: float
    disk: float


@dataclasses.dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class LoopBounds(Frozen, Drawable):
    """Worst cases of a controller in the loop with every consistent plant.

    Attributes
    ----------
    band : Band
        Of R.
    loop : Loop
        That R was measured in.
    controller : control.StateSpace or control.TransferFunction
        The one that the bounds are about: that of the loop, or another one.
    stability : RobustStabilityMargin or None
        Of another controller, over all consistent plants; None of the one that ran, which stabilises all of them.
    omega : (F,) array, rad/s
        Those of the band.
    sensitivity, complementary_sensitivity, process_sensitivity, control_sensitivity : (F,) array
        Bounds of S = (I + P C)^-1, T = I - S, P-S and C-S there, in the largest singular value; infinite where a plant may not be
        stabilised. Of one input and one output exact in the discs of the band.
    peaks : dict of str to Peak
        Of these four on the whole axis.
    margins : LoopMargins
        On the whole axis.
    """

    band: Band
    loop: Loop
    controller: control.StateSpace | control.TransferFunction
    stability: RobustStabilityMargin | None
    omega: Real
    sensitivity: Real
    complementary_sensitivity: Real
    process_sensitivity: Real
    control_sensitivity: Real
    peaks: dict[str, Peak]
    margins: LoopMargins

    def __post_init__(self) -> None:
        self._set(**{name: freeze(getattr(self, name)) for name in ("omega", *MAPS)})

    @property
    def guaranteed(self) -> bool:
        """True if the controller is proved to stabilise every consistent plant."""
        return self.stability is None or self.stability.guaranteed

    @property
    def zone(self) -> str:
        """Zone of ISO 14839-3:2006 for active magnetic bearings that no consistent plant is worse than: A to D, by the peak of S.

        The standard asks for it axis by axis, with the other axes closed; of matrices the largest singular value stands for all.
        """
        return next((name for name, peak in _ZONES if self.peaks["sensitivity"].value <= peak), "D")

    def at(self, omega: ArrayLike) -> dict[str, tuple[Complex, Real]]:
        """Centres (F, p, q) and radii (F,) of balls that hold the four maps of the loop at any frequencies, by their names.

        The values of one input and one output are in these discs; of matrices the radius is one of the largest singular value.
        """
        other = None if self.stability is None else self.loop.as_controller(self.controller)
        return self._at(omega, other)

    def plant_at(self, omega: ArrayLike) -> tuple[Complex, Real]:
        """Centres (F, ny, nu) and radii (F,) of balls that hold the responses of all consistent plants."""
        nu, ny = self.loop.shape
        open_loop = StateMatrices(np.zeros((0, 0)), np.zeros((0, ny)), np.zeros((nu, 0)), np.zeros((nu, ny)))
        return self._at(omega, open_loop)["process_sensitivity"]

    def _at(self, omega: ArrayLike, controller: StateMatrices | None) -> dict[str, tuple[Complex, Real]]:
        omega = np.atleast_1d(as_array("omega", omega))
        around = self.loop.about(StateMatrices.of(self.band.model), controller)
        return dict(_at_frequencies(self.band, around, self.loop, omega))

    def unstable_plant(self, identification: Identification | None = None) -> UnstablePlant | None:
        """A plant that the data allow and that the controller does not stabilise, as a model; None where none was found.

        Parameters
        ----------
        identification : Identification, optional
            Of the problem of the band, where one is at hand. Default: `identify` of it.
        """
        if self.guaranteed or self.stability is None:
            return None
        thing = identify(self.band.problem) if identification is None else identification
        edges, margins = self.stability.edges, self.stability.margins
        worst = np.argsort(margins)
        middle = (edges[:-1] + np.where(np.isfinite(edges[1:]), edges[1:], edges[:-1])) / 2
        frequencies = np.concatenate([[self.stability.frequency], middle[worst]])
        return unstable_plant(thing, self.loop, self.loop.as_controller(self.controller), frequencies)

    def __repr__(self) -> str:
        return f"<LoopBounds: {self._verdict}, peak of S {self.peaks['sensitivity'].value:.4g}>"

    @property
    def _verdict(self) -> str:
        if self.stability is None:
            return "the controller that ran"
        return "every consistent plant is stabilised" if self.guaranteed else "not proved stable"

    def summary(self) -> str:
        """The result in plain text."""
        lines = [f"loop       {self._verdict}{self.band.problem.scope}"]
        if self.stability is not None and not self.guaranteed:
            near = self.stability.frequency / (2 * np.pi)
            lines.append(
                f"margin     {self.stability.margin:.4g}, limited at {near:.5g} Hz: above 1 it would be proved"
            )
        names = {"sensitivity": "S", "complementary_sensitivity": "T", "process_sensitivity": "P S"}
        names["control_sensitivity"] = "C S"
        for name, letters in names.items():
            peak = self.peaks[name]
            where = f" near {peak.omega / (2 * np.pi):.5g} Hz" if np.isfinite(peak.value) else ""
            lines.append(
                f"{letters:10s} at most {peak.value:.4g} at every frequency, for every consistent plant{where}"
            )
        low, high = self.margins.gain
        lines += [
            f"margins    modulus {self.margins.modulus:.4g}, gain {low:.4g} to {high:.4g}, phase"
            f" {math.degrees(self.margins.phase):.4g} degrees, delay {self.margins.delay:.4g} s, disk {self.margins.disk:.4g}",
            f"zone       {self.zone} of ISO 14839-3:2006 (A up to 3, B up to 4, C up to 5)",
            f"assumed    the class of R, the bounds of its samples, and that this controller ran: u = {self.loop.law}",
        ]
        return "\n".join(lines)


@one_thread()
def loop_bounds(
    band: Band, loop: Loop, controller: control.StateSpace | control.TransferFunction | None = None
) -> LoopBounds:
    r"""Worst cases of S, T, PS and CS over every plant that the data allow, with peaks and margins that hold for all of them.

    At the controller that ran all maps of the loop are affine in R,

    .. math:: S = D_c (\tilde D_x - R \tilde N_c), \quad P S = (N_x + D_c R) \tilde D_c,

    so that a disc of R is a disc of S; at another controller :math:`S_Q = (D_c - N_x Q)(I + R Q)^{-1}(\tilde D_x - R \tilde N_c)`,
    of one input and one output a disc again.

    Parameters
    ----------
    band : Band
        Of the stable system R of the loop, around a model.
    loop : Loop
        The controller that ran while it was measured.
    controller : control.StateSpace or control.TransferFunction, optional
        Another controller. Default: the one that ran.

    Returns
    -------
    LoopBounds

    Raises
    ------
    InputError
        A band without a model, of other signals or another sample time; models that do not fit together.

    Notes
    -----
    On the whole axis the bounds of the band around its model hold on arcs, on which the maps are enclosed. Assumed: the class of R,
    the bounds of its samples, and the controller as it ran.

    References
    ----------
    `tay1989`; disc margins: `seiler2020`; zones of magnetic bearings: `iso14839`.

    Examples
    --------
    >>> import control, numpy as np, robustid as rid
    >>> plant, gain = control.ss(1.1, 1.0, 1.0, 0.0, 0.01), control.ss([], [], [], 0.5, 0.01)
    >>> loop = rid.Loop(gain)
    >>> omega = np.linspace(5.0, 300.0, 30)
    >>> R = loop.residual_of(plant)
    >>> closed = rid.FrequencyResponse(omega, [R(np.exp(0.01j * w)) for w in omega], bound=0.02, dt=0.01)
    >>> problem = rid.MixedProblem(frequency=closed, prior=rid.Prior(gain_bound=10.0, decay_rate=1.4))
    >>> result = rid.identify(problem)
    >>> found = rid.loop_bounds(rid.band(result), loop)
    >>> found.guaranteed, bool(1.6 < found.peaks["sensitivity"].value < 2.2)
    (True, True)
    """
    as_kind("band", band, Band, "a Band")
    as_kind("loop", loop, Loop, "a Loop")
    if band.model is None:
        raise InputError("`band` must be about a model of R; use band.with_model(result.model)")
    model = StateMatrices.of(band.model)
    nu, ny = loop.shape
    if model.D.shape != (ny, nu) or not np.isclose(band.problem.dt or 0.0, loop.dt, rtol=1e-9, atol=0.0):
        got = f"{model.D.shape[0]} outputs, {model.D.shape[1]} inputs, dt = {band.problem.dt or 0:g} s"
        raise InputError(
            f"`band` must be of the R of `loop`, {ny} outputs, {nu} inputs, dt = {loop.dt:g} s; got {got}. loop.opened(record)"
            " gives the record of R"
        )
    stability, other = None, None
    if controller is not None:
        stability = band.robust_stability_margin(loop.parameter_of(controller))
        other = loop.as_controller(controller)
    around = loop.about(model, other)
    if decay_of(poles_of(around.A), loop.dt) <= 0:  # the nominal loop is not stable: nothing is bounded
        return _without(band, loop, controller, stability)
    here = _at_frequencies(band, around, loop, band.omega)
    whole = _Axis(band, loop.shape, around).enclosed()
    return LoopBounds(
        band=band,
        loop=loop,
        controller=loop.controller if controller is None else controller,
        stability=stability,
        omega=band.omega,
        **{name: here[name].largest for name in MAPS},
        peaks=whole.peaks,
        margins=whole.margins,
    )


def _without(band: Band, loop: Loop, controller: object, stability: RobustStabilityMargin | None) -> LoopBounds:
    """Nothing is bounded."""
    none = np.full(band.omega.size, np.inf)
    peaks = {name: Peak(np.inf, np.nan) for name in MAPS}
    margins = LoopMargins(0.0, (1.0, 1.0), 0.0, 0.0, 0.0)
    if stability is not None and stability.guaranteed:
        stability = dataclasses.replace(stability, status=MarginStatus.OPEN)
    given: dict[str, Real] = dict.fromkeys(MAPS, none)
    return LoopBounds(
        band=band,
        loop=loop,
        controller=controller,  # type: ignore[arg-type]
        stability=stability,
        omega=band.omega,
        **given,
        peaks=peaks,
        margins=margins,
    )


def _at_frequencies(band: Band, around: StateMatrices, loop: Loop, omega: Real) -> dict[str, Balls]:
    """The four maps at frequencies, from discs about the centres of the band and about its model."""
    points = np.exp(1j * omega * loop.dt) if loop.dt else 1j * omega
    values = LoopValues.at(response_at(around, points), loop.shape)
    nominal, (centre, radius) = band.problem.plane.values_at(band.model, omega), band.at(omega)
    known: Mask = np.asarray(np.isfinite(radius).all(axis=(1, 2)), dtype=bool)[:, None, None]
    about_model = values.balls(band.error_at(omega))
    about_centre = values.shifted(np.where(known, centre - nominal, 0.0)).balls(np.where(known, radius, np.inf))
    return {name: _smaller(about_centre[name], about_model[name]) for name in about_model}


def _smaller(one: Balls, other: Balls) -> Balls:
    """At every point the one of two that says more."""
    first = one.largest <= other.largest
    return Balls(np.where(first[:, None, None], one.centre, other.centre), np.where(first, one.radius, other.radius))


def _smaller_model(model: control.StateSpace) -> tuple[control.StateSpace, Real]:
    """A model of lower order in discrete time, and by how much its entries may differ, (p, q): they are enclosed much faster."""
    angles = np.linspace(0.0, np.pi, _GRID)
    sizes = np.abs(responses(model, angles)).max(axis=0) + np.finfo(float).tiny
    rows, columns = np.ones(sizes.shape[0]), np.ones(sizes.shape[1])
    for _ in range(_BALANCING):
        rows = 1 / (sizes * columns).max(axis=1)
        columns = 1 / (sizes * rows[:, None]).max(axis=0)
    A, B, C, D = StateMatrices.of(model)
    scaled = StateMatrices(A, B * columns, C * rows[:, None], D * rows[:, None] * columns).model(1.0)
    found = balanced_truncation(scaled, tol=_LOST)
    if found.order >= len(A):
        return model, np.zeros(sizes.shape)
    A, B, C, D = StateMatrices.of(found.model)
    small = StateMatrices(A, B / columns, C / rows[:, None], D / rows[:, None] / columns).model(1.0)
    return small, found.bound / rows[:, None] / columns


class _Found(NamedTuple):
    peaks: dict[str, Peak]
    margins: LoopMargins


@dataclasses.dataclass(frozen=True)
class _Axis:
    """The maps of the loop on the whole axis: on pieces of arc, halved where they may set a peak or a margin."""

    band: Band
    shape: tuple[int, int]
    around: StateMatrices

    @functools.cached_property
    def _image(self) -> Image | None:
        return Image.of(self._model, self.band.circle.edges)

    @functools.cached_property
    def _model(self) -> control.StateSpace:
        return self.around.model(self.band.problem.dt or 0.0)

    @functools.cached_property
    def _angles(self) -> Real:
        if self._image is not None:
            return self._image.edges
        angles = self.band.circle.edges * float(self.band.problem.dt or 0.0)
        angles[-1] = np.pi
        return angles

    def enclosed(self) -> _Found:
        """Peaks and margins."""
        edges = self.band.circle.edges
        if edges[0] > 0:
            raise InputError(f"`band` must reach down to frequency 0; got {edges[0]:g} rad/s: R has no integrator")
        model, lost = _smaller_model(self._model if self._image is None else self._image.model("band", self._model))
        reached = np.array([_FLOORS.get(name, 0.0) for name in self._names])
        count = 0

        def coarse(pieces: Pieces) -> NDArray[np.bool_]:
            nonlocal reached, count
            middle, arc = self._sizes(pieces, 0.0 * pieces.radius), self._sizes(pieces, pieces.radius + lost)
            finite = np.where(np.isfinite(middle), middle, -np.inf)
            reached = np.maximum(reached, finite.max(axis=0))
            count += len(arc)
            limits = np.any(arc > reached * (1 + _TOLERANCE), axis=1) & np.all(np.isfinite(middle), axis=1)
            wide = np.any(pieces.radius > lost, axis=(1, 2))  # narrower ones say no more
            return limits & wide & (count < _FEW)

        pieces = enclose(model, self._angles, coarse)
        sizes = self._sizes(pieces, pieces.radius + lost)
        worst = np.argmax(sizes, axis=0)
        largest = dict(zip(self._names, sizes.max(axis=0).tolist(), strict=True))
        where = dict(zip(self._names, self._omega(pieces.middle[worst]).tolist(), strict=True))
        return _Found({name: Peak(largest[name], where[name]) for name in MAPS}, self._margins(largest))

    @property
    def _names(self) -> tuple[str, ...]:
        return (
            *MAPS,
            "disk",
            *(("gain_above", "gain_below", "phase", "delay") if self.shape == (1, 1) else ("delay",)),
        )

    def _sizes(self, pieces: Pieces, reach: Real) -> Real:
        """Sizes that limit peaks and margins where the values are within their reach, (N, names)."""
        bound = self.band.circle.entries[pieces.cell]
        values = LoopValues(pieces.values, reach, self.shape)
        balls = values.balls(bound)
        sensitivity = balls["sensitivity"]
        found = [balls[name].largest for name in MAPS]
        found.append(sensitivity.about(np.eye(self.shape[1]) / 2).largest)
        top = self._omega(self._angles[pieces.cell + 1])
        if self.shape == (1, 1):
            found += worst_of(sensitivity, top)
        else:
            found.append(delay_of(balls["complementary_sensitivity"], top))
        return np.stack(found, axis=1)

    def _omega(self, angles: Real) -> Real:
        if self._image is None:
            return angles / float(self.band.problem.dt or 1.0)
        found = np.full(angles.shape, np.inf)
        found[angles < np.pi] = self._image.plane.omega(angles[angles < np.pi])
        return found

    def _margins(self, largest: dict[str, float]) -> LoopMargins:
        modulus, disk = 1 / largest["sensitivity"], 1 / largest["disk"]
        delay = 1 / largest["delay"] if largest["delay"] else np.inf
        if self.shape == (1, 1):
            above, below, t = (max(largest[name], _FLOORS[name]) for name in ("gain_above", "gain_below", "phase"))
            up, down = (
                (1 + 1 / above if np.isfinite(above) else 1.0),
                (below / (1 + below) if np.isfinite(below) else 1.0),
            )
            return LoopMargins(modulus, (down, up), math.pi - 2 * math.atan(2 * t), delay, disk)
        alpha = min(disk, 2 * (1 - 1e-9))
        return LoopMargins(
            modulus, ((2 - alpha) / (2 + alpha), (2 + alpha) / (2 - alpha)), 2 * math.atan(alpha / 2), delay, disk
        )

"""loop_bounds(): worst cases of a loop over every consistent plant, on the whole axis, and the margins of all of them."""

from __future__ import annotations

import dataclasses
import enum
import functools
import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from robustid.core import (
    Budget,
    Complex,
    Frozen,
    Real,
    Savable,
    StateMatrices,
    as_array,
    as_kind,
    decay_of,
    freeze,
    hz_words,
    one_thread,
    poles_of,
    response_at,
)
from robustid.errors import InputError
from robustid.figures import Drawable
from robustid.guarantees.band_result import Band
from robustid.guarantees.circle import Peak
from robustid.guarantees.loop_axis import LoopAxis, LoopMargins
from robustid.guarantees.loop_radius import farthest_plant
from robustid.guarantees.loop_values import MAPS, Balls, LoopValues
from robustid.guarantees.scope import scope_of
from robustid.guarantees.stability_margin import MarginStatus, RobustStabilityMargin, margin_of_circle
from robustid.guarantees.unstable_plant import UnstablePlant, unstable_plant
from robustid.identification import Identification, Loop, as_system, identify
from robustid.reduction import controller_model

if TYPE_CHECKING:
    import control

    from robustid.data import FrequencyResponse

# Peaks of the sensitivity up to which a bearing is in zone A, B, C of ISO 14839-3 (first edition, 2006): 9.5, 12 and 14 dB.
_ZONES = (("A", 3.0), ("B", 4.0), ("C", 5.0))


class LoopStatus(enum.Enum):
    """Verdict on a controller; the value is the user's sentence."""

    STABLE = "every consistent plant is stabilised, proved on the whole axis"
    UNSTABLE = "a plant that the data allow is not stabilised"
    UNDECIDED = "neither proved for every consistent plant nor refuted by one"


@dataclasses.dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class LoopBounds(Frozen, Drawable, Savable):
    """Worst cases of a controller in the loop with every consistent plant.

    Attributes
    ----------
    band : Band
        Of R.
    loop : Loop
        That R was measured in; of a plant measured in open loop the one without a controller, whose R is the plant.
    controller : control.StateSpace or control.TransferFunction
        The one that the bounds are about: that of the loop, or another one.
    stability : RobustStabilityMargin or None
        Of another controller, over all consistent plants; None of the one that ran, which stabilises all of them.
    omega : (F,) array, rad/s
        Those of the band.
    sensitivity, complementary_sensitivity, process_sensitivity, control_sensitivity : (F,) array
        Bounds of S = (I + P C)^-1, T = I - S, P-S and C-S there, in the largest singular value; infinite where a plant may not be
        stabilised. Of one input and one output exact in the discs of the band. Where the plant has fewer inputs than outputs S and
        T are those at its inputs, (I + C P)^-1: at the outputs some direction is moved by no input.
    peaks : dict of str to Peak
        Of these four on the whole axis.
    margins : LoopMargins
        On the whole axis.
    refuted_by : UnstablePlant or None
        A plant that the data allow and that the controller does not stabilise: see `refuted`.
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
    refuted_by: UnstablePlant | None = None

    def __post_init__(self) -> None:
        self._set(**{name: freeze(getattr(self, name)) for name in ("omega", *MAPS)})

    @property
    def guaranteed(self) -> bool:
        """True if the controller is proved to stabilise every consistent plant."""
        return self.stability is None or self.stability.guaranteed

    @property
    def status(self) -> LoopStatus:
        """Proved stable, refuted by a plant, or neither; the first too of the controller that ran, which stabilises all."""
        otherwise = LoopStatus.UNDECIDED if self.refuted_by is None else LoopStatus.UNSTABLE
        return LoopStatus.STABLE if self.guaranteed else otherwise

    @property
    def in_open_loop(self) -> bool:
        """True of a plant that was measured without a controller: R is the plant itself."""
        return self.loop.auxiliary is None and not as_system("controller", self.loop.controller)[0].D.any()

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
        return self.all_at(omega)[1]

    def plant_at(self, omega: ArrayLike) -> tuple[Complex, Real]:
        """Centres (F, ny, nu) and radii (F,) of balls that hold the responses of all consistent plants."""
        return self.all_at(omega)[0]

    def all_at(self, omega: ArrayLike) -> tuple[tuple[Complex, Real], dict[str, tuple[Complex, Real]]]:
        """Return `plant_at` and `at`, for which the band is evaluated once."""
        omega = np.atleast_1d(as_array("omega", omega))
        nu, ny = self.loop.shape
        open_loop = StateMatrices(np.zeros((0, 0)), np.zeros((0, ny)), np.zeros((nu, 0)), np.zeros((nu, ny)))
        other = None if self.stability is None else self.loop.as_controller(self.controller)
        model = StateMatrices.of(_nominal(self.band))
        around = [self.loop.about(model, controller) for controller in (open_loop, other)]
        plant, maps = _at_frequencies(self.band, around, self.loop, omega)
        return plant["process_sensitivity"], dict(maps)

    def largest_nu_gap(self) -> Peak:
        """Largest `nu_gap` of consistent plants from that of the band's model, on the whole axis; 1 where nothing is known.

        A controller whose `ncf_margin` with that plant is larger stabilises all of them. It depends on the units of the signals.
        Of matrices it is bounded by norms of the largest errors of the entries, of which polygons count their farthest corners.
        """
        return farthest_plant(self.band, self.loop, _nominal(self.band))

    def unstable_plant(
        self, identification: Identification | None = None, *, time_limit: float | None = None
    ) -> UnstablePlant | None:
        """A plant that the data allow and that the controller does not stabilise, as a model; None where none was found.

        Parameters
        ----------
        identification : Identification, optional
            Of the problem of the band, where one is at hand. Default: `identify` of it.
        time_limit : float, optional
            Seconds after which no further plant is looked for.
        """
        budget = Budget(time_limit)
        if self.guaranteed or self.stability is None:
            return None
        thing = identification or identify(self.band.problem, time_limit=budget.seconds)
        if not thing.consistent:
            return None
        edges, margins = self.stability.edges, self.stability.margins
        worst = np.argsort(margins)
        middle = (edges[:-1] + np.where(np.isfinite(edges[1:]), edges[1:], edges[:-1])) / 2
        frequencies = np.concatenate([[self.stability.frequency], middle[worst]])
        return unstable_plant(thing, self.loop, self.loop.as_controller(self.controller), frequencies, budget)

    def refuted(self, identification: Identification | None = None, *, time_limit: float | None = None) -> LoopBounds:
        """Return the same with the plant of `unstable_plant`; itself where none is found, or none can be."""
        found = self.unstable_plant(identification, time_limit=time_limit)
        return self if found is None else dataclasses.replace(self, refuted_by=found)

    def __repr__(self) -> str:
        said = "the controller that ran" if self.stability is None else self.status.name.lower()
        return f"<LoopBounds: {said}, peak of S {self.peaks['sensitivity'].value:.4g}>"

    @property
    def unbounded(self) -> str:
        """The reason for which the maps of the loop have no peak, in words with the frequencies; empty where they have."""
        if np.isfinite(self.peaks["sensitivity"].value):
            return ""
        if self.stability is not None and np.isnan(self.peaks["sensitivity"].omega):
            return "nothing is bounded: the loop with the model itself is not stable"
        if self.band.open_ranges:
            return f"nothing is proved from {self.band.open_words}, where the band is open"
        hz = self.peaks["sensitivity"].omega / (2 * np.pi)
        return f"nothing is proved near {hz_words(hz)}, where a loop of the bounds may be singular"

    def summary(self) -> str:
        """The result in plain text."""
        ran = "the controller that ran stabilises every consistent plant"
        lines = [f"loop       {ran if self.stability is None else self.status.value}{scope_of([self.band])}"]
        if (found := self.refuted_by) is not None:
            lines.append(
                f"refuted    by a plant of order {found.plant.nstates}, whose closed loop has a {found.pole_words}"
            )
        if self.stability is not None and not self.guaranteed:
            hz, size = self.stability.frequency / (2 * np.pi), self.stability.margin
            lines.append(f"margin     {size:.4g}, limited at {hz_words(hz)}: above 1 it would be proved")
        lines += self._peak_lines
        low, high = self.margins.gain
        who = "this controller" if self.stability is None else "the one stated"
        of_loop = f"R, the bounds of its samples, and that {who} ran: u = {self.loop.law}"
        of = "the plant and the bounds of its samples" if self.in_open_loop else of_loop
        lines.append(f"assumed    the class of {of}")
        if self.unbounded:
            return "\n".join(lines)
        lines[-1:-1] = [
            f"margins    modulus {self.margins.modulus:.4g}, gain {low:.4g} to {high:.4g}, phase"
            f" {math.degrees(self.margins.phase):.4g} degrees, delay {self.margins.delay:.4g} s, disk {self.margins.disk:.4g}",
            f"zone       {self.zone} of ISO 14839-3:2006 (A up to 3, B up to 4, C up to 5)",
        ]
        return "\n".join(lines)

    @property
    def _peak_lines(self) -> list[str]:
        """Lines on the peaks of the maps; where there is none, the reason, and what holds at the frequencies elsewhere."""
        if self.unbounded:
            known = self.sensitivity[np.isfinite(self.sensitivity)]
            lines = [f"peaks      {self.unbounded}"]
            if known.size and self.guaranteed:
                count = f"{known.size} of {self.omega.size} frequencies"
                lines.append(f"S          at most {known.max():.4g} at {count}, for every consistent plant")
            return lines
        return [
            f"{letters:10s} at most {self.peaks[name].value:.4g} at every frequency, for every consistent plant, near"
            f" {hz_words(self.peaks[name].omega / (2 * np.pi))}"
            for name, letters in zip(MAPS, ("S", "T", "P S", "C S"), strict=True)
        ]


@one_thread()
def loop_bounds(
    band: Band,
    loop: Loop | None = None,
    controller: control.StateSpace | control.TransferFunction | control.FRD | FrequencyResponse | None = None,
    *,
    time_limit: float | None = None,
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
    loop : Loop, optional
        The controller that ran while it was measured. Default: none, of a stable plant that was measured in open loop, whose band
        this is then.
    controller : control.StateSpace, control.TransferFunction, control.FRD or FrequencyResponse, optional
        Another controller. Default: the one that ran. Of a response as `loop_from_data` takes it.
    time_limit : float, optional
        Seconds after which arcs are parted no further: peaks and margins hold then too, and are wider.

    Returns
    -------
    LoopBounds

    Raises
    ------
    InputError
        A band without a model, of other signals or another sample time; models that do not fit together.

    Notes
    -----
    On the whole axis the maps are enclosed on arcs, on which the bounds of the band around its model hold; of one input and one
    output also discs around other centres, and polygons where the band was refined. Assumed: the class of R,
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
    >>> small = rid.balanced_truncation(result.model, order=2).model
    >>> found = rid.loop_bounds(rid.band(result, model=small), loop)
    >>> found.guaranteed, bool(1.31 < found.peaks["sensitivity"].value < 1.4)
    (True, True)

    A plant that was measured in open loop, and a controller for it:

    >>> frf = rid.FrequencyResponse(omega, [1 / (np.exp(0.01j * w) - 0.5) for w in omega], bound=0.02, dt=0.01)
    >>> stable = rid.MixedProblem(frequency=frf, prior=rid.Prior(gain_bound=10.0, decay_rate=1.4))
    >>> result = rid.identify(stable)
    >>> small = rid.balanced_truncation(result.model, order=2).model
    >>> found = rid.loop_bounds(rid.band(result, model=small), controller=gain)
    >>> found.status.name, bool(1.49 < found.peaks["sensitivity"].value < 1.7)
    ('STABLE', True)
    """
    budget, band = Budget(time_limit), as_kind("band", band, Band, "a Band")
    controller = None if controller is None else controller_model(controller)
    loop = _without_controller(band, controller) if loop is None else as_kind("loop", loop, Loop, "a Loop")
    model = StateMatrices.of(_nominal(band))
    nu, ny = loop.shape
    if model.D.shape != (ny, nu) or not np.isclose(band.problem.dt or 0.0, loop.dt, rtol=1e-9, atol=0.0):
        got = f"{model.D.shape[0]} outputs, {model.D.shape[1]} inputs, dt = {band.problem.dt or 0:g} s"
        raise InputError(
            f"`band` must be of the R of `loop`, {ny} outputs, {nu} inputs, dt = {loop.dt:g} s; got {got}. loop.opened(record)"
            " gives the record of R"
        )
    stability, other = None, None
    if controller is not None:
        circle, nominal = band.circle, _nominal(band)
        bounds = circle.edges, circle.bound, circle.entries
        stability = margin_of_circle(nominal, loop.parameter_of(controller), bounds, "additive", circle.sets)
        other = loop.as_controller(controller)
    around = loop.about(model, other)
    if decay_of(poles_of(around.A), loop.dt) <= 0:  # the nominal loop is not stable: nothing is bounded
        return _without(band, loop, controller, stability)
    (here,) = _at_frequencies(band, [around], loop, band.omega)
    peaks, margins = LoopAxis(band, loop.shape, around).enclosed(budget)
    return LoopBounds(
        band=band,
        loop=loop,
        controller=loop.controller if controller is None else controller,
        stability=stability,
        omega=band.omega,
        **{name: here[name].largest for name in MAPS},
        peaks=peaks,
        margins=margins,
        refuted_by=None,
    )


def _without_controller(band: Band, controller: object) -> Loop:
    """The loop of a plant that is measured in open loop: no controller and no auxiliary plant."""
    import control

    if controller is None:
        raise InputError("`controller` is missing: of a plant in open loop give the one that is to be tried")
    entries = band.problem.entries
    return Loop(control.StateSpace([], [], [], np.zeros((entries.inputs, entries.outputs)), band.problem.dt or 0.0))


def _nominal(band: Band) -> control.StateSpace:
    if band.model is None:
        raise InputError("`band` must be about a model of R; use band.with_model(result.model)")
    return band.model


def _without(band: Band, loop: Loop, controller: object, stability: RobustStabilityMargin | None) -> LoopBounds:
    """Nothing is bounded."""
    none = np.full(band.omega.size, np.inf)
    if stability is not None and stability.guaranteed:
        stability = dataclasses.replace(stability, status=MarginStatus.OPEN)
    return LoopBounds(
        band=band,
        loop=loop,
        controller=controller,  # type: ignore[arg-type]
        stability=stability,
        omega=band.omega,
        **dict.fromkeys(MAPS, none),
        peaks=dict.fromkeys(MAPS, Peak(np.inf, np.nan)),
        margins=LoopMargins(0.0, (1.0, 1.0), 0.0, 0.0, 0.0),
        refuted_by=None,
    )


def _at_frequencies(band: Band, loops: Sequence[StateMatrices], loop: Loop, omega: Real) -> Iterator[dict[str, Balls]]:
    """The four maps of every loop at frequencies, from discs about the centres of the band, about its model, and those of arcs."""
    points = np.exp(1j * omega * loop.dt) if loop.dt else 1j * omega
    nominal, (centre, radius) = band.problem.plane.values_at(_nominal(band), omega), band.at(omega)
    known = np.asarray(np.isfinite(radius).all(axis=(1, 2), keepdims=True), dtype=bool)
    shift, reach, error = np.where(known, centre - nominal, 0.0), np.where(known, radius, np.inf), band.error_at(omega)
    on_arcs = band.circle.sets_at(omega)
    for around in loops:
        values = LoopValues.at(response_at(around, points), loop.shape)
        every = [values.shifted(shift).balls(reach), values.balls(error)]
        every += values.over(on_arcs) if on_arcs.corners.shape[1] else []
        yield {name: functools.reduce(Balls.or_smaller, [one[name] for one in every]) for name in MAPS}

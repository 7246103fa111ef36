"""design_controller(): a controller of fixed structure for every plant that the data allow, and its proof."""

from __future__ import annotations

import dataclasses
import enum
import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from robustid.controllers.limits import Conditions, Discs, Limits, conditions_of
from robustid.controllers.plants import Plants
from robustid.controllers.search import Question, found_for
from robustid.controllers.structure import Basis, Factor, as_structure, basis_of
from robustid.core import Budget, Complex, Frozen, Real, StateMatrices, as_kind, one_thread, points_of, response_at
from robustid.errors import InputError
from robustid.guarantees import Band, LoopBounds

if TYPE_CHECKING:
    import control

GOALS = ("bandwidth", "integral gain")
_FINE = 1.005  # of the goal: two levels that are as good as equal
_STEPS = 10  # levels over the axis that are tried from above
_SPARE = 0.995  # of every limit: what the proof on arcs takes
_CUTS = 6  # rounds of frequencies at which a proof failed
_LOWER = (1.0, 0.998, 0.995, 0.99, 0.97)  # of a level that failed its proof
_SEARCH = (1.5, 1.2, 1.07)  # factors that searched numbers are moved by


class DesignStatus(enum.Enum):
    """Outcome of a design; the value is the user's sentence."""

    PROVED = "proved: every consistent plant keeps the limits with this controller"
    FOUND = "found at frequencies; not proved on the whole axis"
    NONE = "no controller of this structure was found that keeps the limits"


@dataclasses.dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class ControllerDesign(Frozen):
    """A controller, and what is proved of it.

    Attributes
    ----------
    status : DesignStatus
    controller : control.StateSpace or None
        C of u = -C y.
    goal : str
    level : float
        What the goal reached: the bandwidth in rad/s, or the integral gain.
    proofs : tuple of LoopBounds
        Of every band: worst cases and margins on the whole axis.
    shares : dict of str to (float, float)
        Largest share of every limit that any consistent plant takes on the whole axis, and the frequency near it in rad/s.
    searched : tuple of float
        Numbers of the structure that were searched, in its order.
    """

    status: DesignStatus
    controller: control.StateSpace | None
    goal: str
    level: float
    proofs: tuple[LoopBounds, ...]
    shares: dict[str, tuple[float, float]]
    searched: tuple[float, ...]

    @property
    def limited_by(self) -> tuple[str, float] | None:
        """Limit of which the largest share is taken, and where, in rad/s."""
        if not self.shares:
            return None
        name = max(self.shares, key=lambda one: self.shares[one][0])
        return name, self.shares[name][1]

    def __repr__(self) -> str:
        if self.controller is None:
            return f"<ControllerDesign: {self.status.name.lower()}>"
        return f"<ControllerDesign: {self.status.name.lower()}, {self.goal} {self.level:.5g}, order {self.controller.nstates}>"

    def summary(self) -> str:
        """The result in plain text."""
        if self.controller is None:
            return f"controller {self.status.value}"
        everywhere = ", at every frequency" * (self.status is DesignStatus.PROVED)
        scopes = dict.fromkeys(one.band.problem.scope for one in self.proofs)
        lines = [f"controller {self.status.value}{everywhere}{''.join(scopes)}"]
        unit = f"{self.level / (2 * math.pi):.5g} Hz" if self.goal == "bandwidth" else f"{self.level:.5g}"
        lines.append(f"goal       {self.goal} {unit}")
        for name, (share, omega) in self.shares.items():
            lines.append(f"{name:20s} {share:.3g} of its limit, near {omega / (2 * math.pi):.5g} Hz")
        exact = any(one.band.box is None and one.band.problem.parametric is not None for one in self.proofs)
        lines.append(
            f"assumed    the class and the bounds of every band{', its poles as exact' * exact}; the structure as it runs"
        )
        return "\n".join(lines)


@one_thread()
def design_controller(
    bands: Band | LoopBounds | Sequence[Band | LoopBounds],
    structure: Factor | Sequence[Factor],
    *,
    limits: Limits | None = None,
    maximise: str = "bandwidth",
    time_limit: float | None = None,
) -> ControllerDesign:
    r"""The best controller of a structure for every plant that the data allow, with the proof that it keeps its limits.

    With the values of all consistent plants in discs, ``|F - c| <= r``, each limit on the loop is one on the controller's value:

    .. math:: |1 + F C| \ge w \;\forall F \Leftrightarrow \exists\, |\varphi| = 1:\;
              \operatorname{Re} \bar\varphi (1 + c\, C) - r |C| \ge w,

    a second-order cone in the free numbers of C for a given direction, which is turned until nothing is gained. What is found at
    frequencies is then proved on the whole axis for every plant; where a proof fails, that frequency is added.

    Parameters
    ----------
    bands : Band, LoopBounds or a sequence of them
        About models; of one input and one output. Of a plant in a loop its `loop_bounds`. Of several (amplitudes, positions, loads)
        one controller is designed for all plants of all of them.
    structure : factor or sequence of factors
        `PID`, `Notch`, `LeadLag`, `LowPass`, `FIR` and `Fixed` of `robustid.design`; their product is the controller, with one free
        numerator. Intervals are searched.
    limits : Limits, optional
        Default: a peak of the sensitivity of 2.
    maximise : {"bandwidth", "integral gain"}
        The frequency up to which ``|P C| >= 1`` for every consistent plant, or the gain of the integrator.
    time_limit : float, optional
        Seconds of the search of intervals; the best proved controller so far is returned.

    Returns
    -------
    ControllerDesign

    Raises
    ------
    InputError, InputTypeError
        Bands without models, of matrices, or that stand in different time; a structure that makes no controller.

    Notes
    -----
    The proof takes bounds of the cells of a band about its model. Assumed: what the bands assume.

    References
    ----------
    `karimi2017` for the linearisation; `boyd2004`, section 2.5, for the separating direction.

    Examples
    --------
    >>> import control, numpy as np, robustid as rid
    >>> from robustid.design import PID
    >>> omega = np.linspace(0.5, 31.0, 30)
    >>> z = np.exp(0.1j * omega)
    >>> frf = rid.FrequencyResponse(omega, 0.1 / (z - 0.9), bound=0.01, dt=0.1)
    >>> problem = rid.MixedProblem(frequency=frf, prior=rid.Prior(gain_bound=4.0, decay_rate=1.08))
    >>> found = rid.design_controller(rid.band(rid.identify(problem)), PID())
    >>> found.status.name, bool(found.proofs[0].peaks["sensitivity"].value <= 2)
    ('PROVED', True)
    """
    given = bands if isinstance(bands, list | tuple) else (bands,)
    plants = [Plants.of(one) for one in given]
    _check(plants)
    limits = Limits() if limits is None else as_kind("limits", limits, Limits, "Limits of robustid.design")
    if maximise not in GOALS:
        raise InputError(f"`maximise` must be one of {GOALS}; got {maximise!r}")
    task = _Task(plants, as_structure(structure), limits, maximise, [one.grid() for one in plants])
    if maximise == "integral gain" and not basis_of(task.structure, task.middle, task.dt).integral.any():
        raise InputError("`structure` must hold an integrator for its gain to be largest, such as PID()")
    return task.designed(Budget(time_limit))


def _check(plants: list[Plants]) -> None:
    if not plants:
        raise InputError("`bands` must hold at least one band")
    for one in plants:
        if one.loop.shape != (1, 1):
            ny, nu = one.loop.shape[::-1]
            raise InputError(
                f"`bands` must be of one input and one output; got {ny} outputs and {nu} inputs. Take one entry"
            )
        if not math.isclose(one.dt, plants[0].dt, rel_tol=1e-9):
            raise InputError(f"`bands` must have one sample time; got {plants[0].dt:g} and {one.dt:g} s")


@dataclasses.dataclass
class _Task:
    """A design: its plants, and the frequencies of each that are asked about."""

    plants: list[Plants]
    structure: tuple[Factor, ...]
    limits: Limits
    goal: str
    grids: list[Real]

    @property
    def dt(self) -> float:
        return self.plants[0].dt

    @property
    def intervals(self) -> list[tuple[float, float]]:
        """Intervals of the numbers that are searched."""
        return [interval for one in self.structure for interval in one.free]

    @property
    def middle(self) -> list[float]:
        """Geometric means of them."""
        return [math.sqrt(low * high) for low, high in self.intervals]

    def designed(self, budget: Budget) -> ControllerDesign:
        """The best controller, proved."""
        at = self.middle
        best = _At(self, at).best()
        if best is None:
            for at in self._others():
                if (best := _At(self, at).best()) is not None:
                    break
        if best is None:
            return ControllerDesign(
                status=DesignStatus.NONE, controller=None, goal=self.goal, level=0.0, proofs=(), shares={}, searched=()
            )
        best = self._searched(best, budget)
        found = self._judged(best)
        for _ in range(_CUTS):
            if found.status is DesignStatus.PROVED:
                break
            where = [omega for share, omega in found.shares.values() if share > 1 and omega > 0]
            if not where:
                break
            self.grids = [np.unique(np.concatenate([grid, where])) for grid in self.grids]
            here = _At(self, best.at)
            again = here.near(best) or here.best()
            if again is None:
                break
            best, found = again, self._judged(again)
        return found

    def _others(self) -> Iterator[list[float]]:
        """Ends of the intervals, for a start."""
        for part in (0.0, 1.0):
            yield [low ** (1 - part) * high**part for low, high in self.intervals]

    def _searched(self, best: _Found, budget: Budget) -> _Found:
        """A better controller with other numbers in their intervals, one after the other, in smaller steps."""
        intervals = self.intervals
        for factor in _SEARCH:
            moved = True
            while moved and not budget.over:
                moved = False
                for k, (low, high) in enumerate(intervals):
                    if low == high:
                        continue
                    for step in (factor, 1 / factor):
                        at = list(best.at)
                        at[k] = min(max(at[k] * step, low), high)
                        if at[k] == best.at[k] or budget.over:
                            continue
                        other = _At(self, at).best(best.level * _FINE, best)
                        if other is not None and other.level > best.level * _FINE:
                            best, moved = other, True
                            break
        return best

    def _judged(self, best: _Found) -> ControllerDesign:
        """The controller with its proof."""
        proofs = tuple(one.proved(best.controller) for one in self.plants)
        shares: dict[str, tuple[float, float]] = {}

        def told(name: str, share: float, omega: float) -> None:
            if share > shares.get(name, (-1.0, 0.0))[0]:
                shares[name] = share, omega

        corner = best.level if self.goal == "bandwidth" else 0.0
        for plants, proof in zip(self.plants, proofs, strict=True):
            for name, limit in (
                ("sensitivity", self.limits.sensitivity_peak),
                ("complementary_sensitivity", self.limits.complementary_peak),
                ("control_sensitivity", self.limits.control_peak),
                ("process_sensitivity", self.limits.process_peak),
            ):
                if limit is not None:
                    told(name.replace("_", " ") + " peak", proof.peaks[name].value / limit, proof.peaks[name].omega)
            if self.limits.gain_margin is not None:
                told("gain margin", (self.limits.gain_margin - 1) / max(proof.margins.gain[1] - 1, 1e-12), np.nan)
            if self.limits.phase_margin is not None:
                told("phase margin", self.limits.phase_margin / max(proof.margins.phase, 1e-12), np.nan)
            for name, (share, omega) in plants.shares(best.controller, self.limits, corner).items():
                told(name, share, omega)
        kept = all(one.guaranteed for one in proofs) and all(share <= 1 for share, _ in shares.values())
        return ControllerDesign(
            status=DesignStatus.PROVED if kept else DesignStatus.FOUND,
            controller=best.controller,
            goal=self.goal,
            level=best.level,
            proofs=proofs,
            shares=shares,
            searched=tuple(best.at),
        )


@dataclasses.dataclass(frozen=True)
class _Found:
    """Factors of a controller, in the orthonormal basis of its numbers, and the level that it reaches."""

    at: list[float]
    level: float
    controller: control.StateSpace


class _At:
    """The search with given numbers of the structure."""

    def __init__(self, task: _Task, at: Sequence[float]) -> None:
        self.task, self.at = task, list(at)
        self.basis: Basis = basis_of(task.structure, at, task.dt)
        discs = [plants.discs(grid) for plants, grid in zip(task.plants, task.grids, strict=True)]
        self.discs = Discs(*(np.concatenate(parts) for parts in zip(*discs, strict=True)))
        self.owners = [k for k, grid in enumerate(task.grids) for _ in grid]
        plain = self.basis.response(self.discs.omega)
        omega = self.discs.omega
        falling = np.minimum(1.0, omega / np.exp(np.mean(np.log(omega))))  # an integrator is large where omega is small
        weight = ((np.abs(self.discs.centre) + self.discs.radius) * falling)[:, None]
        stacked = np.concatenate([(weight * plain).real, (weight * plain).imag])
        self.back = np.linalg.inv(np.linalg.qr(stacked, mode="r")) * math.sqrt(len(stacked))
        self.values = plain @ self.back
        self.conditions = conditions_of(_with_spare(task.limits), self.discs)

    def best(self, least: float | None = None, near: _Found | None = None) -> _Found | None:
        """The controller of the highest level; None where none is found, or none above `least`."""
        low, high = self._ends()
        levels = np.geomspace(low, high, _STEPS)[::-1].tolist() if least is None else [least]
        for level in levels:
            if (found := self._found(level, near)) is not None:
                return self._raised(found, high)
        return None

    def near(self, best: _Found) -> _Found | None:
        """The controller of about the level of another one, with these frequencies."""
        for part in _LOWER:
            if (found := self._found(best.level * part, best)) is not None:
                return self._raised(found, best.level)
        return None

    def _raised(self, found: _Found, high: float) -> _Found:
        """A controller of a higher level, in ever smaller steps."""
        step, centre = 1.5, found
        while step > _FINE:
            other = self._found(found.level * step, centre) if found.level * step <= high else None
            if other is not None:
                found = centre = other
            elif centre is found and (inner := self._found(found.level, found, centred=True)) is not None:
                centre = inner  # directions from the middle of what is possible lead further
            else:
                step = math.sqrt(step)
        return found

    def _ends(self) -> tuple[float, float]:
        omega = self.discs.omega
        if self.task.goal == "bandwidth":
            return float(omega.min()), float(omega.max())
        size = 1 / float(np.median(np.abs(self.discs.centre)))
        return 1e-6 * size * float(omega.min()), 10 * size * float(omega.max())

    def _found(self, level: float, near: _Found | None, *, centred: bool = False) -> _Found | None:
        """A controller that keeps all limits at a level, from a few directions to begin with."""
        question, discs = self._question(level)

        def accepted(factors: Real) -> bool:
            controller = self.basis.controller(self.back @ factors)
            return all(one.is_stable_with(controller) for one in self.task.plants)

        for values in self._starts(discs, level, near):
            factors = found_for(question, question.directions(values), accepted, centred=centred)
            if factors is not None:
                return _Found(self.at, level, self.basis.controller(self.back @ factors))
        return None

    def _starts(self, discs: Discs, level: float, near: _Found | None) -> Iterator[Complex]:
        """Values of controllers to begin with: one that is known, those that run, an integrator as loop, none."""
        if near is not None:
            points = points_of(discs.omega, self.task.dt)
            yield response_at(StateMatrices.of(near.controller), points)[:, 0, 0]
        running = self._running(discs)
        if running.any():
            yield running
        corner = level if self.task.goal == "bandwidth" else level * abs(discs.centre[np.argmin(discs.omega)])
        yield corner / (1j * discs.omega) / discs.centre
        if near is None and not running.any():
            yield running

    def _running(self, discs: Discs) -> Complex:
        """Values of the controllers that run, each with its plants."""
        owners = [*self.owners, *range(len(self.task.plants))][: discs.omega.size]
        running = np.zeros(discs.omega.size, complex)
        for k, plants in enumerate(self.task.plants):
            own = np.equal(owners, k)
            running[own] = plants.running(discs.omega[own])
        return running

    def _question(self, level: float) -> tuple[Question, Discs]:
        """Conditions on a controller of a level, and the discs they are about: of a bandwidth at its end, too."""
        if self.task.goal == "integral gain":
            gain = (self.basis.integral @ self.back)[None]
            lowest = int(np.argmin(self.discs.omega))  # an integrator is to lower what the loop that runs leaves there
            left = 1 + self.discs.centre[lowest] * self._running(self.discs)[lowest]
            sign = np.sign(np.real(self.discs.centre[lowest] / left))
            return Question(self.values, self.conditions, (sign * gain, np.array([level]))), self.discs
        ends = [plants.discs(np.array([level])) for plants in self.task.plants]
        discs = Discs(*(np.concatenate(parts) for parts in zip(self.discs, *ends, strict=True)))
        last = self.basis.response(np.array([level])) @ self.back
        values = np.concatenate([self.values, np.repeat(last, len(ends), axis=0)])
        place = np.flatnonzero(discs.omega <= level)
        some, w = discs.at(discs.omega <= level), np.full(place.size, 1 / _SPARE)
        own = Conditions("bandwidth", place, np.zeros(place.size, complex), some.centre + 0j, some.radius, w)
        return Question(values, [*self.conditions, own]), discs


def _with_spare(limits: Limits) -> Limits:
    """Limits that are a little closer, so that the proof on arcs holds for what is found at frequencies."""

    def closer(value: float | None) -> float | None:
        return None if value is None else value * _SPARE

    rows = {
        name: tuple((low, high, value * _SPARE) for low, high, value in getattr(limits, name))
        for name in ("attenuation", "roll_off")
    }
    return dataclasses.replace(
        limits,
        **{name: closer(getattr(limits, name)) for name in ("sensitivity_peak", "complementary_peak", "control_peak")},
        process_peak=closer(limits.process_peak),
        gain_margin=None if limits.gain_margin is None else limits.gain_margin / _SPARE,
        phase_margin=None if limits.phase_margin is None else limits.phase_margin / _SPARE,
        **rows,
    )

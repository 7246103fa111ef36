"""design_controller(): a controller of fixed structure for every plant that the data allow, and its proof."""

from __future__ import annotations

import dataclasses
import enum
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from robustid.controllers.closest import closest
from robustid.controllers.designing import At, Found, Task
from robustid.controllers.factors import Factor
from robustid.controllers.goals import Goal, as_goal
from robustid.controllers.improvements import Improvement, improvements
from robustid.controllers.limits import Limits
from robustid.controllers.obstacles import Obstacle, obstacle_of
from robustid.controllers.plants import Plants
from robustid.controllers.proved_search import searched_with_proof
from robustid.controllers.proving import SHARES, Proof
from robustid.controllers.questions import check_question
from robustid.controllers.structure import Matrix, as_structure
from robustid.core import (
    Budget,
    Frozen,
    Progress,
    Savable,
    Unfinished,
    as_float,
    as_function,
    as_kind,
    hz_words,
    one_thread,
)
from robustid.errors import InputError
from robustid.figures import Drawable
from robustid.guarantees import Band, LoopBounds, scope_of

if TYPE_CHECKING:
    import control


_LEVEL = 1e-9  # some level of a goal
_TWICE = 2.0  # a limit, from which on a factor says more than percents


class DesignStatus(enum.Enum):
    """Outcome of a design; the value is the user's sentence."""

    PROVED = "proved: every consistent plant keeps the limits with this controller"
    FOUND = "found at frequencies; not proved on the whole axis"
    NONE = "no controller of this structure was found that keeps the limits"
    UNFINISHED = "none yet: the time was over before a controller was found and proved"


@dataclasses.dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class ControllerDesign(Frozen, Drawable, Savable):
    """A controller, and what is proved of it.

    Attributes
    ----------
    status : DesignStatus
    controller : control.StateSpace or None
        C of u = -C y. Where none was found that keeps the limits the closest one, which keeps limits relaxed by the least factor.
    goal : Bandwidth, IntegralGain, Attenuation or LeastControl
    level : float
        What the goal reached: the bandwidth in rad/s, the integral gain, the factor of attenuation, or 1 over the peak of C S.
    limits : Limits
    structure : tuple of factors
    proofs : tuple of LoopBounds
        Of every band: worst cases and margins on the whole axis.
    shares : dict of str to (float, float)
        Largest share of every limit that any consistent plant takes on the whole axis, and the frequency near it in rad/s.
    by_band : tuple of dict
        The same shares with the plants of each band alone.
    searched : tuple of float
        Numbers of the structure that were searched, in its order.
    bounds : float or None
        Where no controller was found: factor of the bounds of all bands, 0.5 or 0, with which one was; None where not even for
        the models themselves.
    unfinished : Unfinished or None
        What ended the search before its end: the time, or Ctrl-C; None of one that came to it.
    """

    status: DesignStatus
    controller: control.StateSpace | None
    goal: Goal
    level: float
    limits: Limits
    structure: tuple[Factor, ...] | Matrix
    proofs: tuple[LoopBounds, ...]
    shares: dict[str, tuple[float, float]]
    searched: tuple[float, ...]
    bounds: float | None = None
    unfinished: Unfinished | None = None
    by_band: tuple[dict[str, tuple[float, float]], ...] = ()

    @property
    def finished(self) -> bool:
        """False where the time was over or Ctrl-C came before the search had ended."""
        return self.unfinished is None

    @property
    def limited_by(self) -> tuple[str, float] | None:
        """Limit of which the largest share is taken, and where, in rad/s; the goal, which reaches its level, is none."""
        shares = self._without_goal
        if not shares:
            return None
        name = max(shares, key=lambda one: shares[one][0])
        return name, shares[name][1]

    @property
    def limiting_bands(self) -> tuple[tuple[int, str, float], ...]:
        """Every band by its number from 0, with the limit of which its plants take most, and that share; the largest first.

        Limits of which every band takes the same, such as a gain of the controller, tell none from the others and are left out.
        """
        names = [name for name in self.asked_shares if len({one[name][0] for one in self.by_band if name in one}) > 1]
        if not names:
            return ()
        found = [(k, *max(((name, one[name][0]) for name in names), key=_second)) for k, one in enumerate(self.by_band)]
        return tuple(sorted(found, key=lambda entry: -entry[2]))

    @property
    def asked_shares(self) -> dict[str, tuple[float, float]]:
        """The shares, where no controller was found less that of the least level of the goal, for which nobody asked."""
        return self._without_goal if self.status is DesignStatus.NONE else self.shares

    @property
    def _without_goal(self) -> dict[str, tuple[float, float]]:
        """The shares of limits that somebody asked for; all where there are none."""
        own = set(self.goal.asked(Limits(sensitivity_peak=None), max(self.level, _LEVEL)).stated)
        unasked = {SHARES[name] for name in own.difference(self.limits.stated)}
        return {name: share for name, share in self.shares.items() if name not in unasked} or self.shares

    @property
    def scope(self) -> str:
        """Words that follow a claim: for how many bands, on what they take their poles to be, and on their data."""
        count = len(self.proofs)
        every = "both" if count == 2 else f"all {count}"
        several = f", for the plants of {every} bands" if count > 1 else ""
        return several + scope_of([one.band for one in self.proofs])

    def obstacle(self) -> Obstacle | None:
        """Law that the limits contradict, with its numbers: a proof that no controller at all keeps them; None where none is known.

        Its `sentence` says it.
        """
        if self.status is not DesignStatus.NONE or not self.proofs:
            return None
        return obstacle_of(self._plants, self.structure, self.goal.asked(self.limits, self.level))

    def improvements(self, factor: float = 0.5, *, time_limit: float | None = None) -> tuple[Improvement, ...]:
        """Return what smaller bounds would bring, near every frequency that limits and at all of them, and each limit 10 % wider.

        The largest effect first; every one is a search from this controller on, at frequencies and not proved.

        Parameters
        ----------
        factor : float
            Of the bounds, below 1.
        time_limit : float, optional
            Seconds, after which those that are found are returned.

        Returns
        -------
        tuple of Improvement
            Empty of a design that found no controller that keeps the limits.
        """
        if not 0 <= as_float("factor", factor) < 1:
            raise InputError(f"`factor` must be at least 0 and below 1; got {factor:g}")
        budget = Budget(time_limit)
        if self.controller is None or self.status is DesignStatus.NONE or not self.proofs:
            return ()
        task = Task.of(self._plants, self.structure, self.limits, self.goal)
        return improvements(task, Found(list(self.searched), self.level, self.controller), factor, budget)

    @property
    def _plants(self) -> list[Plants]:
        return [Plants.of(one) for one in self.proofs]

    def __repr__(self) -> str:
        name = self.status.name.lower()
        if self.controller is None:
            return f"<ControllerDesign: {name}>"
        if self.status is DesignStatus.NONE:
            return f"<ControllerDesign: {name}; {self.excess}>"
        reached = f"{self.goal.name} {self.goal.told(self.level)}"
        return f"<ControllerDesign: {name}, {reached}, order {self.controller.nstates}>"

    @property
    def excess(self) -> str:
        """The limit that the closest controller exceeds most, where and by how much, in words."""
        limited = self.limited_by
        if limited is None:
            return "nothing is known of the closest one"
        name, omega = limited
        share = self.shares[name][0]
        by = f"by {100 * (share - 1):.3g} %" if share < _TWICE else f"by a factor of {share:.4g}"
        return f"closest: {name} {'exceeded ' + by if math.isfinite(share) else 'not bounded'}{_near(omega)}"

    def summary(self) -> str:
        """The result in plain text."""
        if self.controller is None:
            return f"controller {self.status.value}"
        none = self.status is DesignStatus.NONE
        everywhere = ", at every frequency" * (self.status is DesignStatus.PROVED)
        excess = f"; {self.excess}" * none
        lines = [f"controller {self.status.value}{everywhere}{excess}{self.scope}"]
        lines += self._why if none else [f"goal       {self.goal.name} {self.goal.told(self.level)}"]
        for name, (share, omega) in self.asked_shares.items():
            lines.append(f"{name:20s} {share:.3g} of its limit{_near(omega)}")
        if not self.finished:
            lines.append("unfinished the search ended before its end: the best so far")
        lines.append("assumed    the class and the bounds of every band; the structure as it runs")
        return "\n".join(lines)

    @property
    def _why(self) -> list[str]:
        """Lines on what stands in the way of a controller: a law, or the bounds."""
        found = self.obstacle()
        if found is not None:
            return [f"proved     no controller at all keeps them: {found.sentence}"]
        if not self.finished:
            return []
        if self.bounds is None:
            return ["bounds     not even for the models themselves: the limits contradict the structure or the plant"]
        if self.bounds:
            return ["bounds     half as large: the limits could be kept"]
        return ["bounds     half as large are not enough; for the models themselves the limits could be kept"]


def _second(pair: tuple[str, float]) -> float:
    return pair[1]


def _near(omega: float) -> str:
    return "" if math.isnan(omega) else f" near {hz_words(omega / (2 * math.pi))}"


@one_thread()
def design_controller(
    bands: Band | LoopBounds | Sequence[Band | LoopBounds],
    structure: Factor | Sequence[Factor] | Matrix,
    *,
    limits: Limits | None = None,
    maximise: str | Goal = "bandwidth",
    time_limit: float | None = None,
    progress: Progress | None = None,
) -> ControllerDesign:
    r"""The best controller of a structure for every plant that the data allow, with the proof that it keeps its limits.

    The values of all consistent plants are a convex set; with it in a disc, ``|F - c| <= r``, or in a polygon with the corners v,
    each limit on the loop is one on the controller's value:

    .. math:: |1 + F C| \ge w \;\forall F \Leftrightarrow \exists\, |\varphi| = 1:\;
              \operatorname{Re} \bar\varphi (1 + c\, C) - r |C| \ge w, \quad
              \operatorname{Re} \bar\varphi (1 + v C) \ge w \;\forall v,

    second-order cones in the free numbers of C for a given direction, which is turned until nothing is gained. Polygons are those
    of a band that `Band.refine` has refined, where they are narrower than discs. Of matrices the direction is a unitary matrix U,
    and the Hermitian part of :math:`U^*(I + c\, C)` is at least w and a bound of what the ball adds; all sizes are largest singular
    values then, a bandwidth is one of the smallest singular value. What is found at frequencies is then proved on the whole axis
    for every plant; where a proof fails, that frequency is added.

    Parameters
    ----------
    bands : Band, LoopBounds or a sequence of them
        About models. Of a plant in a loop its `loop_bounds`. Of several (amplitudes, positions, loads) one controller is designed
        for all plants of all of them.
    structure : factor, sequence of factors, or Matrix
        `PID`, `Notch`, `LeadLag`, `LowPass`, `FIR` and `Fixed` of `robustid.design`; their product is the controller, with one free
        numerator. Intervals are searched. Of several outputs a loop to each, or a `Matrix`.
    limits : Limits, optional
        Default: a peak of the sensitivity of 2.
    maximise : {"bandwidth", "integral gain", "least control"} or Attenuation
        The frequency up to which ``|P C| >= 1`` for every consistent plant; the gain of the integrator; the least peak of |C S|;
        or the attenuation of a range of frequencies. What is not limited may be used up: the fastest loop can return slowly from a
        load, until an attenuation or an integral gain asks for more.
    time_limit : float, optional
        Seconds of the whole design; the best controller proved so far is returned. Ctrl-C does the same where one was found.
    progress : callable (text, done, count), optional
        Receiver of what is done.

    Returns
    -------
    ControllerDesign

    Raises
    ------
    InputError, InputTypeError
        Bands without models, of other inputs and outputs, or that stand in different time; a structure that makes no controller;
        limits that contradict each other or the sample time.

    Notes
    -----
    The proof takes discs and polygons that hold the error of the model on every cell of a band; of plants in a loop the design
    alone takes discs about the polygons, or what is outside of a disc where the plant may be infinite:
    :math:`r |C| \ge |1 + c\, C| + w`, a second-order cone for a given direction of C. Of matrices both take discs about the model:
    :math:`U^*(I + F C)` is affine in F, so that polygons of V corners for each of n entries would be exact only with :math:`V^n`
    semidefinite conditions at a frequency, and the largest errors of the entries, which those discs hold, are those of the
    polygons already. Assumed: what the bands assume.
    That no controller was found is no proof that there is none, since the directions are searched; `obstacle` of the result is
    one, where a law says so.

    References
    ----------
    `karimi2017` for the linearisation; `boyd2004`, section 2.5, for the separating direction.

    Examples
    --------
    >>> import control, numpy as np, robustid as rid
    >>> from robustid.design import PID
    >>> omega = np.linspace(0.5, 31.0, 15)
    >>> z = np.exp(0.1j * omega)
    >>> frf = rid.FrequencyResponse(omega, 0.1 / (z - 0.9), bound=0.01, dt=0.1)
    >>> problem = rid.MixedProblem(frequency=frf, prior=rid.Prior(gain_bound=4.0, decay_rate=1.08))
    >>> found = rid.design_controller(rid.band(rid.identify(problem)), PID())
    >>> found.status.name, bool(found.proofs[0].peaks["sensitivity"].value <= 2)
    ('PROVED', True)
    """
    given = bands if isinstance(bands, list | tuple) else (bands,)
    plants = [Plants.of(one) for one in given]
    limits = Limits() if limits is None else as_kind("limits", limits, Limits, "Limits of robustid.design")
    factors, goal = as_structure(structure), as_goal(maximise)
    budget, progress = Budget(time_limit), as_function("progress", progress)
    check_question(plants, factors, limits, goal)
    task = Task.of(plants, factors, limits, goal)
    least = goal.asked(limits, At(task, task.middle).ends[0])
    law = obstacle_of(plants, factors, least)  # where no controller can be found none is sought
    found, proof, unfinished = searched_with_proof(task, budget, progress) if law is None else (None, None, None)
    if found is not None and proof is not None:
        status = DesignStatus.PROVED if proof.kept else DesignStatus.FOUND
        return _design(task, status, found, proof, unfinished)
    near = closest(task, budget, progress) if unfinished is None else None
    if near is not None:
        kept = near.proof.kept  # found from limits that were relaxed, and proved to keep those that were asked for
        status = DesignStatus.PROVED if kept else DesignStatus.NONE
        return _design(task, status, near.found, near.proof, near.unfinished, None if kept else near.bounds)
    status = DesignStatus.NONE if unfinished is None else DesignStatus.UNFINISHED
    return ControllerDesign(
        status=status,
        controller=None,
        goal=goal,
        level=0.0,
        limits=limits,
        structure=factors,
        proofs=(),
        shares={},
        searched=(),
        unfinished=unfinished,
    )


def _design(
    task: Task,
    status: DesignStatus,
    found: Found,
    proof: Proof,
    unfinished: Unfinished | None,
    bounds: float | None = None,
) -> ControllerDesign:
    return ControllerDesign(
        status=status,
        controller=found.controller,
        goal=task.goal,
        level=found.level,
        limits=task.limits,
        structure=task.structure,
        proofs=proof.proofs,
        shares=proof.shares,
        by_band=proof.by_band,
        searched=tuple(found.at),
        bounds=bounds,
        unfinished=unfinished,
    )

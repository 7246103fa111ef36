"""design_controller(): a controller of fixed structure for every plant that the data allow, and its proof."""

from __future__ import annotations

import dataclasses
import enum
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from robustid.controllers.designing import Task
from robustid.controllers.factors import Factor
from robustid.controllers.goals import Goal, as_goal
from robustid.controllers.limits import Limits
from robustid.controllers.plants import Plants
from robustid.controllers.structure import Basis, Matrix, as_structure, basis_of
from robustid.core import Budget, Frozen, Savable, as_kind, one_thread
from robustid.errors import InputError
from robustid.figures import Drawable
from robustid.guarantees import Band, LoopBounds

if TYPE_CHECKING:
    import control


class DesignStatus(enum.Enum):
    """Outcome of a design; the value is the user's sentence."""

    PROVED = "proved: every consistent plant keeps the limits with this controller"
    FOUND = "found at frequencies; not proved on the whole axis"
    NONE = "no controller of this structure was found that keeps the limits"


@dataclasses.dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class ControllerDesign(Frozen, Drawable, Savable):
    """A controller, and what is proved of it.

    Attributes
    ----------
    status : DesignStatus
    controller : control.StateSpace or None
        C of u = -C y.
    goal : Bandwidth, IntegralGain, Attenuation or LeastControl
    level : float
        What the goal reached: the bandwidth in rad/s, the integral gain, the factor of attenuation, or 1 over the peak of C S.
    limits : Limits
    structure : tuple of factors
    proofs : tuple of LoopBounds
        Of every band: worst cases and margins on the whole axis.
    shares : dict of str to (float, float)
        Largest share of every limit that any consistent plant takes on the whole axis, and the frequency near it in rad/s.
    searched : tuple of float
        Numbers of the structure that were searched, in its order.
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
        reached = f"{self.goal.name} {self.goal.told(self.level)}"
        return f"<ControllerDesign: {self.status.name.lower()}, {reached}, order {self.controller.nstates}>"

    def summary(self) -> str:
        """The result in plain text."""
        if self.controller is None:
            return f"controller {self.status.value}"
        everywhere = ", at every frequency" * (self.status is DesignStatus.PROVED)
        scopes = dict.fromkeys(one.band.problem.scope for one in self.proofs)
        lines = [f"controller {self.status.value}{everywhere}{''.join(scopes)}"]
        lines.append(f"goal       {self.goal.name} {self.goal.told(self.level)}")
        for name, (share, omega) in self.shares.items():
            near = "" if math.isnan(omega) else f", near {omega / (2 * math.pi):.5g} Hz"
            lines.append(f"{name:20s} {share:.3g} of its limit{near}")
        exact = any(one.band.box is None and one.band.problem.parametric is not None for one in self.proofs)
        lines.append(
            f"assumed    the class and the bounds of every band{', its poles as exact' * exact}; the structure as it runs"
        )
        return "\n".join(lines)


@one_thread()
def design_controller(
    bands: Band | LoopBounds | Sequence[Band | LoopBounds],
    structure: Factor | Sequence[Factor] | Matrix,
    *,
    limits: Limits | None = None,
    maximise: str | Goal = "bandwidth",
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
    maximise : {"bandwidth", "integral gain", "least control"} or Attenuation
        The frequency up to which ``|P C| >= 1`` for every consistent plant; the gain of the integrator; the least peak of |C S|;
        or the attenuation of a range of frequencies.
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
    factors, goal = as_structure(structure), as_goal(maximise)
    task = Task.of(plants, factors, limits, goal)
    _check_limits(goal.asked(limits, 1.0), basis_of(factors, task.middle, task.dt, task.shape))
    found = task.designed(Budget(time_limit))
    same = {"goal": goal, "limits": limits, "structure": factors}
    if found is None:
        return ControllerDesign(
            status=DesignStatus.NONE, controller=None, level=0.0, proofs=(), shares={}, searched=(), **same
        )
    best, proof = found
    return ControllerDesign(
        status=DesignStatus.PROVED if proof.kept else DesignStatus.FOUND,
        controller=best.controller,
        level=best.level,
        proofs=proof.proofs,
        shares=proof.shares,
        searched=tuple(best.at),
        **same,
    )


def _check_limits(limits: Limits, basis: Basis) -> None:
    if limits.integral_gain and not basis.integral.any():
        raise InputError("`structure` must hold an integrator for its gain to be largest, such as PID()")
    if basis.shape == (1, 1):
        return
    for name in ("gain_margin", "phase_margin", "delay_margin", "integral_gain"):
        if getattr(limits, name) is not None:
            raise InputError(
                f"`{name}` is of one input and one output; got {basis.shape[1]} outputs. The peak of the sensitivity keeps"
                " margins of all loops"
            )


def _check(plants: list[Plants]) -> None:
    if not plants:
        raise InputError("`bands` must hold at least one band")
    for one in plants:
        if one.loop.shape != plants[0].loop.shape:
            raise InputError("`bands` must have the same inputs and outputs")
        if not math.isclose(one.dt, plants[0].dt, rel_tol=1e-9):
            raise InputError(f"`bands` must have one sample time; got {plants[0].dt:g} and {one.dt:g} s")

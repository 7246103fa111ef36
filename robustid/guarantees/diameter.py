"""diameter(): how far two consistent systems can be apart, before any value is measured."""

from __future__ import annotations

import concurrent.futures
import dataclasses

import numpy as np
from numpy.typing import ArrayLike

from robustid.core import Frozen, Progress, Real, as_kind, counted, freeze, hz_words
from robustid.guarantees.worst_case import worst_case_error
from robustid.guarantees.worst_case_result import WorstCaseError
from robustid.identification import MixedProblem, check_gain, identify


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Diameter(Frozen):
    """Largest |F1 - F2| of two systems that are consistent with the same data, whatever these will be.

    Attributes
    ----------
    error : WorstCaseError
        Of the model 0 over the systems that are consistent with zero data: half of every diameter, with its proof.
    """

    error: WorstCaseError

    @property
    def omega(self) -> Real:
        """Frequencies, rad/s, (F,)."""
        return self.error.omega

    @property
    def upper(self) -> Real:
        """Guaranteed: no two systems that are consistent with the same data differ by more, of every entry, (F, ny, nu)."""
        return freeze(2 * self.error.upper)

    @property
    def lower(self) -> Real:
        """Attained: with zero data two systems were found that differ so much, (F, ny, nu)."""
        return freeze(2 * self.error.lower)

    @property
    def largest(self) -> float:
        """Guaranteed bound over the circle (with an integrator: |omega| >= the first frequency point): twice `error.hinf`."""
        return 2 * self.error.hinf

    def verify(self) -> bool:
        """Evaluate all certificates again; no solver is involved."""
        return self.error.verify()

    def __repr__(self) -> str:
        return f"<Diameter: {counted(self.omega.size, 'frequency')}, largest {self.upper.max():.4g}>"

    def summary(self) -> str:
        """The result in plain text."""
        k, *entry = np.unravel_index(int(np.argmax(self.upper)), self.upper.shape)
        return "\n".join(
            [
                f"diameter   whatever is measured, two consistent systems differ by at most {self.upper.max():.4g} at"
                f" {counted(self.omega.size, 'frequency')}",
                f"worst      {hz_words(self.omega[k] / (2 * np.pi))} (zero data attain {self.lower[k, *entry]:.4g})",
                "meaning    no model and no method can guarantee less than half of the attained value for every outcome",
            ]
        )


def diameter(
    problem: MixedProblem,
    *,
    omega: ArrayLike | None = None,
    directions: int = 16,
    rtol: float = 0.05,
    executor: concurrent.futures.Executor | None = None,
    progress: Progress | None = None,
) -> Diameter:
    """A-priori diameter of information: how far two consistent systems can be apart at a frequency, whatever will be measured.

    The values of the samples do not enter, only where they are taken, their bounds, and the class: for the design of experiments.
    If F1 and F2 are consistent with the same data, H = (F1 - F2)/2 is in the class (convex, and symmetric about 0) and keeps every
    bound around the value zero; hence, at every frequency,

        max over data of max |F1 - F2| = 2 max{|H| : H consistent with zero data}.

    Parameters
    ----------
    problem : MixedProblem
        Values and outputs are ignored; the inputs of time records count. Intervals of the parameters count by their widths.
    omega : (F,) array, rad/s, optional
    directions : int
    rtol : float
    executor : concurrent.futures.Executor, optional
    progress : callable (text, done, count), optional
        As for `worst_case_error`.

    Returns
    -------
    Diameter

    Raises
    ------
    InputTypeError
        Something that isn't a MixedProblem.
    InputError
        As for `worst_case_error`.

    Notes
    -----
    Source: `inanc2001` section II-C, `parrilo1998`.

    Examples
    --------
    A bound on f_0 alone says nothing far from z = 0: |F| <= (e + 1/rho)/(1 + e/rho) by Pick's theorem, K = 1.

    >>> import robustid as rid
    >>> from robustid.guarantees import diameter
    >>> record = rid.TimeRecord([1.0], [7.0], dt=1.0, bound=0.2)
    >>> problem = rid.MixedProblem(time=record, prior=rid.Prior(gain_bound=1.0, decay_rate=2.0))
    >>> round(diameter(problem, omega=[0.0], rtol=1e-4).upper.item() / 2, 3), round((0.2 + 0.5) / (1 + 0.2 * 0.5), 3)
    (0.636, 0.636)
    """
    import control

    as_kind("problem", problem, MixedProblem, "a MixedProblem")
    check_gain(problem, "the diameter before the data are known")
    nothing = control.ss([], [], [], np.zeros((problem.entries.outputs, problem.entries.inputs)), problem.dt)
    error = worst_case_error(
        identify(_without_values(problem)),
        model=nothing,
        omega=omega,
        directions=directions,
        rtol=rtol,
        executor=executor,
        progress=progress,
    )
    return Diameter(error)


def _without_values(problem: MixedProblem) -> MixedProblem:
    """The problem with zero data, its intervals moved to be centred at 0."""
    intervals = problem.parameter_bounds
    if intervals is not None:
        half = np.where(np.isfinite(intervals[..., 0]), (intervals[..., 1] - intervals[..., 0]) / 2, np.inf)
        intervals = np.stack([-half, half], axis=-1)
    return dataclasses.replace(
        problem,
        frequency=tuple(dataclasses.replace(f, values=np.zeros_like(f.values)) for f in problem.frequency),
        time=tuple(dataclasses.replace(t, y=np.zeros_like(t.y)) for t in problem.time),
        parameter_bounds=intervals,
    )

"""Samples at frequencies, each against what the others prove of it: a quick proof that data and class contradict each other."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from robustid.core import Complex, Frozen, Real, freeze, one_thread
from robustid.errors import InputError
from robustid.guarantees.linear.amplitudes import extract
from robustid.guarantees.linear.clash import lines_of, predicted_lines
from robustid.guarantees.linear.functions import fixed_functions
from robustid.guarantees.linear.samples import Samples, samples_of
from robustid.guarantees.linear.search import FEW
from robustid.identification import MixedProblem

_MOST = 200  # samples that are checked


@dataclasses.dataclass(frozen=True, eq=False)
class SampleCheck(Frozen):
    """Discs that hold the response of every consistent system at samples, each proved from the other samples alone.

    Attributes
    ----------
    problem : MixedProblem
    omega : (F,) array, rad/s
        Of the samples, ascending.
    values : (F,) complex array
    bound : (F,) array
    centre : (F,) complex array
    radius : (F,) array
    """

    problem: MixedProblem
    omega: Real
    values: Complex
    bound: Real
    centre: Complex
    radius: Real

    def __post_init__(self) -> None:
        names = ("omega", "values", "bound", "centre", "radius")
        self._set(**{name: freeze(np.asarray(getattr(self, name))) for name in names})

    @property
    def ratio(self) -> Real:
        """|value - centre| over bound + radius, (F,): above 1 the discs have no common point, and no system is consistent."""
        return np.abs(self.values - self.centre) / (self.bound + self.radius)

    @property
    def margin(self) -> float:
        """The largest ratio: where it is above 1, a proved lower bound of the consistency margin.

        With all bounds times s >= 1 every radius grows at most by s.
        """
        return float(self.ratio.max(initial=0.0))

    @property
    def worst(self) -> float:
        """Frequency of the sample with the largest ratio, rad/s."""
        return float(self.omega[np.argmax(self.ratio)])

    @property
    def contradicts(self) -> bool:
        """True where no system of the class keeps all samples within their bounds; False says nothing."""
        return self.margin > 1


def check_samples(problem: MixedProblem) -> SampleCheck:
    """Check samples of a problem of one entry, poles as stated: all of them, or 200 of many.

    At its own sample a band is never farther away than the bound; a disc from the other samples may be.

    Raises
    ------
    InputError
        A problem of several entries.
    """
    outputs, inputs = problem.entries.shape
    if outputs * inputs > 1:
        raise InputError(
            f"`problem` must have one input and one output; got {outputs} outputs and {inputs} inputs: choose an entry"
        )
    samples = samples_of(problem, fixed_functions(problem.parametric), (0, 0))
    with one_thread():
        own = _checked(samples)
        each = predicted_lines(extract(samples), own, FEW)
    none = np.zeros(0)
    names = "y", "bound", "centre", "radius"
    parts = [np.concatenate([none, *(getattr(one, name) for one in each)]) for name in names]
    angles = np.concatenate([none, *(samples.angles[one.points[:, 0]] for one in each)])
    order = np.argsort(angles, kind="stable")
    y, bound, centre, radius = (one[order] for one in parts)
    middle: Complex = np.asarray(centre + y, dtype=complex)
    return SampleCheck(problem, problem.plane.omega(angles[order]), y.astype(complex), bound, middle, radius - bound)


def _checked(samples: Samples) -> NDArray[np.intp]:
    """Numbers of the samples to be checked: those of the response itself."""
    own = lines_of(samples)
    own = own[samples.v[own, 0] == 1]
    own = own[np.argsort(samples.angles[own], kind="stable")]
    return own[np.unique(np.linspace(0, own.size - 1, min(_MOST, own.size)).round().astype(int))]

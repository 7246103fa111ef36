"""The finite problems that stand for the infinite one: the exact form, and the form of L Taylor coefficients."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from robustid.bases import input_normal_pair
from robustid.errors import SizeError, Status
from robustid.interpolation import (
    ClassicalForm,
    MarginCertificate,
    MixedProblem,
    SarasonMap,
    ShiftMap,
    classical_form,
    measurement_rows,
    taylor_tail,
)
from robustid.solve import ConvexData

# The exact form is dense: n^4 work per Newton step. Minutes begin at the second.
QUICK_EXACT, LARGEST_EXACT = 100, 200
LONGEST_TAYLOR = 2000  # dense L x L matrices: 32 MB each, a dozen of them, and L^3 work per Newton step
_EDGE = 1e-6  # how far outside the smallest margin the model is centred
_SHARE = 0.1  # of the accuracy that is left to the tails


@dataclasses.dataclass(frozen=True)
class Posed:
    """A problem with its arrays.

    Attributes
    ----------
    problem : MixedProblem
    data : ConvexData
    length : int
        Number L of Taylor coefficients; 0 for the exact form.
    classical : ClassicalForm or None
        The basis of the paper's inequality, where that was asked.
    """

    problem: MixedProblem
    data: ConvexData
    length: int
    classical: ClassicalForm | None = None

    def with_prior(self, **changes: float) -> Posed:
        """The same form of the problem with another prior."""
        return pose(self.problem.with_prior(**changes), self.length, self.classical is not None)


def pose(problem: MixedProblem, length: int = 0, classical: bool = False) -> Posed:
    """Arrays of the exact form (length 0), in the orthonormal or the paper's basis, or of `length` Taylor coefficients."""
    if length:
        return Posed(problem, ConvexData(measurement_rows(problem, length), ShiftMap(length)), length)
    n = problem.coefficients
    if n > LARGEST_EXACT:
        raise SizeError(
            f"`problem` has {n} coefficients in the exact form (2 per frequency line, 1 per time sample); it takes up to"
            f' {LARGEST_EXACT}. Use form="auto" or "taylor", or thin the data: frf.select(slice(None, None, step)), a shorter'
            " record, or fewer lines off resonance"
        )
    pair = input_normal_pair(problem.angles, 1 / problem.prior.decay_rate, problem.taylor)
    data = ConvexData(measurement_rows(problem, pair), SarasonMap(pair))
    basis = None
    if classical and n:
        basis = classical_form(pair, problem.angles, problem.prior.decay_rate, problem.taylor)
    return Posed(problem, data, 0, basis)


def length_of(problem: MixedProblem, form: str, accuracy: float) -> int:
    """The number of Taylor coefficients for a form; 0 for the exact one.

    "auto" takes the exact form while it is quick, and where it is the smaller one.
    """
    if form in ("orthonormal", "classical"):
        return 0
    n = problem.coefficients
    if form == "auto" and n <= QUICK_EXACT:
        return 0
    length = taylor_length(problem, accuracy)
    if form == "auto" and n <= LARGEST_EXACT and length > 4 * n:
        return 0
    if length > LONGEST_TAYLOR:
        raise SizeError(
            f"`problem` has {n} coefficients in the exact form, and needs {length} Taylor coefficients for accuracy {accuracy:g} at"
            f" decay rate {problem.prior.decay_rate:g}; up to {LARGEST_EXACT} and {LONGEST_TAYLOR} are possible. Put lightly damped"
            " modes into `parametric` and raise the decay rate, ask for less accuracy, or thin the data:"
            " frf.select(slice(None, None, step)), a shorter record, or fewer lines off resonance"
        )
    return length


def taylor_length(problem: MixedProblem, accuracy: float) -> int:
    """Smallest L whose tails are below a tenth of the accuracy, in units of every bound."""
    ratio = taylor_tail(problem.prior, 0) / (_SHARE * accuracy * smallest_bound(problem))
    return max(1, math.ceil(math.log(max(ratio, 1.0)) / math.log(problem.prior.decay_rate)))


def smallest_bound(problem: MixedProblem) -> float:
    """Largest error of the model, at every frequency, that no sample feels as more than its bound."""
    least = [float(frf.inner_radius.min()) for frf in problem.frequency]
    for record in problem.time:
        # sum over the past of |u| rho^-j <= max|u| / (1 - 1/rho); a periodic record has the l1 norm of its spectrum.
        drive = float(np.abs(record.u).max()) / (1 - 1 / problem.prior.decay_rate)
        if record.initial == "periodic":
            drive = 2 * float(np.sum(np.abs(np.fft.rfft(record.u[:, 0])))) / record.u.shape[0]
        if drive > 0:
            least.append(float(record.bound[np.isfinite(record.bound)].min()) / drive)
    return min(least, default=problem.prior.gain_bound)


@dataclasses.dataclass(frozen=True, eq=False)
class Claim:
    """The margin as it is claimed: reached by the point (x, p), proved from below by the certificate, to an accuracy."""

    margin: float
    accuracy: float
    x: np.ndarray
    p: np.ndarray
    certificate: MarginCertificate
    solver: str

    @property
    def width(self) -> float:
        """Of the proven interval, relative where the margin exceeds 1; infinite where its ends are the wrong way round."""
        difference = self.margin - self.certificate.value
        return difference / max(1.0, self.margin) if difference >= 0 else np.inf

    @property
    def status(self) -> Status:
        """What the interval says."""
        if self.margin <= 1:
            return Status.CONSISTENT
        if self.certificate.value > 1:
            return Status.INCONSISTENT
        return Status.UNDECIDED if self.width <= self.accuracy else Status.FAILED


def level_of(objective: str, margin: float, accuracy: float) -> float:
    """The multiple of the bounds that defines the set from which the model is taken."""
    widest = max(1.0, margin * (1 + _EDGE))
    return min(margin * (1 + _EDGE) + accuracy, widest) if objective == "margin" else widest

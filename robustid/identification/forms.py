"""The finite problems that stand for the infinite one: the exact form, Taylor coefficients, a repeated section."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from robustid.bases import Sections, input_normal_pair
from robustid.errors import InputError, SizeError, Status
from robustid.identification.certificate import MarginCertificate
from robustid.identification.formulation.classical import ClassicalForm, classical_form
from robustid.identification.formulation.functions import MOST_STORED, taylor_tail
from robustid.identification.formulation.rows import measurement_rows
from robustid.identification.formulation.sarason import SarasonMap, SectionMap, ShiftMap
from robustid.identification.problem import MixedProblem
from robustid.identification.section_choice import demands, shortest_sections
from robustid.identification.solver.conic import ConvexData

# The exact form is dense: n^4 work per Newton step. Minutes begin at the second.
QUICK_EXACT, LARGEST_EXACT = 100, 200
LONGEST_SECTIONS = 1000  # the same, with N x n columns of the lines
LONGEST_TAYLOR = 2000  # dense L x L matrices: 32 MB each, a dozen of them, and L^3 work per Newton step
_QUICK = 5e8  # multiplications per Newton step up to which no other form is looked for: a second in all
_CLEARLY = 0.5  # of the work of the other forms: what sections may take
_MOST_PRODUCTS = 1e8  # numbers held at once: 0.8 GB
_EDGE = 1e-6  # how far outside the smallest margin the model is centred
_SHARE = 0.1  # of the accuracy that is left to the tails


@dataclasses.dataclass(frozen=True)
class Posed:
    """A problem with its arrays.

    Attributes
    ----------
    problem : MixedProblem
    data : ConvexData
    sections : Sections or None
        The repeated section, the shift for Taylor coefficients; None for the exact form.
    classical : ClassicalForm or None
        The basis of the paper's inequality, where that was asked.
    """

    problem: MixedProblem
    data: ConvexData
    sections: Sections | None
    classical: ClassicalForm | None = None

    def with_prior(self, **changes: float) -> Posed:
        """The same form of the problem with another prior."""
        return pose(self.problem.with_prior(**changes), self.sections, self.classical is not None)


def pose(problem: MixedProblem, sections: Sections | None = None, classical: bool = False) -> Posed:
    """Arrays of the exact form, in the orthonormal or the paper's basis, or of the form of a repeated section."""
    if sections is not None:
        sarason = ShiftMap(sections.order, problem.entries) if sections.is_shift else SectionMap(sections)
        return Posed(problem, ConvexData(measurement_rows(problem, sections), sarason), sections)
    n = problem.coefficients
    if n > LARGEST_EXACT:
        raise SizeError(
            f"`problem` has {n} coefficients in the exact form (2 per frequency line, 1 per time sample); it takes up to"
            f' {LARGEST_EXACT}. Use form="auto" or "taylor", or thin the data: frf.select(slice(None, None, step)), a shorter'
            " record, or fewer lines off resonance"
        )
    pair = input_normal_pair(problem.angles, 1 / problem.prior.decay_rate, problem.taylor)
    data = ConvexData(measurement_rows(problem, pair), SarasonMap(pair, problem.entries))
    basis = None
    if classical and n:
        basis = classical_form(pair, problem.angles, problem.prior.decay_rate, problem.taylor)
    return Posed(problem, data, None, basis)


def sections_of(problem: MixedProblem, form: str, accuracy: float) -> Sections | None:
    """The repeated section of a form, the shift for Taylor coefficients; None for the exact form.

    "auto" takes the exact form while it is quick, and then the form with the least work; sections only where they clearly save.
    """
    n, entries = problem.coefficients, problem.entries
    if form in ("sections", "classical") and not entries.single:
        raise InputError(f'`form` = "{form}" is for one input and one output; got {entries.outputs}x{entries.inputs}')
    if form in ("orthonormal", "classical") or (form == "auto" and entries.single and n <= QUICK_EXACT):
        return None
    shift = Sections.shift(taylor_length(problem, accuracy))
    if form == "taylor":
        return _possible(problem, shift, accuracy)
    if form == "sections":
        return _possible(problem, shortest_sections(problem, _SHARE * accuracy), accuracy)
    best = None if _work(problem, None) < _work(problem, shift) else shift
    if entries.single and _work(problem, best) > _QUICK:
        found = shortest_sections(problem, _SHARE * accuracy)
        if _work(problem, found) < _CLEARLY * _work(problem, best):
            best = found
    return best if best is None else _possible(problem, best, accuracy)


def _possible(problem: MixedProblem, sections: Sections, accuracy: float) -> Sections:
    """The same, where it is not too large."""
    n, limit = sections.order, LONGEST_TAYLOR if sections.is_shift else LONGEST_SECTIONS
    limit = int(limit / np.sqrt(problem.entries.count))  # dense matrices of all unknowns
    if n <= limit:
        return sections
    kind = (
        "Taylor coefficients"
        if sections.is_shift
        else f"coefficients (a section of degree {sections.degree}, repeated)"
    )
    raise SizeError(
        f"`problem` has {problem.coefficients} coefficients in the exact form, and needs {n} {kind} for accuracy {accuracy:g} at"
        f" decay rate {problem.prior.decay_rate:g}; up to {LARGEST_EXACT} and {limit} are possible. Put lightly damped"
        " modes into `parametric` and raise the decay rate, ask for less accuracy, or thin the data:"
        " frf.select(slice(None, None, step)), a shorter record, or fewer lines off resonance"
    )


def _work(problem: MixedProblem, sections: Sections | None) -> float:
    """Of a Newton step, in multiplications, nearly, as measured; infinite where a form is too large for the problem."""
    lines, entries = sum(frf.omega.size for frf in problem.frequency), problem.entries
    n = problem.coefficients if sections is None else sections.order
    if not entries.single:
        return _matrix_work(problem, n, sections is None)
    if sections is None:
        return 8.0 * n**4 if n <= LARGEST_EXACT else math.inf
    if sections.is_shift:
        return 20.0 * n**3 if n <= LONGEST_TAYLOR else math.inf
    return 40.0 * n**3 + 3.0 * lines * n**2 if n <= LONGEST_SECTIONS and lines * n <= MOST_STORED else math.inf


def _matrix_work(problem: MixedProblem, n: int, exact: bool) -> float:
    """The same of matrices: the factors of the block of size n(p + q) and of the Newton matrix, and its curvature."""
    p, q = problem.entries.outputs, problem.entries.inputs
    if exact and (n > LARGEST_EXACT or 4 * (p + q) ** 2 * n**3 > _MOST_PRODUCTS):
        return math.inf
    if not exact and n * math.sqrt(p * q) > LONGEST_TAYLOR:
        return math.inf
    dense = 20.0 * (n * (p + q)) ** 3 + (n * p * q) ** 3 / 3 + problem.samples * (n * (p * q if exact else 1)) ** 2
    return dense + (4.0 * p**2 * q**2 * n**4 if exact else 40.0 * p**2 * q**2 * n**2 * math.log(n + 2))


def taylor_length(problem: MixedProblem, accuracy: float) -> int:
    """Smallest L whose tails are below a tenth of the accuracy, in units of every bound."""
    ratio = taylor_tail(problem.prior, 0) / (_SHARE * accuracy * smallest_bound(problem))
    return max(1, math.ceil(math.log(max(ratio, 1.0)) / math.log(problem.prior.decay_rate)))


def smallest_bound(problem: MixedProblem) -> float:
    """Largest error of the model, at every frequency, that no sample feels as more than its bound."""
    _, bounds, everywhere = demands(problem)
    least = min(everywhere, float(bounds.min(initial=np.inf)))
    return least if np.isfinite(least) else problem.prior.gain_bound


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

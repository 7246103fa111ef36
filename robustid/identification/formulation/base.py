"""The finite formulation of a problem: functions, rows, the map X(x), its size, and the interpolants of its solutions."""

from __future__ import annotations

import abc
import dataclasses
import functools
import math
from collections.abc import Callable
from typing import ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from robustid.bases import InputNormalPair, Sections
from robustid.core import Array, Frozen, Numbers, StateMatrices
from robustid.errors import Remedy, SizeError
from robustid.identification.formulation.convex import ConvexData
from robustid.identification.formulation.functions import Functions
from robustid.identification.formulation.rows import Rows, measurement_rows
from robustid.identification.formulation.sarason import SarasonMap
from robustid.identification.interpolant import FreeParameter, Interpolants
from robustid.identification.problem import MixedProblem
from robustid.identification.schur import TaylorInterpolants
from robustid.identification.truncation import BalancedContraction

LARGEST_EXACT = 200  # coefficients: the exact form is dense, n^4 work per Newton step

_PER_SECOND = 2e10  # multiplications, of dense matrices on one core
_PATIENCE = 3.0  # seconds of a step that is begun in any case: what is kept is worth it
_STORED = 2.0  # GB: the Newton matrix, of which there are several copies

Family = Interpolants | TaylorInterpolants
States = tuple[Array, Array, Array, Array]  # A, B, C, D
Realisation = Callable[[float], tuple[States, float]]


@dataclasses.dataclass(frozen=True, eq=False)
class Formulation(Frozen, Functions):
    """A finite convex problem that stands for the infinite one: G is known by n coefficients an entry, x, and a tail.

    Whatever depends on the kind of basis is asked here; what the coefficients leave out, the tails of the rows bound.
    """

    problem: MixedProblem

    name: ClassVar[str]  # value of the argument `form` of `identify`
    exact: ClassVar[bool] = False  # the coefficients determine every sample: no tails

    @classmethod
    @abc.abstractmethod
    def within(cls, problem: MixedProblem, accuracy: float) -> Formulation:
        """The shortest one of this kind whose tails are below a tenth of the accuracy, in units of every bound."""

    @classmethod
    def takes(cls, problem: MixedProblem) -> bool:
        """Say whether such problems can be posed so."""
        return True

    @classmethod
    def refusal(cls, problem: MixedProblem) -> str:
        """Why a problem is not taken, and what to do: the end of a sentence."""
        return "does not take such problems"

    @property
    @abc.abstractmethod
    def basis(self) -> InputNormalPair | Sections:
        """The functions phi_j of the variable zeta of the unit disc, on which the region of the class is mapped."""

    @functools.cached_property
    def sarason(self) -> SarasonMap:
        """The map x -> X(x), which must be a contraction."""
        return self._sarason()

    @abc.abstractmethod
    def _sarason(self) -> SarasonMap: ...

    @property
    @abc.abstractmethod
    def description(self) -> str:
        """The finite problem in words, for reports."""

    @property
    @abc.abstractmethod
    def determined(self) -> int:
        """Number of Taylor coefficients of G that the coefficients determine."""

    @property
    def repeated(self) -> Sections | None:
        """The repeated all-pass function behind the basis; None for the exact form."""
        return None

    @functools.cached_property
    def rows(self) -> Rows:
        """The measurements as linear equations in the coefficients and the parameters."""
        return measurement_rows(self)

    @functools.cached_property
    def data(self) -> ConvexData:
        """Everything that solvers and proofs need."""
        return ConvexData(self.rows, self.sarason)

    def of(self, problem: MixedProblem) -> Self:
        """Another problem in the same form."""
        return dataclasses.replace(self, problem=problem)

    def with_gain(self, gain_bound: float) -> Self:
        """Another gain bound with the same problem and form."""
        return self.of(self.problem.with_prior(gain_bound=gain_bound))

    def with_node(self, angle: float) -> Formulation:
        """A form in which the value at exp(j angle) is determined, or bounded by a tail."""
        return self

    def with_nodes(self, angles: NDArray[np.float64]) -> Formulation:
        """A form in which the values at several angles are determined, or bounded by a tail."""
        return self

    def values(self, angles: NDArray[np.float64]) -> Numbers:
        """The functions at any exp(j angle), (F, n)."""
        functions = self.problem.prior.gain_bound * self.basis.evaluate(self.problem.region.points(angles))
        return self.problem.weighting.times(functions, angles)

    def impulses(self, count: int) -> NDArray[np.float64]:
        """The first samples of the impulse responses of the functions, (count, n), but for the weight of the class."""
        prior = self.problem.prior
        decay = prior.decay_rate ** -np.arange(count, dtype=float)[:, None]
        return prior.gain_bound * decay * self.sarason.pair.taylor(count)

    def family(self, x: NDArray[np.float64]) -> Family:
        """All functions of the unit ball with the coefficients x."""
        return self.sarason.interpolants(x)

    def realisation(self, x: NDArray[np.float64], E: FreeParameter = 0.0) -> Realisation:
        """State spaces of the interpolant with the free parameter E, without scaling and weight of the prior.

        A function of the error that states left out may cost, in the H-infinity norm; it returns a bound of it too.
        """
        whole = BalancedContraction(*self._states(x, E))

        def realise(tolerance: float) -> tuple[States, float]:
            small = whole.truncate(tolerance)
            return small[:4], small.bound

        return realise

    def _states(self, x: NDArray[np.float64], E: FreeParameter) -> States:
        """State space of G(z) = K phi(zeta), forward-shift convention, of that of phi in the series variable zeta."""
        alpha, beta, gamma, delta = self.sarason.interpolants(x).realise(E)
        K = self.problem.prior.gain_bound
        # Half of K on either side keeps the realisation balanced.
        root = np.sqrt(K)
        return self.problem.region.in_z(StateMatrices(alpha, root * beta, root * gamma, K * delta))

    @property
    def work(self) -> float:
        """Multiplications of a Newton step, approximately, as measured; infinite where the form is too large."""
        return self._siso_work() if self.problem.entries.single else self._mimo_work()

    @abc.abstractmethod
    def _siso_work(self) -> float: ...

    @abc.abstractmethod
    def _mimo_work(self) -> float: ...

    def _dense_work(self, seen: int) -> float:
        """Work of MIMO: the factors of the block of size n(p + q) and of the Newton matrix, and samples that see `seen` entries."""
        (p, q), n = self.problem.entries.shape, self.count
        return 20.0 * (n * (p + q)) ** 3 + (n * p * q) ** 3 / 3 + self.problem.samples * (n * seen) ** 2

    def check_size(self, accuracy: float) -> None:
        """Refuse what would take too long, and say the way out."""
        kind, limit = self._kind[0], self._limit
        if self.count > limit:
            raise SizeError(
                f"`problem` has {self.problem.coefficients} coefficients in the exact form, and needs {self.count} {kind} for"
                f" accuracy {accuracy:g} at {self.problem.prior.decay_words}; up to {LARGEST_EXACT} and {limit} are"
                " possible. ",
                Remedy(
                    {},
                    "Put lightly damped modes into `parametric` and raise the decay rate, ask for less accuracy, or thin the data:"
                    " frf.select(slice(None, None, step)), a shorter record, or fewer points where the response is smooth",
                ),
            )

    def check_memory(self) -> None:
        """Refuse a matrix whose Newton step takes more memory than there is."""
        entries, unknowns = self.problem.entries.count, self.count * self.problem.entries.count
        stored = 8e-9 * unknowns**2
        if entries > 1 and stored > _STORED:
            raise SizeError(
                f"`problem` has {unknowns} coefficients in its {entries} entries: one step of its solution takes about"
                f" {self.work / _PER_SECOND:.2g} s and matrices of {stored:.2g} GB, {_STORED:g} GB are possible. ",
                Remedy({}, "Take single entries, frf.entry(output, input), a larger decay, or fewer points"),
            )

    def is_late(self, seconds: float | None, steps: int = 1) -> bool:
        """Tell of a matrix whether so many Newton steps take longer than a solution may."""
        late = seconds is not None and steps * self.work / _PER_SECOND > max(seconds, _PATIENCE)
        return late and not self.problem.entries.single

    @property
    def size_words(self) -> str:
        """Number of coefficients of an entry in this form, and the largest possible one, in words."""
        return f"{self.count} {self._kind[0]} where up to {self._limit} are possible ({self.name} form)"

    @property
    def _limit(self) -> int:
        """Largest number of coefficients: dense matrices of all unknowns."""
        return int(self._kind[1] / math.sqrt(self.problem.entries.count))

    @property
    @abc.abstractmethod
    def _kind(self) -> tuple[str, int]:
        """Name of the coefficients, and largest number of them for SISO."""

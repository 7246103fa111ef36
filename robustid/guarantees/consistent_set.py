"""The set of all consistent systems, and extremes of linear functionals over it."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from robustid.bases import solve_stein
from robustid.core import Budget, Complex, Frozen, Real, hz_words
from robustid.errors import InconsistentDataError
from robustid.guarantees.extremes import Extreme, PartSet, largest, part_set
from robustid.identification import (
    Functional,
    Identification,
    MixedProblem,
    SupportCertificate,
    entry_name,
    evaluate_support,
)
from robustid.identification.formulation import (
    Candidate,
    ConvexData,
    Entries,
    Formulation,
    Part,
    SectionsFormulation,
    lightest,
    parts_of,
)
from robustid.identification.solver import Place, Supports, analytic_center, barrier_extents

Entry = tuple[int, int]  # output and input

_ACCURACY = 1e-4  # of bounds in a form with tails, in units of the samples' bounds
_CHORDS, _FULL = 4, 5e-3  # steps from the centre to a point that is not inside, and how near to the border they end
_TAIL = 0.01  # of the smallest bound of a sample: what a tail may add to a value
_BARELY = (
    1e-6  # sets thinner than this have no inside to work from: their outer neighbour of this width is bounded instead
)


@dataclasses.dataclass(frozen=True, eq=False)
class ConsistentSet(Frozen):
    """All (x, p) with ||X(x)|| <= 1 and every |residual| <= level * bound, and a point well inside."""

    posed: Formulation
    center: Candidate  # analytic centre
    level: float  # 1; barely more where the data are barely consistent, so that the set has an inside (bounds hold all the more)
    # The form without tails, for frequencies at which the tail of `posed` is more than a hundredth of the smallest bound.
    exact: Formulation | None = None

    @property
    def data(self) -> ConvexData:
        """Its arrays."""
        return self.posed.data

    def extreme(
        self,
        functional: Functional,
        gap: float,
        *,
        reached: bool = True,
        near: Place | None = None,
        early: bool = False,
    ) -> Extreme:
        """Largest value, to a part `gap` of how far it is from the value at the centre.

        Of entries that no sample sees together with others first from their own problem, which is smaller (`bounded`). From the
        whole one where the ball ties the entries together, so that no system was found near that bound, if one must be `reached`.
        """
        part, inside = self.bounded(functional, gap), functional(self.center.x, self.center.p)
        if part is None:
            return self.extreme_of_all(functional, gap, near, early)
        x, p = self.towards(part.x, part.p)
        value = functional(x, p) - functional.tail
        close = part.upper - value <= 2 * (gap * max(value + functional.tail - inside, 0.0) + functional.tail)
        if close or not reached:
            return dataclasses.replace(part, attained=value if self.contains(x, p) else -np.inf, x=x, p=p)
        whole = self.extreme_of_all(functional, gap)
        return whole if whole.upper <= part.upper else whole.proved_by(part)

    def extreme_of_all(
        self, functional: Functional, gap: float, near: Place | None = None, early: bool = False
    ) -> Extreme:
        """`extreme` from the whole problem; `near` and `early` as in `largest`."""
        found = largest(self.data, self._supports, self.center, self.level, functional, gap, near, early)
        return found if self.contains(found.x, found.p) else dataclasses.replace(found, attained=-np.inf)

    def member(self, functional: Functional, gap: float, budget: Budget | None = None) -> tuple[Real, Real] | None:
        """Coefficients and parameters of a system whose value is about that near to the largest one; nothing is proved.

        None where the set is too thin for a verified one. Where the time is over it is the farthest so far.
        """
        inside, best, last = functional(self.center.x, self.center.p), None, 0.0
        for point, value, estimate, _ in self._supports.path((np.array(functional.x), np.array(functional.p))):
            best, last, gained = point, value - inside, value - inside - last
            # Near the end values grow less than their estimated gap: each step takes most of it.
            if estimate <= gap * last or (estimate <= last and gained <= gap * last):
                break
            if budget is not None and budget.over:
                break
        return (best.x, best.p) if best is not None and self.contains(best.x, best.p) else None

    def bounded(self, functional: Functional, gap: float) -> Extreme | None:
        """The extreme over systems that are only asked to have entries that are consistent with their own samples.

        None where samples see these entries together with others. The certificate is one about the consistent systems; the point is
        outside of their set where the ball ties the entries together.
        """
        part, mine = next((one for one in self._parts if one[0].sees(functional.x, functional.p)), (None, None))
        if part is None or mine is None:
            return None
        own = Functional(*part.weights(functional.x, functional.p), functional.tail)
        found = largest(mine.data, mine.supports, mine.center, mine.level, own, gap)
        samples, left, right = part.lifted(found.certificate.samples, found.certificate.left, found.certificate.right)
        rows, sarason = self.data.rows, self.data.sarason
        value = evaluate_support(functional, samples, left @ right.T, self.level, rows, sarason)
        proof = SupportCertificate(samples, left, right, self.level, float(value + 1e-12 * abs(value)))
        return Extreme(
            proof.value, found.attained, *part.replaced(self.center.x, self.center.p, (found.x, found.p)), proof
        )

    def towards(self, x: Real, p: Real) -> tuple[Real, Real]:
        """The point (x, p), or one inside that is near to the last one on the way there from the centre.

        What a system takes of its bounds is convex along the way: below 1 wherever a chord is.
        """

        def at(part: float) -> tuple[Real, Real]:
            return self.center.x + part * (x - self.center.x), self.center.p + part * (p - self.center.p)

        inside, taken, whole = 0.0, self._taken(*at(0.0)), self._taken(x, p)
        if whole <= 1:
            return x, p
        for _ in range(_CHORDS):
            if not taken < 1 - _FULL:
                break
            # Infinite where a parameter leaves its interval.
            part = inside + (1 - inside) * ((1 - taken) / (whole - taken) if np.isfinite(whole) else 0.5)
            here = self._taken(*at(part))
            if here > 1 + 1e-12:
                break
            inside, taken = part, here
        return at(inside)

    @functools.cached_property
    def _parts(self) -> tuple[tuple[Part, PartSet], ...]:
        center = self.center
        return tuple(
            (part, part_set(part.data, self.level, *part.restricted(center.x, center.p)))
            for part in parts_of(self.data)
        )

    @property
    def separate(self) -> bool:
        """Return whether samples leave some entries to themselves."""
        return bool(self._parts)

    @functools.cached_property
    def _supports(self) -> Supports:
        return Supports(self.data, self.center, self.level)

    def contains(self, x: Real, p: Real) -> bool:
        """Return whether some system with these coefficients keeps every sample within its bound: evaluated from the numbers."""
        if self._supports.surely_inside(x):  # an eighth of the work of the norm
            return self.data.margin(x, p) <= 1 + 1e-12
        return self._taken(x, p) <= 1 + 1e-12

    def _taken(self, x: Real, p: Real) -> float:
        """The largest part of its bound that a residual or the gain takes."""
        return max(self.data.margin(x, p), self.data.sarason.norm(x))

    def value_weights(self, omega: float, entry: Entry = (0, 0)) -> tuple[Complex, Complex, float]:
        """Weights of (x, p) in an entry of F at a frequency, complex, and what the other coefficients can add."""
        problem, here = self.posed.problem, self.posed.problem.plane.angles(np.array([omega]))
        prior, entries, phi = problem.prior, problem.entries, self.posed.values(here)[0]
        tail = float(self.posed.response_tail(here)[0])
        number, part = entries.place(*entry)
        scale = float(prior.scales(entries.outputs, entries.inputs)[entry])
        x = np.zeros((entries.count, phi.size), complex)
        x[number] = scale * part * phi
        values = np.zeros(0) if problem.parametric is None else problem.parametric.response(here)[0]
        return x.ravel(), self._parameter_weights(values, entry), scale * tail

    def parameter_weights(self, index: int, entry: Entry = (0, 0)) -> Real:
        """Weights of the scaled parameters in the entry of parameter number `index`."""
        parametric = self.posed.problem.parametric
        return np.real(self._parameter_weights(np.eye(parametric.size)[index], entry))

    def _parameter_weights(self, values: Real | Complex, entry: Entry) -> Complex:
        """Weights of the scaled parameters in the sum of values (m,) times the parameters of an entry."""
        rows, (number, part) = self.data.rows, self.posed.problem.entries.place(*entry)
        weights = np.zeros(rows.P.shape[1], complex)
        columns = slice(number * values.size, (number + 1) * values.size)
        weights[columns] = part * values / rows.column_scale[columns]
        return weights

    def with_node(self, omega: float) -> ConsistentSet:
        """Return the same set with coefficients that determine the value at `omega` too.

        The form of a repeated section stays as it is (its tail bounds the value); so does a pair that has the node.
        """
        return self._whole.with_node(omega) if self._tail_matters(omega) else self._in(self.posed_at(omega))

    @functools.cached_property
    def _whole(self) -> ConsistentSet:
        return set_of(self.exact or self.posed, self.level, ())

    def _tail_matters(self, omega: float) -> bool:
        """True where the tail of the form can't be passed over, and another form has none."""
        if self.exact is None:
            return False
        tail = self.posed.response_tail(self.posed.problem.plane.angles(np.array([omega])))[0]
        return bool(tail > _TAIL * self._smallest_bound)

    @functools.cached_property
    def _smallest_bound(self) -> float:
        return min(float(f.bound.inner_radius[f.bound.used].min()) for f in self.posed.problem.frequency)

    def _in(self, posed: Formulation) -> ConsistentSet:
        """The same set in a form with further nodes."""
        if posed is self.posed:
            return self
        pair = posed.data.sarason.pair
        alpha, beta, gamma, delta = self._interpolant
        # x = c g(A) of the central interpolant g(zeta) = delta + zeta gamma (I - zeta alpha)^-1 beta, column by column.
        states = [solve_stein(alpha, pair.A, column[:, None] @ pair.c @ pair.A) for column in beta.T]
        full = np.stack([gamma @ state for state in states], axis=1) + delta[:, :, None] * pair.c[0]
        # Of symmetric matrices the mean of both transposes: it has the same data, and is in the ball.
        start = dataclasses.replace(self.center, x=posed.problem.entries.collapse(full))
        return set_of(posed, self.level, [start])

    def spreads(self, omega: Real) -> Real:
        """Half-widths (F, ny, nu) of the values of the entries in an ellipsoid that the set contains, at all frequencies at once.

        Not what the set can do, but how much at one frequency beside another, for the price of one Newton matrix.
        """
        here = self._in(self.posed.with_nodes(self.posed.problem.plane.angles(omega)))
        entries = here.posed.problem.entries
        shape = omega.size, entries.outputs, entries.inputs
        parts = [here.value_weights(float(omega[k]), (i, j)) for k, i, j in np.ndindex(*shape)]
        X, P = (np.column_stack([part(one[n]) for one in parts for part in (np.real, np.imag)]) for n in (0, 1))
        gram = barrier_extents(here.data, here.center, here.level, X, P)
        blocks = np.array([gram[k : k + 2, k : k + 2] for k in range(0, len(gram), 2)])
        largest = np.sqrt(np.maximum(np.linalg.eigvalsh((blocks + blocks.swapaxes(1, 2)) / 2)[:, -1], 0.0))
        return (largest + [tail for _, _, tail in parts]).reshape(shape)

    def posed_at(self, omega: float) -> Formulation:
        """The arrays of `with_node`, for which nothing is solved; those of the set itself where it has no new node."""
        form = self.exact if self.exact is not None and self._tail_matters(omega) else self.posed
        return form.with_node(float(self.posed.problem.plane.angles(np.array(omega))))

    @functools.cached_property
    def _interpolant(self) -> tuple[Real, ...]:
        return self.data.sarason.interpolants(self.center.x).realise()


def consistent_set(identification: Identification) -> ConsistentSet:
    """The set of an identification; raises for data that are not consistent.

    InconsistentDataError: there is nothing to bound: no system fits, or none was found.
    """
    if not identification.consistent:
        raise InconsistentDataError(
            f"`identification` is {identification.status.name.lower()} (margin {identification.margin:.6g}): there is no consistent"
            " system whose error could be bounded; loosen the bounds or the prior first"
        )
    problem = identification.problem
    posed = identification.formulation
    level = 1.0 if identification.margin < 1 - _BARELY else 1 + _BARELY
    claim = identification.claim
    if (lighter := lightest(posed, _ACCURACY)) is not posed and identification.margin < 1 - _ACCURACY:
        beside = posed if isinstance(lighter, SectionsFormulation) else None
        return dataclasses.replace(set_of(lighter, level, ()), exact=beside)
    shrink = identification.prior.gain_bound / problem.prior.gain_bound
    none = np.zeros(0)
    starts = [
        Candidate(shrink * identification.coefficients, identification.scaled_parameters, none, none, ""),
        Candidate(claim.x, claim.p, none, none, ""),
    ]
    if not identification.prior.decays_as(problem.prior):
        starts = starts[1:]
    return set_of(posed, level, starts)


def set_of(posed: Formulation, level: float, starts: Sequence[Candidate]) -> ConsistentSet:
    """The set at a level above the smallest margin; `starts` are points that may be inside."""
    none = np.zeros(0)  # what proofs the centre has serves nothing here, and would go to every worker
    return ConsistentSet(
        posed,
        dataclasses.replace(analytic_center(posed.data, level, starts, quick=True), samples=none, ball=none),
        level,
    )


def independent_entries(entries: Entries) -> list[Entry]:
    """The entries whose values are independent, in the order of their unknowns: of symmetric matrices the upper triangle."""
    places = np.ndindex(entries.outputs, entries.inputs)
    return [(a, b) for a, b in places if a <= b or not entries.symmetric]


class Sample(NamedTuple):
    """A sample of a problem, named by its experiment and its place.

    Attributes
    ----------
    kind : str
        "frequency" or "time".
    experiment : int
        Number of its response or record, from 0.
    at : float
        Frequency in rad/s, or time in s.
    entry : str
        Its entry, in words that follow others; empty for SISO plants.

    Examples
    --------
    >>> from robustid.guarantees import Sample
    >>> print(Sample("time", 1, 0.25, " (y1)"))
    time 2 at 0.25 s (y1)
    """

    kind: str
    experiment: int
    at: float
    entry: str = ""

    @property
    def place(self) -> str:
        """Place in words, "at 13 Hz (y1 / u1)"."""
        return (
            f"at {hz_words(self.at / (2 * np.pi))}" if self.kind == "frequency" else f"at {self.at:.5g} s"
        ) + self.entry

    def __str__(self) -> str:
        return f"{self.kind} {self.experiment + 1} {self.place}"


def which(problem: MixedProblem, entry: tuple[int | None, int | None]) -> str:
    """An entry in words that follow others; empty for SISO plants."""
    name = entry_name(problem, entry)
    return f" ({name})" if name else ""

"""Family: plants that differ by amplitude, position, load or date; one nominal, and a band that holds every one of them."""

from __future__ import annotations

import dataclasses
import functools
import itertools
from collections.abc import Iterator
from typing import TYPE_CHECKING, NamedTuple, Self

import numpy as np

from robustid.core import Plane, Real, Unfinished, counted, freeze, hz_span, rounded_up
from robustid.guarantees.circle import CircleBound, union_of_circles
from robustid.guarantees.common_nominal import Centres, centres_of
from robustid.guarantees.member import Member, called_otherwise, otherwise_words
from robustid.guarantees.over_cells import WorstCase
from robustid.guarantees.over_poles import Bounded
from robustid.guarantees.pole_proofs import Cell, Claim
from robustid.guarantees.sweep import Means
from robustid.guarantees.weight import UncertaintyWeight, from_zero, uncertainty_weight
from robustid.identification import MixedProblem

if TYPE_CHECKING:
    import control

_DRIVERS = 6  # ranges in a summary


class Driver(NamedTuple):
    """Range of frequencies, rad/s, over which one member has the largest bound; `second` is the largest of the others there."""

    low: float
    high: float
    member: str
    upper: float
    second: float


@dataclasses.dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Family(WorstCase):
    """Band around one nominal model that holds every system consistent with the data of any member.

    The guarantee is about these members: of a plant under another condition, between two of them say, nothing is proved.

    Attributes
    ----------
    members : tuple of Member
        Each with its bounded values.
    model : control.StateSpace
        The nominal.
    tried : tuple of (int, float)
        Orders of nominal models and the largest ratio of their band to the radius of the smallest disc that holds all members.
    schedule : str or None
        The condition that is told apart, "amplitude" for instance.
    interval : (float, float) or None
        Range of it that the family is asked about.
    unfinished : Unfinished or None
        What the run that found it has left out.
    """

    members: tuple[Member, ...]
    omega: Real = dataclasses.field(init=False)
    kept: tuple[Cell, ...] = dataclasses.field(init=False)
    tried: tuple[tuple[int, float], ...] = ()
    schedule: str | None = None
    interval: tuple[float, float] | None = None
    unfinished: Unfinished | None = None

    def __post_init__(self) -> None:
        results: list[Bounded] = [m.result for m in self.members]
        self._set(omega=results[0].omega, kept=tuple(itertools.chain.from_iterable(one.kept for one in results)))

    @property
    def problem(self) -> MixedProblem:
        """Statement of the first member: signals and class are those of all."""
        return self.members[0].identification.problem

    @functools.cached_property
    def errors(self) -> tuple[Bounded, ...]:
        """The bounds of every member around the nominal."""
        return tuple(m.result.with_model(self.model) for m in self.members)

    def ended_early(self, unfinished: Unfinished) -> Self:
        """Return the family with what its run has left out."""
        found = dataclasses.replace(self, unfinished=unfinished)
        object.__setattr__(found, "errors", self.errors)  # with the circle, where it has been bounded
        return found

    @property
    def proofs(self) -> tuple[Bounded, ...]:
        """Bounded values of every member: their proofs together are that of the family."""
        return tuple(m.result for m in self.members)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the members."""
        return tuple(m.name for m in self.members)

    @property
    def dt(self) -> float:
        """Sample time, s; 0 in continuous time."""
        return self.plane.dt

    @property
    def plane(self) -> Plane:
        """The plane of all members."""
        return self.problem.plane

    @functools.cached_property
    def uppers(self) -> Real:
        """Guaranteed bound of |F - nominal| over all consistent systems of every member, (R, F, ny, nu)."""
        return freeze(np.stack([e.upper for e in self.errors]))

    @functools.cached_property
    def sigma_uppers(self) -> Real:
        """Guaranteed bound of the largest singular value of F - nominal, of every member, (R, F)."""
        return freeze(np.stack([e.sigma_upper for e in self.errors]))

    @property
    def sigma_upper(self) -> Real:
        """The largest of them, (F,)."""
        return freeze(self.sigma_uppers.max(axis=0))

    @property
    def lower(self) -> Real:
        """Error of consistent systems of any member that were found, (F, ny, nu): no bound can be smaller."""
        return freeze(np.max([e.lower for e in self.errors], axis=0))

    @property
    def sigma_lower(self) -> Real:
        """Largest singular value of F - nominal of systems that were found, (F,)."""
        return freeze(np.max([e.sigma_lower for e in self.errors], axis=0))

    @functools.cached_property
    def centres(self) -> Centres:
        """Smallest disc that holds the values of all members, at every frequency and entry: no nominal has a smaller band."""
        return centres_of([m.result for m in self.members])

    def claims(self) -> Iterator[Claim]:
        """Every inequality that is stated of a member, with its certificate."""
        for name, error in zip(self.names, self.errors, strict=True):
            yield from (dataclasses.replace(claim, name=f"{name}: {claim.name}") for claim in error.claims())

    @property
    def claim_count(self) -> int:
        """Number of `claims`."""
        return sum(error.claim_count for error in self.errors)

    @property
    def supported(self) -> bool:
        """Return whether those of every member are."""
        return all(error.supported for error in self.errors)

    def not_relaxed_enough(self) -> list[str]:
        """Cells of members whose relaxed problem can't be shown to cover all their poles; see there."""
        each = zip(self.names, self.errors, strict=True)
        return [f"{name}: {cell}" for name, error in each for cell in error.not_relaxed_enough()]

    def with_model(self, model: control.StateSpace) -> Self:
        """Return the same family around another nominal; nothing is solved anew."""
        return dataclasses.replace(super().with_model(model), tried=())

    def _refined(self, rtol: float, everywhere: bool, means: Means) -> CircleBound:
        for number, error in enumerate(self.errors):
            mine = means.part(f"member-{number + 1}", 1 / (len(self.members) - number), means.progress)
            error.on_circle(rtol, everywhere=everywhere, **mine.options)
        return self.circle

    @property
    def known_circle(self) -> CircleBound | None:
        """The largest of the bounds that are known of all members, on every arc; None where one is missing."""
        known = [e.known_circle for e in self.errors if e.known_circle is not None]
        return union_of_circles(known) if len(known) == len(self.errors) else None

    @property
    def circle(self) -> CircleBound:
        """The largest of the bounds of the members on every arc."""
        return union_of_circles([e.circle for e in self.errors])

    def weight(
        self, *, kind: str = "additive", order: int | None = None, below: float | None = None
    ) -> UncertaintyWeight:
        r"""Stable minimum-phase W of the smallest order above the uncertainty of all members on the whole circle, certified.

        .. math::
            F = F_0 + W\Delta, \quad (I + W\Delta) F_0, \quad F_0 (I + W\Delta), \quad (I + W\Delta)^{-1} F_0, \qquad
            \bar\sigma(\Delta) \le 1

        for the kinds "additive", "multiplicative" (at the outputs), "input_multiplicative" and "inverse". Arguments as of any worst
        case; relative kinds from `cover`.
        """
        self._without_sums()
        found = uncertainty_weight(self.model, *from_zero(*self.cover(kind), kind, below), order=order)
        return dataclasses.replace(found, kind=kind)

    def drivers(self) -> list[Driver]:
        """Who drives the band where: ranges of frequencies with the member whose bound is largest there, from low to high."""
        sizes = self.sigma_uppers
        rows: list[Driver] = []
        largest = np.argmax(sizes, axis=0)
        ends = np.flatnonzero(np.diff(largest)) + 1
        for part in np.split(np.arange(self.omega.size), ends):
            member, others = int(largest[part[0]]), np.delete(sizes[:, part], largest[part[0]], axis=0)
            at = int(np.argmax(sizes[member, part]))
            numbers = float(sizes[member, part[at]]), float(others[:, at].max())
            rows.append(Driver(float(self.omega[part[0]]), float(self.omega[part[-1]]), self.names[member], *numbers))
        return rows

    @property
    def matched(self) -> tuple[str, ...]:
        """Sentences on members whose signals are called otherwise than those of the first, whose names hold."""
        found: list[str] = []
        for m in self.members[1:]:
            for side in ("inputs", "outputs"):
                own, first = (getattr(one, side) for one in (m.identification.problem, self.problem))
                if pairs := called_otherwise(own, first):
                    found.append(otherwise_words(m.name, side, pairs))
        return tuple(found)

    @property
    def not_known(self) -> tuple[str, ...]:
        """Sentences on what is not known between the members, and beyond them."""
        if self.schedule is None or self.interval is None:
            return ("Nothing is proved of the plant under other conditions than those of the members.",)
        name, ((low, high), values) = self.schedule, (self.interval, sorted(self.values))
        gaps = [f"between {name} {a:g} and {b:g}" for a, b in itertools.pairwise(values) if max(a, low) < min(b, high)]
        ends = [f"below {name} {values[0]:g}"] * (low < values[0]) + [f"above {name} {values[-1]:g}"] * (
            high > values[-1]
        )
        gap = max(b - a for a, b in itertools.pairwise([min(low, values[0]), *values, max(high, values[-1])]))
        return (
            f"Measured at {name} {', '.join(f'{v:g}' for v in values)}; asked about {low:g} to {high:g}.",
            f"Nothing is proved {', nor '.join([*gaps, *ends])}: the response there may leave the bands of all"
            " members.",
            f"The widest gap is {gap:g}: a member in it tests what the band says there.",
        )

    @property
    def values(self) -> tuple[float, ...]:
        """The condition `schedule` of every member; empty where there is none."""
        return () if self.schedule is None else tuple(float(getattr(m, self.schedule)) for m in self.members)

    def __repr__(self) -> str:
        return (
            f"<Family: {counted(len(self.members), 'member')}, {counted(self.omega.size, 'frequency')}, largest"
            f" {self.sigma_upper.max():.4g},"
            f" nominal of order {self.model.nstates}>"
        )

    @property
    def scope(self) -> str:
        """Words that follow a claim about the family, ", for these excitations, from data with faults"; empty if none is due."""
        problems = [m.identification.problem for m in self.members]
        alone, faulty = any(one.of_one_excitation for one in problems), any(one.open_faults for one in problems)
        return ", for these excitations" * alone + ", from data with faults" * faulty

    def summary(self) -> str:
        """The result in plain text."""
        lines = [
            f"guarantee  every system consistent with the data of any of {len(self.members)} members is within"
            f" {self.sigma_upper.max():.4g} of the nominal at {counted(self.omega.size, 'frequency')}{self.scope}"
            f" (median {self.relative.words})",
            f"nominal    order {self.model.nstates}; its band is at most {(self.upper / self.centres.radius).max():.3g} times the"
            " smallest disc that holds all members",
        ]
        for m, error in zip(self.members, self.errors, strict=True):
            said = ", ".join(f"{what} {value}" for what, value in m.condition.items() if f"{what} {value}" != m.name)
            own = f" ({said})" if said else ""
            lines.append(
                f"member     {m.name}{own}: within {rounded_up(error.upper.max()):.4g}, margin {m.identification.margin:.4g}"
            )
        rows = self.drivers()
        for row in sorted(rows, key=lambda row: -row.upper)[:_DRIVERS]:
            lines.append(
                f"driven by  {row.member} from {hz_span(row.low / (2 * np.pi), row.high / (2 * np.pi))}: {row.upper:.4g}"
                f" (the others {row.second:.4g})"
            )
        if len(rows) > _DRIVERS:
            lines.append(f"           and {len(rows) - _DRIVERS} more ranges, where the band is smaller")
        lines += [f"matched    {sentence}" for sentence in self.matched]
        lines += [f"not known  {sentence}" for sentence in self.not_known]
        lines.append(
            "assumed    one class for all members, its poles, and the bounds of the samples: data can refute them, never prove them"
        )
        return "\n".join(lines)

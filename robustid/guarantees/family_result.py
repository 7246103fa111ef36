"""Family: plants that differ by amplitude, position, load or date; one nominal, and a band that holds every one of them."""

from __future__ import annotations

import dataclasses
import functools
import itertools
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from robustid.core import Complex, Frozen, Plane, Real, Savable, freeze
from robustid.figures import Drawable
from robustid.guarantees.circle import CircleBound, union_of_circles
from robustid.guarantees.common_nominal import Centres, centres_of
from robustid.guarantees.covers import cover_bound
from robustid.guarantees.member import Bounded, Member
from robustid.guarantees.nominal import as_nominal
from robustid.guarantees.stability_margin import RobustStabilityMargin, margin_of_circle
from robustid.guarantees.sweep import Processes, Progress
from robustid.guarantees.value_set import norm_of_bounds
from robustid.guarantees.weight import UncertaintyWeight, uncertainty_weight
from robustid.guarantees.worst_case_result import WorstCaseError

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
class Family(Frozen, Drawable, Savable):
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
    """

    members: tuple[Member, ...]
    model: control.StateSpace
    tried: tuple[tuple[int, float], ...] = ()
    schedule: str | None = None
    interval: tuple[float, float] | None = None

    @functools.cached_property
    def errors(self) -> tuple[Bounded, ...]:
        """The bounds of every member around the nominal."""
        return tuple(m.result.with_model(self.model) for m in self.members)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the members."""
        return tuple(m.name for m in self.members)

    @property
    def omega(self) -> Real:
        """Frequencies, rad/s, (F,)."""
        return self.members[0].result.omega

    @property
    def dt(self) -> float:
        """Sample time, s; 0 in continuous time."""
        return self.plane.dt

    @property
    def plane(self) -> Plane:
        """The plane of the first member."""
        return self.members[0].identification.problem.plane

    @functools.cached_property
    def nominal(self) -> Complex:
        """Response of the nominal, (F,) complex; MIMO: (F, ny, nu)."""
        found = self.plane.values_at(self.model, self.omega)
        return freeze(self.members[0].identification.problem.entries.as_given(found))

    @functools.cached_property
    def uppers(self) -> Real:
        """Guaranteed bound of |F - nominal| over all consistent systems of every member, (R, F, ny, nu)."""
        return freeze(np.stack([e.upper for e in self.errors]))

    @property
    def upper(self) -> Real:
        """The largest of them: the band of the family, (F, ny, nu)."""
        return freeze(self.uppers.max(axis=0))

    @functools.cached_property
    def sigma_uppers(self) -> Real:
        """Guaranteed bound of the largest singular value of F - nominal, of every member, (R, F)."""
        found = [e.sigma_upper if isinstance(e, WorstCaseError) else norm_of_bounds(e.upper) for e in self.errors]
        return freeze(np.stack(found))

    @property
    def sigma_upper(self) -> Real:
        """The largest of them, (F,)."""
        return freeze(self.sigma_uppers.max(axis=0))

    @functools.cached_property
    def centres(self) -> Centres:
        """Smallest disc that holds the values of all members, at every frequency and entry: no nominal has a smaller band."""
        return centres_of([m.result for m in self.members])

    @property
    def certified(self) -> bool:
        """Return whether every bound of every member has its certificate and every certificate, evaluated anew, supports it."""
        return all(error.verify() for error in self.errors)

    def with_model(self, model: control.StateSpace) -> Family:
        """Return the same family around another nominal; nothing is solved anew."""
        found = as_nominal(model, self.members[0].identification)
        return dataclasses.replace(self, model=found, tried=())

    def on_circle(
        self,
        rtol: float = 0.05,
        *,
        everywhere: bool = False,
        executor: Processes = None,
        progress: Progress | None = None,
    ) -> CircleBound:
        """Rigorous bound of |F - nominal| on the whole circle over all members; MIMO: of its singular values.

        On every arc the largest of the bounds of the members, each refined by itself; see `WorstCaseError.on_circle`.

        Members with a pole-uncertainty box are bounded on the circle over every cell that may contain their poles, as of
        `WorstCaseOverPoles.on_circle`.
        """
        for error in self.errors:
            error.on_circle(rtol, everywhere=everywhere, executor=executor, progress=progress)
        return self.circle

    @property
    def circle(self) -> CircleBound:
        """The bound on the whole circle, to 5 % where none was computed before; `on_circle` first for members with a box."""
        return union_of_circles([e.circle for e in self.errors])

    @property
    def hinf(self) -> float:
        """Guaranteed bound of the H-infinity norm of F - nominal over all members."""
        return self.circle.largest

    def cover(self, kind: str = "additive") -> tuple[Real, Real]:
        """Edges (C + 1,) in rad/s, and the bound (C,) of the uncertainty of a kind on every arc between them, over all members."""
        circle = self.circle
        return circle.edges, cover_bound(self.model, circle.edges, circle.bound, circle.entries, kind)

    def weight(self, *, kind: str = "additive", order: int | None = None) -> UncertaintyWeight:
        r"""Stable minimum-phase W of the smallest order above the uncertainty of all members on the whole circle, certified.

        .. math::
            F = F_0 + W\Delta, \quad (I + W\Delta) F_0, \quad F_0 (I + W\Delta), \quad (I + W\Delta)^{-1} F_0, \qquad
            \bar\sigma(\Delta) \le 1

        for the kinds "additive", "multiplicative" (at the outputs), "input_multiplicative" and "inverse".

        Parameters
        ----------
        kind : str
        order : int, optional
            At most; see `uncertainty_weight`.

        Returns
        -------
        UncertaintyWeight
            With `to_control` for synthesis.
        """
        self.on_circle(0.3, everywhere=True)
        edges, bound = self.cover(kind)
        found = uncertainty_weight(self.model, edges, bound, order=order)
        return dataclasses.replace(found, kind=kind)

    def robust_stability_margin(
        self, controller: control.StateSpace, *, kind: str = "additive"
    ) -> RobustStabilityMargin:
        """`robust_stability_margin` of a controller against every system of every member, as of a `WorstCaseError`."""
        circle = self.circle
        return margin_of_circle(self.model, controller, (circle.edges, circle.bound, circle.entries), kind)

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
            f"Nothing is proved {', nor '.join([*gaps, *ends])}: a resonance that moves passes frequencies there that the"
            " band of no member holds.",
            f"The widest gap is {gap:g}: a member in it tests what the band says there.",
        )

    @property
    def values(self) -> tuple[float, ...]:
        """The condition `schedule` of every member; empty where there is none."""
        return () if self.schedule is None else tuple(float(getattr(m, self.schedule)) for m in self.members)

    def __repr__(self) -> str:
        return (
            f"<Family: {len(self.members)} members, {self.omega.size} frequencies, largest {self.sigma_upper.max():.4g},"
            f" nominal of order {self.model.nstates}>"
        )

    def summary(self) -> str:
        """The result in plain text."""
        size = np.linalg.norm(self.plane.values_at(self.model, self.omega), 2, axis=(1, 2))
        relative = np.median(self.sigma_upper / np.maximum(size, np.finfo(float).tiny))
        lines = [
            f"guarantee  every system consistent with the data of any of {len(self.members)} members is within"
            f" {self.sigma_upper.max():.4g} of the nominal at {self.omega.size} frequencies (median {100 * relative:.3g} % of the"
            " response)",
            f"nominal    order {self.model.nstates}; its band is at most {(self.upper / self.centres.radius).max():.3g} times the"
            " smallest disc that holds all members",
        ]
        for m, error in zip(self.members, self.errors, strict=True):
            said = ", ".join(f"{what} {value}" for what, value in m.condition.items() if f"{what} {value}" != m.name)
            own = f" ({said})" if said else ""
            lines.append(
                f"member     {m.name}{own}: within {error.upper.max():.4g}, margin {m.identification.margin:.4g}"
            )
        rows = self.drivers()
        for row in sorted(rows, key=lambda row: -row.upper)[:_DRIVERS]:
            lines.append(
                f"driven by  {row.member} from {row.low / (2 * np.pi):.5g} to {row.high / (2 * np.pi):.5g} Hz: {row.upper:.4g}"
                f" (the others {row.second:.4g})"
            )
        if len(rows) > _DRIVERS:
            lines.append(f"           and {len(rows) - _DRIVERS} more ranges, where the band is smaller")
        lines += [f"not known  {sentence}" for sentence in self.not_known]
        lines.append(
            "assumed    one class for all members, its poles, and the bounds of the samples: data can refute them, never prove them"
        )
        return "\n".join(lines)

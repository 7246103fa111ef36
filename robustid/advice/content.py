"""Statements of a class between the frequency points, and the signs of one that says nothing."""

from __future__ import annotations

import dataclasses

import numpy as np

from robustid.core import Frozen, Real, as_kind, freeze, hz_words, one_thread
from robustid.guarantees import consistent_set
from robustid.identification import Identification

_PAIRS = 6  # neighbouring frequency points between which it is looked
_COMPARABLE, _EMPTY = 3.0, 10.0  # times as wide between the points as on them
_GENEROUS = 1e-3  # a margin below which the bounds could be anything
_APART = 1.0  # least distance of the decay rate from 1, in distances of the frequency points in rad


@dataclasses.dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Content(Frozen):
    """Widths of a consistent set between frequency points beside those on them, and what else tells an empty class.

    Attributes
    ----------
    omega : (P,) array, rad/s
        Middles between neighbouring frequency points.
    on, between : (P,) arrays
        Half-width of the set relative to the response, the larger one of the two points and that in the middle (the largest of the
        entries). They are those of an ellipsoid inside the set: to be compared with each other, not a guarantee.
    separation : float
        Distance of the decay rate from 1 over the median distance of the frequency points in rad; nan with less than two.
    margin : float
    order, data : int
        Order of the identified model, and number of real data.
    """

    omega: Real
    on: Real
    between: Real
    separation: float
    margin: float
    order: int
    data: int

    def __post_init__(self) -> None:
        self._set(**{name: freeze(getattr(self, name)) for name in ("omega", "on", "between")})

    @property
    def ratio(self) -> float:
        """Median of `between` over `on`; 1 where there is nothing between."""
        return float(np.median(self.between / self.on)) if self.on.size else 1.0

    @property
    def empty(self) -> bool:
        """True if the band between the points is more than ten times as wide as on them: the class says nothing there."""
        return self.ratio > _EMPTY

    @property
    def signs(self) -> tuple[str, ...]:
        """Signs of a class without content, in words; none for one that says as much between the points as on them."""
        if self.ratio <= _COMPARABLE:
            return ()
        found = [
            f"the band is about {self.ratio:.3g} times as wide between the frequency points as on them (relative to the"
            f" response, widest near {hz_words(self.omega[int(np.argmax(self.between / self.on))] / (2 * np.pi))})"
        ]
        if self.separation < _APART:
            found.append(
                f"the decay rate is only {self.separation:.2g} distances of the frequency points (in rad) above 1, so that the"
                " non-parametric part can do anything between them"
            )
        if self.margin < _GENEROUS:
            found.append(f"the margin is {self.margin:.2g}: bounds of a thousandth would have been kept as well")
        if self.order > self.data / 3:
            found.append(f"the identified model has order {self.order} for {self.data} real data")
        return tuple(found)

    def __repr__(self) -> str:
        return f"<Content: {self.ratio:.3g} times as wide between the frequency points as on them>"

    def summary(self) -> str:
        """In words."""
        if not self.on.size:
            return "There are no neighbouring frequency points to look between."
        if not self.signs:
            return (
                f"Between the frequency points the band is about as wide as on them ({self.ratio:.2g} times, relative to the"
                " response)."
            )
        head = "The class says nothing between the frequency points" if self.empty else "The class says little there"
        return f"{head}: {'; '.join(self.signs)}. Raise the decay rate and put what then contradicts it into the modes."


@one_thread()
def content(identification: Identification) -> Content:
    """Compare the band between the frequency points with that at them, where the verdict of the class has content or none.

    Every data set is consistent with a class that lets the non-parametric part do anything between the points. Then the band is far
    wider between them than on them. Withheld points say less: they lie in the band of the others whenever all are consistent.

    Parameters
    ----------
    identification : Identification
        Consistent.

    Returns
    -------
    Content

    Raises
    ------
    InconsistentDataError
        Nothing is consistent.
    InputTypeError
        Something that isn't an Identification.

    Notes
    -----
    The widths are those of the ellipsoid of the barrier at the analytic centre, one Newton matrix for all of them: seconds where
    guaranteed widths (`worst_case_error`) take minutes.

    Examples
    --------
    >>> import robustid as rid
    >>> from robustid.advice import content
    >>> data = rid.datasets.flexible_structure(lines=12)
    >>> basis = rid.kautz(data.modes[:, 0], data.modes[:, 1], dt=0.01, delay=1)
    >>> def says(**prior):
    ...     problem = rid.MixedProblem(frequency=data.frequency, parametric=basis, prior=rid.Prior(**prior))
    ...     return content(rid.identify(problem))
    >>> says(gain_bound=0.1, decay_rate=1.2).empty, says(gain_bound=10.0, decay_rate=1.005).empty
    (False, True)
    """
    as_kind("identification", identification, Identification, "an Identification")
    problem, found = identification.problem, consistent_set(identification)
    points = np.unique(np.concatenate([np.zeros(0), *(f.omega for f in problem.frequency)]))
    gaps = np.diff(points)
    # Where the points lie apart from each other the width between them says nothing about those that are near.
    near = np.flatnonzero(gaps <= 2 * np.median(gaps)) if gaps.size else np.zeros(0, int)
    chosen = near[np.unique(np.linspace(0, near.size - 1, min(_PAIRS, near.size)).round().astype(int))]
    low, high = points[chosen], points[chosen + 1] if chosen.size else points[chosen]
    middle = (low + high) / 2
    on, between = np.zeros(0), np.zeros(0)
    if chosen.size:
        sizes = _relative(identification, found.spreads(np.concatenate([low, high, middle])), low, high, middle)
        on, between = np.maximum(sizes[0], sizes[1]), sizes[2]
    real = 2 * sum(int(f.bound.used.sum()) for f in problem.frequency)
    real += sum(int(record.bound.used.sum()) for record in problem.time)
    decay = problem.prior.rate - 1 if problem.dt else problem.prior.rate
    separation = decay / float(np.median(gaps) * (problem.dt or 1.0)) if gaps.size else np.nan
    return Content(
        omega=middle,
        on=on,
        between=between,
        separation=separation,
        margin=identification.margin,
        order=identification.order,
        data=real,
    )


def _relative(identification: Identification, widths: Real, *omega: Real) -> Real:
    """Largest width of the entries relative to the norm of the response, (3, P)."""
    size = np.linalg.norm(
        identification.problem.plane.values_at(identification.model, np.concatenate(omega)), axis=(1, 2)
    )
    return (widths.max(axis=(1, 2)) / np.maximum(size, np.finfo(float).tiny)).reshape(3, -1)

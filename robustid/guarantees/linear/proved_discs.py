"""Discs that sums prove around every consistent system: at any frequency and in time, with the amplitudes behind them."""

from __future__ import annotations

import dataclasses
import functools

import numpy as np
from numpy.typing import ArrayLike, NDArray

from robustid.core import Complex, Frozen, Real, as_array, as_count, freeze, hz_span, one_thread
from robustid.errors import InputError
from robustid.guarantees.linear.entry_band import EntryBand, EntryBands
from robustid.guarantees.linear.functions import Box
from robustid.guarantees.linear.in_time import response_discs, step_tails
from robustid.identification import MixedProblem

_MOST_SAMPLES = 512  # of a step response whose peak is bounded
_LITTLE = 0.01  # of the static gain: what a step response leaves when its samples end


@dataclasses.dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class ProvedDiscs(Frozen):
    """Discs of every entry, row by row, of symmetric matrices of the upper triangle; over a box of the poles where there is one."""

    problem: MixedProblem
    bands: tuple[EntryBand, ...]
    box: Box | None = None

    def __post_init__(self) -> None:
        if self.box is not None:
            self._set(box=(freeze(self.box[0]), freeze(self.box[1])))

    @functools.cached_property
    def _entries(self) -> EntryBands:
        return EntryBands(self.problem, self.bands)

    def at(self, omega: ArrayLike) -> tuple[Complex, Real]:
        """Centres and radii of the discs at any frequencies, (F, ny, nu) each.

        Parameters
        ----------
        omega : (F,) array, rad/s
            Between 0 (the first frequency point, where the plant has an integrator) and pi/dt; in continuous time up to the last
            knot, at `last`.

        Raises
        ------
        InputError
            Frequencies outside of that range.
        """
        with one_thread():
            return self._entries.at(self._angles(np.atleast_1d(as_array("omega", omega))))

    def _angles(self, omega: Real) -> Real:
        """Angles of frequencies inside of the range of the band; others are refused."""
        angles, first = self.problem.plane.angles(omega), self.bands[0].angles
        slack = 1e-12 * max(float(first[-1]), 1.0)
        if angles.size and (angles.min() < first[0] - slack or angles.max() > first[-1] + slack):
            low, high = self.problem.plane.omega(first[[0, -1]]).tolist()
            bad = omega[(angles < first[0] - slack) | (angles > first[-1] + slack)][0]
            raise InputError(f"`omega` must lie between {low:g} and {high:g} rad/s, where the band stands; got {bad:g}")
        return np.clip(angles, first[0], first[-1])

    @property
    def range(self) -> tuple[float, float]:
        """The frequencies between which `at` answers, rad/s."""
        low, high = self.problem.plane.omega(self.bands[0].angles[[0, -1]]).tolist()
        return low, high

    @functools.cached_property
    def open_ranges(self) -> tuple[tuple[float, float], ...]:
        """Ranges of frequencies, rad/s, in which nothing is said: the box of a mode there reaches undamped ones.

        Where a radius is infinite, and beside that as long as it exceeds the largest response.
        """
        omega = self.problem.plane.omega(np.array(self._entries.open_arcs()).reshape(-1, 2))
        return tuple((float(low), float(high)) for low, high in omega)

    def is_open(self, omega: Real) -> NDArray[np.bool_]:
        """Mask of the frequencies, rad/s, (F,), that lie in an open range."""
        return np.any([(low <= omega) & (omega <= high) for low, high in self.open_ranges], axis=0) | np.zeros(
            omega.size, bool
        )

    @property
    def open_words(self) -> str:
        """The open ranges in words, in Hz; empty where there are none."""
        hz = [hz_span(low / (2 * np.pi), high / (2 * np.pi)) for low, high in self.open_ranges]
        return " and ".join(hz)

    @property
    def amplitudes(self) -> tuple[tuple[Complex, Real], ...]:
        r"""Proved discs of the amplitudes of the parametric part: of every entry, as in `bands`, centres and radii, (g,) each.

        Without a box they are intervals of the real coefficients of the parametric functions, in their order. With one come the
        functions that the box does not hold, then for every mode c n(x)/(1 - a x) + conj., x the delay, the complex
        c (1 - \|a_1\|^2)/(1 - a_1* a), by rising frequency: a is the pole anywhere in the box, a_1 its middle
        (``bands[0].samples.functions.modes.middle``). Of modes whose boxes are close they are joint ones, the first the sum of
        theirs. Infinite where the data do not tell them apart.
        """
        return tuple((freeze(centre), freeze(radius)) for centre, radius in (one.amplitudes for one in self.bands))

    @property
    def static_gain(self) -> tuple[Real, Real]:
        """Centres and radii of the intervals that hold the static gain of every consistent system, (ny, nu) each.

        Raises
        ------
        InputError
            The plant has an integrator.
        """
        self._without_integrator()
        centre, radius = self.at([0.0])
        return freeze(centre[0].real), freeze(radius[0])

    def impulse_response(self, count: int) -> tuple[Real, Real]:
        """Centres and radii of the first samples of the response to a unit pulse at t = 0, (count, ny, nu) each.

        Every consistent system is within the radii; each is at most what the class and the amplitudes say, K rho^-t of the
        non-parametric part. From zero initial conditions.

        Raises
        ------
        InputError
            A count below 1, or continuous time.
        """
        return self._response(np.eye(1, as_count("count", count, least=1))[0])

    def step_response(self, count: int) -> tuple[Real, Real]:
        """Centres and radii of the first samples of the response to a unit step, (count, ny, nu) each; as `impulse_response`."""
        return self._response(np.ones(as_count("count", count, least=1)))

    def _response(self, u: Real) -> tuple[Real, Real]:
        self._sampled()
        with one_thread():
            centres, radii = zip(*(response_discs(one.extraction, u) for one in self.bands), strict=True)
        return freeze(self._entries.matrices(centres)), freeze(self._entries.matrices(radii))

    def peak_step(self, count: int | None = None) -> Real:
        """Proved bound of the largest |step response| of every consistent system over all t >= 0, (ny, nu).

        The first `count` samples are bounded one by one; from there on, |static gain| and what class and modes still leave.
        Default: as many samples as leave little, 512 at most.

        Raises
        ------
        InputError
            A count below 1, continuous time, or a plant with an integrator, whose step response has no bound.
        """
        self._sampled()
        self._without_integrator()
        most = _MOST_SAMPLES if count is None else as_count("count", count, least=1)
        static, off = self.static_gain
        end = np.abs(static) + off
        with one_thread():
            later = end + self._entries.matrices([step_tails(one.extraction, most) for one in self.bands])
        if count is None:
            little = np.all(later <= (1 + _LITTLE) * end, axis=(1, 2))
            most = max(int(np.argmax(little)), 1) if little.any() else most
        centre, radius = self.step_response(most)
        first = np.minimum(np.abs(centre) + radius, later[:most])
        return freeze(np.maximum(first.max(axis=0), later[most]))

    def _sampled(self) -> None:
        if not self.problem.dt:
            raise InputError(
                "`problem` is of continuous time, whose responses have no samples: take at(...), or static_gain"
            )

    def _without_integrator(self) -> None:
        basis = self.problem.parametric
        if basis is not None and basis.has_integrator:
            raise InputError("`problem` has an integrator, so that nothing bounds its static gain: take at(...)")

"""Pole-uncertainty boxes: cells of them, each with a convex relaxation that covers all poles inside."""

from __future__ import annotations

import dataclasses
import functools
import itertools
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from robustid.bases import ParametricBasis, kautz, stack_bases
from robustid.core import Array, Arrays, Complex, Frozen, Real, freeze
from robustid.data import TimeRecord
from robustid.errors import InputError
from robustid.guarantees.amplitude_bounds import Extractions, extractions_of, extractions_over, largest_amplitudes
from robustid.guarantees.stated_box import checked_box
from robustid.guarantees.widening import Points, bounds_at, widened_points, widened_record
from robustid.identification import Identification, MixedProblem

REPEAT = 3  # multiplicity of the pole at the middle of a cell: what it leaves of another pole is of third order
_ROUNDING = (
    1e-14  # error of a pole, a distance of it or its logarithm: a few operations on numbers below 4; of s, relative
)
_WIDER = 1 + 1e-9  # the same for products
_AGAIN = 1 + 1e-9  # what bounds may differ by, relatively, when they are computed again elsewhere
_ENDLESS = 1e200  # stands for a remainder that does not converge


@dataclasses.dataclass(frozen=True, eq=False)
class PoleCell(Frozen):
    """A pole-uncertainty box, or a part of one, of natural frequencies w_i and damping ratios d_i, one of each per mode.

    The poles are a_i = exp(s_i T), s_i = (-d_i + j sqrt(1 - d_i^2)) w_i; in continuous time a_i = s_i.

    A mode c/(1 - a z^-1) with |a - a0| <= r expands about the middle a0 into multiples of z^-k/(1 - a0 z^-1)^(k+1), whose
    coefficients c (a - a0)^k are bounded by C r^k, and a remainder of modulus at most C r^m / (d^m (d - r)), d = |1 - a0 z^-1|,
    after m terms; c/(s - a) into multiples of 1/(s - a0)^(k+1), with d = |s - a0|. So the systems with poles in the cell are among
    those with m-fold poles at its middle, coefficients in intervals, and samples whose bounds are wider by what the remainder does
    to them. MIMO: every entry has its own c and C, all have the poles in common.
    """

    omega: Real  # omega, damping: (M, 2); ends, rad/s and 1
    damping: Real
    amplitude: Real  # (M,); MIMO: (M, ny, nu); C, the largest |c| of every mode
    delay: int
    dt: float  # s; 0 in continuous time
    # sums over the samples that prove the amplitudes, of every independent entry; empty: they are stated
    proofs: Extractions = ()

    def __post_init__(self) -> None:
        self._set(**{name: freeze(getattr(self, name)) for name in ("omega", "damping", "amplitude")})

    @functools.cached_property
    def centre(self) -> tuple[Real, Real]:
        """Natural frequencies and damping ratios of the a0, (M,) each."""
        return self.omega.mean(axis=1), self.damping.mean(axis=1)

    @functools.cached_property
    def middle(self) -> Complex:
        """The a0, (M,) complex."""
        return _pole(*self.centre, self.dt)

    @functools.cached_property
    def radius(self) -> Real:
        """Bound r of |a - a0|, (M,): at most the largest |a| times |log a - log a0|, whose parts lie in products of intervals.

        In continuous time those of a and a0 themselves do.
        """
        steps = (self.dt or 1.0) * self.omega
        decay, turn = _products(steps, self.damping), _products(steps, np.sqrt(1 - self.damping**2))
        middle = np.asarray(np.log(self.middle)) if self.dt else self.middle
        away = [
            np.maximum(high - value, value - low)
            for (low, high), value in ((decay, -np.real(middle)), (turn, np.imag(middle)))
        ]
        largest = np.exp(-decay[0]) if self.dt else 1.0
        return largest * np.hypot(*away) * _WIDER + self._rounding

    @property
    def _rounding(self) -> Real:
        """Error of a distance from each of the poles, (M,)."""
        return _ROUNDING * (np.ones(self.middle.size) if self.dt else np.abs(self.middle))

    def basis(self) -> ParametricBasis:
        """Repeated pairs at the middle."""
        return stack_bases(self._pairs)

    @functools.cached_property
    def _pairs(self) -> list[ParametricBasis]:
        """The powers at the middle of every mode."""
        every = zip(*self.centre, strict=True)
        return [kautz(w, d, dt=self.dt, repeat=REPEAT, delay=self.delay) for w, d in every]

    def intervals(self) -> Real:
        """Intervals of the coefficients of `basis`, (2 M repeat, 2); MIMO: (2 M repeat, ny, nu, 2)."""
        ends: list[Real] = []
        for number, one in enumerate(self._pairs):
            # binom(k, j) a^k has the transform a^j z^-j/(1 - a z^-1)^(j+1); c a^k + its conjugate = 2 Re c Re a^k - ...
            # In continuous time (w t)^j/j! exp(a t) has w^j/(s - a)^(j+1), w = |a|.
            scale = abs(self.middle[number])
            shrink = float(self.radius[number] / scale) ** (np.arange(len(one.C)) // 2)
            ends.append(2 * self.amplitude[number] * self._each(shrink) * self._each(_norms_of(one)))
        half = np.concatenate(ends) * _WIDER
        return np.stack([-half, half], axis=-1)

    def remainder(self, omega: Real) -> Real:
        """Bound of what the expansion leaves out at frequencies, (F, M); inf where it does not converge. MIMO: (F, M, ny, nu)."""
        total = np.zeros((np.size(omega), *self.amplitude.shape))
        for pole in (self.middle, self.middle.conj()):
            total += self._left_out(self._distance(pole, np.asarray(omega, dtype=float)))
        return total * _WIDER

    def _distance(self, pole: Complex, omega: Real) -> Real:
        """Distance d of frequencies (F,) or (F, M) from poles (M,), (F, M)."""
        omega = omega.reshape(len(omega), -1)
        if self.dt:
            return np.abs(1 - pole * np.exp(-1j * (omega * self.dt)))
        return np.hypot(pole.real, omega - pole.imag)

    def _left_out(self, distance: Real) -> Real:
        """Part that the expansion about poles at these distances (F, M) leaves out, (F, M); MIMO: (F, M, ny, nu)."""
        distance = distance - self._rounding
        room = distance - self.radius
        with np.errstate(divide="ignore", invalid="ignore"):
            terms = self.amplitude * self._each((self.radius / distance) ** REPEAT) / self._each(room)
            return np.where(self._each(room) > 0, terms, np.inf)

    def slack_on(self, low: Real, high: Real) -> Real:
        """Largest `slack` between frequencies, rad/s, (F, ny, nu); inf where the expansion does not converge.

        What is left out falls with the distance from the pole: it is largest at the frequency of the pole, or at an end.
        """
        total = np.zeros((low.size, *self.amplitude.shape))
        for pole in (self.middle, self.middle.conj()):
            ends = [self._distance(pole, end) for end in (low, high)]
            nearest = np.where(ends[0] <= ends[1], low[:, None], high[:, None])
            turn = np.angle(pole) / self.dt if self.dt else pole.imag
            nearest = np.where((low[:, None] <= turn) & (turn <= high[:, None]), turn, nearest)
            total += self._left_out(self._distance(pole, nearest))
        return self._matrices((total * _WIDER).sum(axis=1))

    def slack(self, omega: Real) -> Real:
        """Remainder of the expansion of all modes in every entry at frequencies in rad/s, (F, ny, nu)."""
        return self._matrices(self.remainder(omega).sum(axis=1))

    def impulse_remainder(self, count: int) -> Real:
        """Bound of what the expansion leaves out of the impulse response, (count, M); MIMO: (count, M, ny, nu).

        2 C r^m binom(k, m) x^(k-m), x the largest modulus of a pole.
        """
        import scipy.special

        k = np.arange(count)[:, None] - self.delay
        largest = np.abs(self.middle) + self.radius
        ways = scipy.special.comb(np.maximum(k, 0), REPEAT) * _WIDER
        size = 2 * self.amplitude * self._each(self.radius**REPEAT)
        return size * self._each(ways * largest ** np.maximum(k - REPEAT, 0))

    def _each(self, array: Array) -> Real:
        """An array whose last axis goes with the modes, with an axis more for each of the entries."""
        return array.reshape(*array.shape, *(1,) * (self.amplitude.ndim - 1))

    def _matrices(self, array: Real) -> Real:
        """(k, ny, nu) of numbers that SISO plants have without the last two axes."""
        return array.reshape(len(array), *(self.amplitude.shape[1:] or (1, 1)))

    def relaxed(self, problem: MixedProblem) -> MixedProblem | None:
        """A problem with fixed poles that every consistent system with poles in the cell solves; None if no data are left."""
        frequency: list[Points] = []
        for points in problem.frequency:
            wider = widened_points(points, self.slack(points.omega))
            frequency += [] if wider is None else [wider]
        time: list[TimeRecord] = []
        for record in problem.time:
            rest = self._matrices(self.impulse_remainder(record.u.shape[0]).sum(axis=1))
            time.append(widened_record(record, rest))
        if not frequency and not time:
            return None
        return MixedProblem(
            frequency=tuple(frequency) or None,
            time=tuple(time) or None,
            prior=problem.prior,
            parametric=self.basis(),
            parameter_bounds=self.intervals(),
            symmetric=problem.symmetric,
        )

    def cost(self, omega: Real, bounds: Real) -> float:
        """Largest remainder of the expansion at frequencies, in units of the bounds (F, ny, nu) of the samples there.

        At the samples it is the part by which any sum of theirs grows at most, since |d| (bound + remainder) does so term by term.
        """
        slack = self.slack(omega)
        return float(np.divide(slack, bounds, out=np.zeros(slack.shape), where=np.isfinite(bounds)).max())

    def widest(self, problem: MixedProblem, omega: Real) -> int:
        """Mode whose remainder is largest in units of the bounds, at frequencies and at the samples."""
        omega = np.concatenate([omega, *(f.omega for f in problem.frequency)])
        weight = np.minimum(self.remainder(omega), _ENDLESS).reshape(omega.size, len(self.middle), -1)
        bounds = bounds_at(problem, omega).reshape(omega.size, 1, -1)
        return int(np.argmax((weight / bounds).max(axis=(0, 2))))

    def split(self, problem: MixedProblem, mode: int, hyperbolic: bool = False) -> tuple[PoleCell, PoleCell] | None:
        """Two halves of the side of a mode that moves its pole more, each with its own amplitudes; None if these have no bound.

        `hyperbolic` in that metric, as matters near its frequency.
        """
        sides = [np.ptp(self.omega[mode]), np.ptp(self.damping[mode]) * self.omega[mode].mean()]
        middle = self.omega[mode].mean(), self.damping[mode].mean()
        if hyperbolic:
            low, high = self.damping[mode].tolist()
            middle = middle[0], np.sqrt(low * high)
            sides = [sides[0] / (middle[0] * middle[1]), np.log(high / low)]
        at = int(sides[1] > sides[0])
        name, cut = ("omega", "damping")[at], float(middle[at])
        halves: list[PoleCell] = []
        for end in (0, 1):
            ends = {"omega": np.array(self.omega), "damping": np.array(self.damping)}
            ends[name][mode, 1 - end] = cut
            box = ends["omega"], ends["damping"]
            try:
                halves.append(proved_cell(problem, *box, self.delay, before=self.proofs))
            except InputError:
                return None
        return halves[0], halves[1]

    def proved_again(self, problem: MixedProblem) -> PoleCell | None:
        """The cell of its ends and of the multipliers of its proofs: how samples see its poles is not taken over.

        None for multipliers of other entries or samples, and where they prove larger amplitudes than are stated, or none.
        """
        multipliers = [one.stored for one in self.proofs]
        try:
            again = loaded_cell(problem, self.omega, self.damping, self.delay, multipliers)
        except ValueError:
            return None
        return again if np.all(again.amplitude <= self.amplitude * _AGAIN) else None

    @property
    def ends(self) -> Real:
        """All sides, (2 M, 2): natural frequencies, then damping ratios."""
        return np.concatenate([self.omega, self.damping])

    def covered_by(self, cells: Sequence[PoleCell]) -> bool:
        """Return whether cells that lie inside leave out none of its poles, by their ends alone."""
        whole, parts = self.ends, [cell.ends for cell in cells]
        return all(lies_within(part, whole) for part in parts) and are_covered(whole, parts)


def box_of(identification: Identification, omega: ArrayLike | None, damping: ArrayLike | None, delay: int) -> PoleCell:
    """Pole-uncertainty box as one cell, with certified bounds of its amplitudes.

    InputError: as `checked_box`; the samples bound no amplitude of some mode by itself.
    """
    return proved_cell(identification.problem, *checked_box(identification, omega, damping, delay))


def proved_cell(
    problem: MixedProblem,
    omega: Real,
    damping: Real,
    delay: int,
    proofs: Extractions | None = None,
    before: Extractions = (),
) -> PoleCell:
    """Cell of modes in the order of the parametric part, with amplitudes that the samples prove; `proofs` as they are known.

    Those `before` are of a larger cell.
    InputError: the samples bound no amplitude of some mode by itself.
    """
    own = _about(problem, omega, damping, delay)
    proofs = extractions_over(own, omega, damping, before) if proofs is None else proofs
    largest = problem.entries.as_given(largest_amplitudes(own, omega, damping, proofs))
    return PoleCell(omega, damping, largest, delay, problem.dt, proofs)


def loaded_cell(
    problem: MixedProblem, omega: Real, damping: Real, delay: int, multipliers: Sequence[Arrays]
) -> PoleCell:
    """Cell whose amplitudes known multipliers prove. ValueError for those of other entries or samples."""
    own = _about(problem, omega, damping, delay)
    return proved_cell(problem, omega, damping, delay, extractions_of(own, omega, damping, multipliers))


def _about(problem: MixedProblem, omega: Real, damping: Real, delay: int) -> MixedProblem:
    """The statement with the pairs at the middle of a cell."""
    pairs = kautz(omega.mean(axis=1), damping.mean(axis=1), dt=problem.dt, delay=delay)
    return dataclasses.replace(problem, parametric=pairs, parameter_bounds=None)


def _norms_of(pair: ParametricBasis) -> Real:
    """H2 norms by which the functions of one repeated `kautz` pair are divided, (2 repeat,)."""
    at_once = bool(pair.dt) and bool(np.any(pair.D))
    plain = np.linalg.norm(pair.A[: pair.size], axis=1) if at_once else np.ones(pair.size)
    return plain / np.linalg.norm(pair.C, axis=1)


def _pole(omega: Real, damping: Real, dt: float) -> Complex:
    s = -damping + 1j * np.sqrt(1 - damping**2)
    return np.exp(s * omega * dt) if dt else s * omega


def _products(a: Real, b: Real) -> tuple[Real, Real]:
    """Smallest and largest product of positive intervals, (M,) each."""
    all_of = np.stack([a[:, i] * b[:, j] for i, j in itertools.product((0, 1), repeat=2)])
    return all_of.min(axis=0), all_of.max(axis=0)


def lies_within(inner: Real, outer: Real) -> bool:
    """Return whether a box lies within another one."""
    return inner.shape == outer.shape and bool(np.all((outer[:, 0] <= inner[:, 0]) & (inner[:, 1] <= outer[:, 1])))


def are_covered(whole: Real, parts: list[Real]) -> bool:
    """Return whether parts of a box cover it: it is cut where as few of them as possible lie on both sides, these are cut too."""
    if any(lies_within(whole, part) for part in parts):
        return True
    side, cut = _cut(whole.tolist(), [part.tolist() for part in parts])
    if side < 0:
        return False
    for end in (0, 1):
        half = whole.copy()
        half[side, 1 - end] = cut
        mine = [part.copy() for part in parts if (part[side, 0] < cut if end == 0 else part[side, 1] > cut)]
        for part in mine:
            part[side] = np.clip(part[side], *half[side])
        if not are_covered(half, mine):
            return False
    return True


def _cut(whole: list[list[float]], parts: list[list[list[float]]]) -> tuple[int, float]:
    """Side of a box and the end of a part where it is cut; side -1 where no part ends inside."""
    best, found = len(parts) + 1, (-1, 0.0)
    for side, (low, high) in enumerate(whole):
        ends = [part[side] for part in parts]
        for cut in {end for pair in ends for end in pair if low < end < high}:
            across = sum(a < cut < b for a, b in ends)
            if across < best:
                best, found = across, (side, cut)
            if not across:
                return found
    return found

"""Poles that are known up to a box: cells of it, each with a convex relaxation that covers all poles inside."""

from __future__ import annotations

import dataclasses
import functools
import itertools

import numpy as np

from robustid._arrays import Frozen, freeze
from robustid.bases import ParametricBasis, kautz
from robustid.data import FrequencyResponse
from robustid.interpolation import MixedProblem

_REPEAT = 3  # multiplicity of the pole at the middle of a cell: what it leaves of another pole is of third order
_DISTANT = 3.0  # lines whose bound would grow by more than this factor are left out: they say next to nothing


@dataclasses.dataclass(frozen=True, eq=False)
class PoleCell(Frozen):
    """A box of poles a_i = exp((-d_i + j sqrt(1 - d_i^2)) w_i T), one natural frequency and damping ratio per mode.

    A mode c/(1 - a z^-1) with |a - a0| <= r expands about the middle a0 into multiples of z^-k/(1 - a0 z^-1)^(k+1), whose
    coefficients c (a - a0)^k are bounded by C r^k, and a remainder of modulus at most C r^m / (d^m (d - r)), d = |1 - a0 z^-1|,
    after m terms. So the systems with poles in the cell are among those with m-fold poles at its middle, coefficients in intervals,
    and samples whose bounds are wider by what the remainder does to them.

    Attributes
    ----------
    omega, damping : (M, 2) arrays
        Ends, rad/s and 1.
    amplitude : (M,) array
        C, the largest |c| of every mode.
    delay : int, samples
    dt : float, s
    """

    omega: np.ndarray
    damping: np.ndarray
    amplitude: np.ndarray
    delay: int
    dt: float

    def __post_init__(self) -> None:
        self._set(**{name: freeze(getattr(self, name)) for name in ("omega", "damping", "amplitude")})

    @functools.cached_property
    def middle(self) -> np.ndarray:
        """The a0, (M,) complex."""
        return _pole(self.omega.mean(axis=1), self.damping.mean(axis=1), self.dt)

    @functools.cached_property
    def radius(self) -> np.ndarray:
        """Bound of |a - a0|, (M,): at most the largest |a| times |log a - log a0|, whose parts lie in products of intervals."""
        steps = self.dt * self.omega
        decay, turn = _products(steps, self.damping), _products(steps, np.sqrt(1 - self.damping**2))
        middle = np.asarray(np.log(self.middle))
        away = [
            np.maximum(high - value, value - low)
            for (low, high), value in ((decay, -np.real(middle)), (turn, np.imag(middle)))
        ]
        return np.exp(-decay[0]) * np.hypot(*away) * (1 + 1e-9)

    def basis(self) -> ParametricBasis:
        """Repeated pairs at the middle."""
        omega, damping = self.omega.mean(axis=1), self.damping.mean(axis=1)
        return kautz(omega, damping, dt=self.dt, repeat=_REPEAT, delay=self.delay)

    def intervals(self) -> np.ndarray:
        """Of the coefficients of `basis`, (2 M repeat, 2)."""
        ends = []
        for number, (w, d) in enumerate(zip(self.omega.mean(axis=1), self.damping.mean(axis=1), strict=True)):
            one = kautz(w, d, dt=self.dt, repeat=_REPEAT, delay=self.delay)
            rows = np.linalg.norm(one.C, axis=1)
            norms = (np.linalg.norm(one.A, axis=1) if self.delay == 0 else np.ones(rows.size)) / rows
            # binom(k, j) a^k has the transform a^j z^-j/(1 - a z^-1)^(j+1); c a^k + its conjugate = 2 Re c Re a^k - ...
            shrink = (self.radius[number] / abs(self.middle[number])) ** (np.arange(rows.size) // 2)
            ends.append(2 * self.amplitude[number] * shrink * norms)
        half = np.concatenate(ends)
        return np.stack([-half, half], axis=1)

    def remainder(self, angles: np.ndarray) -> np.ndarray:
        """What the expansion leaves out at exp(j angle), at most, (F, M); inf where it does not converge."""
        z = np.exp(-1j * np.asarray(angles))[:, None]
        total = np.zeros((z.size, self.middle.size))
        for pole in (self.middle, self.middle.conj()):
            distance = np.abs(1 - pole * z)
            room = distance - self.radius
            with np.errstate(divide="ignore", invalid="ignore"):
                total += np.where(room > 0, self.amplitude * (self.radius / distance) ** _REPEAT / room, np.inf)
        return total

    def impulse_remainder(self, count: int) -> np.ndarray:
        """The same for the impulse response: 2 C r^m binom(k, m) x^(k-m), x the largest modulus of a pole, (count, M)."""
        k = np.arange(count) - self.delay
        largest = np.abs(self.middle) + self.radius
        ways = np.where(k >= _REPEAT, k * (k - 1) * (k - 2) / 6, 0.0)[:, None]
        return 2 * self.amplitude * self.radius**_REPEAT * ways * largest ** np.maximum(k - _REPEAT, 0)[:, None]

    def relaxed(self, problem: MixedProblem) -> MixedProblem | None:
        """A problem with fixed poles that every consistent system with poles in the cell solves; None if no data are left."""
        frequency = []
        for frf in problem.frequency:
            extra = self.remainder(frf.omega * problem.dt).sum(axis=1) * (1 + line_tilt(frf))
            near = extra <= _DISTANT * frf.bound[:, 0, 0]
            if near.any():
                kept = frf.select(near)
                frequency.append(kept.with_bound(kept.bound + extra[near, None, None]))
        time = []
        for record in problem.time:
            h = self.impulse_remainder(record.u.shape[0]).sum(axis=1)
            extra = np.convolve(np.abs(record.u[:, 0]), h)[: h.size]
            time.append(record.with_bound(record.bound + extra[:, None]))
        if not frequency and not time:
            return None
        return MixedProblem(
            frequency=tuple(frequency) or None,
            time=tuple(time) or None,
            prior=problem.prior,
            parametric=self.basis(),
            parameter_bounds=self.intervals(),
        )

    def split(self, problem: MixedProblem, omega: np.ndarray) -> tuple[PoleCell, PoleCell]:
        """Two halves of the side of the mode that matters most."""
        angles = np.concatenate([omega * problem.dt, *(f.omega * problem.dt for f in problem.frequency)])
        weight = np.minimum(self.remainder(angles), 1e300).max(axis=0)
        mode = int(np.argmax(weight))
        sides = [
            np.ptp(self.omega[mode]),
            np.ptp(self.damping[mode]) * self.omega[mode].mean(),
        ]  # how far each moves the pole
        name = "omega" if sides[0] >= sides[1] else "damping"
        middle = float(getattr(self, name)[mode].mean())
        halves = []
        for end in (0, 1):
            ends = np.array(getattr(self, name))
            ends[mode, 1 - end] = middle
            halves.append(dataclasses.replace(self, **{name: ends}))
        return halves[0], halves[1]


def line_tilt(frf: FrequencyResponse) -> np.ndarray:
    """|kappa| of every line: an ellipse's rows are weighted by up to 1 + |kappa|."""
    return np.zeros(frf.omega.size) if frf.tilt is None else np.abs(frf.tilt[:, 0, 0])


def _pole(omega: np.ndarray, damping: np.ndarray, dt: float) -> np.ndarray:
    return np.exp((-damping + 1j * np.sqrt(1 - damping**2)) * omega * dt)


def _products(a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Smallest and largest product of positive intervals, (M,) each."""
    all_of = np.stack([a[:, i] * b[:, j] for i, j in itertools.product((0, 1), repeat=2)])
    return all_of.min(axis=0), all_of.max(axis=0)

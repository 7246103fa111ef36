r"""Relaxations of cells of poles, checked in ball arithmetic: every rounding error enclosed (extra `robustid[exact]`).

The numbers of a cell are computed in double precision, larger than the formulas by a part of 1e-9. Here the formulas are enclosed
again, for the ends of the cell as they are stored, and compared with these numbers less half of that part. The other half is for
what follows: sums, products and norms of non-negative numbers, whose rounding is at most some thousand units of 1e-16. Bounds that
the remainders are added to may be too small by one rounding, which the claims about relaxed problems allow for.

.. math:: |a - a_0| \le \max(|a|, |a_0|)\, |\log a - \log a_0|, \qquad
          \Big|\frac{c}{1 - a/z} - \sum_{j<m} c\,(a - a_0)^j \frac{z^{-j}}{(1 - a_0/z)^{j+1}}\Big|
          \le \frac{|c|\, r^m}{d^m (d - r)}, \quad d = |1 - a_0/z|

and the same for 1/(s - a), with d = |s - a_0|, in continuous time.
"""

from __future__ import annotations

import math
from types import ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np

from robustid.bases import kautz
from robustid.core import Real
from robustid.guarantees.pole_cells import REPEAT, PoleCell
from robustid.identification import MixedProblem, ball_arithmetic

if TYPE_CHECKING:
    from flint import arb

_HALF = 1 + 5e-10  # half of the allowance


def relaxed_enough(cell: PoleCell, problem: MixedProblem, omega: Real) -> bool:
    """Return whether radii, intervals and remainders of a cell are above what the formulas give, all rounding enclosed.

    The remainders are used at the samples of the problem and at `omega` (F,), rad/s, where the response is bounded.
    """
    omega = np.concatenate([omega, *(points.omega for points in problem.frequency)])
    samples = max((record.u.shape[0] for record in problem.time), default=0)
    with ball_arithmetic() as flint:
        modes = [_Mode(flint, cell, number) for number in range(cell.radius.size)]
        return (
            all(mode.radius_holds() for mode in modes)
            and all(mode.intervals_hold() for mode in modes)
            and _remainders_hold(modes, np.unique(omega), cell)
            and (not samples or all(mode.impulse_holds(samples) for mode in modes))
        )


class _Mode:
    """One mode of a cell: its middle pole as a ball, its radius and its largest amplitudes as they are stored."""

    def __init__(self, flint: ModuleType, cell: PoleCell, number: int) -> None:
        self.flint, self.cell, self.number = flint, cell, number
        self.radius = flint.arb(float(cell.radius[number]))
        self.amplitude: Real = cell.amplitude.reshape(cell.radius.size, -1)[number]
        self.ends = [[flint.arb(end) for end in side[number].tolist()] for side in (cell.omega, cell.damping)]
        self.means = [float(side[number]) for side in cell.centre]
        self.decay, self.turn = self._log(*map(flint.arb, self.means))
        exponent = flint.acb(-self.decay, self.turn)
        self.pole = exponent.exp() if cell.dt else exponent

    def _log(self, omega: arb, damping: arb) -> tuple[arb, arb]:
        """-Re and Im of the logarithm of a pole; in continuous time of the pole."""
        step = omega * self.flint.arb(self.cell.dt or 1.0)
        return step * damping, step * (1 - damping * damping).sqrt()

    def radius_holds(self) -> bool:
        """Return whether |a - a0| <= r on the whole cell: decay rises with both sides, the angle falls with the damping."""
        (w, v), (d, e) = self.ends
        slow, fast = self._log(w, d)[0], self._log(v, e)[0]
        least, most = self._log(w, e)[1], self._log(v, d)[1]
        ends = ((fast - self.decay).max(self.decay - slow), (most - self.turn).max(self.turn - least))
        away, aside = (end.abs_upper() for end in ends)  # numbers, since a ball around 0 has no square root
        largest = (-slow).exp() if self.cell.dt else 1
        return self._below(largest * (away * away + aside * aside).sqrt(), self.radius)

    def intervals_hold(self) -> bool:
        """Return whether twice the coefficients c (a - a0)^j / a0^j, of functions of unit norm, lie in their intervals."""
        arb, cell = self.flint.arb, self.cell
        one = kautz(*self.means, dt=cell.dt, repeat=REPEAT, delay=cell.delay)
        ends = cell.intervals()[..., 1].reshape(cell.radius.size, 2 * REPEAT, -1)[self.number]
        for k, (row, stored) in enumerate(zip(one.C, ends, strict=True)):
            first = _norm(arb, one.A[k]) if cell.dt and cell.delay == 0 else arb(1)
            size = 2 * (self.radius / abs(self.pole)) ** (k // 2) * first / _norm(arb, row)
            if not all(self._below(size * arb(c), arb(end)) for c, end in zip(self.amplitude, stored, strict=True)):
                return False
        return True

    def remainder(self, omega: float) -> arb | None:
        """Bound of what the expansion leaves out at a frequency of an amplitude of one; None where it may be without bound."""
        total, dt = self.flint.arb(0), self.cell.dt
        turned = self.flint.acb(0, -self.flint.arb(omega * dt)).exp()
        for pole in (self.pole, self.pole.conjugate()):
            distance = abs(1 - pole * turned) if dt else abs(self.flint.acb(0, omega) - pole)
            room = distance - self.radius
            if not room > 0:
                return None
            total += (self.radius / distance) ** REPEAT / room
        return total

    def impulse_holds(self, count: int) -> bool:
        """Return whether 2 C r^m binom(k, m) x^(k-m) is below the remainder of every sample, x the largest modulus of a pole."""
        arb, largest = self.flint.arb, abs(self.pole) + self.radius
        stored = self.cell.impulse_remainder(count)[:, self.number].reshape(count, -1)
        for row, k in zip(stored, range(-self.cell.delay, count - self.cell.delay), strict=True):
            size = 2 * self.radius**REPEAT * math.comb(k, REPEAT) * largest ** (k - REPEAT) if k >= REPEAT else arb(0)
            if not all(self._below(size * arb(c), arb(end)) for c, end in zip(self.amplitude, row, strict=True)):
                return False
        return True

    def _below(self, value: arb, stored: arb) -> bool:
        """Return whether a ball lies below a number with half of the allowance."""
        return bool(value * self.flint.arb(_HALF) <= stored)


def _remainders_hold(modes: list[_Mode], omega: Real, cell: PoleCell) -> bool:
    """Return whether the slack of every entry at every frequency is above the sum of the remainders of all modes."""
    arb = modes[0].flint.arb
    for frequency, stored in zip(omega.tolist(), cell.slack(omega).reshape(omega.size, -1), strict=True):
        if not np.all(np.isfinite(stored)):
            continue  # nothing is claimed there
        each = [mode.remainder(frequency) for mode in modes]
        if any(one is None for one in each):
            return False
        for entry, end in enumerate(stored.tolist()):
            total = sum((one * arb(float(m.amplitude[entry])) for one, m in zip(each, modes, strict=True)), arb(0))
            if not total * arb(_HALF) <= end:
                return False
    return True


def _norm(arb: Any, values: Real) -> Any:
    total = arb(0)
    for value in values.tolist():
        total += arb(value) ** 2
    return total.sqrt()

r"""Relaxations of cells of poles, checked in ball arithmetic: every rounding error enclosed (extra `robustid[exact]`).

The numbers of a cell are computed in double precision, larger than the formulas by a part of 1e-9. Here the formulas are enclosed
again, for the ends of the cell as they are stored, and compared with these numbers less half of that part. The other half is for
what follows: sums, products and norms of non-negative numbers, whose rounding is at most some thousand units of 1e-16. Bounds that
the remainders are added to may be too small by one rounding, which the claims about relaxed problems allow for.

.. math:: T = \max \Big|\frac{s - s_1}{s + s_1^*}\Big|, \qquad
          \Big|\frac{c}{1 - a/z} - \frac{c'}{1 - a_1/z} \sum_{j<m} (t b)^j\Big| \le \frac{|c'|\, T^m}{(1 - T)\, d},
          \quad d = |1 - a_1/z|

and the same for c/(s - a), with d = |s - a_1|, in continuous time. The largest distance T from the middle is at a corner of a
polygon around the s of a cell, since hyperbolic discs are convex; their images in z are at most as far apart (Schwarz and Pick).
"""

from __future__ import annotations

from types import ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np

from robustid.core import Real
from robustid.guarantees.pole_cells import REPEAT, TERMS, PoleCell
from robustid.identification import MixedProblem, ball_arithmetic

if TYPE_CHECKING:
    from flint import arb

_HALF = 1 + 5e-10  # half of the allowance


def relaxed_enough(cell: PoleCell, problem: MixedProblem, omega: Real) -> bool:
    """Return whether distances, intervals and remainders of a cell are above what the formulas give, all rounding enclosed.

    The remainders are used at the samples of the problem and at `omega` (F,), rad/s, where the response is bounded.
    """
    omega = np.concatenate([omega, *(points.omega for points in problem.frequency)])
    samples = max((record.u.shape[0] for record in problem.time), default=0)
    with ball_arithmetic() as flint:
        modes = [_Mode(flint, cell, number) for number in range(cell.distance.size)]
        return (
            all(mode.distance_holds() for mode in modes)
            and all(mode.intervals_hold() for mode in modes)
            and _remainders_hold(modes, np.unique(omega), cell)
            and (not samples or all(mode.impulse_holds(samples) for mode in modes))
        )


class _Mode:
    """One mode of a cell: its middle pole as a ball, its distance and its largest amplitudes as they are stored."""

    def __init__(self, flint: ModuleType, cell: PoleCell, number: int) -> None:
        self.flint, self.cell, self.number = flint, cell, number
        self.distance = flint.arb(float(cell.distance[number]))
        self.amplitude: Real = cell.amplitude.reshape(cell.distance.size, -1)[number]
        self.ends = [[flint.arb(end) for end in side[number].tolist()] for side in (cell.omega, cell.damping)]
        middle = complex(cell.middle[number])
        self.pole = flint.acb(middle.real, middle.imag)

    def distance_holds(self) -> bool:
        """Return whether corners of a polygon around the s of the cell are within the distance from that of the middle.

        Besides its four corners the point in which the tangents at the ends of the outer arc meet.
        """
        acb, dt, (omega, damping) = self.flint.acb, self.cell.dt, self.ends
        middle = self.pole.log() / self.flint.arb(dt) if dt else self.pole
        turns = [acb(-d, (1 - d * d).sqrt()) for d in damping]
        total = turns[0] + turns[1]  # its length is 2 cos of half of the angle between them
        tip = omega[1] * total / (total * total.conjugate()).real * 2
        corners = [w * turn for w in omega for turn in turns] + [tip]
        return all(bool(abs((s - middle) / (s + middle.conjugate())) <= self.distance) for s in corners)

    def intervals_hold(self) -> bool:
        """Return whether twice the coefficients c' t^k lie in their intervals."""
        ends = self.cell.intervals()[..., 1].reshape(self.cell.distance.size, 2 * REPEAT, -1)[self.number]
        sizes = [2 * self.distance ** (k // 2) for k in range(2 * REPEAT)]
        return all(self._reach(size, row) for size, row in zip(sizes, ends, strict=True))

    def remainder(self, omega: float) -> arb | None:
        """Bound of what the series leaves out at a frequency of an amplitude of one; None where it may be without bound."""
        total, dt = self.flint.arb(0), self.cell.dt
        turned = self.flint.acb(0, -self.flint.arb(omega * dt)).exp()
        for pole in (self.pole, self.pole.conjugate()):
            distance = abs(1 - pole * turned) if dt else abs(self.flint.acb(0, omega) - pole)
            room = distance * (1 - self.distance)
            if not room > 0:
                return None
            total += self.distance**REPEAT / room
        return total

    def impulse_holds(self, count: int) -> bool:
        """Return whether 2 c' sum_k T^k |f_k| is below the remainder of every sample: f_0 = a1^n, f_k = b f_(k-1).

        Of the functions after some terms the norm bounds the sum.
        """
        arb, acb, T, a = self.flint.arb, self.flint.acb, self.distance, self.pole
        norm = 1 / (1 - (a * a.conjugate()).real).sqrt()
        stored = self.cell.impulse_remainder(count)[:, self.number].reshape(count, -1)
        stored = stored[self.cell.delay :]
        f, total = [a**n for n in range(len(stored))], [norm * T**TERMS / (1 - T)] * len(stored)
        for k in range(TERMS):
            if k >= REPEAT:
                total = [one + T**k * abs(here) for one, here in zip(total, f, strict=True)]
            last, before, after = acb(0), acb(0), list[Any]()
            for here in f:
                last = a * last + before - a.conjugate() * here
                before = here
                after.append(last)
            f = after
        return all(self._reach(2 * size, row) for size, row in zip(total, stored, strict=True)) and bool(arb(1) > T)

    def _reach(self, size: arb, stored: Real) -> bool:
        """Return whether so many times the amplitude of every entry lie below stored numbers."""
        arb = self.flint.arb
        return all(self._below(size * arb(c), arb(end)) for c, end in zip(self.amplitude, stored, strict=True))

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

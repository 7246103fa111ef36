"""Linear certificates in ball arithmetic: every rounding error of the sums enclosed, with the library FLINT (`robustid[exact]`).

This module shares no formula with the search, nor with the evaluation in double precision. Nodes, weights, values of the functions,
samples and bounds are taken as they are in double precision.
"""

from __future__ import annotations

from types import ModuleType
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from robustid.core import Complex, Real
from robustid.guarantees.linear.amplitudes import Extraction, amplitude_targets
from robustid.guarantees.linear.certificate import Amplitudes, Targets, targets_at
from robustid.guarantees.linear.entry_band import EntryBand
from robustid.guarantees.linear.predictions import nothing
from robustid.guarantees.linear.samples import Samples
from robustid.identification import ball_arithmetic

if TYPE_CHECKING:
    from flint import acb, arb


def holds_exactly(band: EntryBand) -> bool:
    """Say whether the discs of the amplitudes are proved, and every disc at a knot, all rounding enclosed."""
    samples, extraction = band.samples, band.extraction
    known = extraction.known
    with ball_arithmetic() as flint:
        sums = Sums(flint, samples)
        if samples.amplitudes and not sums.amplitudes_proved(extraction, known):
            return False
        targets, stated = targets_at(samples, band.angles), band.radius
        for k, (points, d) in enumerate(zip(band.points, band.multipliers.astype(complex), strict=True)):
            radius = sums.radius(targets, k, points, d, known)
            centre = sums.centre(targets, k, points, d, known)
            away = sums.distance(centre, complex(band.centre[k]))
            if not radius + away <= float(stated[k]) and np.isfinite(stated[k]):
                return False
    return True


def contradicts_exactly(extraction: Extraction, base: complex, points: NDArray[np.intp], d: Complex) -> bool:
    """Say whether the discs of the amplitudes are proved, and zero is outside of that of a combination, all rounding enclosed."""
    samples, known = extraction.samples, extraction.known
    with ball_arithmetic() as flint:
        sums = Sums(flint, samples)
        if samples.amplitudes and not sums.amplitudes_proved(extraction, known):
            return False
        numbers = nothing(samples, np.array([base])), 0, points, d, known
        return bool(sums.distance(sums.centre(*numbers), 0j) > sums.radius(*numbers))


class Sums:
    """The sums of linear certificates as balls."""

    def __init__(self, flint: ModuleType, samples: Samples) -> None:
        self.flint, self.samples = flint, samples
        self.nodes = [flint.acb(*pair) for pair in _pairs(samples.nodes)]
        self.inverse: dict[tuple[int, int], acb] = {}

    def number(self, value: complex) -> acb:
        """A complex number, exactly."""
        return self.flint.acb(value.real, value.imag)

    def distance(self, centre: acb, stated: complex) -> arb:
        """|centre - stated|."""
        return abs(centre - self.number(stated))

    def _cauchy(self, k: int, other: int) -> acb:
        """1/(1 - z_k conj(z_other)), kept."""
        found = self.inverse.get((k, other))
        if found is None:
            found = 1 / (1 - self.nodes[k] * self.nodes[other].conjugate())
            self.inverse[k, other], self.inverse[other, k] = found, found.conjugate()
        return found

    def square(self, targets: Targets, row: int, points: NDArray[np.intp], d: Complex) -> arb:
        """The squared norm of the target less the combination, in H2 of the harmonic measure."""
        flint, samples = self.flint, self.samples
        base = self.number(complex(targets.base[row]))
        scale = 1 - base * base.conjugate()
        count = len(points)
        total = flint.acb(0)
        weight = self.number(complex(targets.weight[row]))
        total += weight * weight.conjugate()
        places = points.tolist()
        weights = [[self.number(w) for w in samples.weights[k].tolist()] for k in places]
        multipliers = [self.number(one) for one in d.tolist()]
        # Points: sum over components of u C u^H / scale, u = d w (1 - base* z).
        near = [1 - base.conjugate() * self.nodes[k] for k in places]
        every = [self._cauchy(k, other) for k in places for other in places]
        cauchy = flint.acb_mat(count, count, every) if count else None
        powers: list[list[acb]] = []
        for c in range(len(samples.components)):
            u = [m * w[c] * v for m, w, v in zip(multipliers, weights, near, strict=False)]
            if count:
                row_of, column = flint.acb_mat(1, count, u), flint.acb_mat(count, 1, [one.conjugate() for one in u])
                total += (row_of * cauchy * column)[0, 0] / scale
            powers.append(u)
        cross = sum((m * w[samples.target] for m, w in zip(multipliers, weights, strict=False)), flint.acb(0))
        if samples.rows:
            total += self._records(base, scale, places, powers, multipliers[count:])
            start = samples.blocks[samples.target][:, 0].tolist()
            cross += sum((m * s for m, s in zip(multipliers[count:], start, strict=True)), flint.acb(0))
        return (total - 2 * cross * weight.conjugate()).real

    def _records(self, base: acb, scale: acb, places: list[int], powers: list[list[acb]], d: list[acb]) -> acb:
        """Part of the rows of the records: the polynomial q = d U of a component, beside the points, in the same norm."""
        flint, total = self.flint, self.flint.acb(0)
        for c, block in enumerate(self.samples.blocks):
            size = block.shape[1]
            q = (
                flint.acb_mat(1, len(d), d) * flint.acb_mat(flint.arb_mat(*block.shape, block.ravel().tolist()))
            ).entries()
            # sum_nl q_n T_nl conj(q_l), T the Taylor coefficients of (1 - base* z)(1 - base w*)/(1 - z w*).
            own = sum((one * one.conjugate() for one in q), flint.acb(0))
            later = sum((one * one.conjugate() for one in q[1:]), flint.acb(0))
            turned = sum((q[n + 1] * q[n].conjugate() for n in range(size - 1)), flint.acb(0))
            total += (own + base * base.conjugate() * later - 2 * (base.conjugate() * turned).real) / scale
            for k, u in zip(places, powers[c], strict=False):
                # The point's functional is u/(1 - base* z) times the value: against z^n it has conj(z)^n - base* conj(z)^(n-1).
                w, value, power, last = self.nodes[k].conjugate(), flint.acb(0), flint.acb(1), flint.acb(0)
                for n in range(size):
                    value += q[n] * (power - base.conjugate() * last)
                    last, power = power, power * w
                total += 2 * (value * u.conjugate() / scale).real
        return total

    def missed(self, targets: Targets, row: int, points: NDArray[np.intp], d: Complex) -> list[acb]:
        """Differences of the combination from the target in every function."""
        values = np.concatenate([self.samples.values[points], self.samples.record_functions])
        m = values.shape[1]
        if not m:
            return []
        left = self.flint.acb_mat(1, len(values), [self.number(one) for one in d.tolist()])
        right = self.flint.acb_mat(*values.shape, [self.number(one) for one in values.ravel().tolist()])
        found = (left * right).entries()
        return [one - self.number(t) for one, t in zip(found, targets.values[row].tolist(), strict=True)]

    def _sizes(self, points: NDArray[np.intp], d: Complex) -> tuple[list[arb], Real, Real]:
        samples = self.samples
        bound = np.concatenate([samples.bound[points], samples.record_bound])
        left_out = np.concatenate([samples.left_out[points], samples.record_left_out])
        return [abs(self.number(one)) for one in d.tolist()], bound, left_out

    def radius(self, targets: Targets, row: int, points: NDArray[np.intp], d: Complex, known: Amplitudes) -> arb:
        """The radius of a disc."""
        arb = self.flint.arb
        size, bound, left_out = self._sizes(points, d)
        total = self._root(self.square(targets, row, points, d))
        largest = [abs(self.number(c)) + r for c, r in zip(known.centre.tolist(), known.radius.tolist(), strict=True)]
        total += sum((s * e for s, e in zip(size, bound.tolist(), strict=True)), arb(0))
        for g, most in enumerate(largest):
            column = left_out[:, g]
            used = np.flatnonzero(column).tolist()
            left = sum((size[k] * float(column[k]) for k in used), arb(0)) + float(targets.left_out[row, g])
            total += left * most
        for missed, at, first, power in zip(
            self.missed(targets, row, points, d),
            self.samples.amplitude_of.tolist(),
            self.samples.first.tolist(),
            self.samples.powers.tolist(),
            strict=True,
        ):
            total += abs(missed) * (float(known.radius[at]) if first else largest[at] * power)
        return total

    def _root(self, square: arb) -> arb:
        """Above the root of a number that is not negative."""
        top = square.upper()
        return top.sqrt() if top > 0 else self.flint.arb(0)

    def centre(self, targets: Targets, row: int, points: NDArray[np.intp], d: Complex, known: Amplitudes) -> acb:
        """The centre of a disc."""
        samples = self.samples
        y = np.concatenate([samples.y[points], samples.record_y])
        total = sum(
            (self.number(m) * self.number(v) for m, v in zip(d.tolist(), y.tolist(), strict=True)), self.flint.acb(0)
        )
        missed = self.missed(targets, row, points, d)
        for one, at, first, conjugate in zip(
            missed, samples.amplitude_of.tolist(), samples.first.tolist(), samples.conjugate.tolist(), strict=True
        ):
            if first:
                value = self.number(complex(known.centre[at]))
                total -= one * (value.conjugate() if conjugate else value)
        return total

    def amplitudes_proved(self, extraction: Extraction, known: Amplitudes) -> bool:
        """Say whether b + E u <= u: then no amplitude is farther than u from its centre.

        u are distances from the stated centres; every combination bounds its own by what it confuses with the others.
        """
        if not np.all(np.isfinite(known.radius)):
            return True  # nothing is claimed
        arb, samples, targets = self.flint.arb, self.samples, amplitude_targets(self.samples)
        for row, (points, d) in enumerate(zip(extraction.points, extraction.multipliers, strict=True)):
            proved = self.radius(targets, row, points, d, known)
            # The combination's own value for the amplitude, against the stated centre: real amplitudes by their real parts.
            value = self.centre(targets, row, points, d, known)
            real = np.sum(samples.first & (samples.amplitude_of == row)) == 1
            away = value - self.number(complex(known.centre[row]))
            apart = abs(away.real) if real else abs(away)
            if not proved + apart <= arb(float(known.radius[row])):
                return False
        return True


def _pairs(values: Complex) -> list[tuple[float, float]]:
    return list(zip(np.real(values).tolist(), np.imag(values).tolist(), strict=True))

"""Least squares over a delay, common poles and the residues of all entries: what `estimate_delay` minimises.

Residues are projected out as in the fit of `advice/pole_fit.py`, of another model: here a delay that is no whole number of
samples is an unknown and the order is stated. There modes come one after another, beside a smooth remainder in whose span whole
samples of delay lie: its cost is the same for each of them, and it finds the number of modes where nobody states an order.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from robustid.core import Projection, lengths, projected, real_rows
from robustid.data import FrequencyResponse
from robustid.errors import InputError

_RELOCATIONS, _MORE = 4, 12  # at every delay of a search; before a minimum is refined
_INSIDE = 1 - 1e-9
_DAMPING = 0.02  # of the first poles
_WIDE = 100.0  # highest over lowest frequency from which on the plant may be one of relaxations: real poles over the decades
_SMALLEST = 1e-9  # part of the largest |G| below which a relative weight makes no sense
_STEP = 1e-6  # of the differences, in units of 1/omega and of the unit circle
_TIGHT = 1e-11
_ABOVE = 2.0  # times the highest frequency, where a pole above the band begins
_APART = 5  # frequency points between pairs that are added
_NEAR, _FAR, _WIDER = 1e-3, 10.0, 1.5  # how far a delay is moved for its deviation, times the largest omega


class Refined(NamedTuple):
    """A minimum over poles, and over the delay unless it is held: the delay in s, the weighted sum of squares."""

    delay: float
    poles: np.ndarray
    cost: float


class PoleFit:
    """A delayed sum of partial fractions r_i/(x - a_i) [+ d] against the entries of a response, weighted.

    x = 1j omega over the largest omega, or exp(1j omega dt) with a zero-order hold. Poles are complex numbers with
    Im >= 0: one of a pair, or real. Real rows hold the real parts of all frequency points, then the imaginary parts.
    """

    def __init__(self, frf: FrequencyResponse, *, feedthrough: bool) -> None:
        self.omega, self.dt, self.feedthrough = frf.omega, frf.dt, feedthrough
        self.x = 1j * frf.omega / frf.omega[-1] if frf.dt is None else np.exp(1j * frf.omega * frf.dt)
        self.values = frf.values.swapaxes(1, 2).reshape(self.omega.size, -1)  # vec: columns stacked
        if not np.any(self.values):
            raise InputError("`frf` is zero at every frequency point: it has no delay")
        size = np.maximum(np.abs(self.values), _SMALLEST * np.abs(self.values).max())
        if frf.covariance is not None:
            deviation = np.sqrt(np.maximum(np.einsum("fii->fi", frf.covariance).real, 0))
            size = np.maximum(deviation, np.finfo(float).eps * size)
        self.weight = 1 / size

    @property
    def samples(self) -> int:
        """Complex numbers that are fitted."""
        return self.values.size

    @property
    def _band(self) -> tuple[float, float]:
        """Lowest frequency above zero and the highest."""
        return float(self.omega[self.omega > 0].min(initial=self.omega[-1])), float(self.omega[-1])

    @property
    def wide(self) -> bool:
        """True if the frequencies span decades."""
        low, high = self._band
        return high > _WIDE * low

    def unknowns(self, poles: int) -> int:
        """Real unknowns: poles, residues and the delay."""
        return 1 + poles + self.values.shape[1] * (poles + self.feedthrough)

    def search(self, order: int, delays: np.ndarray, *, decades: bool = True) -> tuple[np.ndarray, list[np.ndarray]]:
        """Sum of squares and poles at each delay, by relocating poles; of a wide response from real ones too, with `decades`."""
        costs: list[float] = []
        found: list[np.ndarray] = []
        for delay in delays:
            ahead, best = self._ahead(delay), (np.inf, np.zeros(0, complex))
            for poles in self._firsts(order)[: None if decades else 1]:
                for _ in range(_RELOCATIONS * (1 + self.wide)):
                    poles = self._relocated(ahead, poles)
                    if np.any(self.x[:, None] == poles):
                        break  # on a frequency point: its functions are infinite there
                    best = min(best, (self._cost(ahead, poles), poles), key=lambda item: item[0])
            costs.append(best[0])
            found.append(best[1])
        return np.array(costs), found

    def _cost(self, values: np.ndarray, poles: np.ndarray) -> float:
        """Sum of squares of what these poles leave."""
        entries = self._entries(values, self._functions(0.0, poles))
        return sum(float(one.residual @ one.residual) for one in entries)

    def residuals(self, poles: np.ndarray) -> np.ndarray:
        """Weighted values less their best fit at these poles, complex, (F, entries); without a delay."""
        left = [one.residual for one in self._entries(self.values, self._functions(0.0, poles))]
        half = len(self.omega)
        return np.stack([rows[:half] + 1j * rows[half:] for rows in left], axis=1)

    def refine(self, delay: float, poles: np.ndarray, *, held: bool = False, steps: int | None = None) -> Refined:
        """The minimum near a start: variable projection with Kaufman's Jacobian (`golub1973`); over poles alone if `held`."""
        import scipy.optimize

        for _ in range(0 if held else _MORE):
            poles = self._relocated(self._ahead(delay), poles)
        pair, unit = np.imag(poles) > 0, 1 / self.omega[-1]
        start = np.concatenate([[delay / unit], np.real(poles), np.imag(poles[pair])])
        moves = np.eye(start.size)[1 if held else 0 :]

        def unpack(z: np.ndarray) -> tuple[float, np.ndarray]:
            z = start + z @ moves
            moved = z[1 : 1 + pair.size].astype(complex)
            moved[pair] += 1j * z[1 + pair.size :]
            return float(z[0] * unit), moved

        latest: tuple[np.ndarray, list[Projection]] = np.array([np.nan]), []

        def entries_at(z: np.ndarray) -> list[Projection]:
            nonlocal latest
            if not np.array_equal(latest[0], z):  # slopes are asked for where a residual has just been
                latest = z.copy(), list(self._entries(self.values, self._functions(*unpack(z))))
            return latest[1]

        def residual(z: np.ndarray) -> np.ndarray:
            return np.concatenate([one.residual for one in entries_at(z)])

        plain = held and delay == 0
        reach = () if plain else _STEP * np.eye(len(moves))

        def slopes(z: np.ndarray) -> np.ndarray:
            ends = [[self._functions(*unpack(z + step)) for step in (e, -e)] for e in reach]
            changes = [(up - down) / (2 * _STEP) for up, down in ends]
            rows: list[np.ndarray] = []
            for weight, one in zip(self.weight.T, entries_at(z), strict=True):
                c = one.coefficients
                ways = self._ways(unpack(z)[1], c) if plain else np.stack([each @ c for each in changes], axis=1)
                rows.append(one.tangent(real_rows(weight[:, None] * ways)))
            return np.concatenate(rows)

        least_squares: Any = scipy.optimize.least_squares
        tight = {"ftol": _TIGHT, "xtol": _TIGHT, "gtol": _TIGHT}
        begin = np.zeros(len(moves))
        with np.errstate(all="ignore"):  # poles that meet have no functions of their own; on a point they have no value
            found = least_squares(residual, begin, slopes, method="lm", x_scale="jac", max_nfev=steps or 40, **tight)
        if not np.isfinite(found.cost):
            return Refined(*unpack(begin), float(np.sum(residual(begin) ** 2)))
        return Refined(*unpack(found.x), 2 * float(found.cost))

    def deviation(self, best: Refined) -> float:
        """Way of the delay, the poles following, until the cost has risen as much as one standard deviation costs.

        Not from the curvature at the minimum: within a sample the cost of a held plant can be as flat as a fourth power.
        """
        rise = best.cost / max(
            2 * self.samples - self.unknowns(best.poles.size + int(np.sum(np.imag(best.poles) > 0))), 1
        )
        return max(self._reach(best, side, rise) for side in (-1.0, 1.0))

    def _reach(self, best: Refined, side: float, rise: float) -> float:
        far, poles = _NEAR / self.omega[-1], best.poles
        while far * self.omega[-1] < _FAR:
            moved = self.refine(best.delay + side * far, poles, held=True)
            if moved.cost > best.cost + rise:
                return far * float(np.sqrt(rise / (moved.cost - best.cost)))
            far, poles = far * _WIDER, moved.poles
        return np.inf

    def _ahead(self, delay: float) -> np.ndarray:
        """The values with a delay taken out."""
        return self.values * np.exp(1j * self.omega * delay)[:, None]

    def _functions(self, delay: float, poles: np.ndarray) -> np.ndarray:
        """The delayed functions of the poles, and of the constant, (F, n).

        Behind a hold 1/(z - p) with a delay of d + f samples, 0 <= f < 1, is z^-d (B0 + B1/z)/(z - p), where
        B0 = (p^(1-f) - 1)/(p - 1) and B1 = 1 - B0: the modified z-transform of the mode, scaled.
        """
        if self.dt is None:
            turn, f = np.exp(-1j * self.omega * delay)[:, None], 0.0
        else:
            whole = np.floor(delay / self.dt)
            turn, f = np.exp(-1j * self.omega * self.dt * whole)[:, None], delay / self.dt - whole
        functions = turn * fractions(self.x, poles, f)
        # A constant jumps by a whole sample as f leaves 0; the line between the two lets the minimum be sought.
        constant = (
            1 - f + f / self.x[:, None] if f else np.ones((self.x.size, 1))
        )  # x is 0 at zero frequency, without a hold
        return np.hstack([functions, turn * constant]) if self.feedthrough else functions

    def _ways(self, poles: np.ndarray, c: np.ndarray) -> np.ndarray:
        """Derivatives of the functions times c by the poles, without a delay."""
        return slopes_of(self.x, poles, c)

    def _entries(self, values: np.ndarray, functions: np.ndarray) -> Iterator[Projection]:
        """The weighted values of every entry, projected on the weighted functions."""
        for weight, value in zip(self.weight.T, values.T, strict=True):
            yield projected(real_rows(weight[:, None] * functions), real_rows(weight * value))

    def _relocated(self, values: np.ndarray, poles: np.ndarray) -> np.ndarray:
        """The zeros of sigma in values*sigma = N, sigma = 1 + sum c_i/(x - a_i) and N of the same poles (`gustavsen2006`)."""
        functions = fractions(self.x, poles)
        rows: list[np.ndarray] = []
        rights: list[np.ndarray] = []
        entries = self._entries(values, self._functions(0.0, poles))
        for weight, value, one in zip(self.weight.T, values.T, entries, strict=True):
            rows.append(one.tangent(real_rows((weight * value)[:, None] * functions)))
            rights.append(one.residual)
        stacked = np.vstack(rows)
        scale = lengths(stacked)
        c = np.asarray(np.linalg.lstsq(stacked / scale, np.concatenate(rights), rcond=None)[0], dtype=float) / scale
        zeros = np.linalg.eigvals(companion(poles, c))
        if self.dt is None:
            zeros = -np.abs(np.real(zeros)) + 1j * np.imag(zeros)
        else:
            out = np.abs(zeros) > 1
            zeros[out] = _INSIDE / np.conj(zeros[out])
        return zeros[np.imag(zeros) >= 0]

    def _firsts(self, order: int) -> list[np.ndarray]:
        """Lightly damped pairs over the band, and a real pole where the order is odd; over decades also real poles alone."""
        lowest, high = self._band
        low = max(float(self.omega[0]), high / 50)
        pairs = np.linspace(low, high, order // 2 + 2)[1:-1] * (1j - _DAMPING)
        starts = [np.concatenate([pairs, [complex(-np.sqrt(low * high))] * (order % 2)])]
        if self.wide:
            starts.append(-np.geomspace(lowest, high, order).astype(complex))
        return [s / high if self.dt is None else np.exp(s * self.dt) for s in starts]

    def broad(self, order: int) -> np.ndarray:
        """Pairs over the band that are as wide as their distance, and a real pole where the order is odd.

        They follow what is smooth as they stand: where noise is a quarter of the response and more, relocation goes astray.
        """
        low, high = self._band
        middle = np.linspace(low, high, order // 2 + 2)[1:-1]
        return self._placed(middle, np.full(middle.size, (high - low) / (order // 2 + 1)), order)

    def grown(self, poles: np.ndarray, order: int) -> np.ndarray:
        """The poles, and narrow pairs where they leave most, up to an order; a real pole where a single one is missing."""
        left = np.sum(np.abs(self.residuals(poles)) ** 2, axis=1)
        width, at = np.gradient(self.omega), list[int]()
        missing = order - poles.size - int(np.sum(np.imag(poles) > 0))
        for _ in range(missing // 2):
            k = int(np.argmax(left))
            at.append(k)
            left[np.abs(self.omega - self.omega[k]) <= _APART * width[k]] = 0
        return np.concatenate([poles, self._placed(self.omega[at], width[at], missing)])

    def beyond(self, poles: np.ndarray) -> np.ndarray:
        """The poles, and a pair above the band: a mode of which only the flank shows. Relocation rarely finds it from within."""
        high = self._band[1]
        above = _ABOVE * high if self.dt is None else (high + np.pi / self.dt) / 2
        return np.concatenate([poles, self._placed(np.array([above]), np.array([_DAMPING * above]), 2)])

    def _placed(self, omega: np.ndarray, width: np.ndarray, order: int) -> np.ndarray:
        """Pairs at frequencies with distances from the axis in rad/s, and a real pole where the order is odd."""
        poles = np.append(1j * omega - width, [complex(-self.omega[-1])] * (order % 2))
        return poles / self.omega[-1] if self.dt is None else np.exp(poles * self.dt)


def fractions(x: np.ndarray, poles: np.ndarray, f: float = 0.0) -> np.ndarray:
    """Functions of real poles, the sum and j times the difference of those of pairs, (F, order): real coefficients."""
    pair = np.imag(poles) != 0
    ahead = _ahead_of_hold(poles, f)
    first = np.cumsum(1 + pair) - 1 - pair  # column of every pole's first function
    columns = np.empty((x.size, int(np.sum(1 + pair))), complex)
    x = x[:, None]
    conj = np.conj(ahead[pair])
    one = (ahead + (1 - ahead) / x if f else 1) / (x - poles)  # x is 0 at zero frequency, without a hold
    other = (conj + (1 - conj) / x if f else 1) / (x - np.conj(poles[pair]))
    columns[:, first] = one
    columns[:, first[pair]] += other
    columns[:, first[pair] + 1] = 1j * (one[:, pair] - other)
    return columns


def slopes_of(x: np.ndarray, poles: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Derivatives of the sum of `fractions` times c by Re of every pole, then by Im of those of pairs, (F, n)."""
    pair = np.imag(poles) != 0
    first = np.cumsum(1 + pair) - 1 - pair
    one = 1 / (x[:, None] - poles) ** 2
    other = np.where(pair, 1 / (x[:, None] - np.conj(poles)) ** 2, 0)
    real, imag = c[first], np.where(pair, c[np.minimum(first + 1, len(c) - 1)], 0)
    both, apart = one + other, 1j * (one - other)
    return np.hstack([real * both + imag * apart, (real * apart - imag * both)[:, pair]])


def _ahead_of_hold(poles: np.ndarray, f: float) -> np.ndarray:
    """B0 of `PoleFit._functions`: the part of a mode's step that a fraction f of a sample leaves in the same sample."""
    ahead = np.ones(poles.size, complex)
    sampled = (np.imag(poles) != 0) | (np.real(poles) > 0)  # no sampled mode has another pole
    if f and np.any(sampled):
        log = np.log(poles[sampled])
        still = log == 0
        log[still] = 1.0
        ahead[sampled] = np.where(still, 1 - f, np.expm1((1 - f) * log) / np.expm1(log))
    return ahead


def companion(poles: np.ndarray, c: np.ndarray) -> np.ndarray:
    """A real matrix whose eigenvalues are the zeros of 1 + sum c_i phi_i."""
    matrix, push, i = np.zeros((c.size, c.size)), np.zeros(c.size), 0
    for pole in poles:
        if pole.imag == 0:
            matrix[i, i], push[i] = pole.real, 1.0
            i += 1
        else:
            matrix[i : i + 2, i : i + 2] = [[pole.real, pole.imag], [-pole.imag, pole.real]]
            push[i] = 2.0
            i += 2
    return matrix - np.outer(push, c)

"""Poles of a frequency response: separable least squares, one mode after another.

Damped pairs beside a smooth remainder, in units of the bounds. `data/estimate/pole_fit.py` fits another model, with a delay.
"""

from __future__ import annotations

import dataclasses
import logging
from typing import Any

import numpy as np
from numpy.typing import NDArray

from robustid.core import Complex, Plane, Projection, Real, projected

_log = logging.getLogger("robustid")

SMOOTH = 3  # terms 1, z^-1, z^-2 of the smooth remainder
_MOST_MODES = 12
_MOST_LINES = 1000  # for the search; the interval of a mode uses the frequency points around it
# A further mode must remove this part of the sum of squares at the start, or this part of what is left.
_WORTH, _WORTH_LEFT = 0.003, 0.75
DAMPING = (1e-5, 0.5)  # where poles are looked for; above the upper end nothing is lightly damped
_START = np.geomspace(1e-3, 0.2, 6)  # damping ratios at which the search starts
_DELAYS = range(4)  # samples
BELOW = 20  # times below the lowest frequency point: where poles are looked for too (friction, a suspension)
_ONE = 0.01  # half-widths between two poles, below which they are one
_SLOW = 0.7  # decay per sample, in units of log; a smooth remainder can hold a pole that decays faster


@dataclasses.dataclass(frozen=True)
class LineData:
    """Angles of the frequency points, values, bounds, plane; for several entries (F, E), a bound infinite if not measured."""

    angle: Real
    value: Complex
    bound: Real
    plane: Plane

    def select(self, index: Any) -> LineData:
        """Some of the frequency points."""
        return LineData(self.angle[index], self.value[index], self.bound[index], self.plane)

    @property
    def each(self) -> tuple[LineData, ...]:
        """The entries, one by one."""
        if self.value.ndim == 1:
            return (self,)
        pairs = zip(self.value.T, self.bound.T, strict=True)
        return tuple(LineData(self.angle, *pair, self.plane).select(np.isfinite(pair[1])) for pair in pairs)

    @property
    def room(self) -> int:
        """Number of modes (four numbers each) that the frequency points tell from a smooth remainder, one spare equation left."""
        return max(0, (2 * self.angle.size - SMOOTH - 1) // 4)

    def scaled(self, columns: Complex) -> Real:
        """Complex columns as real rows in units of the bounds."""
        weighted = columns / self.bound[:, None]
        return np.concatenate([weighted.real, weighted.imag])


def pole_pair(angle: Real, pole: Real, power: int = 1) -> Complex:
    """1 and z^-1 over (1 - 2 Re a z^-1 + |a|^2 z^-2)^power: the real span of a pole pair, (F, 2).

    Delays need no columns: they move within the span of pair and smooth remainder.
    """
    back = np.exp(-1j * angle)
    turn, zeta = np.exp(pole)
    a = np.exp((-zeta + 1j * np.sqrt(1 - zeta**2)) * turn)
    first = 1 / (1 - 2 * a.real * back + abs(a) ** 2 * back**2) ** power
    return np.stack([first, back * first], axis=1)


def pair_changes(angle: Real, pole: Real) -> tuple[Complex, Complex]:
    """Derivatives of `pole_pair` by log angle and log damping, (F, 2) each."""
    back, (turn, zeta) = np.exp(-1j * angle), np.exp(pole)
    root = np.sqrt(1 - zeta**2)
    a = np.exp((-zeta + 1j * root) * turn)
    double = pole_pair(angle, pole, 2)
    # of log a, by log angle and by log damping; d|a|^2 = 2 |a|^2 Re(d log a)
    moves = (-zeta + 1j * root) * turn, (-zeta - 1j * zeta**2 / root) * turn
    slopes = [2 * (abs(a) ** 2 * move.real * back - (a * move).real) * back for move in moves]
    return -slopes[0][:, None] * double, -slopes[1][:, None] * double


def smooth_terms(angle: Real) -> Complex:
    """1, z^-1, z^-2 at the frequency points, (F, 3)."""
    return np.exp(-1j * angle[:, None] * np.arange(SMOOTH))


def design(data: LineData, poles: Real) -> Real:
    """The pairs of all poles (log angle, log damping), then the smooth remainder, as real rows in units of the bounds."""
    columns = [pole_pair(data.angle, pole) for pole in poles] + [smooth_terms(data.angle)]
    return data.scaled(np.hstack(columns))


def residual_rows(poles: Real, data: LineData) -> Real:
    """Residuals of least squares at these poles, in units of the bounds, as real rows: real parts of all entries first."""
    fits = [_projected(one, poles.reshape(-1, 2)) for one in data.each]
    return np.hstack([fit.residual.reshape(2, -1) for fit in fits]).ravel()


def residual_slopes(poles: Real, data: LineData) -> Real:
    """Derivatives of the `residual_rows` by the poles, log angle and log damping in turn."""
    poles = poles.reshape(-1, 2)
    parts: list[Real] = []
    for one in data.each:
        fit = _projected(one, poles)
        weights = fit.coefficients
        moved = [
            change @ weights[2 * k : 2 * k + 2]
            for k, pole in enumerate(poles)
            for change in pair_changes(one.angle, pole)
        ]
        parts.append(fit.tangent(one.scaled(np.stack(moved, axis=1))).reshape(2, -1, 2 * len(poles)))
    return np.concatenate(parts, axis=1).reshape(-1, 2 * len(poles))


def _projected(data: LineData, poles: Real) -> Projection:
    """The values of one entry, projected on the columns of these poles."""
    return projected(design(data, poles), data.scaled(data.value[:, None])[:, 0])


def ratios(rows: Real) -> Real:
    """|e_k|/bound_k from real rows."""
    half = rows.size // 2
    return np.hypot(rows[:half], rows[half:])


def find_poles(data: LineData, wanted: int | None) -> tuple[Real, str]:
    """Poles (log angle, log damping) one after the other, all refined together after each."""
    data = data.select(slice(None, None, -(-data.angle.size // _MOST_LINES)))
    poles = np.zeros((0, 2))
    most = min(data.room, _MOST_MODES if wanted is None else wanted)
    before = residual_rows(poles, data)
    whole = float(before @ before)
    while True:
        largest = float(ratios(before).max())
        _log.debug("%d modes: largest |residual|/bound %.3g", len(poles), largest)
        fits = f"the largest residual of the fit is {largest:.3g} times its bound"
        if wanted is None and largest <= 1:
            return poles, f"{_count(poles)} and a smooth remainder keep all frequency points in bounds: {fits}"
        if len(poles) >= most:
            why = "as many as were asked for" if len(poles) == wanted else "as many as are looked for"
            return poles, f"{_count(poles)}, {why}; {fits}"
        further = refine(np.vstack([poles, best_start(poles, data)]), data)
        after = residual_rows(further, data)
        gain = float(before @ before - after @ after)
        if wanted is None and gain < _WORTH * whole and gain < _WORTH_LEFT * float(before @ before):
            return (
                poles,
                f"{_count(poles)}; a further one would remove {gain / whole:.2g} of the sum of squares; {fits}",
            )
        poles, before = further, after


def _count(poles: Real) -> str:
    return f"{len(poles)} mode{'s' * (len(poles) != 1)}"


def best_start(poles: Real, data: LineData) -> Real:
    """The pole on a grid whose pair removes most of the residual."""
    lines = data.angle.size
    # Between the frequency points too: the resonance of a light mode usually lies there.
    place = np.interp(np.linspace(0, lines - 1, min(8 * lines, 400)), np.arange(lines), data.angle)
    place = place[(place > 0) & (place < np.pi)]
    best, where = -np.inf, np.zeros(2)
    for zeta in _START:
        tried = [np.log([turn, zeta]) for turn in place]
        gain = np.sum([_gains(one, poles, tried) for one in data.each], axis=0)
        if gain.max() > best:
            best, where = gain.max(), tried[int(np.argmax(gain))]
    return where


def _gains(data: LineData, poles: Real, tried: list[Real]) -> Real:
    """Reduction by a further pair, for each pole tried, of the sum of squares of one entry."""
    fit = _projected(data, poles)
    stacked = np.stack([data.scaled(pole_pair(data.angle, pole)) for pole in tried], axis=1)
    stacked = stacked - np.tensordot(fit.basis, np.tensordot(fit.basis.T, stacked, 1), 1)
    gram = np.einsum("kni,knj->nij", stacked, stacked)
    gram += 1e-12 * np.trace(gram, axis1=1, axis2=2)[:, None, None] * np.eye(2)
    moment = np.einsum("kni,k->ni", stacked, fit.residual)
    weights = np.asarray(np.linalg.solve(gram, moment[..., None]), dtype=float)[..., 0]
    return np.einsum("ni,ni->n", moment, weights)


def refine(poles: Real, data: LineData) -> Real:
    """All poles together, from a start, by nonlinear least squares."""
    positive = data.angle[data.angle > 0]
    low = np.log([positive[0] / BELOW, DAMPING[0]])
    high = np.log([min(2 * positive[-1], 0.999 * np.pi), DAMPING[1]])
    return refine_beside(np.zeros((0, 2)), poles, data, low, high)


def refine_beside(fixed: Real, poles: Real, data: LineData, low: Real, high: Real) -> Real:
    """Poles between `low` and `high` (log angle, log damping), beside fixed ones, from a start, by nonlinear least squares."""
    import scipy.optimize

    low, high = np.tile(low, len(poles)), np.tile(high, len(poles))
    least_squares: Any = scipy.optimize.least_squares

    def rows(free: Real) -> Real:
        return residual_rows(np.append(fixed, free), data)

    def slopes(free: Real) -> Real:
        return residual_slopes(np.append(fixed, free), data)[:, fixed.size :]

    start = np.clip(poles.ravel(), low + 1e-9, high - 1e-9)
    found = least_squares(rows, start, slopes, x_scale="jac", bounds=(low, high), max_nfev=50)
    return found.x.reshape(-1, 2)


def told_apart(poles: Real) -> Real:
    """The poles without those that coincide with another one: their functions can't be told apart on any data."""
    turn, damping = np.exp(poles).T
    s = turn * (-damping + 1j * np.sqrt(1 - damping**2))
    kept: list[int] = []
    for k, half in enumerate(damping * turn):
        if all(abs(s[k] - s[j]) > _ONE * half for j in kept):
            kept.append(k)
    return poles[kept]


def wanted_in_basis(poles: Real, data: LineData) -> NDArray[np.bool_]:
    """Choose the poles for the parametric part: resonances that the frequency points show, and whatever decays slowly.

    A pole outside the points, or a well-damped one, is background that a smooth remainder holds, unless it decays slowly: then
    no class with a useful decay rate has it (friction at 3 Hz below a band that begins at 11 Hz).
    """
    turn, zeta = np.exp(poles).T
    resonant = (turn > data.angle[0]) & (turn < data.angle[-1]) & (zeta < 0.99 * DAMPING[1])
    return resonant | (turn * zeta < min(_SLOW, data.angle[-1] / 4))


def nearest(angle: Real, centre: float, reach: float, fewest: int) -> NDArray[np.intp]:
    """Indices of the frequency points within `reach` of `centre`, and of the nearest ones up to `fewest`."""
    distance = np.abs(angle - centre)
    count = max(fewest, int(np.sum(distance <= reach)))
    return np.sort(np.argsort(distance, kind="stable")[:count])


def smallest_remainder(data: LineData, poles: Real) -> int:
    """The delay for which modes and smooth remainder fit with the smallest remainder: what is left to the gain bound."""
    if not len(poles):
        return 0
    return int(np.argmin(np.sum([_remainder_sizes(one, poles) for one in data.each], axis=0)))


def _remainder_sizes(data: LineData, poles: Real) -> Real:
    """Largest smooth remainder of one entry at each delay, relative to its largest value."""
    y = data.scaled(data.value[:, None])[:, 0]
    smooth = smooth_terms(data.angle)
    sizes: list[float] = []
    for delay in _DELAYS:
        shift = np.exp(-1j * delay * data.angle)[:, None]
        modes = np.hstack([shift * pole_pair(data.angle, pole) for pole in poles])
        columns = data.scaled(np.hstack([modes, smooth]))
        norms = np.linalg.norm(columns, axis=0)
        weights = np.asarray(np.linalg.lstsq(columns / norms, y, rcond=1e-12)[0], dtype=float) / norms
        sizes.append(float(np.abs(smooth @ weights[-SMOOTH:]).max()))
    return np.array(sizes) / max(np.abs(data.value).max(), np.finfo(float).tiny)

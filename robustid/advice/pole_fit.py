"""Poles of a frequency response: separable least squares, one mode after another.

Damped pairs beside a smooth remainder, in units of the bounds. `estimation/pole_fit.py` fits another model, with a delay.
"""

from __future__ import annotations

import dataclasses
import logging
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from robustid.advice.step_clock import MOST_LINES, PLACES, StepClock
from robustid.core import Complex, Plane, Projection, Real, as_positive, plane_of, projected
from robustid.data import FrequencyResponse
from robustid.errors import InputError, InputTypeError

_log = logging.getLogger("robustid")

SMOOTH = 3  # terms 1, z^-1, z^-2 of the smooth remainder
_MOST_MODES = 20
# A further mode must remove this part of the sum of squares at the start, or this part of what is left.
_WORTH, _WORTH_LEFT = 0.003, 0.75
_WORTH_NEAR = 0.9  # or this part of what there is around it, where that is more than the bounds
_NEAR = (5, 12)  # half-widths of a mode, and fewest frequency points, that are around it
DAMPING = (1e-5, 0.5)  # where poles are looked for; above the upper end nothing is lightly damped, and see `lightest`
_CLEARLY = 2.0  # times their bounds, that points are missed by where two further modes are tried at once
_LIGHT = 0.4  # damping ratio below which a pair is a mode, and none that stands for a remainder
_START = np.geomspace(1e-3, 0.2, 6)  # damping ratios at which the search starts
_DENSE = 12  # lighter ones, where the points are denser than the lightest damping
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

    def select(self, index: NDArray[np.bool_] | NDArray[np.intp] | slice) -> LineData:
        """Some of the frequency points."""
        return LineData(self.angle[index], self.value[index], self.bound[index], self.plane)

    @property
    def each(self) -> tuple[LineData, ...]:
        """The entries, one by one."""
        if self.value.ndim == 1:
            return (self,)
        pairs = zip(self.value.T, self.bound.T, self.measured, strict=True)
        return tuple(LineData(self.angle, v, b, self.plane).select(there) for v, b, there in pairs)

    @property
    def measured(self) -> NDArray[np.bool_]:
        """Frequency points at which each entry was measured, (E, F)."""
        return np.ones((1, self.angle.size), bool) if self.value.ndim == 1 else np.isfinite(self.bound.T)

    @property
    def size(self) -> tuple[int, int]:
        """Numbers of entries and of frequency points."""
        return len(self.measured), self.angle.size

    @property
    def room(self) -> int:
        """Number of modes (four numbers each) that the frequency points tell from a smooth remainder, one spare equation left."""
        return max(0, (2 * self.angle.size - SMOOTH - 1) // 4)

    def scaled(self, columns: Complex) -> Real:
        """Complex columns as real rows in units of the bounds."""
        weighted = columns / self.bound[:, None]
        return np.concatenate([weighted.real, weighted.imag])


def line_data(frfs: Sequence[FrequencyResponse], plane: Plane) -> LineData:
    """Frequency points of all, in order, without entries that are zero throughout."""
    angle = plane.angles(np.concatenate([f.omega for f in frfs]))
    order = np.argsort(angle, kind="stable")
    measured = np.concatenate([~f.missing for f in frfs]).reshape(angle.size, -1)[order]
    value = np.concatenate([f.values for f in frfs]).reshape(angle.size, -1)[order]
    value = np.where(measured, value, 0.0)
    size = np.abs(value)
    bound = np.maximum(0.05 * size, 1e-6 * size.max(axis=0))
    if all(f.bound is not None for f in frfs):
        bound = np.concatenate([f.bound.outer_radius for f in frfs]).reshape(angle.size, -1)[order]
    bound, seen = np.where(measured, bound, np.inf), size.max(axis=0) > 0
    if size.shape[1] == 1:
        return LineData(angle[order], value[:, 0], bound[:, 0], plane)
    return LineData(angle[order], value[:, seen], bound[:, seen], plane)


def tells_modes(frf: FrequencyResponse) -> bool:
    """Tell whether the frequency points suffice for one mode beside a smooth remainder."""
    return line_data([frf.select(~frf.missing.all(axis=(1, 2)))], plane_of(frf.dt, frf.omega)).room > 0


def checked_lines(frf: object, dt: float | None) -> LineData:
    """Frequency points of a response in a plane, refused where they are too few or zero to tell a mode."""
    if not isinstance(frf, FrequencyResponse):
        raise InputTypeError(
            f"`frf` must be a FrequencyResponse; got {type(frf).__name__}. From a periodic record: estimate_frf"
        )
    given = frf.dt if dt is None else dt
    frf = frf.select(~frf.missing.all(axis=(1, 2)))
    plane = plane_of(None if given is None else as_positive("dt", given), frf.omega)
    if frf.omega.max() > plane.top * (1 + 1e-12):
        raise InputError(
            f"`dt` = {plane.dt:g} s allows frequencies up to {plane.top:g} rad/s; got {frf.omega.max():g} rad/s"
        )
    if not np.any(np.abs(frf.values[~frf.missing]) > 0):
        raise InputError("`frf` is zero at all frequency points; check the output")
    if not tells_modes(frf):
        raise InputError(
            f"`frf` has {frf.omega.size} frequency points; at least 4 are needed to find one mode beside a smooth remainder"
        )
    return line_data([frf], plane)


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
    return data.scaled(_columns(data.angle, poles))


def _columns(angle: Real, poles: Real) -> Complex:
    """The functions of the `design` at the frequency points, (F, 2 N + 3)."""
    return np.hstack([pole_pair(angle, pole) for pole in poles] + [smooth_terms(angle)])


def residual_rows(poles: Real, data: LineData) -> Real:
    """Residuals of least squares at these poles, in units of the bounds, as real rows: real parts of all entries first."""
    fits = _projected(data, poles.reshape(-1, 2))
    return np.hstack([fit.residual.reshape(2, -1) for fit in fits]).ravel()


def residual_slopes(poles: Real, data: LineData) -> Real:
    """Derivatives of the `residual_rows` by the poles, log angle and log damping in turn."""
    poles = poles.reshape(-1, 2)
    changes = [change for pole in poles for change in pair_changes(data.angle, pole)]
    parts: list[Real] = []
    for one, there, fit in zip(data.each, data.measured, _projected(data, poles), strict=True):
        weights = fit.coefficients
        moved = [change[there] @ weights[k - k % 2 : k - k % 2 + 2] for k, change in enumerate(changes)]
        parts.append(fit.tangent(one.scaled(np.stack(moved, axis=1))).reshape(2, -1, 2 * len(poles)))
    return np.concatenate(parts, axis=1).reshape(-1, 2 * len(poles))


def _projected(data: LineData, poles: Real) -> list[Projection]:
    """The values of every entry, projected on the columns of these poles, which all of them share."""
    columns = _columns(data.angle, poles)
    each = zip(data.each, data.measured, strict=True)
    return [projected(one.scaled(columns[there]), one.scaled(one.value[:, None])[:, 0]) for one, there in each]


def ratios(rows: Real) -> Real:
    """|e_k|/bound_k from real rows."""
    half = rows.size // 2
    return np.hypot(rows[:half], rows[half:])


def find_poles(data: LineData, wanted: int | None, clock: StepClock) -> tuple[Real, str]:
    """Poles (log angle, log damping) one after the other, all refined together after each."""
    data = data.select(slice(None, None, -(-data.angle.size // MOST_LINES)))
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
        if not clock.begins():
            if wanted is not None or not len(poles):
                raise clock.refuse(f"{_count(poles)} found")
            return poles, f"{_count(poles)}, then the time was over; {fits}"
        further, after = _with_one_more(data, poles)
        gain = float(before @ before - after @ after)
        if wanted is None and not _is_worth(data, further[-1], whole, before, after):
            # The first of two modes that lie together may win little alone; heavily damped ones stand for a remainder.
            tried = largest > _CLEARLY and len(poles) + 1 < most and clock.begins()
            further, after = _with_one_more(data, further) if tried else (further, after)
            light = bool(np.all(further[-2:, 1] < np.log(_LIGHT)))
            if not (tried and light and _is_worth(data, further[-1], whole, before, after)):
                said = f"a further one would remove {gain / whole:.2g} of the sum of squares"
                return poles, f"{_count(poles)}; {said}; {fits}"
        poles, before = further, after


def _with_one_more(data: LineData, poles: Real) -> tuple[Real, Real]:
    """All poles refined with one more, and what they leave."""
    further = refine(np.vstack([poles, best_start(poles, data)]), data)
    return further, residual_rows(further, data)


def _is_worth(data: LineData, pole: Real, whole: float, before: Real, after: Real) -> bool:
    gain, left = float(before @ before - after @ after), float(before @ before)
    return gain >= _WORTH * whole or gain >= _WORTH_LEFT * left or _explains(data, pole, before, after)


def _explains(data: LineData, pole: Real, before: Real, after: Real) -> bool:
    """True if a mode removes nine tenths of what was around it, beyond the bounds: small beside others, and there all the same."""
    turn, zeta = np.exp(pole)
    around = np.zeros(data.angle.size, bool)
    around[nearest(data.angle, turn, _NEAR[0] * zeta * turn, _NEAR[1])] = True
    places = np.concatenate([around[there] for there in data.measured])
    was, left = ratios(before)[places], ratios(after)[places]
    return bool(was.max() > 1 and np.sum(left**2) <= (1 - _WORTH_NEAR) * np.sum(was**2))


def _count(poles: Real) -> str:
    return f"{len(poles)} mode{'s' * (len(poles) != 1)}"


def best_start(poles: Real, data: LineData) -> Real:
    """The pole on a grid whose pair removes most of the residual."""
    lines = data.angle.size
    # Between the frequency points too: the resonance of a light mode usually lies there.
    place = np.interp(np.linspace(0, lines - 1, min(8 * lines, PLACES)), np.arange(lines), data.angle)
    place = place[(place > 0) & (place < np.pi)]
    best, where = -np.inf, np.zeros(2)
    entries = list(zip(data.each, _projected(data, poles), data.measured, strict=True))
    least = lightest(data.angle)
    lighter: Real = least * (float(_START[0]) / least) ** (np.arange(_DENSE) / _DENSE)
    dampings = np.append(lighter, _START) if least < DAMPING[0] else _START
    for zeta in dampings:
        tried = np.log(np.stack([place, np.full(place.size, zeta)], axis=1))
        functions = _first_functions(data.angle, tried)
        gain = np.sum([_gains(one, fit, functions[there]) for one, fit, there in entries], axis=0)
        if gain.max() > best:
            best, where = gain.max(), tried[int(np.argmax(gain))]
    return where


def _first_functions(angle: Real, poles: Real) -> Complex:
    """The first function of the `pole_pair` of each of many poles, (F, T)."""
    back, (turn, zeta) = np.exp(-1j * angle)[:, None], np.exp(poles).T
    a = np.exp((-zeta + 1j * np.sqrt(1 - zeta**2)) * turn)
    return np.asarray(1 / (1 - back * (2 * a.real - np.abs(a) ** 2 * back)), dtype=complex)


def _gains(data: LineData, fit: Projection, functions: Complex) -> Real:
    """Reduction by a further pair, for the `_first_functions` of each, of the sum of squares of one entry.

    The other function of a pair is 1/z times the first one: products with both are products with the first.
    """
    back, half = np.exp(-1j * data.angle), data.angle.size
    rows = np.column_stack([fit.basis, fit.residual])  # the residual is orthogonal to the basis
    left = ((rows[:half] - 1j * rows[half:]) / data.bound[:, None]).T
    first, second = (np.real(part @ functions) for part in (left, left * back))
    sizes = (np.abs(functions) ** 2).T / data.bound**2
    square, mixed = sizes.sum(axis=1), sizes @ np.cos(data.angle)
    gram = np.empty((square.size, 2, 2))
    gram[:, 0, 0] = square - np.sum(first[:-1] ** 2, axis=0)
    gram[:, 1, 1] = square - np.sum(second[:-1] ** 2, axis=0)
    gram[:, 0, 1] = gram[:, 1, 0] = mixed - np.sum(first[:-1] * second[:-1], axis=0)
    gram += 1e-12 * square[:, None, None] * np.eye(2)
    moment = np.stack([first[-1], second[-1]], axis=1)
    weights = np.asarray(np.linalg.solve(gram, moment[..., None]), dtype=float)[..., 0]
    return np.einsum("ni,ni->n", moment, weights)


def refine(poles: Real, data: LineData) -> Real:
    """All poles together, from a start, by nonlinear least squares."""
    positive = data.angle[data.angle > 0]
    low = np.log([positive[0] / BELOW, lightest(data.angle)])
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


def lightest(angle: Real) -> float:
    """Lowest damping ratio at which poles are looked for: points a millionth of their frequency apart show one of 10^-6 too."""
    positive = np.unique(angle[angle > 0])
    return min([DAMPING[0], float(np.median(np.diff(positive) / positive[1:]))] if positive.size > 1 else DAMPING[:1])


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

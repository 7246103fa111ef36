"""Lines and parts of the axis that one rational model of a whole entry does not follow, where its neighbours alone cannot tell."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from robustid.core import Complex, Real
from robustid.data import FrequencyResponse
from robustid.estimation.axis_parts import Jump, of_resonance
from robustid.estimation.outlying_lines import NARROW, Odd, noise_in_bounds
from robustid.estimation.pole_fit import PoleFit, fractions

_CHANCE = 1e-4  # of a false alarm, over all places of all entries
_ORDERS = (4, 6, 8, 12, 16, 20)
_A_POLE, _FEWEST, _MOST = 6, 48, 2000  # lines; and lines of all entries
_AS_GOOD, _UNCERTAIN = (
    1.2,
    2.0,
)  # times the noise that local models find, and deviations of it: the model is one of the whole entry
_EDGE = 6  # lines on either side of a jump
_PART = 0.5  # of a bound, that a jump takes in both parts at least
_KNOWN = 1e-6  # part of what a change moves that the model doesn't follow
_QUIET = 12.0  # of chi-squared of a line beside, which a mode of some width would move too
_FEW = 0.1  # of the lines
_SEVERAL, _SPARED = 3, 3.0  # lines beyond their bounds; deviations of the model
_RELATED = 3.0  # deviations of a correlation of neighbours


class WholeModel(NamedTuple):
    """Rational model of one entry, in units of its bound: values, what it leaves, and an orthonormal basis of all it can follow."""

    values: Complex  # (F,) of the model
    left: Real  # (2 F,): real parts, then imaginary parts
    basis: Real  # (2 F, n)
    variance: float  # of every number that is left
    noise: float  # that local models find, rms

    @property
    def spare(self) -> int:
        """Numbers that are left over."""
        return len(self.left) - self.basis.shape[1]

    @property
    def white(self) -> bool:
        """Return whether what it leaves is unrelated from line to line: no model of too low an order."""
        left = self.left[: self.values.size] + 1j * self.left[self.values.size :]
        related = abs(complex(left[1:] @ left[:-1].conj())) / max(float(np.linalg.norm(left)) ** 2, 1e-300)
        return related * float(np.sqrt(left.size)) < _RELATED

    def as_good(self, removed: float, most: float = _AS_GOOD) -> bool:
        """Return whether it leaves at most so many times what local models do, without squares so many times the variance."""
        share = max(1 - removed / self.spare, 0.0)
        return bool(np.sqrt(2 * self.variance * share) <= most * self.noise)


def whole_models(frf: FrequencyResponse) -> dict[int, WholeModel]:
    """Models of the entries, by number, row by row; none of long or short responses, nor of those without bounds."""
    entries, lines = frf.values[0].size, frf.omega.size
    if frf.bound is None or lines < _FEWEST or lines * entries > _MOST or np.any(frf.missing):
        return {}
    if np.any(np.diff(frf.omega) <= 0):
        return {}
    each = {k: frf.entry(*divmod(k, frf.values.shape[2])) for k in range(entries)}
    return {k: found for k, one in each.items() if np.any(one.values) and (found := _whole(one)) is not None}


def _whole(one: FrequencyResponse) -> WholeModel | None:
    """Model of the order with the smallest Bayesian information criterion."""
    bound = one.bound.outer_radius.reshape(-1)
    if not np.all(bound > 1e-12 * float(np.abs(one.values).max())):
        return None
    fit, count = PoleFit(one, feedthrough=True), 2 * bound.size
    fit.weight = (1 / bound)[:, None]
    right = _real(one.values.reshape(-1) / bound)
    best: tuple[float, Complex, Real, Complex] | None = None
    for order in _ORDERS:
        if order * _A_POLE > bound.size:
            break
        poles = fit.search(order, np.zeros(1), decades=False)[1][0]
        if _needle(poles, one):
            continue
        functions = np.hstack([fractions(fit.x, poles), np.ones((bound.size, 1))]) / bound[:, None]
        rows = _real(functions)
        solved = np.asarray(np.linalg.lstsq(rows, right, rcond=None)[0], dtype=float)
        left = right - rows @ solved
        criterion = count * float(np.log(max(float(left @ left), 1e-300))) + 2 * rows.shape[1] * float(np.log(count))
        if best is None or criterion < best[0]:
            best = (criterion, poles, rows, np.asarray(functions @ solved, dtype=complex))
    if best is None:
        return None
    _, poles, rows, values = best
    moved = np.hstack([rows, _real(_second(fit.x, poles) / bound[:, None])])  # the poles may move
    basis = np.linalg.qr(moved / np.linalg.norm(moved, axis=0))[0]
    left = right - basis @ (basis.T @ right)
    spare = count - basis.shape[1]
    power = float(left @ left)
    if spare < count / 2 or power <= 1e-24 * float(right @ right):
        return None
    return WholeModel(values, left, basis, power / spare, noise_in_bounds(one))


def _needle(poles: Complex, one: FrequencyResponse) -> bool:
    """Return whether a pole shows on one line only: that line would be explained by it, whatever it is."""
    if one.dt is None:
        place, width = np.imag(poles) * one.omega[-1], np.abs(np.real(poles)) * one.omega[-1]
    else:
        place, width = np.angle(poles) / one.dt, np.abs(np.log(np.maximum(np.abs(poles), 1e-300))) / one.dt
    steps = np.diff(one.omega)
    spacing = steps[np.clip(np.searchsorted(one.omega, place) - 1, 0, steps.size - 1)]
    inside = (place > one.omega[0]) & (place < one.omega[-1])
    return bool(np.any(inside & (width < NARROW * spacing)))


def _second(x: Complex, poles: Complex) -> Complex:
    """Functions by which a sum of fractions changes where its poles move."""
    columns: list[Complex] = []
    for pole in poles:
        own, other = 1 / (x - pole) ** 2, 1 / (x - np.conj(pole)) ** 2
        columns += [own + other, 1j * (own - other)] if pole.imag else [own]
    return np.stack(columns, axis=1)


def _real(values: np.ndarray) -> Real:
    return np.concatenate([np.real(values), np.imag(values)])


# --- lines ---------------------------------------------------------------------------------------------------------------------


def odd_lines(models: dict[int, WholeModel]) -> list[Odd]:
    """Lines that are off by more than their bound, while those beside them are not off at all."""
    found: list[Odd] = []
    total = sum(one.values.size for one in models.values())
    for k, one in models.items():
        lines = one.values.size
        square, away = _own(one)
        limit = 2 * np.log(max(total, 1) / _CHANCE)
        beside = np.maximum(np.append(square[1:], 0), np.insert(square[:-1], 0, 0))
        odd = np.flatnonzero((square > limit) & (away > 1) & (beside < _QUIET))
        most = _AS_GOOD + _UNCERTAIN / np.sqrt(one.spare)
        if odd.size <= max(1, _FEW * lines) and one.as_good(float(square[odd].sum()), most):
            part = away[odd] / np.maximum(np.abs(one.values[odd]), np.finfo(float).tiny)
            scatter = np.sqrt(square[odd] / 2)
            found += [
                Odd(int(at), k, float(a), float(s), float(p))
                for at, a, s, p in zip(odd, away[odd], scatter, part, strict=True)
            ]
    return sorted(found)


def _own(one: WholeModel) -> tuple[Real, Real]:
    """Chi-squared of every line that was left out, two degrees of freedom; and how far it is off, in bounds."""
    lines = one.values.size
    rows = np.stack([one.basis[:lines], one.basis[lines:]], axis=1)  # (F, 2, n)
    kept = np.eye(2) - rows @ rows.swapaxes(1, 2)
    kept += 1e-9 * np.eye(2)
    left = np.stack([one.left[:lines], one.left[lines:]], axis=1)[:, :, None]
    off = np.linalg.solve(kept, left)
    return np.sum(left * off, axis=(1, 2)) / one.variance, np.linalg.norm(off[:, :, 0], axis=1)


def beyond_bounds(models: dict[int, WholeModel]) -> float:
    """Largest residual in bounds, where several lines of an entry are left farther away than errors within them do; or 0.

    Errors of at most a bound move a model of least squares by what its parameters take: three deviations of that are spared.
    """
    largest = 0.0
    for one in models.values():
        lines = one.values.size
        left = np.sort(np.hypot(one.left[:lines], one.left[lines:]))[::-1]
        moved = np.sqrt(2 * one.variance * one.basis.shape[1] / (2 * lines))
        several = left.size > _SEVERAL and left[_SEVERAL - 1] > 1 + _SPARED * moved
        if several and one.as_good(0.0) and one.white:
            largest = max(largest, float(left[0]))
    return largest


# --- jumps ---------------------------------------------------------------------------------------------------------------------


def jump_of_models(models: dict[int, WholeModel], omega: Real, entries: int) -> Jump | None:
    """The place from which on the entries have another gain, or another delay, than below it; None where there is none."""
    lines = omega.size
    if not models or lines < 4 * _EDGE:
        return None
    limit = 2 * float(np.log(2 * lines * len(models) / _CHANCE))
    seen = {
        k: [_steps(one, change) for change in (1.0 + 0 * omega, 1j * omega / omega[-1])] for k, one in models.items()
    }
    each = {k: np.maximum(gain[0], delay[0]) for k, (gain, delay) in seen.items()}
    evidence = np.sum([np.where(one > limit, one, 0) for one in each.values()], axis=0)
    upper = int(np.argmax(evidence))
    if evidence[upper] <= 0:
        return None
    factors, size = np.ones(entries, complex), 0.0
    for k, one in models.items():
        if each[k][upper] <= limit or not one.as_good(float(each[k][upper])):
            continue
        (gained, gain), (_, delay) = seen[k]
        own = (
            1 + gain[upper] if gained[upper] == each[k][upper] else np.exp(1j * delay[upper] * omega[upper] / omega[-1])
        )
        most = min(np.abs(one.values[:upper]).max(), np.abs(one.values[upper:]).max())  # of either part
        if np.abs(own - 1) * most > _PART and not of_resonance(complex(own)):
            factors[k], size = own, max(size, float(np.abs(own - 1) * np.abs(one.values[upper - 1 : upper + 1]).mean()))
    return Jump(upper, factors, size) if size > 0 else None


def _steps(one: WholeModel, change: NDArray[np.complexfloating] | Real) -> tuple[Real, Real]:
    """Chi-squared of a change of the model from every line on, one degree of freedom, and its size."""
    lines = one.values.size
    column = change * one.values
    a, b = np.real(column), np.imag(column)
    followed = _from(one.basis[:lines] * a[:, None] + one.basis[lines:] * b[:, None])
    power = _from(a**2 + b**2)
    left = power - np.sum(followed**2, axis=1)
    product = _from(a * one.left[:lines] + b * one.left[lines:])
    known = left > _KNOWN * power
    known[:_EDGE] = known[lines - _EDGE :] = False
    size = np.where(known, product / np.where(known, left, 1.0), 0.0)
    return size * product / one.variance, size


def _from(values: Real) -> Real:
    """Sums from every line on."""
    return np.asarray(np.cumsum(values[::-1], axis=0)[::-1], dtype=float)

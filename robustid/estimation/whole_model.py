"""Lines and parts of the axis that one rational model of a whole entry does not follow, where its neighbours alone cannot tell."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from robustid.core import Complex, Real, real_rows
from robustid.data import FrequencyResponse
from robustid.estimation.axis_parts import Jump, least_step, of_resonance
from robustid.estimation.local_models import mean_nearby, unlikely
from robustid.estimation.outlying_lines import NARROW, Odd, noise_in_bounds
from robustid.estimation.pole_fit import PoleFit, fractions

_CHANCE = 1e-4  # of a false alarm, over all places of all entries,
_OF_JUMP = 1e-3  # and of one at a jump,
_OF_PLACE = 1.0  # which is sought where something is seen,
_PLACES, _SIZES = 3, 2  # at so many places, by so many models
_ORDERS = (4, 6, 8, 12, 16, 20)
_MORE = (0, 1, 2)  # poles, beside the order of a model of a change
_A_POLE, _FEWEST, _MOST = 6, 48, 2000  # lines; and lines of all entries
_AS_GOOD, _UNCERTAIN = (
    1.2,
    2.0,
)  # times the noise that local models find, and deviations of it: the model is one of the whole entry
_STEPS = 40  # of least squares, after the poles are relocated: what relocation leaves is not noise
_EDGE = 6  # lines on either side of a jump
WINDOW = 256  # lines around such a place that refined models follow: modes farther away are smooth there
_NEAR = 2  # lines beside the most likely place of a jump, where it may be as well
_PART = 0.5  # of a bound, that a jump takes in both parts at least
_KNOWN = 1e-6  # part of what a change moves that the model doesn't follow
_QUIET = 12.0  # of chi-squared of a line beside, which a mode of some width would move too
_FEW = 0.1  # of the lines
_AROUND = 24  # lines on either side that tell the scatter at a line; and half of them, which a median is worth
_SEVERAL, _SPARED = 3, 3.0  # lines beyond their bounds; deviations of the model
_RELATED = 3.0  # deviations of a correlation of neighbours


class WholeModel(NamedTuple):
    """Rational model of one entry, in units of its bound: values, what it leaves, and an orthonormal basis of all it can follow."""

    values: Complex  # (F,) of the model
    left: Real  # (2 F,): real parts, then imaginary parts
    basis: Real  # (2 F, n)
    variance: float  # of every number that is left
    noise: float  # that local models find, rms
    dof: float | None  # of the scatter from which the bound of a line was taken; None: known
    order: int
    criterion: float

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


class _Fitted(NamedTuple):
    """Poles, the rows of their functions, the values that these take, and the criterion of that."""

    criterion: float
    order: int  # of the search for the poles
    poles: Complex
    rows: Real
    values: Complex


def whole_models(frf: FrequencyResponse, *, refined: bool = False) -> dict[int, WholeModel]:
    """Models of the entries, by number, row by row; none of long or short responses, nor of those without bounds.

    Relocated poles are soon found and leave some of the response; those that are `refined`, by least squares, leave its noise, but
    follow a part of its faults too.
    """
    entries, lines = frf.values[0].size, frf.omega.size
    if frf.bound is None or lines < _FEWEST or lines * entries > _MOST or np.any(frf.missing):
        return {}
    if np.any(np.diff(frf.omega) <= 0):
        return {}
    each = {k: _entry(frf, k) for k in range(entries)}
    return {k: found for k, one in each.items() if np.any(one.values) and (found := _whole(one, refined)) is not None}


def _entry(frf: FrequencyResponse, number: int) -> FrequencyResponse:
    return frf.entry(*divmod(number, frf.values.shape[2]))


def _whole(
    one: FrequencyResponse, refined: bool, orders: Sequence[int] = _ORDERS, *, beyond: bool = False
) -> WholeModel | None:
    """Model of the order with the smallest Bayesian information criterion, of these; also with a mode `beyond` the band."""
    bound = one.bound.outer_radius.reshape(-1)
    if not np.all(bound > 1e-12 * float(np.abs(one.values).max())):
        return None
    best, fit = _of_least_criterion(one, refined, orders, beyond)
    if best is None:
        return None
    right = real_rows(one.values.reshape(-1) / bound)
    moved = np.hstack([best.rows, real_rows(_second(fit.x, best.poles) / bound[:, None])])  # the poles may move
    basis = np.linalg.qr(moved / np.linalg.norm(moved, axis=0))[0]
    left = right - basis @ (basis.T @ right)
    spare = right.size - basis.shape[1]
    power = float(left @ left)
    if spare < right.size / 2 or power <= 1e-24 * float(right @ right):
        return None
    noise, dof = noise_in_bounds(one), one.bound.dof
    return WholeModel(best.values, left, basis, power / spare, noise, dof, best.order, best.criterion)


def _of_least_criterion(
    one: FrequencyResponse, refined: bool, orders: Sequence[int], beyond: bool
) -> tuple[_Fitted | None, PoleFit]:
    bound = one.bound.outer_radius.reshape(-1)
    fit, count = PoleFit(one, feedthrough=True), 2 * bound.size
    fit.weight = (1 / bound)[:, None]
    right = real_rows(one.values.reshape(-1) / bound)
    best: _Fitted | None = None
    for order in orders:
        if order * _A_POLE > bound.size:
            break
        for poles in _starts(fit, order, beyond):
            if refined:
                poles, rows = _followed(fit, one, bound, right, poles)
            else:
                rows = _rows(fit, poles, bound)
                if _alone(poles, one, rows, right):
                    continue
            solved = np.asarray(np.linalg.lstsq(rows, right, rcond=None)[0], dtype=float)
            power = max(float(np.sum((right - rows @ solved) ** 2)), 1e-300)
            criterion = count * float(np.log(power)) + 2 * rows.shape[1] * float(np.log(count))
            if best is None or criterion < best.criterion:
                best = _Fitted(criterion, order, poles, rows, _complex(rows @ solved))
    return best, fit


def _starts(fit: PoleFit, order: int, beyond: bool) -> Iterator[Complex]:
    """Relocated poles of an order; also two fewer, and a mode beyond the band."""
    yield fit.search(order, np.zeros(1), decades=False)[1][0]
    if beyond and order > 2:
        yield fit.beyond(fit.search(order - 2, np.zeros(1), decades=False)[1][0])


def _rows(fit: PoleFit, poles: Complex, bound: Real) -> Real:
    """Functions of the poles, and a constant, in units of the bound."""
    return real_rows(np.hstack([fractions(fit.x, poles), np.ones((bound.size, 1))]) / bound[:, None])


def _followed(fit: PoleFit, one: FrequencyResponse, bound: Real, right: Real, poles: Complex) -> tuple[Complex, Real]:
    """Poles of least squares from a start, without those that explain one line only, and the rows of their functions."""
    while True:
        poles = fit.refine(0.0, poles, held=True, steps=_STEPS).poles
        rows = _rows(fit, poles, bound)
        if not (alone := _alone(poles, one, rows, right)):
            return poles, rows
        poles = np.delete(poles, alone)


def _alone(poles: Complex, one: FrequencyResponse, rows: Real, right: Real) -> list[int]:
    """Poles that explain a single line, or two: whatever these are."""
    return [number for number, *place in _needles(poles, one) if not _seen_beside(rows, right, *place)]


def _needles(poles: Complex, one: FrequencyResponse) -> list[tuple[int, list[int], list[int]]]:
    """Number and columns of each pole that is narrower than the lines are apart, and the two lines between which it is."""
    if one.dt is None:
        place, width = np.abs(np.imag(poles)) * one.omega[-1], np.abs(np.real(poles)) * one.omega[-1]
    else:
        place, width = np.abs(np.angle(poles)) / one.dt, np.abs(np.log(np.maximum(np.abs(poles), 1e-300))) / one.dt
    steps = np.diff(one.omega)
    below = np.clip(np.searchsorted(one.omega, place) - 1, 0, steps.size - 1)
    inside = (place > one.omega[0]) & (place < one.omega[-1])
    wide = 1 + (np.imag(poles) != 0)
    first = np.cumsum(wide) - wide
    return [
        (int(k), list(range(int(first[k]), int(first[k] + wide[k]))), [int(below[k]), int(below[k]) + 1])
        for k in np.flatnonzero(inside & (width < NARROW * steps[below]))
    ]


def _seen_beside(rows: Real, right: Real, columns: list[int], lines: list[int]) -> bool:
    """Return whether the other lines need these columns too, as those around a narrow mode do."""
    count = right.size // 2
    kept = np.delete(np.arange(2 * count), [*lines, *(count + line for line in lines)])
    rest, fewer = right[kept], np.delete(rows[kept], columns, axis=1)
    with_, without = (
        float(np.sum((rest - one @ np.linalg.lstsq(one, rest, rcond=None)[0]) ** 2)) for one in (rows[kept], fewer)
    )
    spare = kept.size - rows.shape[1]
    return spare > 0 and (without - with_) * spare > 2 * np.log(count / _CHANCE) * with_


def _second(x: Complex, poles: Complex) -> Complex:
    """Functions by which a sum of fractions changes where its poles move."""
    columns: list[Complex] = []
    for pole in poles:
        own, other = 1 / (x - pole) ** 2, 1 / (x - np.conj(pole)) ** 2
        columns += [own + other, 1j * (own - other)] if pole.imag else [own]
    return np.stack(columns, axis=1) if columns else np.zeros((x.size, 0), complex)


def _complex(rows: Real) -> Complex:
    return rows[: rows.size // 2] + 1j * rows[rows.size // 2 :]


# --- lines ---------------------------------------------------------------------------------------------------------------------


def odd_lines(models: dict[int, WholeModel]) -> list[Odd]:
    """Lines that are off by more than their bound, while those beside them are not off at all."""
    found: list[Odd] = []
    total = sum(one.values.size for one in models.values())
    for k, one in models.items():
        lines = one.values.size
        square, away = _own(one)
        limit = np.log(max(total, 1) / _CHANCE)
        beside = np.maximum(np.append(square[1:], 0), np.insert(square[:-1], 0, 0))
        # A bound from few residuals is small by chance at some lines: their errors in units of it are F distributed.
        chance = square / 2 if one.dof is None else unlikely(square / 2, one.dof)
        # Nor is the scatter of what a bound leaves out, as distortion at a resonance, the same everywhere.
        chance = np.minimum(chance, unlikely(square / mean_nearby(square, _AROUND), _AROUND))
        odd = np.flatnonzero((chance > limit) & (away > 1) & (beside < _QUIET))
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


def beyond_bounds(models: dict[int, WholeModel], *, poor: bool = False) -> float:
    """Largest residual in bounds, where several lines of an entry are left farther away than errors within them do; or 0.

    Errors of at most a bound move a model of least squares by what its parameters take: three deviations of that are spared. A
    `poor` model, too simple for the response, leaves more than its errors: it shows only where none can be beyond a bound.
    """
    largest = 0.0
    for one in models.values():
        lines = one.values.size
        left = np.hypot(one.left[:lines], one.left[lines:])
        beside = np.maximum(np.append(left[1:], 0), np.insert(left[:-1], 0, 0))
        left = np.sort(left[left >= beside])[::-1]  # lines beside each other that are off are a mode's
        moved = np.sqrt(2 * one.variance * one.basis.shape[1] / (2 * lines))
        several = left.size > _SEVERAL and left[_SEVERAL - 1] > 1 + _SPARED * moved
        if several and (poor or (one.as_good(0.0) and one.white)):
            largest = max(largest, float(left[0]))
    return largest


# --- jumps ---------------------------------------------------------------------------------------------------------------------


def jump_of_models(models: dict[int, WholeModel], frf: FrequencyResponse) -> Jump | None:
    """The place from which on the entries have another gain, or another delay, than below it; None where there is none."""
    omega, lines, entries = frf.omega, frf.omega.size, frf.values[0].size
    if not models or lines < 4 * _EDGE:
        return None
    limit = 2 * float(np.log(2 * lines * len(models) / _OF_PLACE))
    seen = {
        k: [_steps(one, change) for change in (1.0 + 0 * omega, 1j * omega / omega[-1])] for k, one in models.items()
    }
    each = {k: np.maximum(gain[0], delay[0]) for k, (gain, delay) in seen.items()}
    evidence = np.sum([np.where(one > limit, one, 0) for one in each.values()], axis=0)

    @functools.cache
    def plain(k: int, first: int) -> WholeModel | None:
        return _whole(_entry(frf, k).select(slice(first, first + WINDOW)), True)

    looked_at = set[int]()
    for peak in _peaks(evidence):
        first = max(min(peak - WINDOW // 2, lines - WINDOW), 0)
        for upper in _beside(peak, lines):
            if upper in looked_at:
                continue
            looked_at.add(upper)
            factors, size, nearly = np.ones(entries, complex), 0.0, False
            for k, one in models.items():
                if each[k][upper] <= limit or not one.as_good(float(each[k][upper])):
                    continue
                if (whole := plain(k, first)) is None:
                    continue
                gain, delay = ((float(chi[upper]), float(step[upper])) for chi, step in seen[k])
                delayed = delay > gain
                change, gained = _needed(_entry(frf, k), upper, first, whole, (delay if delayed else gain)[1], delayed)
                nearly |= gained > np.log(2 * lines)
                own, values = complex(change[upper]), np.abs(one.values)
                largest = min(values[:upper].max(), values[upper:].max())  # of either part
                if gained > _price(lines) and np.abs(own - 1) * largest > _PART and not of_resonance(own):
                    factors[k], size = own, max(size, float(np.abs(own - 1) * values[upper - 1 : upper + 1].mean()))
            if size > 0 and size >= least_step(frf):
                return Jump(upper, factors, size)
            if upper == peak and not nearly:
                break
    return None


def _peaks(evidence: Real) -> list[int]:
    """The most likely places, away from each other."""
    left, found = evidence.copy(), list[int]()
    while len(found) < _PLACES and np.any(left > 0):
        found.append(int(np.argmax(left)))
        left[max(found[-1] - _NEAR, 0) : found[-1] + _NEAR + 1] = 0
    return found


def _beside(peak: int, lines: int) -> list[int]:
    """A place and those near it, by distance."""
    return sorted(range(max(peak - _NEAR, 0), min(peak + _NEAR + 1, lines)), key=lambda upper: abs(upper - peak))


def _price(lines: int) -> float:
    """Least gain of a change in the criterion: it is one number more, sought at all places."""
    return float(np.log(2 * lines) + 2 * np.log(2 * lines / _OF_JUMP))


def _needed(
    one: FrequencyResponse, upper: int, first: int, plain: WholeModel, size: float, delayed: bool
) -> tuple[Complex, float]:
    """The change from a line on, and by how much models are better without it; its size is that of such a model.

    The first size is of a model that follows a part of the change with poles of its own. Without it no more poles are needed, and
    at least half of them; nor do one or two poles more, or a mode beyond the band, do as well as the change. Models are of the
    window that begins at the first line, as the plain one is.
    """
    slope: Complex = 1j * one.omega / one.omega[-1]
    best, most = np.ones(one.omega.size, complex), 0.0
    window = slice(first, first + WINDOW)
    orders = [order for order in _ORDERS if plain.order // 2 <= order <= plain.order]
    for _ in range(_SIZES):
        change: Complex = np.exp(size * slope) if delayed else np.full(slope.size, 1 + size, complex)
        by = np.where(np.arange(slope.size) >= upper, change, 1)
        without = dataclasses.replace(one, values=one.values / by[:, None, None]).select(window)
        simpler = _whole(without, True, orders)
        if simpler is None:
            break
        gained = plain.criterion - simpler.criterion
        if gained > _price(slope.size):  # one or two poles more, or a mode beyond the band, may do as well
            between = _whole(one.select(window), True, [simpler.order + more for more in _MORE], beyond=True)
            gained = min(gained, np.inf if between is None else between.criterion - simpler.criterion)
        if gained > most:
            best, most = change, gained
        if most > _price(slope.size):
            break
        more = float(_steps(simpler, slope[window] if delayed else np.ones(simpler.values.size))[1][upper - first])
        size = size + more if delayed else (1 + size) * (1 + more) - 1
    return best, most


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

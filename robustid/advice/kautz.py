"""Kautz modes from a measured frequency response, with the interval of each pole that the data leave."""

from __future__ import annotations

import dataclasses
import functools
import logging
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from robustid.advice.pole_fit import (
    BELOW,
    DAMPING,
    LineData,
    best_start,
    checked_lines,
    find_poles,
    lightest,
    ratios,
    refine_beside,
    residual_rows,
    smallest_remainder,
    told_apart,
    wanted_in_basis,
)
from robustid.advice.pole_interval import (
    PoleBox,
    bounded_by_shown,
    damped_outside,
    mode_intervals,
    pole_interval,
    shown_in,
    with_shown,
)
from robustid.advice.real_poles import RealPoles, explain_more, over_decades, slow_poles
from robustid.advice.step_clock import StepClock
from robustid.bases import ParametricBasis, kautz
from robustid.core import Budget, Frozen, Real, as_count, freeze, hz_scale, hz_words, one_thread
from robustid.data import FrequencyResponse
from robustid.errors import InputError
from robustid.guarantees import told_apart_of

_log = logging.getLogger("robustid")

_DOUBLE = 1 - 1e-6  # damping of a pair from which on it is a double real pole but for rounding
_SLOWER = 1e-3  # times the lowest frequency point: a real pole there is 1/s at all points
_FASTER, _FASTEST = 30.0, 300.0  # times the highest frequency point: for a real pole over decades, and for one more
_FREE = (
    "; a mode below the first frequency point may stand for a machine that is free to move: in its place integrators = 2"
    " (1 from torque to speed)"
)
_BEYOND = 2.0  # times the highest frequency point, or so far below the lowest: a pole is no mode there, but a slope
_TWICE = 2  # a real pole of a process: errors of its place do not matter to first order


@dataclasses.dataclass(frozen=True, eq=False, kw_only=True)
class KautzSuggestion(Frozen):
    """Modes that the data show, the interval that the data leave to each pole, and the basis made of them.

    Attributes
    ----------
    omega, damping : (M,) arrays, rad/s and 1
        Natural frequencies, ascending, and damping ratios.
    omega_interval, damping_interval : (M, 2) arrays
        Ends of the set of poles with which a local fit keeps its residuals within `level` times the bounds.
    level : (M,) array
        1 where the bounds allow the fit; else twice the factor on the bounds that the best local fit needs.
    reached : (M,) array of bool
        The set reaches an end of the range that was searched: it may go on beyond it.
    share : (M,) array
        Part of all values, of all entries, that the local fit used.
    linear : (M, 2, 2) array
        Logarithms of omega and damping by local least squares, and the most that errors as large as the bounds move each, or NaN.
    basis : ParametricBasis or None
        ``kautz(omega, damping, dt=..., repeat=..., delay=...)``; None where no mode was found.
    repeat : int
        Multiplicity of each pole in `basis`: that which was asked, and 2 at least of the real poles of a sampled plant without
        modes, so that errors of their places do not matter to first order.
    delay : int, samples
    reason : str
        What was done and why it stopped, in words.
    complete : bool
        False where the time was over before the search came to its end: there may be further modes.
    """

    omega: Real
    damping: Real
    omega_interval: Real
    damping_interval: Real
    level: Real
    reached: NDArray[np.bool_]
    share: Real
    linear: Real
    basis: ParametricBasis | None
    repeat: int
    delay: int
    reason: str
    complete: bool = True

    def __post_init__(self) -> None:
        names = ("omega", "damping", "omega_interval", "damping_interval", "level", "reached", "share", "linear")
        self._set(**{name: freeze(getattr(self, name)) for name in names})

    @property
    def undetermined(self) -> NDArray[np.bool_]:
        """True where the set `reached` an end of the search, or the damping interval spans a factor of two or more, (M,)."""
        return self.reached | (self.damping_interval[:, 1] >= 2 * self.damping_interval[:, 0])

    def summary(self) -> str:
        """One line per mode, then the reason."""
        lines: list[str] = []
        for k, (w, z) in enumerate(zip(self.omega / (2 * np.pi), self.damping, strict=True)):
            low, high = self.omega_interval[k] / (2 * np.pi)
            size, unit = hz_scale(high)
            lightest, heaviest = self.damping_interval[k]
            text = f"mode {k + 1}: {w / size:.5g} {unit} ({low / size:.5g} to {high / size:.5g}),"
            text += f" damping {z:.3g} ({lightest:.3g} to {heaviest:.3g})"
            if z == lightest == heaviest == 1:
                lines.append(f"real pole {k + 1}: {hz_words(w)}")
                continue
            if self.level[k] > 1:
                text += f", with bounds times {self.level[k]:.3g}"
            if self.undetermined[k]:
                text += "; the frequency points hardly determine its damping"
                text += ": measure more of them around it" if self.level[k] == 1 else " once the bounds are so wide"
            lines.append(text)
        return "\n".join([*lines, self.reason])


@one_thread()
def suggest_kautz(
    frf: FrequencyResponse,
    *,
    dt: float | None = None,
    modes: int | None = None,
    delay: int | None = None,
    repeat: int = 1,
    time_limit: float | None = None,
) -> KautzSuggestion:
    """Find the lightly damped modes of a frequency response and the pole positions that its bounds leave.

    Fits ``F(z) = sum_i z^-delay (b_i + c_i z^-1)/(1 - 2 Re a_i z^-1 + |a_i|^2 z^-2) + d_0 + d_1 z^-1 + d_2 z^-2`` in units of
    the bounds. Given the poles, everything else is linear least squares (variable projection). One mode after another is added
    where, on a grid of poles, a pair removes most of what remains, and all poles are refined together.

    Parameters
    ----------
    frf : FrequencyResponse
        Frequency points that are missing are left out; the modes are common to all entries. Without `bound`, 5 % of the
        magnitude takes its place; of an ellipse, the disc around it; of a joint bound, that of each entry alone.
    dt : float, s
        Sample time of the basis; default that of `frf`, whose modes are those of a continuous model where it has none.
    modes : int
        How many. Default: until the residuals are within the bounds, or the next mode removes less than 0.3 % of the
        sum of squares (relative to the bounds) that there was without modes, of which it removes less than 75 % of what is left,
        and less than 90 % of what is left around it; 20 at most. Of these, modes that fit as well with heavy damping, and the
        heavier one of two that the points do not tell apart, are left to the gain bound. Where none remains, a sampled plant is
        one without modes, a process: the slow real poles of partial fractions that keep to the bounds.
    delay : int, samples
        Of the pairs; default: the one of 0 to 3 that leaves the smallest remainder beside the modes; of a process, the one with
        which the fewest real poles keep to the bounds.
    repeat : int
        Multiplicity of each pole in `basis` (see `kautz`).
    time_limit : float, optional
        Seconds, five at least: modes are not found by halves. The search ends with the modes that it has found when two thirds
        of them are over, and their intervals take the rest; `complete` says so.

    Returns
    -------
    KautzSuggestion

    Raises
    ------
    SizeError
        The first mode, or one of those that were asked for, would take longer than what is left of the time.
    InputError
        Too few frequency points for the modes asked, frequencies above pi/dt.
    InputTypeError
        Something that isn't a FrequencyResponse.

    Notes
    -----
    The interval of a mode comes from a local fit: frequency points within five half-widths (12 at least, 60 at most), this mode, a
    smooth remainder, double pairs for the modes nearby so that errors of their poles don't matter to first order, the others
    subtracted. A pole is left out only where weights w, summing to one, are found for which even the weighted
    least-squares fit has ``sum_k w_k |e_k/bound_k|^2 > level^2``, so that no fit of this kind keeps to the bounds (Lawson's
    iteration). The boundary is sought along 20 rays from the estimate: a set that isn't star-shaped can reach
    further. A mode that the records of the response show (`FrequencyResponse.modes`) and its bounds hide, or leave as heavy as may
    be, has the interval of the records: left to the gain bound it would stand in no class with a useful decay. Poles taken from
    the data are an assumption like any other: the data may leave much larger intervals than the fit suggests.

    Source: separable least squares, `golub1973`; minimax by reweighting, `lawson1961`; Kautz pairs, `inanc2001`
    equation (29).

    Examples
    --------
    >>> import numpy as np, robustid as rid
    >>> from robustid.advice import suggest_kautz
    >>> data = rid.datasets.flexible_structure(extra_hz=np.linspace(17.2, 18.1, 10))
    >>> found = suggest_kautz(data.frequency)
    >>> np.round(found.omega / (2 * np.pi), 1), np.round(found.damping, 3)
    (array([ 9. , 17.7]), array([0.1  , 0.004]))
    """
    fit = checked_lines(frf, dt)
    repeat = as_count("repeat", repeat, least=1)
    wanted = None if modes is None else as_count("modes", modes, least=1)
    fixed_delay = None if delay is None else as_count("delay", delay)
    if wanted is not None and wanted > fit.room:
        raise InputError(
            f"`modes` = {wanted}: {fit.angle.size} frequency points can't tell more than {fit.room} modes from a smooth"
            " remainder; ask for fewer modes, or give more frequency points"
        )
    budget, clock = Budget(time_limit), StepClock(*fit.size, time_limit)
    poles, reason = find_poles(fit, wanted, clock)
    lowest = float(frf.omega[frf.omega > 0].min(initial=np.inf))
    # Looked for where modes leave something, or none of them stands.
    decades = functools.cache(lambda: over_decades(frf, budget) if wanted is None and not fit.plane.dt else None)
    left = residual_rows(poles, fit)
    if ratios(left).max() > 1 and (real := decades()) is not None and explain_more(real, left, len(poles)):
        return _of_decades(fit, real, lowest, repeat)
    shown = shown_in(frf.modes if fit.plane.dt and wanted is None else (), fit)
    poles, kept, words = _kept(fit, poles, shown, wanted is not None)
    reason += words
    boxes: Sequence[PoleBox] = [
        bounded_by_shown(pole_interval(fit, poles, k), poles[k], shown, fit.angle) for k in kept.tolist()
    ]
    kept, boxes, words = _bounded(kept, boxes, fit) if wanted is None else (kept, boxes, "")
    reason += words
    step, edges = fit.plane.dt, _edges(boxes, fit)
    if wanted is None and (len(poles) or frf.doubt is not None) and not len(kept):  # none stands in a class
        if (real := decades()) is not None and real.largest <= 1:
            return _of_decades(fit, real, lowest, repeat)
        if fit.plane.dt and (slow := slow_poles(frf, budget, fixed_delay)) is not None:
            return _of_process(fit, slow, repeat)
        clock.ended |= budget.over
    omega, damping = fit.plane.modes(*np.exp(poles[kept]).T)
    below = omega < lowest / _BEYOND  # one pair may be a suspension; several, or nothing else, are a slope
    if below.any() and (below.all() or below.sum() > 1) and (real := decades()) is not None:
        return _of_decades(fit, real, lowest, repeat)
    if not step and wanted is None and np.any(far := omega > _BEYOND * frf.omega[-1]):
        edges[far] = np.stack([omega[far], damping[far]], axis=1)[:, :, None]
        reason += _far_words(int(np.sum(far)))
    if step and np.any(omega < frf.omega[0]):
        reason += _FREE
    chosen = 0
    if step:
        chosen = smallest_remainder(fit, poles[kept]) if fixed_delay is None else fixed_delay
    return KautzSuggestion(
        omega=omega,
        damping=damping,
        omega_interval=edges[:, 0],
        damping_interval=edges[:, 1],
        level=np.array([box.level for box in boxes]),
        reached=np.array([box.reached for box in boxes], bool),
        share=np.array([box.share for box in boxes]),
        linear=np.array([box.linear for box in boxes]).reshape(-1, 2, 2),
        basis=kautz(omega, damping, dt=step, repeat=repeat, delay=chosen) if len(kept) else None,
        repeat=repeat,
        delay=chosen,
        reason=reason,
        complete=not clock.ended,
    )


def _far_words(count: int) -> str:
    return (
        f"; {count} of them far above the frequency points: what rises or falls towards these has the pole's place as a"
        " choice, with no interval"
    )


def _bounded(
    kept: NDArray[np.int_], boxes: Sequence[PoleBox], fit: LineData
) -> tuple[NDArray[np.int_], Sequence[PoleBox], str]:
    """Modes whose places the points bound, with their intervals, and words on the others."""
    words = ""
    # In continuous time the ends are those of a bilinear variable, where a pole far above the corner is light whatever it is.
    (low, _), (least, most) = _edges(boxes, fit).transpose(1, 2, 0)
    limit, within = DAMPING[1] * (1 - 1e-6), low < fit.plane.omega(fit.angle[-1:])
    vague = (not fit.plane.dt) & within & (most >= limit) & (least <= most / 2)
    seen = [k for k, box in enumerate(boxes) if box.ends[1, 1] < limit and not vague[k]]
    if len(seen) < len(kept):
        words += f"; {len(kept) - len(seen)} of them as well with any damping: left out, the gain bound covers them"
    kept, boxes = kept[seen], [boxes[k] for k in seen]
    edges = _edges(boxes, fit)
    apart = told_apart_of(edges[:, 0], edges[:, 1])
    if apart.size < len(kept):
        words += (
            f"; {len(kept) - apart.size} of them so close to another, for what the points say of either, that nothing"
            " bounds their amplitudes: left out, the gain bound covers them"
        )
    return kept[apart], [box for k, box in enumerate(boxes) if k in apart], words


def _edges(boxes: Sequence[PoleBox], fit: LineData) -> Real:
    """Intervals of modes, (M, 2, 2)."""
    return mode_intervals(np.array([box.ends for box in boxes]).reshape(-1, 2, 2), fit.plane)


def _kept(fit: LineData, poles: Real, shown: Real, every: bool) -> tuple[Real, NDArray[np.int_], str]:
    """Poles with those that the records show, by rising frequency; which of them may stand in the basis; words on the others."""
    few, words = len(poles), ""
    poles = with_shown(poles, shown, fit.angle)
    if len(poles) > few:
        words += f"; {len(poles) - few} more that the records show within these bounds"
    poles = poles[np.argsort(poles[:, 0])]
    if every:
        return poles, np.arange(len(poles)), words
    found = damped_outside(fit, poles)
    poles = told_apart(found)
    if len(poles) < len(found):
        words += f"; {len(found) - len(poles)} of them coincide with others: left out"
    kept = np.flatnonzero(wanted_in_basis(poles, fit))
    if len(kept) < len(poles):
        words += f"; {len(poles) - len(kept)} of them outside the frequency points or well damped, and fast: left out"
    return poles, kept, words


def _of_decades(fit: LineData, found: RealPoles, lowest: float, repeat: int) -> KautzSuggestion:
    """Pairs with the intervals that the points leave, real poles with all that was searched: their places are a choice."""
    top = float(fit.plane.omega(fit.angle[-1:])[0])
    # The fastest one stands for the constant, which no other pole has; one that is faster than the last for a straight line.
    fast = (found.omega >= _FASTER * top) & (found.damping == 1)
    one = np.arange(found.omega.size) == np.argmax(fast)  # of several, of which the points see the same straight line
    slow = (found.omega < _SLOWER * lowest) & (found.damping == 1)  # likewise of 1/s, which has no place either
    one |= slow & (np.arange(found.omega.size) == np.argmax(slow))
    kept = ~(fast | slow) | one
    omega = np.append(np.clip(found.omega[kept], _SLOWER * lowest, _FASTER * top), _FASTEST * top)
    order = np.argsort(omega)
    omega, damping = omega[order], np.append(found.damping[kept], 1.0)[order]
    pair = damping < _DOUBLE
    ends = np.array([[max(lowest, 1e-6 * top) / BELOW, 2 * top], [1.0, 1.0]])
    edges, level, reached = np.tile(ends, (order.size, 1, 1)), np.ones(order.size), np.ones(order.size, bool)
    share, linear = np.ones(order.size), np.full((order.size, 2, 2), np.nan)
    pairs = np.log(np.stack(fit.plane.turned(omega[pair], damping[pair]), axis=1))
    for place, which in enumerate(np.flatnonzero(pair)):
        box, level[which], reached[which], share[which], linear[which] = pole_interval(fit, pairs, place)
        edges[which] = mode_intervals(box[None], fit.plane)[0]
    edges[:, 0] = np.stack([np.minimum(edges[:, 0, 0], omega), np.maximum(edges[:, 0, 1], omega)], axis=1)
    reason = (
        f"{found.omega.size} poles over {np.log10(top / lowest):.1f} decades, {np.sum(found.damping == 1)} of them real, and a"
        f" constant leave at most {found.largest:.3g} times the bound; modes beside a smooth remainder leave more, or none that a"
        " class could hold. Other real poles follow a plant that relaxes over decades as well: these are a choice, no property of"
        " it, and the fastest stands for the constant"
    )
    return KautzSuggestion(
        omega=omega,
        damping=damping,
        omega_interval=edges[:, 0],
        damping_interval=edges[:, 1],
        level=level,
        reached=reached,
        share=share,
        linear=linear,
        basis=kautz(omega, damping, dt=0, repeat=repeat),
        repeat=repeat,
        delay=0,
        reason=reason,
    )


def _of_process(fit: LineData, found: RealPoles, repeat: int) -> KautzSuggestion:
    """Real poles and heavily damped pairs of a sampled plant without modes: what decays faster is left to the gain bound."""
    repeat, one = max(repeat, _TWICE), np.ones(found.omega.size)
    step, lowest = fit.plane.dt, float(fit.plane.omega(fit.angle[fit.angle > 0][:1])[0])
    pair = found.damping < 1
    wide = np.array([min(lowest, float(found.omega[0])) / BELOW, np.pi / step])
    behind = f" behind {found.delay} sample{'s' * (found.delay > 1)} of delay" if found.delay else ""
    reason = (
        f"no mode; {found.words}{behind} and what decays faster leave at most {found.largest:.3g} times the bound. Each is taken"
        f" {repeat} times, which absorbs small errors of its place; others nearby follow the frequency points as well"
    )
    return KautzSuggestion(
        omega=found.omega,
        damping=found.damping,
        omega_interval=np.where(pair[:, None], found.omega[:, None], wide),
        damping_interval=np.repeat(found.damping[:, None], 2, axis=1),
        level=one,
        reached=np.ones(one.size, bool),
        share=one,
        linear=np.full((one.size, 2, 2), np.nan),
        basis=kautz(found.omega, found.damping, dt=step, repeat=repeat, delay=found.delay),
        repeat=repeat,
        delay=found.delay,
        reason=reason,
    )


def further_mode(frf: FrequencyResponse, omega: Real, damping: Real) -> tuple[float, float]:
    """Natural frequency and damping of the mode, in the measured range, that a fit with these and a smooth remainder lacks most."""
    data = checked_lines(frf, None)
    poles = np.log(np.stack(data.plane.turned(omega, damping), axis=1))
    start = best_start(poles, data)
    positive = data.angle[data.angle > 0]
    low, high = np.log([[positive[0], lightest(positive)], [min(positive[-1], 0.999 * np.pi), DAMPING[1]]])
    ((turn, zeta),) = np.exp(refine_beside(poles, start[None], data, low, high))
    one, zeta = data.plane.modes(np.array([turn]), np.array([zeta]))
    return float(one[0]), float(zeta[0])

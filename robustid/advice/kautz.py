"""Kautz modes from a measured frequency response, with the interval of each pole that the data leave."""

from __future__ import annotations

import dataclasses
import logging
from typing import Any

import numpy as np

from robustid._arrays import Frozen, as_count, as_positive, freeze
from robustid.bases import ParametricBasis, kautz
from robustid.data import FrequencyResponse
from robustid.errors import InputError, InputTypeError

_log = logging.getLogger("robustid")

_SMOOTH = 3  # terms 1, z^-1, z^-2 of the smooth rest
_MOST_MODES = 12
_MOST_LINES = 1000  # for the search; the interval of a mode uses the lines around it
# A further mode must remove this part of the sum of squares at the start, or this part of what is left.
_WORTH, _WORTH_LEFT = 0.003, 0.75
_DAMPING = (1e-5, 0.5)  # where poles are looked for; above the upper end nothing is lightly damped
_START = np.geomspace(1e-3, 0.2, 6)  # damping ratios at which the search starts
_DELAYS = range(4)  # samples
_RAYS = 16
_LOCAL = (12, 60)  # fewest and most lines of the local fit


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
    undetermined : (M,) array of bool
        The set reaches an end of the box that was searched, or the damping interval spans a factor of two or more.
    basis : ParametricBasis or None
        ``kautz(omega, damping, dt=..., repeat=..., delay=...)``; None where no mode was found.
    delay : int, samples
    reason : str
        What was done and why it stopped, in words.
    """

    omega: np.ndarray
    damping: np.ndarray
    omega_interval: np.ndarray
    damping_interval: np.ndarray
    level: np.ndarray
    undetermined: np.ndarray
    basis: ParametricBasis | None
    delay: int
    reason: str

    def __post_init__(self) -> None:
        names = ("omega", "damping", "omega_interval", "damping_interval", "level", "undetermined")
        self._set(**{name: freeze(getattr(self, name)) for name in names})

    def summary(self) -> str:
        """One line per mode, then the reason."""
        lines = []
        for k, (w, z) in enumerate(zip(self.omega / (2 * np.pi), self.damping, strict=True)):
            low, high = self.omega_interval[k] / (2 * np.pi)
            lightest, heaviest = self.damping_interval[k]
            text = f"mode {k + 1}: {w:.5g} Hz ({low:.5g} to {high:.5g}), damping {z:.3g} ({lightest:.2g} to {heaviest:.2g})"
            if self.level[k] > 1:
                text += f", with bounds times {self.level[k]:.3g}"
            if self.undetermined[k]:
                remedy = "measure more of them around it" if self.level[k] == 1 else "a mode so poorly fitted is a guess"
                text += f"; the lines hardly determine its damping: {remedy}"
            lines.append(text)
        return "\n".join([*lines, self.reason])


def suggest_kautz(
    frf: FrequencyResponse,
    *,
    dt: float | None = None,
    modes: int | None = None,
    delay: int | None = None,
    repeat: int = 1,
) -> KautzSuggestion:
    """Find the lightly damped modes of a frequency response and the pole positions that its bounds leave.

    Fits ``F(z) = sum_i z^-delay (b_i + c_i z^-1)/(1 - 2 Re a_i z^-1 + |a_i|^2 z^-2) + d_0 + d_1 z^-1 + d_2 z^-2`` in units of
    the bounds. Given the poles, the rest is linear least squares (variable projection). One mode after another is added
    where, on a grid of poles, a pair removes most of what remains, and all poles are refined together.

    Parameters
    ----------
    frf : FrequencyResponse
        One input, one output. Without `bound`, 5 % of the magnitude takes its place.
    dt : float, s
        Sample time of the basis; default that of `frf`.
    modes : int
        How many. Default: until the residuals are within the bounds, or the next mode removes less than 0.3 % of the
        sum of squares (relative to the bounds) that there was without modes and doesn't halve the residuals either.
    delay : int, samples
        Of the pairs; default: the one of 0 to 3 that leaves the smallest rest beside the modes.
    repeat : int
        Multiplicity of each pole in `basis` (see `kautz`).

    Returns
    -------
    KautzSuggestion

    Raises
    ------
    InputError
        More than one channel, no sample time, too few lines for the modes asked.
    InputTypeError
        Something that isn't a FrequencyResponse.

    Notes
    -----
    The interval of a mode comes from a local fit: lines within five half-widths (12 at least, 60 at most), this mode, a
    smooth rest, double pairs for the modes nearby so that errors of their poles don't matter to first order, the others
    subtracted. A pole is left out only where weights w, summing to one, are found for which even the weighted
    least-squares fit has ``sum_k w_k |e_k/bound_k|^2 > level^2``, so that no fit of this kind keeps to the bounds (Lawson's
    iteration). The boundary is sought along 20 rays from the estimate: a set that isn't star-shaped can reach
    further. Poles taken from the data are an assumption like any other: the data may leave much larger intervals than
    the fit suggests.

    Source: separable least squares, `golub1973`; minimax by reweighting, `lawson1961`; Kautz pairs, `inanc2001`
    equation (29).

    Examples
    --------
    >>> import numpy as np, robustid as rid
    >>> from robustid.advice import suggest_kautz
    >>> data = rid.flexible_structure(extra_hz=np.linspace(17.2, 18.1, 10))
    >>> found = suggest_kautz(data.frequency)
    >>> np.round(found.omega / (2 * np.pi), 1), np.round(found.damping, 3)
    (array([ 9. , 17.7]), array([0.1  , 0.004]))
    """
    fit = _checked(frf, dt)
    repeat = as_count("repeat", repeat, least=1)
    wanted = None if modes is None else as_count("modes", modes, least=1)
    fixed_delay = None if delay is None else as_count("delay", delay)
    if wanted is not None and wanted > fit.room:
        raise InputError(
            f"`modes` = {wanted}: {fit.angle.size} lines can't tell more than {fit.room} modes from a smooth rest; ask for"
            " fewer modes, or give more lines"
        )
    poles, reason = _search(fit, wanted)
    poles = poles[np.argsort(poles[:, 0])]
    kept = np.arange(len(poles)) if wanted is not None else np.flatnonzero(_among_lines(poles, fit))
    if len(kept) < len(poles):
        reason += f"; {len(poles) - len(kept)} of them outside the lines or well damped: left out"
    step = fit.dt
    omega, damping = np.exp(poles[kept]).T / np.array([[step], [1.0]])
    chosen = fixed_delay if fixed_delay is not None else _smallest_rest(fit, poles[kept])
    boxes = [_interval(fit, poles, i) for i in kept]
    edges = np.array([box for box, _, _ in boxes]).reshape(-1, 2, 2)
    return KautzSuggestion(
        omega=omega,
        damping=damping,
        omega_interval=edges[:, 0] / step,
        damping_interval=edges[:, 1],
        level=np.array([level for _, level, _ in boxes]),
        undetermined=np.array([reached for _, _, reached in boxes], bool) | (edges[:, 1, 1] >= 2 * edges[:, 1, 0]),
        basis=kautz(omega, damping, dt=step, repeat=repeat, delay=chosen) if len(kept) else None,
        delay=chosen,
        reason=reason,
    )


def further_mode(frf: FrequencyResponse, omega: np.ndarray, damping: np.ndarray) -> tuple[float, float]:
    """Natural frequency and damping of the mode among the lines that a fit with these modes and a smooth rest lacks most."""
    from scipy.optimize import least_squares

    data = _checked(frf, None)
    poles = np.log(np.stack([omega * data.dt, damping], axis=1))
    start = _best_start(poles, data)
    positive = data.angle[data.angle > 0]
    low, high = np.log([[positive[0], _DAMPING[0]], [min(positive[-1], 0.999 * np.pi), _DAMPING[1]]])
    found = least_squares(
        lambda new: _residual(np.append(poles, [new], axis=0), data),
        np.clip(start, low + 1e-9, high - 1e-9),
        x_scale="jac",
        bounds=(low, high),
        max_nfev=50,
    )
    turn, zeta = np.exp(found.x)
    return float(turn / data.dt), float(zeta)


@dataclasses.dataclass(frozen=True)
class _Data:
    """Angles of the lines, values, bounds, sample time."""

    angle: np.ndarray
    value: np.ndarray
    bound: np.ndarray
    dt: float

    def select(self, index: Any) -> _Data:
        return _Data(self.angle[index], self.value[index], self.bound[index], self.dt)

    @property
    def room(self) -> int:
        """How many modes (four numbers each) the lines can tell from a smooth rest, one spare equation left."""
        return max(0, (2 * self.angle.size - _SMOOTH - 1) // 4)

    def scaled(self, columns: np.ndarray) -> np.ndarray:
        """Complex columns as real rows in units of the bounds."""
        weighted = columns / self.bound[:, None]
        return np.concatenate([weighted.real, weighted.imag])


def _checked(frf: Any, dt: Any) -> _Data:
    if not isinstance(frf, FrequencyResponse):
        raise InputTypeError(
            f"`frf` must be a FrequencyResponse; got {type(frf).__name__}. From a periodic record: estimate_frf"
        )
    if frf.values.shape[1:] != (1, 1):
        raise InputError(
            f"`frf` must have one input and one output; got {frf.values.shape[1]} outputs and {frf.values.shape[2]} inputs."
            " Pick one entry with .channel(output, input)"
        )
    if dt is None and frf.dt is None:
        raise InputError("`dt` is needed: `frf` is of continuous time; give the sample time of the model in s")
    step = frf.dt if dt is None else as_positive("dt", dt)
    angle = frf.omega * step
    if angle.max() > np.pi * (1 + 1e-12):
        raise InputError(
            f"`dt` = {step:g} s allows frequencies up to {np.pi / step:g} rad/s; got {frf.omega.max():g} rad/s"
        )
    value = frf.values[:, 0, 0]
    size = np.abs(value)
    if not np.any(size > 0):
        raise InputError("`frf` is zero at all lines; check the output")
    bound = np.maximum(0.05 * size, 1e-6 * size.max()) if frf.bound is None else frf.bound[:, 0, 0]
    data = _Data(angle, value, np.asarray(bound), float(step))
    if data.room < 1:
        raise InputError(f"`frf` has {angle.size} lines; at least 4 are needed to find one mode beside a smooth rest")
    return data


def _pair(angle: np.ndarray, pole: np.ndarray, power: int = 1) -> np.ndarray:
    """1 and z^-1 over (1 - 2 Re a z^-1 + |a|^2 z^-2)^power: the real span of a pole pair, (F, 2).

    Delays need no columns: they move within the span of pair and smooth rest.
    """
    back = np.exp(-1j * angle)
    turn, zeta = np.exp(pole)
    a = np.exp((-zeta + 1j * np.sqrt(1 - zeta**2)) * turn)
    first = 1 / (1 - 2 * a.real * back + abs(a) ** 2 * back**2) ** power
    return np.stack([first, back * first], axis=1)


def _smooth(angle: np.ndarray) -> np.ndarray:
    return np.exp(-1j * angle[:, None] * np.arange(_SMOOTH))


def _design(data: _Data, poles: np.ndarray) -> np.ndarray:
    columns = [_pair(data.angle, pole) for pole in poles] + [_smooth(data.angle)]
    return data.scaled(np.hstack(columns))


def _residual(poles: np.ndarray, data: _Data) -> np.ndarray:
    """What least squares leaves at these poles, in units of the bounds, as real rows."""
    columns = _design(data, poles.reshape(-1, 2))
    Q = np.linalg.qr(columns / np.linalg.norm(columns, axis=0))[0]
    y = data.scaled(data.value[:, None])[:, 0]
    return y - Q @ (Q.T @ y)


def _ratio(rows: np.ndarray) -> np.ndarray:
    """|e_k|/bound_k from real rows."""
    half = rows.size // 2
    return np.hypot(rows[:half], rows[half:])


def _search(data: _Data, wanted: int | None) -> tuple[np.ndarray, str]:
    """Poles (log angle, log damping) one after the other, all refined together after each."""
    data = data.select(slice(None, None, -(-data.angle.size // _MOST_LINES)))
    poles = np.zeros((0, 2))
    most = min(data.room, _MOST_MODES if wanted is None else wanted)
    before = _residual(poles, data)
    whole = float(before @ before)
    while True:
        largest = float(_ratio(before).max())
        _log.debug("%d modes: largest |residual|/bound %.3g", len(poles), largest)
        fits = f"the largest residual of the fit is {largest:.3g} times its bound"
        if wanted is None and largest <= 1:
            return poles, f"{_count(poles)} and a smooth rest keep all lines within their bounds: {fits}"
        if len(poles) >= most:
            why = "as many as were asked for" if len(poles) == wanted else "as many as are looked for"
            return poles, f"{_count(poles)}, {why}; {fits}"
        further = _refine(np.vstack([poles, _best_start(poles, data)]), data)
        after = _residual(further, data)
        gain = float(before @ before - after @ after)
        if wanted is None and gain < _WORTH * whole and gain < _WORTH_LEFT * float(before @ before):
            return poles, f"{_count(poles)}; a further one would remove {gain / whole:.2g} of the sum of squares; {fits}"
        poles, before = further, after


def _count(poles: np.ndarray) -> str:
    return f"{len(poles)} mode{'s' * (len(poles) != 1)}"


def _best_start(poles: np.ndarray, data: _Data) -> np.ndarray:
    """The pole on a grid whose pair removes most of the residual."""
    columns = _design(data, poles)
    Q = np.linalg.qr(columns / np.linalg.norm(columns, axis=0))[0]
    residual = _residual(poles, data)
    lines = data.angle.size
    # Between the lines too: the resonance of a light mode usually lies there.
    place = np.interp(np.linspace(0, lines - 1, min(8 * lines, 400)), np.arange(lines), data.angle)
    place = place[(place > 0) & (place < np.pi)]
    best, where = -np.inf, np.zeros(2)
    for zeta in _START:
        pairs = [data.scaled(_pair(data.angle, np.log([turn, zeta]))) for turn in place]
        stacked = np.stack(pairs, axis=1)
        stacked = stacked - np.tensordot(Q, np.tensordot(Q.T, stacked, 1), 1)
        gram = np.einsum("kni,knj->nij", stacked, stacked)
        gram += 1e-12 * np.trace(gram, axis1=1, axis2=2)[:, None, None] * np.eye(2)
        moment = np.einsum("kni,k->ni", stacked, residual)
        gain = np.einsum("ni,ni->n", moment, np.linalg.solve(gram, moment[..., None])[..., 0])
        if gain.max() > best:
            best, where = gain.max(), np.log([place[np.argmax(gain)], zeta])
    return where


def _refine(poles: np.ndarray, data: _Data) -> np.ndarray:
    from scipy.optimize import least_squares

    positive = data.angle[data.angle > 0]
    low = np.tile(np.log([positive[0] / 2, _DAMPING[0]]), len(poles))
    high = np.tile(np.log([min(2 * positive[-1], 0.999 * np.pi), _DAMPING[1]]), len(poles))
    start = np.clip(poles.ravel(), low + 1e-9, high - 1e-9)
    found = least_squares(_residual, start, args=(data,), x_scale="jac", bounds=(low, high), max_nfev=50)
    return found.x.reshape(-1, 2)


def _among_lines(poles: np.ndarray, data: _Data) -> np.ndarray:
    """Which poles are resonances that the lines show, not background that the fit puts outside them."""
    turn, zeta = np.exp(poles).T
    return (turn > data.angle[0]) & (turn < data.angle[-1]) & (zeta < 0.99 * _DAMPING[1])


def _nearest(angle: np.ndarray, centre: float, reach: float, fewest: int) -> np.ndarray:
    """Indices of the lines within `reach` of `centre`, and of the nearest ones up to `fewest`."""
    distance = np.abs(angle - centre)
    count = max(fewest, int(np.sum(distance <= reach)))
    return np.sort(np.argsort(distance, kind="stable")[:count])


def _smallest_rest(data: _Data, poles: np.ndarray) -> int:
    """The delay for which modes and smooth rest fit with the smallest rest: what is left to the gain bound."""
    if not len(poles):
        return 0
    y = data.scaled(data.value[:, None])[:, 0]
    smooth, sizes = _smooth(data.angle), []
    for delay in _DELAYS:
        shift = np.exp(-1j * delay * data.angle)[:, None]
        modes = np.hstack([shift * _pair(data.angle, pole) for pole in poles])
        columns = data.scaled(np.hstack([modes, smooth]))
        norms = np.linalg.norm(columns, axis=0)
        weights = np.linalg.lstsq(columns / norms, y, rcond=1e-12)[0] / norms
        sizes.append(np.abs(smooth @ weights[-_SMOOTH:]).max())
    return int(np.argmin(sizes))


@dataclasses.dataclass(frozen=True)
class _Local:
    """A local fit: its data, and the columns that don't depend on the pole in question."""

    data: _Data
    fixed: np.ndarray

    def minimax(self, pole: np.ndarray, level: float | None = None) -> tuple[float, float]:
        """Lower and upper bound of the smallest max |e|/bound at this pole; stops once a `level` is decided."""
        columns = np.hstack([self.data.scaled(_pair(self.data.angle, pole)), self.fixed])
        columns = columns / np.linalg.norm(columns, axis=0)
        y = self.data.scaled(self.data.value[:, None])[:, 0]
        lines = self.data.angle.size
        weight = np.full(lines, 1 / lines)
        lower, upper = 0.0, np.inf
        for _ in range(30):
            root = np.sqrt(np.tile(weight, 2))
            solution = np.linalg.lstsq(root[:, None] * columns, root * y, rcond=1e-12)[0]
            ratio = _ratio(y - columns @ solution)
            lower, upper = max(lower, float(np.sqrt(weight @ ratio**2))), min(upper, float(ratio.max()))
            decided = level is not None and (lower > level or upper <= level)
            if decided or upper - lower <= 1e-3 * upper:
                break
            weight = weight * ratio
            weight = weight / weight.sum()
        return lower, upper


def _local_fit(data: _Data, poles: np.ndarray, which: int) -> tuple[_Local, tuple[float, float]]:
    """The lines around one mode, without the modes far away; and the range of angles that they span."""
    turn, zeta = np.exp(poles[which])
    near = _nearest(data.angle, turn, 5 * zeta * turn, _LOCAL[0])
    span = (float(data.angle[near[0]]), float(data.angle[near[-1]]))
    near = near[np.unique(np.linspace(0, near.size - 1, min(near.size, _LOCAL[1])).round().astype(int))]
    others = [i for i in range(len(poles)) if i != which]
    width = span[1] - span[0]
    close = [i for i in others if span[0] - width / 2 <= np.exp(poles[i, 0]) <= span[1] + width / 2]
    # Equations less unknowns: near modes are dropped to single pairs where the lines are too few for double ones.
    power = 2 if 2 * near.size > 4 + 4 * len(close) + _SMOOTH else 1
    columns = _design(data, poles)
    norms = np.linalg.norm(columns, axis=0)
    weights = np.linalg.lstsq(columns / norms, data.scaled(data.value[:, None])[:, 0], rcond=1e-12)[0] / norms
    far = sum(
        (_pair(data.angle, poles[i]) @ weights[2 * i : 2 * i + 2] for i in others if i not in close), np.zeros(1)
    )
    local = _Data(data.angle, data.value - far, data.bound, data.dt).select(near)
    parts = [_pair(local.angle, poles[i], k) for i in close for k in range(1, power + 1)] + [_smooth(local.angle)]
    return _Local(local, local.scaled(np.hstack(parts))), span


def _interval(data: _Data, poles: np.ndarray, which: int) -> tuple[np.ndarray, float, bool]:
    """Ends in (angle, damping) of the poles that the data leave, at which level, and whether the box was reached."""
    local, span = _local_fit(data, poles, which)
    centre = poles[which]
    _, best = local.minimax(centre)
    level = 1.0 if best <= 1 else 2 * best
    low = np.array([max(span[0], 1e-3 * span[1]), _DAMPING[0]])
    high = np.array([min(span[1], 0.999 * np.pi), _DAMPING[1]])
    low, high = np.minimum(np.log(low), centre), np.maximum(np.log(high), centre)
    unit = np.array([np.exp(centre[1]), 1.0])  # a half-width in frequency weighs as a factor e in damping
    axes = [_reach(local, centre, unit * d, level, low, high) for d in ((1, 0), (-1, 0), (0, 1), (0, -1))]
    scale = np.array([max(abs(e[k] - centre[k]) for e in axes[2 * k : 2 * k + 2]) for k in range(2)])
    angles = 2 * np.pi * (np.arange(_RAYS) + 0.5) / _RAYS
    rays = [_reach(local, centre, scale * [np.cos(t), np.sin(t)], level, low, high) for t in angles]
    points = np.array([centre, *axes, *rays])
    box = np.array([points.min(axis=0), points.max(axis=0)])
    reached = bool(np.any(box[0] <= low + 1e-9) or np.any(box[1] >= high - 1e-9))
    return np.exp(box.T), level, reached


def _reach(
    local: _Local, centre: np.ndarray, ray: np.ndarray, level: float, low: np.ndarray, high: np.ndarray
) -> np.ndarray:
    """The last pole along a ray, inside the box, that isn't refuted; rounded outwards."""
    with np.errstate(divide="ignore", invalid="ignore"):
        room = np.where(ray > 0, (high - centre) / ray, np.where(ray < 0, (low - centre) / ray, np.inf))
    end = float(np.min(room))

    def refuted(step: float) -> bool:
        return local.minimax(centre + step * ray, level)[0] > level

    inside, outside = 0.0, min(1e-3, end)
    while not refuted(outside):
        inside = outside
        if outside >= end:
            return centre + end * ray
        outside = min(2 * outside, end)
    for _ in range(7):
        middle = (inside + outside) / 2
        inside, outside = (inside, middle) if refuted(middle) else (middle, outside)
    return centre + outside * ray

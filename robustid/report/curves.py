"""Arrays on their way to a chart: fewer points and digits, phases without jumps, ranges of axes."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from robustid.core import Real

# Cells of the frequency axis; of each, two points of the curve or three samples are drawn.
_MOST_CELLS, _LEAST_CELLS, _ALL_CELLS = 350, 60, 4800
_DIGITS = 6
_DEPTH = 1e-8  # of the largest value: what is lower is rounding
_TURNS = 720.0  # degrees, beyond which a phase is drawn from -180 to 180
WRAPPED = (-225.0, 225.0)


def cells_per_entry(entries: int) -> int:
    """Number of cells of each of many entries: the more entries the fewer, so that the page keeps its size."""
    return int(np.clip(_ALL_CELLS // entries, _LEAST_CELLS, _MOST_CELLS))


def most_drawn(points: int, entries: int) -> int:
    """Most frequency points of an entry that are drawn."""
    return min(points, 3 * cells_per_entry(entries))


def log_axis(omega: np.ndarray) -> bool:
    """Return whether the frequencies are spread rather like a geometric sequence than evenly, over an octave at least."""
    known = omega[omega > 0]
    if known.size < 2:
        return bool(known.size)
    middle, ends = np.median(known), known[[0, -1]]
    if known.max() < 2 * known.min():
        return False
    return bool(abs(np.log(middle / np.sqrt(ends.prod()))) <= abs(np.log(middle / ends.mean())))


def spread(low: float, high: float, count: int, log: bool) -> Real:
    """Points between two ends, even on a logarithmic axis or on a linear one."""
    return np.asarray(np.geomspace(low, high, count) if log else np.linspace(low, high, count), dtype=float)


def position(omega: np.ndarray, log: bool) -> np.ndarray:
    """Place of each frequency along the axis."""
    return np.log(np.maximum(omega, omega[omega > 0].min(initial=1.0))) if log else omega


def thinned(position: np.ndarray, sizes: list[np.ndarray], cells: int) -> np.ndarray:
    """Choose the points to draw: all where they are few, else of every cell the smallest and largest of the first array, and
    the largest of every other one; no peak, no notch and no outlier is lost.
    """
    if position.size <= (len(sizes) + 1) * cells:
        return np.arange(position.size)
    width = (position[-1] - position[0]) / cells or 1.0
    cell = np.minimum((position - position[0]) // width, cells - 1)
    chosen: list[np.ndarray] = []
    for k, size in enumerate(sizes):
        order = np.lexsort((size, cell))
        last = np.append(np.flatnonzero(np.diff(cell[order])), position.size - 1)
        chosen.append(order[last])
        if k == 0:
            chosen.append(order[np.append(0, last[:-1] + 1)])
    return np.unique(np.concatenate(chosen))


def rounded(values: np.ndarray) -> np.ndarray:
    """Round to six digits, more than a picture shows: the page becomes a third as large."""
    with np.errstate(divide="ignore", invalid="ignore"):
        places = _DIGITS - 1 - np.floor(np.log10(np.abs(values)))
    places = np.where(np.isfinite(places), places, 0)
    # Division by a power of ten rounds to the shortest decimal; multiplication by 1e-5 doesn't.
    large, small = 10.0 ** np.minimum(np.abs(places), 290), places >= 0
    return np.where(small, np.round(values * large) / large, np.round(values / large) * large)


def positive(values: np.ndarray) -> np.ndarray:
    """Replace by NaN what a logarithmic axis can't show."""
    values = np.asarray(values, dtype=float)
    return np.where(values > 0, values, np.nan)


def resolved(base: np.ndarray, poles: np.ndarray, phases: np.ndarray, low: float, high: float) -> np.ndarray:
    """Frequencies of `base` between two ends, and those at which the resonance of each pole in s has turned by these phases:
    w + sigma tan(theta), equal steps of phase across it.
    """
    around = [pole.imag + abs(pole.real) * np.tan(phases) for pole in poles if pole.imag > 0 and pole.real]
    omega = np.unique(np.concatenate([base, *around]))
    return omega[(omega >= low) & (omega <= high)]


def next_to(angle: np.ndarray, near: np.ndarray) -> np.ndarray:
    """Turn angles in degrees by whole turns, next to other ones."""
    return angle - 360 * np.round((angle - near) / 360)


def phase_curves(values: list[np.ndarray]) -> tuple[Sequence[np.ndarray], tuple[float, float]]:
    """Phases in degrees and their range: continuous where they stay within two turns, else from -180 to 180."""
    unwrapped: list[Real] = [np.degrees(np.unwrap(np.angle(v))) for v in values]
    turned: list[Real] = [p - 360 * np.round(np.median(p - unwrapped[0]) / 360) for p in unwrapped]
    low, high = (float(limit(np.concatenate(turned))) for limit in (np.min, np.max))
    if high - low <= _TURNS:
        return turned, _quarter_turns(low, high)
    return [np.degrees(np.angle(v)) for v in values], WRAPPED


def measured_phase(
    omega: np.ndarray, values: np.ndarray, radius: np.ndarray | None
) -> tuple[np.ndarray, tuple[float, float]]:
    """Phase in degrees of a measured response, and its range: continuous over the points that are sure, the others next to them.

    Noise alone turns a phase without end; beyond two turns it is drawn from -180 to 180.
    """
    angle = np.degrees(np.angle(values))
    sure = np.abs(values) > (0 if radius is None else 2 * radius)
    if sure.any():
        near = np.interp(omega, omega[sure], np.degrees(np.unwrap(np.angle(values[sure]))))
        turned = next_to(angle, near)
        low, high = float(turned.min()), float(turned.max())
        if high - low <= _TURNS:
            back = 360 * np.round((low + high) / 720)
            return turned - back, _quarter_turns(low - back, high - back)
    return angle, WRAPPED


def _quarter_turns(low: float, high: float) -> tuple[float, float]:
    return 90 * np.floor(low / 90) - 45, 90 * np.ceil(high / 90) + 45


def phase_tick(span: tuple[float, float]) -> float:
    """Step of the ticks of a phase, in degrees."""
    width = span[1] - span[0]
    return 90.0 if width <= 450 else float(180 * np.ceil(width / 1080))


def half_angle(size: np.ndarray, radius: np.ndarray) -> np.ndarray:
    """Largest phase in degrees between the centre of a disc and its points; 90 where it holds 0, whose phase can be anything."""
    known = np.where(np.isinf(radius), 1.0, radius)
    largest = np.where(np.isinf(radius), 1.0, np.maximum(size, radius))
    return np.degrees(np.arcsin(np.minimum(known / largest, 1)))


def with_gaps(angle: np.ndarray) -> np.ndarray:
    """Copy a curve, with a gap where the phase jumps by a turn."""
    out = angle.copy()
    out[1:][np.abs(np.diff(angle)) > 180] = np.nan
    return out


def between_gaps(values: np.ndarray) -> list[slice]:
    """Stretches without NaN."""
    known = np.concatenate([[False], np.isfinite(values), [False]])
    ends = np.flatnonzero(np.diff(known.astype(int)))
    return [slice(int(a), int(b)) for a, b in ends.reshape(-1, 2)]


def magnitude_range(top: float, floors: Iterable[float], depth: float = _DEPTH) -> tuple[float, float]:
    """Range of a logarithmic axis that holds `top` and every one of the `floors`, but nothing below `depth` times the top.

    Floors are quantiles rather than smallest values where the bottom of deep notches doesn't matter.
    """
    if not top > 0:
        return 0.1, 1.0
    return max(min(floors) / 2, depth * top), 1.5 * top


def low_quantile(values: np.ndarray) -> float:
    """Size below which two in a hundred values lie."""
    return float(np.quantile(values, 0.02))


def span_of(values: np.ndarray, factor: float) -> tuple[float, float] | None:
    """Range of a logarithmic axis around all positive values, `factor` beyond them; None where there are none."""
    values = values[np.isfinite(values) & (values > 0)]
    return (float(values.min()) / factor, float(values.max()) * factor) if values.size else None

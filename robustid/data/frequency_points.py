"""Base of all samples at frequencies: checks on entry, frequency points to choose, values that were not measured."""

from __future__ import annotations

import dataclasses
import operator
from collections.abc import Sequence
from typing import Any, ClassVar, Self, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from robustid.core import ByValue, Frozen, Savable, Signal, as_array, as_positive, counted, hz_words
from robustid.data.bound import Bound, Points
from robustid.data.bound_checks import in_part
from robustid.errors import InputError, InputTypeError, Remedy

# Above pi/dt by a rounding error only: a grid that ends at the Nyquist frequency is legitimate.
NYQUIST_SLACK = 1 + 1e-12
SAME_FREQUENCY = 1e-4  # part of a frequency: numbers that are read from a plot have five digits


class FrequencyPoints(ByValue, Frozen, Savable):
    """Base of frozen dataclasses of samples at frequencies, sorted, with an infinite bound where nothing was measured.

    ``data[10:50]`` are some of the frequency points (`select`), ``data == other`` compares everything that they hold.
    """

    PER_POINT: ClassVar[tuple[str, ...]]  # names of what has a part for every frequency point, beside the bound
    omega: np.ndarray
    values: np.ndarray
    bound: Any
    dt: float | None

    @property
    def freq_hz(self) -> NDArray[np.float64]:
        """Frequencies in Hz, (F,)."""
        return self.omega / (2 * np.pi)

    @property
    def all_real(self) -> NDArray[np.bool_]:
        """True at 0 and at the Nyquist frequency, where values and their errors are real, (F,)."""
        return (self.omega == 0) | (self.omega * (self.dt or 0.0) >= np.pi / NYQUIST_SLACK)

    @property
    def missing(self) -> NDArray[np.bool_]:
        """True where a value was not measured, which an infinite bound says; shaped as `values`."""
        return np.zeros_like(self.values, dtype=bool) if self.bound is None else self.bound.missing

    __iter__: ClassVar[None] = None  # no sequence: neither loops nor arrays go through the points one by one

    def __getitem__(self, points: Any) -> Self:
        """Some frequency points: a number, a slice, a mask or indices, as `select` takes them."""
        return self.select(points)

    def select(self, points: Points) -> Self:
        """Keep some frequency points: a boolean mask, indices or a slice along the frequency axis."""
        try:
            index: NDArray[np.intp] = np.atleast_1d(np.asarray(np.arange(self.omega.size)[points], dtype=np.intp))
        except IndexError as error:
            raise InputError(
                f"`points` doesn't select from {counted(self.omega.size, 'frequency point')}: {error}"
            ) from None
        if index.size == 0:
            raise InputError(f"`points` selects none of the {counted(self.omega.size, 'frequency point')}")
        arrays = {name: array[index] for name in self.PER_POINT if (array := getattr(self, name)) is not None}
        return self._with(bound=None if self.bound is None else self.bound.select(index), **arrays)

    def band(self, low_hz: float, high_hz: float) -> Self:
        """Keep the frequency points with ``low_hz <= f <= high_hz``."""
        inside = (self.freq_hz >= low_hz) & (self.freq_hz <= high_hz)
        if not np.any(inside):
            raise InputError(
                f"no frequency point lies between {low_hz:g} and {high_hz:g} Hz; they go"
                f" from {self.freq_hz[0]:g} to {self.freq_hz[-1]:g} Hz"
            )
        return self.select(inside)

    def ratio(self, error: ArrayLike) -> NDArray[np.float64]:
        """Size of an error, shaped as `values`, in units of the bound, at most 1 inside: see `Bound.ratio`.

        Raises
        ------
        InputError
            Another shape, or data without a bound.

        Examples
        --------
        >>> import numpy as np, robustid as rid
        >>> frf = rid.FrequencyResponse([10.0], np.zeros((1, 2, 1))).with_column_bound(0.1)
        >>> frf.ratio([[[0.06], [0.08j]]]).round(9).item()
        1.0
        """
        if self.bound is None:
            raise InputError("`ratio` needs the bound of the data; give one by with_bound(...)")
        return self.bound.ratio(error)

    def with_bound(self, bound: Bound | ArrayLike | None, note: str = "") -> Self:
        """Return the samples with a `Bound`, or a radius of your own for every value, of the same tilt, in the place of any other.

        A text such as "5%" is that part of the size of each value. What was not measured stays so.
        """
        radius = in_part(bound, np.abs(self.values))
        if radius is not None and not isinstance(radius, Bound):
            radius = Bound(radius, tilt=None if self.bound is None else self.bound.tilt)
        fitted = Bound.of(radius, self.values.shape)
        if np.any(self.missing):
            if fitted is None:
                raise InputError("`bound` is needed: its infinite values say which entries were not measured; got None")
            fitted = fitted.only(~self.missing)
        return self._with(bound=fitted, note=note)

    def _with(self, **changes: object) -> Self:
        return dataclasses.replace(self, **changes)  # type: ignore[type-var]

    def require_complete(self, what: str) -> None:
        """Refuse, in the name of what needs every value at every frequency point, data that miss some."""
        if not np.any(self.missing):
            return
        k, i, j = np.argwhere(self.missing)[0]
        whole = int(np.sum(~self.missing.any(axis=(1, 2))))
        raise InputError(
            f"{what} needs every entry at every frequency point; {int(np.sum(self.missing))} of {self.values.size} are missing,"
            f" the first at {hz_words(float(self.freq_hz[k]), 6)} in entry ({i}, {j}). Pick one entry by .entry(output, input), or"
            f" the {whole} complete frequency points by .select(~data.missing.any(axis=(1, 2)))"
        )


def points_at(omega: NDArray[np.float64], wanted: float) -> NDArray[np.intp]:
    """The frequency point nearest to a frequency as people write it, and those at the very same; none where none is there."""
    nearest = omega[int(np.argmin(np.abs(omega - wanted)))]
    if abs(nearest - wanted) > SAME_FREQUENCY * abs(wanted):
        return np.zeros(0, np.intp)
    return np.flatnonzero(omega == nearest)


def _moved(values: np.ndarray, points: int) -> str:
    """Advice where the frequency is another axis than the first."""
    axes = [axis for axis in range(1, values.ndim) if values.shape[axis] == points]
    return f". Is axis {axes[0]} the frequency? Then give np.moveaxis(values, {axes[0]}, 0)" if axes else ""


def as_points(
    omega: ArrayLike, values: ArrayLike, dt: object, axes: str
) -> tuple[NDArray[np.float64], NDArray[np.complex128], float | None]:
    """Frequencies, values of three dimensions and sample time, checked but for what the bound says; not yet sorted."""
    omega = as_array("omega", omega, ndim=1)
    points = omega.size
    if points == 0:
        raise InputError("`omega` is empty; give at least one frequency")
    values = as_array("values", values, dtype=complex, finite=False)
    if values.shape == (points,):
        values = values.reshape(points, 1, 1)
    if values.ndim != 3 or values.shape[0] != points or 0 in values.shape:
        raise InputError(
            f"`values` must have shape (F,) or (F, {axes}) with F = {points} from `omega`; got {values.shape}"
            + _moved(values, points)
        )
    if np.any(omega < 0):
        below = int(np.sum(omega < 0))
        raise InputError(
            f"`omega` must be >= 0; got {omega.min():g} rad/s, and {below} of {points} points to be left out: the response at"
            " -omega is the conjugate of that at omega"
        )
    dt = None if dt is None else as_positive("dt", dt)
    if dt is not None and omega.max() * dt > np.pi * NYQUIST_SLACK:
        raise InputError(
            "`omega` must not exceed pi/dt = ",
            Remedy({"omega": np.pi / dt}, f"{np.pi / dt:g} rad/s"),
            f"; got {omega.max():g} rad/s. Frequencies are in rad/s, not Hz; check `dt` too",
            argument="omega",
            got=float(omega.max()),
        )
    return omega, values, dt


def check_measured(values: NDArray[np.complex128], bound: Bound | None) -> None:
    """Refuse values that aren't finite where they were measured, and data of which nothing was."""
    measured = np.ones(values.shape, dtype=bool) if bound is None else bound.used
    if not np.any(measured):
        raise InputError("`bound` is infinite everywhere: nothing was measured; give at least one entry a finite bound")
    bad = np.argwhere(~np.isfinite(values) & measured)
    if len(bad):
        raise InputError(
            f"`values` must be finite; got {values[tuple(bad[0])]} at index {tuple(int(i) for i in bad[0])}"
            f" ({len(bad)} of {values.size} values are not finite). A `bound` of inf marks what was not measured"
        )


def as_note(note: object) -> str:
    """Text."""
    if not isinstance(note, str):
        raise InputTypeError(f"`note` must be text; got {type(note).__name__}")
    return note


def signal_index(name: str, wanted: int | str, signals: tuple[Signal, ...]) -> int:
    """Index of a signal that is given by number or by name."""
    if isinstance(wanted, str):
        names = [signal.name for signal in signals]
        if wanted not in names:
            raise InputError(f"`{name}` must be one of {names}; got {wanted!r}")
        return names.index(wanted)
    try:
        index = operator.index(wanted)
    except TypeError:
        raise InputTypeError(f"`{name}` must be the number or name of a signal; got {wanted!r}") from None
    if not -len(signals) <= index < len(signals):
        raise InputError(f"`{name}` must be below {len(signals)}; got {index}")
    return index % len(signals)


def signal_indices(name: str, wanted: Any, signals: tuple[Signal, ...]) -> list[int]:
    """Indices of signals that are given by number, name, slice or a list of such."""
    if isinstance(wanted, slice):
        found = list(range(len(signals)))[wanted]
    elif isinstance(wanted, list | tuple | np.ndarray):
        found = [signal_index(name, one, signals) for one in cast("Sequence[int | str]", wanted)]
    else:
        found = [signal_index(name, wanted, signals)]
    if not found or len(set(found)) < len(found):
        raise InputError(f"`{name}` must choose signals, each once; got {wanted!r} of {len(signals)}")
    return found


def in_parts(key: Any) -> tuple[Any, Any, Any]:
    """Index of samples, outputs and inputs in brackets; what is left out is all."""
    parts: list[Any] = list(cast("tuple[Any, ...]", key)) if isinstance(key, tuple) else [key]
    if len(parts) > 3:
        raise InputError(f"`[...]` takes samples, outputs and inputs; got {len(parts)} parts")
    samples, outputs, inputs = parts + [slice(None)] * (3 - len(parts))
    return samples, outputs, inputs


def as_entries(name: str, value: object, shape: tuple[int, ...]) -> NDArray[np.complex128]:
    """A complex number for every frequency point and entry."""
    found = as_array(name, value, dtype=complex)
    if found.size == shape[0] and np.prod(shape) == shape[0]:
        found = found.reshape(shape)
    if found.shape != shape:
        raise InputError(f"`{name}` must have shape {shape}; got {found.shape}")
    return found


def as_level(name: str, value: object, shape: tuple[int, ...]) -> NDArray[np.float64] | None:
    """A coherence or standard deviation of every frequency point, not negative."""
    if value is None:
        return None
    level = as_array(name, value)
    if level.size == shape[0] and np.prod(shape) == shape[0]:
        level = level.reshape(shape)
    if level.shape != shape:
        raise InputError(f"`{name}` must have shape {shape}; got {level.shape}")
    highest = 1.0 if name == "coherence" else np.inf
    if np.any((level < 0) | (level > highest)):
        count = int(np.sum(np.any(np.reshape((level < 0) | (level > highest), (len(level), -1)), axis=1)))
        advice = "; numbers above 1 are no coherence: leave it out" if level.max() > highest else ""
        raise InputError(
            f"`{name}` must lie between 0 and {'1' if highest == 1 else 'infinity'}; got {level.min():g} to"
            f" {level.max():g}, outside at {count} of {len(level)} points{advice}"
        )
    return level


def as_modes(name: str, value: Sequence[Sequence[float]]) -> tuple[tuple[float, float, float, float], ...]:
    """Ends of natural frequencies and damping ratios, four numbers for every mode."""
    ends = as_array(name, value).reshape(-1, 4) if np.size(value) else np.zeros((0, 4))
    if not np.all((ends[:, [0, 2]] > 0) & (ends[:, [0, 2]] <= ends[:, [1, 3]])):
        raise InputError(
            f"`{name}` must hold positive ends, the lower one first, of frequency and damping; got {value!r}"
        )
    return tuple((a, b, c, d) for a, b, c, d in ends.tolist())

"""What all samples at frequencies have in common: the checks on entry, lines to choose, entries that were not measured."""

from __future__ import annotations

import dataclasses
import operator
from typing import Any, ClassVar, Self

import numpy as np

from robustid.core import Frozen, Signal, as_array, as_bound, as_float, as_positive
from robustid.errors import InputError, InputTypeError

# Above pi/dt by a rounding error only: a grid that ends at the Nyquist frequency is legitimate.
NYQUIST_SLACK = 1 + 1e-12
BOUND_KINDS = ("hard", "rest", "statistical")


class Lines(Frozen):
    """Base of frozen dataclasses of samples at frequencies, sorted, with an infinite bound where nothing was measured."""

    PER_LINE: ClassVar[tuple[str, ...]]  # names of the arrays with an entry per line
    omega: Any
    values: Any
    bound: Any
    dt: float | None

    @property
    def freq_hz(self) -> np.ndarray:
        """Frequencies in Hz, (F,)."""
        return self.omega / (2 * np.pi)

    @property
    def missing(self) -> np.ndarray:
        """Which values were not measured: those of an infinite bound, bool, shaped as `values`."""
        return np.zeros(self.values.shape, dtype=bool) if self.bound is None else np.isinf(self.bound)

    def select(self, lines: Any) -> Self:
        """Keep some lines: a boolean mask, indices or a slice along the frequency axis."""
        try:
            index = np.atleast_1d(np.arange(self.omega.size)[lines])
        except IndexError as error:
            raise InputError(f"`lines` doesn't select from {self.omega.size} lines: {error}") from None
        if index.size == 0:
            raise InputError(f"`lines` selects none of the {self.omega.size} lines")
        return self._with(
            **{name: array[index] for name in self.PER_LINE if (array := getattr(self, name)) is not None}
        )

    def band(self, low_hz: float, high_hz: float) -> Self:
        """Keep the lines with ``low_hz <= f <= high_hz``."""
        inside = (self.freq_hz >= low_hz) & (self.freq_hz <= high_hz)
        if not np.any(inside):
            raise InputError(
                f"no line lies between `low_hz` = {low_hz:g} and `high_hz` = {high_hz:g} Hz; the lines go"
                f" from {self.freq_hz[0]:g} to {self.freq_hz[-1]:g} Hz"
            )
        return self.select(inside)

    def _with(self, **changes: Any) -> Self:
        return dataclasses.replace(self, **changes)  # type: ignore[type-var]

    def require_complete(self, what: str) -> None:
        """Refuse, in the name of what needs every value at every line, data that miss some."""
        if not np.any(self.missing):
            return
        k, i, j = np.argwhere(self.missing)[0]
        whole = int(np.sum(~self.missing.any(axis=(1, 2))))
        raise InputError(
            f"{what} needs every entry at every line; {int(np.sum(self.missing))} of {self.values.size} are missing, the first"
            f" at {self.freq_hz[k]:.6g} Hz in entry ({i}, {j}). Pick one entry by .entry(output, input), or the {whole} complete"
            " lines by .select(~data.missing.any(axis=(1, 2)))"
        )

    def _where_measured(self, bound: Any) -> np.ndarray | None:
        """A new bound; what was not measured stays so."""
        bound = as_bound(bound, self.values.shape, "F", infinite=True)
        if not np.any(self.missing):
            return bound
        if bound is None:
            raise InputError("`bound` is needed: its infinite values say which entries were not measured; got None")
        return np.where(self.missing, np.inf, bound)

    def _error(self, error: Any) -> np.ndarray:
        """An error array for `ratio`, 0 where nothing was measured."""
        if self.bound is None:
            raise InputError("`ratio` needs the bound of the data; give one by with_bound(...)")
        error = as_array("error", error, dtype=complex, finite=False)
        if error.shape != self.values.shape:
            raise InputError(f"`error` must have shape {self.values.shape} as the values; got {error.shape}")
        return np.where(self.missing, 0, error)


def as_lines(omega: Any, values: Any, dt: Any, axes: str) -> tuple[np.ndarray, np.ndarray, float | None]:
    """Frequencies, values of three dimensions and sample time, checked but for what the bound says; not yet sorted."""
    omega = as_array("omega", omega, ndim=1)
    lines = omega.size
    if lines == 0:
        raise InputError("`omega` is empty; give at least one frequency")
    values = as_array("values", values, dtype=complex, finite=False)
    if values.shape == (lines,):
        values = values.reshape(lines, 1, 1)
    if values.ndim != 3 or values.shape[0] != lines or 0 in values.shape:
        raise InputError(
            f"`values` must have shape (F,) or (F, {axes}) with F = {lines} from `omega`; got {values.shape}"
        )
    if np.any(omega < 0):
        raise InputError(f"`omega` must be >= 0 (conjugate lines are implied); got {omega.min():g} rad/s")
    dt = None if dt is None else as_positive("dt", dt)
    if dt is not None and omega.max() * dt > np.pi * NYQUIST_SLACK:
        raise InputError(
            f"`omega` must not exceed pi/dt = {np.pi / dt:g} rad/s; got {omega.max():g} rad/s."
            " Frequencies are in rad/s, not Hz; check `dt` too"
        )
    return omega, values, dt


def check_measured(values: np.ndarray, bound: np.ndarray | None) -> None:
    """Values must be finite where they were measured, and something must have been."""
    measured = np.ones(values.shape, dtype=bool) if bound is None else np.isfinite(bound)
    if not np.any(measured):
        raise InputError("`bound` is infinite everywhere: nothing was measured; give at least one entry a finite bound")
    bad = np.argwhere(~np.isfinite(values) & measured)
    if len(bad):
        raise InputError(
            f"`values` must be finite; got {values[tuple(bad[0])]} at index {tuple(int(i) for i in bad[0])}"
            f" ({len(bad)} of {values.size} values are not finite). A `bound` of inf marks what was not measured"
        )


def as_bound_kind(kind: Any) -> str:
    """One of `BOUND_KINDS`."""
    if kind not in BOUND_KINDS:
        raise InputError(f"`bound_kind` must be one of {BOUND_KINDS}; got {kind!r}")
    return kind


def as_probability(value: Any) -> float:
    """A number between 0 and 1."""
    value = as_float("probability", value)
    if not 0 < value < 1:
        raise InputError(f"`probability` must be between 0 and 1; got {value:g}")
    return value


def as_note(note: Any) -> str:
    """Text."""
    if not isinstance(note, str):
        raise InputTypeError(f"`note` must be text; got {type(note).__name__}")
    return note


def signal_index(name: str, wanted: int | str, channels: tuple[Signal, ...]) -> int:
    """Index of a channel given by number or by name."""
    if isinstance(wanted, str):
        names = [c.name for c in channels]
        if wanted not in names:
            raise InputError(f"`{name}` must be one of {names}; got {wanted!r}")
        return names.index(wanted)
    try:
        index = operator.index(wanted)
    except TypeError:
        raise InputTypeError(f"`{name}` must be a channel's number or name; got {wanted!r}") from None
    if not -len(channels) <= index < len(channels):
        raise InputError(f"`{name}` must be below {len(channels)}; got {index}")
    return index % len(channels)


def as_level(name: str, value: Any, shape: tuple[int, ...]) -> np.ndarray | None:
    """A coherence or standard deviation of every line, not negative."""
    if value is None:
        return None
    level = as_array(name, value)
    if level.size == shape[0] and np.prod(shape) == shape[0]:
        level = level.reshape(shape)
    if level.shape != shape:
        raise InputError(f"`{name}` must have shape {shape}; got {level.shape}")
    if np.any(level < 0) or (name == "coherence" and np.any(level > 1)):
        raise InputError(
            f"`{name}` must lie between 0 and {'1' if name == 'coherence' else 'infinity'};"
            f" got {level.min():g} to {level.max():g}"
        )
    return level

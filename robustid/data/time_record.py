"""Measured time records with the bounds on their errors."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Any, ClassVar, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from robustid.core import (
    ByValue,
    Frozen,
    Savable,
    Tabular,
    as_array,
    as_flag,
    as_float,
    as_positive,
    as_signals,
    freeze,
)
from robustid.data.bound import Bound
from robustid.data.frequency_points import as_note, in_parts, signal_index, signal_indices
from robustid.errors import InputError, InputTypeError
from robustid.figures import Drawable

INITIAL = ("rest", "free", "periodic")
_WHOLE = 1e-6  # part of a sample, or of a spectrum, that is rounding
PAST = ("known", "unknown", "periodic")


@dataclasses.dataclass(frozen=True, eq=False)
class TimeRecord(ByValue, Frozen, Tabular, Drawable, Savable):
    """A known input and the measured output, each sample in an interval of known half-width.

    ``y[k] = sum_j f[j] u[k-j] + e[k]``, ``|e[k]| <= bound[k]``, f the impulse response.

    Parameters
    ----------
    u : (T,) or (T, nu) array
        Input at the sample instants (zero-order hold between them). Time is the first axis.
    y : (T,) or (T, ny) array
        Output.
    dt : float
        Sample time in s.
    bound : scalar, (T,) or (T, ny) array, or Bound, optional
        Half-width of the interval around each output sample: a hard bound; ``inf`` marks a sample that is not used (a known
        past input before the window of interest, say). A `Bound` says of what kind it is.
    reference : (T,) or (T, nr) array, optional
        External excitation, in closed loop.
    initial : {"rest", "free", "periodic"}
        Before the record: zero initial conditions (the default); an unknown state; or periodic steady state, the record being a
        whole number of periods.
    past_input_bound : float, optional
        For ``initial="free"``: a bound on |u| before the record; default max |u| of the record.
    held : bool
        The input keeps its value until the next sample. Not after `prepare.decimate`: then the output may follow the next sample of
        the input, and that is no fault.
    inputs, outputs : sequence of str or (name, unit), optional
        Signal names and units; default: the columns of a DataFrame.
    note : str, optional
        Where the bound comes from, for reports.

    Examples
    --------
    >>> import numpy as np, robustid as rid
    >>> record = rid.TimeRecord(np.ones(4), [0.0, 0.5, 0.75, 0.875], dt=0.01, bound=0.01)
    >>> record
    <TimeRecord: 4 samples, 1x1, bound, rest, dt=0.01 s>
    >>> record.y.shape
    (4, 1)
    """

    INDEX: ClassVar[str] = "time [s]"
    u: np.ndarray
    y: np.ndarray
    _: dataclasses.KW_ONLY
    dt: float
    bound: Any = None
    reference: Any = None
    initial: str = "rest"
    past_input_bound: float | None = None
    held: bool = True
    inputs: Any = None
    outputs: Any = None
    note: str = ""

    def __post_init__(self) -> None:
        u, y = (_signal(name, getattr(self, name)) for name in ("u", "y"))
        if u.shape[0] != y.shape[0]:
            raise InputError(f"`u` and `y` must have the same number of samples; got {u.shape[0]} and {y.shape[0]}")
        reference = None if self.reference is None else _signal("reference", self.reference)
        if reference is not None and reference.shape[0] != u.shape[0]:
            raise InputError(f"`reference` must have T = {u.shape[0]} samples; got {reference.shape[0]}")
        if self.initial not in INITIAL:
            raise InputError(f"`initial` must be one of {INITIAL}; got {self.initial!r}")
        past = self.past_input_bound
        if past is not None:
            past = as_float("past_input_bound", past)
            if past < 0:
                raise InputError(f"`past_input_bound` must be >= 0; got {past:g}")
        as_note(self.note)
        bound = Bound.of(self.bound, y.shape, "T")
        self._set(
            u=freeze(u),
            y=freeze(y),
            dt=as_positive("dt", self.dt),
            bound=bound,
            reference=None if reference is None else freeze(reference),
            past_input_bound=past,
            held=as_flag("held", self.held),
            inputs=as_signals("inputs", _labels(self.inputs, self.u), u.shape[1], "u"),
            outputs=as_signals("outputs", _labels(self.outputs, self.y), y.shape[1], "y"),
        )

    def __repr__(self) -> str:
        parts = [f"{self.u.shape[0]} samples", f"{len(self.outputs)}x{len(self.inputs)}"]
        parts += [name for name in ("bound", "reference") if getattr(self, name) is not None]
        return f"<TimeRecord: {', '.join(parts)}, {self.initial}, dt={self.dt:.6g} s>"

    @property
    def time(self) -> np.ndarray:
        """Sample instants in s, (T,), from 0."""
        return self.dt * np.arange(len(self.u))

    @property
    def used(self) -> NDArray[np.bool_]:
        """True where a sample counts: where its bound is finite, or everywhere without a bound; shaped as `y`."""
        return np.ones(self.y.shape, dtype=bool) if self.bound is None else self.bound.used

    def ratio(self, error: ArrayLike) -> NDArray[np.float64]:
        """Size of an error (T, ny) of the output in units of its bound, at most 1 inside; 0 where a sample is not used."""
        if self.bound is None:
            raise InputError("`ratio` needs the bound of the record; give one by with_bound(...)")
        return self.bound.ratio(error)

    def entry(self, output: int | str = 0, input: int | str = 0) -> TimeRecord:
        """One output and one input of the record, by index or name; the other inputs must be zero."""
        i, j = signal_index("output", output, self.outputs), signal_index("input", input, self.inputs)
        return self._signals([i], [j])

    __iter__: ClassVar[None] = None  # no sequence: neither loops nor arrays go through the samples one by one

    def __getitem__(self, samples: object) -> TimeRecord:
        """Some samples, outputs and inputs: ``record[100:500]``, ``record[:, "angle"]``; what was before the samples is unknown.

        Inputs that are left out must be zero. `window` keeps what the input did before; it takes seconds.
        """
        wanted, outputs, inputs = in_parts(samples)
        rows, columns = signal_indices("output", outputs, self.outputs), signal_indices("input", inputs, self.inputs)
        whole = rows == list(range(len(self.outputs))) and columns == list(range(len(self.inputs)))
        part = self if whole else self._signals(rows, columns)
        if not isinstance(wanted, slice) or cast("Any", wanted).step not in (None, 1):
            raise InputError(
                f"`[...]` of a record takes a slice of neighbouring samples such as [100:500]; got {wanted!r}. Fewer samples a"
                " second: rid.prepare.decimate"
            )
        start, stop, _ = wanted.indices(len(self.u))
        if (start, stop) == (0, len(self.u)):
            return part
        if start == 0 and part.initial != "periodic":
            return part.window(0.0, stop * self.dt)
        return part.window(start * self.dt, stop * self.dt, past="unknown")

    def _signals(self, rows: list[int], columns: list[int]) -> TimeRecord:
        """Some outputs and inputs."""
        if np.any(np.delete(self.u, columns, axis=1)):
            names = ", ".join(self.inputs[j].name for j in columns)
            raise InputError(
                f"`input` = {names!r}: the other inputs of the record are not zero, so that the"
                " output isn't the response to this one alone"
            )
        every = columns == list(range(len(self.inputs)))
        return dataclasses.replace(
            self,
            u=self.u[:, columns],
            y=self.y[:, rows],
            bound=None if self.bound is None else self.bound.entries(rows),
            reference=self.reference if every else None,
            inputs=tuple(self.inputs[j] for j in columns),
            outputs=tuple(self.outputs[i] for i in rows),
        )

    def table(self) -> dict[str, np.ndarray]:
        """Time, inputs, outputs and their bounds, by the names of the signals with their units."""
        found = {self.INDEX: self.time}
        found |= {str(signal): self.u[:, j] for j, signal in enumerate(self.inputs)}
        found |= {str(signal): self.y[:, i] for i, signal in enumerate(self.outputs)}
        if self.bound is not None:
            found |= {f"bound {signal.name}": self.bound.radius[:, i] for i, signal in enumerate(self.outputs)}
        return found

    def window(self, start: float = 0.0, stop: float | None = None, *, past: str = "known") -> TimeRecord:
        """The samples with ``start <= t < stop``; what the input did before them is still used.

        Parameters
        ----------
        start, stop : float, s
            On the axis `time`; `stop` = None is the end of the record.
        past : {"known", "unknown", "periodic"}
            "known": the input outside the window stays in the record and the output there gets ``bound=inf``: not used
            (nothing after the window, which can't act on it, except in periodic steady state). "unknown": the window
            alone, from a free state, with the bound on |u| before it that the record gives. "periodic": the window
            alone, which you know to be whole periods in steady state.

        Raises
        ------
        InputError
            A window outside the record, or without a used sample; a known past in a record without a bound, where nothing
            says which samples are used.

        Examples
        --------
        >>> import numpy as np, robustid as rid
        >>> record = rid.TimeRecord(np.ones(5), np.arange(5.0), dt=0.1, bound=0.01)
        >>> record.window(0.2, 0.4).bound.ravel().tolist()
        [inf, inf, 0.01, 0.01]
        >>> record.window(0.2, past="unknown")
        <TimeRecord: 3 samples, 1x1, bound, free, dt=0.1 s>
        """
        if past not in PAST:
            raise InputError(f"`past` must be one of {PAST}; got {past!r}")
        total = self.u.shape[0]
        first = self._sample("start", start)
        end = total if stop is None else self._sample("stop", stop)
        if not 0 <= first < end <= total:
            raise InputError(
                f"`start` = {start:g} s and `stop` = {stop if stop is None else format(stop, 'g')} must enclose samples of"
                f" the record, which lasts from 0 to {total * self.dt:g} s"
            )
        if self.bound is not None and not np.any(self.used[first:end]):
            raise InputError(f"no sample from `start` = {start:g} s on is used: their `bound` is infinite")
        if past == "known":
            return self._with_known_past(first, end)
        before = np.concatenate([self.u[end:], self.u[:first]]) if self.initial == "periodic" else self.u[:first]
        largest = float(np.abs(before).max(initial=0.0))
        if self.initial == "free":
            largest = max(largest, self.largest_past_input)
        free = past == "unknown"
        return self._cut(
            slice(first, end), initial="free" if free else "periodic", past_input_bound=largest if free else None
        )

    @property
    def largest_past_input(self) -> float:
        """The bound on |u| before a record from an unknown state."""
        return float(np.abs(self.u).max()) if self.past_input_bound is None else self.past_input_bound

    def _sample(self, name: str, seconds: float) -> int:
        """The first sample at or after an instant, which may miss it by rounding."""
        return math.ceil(as_float(name, seconds) / self.dt - 1e-6)

    def _with_known_past(self, first: int, end: int) -> TimeRecord:
        kept = self if self.initial == "periodic" else self._cut(slice(0, end), past_input_bound=self._past_of_cut())
        unused = np.ones(kept.u.shape[0], dtype=bool)
        unused[first:end] = False
        if not np.any(unused):
            return kept
        if kept.bound is None:
            raise InputError(
                "`window` keeps the input outside it and marks the output there as not used, by an infinite `bound`; this"
                ' record has none: call with_bound(...) first, or take past="unknown" or past="periodic"'
            )
        return dataclasses.replace(kept, bound=kept.bound.only(~unused[:, None]))

    def _past_of_cut(self) -> float | None:
        return self.largest_past_input if self.initial == "free" else None

    def _cut(self, samples: slice, **changes: object) -> TimeRecord:
        """Some samples of everything that has one entry per sample."""
        arrays = {name: getattr(self, name) for name in ("u", "y", "reference")}
        cut = {name: array[samples] for name, array in arrays.items() if array is not None}
        bound = None if self.bound is None else self.bound.select(samples)
        return dataclasses.replace(self, bound=bound, **cut, **changes)

    def without_delay(self, seconds: float) -> TimeRecord:
        """The record of the same plant without its delay: the input (and the reference) moved later, the output as it is.

        In periodic steady state any fraction of a sample, exactly, by the DFT of the known input: the bound stays what it
        was. Else whole samples; the output of the first ones, which the input could not reach, is left out.

        Raises
        ------
        InputError
            A fraction of a sample where the record isn't periodic, or where its input has power at pi/dt; a delay
            as long as the record.

        Examples
        --------
        >>> import robustid as rid
        >>> record = rid.TimeRecord([1, 2, 3, 4], [0, 0, 5, 10], dt=0.1)
        >>> later = record.without_delay(0.2)
        >>> later.u.ravel().tolist(), later.y.ravel().tolist()
        ([1.0, 2.0], [5.0, 10.0])
        """
        samples = as_float("seconds", seconds) / self.dt
        whole, total = round(samples), self.u.shape[0]
        exact = abs(samples - whole) <= _WHOLE
        if self.initial == "periodic":
            moved = {"u": _later(self.u, whole if exact else samples)}
            if self.reference is not None:
                moved["reference"] = _later(self.reference, whole if exact else samples)
            return dataclasses.replace(self, **moved)
        if not exact:
            raise InputError(
                f"`seconds` = {seconds:g} is {samples:.6g} samples of {self.dt:g} s: a record that isn't periodic can be moved by"
                " whole samples only. Take the whole ones, and the fraction out of the frequency response"
            )
        if not 0 <= whole < total:
            raise InputError(f"`seconds` = {seconds:g} must be from 0 to less than the record's {total * self.dt:g} s")
        late = self._cut(slice(whole, total), past_input_bound=self._past_of_cut())
        early = self._cut(slice(0, total - whole))
        return dataclasses.replace(late, u=early.u, reference=early.reference)

    def with_bound(self, bound: Bound | ArrayLike | None, note: str = "") -> TimeRecord:
        """Return the samples with a `Bound`, or a half-width of your own, in the place of any other."""
        return dataclasses.replace(self, bound=bound, note=note)


def _later(signal: np.ndarray, samples: float) -> np.ndarray:
    """A periodic signal (T, n) delayed by a number of samples."""
    if isinstance(samples, int):
        return np.roll(signal, samples, axis=0)
    spectrum, total = np.fft.rfft(signal, axis=0), signal.shape[0]
    if total % 2 == 0 and np.any(np.abs(spectrum[-1]) > _WHOLE * np.abs(spectrum).max(axis=0)):
        raise InputError(
            "`seconds` is no whole number of samples, and the input has power at pi/dt, where a fraction of a sample is"
            " ambiguous; take the delay out of the frequency response"
        )
    turn = np.exp(-2j * np.pi * np.arange(len(spectrum)) * samples / total)
    return np.fft.irfft(spectrum * turn[:, None], total, axis=0)


def _labels(stated: object, values: object) -> object:
    """The names that are stated, else those that pandas gives the columns."""
    names = getattr(values, "columns", None) if stated is None else None
    if names is None:
        return stated
    names = list(cast("Sequence[object]", names))
    return names if all(isinstance(name, str) for name in names) else None


def _signal(name: str, value: object) -> np.ndarray:
    array = as_array(name, value)
    if array.ndim == 1:
        array = array[:, None]
    if array.ndim != 2:
        raise InputError(f"`{name}` must have shape (T,) or (T, signals); got {array.shape}")
    if 0 in array.shape:
        raise InputError(f"`{name}` is empty; got shape {array.shape}")
    if array.shape[1] > array.shape[0]:
        raise InputError(
            f"`{name}` has shape {array.shape}: fewer samples than signals. Time is the first axis; transpose it"
        )
    return array


def as_records(name: str, value: object) -> list[TimeRecord]:
    """A record, or a sequence of them, as a list that is not empty; else a sentence."""
    if isinstance(value, TimeRecord):
        return [value]
    kind = type(value).__name__
    items = cast("Sequence[object]", value) if isinstance(value, Sequence) and not isinstance(value, str) else ()
    records: list[TimeRecord] = []
    wrong = ""
    for k, record in enumerate(items):
        if isinstance(record, TimeRecord):
            records.append(record)
        else:
            wrong = wrong or f" with {type(record).__name__} at position {k}"
    if wrong or not records:
        raise InputTypeError(f"`{name}` must be a TimeRecord or a sequence of them; got {kind}{wrong}")
    return records

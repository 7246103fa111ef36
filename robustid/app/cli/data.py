"""From the options of `robustid identify` to measurements: what was read is said, and what is wrong names an option."""

from __future__ import annotations

import contextlib
import dataclasses
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from robustid.app.cli.terminal import plain, warn
from robustid.data import INITIAL, FrequencyResponse, TimeRecord, load
from robustid.data.io import Origin, origin
from robustid.errors import FileFormatError, InputError, InputTypeError

_NOTE = "given on the command line"
_SAME_STEP = 1e-6
_SIGNALS = ("u", "y", "reference", "bound")


@dataclasses.dataclass(frozen=True, kw_only=True)
class Options:
    """How the files of one kind are to be read; what isn't given is None."""

    kind: str
    fields: list[str] | None = None
    bound: float | None = None
    dt: float | None = None
    channel: str | None = None
    unit: str | None = None
    band: str | None = None
    initial: str | None = None
    first: int | None = None

    def check(self, paths: list[Path] | None) -> None:
        """Values that no file can make right, and options of a kind of which there is no file."""
        needs = {"frequency": ("unit", "band"), "time": ("initial", "first")}[self.kind]
        names = {"unit": "--frequency-unit", "fields": f"--{self.kind}-field", "bound": f"--{self.kind}-bound"}
        for name in ("fields", "bound", *needs):
            if getattr(self, name) is not None and not paths:
                option = names.get(name, f"--{name}")
                raise InputError(f"{option} is given without a file: add --{self.kind} FILE, or leave {option} out")
        for option, value in ((names["bound"], self.bound), ("--dt", self.dt), ("--first", self.first)):
            if value is not None and not 0 < value < np.inf:
                raise InputError(f"{option} must be a positive number; got {value:g}")
        if self.initial not in (None, *INITIAL):
            raise InputError(f"--initial must be {', '.join(INITIAL[:-1])} or {INITIAL[-1]}; got {self.initial!r}")
        if self.unit is not None and self.unit.lower() not in ("rad/s", "hz"):
            raise InputError(f"--frequency-unit must be rad/s or Hz; got {self.unit!r}")
        if self.first is not None and self.initial == "periodic":
            raise InputError("--first cuts a record, which --initial periodic needs whole; leave one of them out")


def measurements(out: Any, paths: list[Path] | None, options: Options) -> list[Any]:
    """The files of one kind, one line said about each."""
    options.check(paths)
    seen = set()
    data = []
    for path in paths or []:
        data.append(_measurement(out, path, options))
        if path.resolve() in seen:
            warn(out, f"{path} is given twice: its samples count twice")
        seen.add(path.resolve())
    return data


def _measurement(out: Any, path: Path, options: Options) -> Any:
    kind, fields = options.kind, field_pairs(options)
    with reading(path, kind):
        found = origin(path, kind, fields)
        if found.kind not in (None, kind):
            hint = "use it from Python" if found.kind == "tangential" else f"use --{found.kind} {path}"
            raise InputError(f"{path.name} holds {found.kind} data; {hint}")
        data = load(path, kind=kind, fields=fields, dt=options.dt, bound=options.bound,
                    frequency_unit=options.unit, initial=options.initial)  # fmt: skip
        if data.dt is None:
            raise InputError(f"{path.name} has no sample time: give --dt")
        if data.bound is None:
            what = (
                "the radius of the error disc of every line" if kind == "frequency" else "the half-width of the error"
            )
            raise InputError(f"{path.name} has no error bound: give --{kind}-bound ({what}), or a column bound")
        if options.bound is not None:
            data = data.with_bound(data.bound, note=_NOTE)
        text, data = _channel(data, options.channel, path.name)
        data = part(data, options)
    unit = "" if found.unit_known else options.unit or "rad/s"
    out.print(plain(_described(path, data, text, unit)), highlight=False, soft_wrap=True)
    if found.unit_known and options.unit is not None:
        warn(out, f"--frequency-unit is ignored: {path.name} says the unit of its frequencies")
    compare_step(out, path, found, options)
    return data


@contextlib.contextmanager
def reading(path: Path, kind: str) -> Iterator[None]:
    """Name the file and the options in what is wrong with it."""
    try:
        yield
    except (InputError, InputTypeError, FileFormatError) as error:
        words = in_options(str(error), kind)
        raise type(error)(words if path.name in words else f"{path.name}: {words}") from None


def compare_step(out: Any, path: Path, found: Origin, options: Options) -> None:
    """Warn where a sample time that was given isn't that of the file."""
    if options.dt and found.dt and abs(found.dt - options.dt) > _SAME_STEP * options.dt:
        warn(out, f"--dt {options.dt:g} s is used; {path.name} has {found.dt:.6g} s ({found.dt_from})")


def _described(path: Path, data: Any, channel: str, unit: str) -> str:
    if isinstance(data, FrequencyResponse):
        what, axis, symbol = f"frequency response, {data.omega.size} lines", data.freq_hz, "Hz"
    else:
        what, axis, symbol = f"time record, {data.time.size} samples", data.time, "s"
    text = f"read {path}: {what}, {axis[0]:.5g} to {axis[-1]:.5g} {symbol}, {channel}, dt = {data.dt:g} s"
    if unit.lower() == "rad/s":
        text += "; omega read as rad/s (--frequency-unit Hz if the file has Hz)"
    return text + ("; omega read as Hz" if unit.lower() == "hz" else "")


def _channel(data: Any, wanted: str | None, name: str) -> tuple[str, Any]:
    """The entry that is asked for, else the whole matrix, and what it is in words."""
    outputs, inputs = len(data.outputs), len(data.inputs)
    size = f"{outputs} output{'s' * (outputs > 1)} and {inputs} input{'s' * (inputs > 1)}"
    if wanted is None and outputs * inputs > 1:
        return f"all of {size} (--channel OUTPUT,INPUT for one entry)", data
    try:
        row, column = (int(number) for number in (wanted or "0,0").split(","))
    except ValueError:
        raise InputError(f"--channel must be OUTPUT,INPUT such as 0,0; got {wanted!r}") from None
    if not (0 <= row < outputs and 0 <= column < inputs):
        raise InputError(f"--channel {wanted} (OUTPUT,INPUT from 0) isn't in {name}, which has {size}")
    words = f"{data.outputs[row]} / {data.inputs[column]}"
    if (outputs, inputs) == (1, 1):
        return words, data
    words += f" (channel {row},{column} of {size}; without --channel the whole matrix)"
    return words, data.entry(row, column)


def part(data: Any, options: Options) -> Any:
    """The band and the first samples asked for."""
    if options.band is not None:
        try:
            low, high = (float(number) for number in options.band.split(":"))
        except ValueError:
            raise InputError(f"--band must be LOW:HIGH in Hz, such as 1:21; got {options.band!r}") from None
        return data.band(low, high)
    if options.first is None or not isinstance(data, TimeRecord):
        return data
    if data.initial == "periodic":
        raise InputError("--first cuts the record, which is periodic and needed whole; leave --first out")
    arrays = {name: getattr(data, name) for name in ("u", "y", "bound", "reference")}
    return dataclasses.replace(data, **{k: v[: options.first] for k, v in arrays.items() if v is not None})


def field_pairs(options: Options) -> dict[str, Any] | None:
    """Which role has which name in the file; a signal that is given several times has several channels."""
    option, pairs = f"--{options.kind}-field", {}
    for field in options.fields or []:
        role, sign, name = field.partition("=")
        if not sign:
            raise InputError(f"{option} must be ROLE=NAME, such as u=current; got {field!r}")
        pairs.setdefault(role, []).append(name)
    for role, names in pairs.items():
        if len(names) > 1 and (options.kind != "time" or role not in _SIGNALS):
            raise InputError(f"{option} {role} is given {len(names)} times; give one name")
    return {role: names[0] if len(names) == 1 else names for role, names in pairs.items()} or None


def in_options(text: str, kind: str) -> str:
    """A sentence of the library, with the options of the command line in place of the arguments of Python."""
    beyond = re.search(r"`omega` must not exceed pi/dt = (\S+) rad/s; got (\S+) rad/s", text)
    if beyond:
        nyquist, got = (float(group) / (2 * np.pi) for group in beyond.groups())
        return (
            f"a line at {got:.5g} Hz lies above the Nyquist frequency of {nyquist:.5g} Hz; check --dt, and --frequency-unit:"
            " an omega column is in rad/s unless it says Hz"
        )
    field = f"--{kind}-field"
    for pattern, words in (
        (r"`fields=\{'(\w+)': \.\.\.\}`", rf"{field} \1=NAME"),
        (r"`fields\['(\w+)'\]`", rf"{field} \1"),
        (r"`fields`", f"{field} ROLE=NAME"),
        (r"`dt`", "--dt"),
        (r"`frequency_unit`", "--frequency-unit"),
        (r"`low_hz` = (\S+) and `high_hz` = (\S+) Hz", r"\1 and \2 Hz (--band)"),
    ):
        text = re.sub(pattern, words, text)
    return text


def parse_modes(texts: list[str] | None, dt: float) -> list[tuple[float, float]] | None:
    """--mode HZ:DAMPING, checked in Hz; [] for "none", None where not given."""
    if texts is None:
        return None
    if texts == ["none"]:
        return []
    modes, nyquist = [], 0.5 / dt
    for text in texts:
        try:
            hz, damping = (float(number) for number in text.split(":"))
        except ValueError:
            raise InputError(f'--mode must be HZ:DAMPING such as 17.67:0.004, or "none"; got {text!r}') from None
        if not 0 < damping < 1:
            raise InputError(
                f"--mode {text}: the damping is a ratio between 0 and 1, not percent (10 % is 0.1); got {damping:g}"
            )
        if not 0 < hz * np.sqrt(1 - damping**2) < nyquist:
            raise InputError(
                f"--mode {text}: the frequency must lie between 0 and the Nyquist frequency, {nyquist:g} Hz at dt = {dt:g} s;"
                f" got {hz:g} Hz"
            )
        modes.append((hz, damping))
    return modes

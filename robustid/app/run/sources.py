"""The sections of a run file that say where measurements are, what they are of, and how they become a response; see `options`."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any, ClassVar

from robustid.app.run.checks import Check, Described, either, key, listed, number, roles, several, table, text, whole
from robustid.errors import InputError

if TYPE_CHECKING:
    from robustid.core import Options

USES = ("response", "samples", "noise_floor")
_SIGNALS = ("u", "y", "reference", "bound")
_positive = number(above=0)
_names = table(either(text(), several(either(text(), several(text())))))
_DIGEST = "Digest of the data that were read, by which other data are noticed; written by the program."
_OF_RESPONSE, _OF_RECORD = (
    ("scatter", "coherence"),
    ("periods", "rest"),
)  # what bounds are taken from; see `estimate_bound`
_DT: Described = {"help": "Sample time, where the file doesn't say.", "unit": "s", "flag": "--dt"}
_RATE: Described = {"help": "Sample rate, in place of the sample time.", "unit": "Hz", "flag": "--rate"}
_AXES: Described = {
    "help": "Names of the axes of the arrays in the file, in their order: time,signal,realisation,period or"
    " output,input,frequency; every realisation is a record, and periods follow each other.",
    "flag": "--axes",
}
_DECIMAL: Described = {
    "help": "Decimal mark of a text, a point or a comma, where its numbers don't say.",
    "flag": "--decimal",
}
_READ = ("fields", "dt", "rate", "axes", "decimal", "bound")


def _signal_roles(name: str, content: Iterable[str]) -> dict[str, str | list[str]]:
    return roles(name, content, _SIGNALS)


def _recognised(roles: str) -> str:
    """Names of columns that are found without being told."""
    from robustid.formats import FREQUENCY, TIME

    known = {"FREQUENCY": FREQUENCY, "TIME": TIME}[roles]
    return "; ".join(f"{role}: {', '.join(names)}" for role, names in known.items())


def _response_fields() -> str:
    return (
        "Name in the file of every role: omega=w, real=Re, imag=Im, values=G.data, bound=eps. Recognised without it, upper or"
        f" lower case: {_recognised('FREQUENCY')}; in .npz and .mat the sample time as dt, Ts or T, in text as a"
        " column dt or Ts of one number."
    )


def _record_fields() -> str:
    return (
        "Name or address in the file of every role, repeated for several signals: time=t, u=current, y=angle, y=speed,"
        " reference=setpoint (closed loop), bound=eps; u=x[:,0] is the first column of the array x. Recognised without it, with"
        f" numbers for several (u1, u2, ...): {_recognised('TIME')}."
    )


def _probability(name: str, value: object) -> float:
    if (wanted := number()(name, value)) <= 0 or wanted >= 1:
        raise InputError(f"{name} must be between 0 and 1; got {wanted:g}")
    return wanted


def _bound(words: tuple[str, ...], part: bool) -> Check[float | str]:
    """The check of a bound: a number, or what it is taken from; a part of the response such as "5%" if `part`."""

    def check(name: str, value: object) -> float | str:
        if not isinstance(value, str):
            return _positive(name, value)
        if part and value.strip().endswith("%"):
            return value
        if value not in words:
            others = ' or a part of the response such as "5%",' if part else ""
            raise InputError(f"{name} must be a positive number,{others} or one of {', '.join(words)}; got {value!r}")
        return value

    return check


def _number_or_word(_: str, content: str) -> float | str:
    try:
        return float(content)
    except ValueError:
        return content


def _separated(name: str, content: str) -> list[str]:
    """Corrections from one text, with commas between them."""
    return [part.strip() for part in content.split(",") if part.strip()]


def _corrections(kind: str) -> Any:
    """The key of the corrections of responses or of records."""
    return key(
        several(text()),
        help=f"Mistakes of the file that are undone, one after the other, such as {kind} (on the command line commas"
        " between them, and FILE: before one that is of one of several files); `robustid.prepare.correct` lists them, and what"
        " helps where data contradict a class names them.",
        flag=f"--{'time' if 'late' in kind else 'frequency'}-correct",
        text=_separated,
        metavar="CORRECTION",
    )


@dataclasses.dataclass(frozen=True, kw_only=True)
class RecordSource:
    """A time record: where it is, what is made of it before use, and what it is used for."""

    file: str | None = key(text(), help="File with inputs and outputs, seen from the folder of the run file.")
    dataset: str | None = key(text(), help="Published measurements by name, in place of a file.")
    use: str = key(
        text(USES),
        "response",
        help="What the record is for: response (a frequency response is estimated), samples (as they are), or noise_floor (a"
        " record without excitation that bounds the others).",
    )
    fields: Mapping[str, object] | None = key(
        _names, help=_record_fields, flag="--time-field", text=_signal_roles, metavar="ROLE=NAME"
    )
    dt: float | None = key(_positive, **_DT)
    rate: float | None = key(_positive, **_RATE)
    axes: str | None = key(text(), **_AXES)
    decimal: str | None = key(text((".", ",")), **_DECIMAL)
    bound: float | str | None = key(
        _bound(_OF_RECORD, part=False),
        help="Half-width of the error interval of every sample, in units of y; or what it is taken from, as where none is stated:"
        " periods (the largest deviation from their mean) or rest (the noise before the input moves).",
        flag="--time-bound",
        text=_number_or_word,
        metavar="HALF_WIDTH",
    )
    initial: str | None = key(
        text(listed("data", "INITIAL")),
        help="State before the first sample: rest (zero initial conditions, default), free, or periodic (in steady state).",
        flag="--initial",
    )
    correct: tuple[str, ...] | None = _corrections(
        '"negate", "times 0.001" or "advance 1" (outputs come a sample late)'
    )
    combine: Mapping[str, float] | None = key(
        table(number()), help="One output in place of all: a weighted sum of outputs, by name."
    )
    start: float | None = key(number(least=0), help="Start of the part of the record that is used.", unit="s")
    stop: float | None = key(_positive, help="End of the part of the record that is used.", unit="s")
    past: str | None = key(
        text(listed("data", "PAST")), help="What is known of the input before that part: known, unknown or periodic."
    )
    detrend: str | None = key(text(("mean", "linear")), help="Take out the mean or a straight line.")
    until: float | None = key(_positive, help="The trend is that of the record up to here.", unit="s")
    decimate: int | None = key(whole(2), help="Keep one sample of so many, after a filter.", unit="samples")
    member: str | None = key(text(), help="Name of the member that this was measured of, where there are [[members]].")
    digest: str | None = key(text(), help=_DIGEST)

    kind: ClassVar = "time"

    @property
    def arguments(self) -> Options:
        """The keyword arguments of `robustid.load`."""
        return _arguments(self) | {"initial": self.initial}


@dataclasses.dataclass(frozen=True, kw_only=True)
class ResponseSource:
    """A frequency response that was measured elsewhere."""

    file: str | None = key(text(), help="File with the response, seen from the folder of the run file.")
    fields: Mapping[str, object] | None = key(
        _names, help=_response_fields, flag="--frequency-field", text=roles, metavar="ROLE=NAME"
    )
    dt: float | None = key(_positive, **_DT)
    rate: float | None = key(_positive, **_RATE)
    axes: str | None = key(text(), **_AXES)
    decimal: str | None = key(text((".", ",")), **_DECIMAL)
    start: float | None = key(
        number(least=0),
        help="First frequency of a file that has none, in the unit that is given.",
        flag="--frequency-start",
    )
    step: float | None = key(
        _positive, help="Distance of the frequencies of a file that has none.", flag="--frequency-step"
    )
    bound: float | str | None = key(
        _bound(_OF_RESPONSE, part=True),
        help='Radius of the error disc of every frequency point, in units of the response, or the part of it, such as "5%"; or what'
        " it is taken from, as where none is stated: scatter (around a smooth model) or coherence (with averages).",
        flag="--frequency-bound",
        text=_number_or_word,
        metavar="RADIUS",
    )
    averages: int | None = key(
        whole(2), help="Blocks without overlap behind a coherence that stands beside the response.", flag="--averages"
    )
    unit: str | None = key(
        text(("rad/s", "Hz", "kHz")),
        help="Unit of an omega column that doesn't say it: rad/s (default), Hz or kHz.",
        flag="--frequency-unit",
    )
    correct: tuple[str, ...] | None = _corrections('"conjugate", "times 0.001" or "frequency in Hz"')
    member: str | None = key(text(), help="Name of the member that this was measured of, where there are [[members]].")
    digest: str | None = key(text(), help=_DIGEST)

    kind: ClassVar = "frequency"

    @property
    def arguments(self) -> Options:
        """The keyword arguments of `robustid.load`."""
        return _arguments(self) | {"frequency_unit": self.unit, "start": self.start, "step": self.step}


def _arguments(source: RecordSource | ResponseSource) -> Options:
    """Arguments for both kinds; a word for a bound asks for one that is taken from the data."""
    given = {name: getattr(source, name) for name in _READ}
    return given | {
        "bound": None if isinstance(source.bound, str) and not source.bound.strip().endswith("%") else source.bound
    }


@dataclasses.dataclass(frozen=True, kw_only=True)
class MemberChoice:
    """A plant of a family: its name, which its records and responses state as member, and the condition of its measurement."""

    name: str = key(text(), "", help="Its name, which its records and responses state.")
    amplitude: float | None = key(number(), help="Amplitude of the excitation, in the same unit for all members.")
    position: float | None = key(number(), help="Position of the machine.")
    load: float | None = key(number(), help="Load on the machine.")
    date: str | None = key(text(), help="When it was measured.")
    hz: tuple[float, ...] | None = key(
        several(_positive),
        help="Frequencies of its own poles, as many as [modes] has; default: those that [modes] states, else from its data.",
        unit="Hz",
    )
    damping: tuple[float, ...] | None = key(several(_positive), help="Damping ratios of its own poles.")
    hz_interval: tuple[tuple[float, float], ...] | None = key(
        several(several(_positive, 2)),
        help="Its own pole-uncertainty box, where over_poles = true: an interval for each of hz; default: that of [modes], or what"
        " its data leave.",
        unit="Hz",
    )
    damping_interval: tuple[tuple[float, float], ...] | None = key(
        several(several(_positive, 2)), help="Its own pole-uncertainty box: an interval for each of damping."
    )


@dataclasses.dataclass(frozen=True, kw_only=True)
class FamilyChoice:
    """Options of all members together."""

    schedule: str | None = key(
        text(("amplitude", "position", "load")),
        help="The condition by which the members are told apart; default: the only one that every member states, and that differs.",
    )
    interval: tuple[float, float] | None = key(
        several(number(), 2),
        help="Range of it that is asked about; default: from the smallest to the largest of the members.",
    )
    order: int | None = key(
        whole(1), help="Order of the nominal; default: the smallest whose band is almost the smallest."
    )


@dataclasses.dataclass(frozen=True, kw_only=True)
class Estimate:
    """The way from the records to a frequency response with bounds."""

    method: str | None = key(
        text(("periodic", "local", "welch")),
        help="periodic, local (any excitation) or welch (a first look, smeared). Default: periodic where there is a period,"
        " else local.",
        flag="--method",
    )
    period: int | None = key(whole(2), help="Period of the excitation.", unit="samples", flag="--period")
    probability: float = key(
        _probability,
        0.95,
        help="Probability of the bound, for all spectral lines and entries at once.",
        flag="--probability",
    )
    about: str = key(
        text(("mean", "next record")),
        "mean",
        help='What the bound holds for: the "mean" response over all realisations of the excitation, or that in the "next record",'
        " with what changes from one to the next.",
        flag="--about",
    )
    noise_floor_factor: float = key(
        number(least=1), 1.5, help="Bounds are so many times the noise floor, where a record gives it."
    )

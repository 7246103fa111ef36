"""Checks of values, which say in one sentence what is wrong, and the description of an option for every way to state it."""

from __future__ import annotations

import contextlib
import dataclasses
import difflib
import importlib
import math
from collections.abc import Callable, Generator, Iterable, Iterator
from typing import TYPE_CHECKING, Any, Required, TypedDict, TypeVar, Unpack

from robustid.app.run.toml import is_array, is_table
from robustid.errors import InputError, InputTypeError, SizeError

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

AUTO = "auto"
_RENAMED = {
    "lines": "frequency_points",
    "rest_factor": "noise_floor_factor",
    "channel": "entry",
}  # keys of older run files
# Words that engineers write, by the keys that are meant, and where those stand.
_ROLES = 'signals are named by their roles: fields = { u = "force", y = "position" } in [[record]] or [[frequency]]'
_WORDS: tuple[tuple[str, tuple[str, ...], str], ...] = (
    ("input inputs output outputs signal signals columns column channels", ("fields",), _ROLES),
    (
        "fs rate sample_rate sampling_rate samplerate",
        ("rate",),
        "the sample rate is rate, in [[record]] or [[frequency]]",
    ),
    (
        "ts sample_time sampling_time timestep step_time",
        ("dt",),
        "the sample time is dt, in [[record]] or [[frequency]]",
    ),
    (
        "noise error errors tolerance sigma uncertainty",
        ("bound",),
        "errors are bounded by bound, in [[record]] or [[frequency]]",
    ),
    ("n nx states n_states model_order", ("order",), "the order of a fit is order, in [fit]"),
    ("poles kautz resonances mode modes_hz f0", ("hz",), "modes are hz and damping, in [modes]"),
    ("zeta xi damping_ratio damping_ratios", ("damping",), "modes are hz and damping, in [modes]"),
    ("k gain gamma", ("gain_bound",), "the size of the non-parametric part is gain_bound, in [prior]"),
    ("rho", ("decay_rate",), "the decay is decay_rate (of samples) or decay (1/s), in [prior]"),
    ("alpha", ("decay",), "the decay is decay_rate (of samples) or decay (1/s), in [prior]"),
    ("fmin fmax range band frequency_range", ("band_hz",), "a band is band_hz = [low, high], in [frequency_points]"),
    (
        "scale sign flip conjugate transpose",
        ("correct",),
        'a mistake is undone by correct = ["times 0.001"], in [[frequency]]',
    ),
    ("timeout max_time budget", ("time_limit",), "time_limit is in [identify], [fit], [small_model] and [worst_case]"),
    ("path filename filepath source", ("file",), "data are file = ..., in [[record]] or [[frequency]]"),
    ("dead_time latency", ("seconds",), "a delay is seconds, in [delay]"),
)
_MEANT = {word: (*keys, where) for words, keys, where in _WORDS for word in words.split()}
T = TypeVar("T")
Kind = TypeVar("Kind", bound="DataclassInstance")
Check = Callable[[str, object], T]  # (name, value) -> the value to take; raises with the name in the sentence


@dataclasses.dataclass(frozen=True, kw_only=True)
class Option:
    """Description of one option: the key of a run file, and where these are given, that of the command line and of Python."""

    check: Check[object]
    help: str | Callable[[], str]  # in whole sentences; a callable is asked when the text is shown
    unit: str = ""
    flag: str | None = None  # its spelling on the command line; None where it has no place there
    text: Callable[[str, Any], object] | None = (
        None  # to what `check` takes, where that isn't the plain type of the field
    )
    metavar: str | None = None  # form of that text, such as LOW:HIGH
    keyword: str | None = None  # its name as an argument of `identify_reduced`

    @property
    def sentence(self) -> str:
        """The help as text."""
        return self.help if isinstance(self.help, str) else self.help()


class Described(TypedDict, total=False):
    """Everything of an `Option` but its check."""

    help: Required[str | Callable[[], str]]
    unit: str
    flag: str | None
    text: Callable[[str, Any], object] | None
    metavar: str | None
    keyword: str | None


def key(check: Check[T], default: T | None = None, **described: Unpack[Described]) -> Any:
    """A field of a section, with the description of its option; default None: left to the program."""
    return dataclasses.field(default=default, metadata={"option": Option(check=check, **described)})


def explained(part: str) -> Any:
    """A field that says where the values of a section come from: its source, note or digest."""
    check = text(listed("core", "Source")) if part == "source" else text()
    return key(check, help=f"{_EXPLAINED[part]}; written by the program.")


_EXPLAINED = {
    "source": "Where these values come from: stated (default), data (taken from them), program, or stopped (data, in a search that"
    " was ended)",
    "note": "How the program chose these values, in words",
    "digest": "Digest of the chosen values, by which changed ones are noticed",
}


def options(kind: DataclassInstance | type[DataclassInstance]) -> Iterator[tuple[dataclasses.Field[Any], Option]]:
    """The fields of a section that can be stated."""
    return ((field, field.metadata["option"]) for field in dataclasses.fields(kind) if "option" in field.metadata)


def section(kind: type[Kind], content: object, place: str) -> Kind:
    """A section of the kind, every key known and of the right type."""
    if not is_table(content):
        raise InputTypeError(f"{place} must be a section with keys; got {_got(content)}")
    checks = {field.name: option.check for field, option in options(kind)}
    refuse_unknown(content, checks, place)
    return kind(**{name: checks[name](f"{place} {name}", value) for name, value in content.items()})


def refuse_unknown(
    content: Iterable[str], known: Iterable[str], place: str, word: str = "key", error: type = InputError
) -> None:
    """Raise an error with the nearest known key for one that isn't."""
    known = list(known)
    for name in content:
        if name not in known:
            if (now := _RENAMED.get(name)) in known:
                raise error(f"{place} has no {word} {name!r} any more: it is called {now!r} now")
            if word == "key" and (meant := _MEANT.get(str(name).lower())) is not None:
                here = next((one for one in meant[:-1] if one in known), None)
                raise error(
                    f"{place} has no {word} {name!r}; " + (f"it is called {here!r}: {meant[-1]}" if here else meant[-1])
                )
            near = difflib.get_close_matches(name, known, n=1)
            hint = f"the nearest is {near[0]!r}; all" if near else "these are known"
            raise error(f"{place} has no {word} {name!r}; {hint}: {', '.join(known)}")


@contextlib.contextmanager
def too_large(way_out: str) -> Generator[None]:
    """Say of data that are too large how less of them is asked for here, in place of the arguments that Python has for it."""
    try:
        yield
    except SizeError as error:
        raise error.reworded({"problem": "the problem"}, lambda _: f"Use a part of the data: {way_out}") from None


def text(choices: Iterable[str] | Callable[[], Iterable[str]] = ()) -> Check[str]:
    """Text, one of the choices where there are any (upper or lower case); a callable is asked for them when they are needed."""

    def check(name: str, value: object) -> str:
        if not isinstance(value, str):
            raise InputTypeError(f"{name} must be text in quotes; got {_got(value)}")
        known = {choice.lower(): choice for choice in (choices() if callable(choices) else choices)}
        if known and value.lower() not in known:
            raise InputError(f"{name} must be one of {', '.join(known.values())}; got {value!r}")
        return known.get(value.lower(), value)

    return check


def number(above: float = -math.inf, least: float = -math.inf) -> Check[float]:
    """A finite number."""

    def check(name: str, value: object) -> float:
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise InputTypeError(f"{name} must be a number; got {_got(value)}")
        if not math.isfinite(value):
            raise InputError(f"{name} must be finite; got {value}")
        if value <= above or value < least:
            limit = f"at least {least:g}" if value > above else f"above {above:g}" if above else "positive"
            raise InputError(f"{name} must be {limit}; got {value:g}")
        return float(value)

    return check


def whole(least: int = 0, most: float = math.inf) -> Check[int]:
    """A whole number."""

    def check(name: str, value: object) -> int:
        if isinstance(value, bool) or not isinstance(value, int):
            raise InputTypeError(f"{name} must be a whole number; got {_got(value)}")
        if not least <= value <= most:
            limit = f"at least {least}" if value < least else f"at most {most}"
            raise InputError(f"{name} must be {limit}; got {value}")
        return value

    return check


def flag(name: str, value: object) -> bool:
    """True or false."""
    if not isinstance(value, bool):
        raise InputTypeError(f"{name} must be true or false; got {_got(value)}")
    return value


def several(item: Check[T], size: int | None = None) -> Check[tuple[T, ...]]:
    """An array, of `size` items where that is given."""

    def check(name: str, value: object) -> tuple[T, ...]:
        if not is_array(value):
            raise InputTypeError(f"{name} must be an array in [ ]; got {_got(value)}")
        if size is not None and len(value) != size:
            raise InputError(f"{name} must have {size} items; got {len(value)}")
        return tuple(item(f"{name.removesuffix(',')}, item {k + 1},", one) for k, one in enumerate(value))

    return check


def table(item: Check[T]) -> Check[dict[str, T]]:
    """A table of names and values."""

    def check(name: str, value: object) -> dict[str, T]:
        if not is_table(value) or not value:
            raise InputTypeError(f"{name} must be a table such as {{ name = value }}; got {_got(value)}")
        return {part: item(f"{name} {part}", one) for part, one in value.items()}

    return check


def either(*checks: Check[T]) -> Check[T]:
    """A value that passes one of the checks; the sentence is that of the last."""

    def check(name: str, value: object) -> T:
        for one in checks[:-1]:
            try:
                return one(name, value)
            except (InputError, InputTypeError):
                continue
        return checks[-1](name, value)

    return check


def auto_or(item: Check[T]) -> Check[T | str]:
    """A value that passes the check, or the word auto."""

    def check(name: str, value: object) -> T | str:
        if isinstance(value, str):
            if value == AUTO:
                return value
            raise InputError(f'{name} must be "{AUTO}" or a number; got {value!r}')
        return item(name, value)

    return check


# Forms of values on the command line.


def low_high(name: str, content: str) -> tuple[float, float]:
    """Two frequencies from LOW:HIGH."""
    try:
        low, high = (float(part) for part in content.split(":"))
    except ValueError:
        raise InputError(f"{name} must be LOW:HIGH in Hz, such as 5:200; got {content!r}") from None
    return low, high


def hz_levels(name: str, content: str) -> list[list[float]]:
    """Rows of a table from HZ:LEVEL,HZ:LEVEL,..."""
    try:
        return [[float(part) for part in row.split(":")] for row in content.split(",")]
    except ValueError:
        raise InputError(
            f"{name} must be HZ:LEVEL,HZ:LEVEL,... such as 10:1,200:1,2000:0.01; got {content!r}"
        ) from None


def output_input(name: str, content: str) -> list[int | str]:
    """Two numbers or names from OUTPUT,INPUT."""
    parts = [part.strip() for part in content.split(",")]
    if len(parts) != 2 or not all(parts):
        raise InputError(f"{name} must be OUTPUT,INPUT, by number or name, such as 0,0; got {content!r}")
    return [int(part) if part.isdigit() else part for part in parts]


def roles(name: str, content: Iterable[str], repeated: tuple[str, ...] = ()) -> dict[str, str | list[str]]:
    """The name in the file of every role; a role that may be repeated has several signals."""
    found: dict[str, list[str]] = {}
    for pair in content:
        role, sign, title = pair.partition("=")
        if not sign:
            raise InputError(f"{name} must be ROLE=NAME, such as u=current; got {pair!r}")
        found.setdefault(role, []).append(title)
    for role, titles in found.items():
        if len(titles) > 1 and role not in repeated:
            raise InputError(f"{name} {role} is given {len(titles)} times; give one name")
    return {role: titles[0] if len(titles) == 1 else titles for role, titles in found.items()}


def _got(value: object) -> str:
    shown = repr(value)
    return shown if len(shown) <= 60 else shown[:57] + "..."


def listed(room: str, name: str) -> Callable[[], Iterable[str]]:
    """The values that a room knows, asked for when they are needed: to import a room takes a while."""
    return lambda: getattr(importlib.import_module(f"robustid.{room}"), name)

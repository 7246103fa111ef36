"""Structures and goals of controllers as they are written in run files and commands: a small grammar, read and never evaluated.

``PID(80), Notch(300..400, damping=0.5), LowPass(900, order=2)``: factors with their frequencies in Hz, intervals with two dots; of
several outputs one such loop to each, ``Diagonal(PI, PID(80) * Notch(30))`` other ones, ``Matrix(PI, 0; P, PI)`` any, by rows.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

from robustid.errors import InputError

if TYPE_CHECKING:
    from robustid.controllers import Attenuation, Factor, Matrix
    from robustid.core import Real

    Rows = list[list[tuple[Factor, ...] | None]]

_TOKEN = re.compile(
    r"\s*(?:(?P<number>(?:\d+(?:\.\d+)?|\.\d+)(?:[eE][-+]?\d+)?)|(?P<word>[A-Za-z]+)|(?P<sign>\.\.|[(),;=*]))"
)
_HZ = 2 * math.pi
GOALS = ("bandwidth", "integral-gain", "least-control")
_FORMS = "P, PI, PD(80), PID(80), Notch(300..400, damping=0.5), LeadLag(20), LowPass(900, order=2), FIR(3)"
_SEVERAL = "of several loops Diagonal(PI, PID(80) * Notch(30)), or rows: Matrix(PI, 0; P, PI)"
Value = tuple[float, float]


class _Form(NamedTuple):
    """Arguments of a factor: the first one without its name, the others by it; and what it becomes."""

    first: str  # its name; empty: none
    others: tuple[str, ...]
    make: Callable[..., Factor]
    example: str


def _forms() -> dict[str, _Form]:
    from robustid.controllers import FIR, PID, LeadLag, LowPass, Notch

    def of_order(omega: Any, order: float = 1) -> LowPass:
        return LowPass(omega, int(order))

    def without_integral(filter: Any) -> PID:
        return PID(filter=filter, integral=False)

    def of_length(length: float) -> FIR:
        return FIR(int(length))

    return {
        "p": _Form("", (), lambda: PID(integral=False), "P"),
        "pi": _Form("", (), PID, "PI"),
        "pd": _Form("filter", (), without_integral, "PD(80)"),
        "pid": _Form("filter", (), PID, "PID(80)"),
        "notch": _Form("omega", ("damping",), Notch, "Notch(300..400, damping=0.5)"),
        "leadlag": _Form("omega", (), LeadLag, "LeadLag(20)"),
        "lowpass": _Form("omega", ("order",), of_order, "LowPass(900, order=2)"),
        "fir": _Form("length", (), of_length, "FIR(3)"),
    }


def structure_of(name: str, text: str) -> tuple[Factor, ...] | Matrix:
    """A structure, factors or a matrix of them; `name`: where it stands, for messages."""
    reader = _Reader(name, text)
    for word, read in (("matrix", reader.rows), ("diagonal", reader.diagonal)):
        if reader.opens(word):
            return _matrix(reader, read())
    found = [reader.factor()]
    while not reader.ended:
        if not (reader.accept(",") or reader.accept("*")):
            raise reader.error("a comma between two factors")
        found.append(reader.factor())
    return tuple(found)


def structure_around(
    found: tuple[Factor, ...] | Matrix, beside: Sequence[Any], around: Mapping[str, Real]
) -> tuple[Factor, ...] | Matrix:
    """A structure with further factors of each loop, between constant matrices `actuators` and `sensors`."""
    from robustid.controllers import Matrix, entries_of

    if isinstance(found, tuple):
        if not around:
            return (*found, *beside)
        count = around["actuators"].shape[1] if "actuators" in around else len(around["sensors"])
        found = Matrix([[found if i == j else None for j in range(count)] for i in range(count)])
    nu, ny = found.shape
    rows: Rows = [[None] * ny for _ in range(nu)]
    for i, j, factors in entries_of(found, (ny, nu)):
        rows[i][j] = (*factors, *beside)
    return Matrix(rows, **around)


def structure_text(name: str, value: object) -> str:
    """Check of a key: a text that is a structure."""
    if not isinstance(value, str):
        raise InputError(f"{name} must be text in quotes such as {_FORMS}; got {value!r}")
    found = structure_of(name, value)
    for factor in found if isinstance(found, tuple) else _inside(found):
        _ = factor.free  # checks its numbers
    return value


def _inside(matrix: Matrix) -> Iterator[Factor]:
    from robustid.controllers import entries_of

    nu, ny = matrix.shape
    return (one for *_, factors in entries_of(matrix, (ny, nu)) for one in factors)


def _matrix(reader: _Reader, rows: Rows) -> Matrix:
    """Rows of one length, one to each input."""
    from robustid.controllers import Matrix

    if not reader.ended:
        raise reader.error("the end")
    for k, row in enumerate(rows):
        if len(row) != len(rows[0]):
            raise InputError(
                f"{reader.name} {reader.text!r}: rows of a matrix have as many entries each; got {len(rows[0])} in row 1 and"
                f" {len(row)} in row {k + 1}. An entry of nothing is 0"
            )
    if not any(one for row in rows for one in row):
        raise InputError(f"{reader.name} {reader.text!r}: a matrix needs a factor in one entry at least")
    return Matrix(rows)


def goal_of(name: str, text: str) -> str | Attenuation:
    """A goal as `design_controller` takes it."""
    from robustid.controllers import Attenuation

    if text in GOALS:
        return text.replace("-", " ")
    word, *ends = text.split(":")
    try:
        low, high = (float(end) for end in ends)
    except ValueError:
        low = high = math.nan
    if word != "attenuation" or not 0 <= low < high < math.inf:
        raise InputError(
            f"{name} must be one of {', '.join(GOALS)} or attenuation:LOW:HIGH in Hz, such as attenuation:1:20; got {text!r}"
        )
    return Attenuation(_HZ * low, _HZ * high)


def goal_text(name: str, value: object) -> str:
    """Check of a key: a text that is a goal."""
    if not isinstance(value, str):
        raise InputError(f"{name} must be text in quotes; got {value!r}")
    goal_of(name, value)
    return value


class _Reader:
    """A text, read from its beginning: factors with their arguments."""

    def __init__(self, name: str, text: str) -> None:
        self.name, self.text, self.place = name, text, 0

    @property
    def ended(self) -> bool:
        """True where nothing is left."""
        return not self.text[self.place :].strip()

    def error(self, wanted: str) -> InputError:
        """Sentence on what is wanted at this place."""
        rest = self.text[self.place :].strip()
        where = f"at {rest[:20]!r}" if rest else "at its end"
        return InputError(
            f"{self.name} {self.text!r}: {wanted} is missing {where}. Factors are {_FORMS}, in Hz; {_SEVERAL}"
        )

    def _next(self, kind: str) -> str | None:
        """The next token, where it is of this kind."""
        found = _TOKEN.match(self.text, self.place)
        if found is None or found[kind] is None:
            return None
        self.place = found.end()
        return found[kind]

    def accept(self, sign: str) -> bool:
        """Go beyond a sign; false where there is another one."""
        before = self.place
        if self._next("sign") == sign:
            return True
        self.place = before
        return False

    def opens(self, word: str) -> bool:
        """Go beyond a word and the bracket behind it; false where something else stands here."""
        before = self.place
        if (self._next("word") or "").lower() == word and self.accept("("):
            return True
        self.place = before
        return False

    def rows(self) -> Rows:
        """Rows of entries up to the closing bracket: entries with commas, rows with semicolons between them."""
        found = [[self._entry()]]
        while not self.accept(")"):
            if self.accept(","):
                found[-1].append(self._entry())
            elif self.accept(";"):
                found.append([self._entry()])
            else:
                raise self.error("a comma, a semicolon or a closing bracket")
        return found

    def diagonal(self) -> Rows:
        """Rows of a matrix of which the diagonal is stated, up to the closing bracket."""
        found = [self._entry()]
        while not self.accept(")"):
            if not self.accept(","):
                raise self.error("a comma or a closing bracket")
            found.append(self._entry())
        return [[one if i == j else None for j in range(len(found))] for i, one in enumerate(found)]

    def _entry(self) -> tuple[Factor, ...] | None:
        """Factors with * between them, or 0 for nothing."""
        before = self.place
        if (text := self._next("number")) is not None:
            if float(text) == 0:
                return None
            self.place = before
            raise self.error("a factor, or 0,")
        found = [self.factor()]
        while self.accept("*"):
            found.append(self.factor())
        return tuple(found)

    def factor(self) -> Factor:
        """One factor."""
        forms, word = _forms(), self._next("word")
        if word is None:
            raise self.error("a factor")
        form = forms.get(word.lower())
        if form is None:
            raise InputError(
                f"{self.name} {self.text!r}: there is no factor {word!r}. Factors are {_FORMS}, in Hz; {_SEVERAL}"
            )
        arguments: dict[str, Value] = {}
        if self.accept("(") and not self.accept(")"):
            self._argument(form, word, arguments, first=True)
            while self.accept(","):
                self._argument(form, word, arguments, first=False)
            if not self.accept(")"):
                raise self.error("a closing bracket")
        if form.first and form.first not in arguments:
            raise InputError(
                f"{self.name} {self.text!r}: {word} needs its number, such as {form.example}"
                + ("; without a derivative it is PI" if word.lower() == "pid" else "")
            )
        return form.make(**{key: self._meant(word, key, value) for key, value in arguments.items()})

    def _argument(self, form: _Form, word: str, arguments: dict[str, Value], *, first: bool) -> None:
        """One argument, NAME=VALUE or the first one without its name."""
        before, key = self.place, self._next("word")
        if key is None or not self.accept("="):
            self.place, key = before, form.first if first else ""
        known = [one for one in (form.first, *form.others) if one]
        if key == "" and known and not first:
            raise self.error(f"a name, such as {known[-1]}=")
        if key not in known:
            said = f"it has {' and '.join(known)}" if known else "it has none"
            raise InputError(f"{self.name} {self.text!r}: {word} has no argument {key or 'without a name'!s}; {said}")
        if key in arguments:
            raise InputError(f"{self.name} {self.text!r}: {key} of {word} is given twice")
        arguments[key] = self._value()

    def _value(self) -> Value:
        """A number, or an interval of two."""
        low = self._number()
        return (low, self._number()) if self.accept("..") else (low, low)

    def _number(self) -> float:
        text = self._next("number")
        if text is None:
            raise self.error("a number")
        before = self.place
        if (self._next("word") or "").lower() != "hz":
            self.place = before
        return float(text)

    def _meant(self, word: str, key: str, value: Value) -> Any:
        """A value in the unit of the library; frequencies may be intervals, nothing else."""
        low, high = value
        if key in ("filter", "omega"):
            if not 0 < low <= high:
                raise InputError(
                    f"{self.name} {self.text!r}: {word} needs positive frequencies, low before high; got {low:g}..{high:g}"
                )
            return (_HZ * low, _HZ * high) if low < high else _HZ * low
        if low != high:
            raise InputError(f"{self.name} {self.text!r}: {key} of {word} is one number, no interval")
        if key in ("length", "order") and low != int(low):
            raise InputError(f"{self.name} {self.text!r}: {key} of {word} is a whole number; got {low:g}")
        return low

"""Words in the headings of columns, in one table: quantity, entry of a matrix, part of a complex number, unit and sign."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import NamedTuple

from robustid.formats import units

# What a word says of a column. Words that are put together ("zreal", "imz", "rezdd") are taken apart.
PARTS = {
    **dict.fromkeys(("re", "real", "realteil"), "real"),
    **dict.fromkeys(("im", "img", "imag", "imaginary", "imaginär", "imaginärteil"), "imag"),
    **dict.fromkeys(("mag", "magnitude", "abs", "mod", "modulus", "betrag"), "magnitude"),
    **dict.fromkeys(("phase", "phz", "ph", "phi", "arg", "angle", "ang", "theta"), "phase"),
}
QUANTITIES = {"z": "Z", "impedance": "Z", "impedanz": "Z", "imp": "Z", "y": "Y", "admittance": "Y",
              "s": "S", "h": "H", "g": "G",
              **dict.fromkeys(("h1", "h2", "hv"), "H"),  # estimates of a response by an analyser of vibration
              "gain": "G",
              "frf": "H", "spl": "SPL"}  # fmt: skip
AXES = {
    **dict.fromkeys(("frequency", "frequencies", "freq", "f", "stimulus", "frequenz"), "frequency"),
    **dict.fromkeys(
        ("time", "t", "times", "zeit", "timestamp", "time stamp", "datetime", "date time", "date/time"), "time"
    ),
}
LEVELS = ("gain", "amplitude", "level")  # magnitudes if they are in dB
_SILENT = {"log", "lin", "of", "part", "response", "trace", "value", "data"}  # they change nothing
_ALONE = {"Z": units.OHM, "Y": units.SIEMENS}  # quantities whose letter alone says them only in these units
_SIGNS = ("-", "−", "–", "neg. ", "neg ", "minus ")
_PRIMES = ((re.compile(r"([zy])\s*(?:''|\"|´´|’’|″|′′)"), r"\1 imag "), (re.compile(r"([zy])\s*['´’′]"), r"\1 real "))
_BARS = re.compile(r"\|([^|]+)\|")
_ANGLE_SIGN = re.compile(r"[∠∡<]\s*(?=[a-z])")
_APART = re.compile(r"[\s_:;(){}\[\]<>.,*]+")
_WORD = "|".join(sorted(PARTS, key=len, reverse=True))
_TOGETHER = re.compile(
    rf"(?P<before>{_WORD})?(?P<quantity>[zyshg])(?P<entry>[dq]{{2}}|[pn]{{2}}|[1-9]{{2}})?(?P<behind>{_WORD})?"
)
_TRACE = re.compile(rf"(?P<before>{_WORD})?trc\d*|\d{{1,2}}")
_POINTS = re.compile(
    r"\(\s*\d+(r?[xyz][+-]?)?\s*[/,]\s*\d+(r?[xyz][+-]?)?\s*\)", re.I
)  # response and reference, (12Z+/2Z+)
_ENTRIES = {a + b for axes in ("dq", "pn") for a in axes for b in axes}  # of rotating axes, of sequences
_LONGEST, _MOST_NAMED = 200, 4  # characters; names
# ZPlot names the axes of its plots so.
_PROGRAMS = {"z'(a)": "z' [Ohm]", "z''(b)": "z'' [Ohm]"}
# Columns of formats that have no line of names, by the ending of the file.
BY_ENDING = {
    ".frd": ("Frequency [Hz]", "SPL [dB]", "Phase [deg]"),
    ".zma": ("Frequency [Hz]", "|Z| [Ohm]", "Phase [deg]"),
}


class Heading(NamedTuple):
    """Meaning of a column by its name; "" for what the name leaves open."""

    quantity: str  # {"Z", "Y", "S", "H", "G", "SPL", ""}
    entry: str  # of a matrix: the letters or numbers of output and input, "dq", "21"
    part: str  # {"real", "imag", "magnitude", "phase", ""}
    unit: str  # as it is written
    sign: int  # {1, -1}; -1 where the name says that the column holds the negative

    @property
    def decibels(self) -> bool:
        """Return whether the unit is one of decibels."""
        return self.unit.lower().startswith("db")

    @property
    def words(self) -> str:
        """Description of the column: "imaginary part of Z in Ohm, its sign turned"."""
        names = {"real": "real part", "imag": "imaginary part", "magnitude": "magnitude", "phase": "phase"}
        of = f"{self.quantity}{self.entry}"
        text = f"{names[self.part]} of {of}" if of and self.part else names.get(self.part, of)
        return text + f" in {self.unit}" * bool(self.unit) + ", its sign turned" * (self.sign < 0)


def heading(name: str) -> Heading | None:
    """The heading that a name is; None where a word of it isn't known, or where it says neither a quantity nor a part."""
    if len(name) > _LONGEST:
        return None
    bare = name.strip()
    base, unit = units.in_brackets(_PROGRAMS.get(bare.lower().replace(" ", ""), _POINTS.sub(" ", bare)))
    if not unit:
        base, unit = units.axis_label(base)
    if unit and _said(unit) is not None and unit.lower() not in ("db", "deg", "s", "h", "g"):  # "S11(REAL)", "Re(Z)"
        base, unit = f"{base} {unit}", ""
    if "(" in base and not base.rstrip().endswith(")"):  # "|Z| (Ohm) mean": no heading of one part
        return None
    base, sign = base.lower().strip(), 1
    for mark in _SIGNS:
        if base.startswith(mark):
            base, sign = base[len(mark) :], -1
            break
    if (said := _said(base)) is None:
        return None
    quantity, entry, part = said
    unit = "" if unit.lower() in ("u", "1", "-") else unit
    if not part and units.factor(units.PHASE, unit) is not None:
        part = "phase"
    elif not part and (unit.lower() == "db" or units.factor(_ALONE.get(quantity, {}), unit) is not None):
        part = "magnitude"
    if quantity == "Y" and not entry and units.factor(units.SIEMENS, unit) is None:  # of a signal y
        return None
    if not part and not entry:
        return None
    return Heading(quantity, entry, part, unit, sign)


def turned(names: Iterable[str]) -> str:
    """End of a line that says which columns are negated for the minus in their names; empty where none is."""
    found = [repr(name) for name in names if (said := heading(name)) is not None and said.sign < 0]
    shown = ", ".join(found[:_MOST_NAMED]) + " …" * (len(found) > _MOST_NAMED)
    return f"; the sign of {shown} is turned, as the minus in the name says" if found else ""


def _said(base: str) -> tuple[str, str, str] | None:
    """Quantity, entry and part that the words of a name say; None where one of them isn't known or two contradict."""
    text = _BARS.sub(r" abs \1 ", base.lower())
    for pattern, words in _PRIMES:
        text = pattern.sub(words, text)
    text = _ANGLE_SIGN.sub("arg ", text)
    found: dict[str, set[str]] = {"quantity": set(), "entry": set(), "part": set()}
    tokens = [token for token in _APART.split(text) if token]
    for token in tokens:
        if token in PARTS:
            found["part"].add(PARTS[token])
        elif token in QUANTITIES:
            found["quantity"].add(QUANTITIES[token])
        elif match := _TOGETHER.fullmatch(token):
            found["quantity"].add(QUANTITIES[match["quantity"]])
            found["entry"] |= {match["entry"]} - {None}
            found["part"] |= {PARTS[word] for word in (match["before"], match["behind"]) if word}
        elif match := _TRACE.fullmatch(token):
            found["part"] |= {PARTS[match["before"]]} if match["before"] else set()
        elif token in _ENTRIES:
            found["entry"].add(token)
        elif token not in _SILENT:
            return None
    if not (found["quantity"] or found["part"]) or any(len(one) > 1 for one in found.values()):
        return None
    quantity, entry, part = ("".join(one) for one in found.values())
    return quantity, entry, part

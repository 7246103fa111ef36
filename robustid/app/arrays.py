"""One array of a file, as a person would describe it: shape, range, what its name says, and what is odd about it."""

from __future__ import annotations

import re

import numpy as np

from robustid.core import Real, hz_words, telling_digits
from robustid.data import Fault, FaultKind
from robustid.formats import Item, axis_role, heading, seconds_in

_EVEN = 1e-6  # part of a step
_FEW = 8  # rows of a spectrum
_FIRST = 1000  # numbers
_MAGNITUDE, _PHASE = re.compile(r"^mag(n|$)|magn|gain|ampl|^abs", re.I), re.compile(r"pha|arg|angle|°|deg", re.I)
_AXIS = re.compile(r"f$|freq|omega|hz|rad|w$", re.I)
_TIME = re.compile(r"\bt$|time", re.I)


def shape_words(item: Item) -> str:
    """Sizes of an array, or the kind of anything else."""
    return " x ".join(map(str, item.shape)) if item.values is not None else item.kind


def said_words(item: Item, *, of_record: bool = False) -> str:
    """Range of an item, and what its name says of it: quantity, unit, and whether its sign is turned; of a signal nothing."""
    said = heading(item.address) if item.kind == "real" and not of_record else None
    known = said is not None and said.part and (said.unit or said.quantity or said.sign < 0)
    return f"{_range(item)}: {said.words}" if said is not None and known else _range(item)


def _range(item: Item) -> str:
    """Range of numbers, with their step where they are evenly spaced; else the text."""
    if item.values is None or not item.values.size:
        return item.text.replace("\n", ", ")[:60]
    values = np.asarray(item.values)
    if np.iscomplexobj(values):
        size = np.abs(values[np.isfinite(values)])
        return f"complex, magnitudes {size.min():.4g} to {size.max():.4g}" if size.size else "not finite"
    known = np.isfinite(values)
    finite: Real = np.asarray(values if np.all(known) else values[known], dtype=float)
    if not finite.size:
        return "not finite"
    if values.size == 1:
        return f"{finite.ravel()[0]:.6g}"
    low, high = float(finite.min()), float(finite.max())
    digits = telling_digits(low, high, 4)
    words = f"{low:.{digits}g} to {high:.{digits}g}"
    step = _step(values)
    if step:
        words += f", evenly spaced by {step:.6g}"
        if _TIME.search(item.name):
            scale = seconds_in(item.address)
            words += f" ({'as seconds: ' if scale is None else ''}{1 / (step * (scale or 1)):.6g} samples per second)"
        elif _AXIS.search(item.name) and not item.unit and axis_role(item.address.rpartition(".")[2]) != "freq_hz":
            words += f" (as Hz up to {hz_words(high, 4)}; as rad/s up to {hz_words(high / (2 * np.pi), 4)})"
    return words


def _step(values: np.ndarray) -> float:
    """Step of numbers that are evenly spaced; 0 of others."""
    flat: Real = np.asarray(values, dtype=float).ravel()
    first = np.diff(flat[:_FIRST])  # those of most signals show that they are none of an axis
    if flat.size < 3 or not np.ptp(first) <= 30 * _EVEN * np.abs(first).max() or not np.all(np.isfinite(flat)):
        return 0.0
    steps = np.diff(flat)
    middle = float(np.median(steps))
    return middle if middle > 0 and float(np.max(np.abs(steps - middle))) <= _EVEN * middle * 10 else 0.0


def _two_sided(values: np.ndarray) -> bool:
    """Return whether the rows of a DFT of real signals go on beyond the Nyquist frequency."""
    rows = values.reshape(len(values), -1)
    size = float(np.abs(rows).max()) if rows.shape[0] >= _FEW else np.nan
    return bool(np.any(np.abs(np.imag(rows)) > _EVEN * size)) and bool(
        np.all(np.abs(rows[1:] - rows[:0:-1].conj()) <= _EVEN * size)
    )


def array_faults(item: Item, of_record: bool) -> list[Fault]:
    """Faults of one array: not finite, decibels, degrees; of a record an amplitude or an angle is a signal."""
    values, name = np.asarray(item.values), item.address
    found: list[Fault] = []
    missing = int(np.sum(~np.isfinite(values)))
    if missing:
        counted = "1 value that is" if missing == 1 else f"{missing} values that are"
        words = f"{name} has {counted} not finite, of {values.size}"
        found.append(Fault(FaultKind.NOT_FINITE, words, where=name, size=missing))
    if np.iscomplexobj(values) and _two_sided(values):
        half = values.shape[0] // 2
        words = f"{name} is a two-sided spectrum, its second half the conjugate of its first: keep rows 0 to {half},"
        words += f' "{name.removesuffix("[:]")}[:{half + 1}]"'
        found.append(Fault(FaultKind.TWO_SIDED, words, where=name, size=half))
    if np.iscomplexobj(values) or not values.size or missing == values.size or of_record:
        return found
    finite: Real = np.asarray(values[np.isfinite(values)] if missing else values, dtype=float)
    said = heading(name)
    size = not item.unit and (said is None or said.part in ("magnitude", ""))
    if size and _MAGNITUDE.search(item.name) and "db" not in name.lower() and (least := float(finite.min())) < 0:
        words = f"{name} has negative values: a magnitude in decibels"
        found.append(Fault(FaultKind.MAGNITUDE_UNIT, words, where=name, size=least))
    if _PHASE.search(item.name) and not item.unit and "rad" not in name.lower() and not re.search(r"deg|°", name, re.I):
        most = float(np.abs(finite).max())
        if most > 4 * np.pi:
            words = f"{name} goes to {most:.4g}: a phase in degrees"
            found.append(Fault(FaultKind.PHASE_UNIT, words, where=name, size=most))
        elif most <= 1.001 * np.pi:
            words = f"{name} stays within pi: a phase in radians"
            found.append(Fault(FaultKind.PHASE_UNIT, words, where=name, size=most))
    return found

"""Roles that an array of a file can play, and the usual names of each."""

from __future__ import annotations

import re

from robustid.formats import headings, units

# Roles and the names tried for them, which may have a unit: "frequency [Hz]", "time_ms". Names whose unit isn't certain
# ("frequency", "phase") are refused without one.
FREQUENCY = {
    "omega": ("omega", "w", "rad_s", "omega_rad_s"),
    "freq_hz": ("freq_hz", "frequency_hz", "f_hz", "hz"),
    "values": ("values", "frf", "response", "g", "h"),
    "real": ("real", "re", "real part"),
    "imag": ("imag", "im", "imaginary", "imaginary part"),
    "magnitude": ("magnitude", "mag", "abs"),
    "magnitude_db": ("magnitude_db", "mag_db", "db"),
    "phase_deg": ("phase_deg", "phase_degrees"),
    "phase_rad": ("phase_rad",),
}
TIME = {
    "time": ("time", "t", "times"),
    "u": ("u", "input", "inputs", "inputvalues", "input_values", "inputdata", "input_data"),
    "y": ("y", "output", "outputs", "outputvalues", "output_values", "outputdata", "output_data"),
    "reference": ("reference", "ref", "r", "setpoint", "set_point"),
}
NAMES = {
    **FREQUENCY,
    **TIME,
    "bound": ("bound", "bounds"),
    "coherence": ("coherence", "coh", "gamma2", "gamma_squared"),
    "dt": ("dt", "Ts", "T"),
    "rate": ("fs", "Fs", "sample_rate", "sampling_rate"),
}
_ANGULAR = ("omega", "ω", "w", "angular frequency", "angular_frequency")
_PARTS = {word: part for word, part in headings.PARTS.items() if part in ("phase", "magnitude")}
_AXES = {**dict.fromkeys(_ANGULAR, "frequency"), **headings.AXES, **_PARTS}
_FREQUENCY_WORDS = {"omega", "ω", "frequency", "frequencies", "freq", "frequenz", "hz", "khz", "mhz", "ghz"}
UNSURE = "unsure "  # before the kind of an axis: its unit isn't known


def axis_role(name: str) -> str | None:
    """Role of a column that is an axis, by its name and unit; "unsure frequency" (time, ...) where the unit isn't certain."""
    base, unit = units.axis_label(name)
    base = base.lower().rstrip(".")
    known = {"hz": "frequency", "rad_s": "frequency", "db": "magnitude"}
    kind = _AXES.get(base) or (known.get(unit.lower()) if not base else None)
    if kind is None and units.in_brackets(name)[1] and base:  # "H1 Magnitude [dB]"
        kind = _PARTS.get(base.split()[-1], "level" if base.split()[-1] in headings.LEVELS else None)
    if len(base) == 1 and unit.lower() in units.OF_SIGNALS:
        return None  # "F [N]" is a force
    if kind == "frequency":
        if not unit:
            return "omega" if base in _ANGULAR else UNSURE + kind
        scale = units.factor(units.FREQUENCY, unit)
        if scale is None or (base in _ANGULAR and "hz" in unit.lower()):
            return UNSURE + kind
        return "freq_hz" if "hz" in unit.lower() else "omega"
    if kind == "time":
        return "time" if not unit or units.factor(units.TIME, unit) else UNSURE + kind
    if kind == "phase":
        scale = units.factor(units.PHASE, unit)
        return UNSURE + kind if scale is None else "phase_rad" if scale == 1 else "phase_deg"
    if kind == "level":
        return "magnitude_db" if unit.lower() == "db" else None
    if kind == "magnitude":
        return "magnitude_db" if unit.lower() == "db" else UNSURE + kind if "db" in unit.lower() else "magnitude"
    return None


def speaks_of_frequency(name: str) -> bool:
    """Return whether a word of a name is one for frequency, or a unit of it: it is no signal of a record then."""
    words = set(re.split(r"[^a-zω]+", name.lower()))
    return bool(words & _FREQUENCY_WORDS)


def rank(role: str, name: str) -> tuple[int, bool]:
    """Order among columns that could play a role: the most usual name first."""
    base = units.axis_label(name)[0]
    usual = [*dict.fromkeys(units.axis_label(known)[0] for known in NAMES[role])]
    return usual.index(base.lower()) if base.lower() in usual else len(usual), base != base.lower()


def is_usual(role: str, name: str) -> bool:
    """Return whether a column has a usual name of a role, but for its unit."""
    return units.axis_label(name)[0].lower() in {units.axis_label(known)[0] for known in NAMES[role]} | set(_AXES)

"""From the arrays of a file, found by their roles, to measurements: units, magnitude and phase, the time axis."""

from __future__ import annotations

import itertools
import logging
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from robustid.core import Options, as_float, as_positive
from robustid.data import FEW, FrequencyResponse, TimeRecord, clock_scatter, longest_part, named_part, uniform_step
from robustid.errors import FileFormatError, InputError, InputTypeError, Remedy
from robustid.formats import units
from robustid.formats.addresses import TIME_AXES, part_of
from robustid.formats.role_lookup import Lookup, flat, seconds
from robustid.formats.role_names import axis_role

_log = logging.getLogger("robustid")

_SAID = 1e-3  # part of a step: instants that scatter more are told
_PARTS = (1e-3, 1e-6, 1e-9)  # of a second
_THIS_CENTURY = (946684800.0, 4102444800.0)  # from 2000 to 2100, s since 1970
_WAYS: tuple[tuple[str, ...], ...] = (
    ("values",),
    ("real", "imag"),
    *itertools.product(("magnitude", "magnitude_db"), ("phase_deg", "phase_rad")),
)


def frequency_axis(lookup: Lookup, frequency_unit: str | None) -> tuple[str, str | None]:
    """Name of the frequency axis, and its unit as far as the file states it."""
    if "omega" in lookup.fields and "freq_hz" in lookup.fields:
        raise InputError("`fields` gives both 'omega' and 'freq_hz'; give one")
    role = "freq_hz" if "freq_hz" in lookup.fields else "omega"
    name = lookup.find(role)
    if name is None:
        role, name = "freq_hz", lookup.find("freq_hz")
    if name is None and (unsure := lookup.unsure("frequency")) is not None:
        if frequency_unit is None or units.axis_label(unsure)[1]:
            both = " and `fields={'omega': ...}`" if units.axis_label(unsure)[1] else ""
            raise InputError(
                f"the unit of the frequencies in {unsure!r} isn't certain: give `frequency_unit` ('Hz' or 'rad/s'){both},"
                f" or call the column 'frequency [Hz]' or 'omega [rad/s]'. {lookup.inventory()}",
                argument="frequency_unit",
            )
        return unsure, None
    if name is None:
        lookup.need("omega")
    name = lookup.name(name)
    unit = units.axis_label(name)[1]
    if role in lookup.fields and units.factor(units.FREQUENCY, unit) is None:
        # The last word of a name that the user gives needn't be a unit; what stands in brackets is one.
        if units.in_brackets(name)[1] and (frequency_unit is None or role == "freq_hz"):
            raise InputError(
                f"`fields[{role!r}]` = {name!r}: {unit!r} is no certain unit of frequency; give `frequency_unit`"
            )
        unit = ""
    return name, unit or ("Hz" if role == "freq_hz" else None)


def _omega(lookup: Lookup, frequency_unit: str | None) -> np.ndarray:
    """The frequencies in rad/s."""
    name, unit = frequency_axis(lookup, frequency_unit)
    column = lookup.column("omega", name)
    stated, own = (None if said is None else units.factor(units.FREQUENCY, said) for said in (frequency_unit, unit))
    if stated is not None and own is not None and stated != own:
        raise InputError(
            f"`frequency_unit` says {frequency_unit}, and the name of {name!r} or its role says {unit}; correct what is wrong"
        )
    if "freq_hz" in lookup.fields and unit and "hz" not in unit.lower():
        raise InputError(f"the role says Hz, and the name of {name!r} says {unit}; correct the one that is wrong")
    scale = units.factor(units.FREQUENCY, unit or frequency_unit or "rad/s")
    return column * scale if scale != 1 else column


def _omega_of(lookup: Lookup, grid: tuple[float, float], frequency_unit: str | None, points: int) -> np.ndarray:
    """The frequencies of a file that has none, in rad/s."""
    if given := {"omega", "freq_hz"} & set(lookup.fields):
        raise InputError(f"`start` and `step` and `fields[{given.pop()!r}]` are given; give one axis of frequencies")
    if frequency_unit is None:
        raise InputError("`start` and `step` need their unit: give `frequency_unit` ('Hz' or 'rad/s')")
    start, step = as_float("start", grid[0]), as_positive("step", grid[1])
    return (start + step * np.arange(points)) * (units.factor(units.FREQUENCY, frequency_unit) or 1.0)


def as_frequency(
    lookup: Lookup, options: Options, frequency_unit: str | None, grid: tuple[float, float] | None = None
) -> FrequencyResponse:
    """The frequency response that the columns hold; at a first frequency and steps from there, where `grid` gives both."""
    if grid is None:
        omega = _omega(lookup, frequency_unit)
        values = _values(lookup)
    else:
        values = _values(lookup)
        omega = _omega_of(lookup, grid, frequency_unit, len(values))
    if values.ndim == 3 and values.shape[0] != omega.size == values.shape[-1]:
        raise InputError(
            f"the values have shape {values.shape} with the frequency last, as MATLAB has it; frequency is"
            " the first axis here: give ",
            Remedy({"axes": "output,input,frequency"}),
            ", store permute(G, [3 1 2]), or call FrequencyResponse(omega, numpy.moveaxis(values, -1, 0))",
        )
    if "bound" not in options and (name := lookup.find("bound")) is not None:
        _same_unit(lookup, name, [lookup.find(role) for role in ("values", "real", "magnitude", "magnitude_db")])
        bound = lookup.matrix("bound", name)
        options["bound"] = bound.item() if bound.size == 1 else bound
    if (name := lookup.find("coherence")) is not None:
        coherence = lookup.matrix("coherence", name)
        options.setdefault("coherence", coherence.reshape(len(coherence), -1))
    if not lookup.fields:
        options = {**lookup.facts.get("frequency", {}), **options}
    if "dt" not in options:
        lookup.refuse_step(0, -1)  # of MATLAB: continuous, and not said
        options["dt"] = lookup.sample_time()
    if "bound" not in options and len(values) == omega.size:
        there = np.any(np.isfinite(values.reshape(omega.size, -1)), axis=1)
        if 0 < (gone := int(np.sum(~there))) < omega.size and "covariance" not in options:
            _log.warning(
                "%s: %d of %d frequency points have no value; they are left out", lookup.file, gone, omega.size
            )
            omega, values = omega[there], values[there]
            if "coherence" in options:
                options["coherence"] = np.asarray(options["coherence"])[there]
    return FrequencyResponse(omega, values, **options)


def _same_unit(lookup: Lookup, bound: object, signals: list[object]) -> None:
    """A bound in another unit than what it bounds would be wrong without a word."""
    stated, others = (
        {units.in_brackets(lookup.name(name))[1] for name in flat(names)} - {""} for names in (bound, signals)
    )
    others = {unit for unit in others if unit.lower() != "db"}
    if (stated and others and stated != others) or any("db" in unit.lower() for unit in stated):
        raise InputError(
            f"the bound is in {', '.join(sorted(stated))} and what it bounds in {', '.join(sorted(others)) or 'no stated unit'};"
            " store both in one linear unit, or give `bound`"
        )


def _values(lookup: Lookup) -> np.ndarray:
    given = set(lookup.fields) & {role for way in _WAYS for role in way}
    way = next((w for w in _WAYS if given <= set(w) and all(lookup.find(role) is not None for role in w)), None)
    if way is None:
        if (unsure := lookup.unsure("phase") or lookup.unsure("magnitude")) is not None:
            raise InputError(
                f"the unit of {unsure!r} isn't certain: give `fields={{'phase_deg': ...}}` or 'phase_rad', and 'magnitude' or"
                f" 'magnitude_db', or call the columns 'phase [deg]' and 'magnitude [dB]'. {lookup.inventory()}",
                argument="fields",
            )
        raise InputError(
            "needs 'values' (complex), or 'real' and 'imag', or 'magnitude' or 'magnitude_db' with"
            " 'phase_deg' or 'phase_rad'; name them by `fields`. ",
            *lookup.help(),
        )
    for role in way:
        # A magnitude or phase named by the user must not say another unit than its role.
        for name in map(lookup.name, flat(lookup.fields.get(role))):
            said = axis_role(name) or ""
            if units.axis_label(name)[1] and said != role and said.split("_")[0] in ("magnitude", "phase"):
                raise InputError(f"`fields[{role!r}]` = {name!r} says another unit; give the role {said!r}")
    parts = [lookup.matrix(role, lookup.find(role)) for role in way]
    if len(parts) == 1:
        return parts[0]
    if any(np.iscomplexobj(part) for part in parts):
        raise InputError(f"{way[0]!r} and {way[1]!r} must be real; for complex numbers name one role, 'values'")
    if parts[0].shape != parts[1].shape:
        raise InputError(f"{way[0]!r} and {way[1]!r} must have one shape; got {parts[0].shape}, {parts[1].shape}")
    if way[0] == "real":
        return parts[0] + 1j * parts[1]
    if way[0] == "magnitude" and np.any(parts[0] < 0):
        raise InputError("'magnitude' has negative values: is it in dB? Then name it by `fields={'magnitude_db': ...}`")
    magnitude = 10 ** (parts[0] / 20) if way[0] == "magnitude_db" else parts[0]
    return magnitude * np.exp(1j * (np.deg2rad(parts[1]) if way[1] == "phase_deg" else parts[1]))


def as_time(lookup: Lookup, options: Options) -> TimeRecord | list[TimeRecord]:
    """The time record that the columns hold; a list where `axes` names an axis of realisations.

    Periods follow each other in one record, which is in steady state unless `initial` says otherwise.
    """
    if "dt" in options and "time" in lookup.fields:
        raise InputError("`dt` and `fields['time']` are both given; give one")
    if not lookup.fields:
        options = {**lookup.facts.get("time", {}), **options}
    names = {role: lookup.need(role) for role in ("u", "y")}
    for role in ("reference", "bound"):
        if role not in options and (name := lookup.find(role)) is not None:
            if role == "reference" and role not in lookup.fields and not _is_reference(lookup, name, names):
                continue
            names[role] = name
            if role == "bound":
                _same_unit(lookup, name, [names["y"]])
    if lookup.named_axes is not None:
        return _realisations(lookup, lookup.named_axes, names, options)
    signals = {role: lookup.signal(role, name) for role, name in names.items()}
    for role, values in signals.items():
        if values.ndim > 2:
            raise InputError(
                f"{names[role]!r} has {values.ndim} axes {values.shape}; name them, such as ",
                Remedy({"axes": "time,signal,realisation,period"}),
                f", or take a part of it by an address such as '{names[role]}[:,:,0]'",
            )
        if values.ndim == 2 and values.shape[1] > values.shape[0]:
            raise InputError(
                f"{names[role]!r} has the shape {values.shape}: fewer samples than signals. Time is the first axis here; if it is"
                " the second one, give ",
                Remedy({"axes": "signal,time"}),
            )
    for side, role in (("inputs", "u"), ("outputs", "y")):
        labels = lookup.labels(names[role])
        if side not in options and len(labels) == (1 if signals[role].ndim == 1 else signals[role].shape[1]):
            options[side] = labels
    if "dt" not in options:
        options["dt"] = time_step(lookup, len(signals["u"]), _namer(lookup, names))
    if "bound" not in signals and len(signals["u"]) == len(signals["y"]):
        _refuse_gaps(lookup, names, signals)
    return TimeRecord(**signals, **options)


def _refuse_gaps(lookup: Lookup, names: Mapping[str, object], signals: Mapping[str, np.ndarray]) -> None:
    """Refuse signals without a value in some samples, with the longest part that has them all."""
    gone = {role: np.isnan(signals[role].reshape(len(signals[role]), -1)).any(axis=1) for role in ("u", "y")}
    if (role := next((role for role, rows in gone.items() if rows.any()), None)) is None:
        return
    rows, known = gone[role], np.flatnonzero(~(gone["u"] | gone["y"]))
    step = int(known[1] - known[0]) if known.size > 3 else 1
    if step > 1 and bool(np.all(np.diff(known) == step)):
        own = part_of(_arrays(lookup, names), int(known[0]), rows.size, step) or named_part(int(known[0]), rows.size)
        raise InputError(
            f"{names[role]!r} has a value in every {step}th sample only: use these alone, if the input is held between them, by ",
            own,
        )
    ends = np.flatnonzero(np.concatenate([[True], gone["u"] | gone["y"], [True]]))
    k = int(np.argmax(np.diff(ends)))
    first, end = int(ends[k]), int(ends[k + 1]) - 1
    part = [*longest_part(first, end, _namer(lookup, names)), ", or fill the gaps"] if end - first >= FEW else []
    raise InputError(
        f"{names[role]!r} has no value in {int(rows.sum())} of {rows.size} samples, the first is sample {int(np.argmax(rows))}: ",
        *(part or ["make files of the samples before and behind the gap, or fill it"]),
    )


def _namer(lookup: Lookup, names: Mapping[str, object]) -> Callable[[int, int], Remedy]:
    """Names for a part of a record: addresses of the same samples of all its arrays, where these are whole."""
    arrays = _arrays(lookup, names)
    return lambda first, end: part_of(arrays, first, end) or named_part(first, end)


def _arrays(lookup: Lookup, names: Mapping[str, object]) -> Mapping[str, object]:
    """Names of the arrays of a record by their roles, with its time."""
    time = lookup.find("time")
    return names if time is None else {"time": time, **names}


def _is_reference(lookup: Lookup, name: object, names: Mapping[str, object]) -> bool:
    """Say whether an array named as a reference is a signal that varies, of as many numbers as all inputs or all outputs."""
    try:
        found, *signals = (lookup.signal(role, one) for role, one in [("reference", name), *names.items()])
    except (InputError, InputTypeError, FileFormatError):
        return False
    same = any(one.shape[:1] == found.shape[:1] and one.size == found.size for one in signals)
    return same and bool(np.all(np.isfinite(found)) and np.ptp(found) > 0)


def _realisations(
    lookup: Lookup, named: Sequence[str], names: dict[str, object], options: Options
) -> TimeRecord | list[TimeRecord]:
    """The records of arrays whose axes are named."""
    arrays = {role: lookup.arranged(role, name, TIME_AXES) for role, name in names.items()}
    if len({array.shape[:3] for array in arrays.values()}) != 1:
        shapes = ", ".join(f"{role} {array.shape[:3]}" for role, array in arrays.items())
        raise InputError(f"the signals differ in their numbers of realisations, periods and samples: {shapes}")
    count, _, samples, _ = arrays["u"].shape
    for side, role in (("inputs", "u"), ("outputs", "y")):
        title, signals = lookup.title(names[role]), arrays[role].shape[-1]
        options.setdefault(side, [f"{title} {k + 1}" if signals > 1 else title for k in range(signals)])
    if "dt" not in options:
        options["dt"] = time_step(lookup, samples)
    if "period" in named:
        options.setdefault("initial", "periodic")
    flat = {role: array.reshape(count, -1, array.shape[-1]) for role, array in arrays.items()}
    records = [TimeRecord(**{role: array[k] for role, array in flat.items()}, **options) for k in range(count)]
    return records if "realisation" in named else records[0]


def time_step(lookup: Lookup, samples: int, named: Callable[[int, int], Remedy] = named_part) -> float:
    """Sample time of a record: of its time column, which goes before a stored number that wasn't named."""
    time = None if "dt" in lookup.fields else lookup.find("time")
    # A scalar T is found as "t" too.
    if time is not None and not (time == "T" and lookup.columns[time].size == 1 < samples):  # type: ignore[union-attr]
        column = lookup.column("time", time)
        unit = seconds(lookup, time) * _of_epoch(lookup.name(time), column)
        step = uniform_step(column, samples, named, unit)
        if (off := clock_scatter(column)) > _SAID:
            lookup.clock = f", its instants within {100 * off:.2g} % of a step of a uniform clock"
        return step
    if time is None and "dt" not in lookup.fields and (unsure := lookup.unsure("time")) is not None:
        seconds(lookup, unsure)
    lookup.refuse_step()
    if (step := lookup.sample_time()) is None:
        words = f"no 'time' found; give `dt` or name it by `fields`. {lookup.inventory()}"
        raise InputError(words, argument="dt")
    return step


def _of_epoch(title: str, instants: np.ndarray) -> float:
    """Factor to s of instants that count a part of a second since 1970, which a name without a unit does not say."""
    since = float(np.min(instants))
    return (
        1.0
        if units.in_brackets(title)[1]
        else next((k for k in _PARTS if _THIS_CENTURY[0] < since * k < _THIS_CENTURY[1]), 1.0)
    )

"""A commented run file that is drafted from looks into files: robustid new."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from robustid.app.look import Look
from robustid.app.run.reading import RUN_FILE, in_run_file
from robustid.app.run.toml import is_array, is_table
from robustid.data import FaultKind

_HEAD = """\
# A run file for `robustid run`: what isn't stated here is chosen from the data, and written back with its reason.
# `robustid run --keys` lists all keys. Lines that begin with # do nothing.
title = "Untitled"
"""
_CLASS = """\
[frequency_points]
# band_hz = [5.0, 200.0]  # use only these; EDIT

[modes]  # without hz they are taken from the response
# hz = [17.67]
# damping = [0.004]  # ratios, not per cent

[prior]  # without it: from the curve of the smallest gain bound
# gain_bound = 0.2
# decay_rate = 1.1
"""
_LOOP = """\
[loop]  # a reference was recorded: a controller ran, u = r - C y. Without it the response from u to y is identified
%s
# excitation = "reference"  # where r was added: "input", u = r - C y (default), "reference", u = C (r - y), or "output"
"""
_CONTROLLER = (
    '# controller = "controller.json"  # EDIT: the file with the controller that ran; or its numerator and denominator'
)
_ASKED = {
    "dt": "# dt = 0.001  # EDIT: the sample time in s, which nothing here says; or rate = ... in Hz",
    "frequency_unit": '# unit = "Hz"  # EDIT: the unit of the frequencies, which the file does not say',
}
_STEPS = "# EDIT: sample times of %s s: all experiments of one run have the same; keep the sources of one of them"
_EITHER = "# EDIT: [[record]] or [[frequency]], and fields: nothing in the file says what it holds"


class Draft(NamedTuple):
    """Text of a run file, and the lines of it that somebody has to edit or check first."""

    text: str
    edits: tuple[str, ...]


class _Source(NamedTuple):
    """Lines of a source of data, and those of them that are to be edited, and to be checked."""

    lines: list[str]
    edits: list[str]
    checks: list[str]


def drafted_run_file(looks: Sequence[Look], folder: Path) -> Draft:
    """Draft a commented run file for files that were looked into; names are seen from `folder`."""
    sources = [source for one in _once(looks) for source in _sources(one, folder)]
    parts = [_HEAD, *("\n".join([*one.lines, ""]) for one in sources)]
    sizes = (fault.size for one in looks for fault in one.faults if fault.kind is FaultKind.UNSTATED_PERIOD)
    if period := next((size for size in sizes if size is not None), None):
        parts.append(f"[estimate]\nperiod = {int(period)}  # samples; found in the input\n")
    edits = [line for one in sources for line in one.edits]
    steps = sorted({float(dt) for one in looks if (dt := getattr(one.found, "dt", None)) is not None})
    if len(steps) > 1:
        edits.insert(0, _STEPS % " and ".join(f"{dt:.6g}" for dt in steps))
        parts.insert(1, f"{edits[0]}\n")
    if any(one.looped for one in looks):
        parts.append(_LOOP % _CONTROLLER)
        edits.append(_CONTROLLER)
    return Draft("\n".join([*parts, _CLASS]), (*edits, *(line for one in sources for line in one.checks)))


def _once(looks: Sequence[Look]) -> list[Look]:
    """Looks without those into a file that holds the other signals of a record before: u.txt and y.txt are one."""
    kept = list[Look]()
    for one in looks:
        name = Path(one.path).name
        marks = (f"{name}:", f"{name}[")
        fields = [field for other in kept for field in other.arguments.get("fields", {}).values()]
        if not any(field == name or (isinstance(field, str) and field.startswith(marks)) for field in fields):
            kept.append(one)
    return kept


def _sources(one: Look, folder: Path) -> list[_Source]:
    """The sources of a file: one of each record where pairs of its arrays are of several."""
    if len(one.records) < 2:
        return [_source(one, folder, one.arguments)]
    found = [_source(one, folder, {**one.arguments, "fields": fields}) for fields in one.records]
    together = f"; signals that were played together make one: fields = {_toml(one.joined)}" if one.joined else ""
    found[0].lines.insert(0, f"# {len(one.records)} records, by the names of the arrays{together}")
    return found


def _source(one: Look, folder: Path, arguments: Mapping[str, object]) -> _Source:
    """One source with the arguments of `load` that are to be tried."""
    edits: list[str] = []
    checks: list[str] = []
    response = one.kind == "frequency"
    lines = [f"# {one.how}" + (f"; {one.read_as}" if one.found is not None and not is_array(one.found) else "")]
    lines += [f"# Looks odd: {fault}" for fault in one.faults]
    lines += ["[[frequency]]" if response else "[[record]]", f"file = {json.dumps(os.path.relpath(one.path, folder))}"]
    lines += [f"{key} = {_toml(value)}" for key, value in arguments.items() if key not in one.unknown]
    edits += [_ASKED[name] for name in one.unknown if name in _ASKED]
    if "fields" in one.unknown:
        edits.append(f"# fields = {_toml(arguments['fields'])}  # EDIT: a guess, the names say nothing")
    edits += [_EITHER] * (not one.kind)
    if one.correction:
        checks.append(f"# correct = [{json.dumps(one.correction)}]  # undoes what looks odd; without the # it is done")
        lines.append(checks[-1])
    if one.error is not None:
        checks.append(f"# Check these lines: {' '.join(one.error.said(RUN_FILE, in_run_file).split())}")
        lines.append(checks[-1])
    bounded = getattr(one.found, "bound", None) is not None
    if response and not bounded:
        words = "the radius of the error disc of every frequency point, or a part of the response"
        own = one.bound or ("one is taken from the data" if one.found is None else "")
        edits += [] if own else [f'bound = "5%"  # EDIT: {words}']
        lines += [f'# bound = "5%"  # {words}; without it: {own}'] if own else []
    if not response:
        use, other = ("samples", "response") if bounded else ("response", "samples")
        lines.append(f'use = "{use}"  # or "{other}", or "noise_floor" (samples need bound = ...)')
    return _Source([*lines, *edits], edits, checks)


def _toml(value: object) -> str:
    if is_table(value):
        return "{ " + ", ".join(f"{json.dumps(key)} = {_toml(one)}" for key, one in value.items()) + " }"
    return json.dumps(value)

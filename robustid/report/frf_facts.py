"""What is said of a measured frequency response, in words and tables, before any medium."""

from __future__ import annotations

import numpy as np

from robustid.data.estimate import joint_radius
from robustid.report.facts import Verdict, bound_source, joint_words
from robustid.report.frf_view import FrfView
from robustid.report.style import number

_LOW_COHERENCE, _FEW_DOF = 0.8, 10
_LISTED = 6  # entries that are named
_TOLERATED = 0.05  # part of the lines that may be bad before it is worth a warning: antiresonances always are
_NOTED = {
    "smeared": "This is a first look by Welch's method: peaks and notches narrower than its windows are smeared, and the bound"
    " doesn't know it. Estimate with the local method, or with periodic excitation, before you identify.",
    "still not steady": "The record isn't in steady state even after the periods that were left out: the bounds hold for steady"
    " data. Leave out more of its start.",
}
LEVELS = (
    "σ is the standard deviation of the values; that of the distortion is for one realisation of the excitation. What is"
    " below its bound has no known phase."
)


def kind(view: FrfView) -> str:
    """Of the bound, in a few words."""
    frf = view.frf
    if frf.bound is None:
        return "No bound"
    if frf.bound_kind == "statistical":
        return "Statistical bound" + (f", {number(100 * frf.probability, 6)} %" if frf.probability else "")
    return {"hard": "Hard bound", "rest": "Bound from rest"}[frf.bound_kind]


def verdict(view: FrfView) -> Verdict:
    """What the bound promises, in one sentence."""
    frf, lines = view.frf, view.frf.omega.size
    where = f"at all {lines} lines" + (f" and in all {view.ny * view.nu} entries" if view.ny * view.nu > 1 else "")
    if not view.complete.all():
        where = f"at all {lines} lines, in all entries measured there,"
    sentences = {
        "hard": f"The true response lies within the bound {where.rstrip(',')}: this is what was stated about the data.",
        "rest": f"The bound was taken from measurements without excitation; it covers what disturbs {where} as it did then.",
        "statistical": "The bound is taken from the scatter of the data; the probability that it holds"
        f" {where} at once isn't stated.",
    }
    sentence = sentences[frf.bound_kind]
    if frf.bound is None:
        sentence = "Nothing is known about the errors: give a bound, or estimate it from the records."
    elif frf.bound_kind == "statistical" and frf.probability:
        chance = f"{number(100 * frf.probability, 6)} %"
        sentence = f"With a probability of {chance} the true response lies within the bound {where} at once."
        if any(words in frf.note for words in _NOTED):
            sentence += " The warnings say what this leaves out."
    key = "undecided" if frf.bound is None else "weak" if warnings(view) else "consistent"
    return Verdict(key, kind(view), sentence)


def summary_rows(view: FrfView) -> list[tuple[str, str]]:
    """What was measured, and how sure it is: (what, in which words)."""
    frf, hz = view.frf, view.frf.freq_hz
    lines = (
        f"{hz.size} lines, {number(hz[0], 5)} to {number(hz[-1], 5)} Hz" if hz.size > 1 else f"{number(hz[0], 5)} Hz"
    )
    steps = np.diff(hz)[np.diff(hz) > 0]
    if steps.size:
        even = steps.max() <= 1.001 * steps.min()
        lines += f", {'' if even else 'at least '}{number(float(np.min(steps)), 5)} Hz apart"
    names = [", ".join(str(channel) for channel in group) for group in (frf.outputs, frf.inputs)]
    rows = [
        ("Lines", lines),
        ("Channels", f"{view.ny} × {view.nu} (outputs × inputs): {names[0]} / {names[1]}"),
        ("Time", "continuous" if frf.dt is None else f"sample time {number(frf.dt, 6)} s"),
    ]
    if not view.complete.all():
        rows.append(("Missing", _missing_words(view)))
    if frf.bound is not None:
        rows.append(
            ("Bound", f"{bound_source(frf)}. {joint_words({frf.joint})}" if frf.joint != "entry" else bound_source(frf))
        )
    if frf.dof is not None:
        rows.append(("Degrees of freedom", f"{number(frf.dof)} of the covariance at every line"))
    if frf.coherence is not None:
        rows.append(("Coherence", _coherence_words(view)))
    return rows


def _missing_words(view: FrfView) -> str:
    """How much was not measured, and where."""
    lines, parts = view.frf.omega.size, []
    for i, j in np.argwhere(view.measured < lines).tolist():
        gone = lines - int(view.measured[i, j])
        parts.append(
            f"{view.entry(i, j)} at {'every line' if gone == lines else f'{gone} lines' if gone > 1 else '1 line'}"
        )
    more = f" and {len(parts) - _LISTED} more entries" if len(parts) > _LISTED else ""
    return (
        f"{int(view.frf.missing.sum())} of {view.frf.values.size} values: {', '.join(parts[:_LISTED])}{more}. Every entry was"
        f" measured at {int(view.complete.sum())} of the {lines} lines."
    )


def _coherence_words(view: FrfView) -> str:
    words = []
    for i, output in enumerate(view.frf.outputs):
        part = view.frf.coherence[:, i]
        worst = int(np.argmin(part))
        lowest = f"lowest {number(float(part[worst]), 3)} at {number(view.frf.freq_hz[worst], 5)} Hz"
        words.append(f"{output.name}: median {number(float(np.median(part)), 4)}, {lowest}")
    return "; ".join(words)


def level_columns(view: FrfView) -> tuple[str, ...]:
    """Heads of `level_rows`; ">" before those to be aligned to the right."""
    names = [name.removeprefix("σ of the ") for name in view.levels]
    return ("Response", ">|G|", ">Bound", *(f">σ, {name}" for name in names), ">Lines below\ntheir bound")


def level_rows(view: FrfView) -> list[tuple[str, ...]]:
    """A row an entry: medians over the lines, the levels relative to the response."""
    frf = view.frf
    shares = [None if array is None else view.relative(array) for array in (view.radius, *view.levels.values())]
    rows, sizes = [], view.median(view.size)
    for i in range(view.ny):
        for j in range(view.nu):
            cells = ["–" if share is None else _percent(share[i, j]) for share in shares]
            size = number(sizes[i, j], 3)
            silent = f"{int(view.silent[:, i, j].sum())} of {view.measured[i, j]}" if frf.bound is not None else "–"
            rows.append((view.entry(i, j), size, *cells, silent))
    return rows


def _percent(share: float) -> str:
    return f"{number(100 * float(share), 2)} %" if np.isfinite(share) else "–"


def warnings(view: FrfView) -> list[str]:
    """What must be seen before this is used."""
    frf, out = view.frf, [sentence for words, sentence in _NOTED.items() if words in view.frf.note]
    share = view.silent.sum(axis=0) / np.maximum(view.measured, 1)
    if share.max() > _TOLERATED:
        i, j = np.unravel_index(np.argmax(share), share.shape)
        count, lines = int(view.silent[:, i, j].sum()), int(view.measured[i, j])
        where = f" of {view.entry(int(i), int(j))}" if share.size > 1 else ""
        more = (
            f" (the worst of {int(np.sum(share > _TOLERATED))} such entries)" if np.sum(share > _TOLERATED) > 1 else ""
        )
        out.append(
            f"At {count} of {lines} lines{where}{more} the bound exceeds the response: these lines say nothing of its phase."
            " Measure longer, excite more, or leave them out."
        )
    if frf.coherence is not None:
        low = [
            f"{output.name} at {int(bad.sum())} of {bad.size} lines"
            for output, bad in zip(frf.outputs, frf.coherence.T < _LOW_COHERENCE, strict=True)
            if bad.mean() > _TOLERATED
        ]
        if low:
            out.append(
                f"The coherence is below {_LOW_COHERENCE}: {', '.join(low)}. There the output is mostly noise, or not caused"
                " by these inputs."
            )
    if frf.bound_kind == "statistical" and frf.probability and frf.dof is not None and frf.dof <= _FEW_DOF:
        wider = (
            joint_radius(frf.probability, view.size.size, frf.dof) / joint_radius(frf.probability, view.size.size, None)
        ).item()
        out.append(
            f"The covariance has only {number(frf.dof)} degree{'s' * (frf.dof != 1)} of freedom: the bound is"
            f" {number(wider, 2)} times as wide as with a known one. More periods or realisations narrow it."
        )
    return out

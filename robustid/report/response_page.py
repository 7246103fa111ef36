"""A measured frequency response: what its bound promises, levels of every entry, spectra; its page and its summary."""

from __future__ import annotations

import numpy as np

from robustid.core import counted
from robustid.data import Bound, Caveat, FrequencyResponse, joint_radius
from robustid.report.assumptions import bound_source
from robustid.report.charts import Chart, first_panel
from robustid.report.curves import most_drawn
from robustid.report.data_faults import fault_verdict, further_faults, placed, steps_with_faults
from robustid.report.document import (
    Block,
    Column,
    Document,
    Drawing,
    Facts,
    Glance,
    Grid,
    Heading,
    Table,
    Text,
    Verdict,
    pasted,
)
from robustid.report.identified import Parts
from robustid.report.response_charts import ResponseView, entry_charts, overview_charts, spectrum_charts
from robustid.report.words import drawn_words, in_hz, in_hz_span, number, percent, plural, title

_LOW_COHERENCE, _FEW_DOF = 0.8, 10
_LISTED = 6  # entries that are named
_TOLERATED = 0.05  # part of the points that may be bad before it is worth a warning: antiresonances always are
_CAVEATS = {
    Caveat.SMEARED: "This is a first look by Welch's method: peaks and notches narrower than its windows are smeared, and the bound"
    " doesn't know it. Estimate with the local method, or with periodic excitation, before you identify.",
    Caveat.UNSTEADY: "The record isn't in steady state even after the periods that were left out: the bounds hold for steady"
    " data. Leave out more of its start.",
    Caveat.CHANGING: "Halves of the measurement differ beyond chance: the plant changed (it warmed up, say), or another one was"
    " measured. The bound holds what they differ by, not what comes after. Measure again once nothing changes, or each condition"
    " by itself.",
}
_LEVELS = (
    "Medians over the frequency points; bound, noise and distortion relative to the response. σ is the standard deviation of the"
    " values; that of the distortion is for one realisation of the excitation. What is below its bound has no known phase."
)
_COMMAND = "robustid identify --frequency FILE --report report.html"
_MOST_ENTRIES = 16  # at the terminal


def response_page(frf: FrequencyResponse, title: str | None, parts: Parts) -> Document:
    """Build the page of a measured frequency response."""
    view = ResponseView(frf, parts.get("records"))
    several, points, spectra = view.ny * view.nu > 1, frf.omega.size, spectrum_charts(view)
    of_each = " of every entry; outputs below each other, inputs beside each other" if several else ""
    entries = entry_charts(view)
    left_out = drawn_words(points, most_drawn(points, view.ny * view.nu), "level")
    return Document(
        title or _title(view),
        head=[*response_fault_verdict(view), response_verdict(view), *warnings(view)],
        body=[
            Heading("Measurement"),
            Facts(summary_rows(view)),
            level_table(view),
            Text(_LEVELS, "soft"),
            Heading("Frequency response"),
            Text(f"Magnitude and phase{of_each}. Drag to zoom, double click to go back.{left_out}", "soft"),
            Grid(entries, view.nu, small=view.nu > 1, titled=several),
            *(block for chart in overview_charts(view) for block in _overview(view, chart)),
            *_spectra(view, spectra),
        ],
        glance=_glance(view, entries[0], parts),
    )


def _glance(view: ResponseView, entry: Chart, parts: Parts) -> Glance:
    """The first screen: points, relative bound, the first entry, what to do next."""
    steps = [Text(f"A model with a proof: {_COMMAND}", code=(_COMMAND,))]
    if view.frf.bound is None:
        steps = [Text("Give a bound of the errors (--frequency-bound), or estimate it from records: robustid frf.")]
    after = steps_with_faults(placed(view.frf), parts.get("undoing"), pasted(parts.get("steps", ())) or steps)
    left_out = "" if view.frf.bound is None else "what lies between the frequency points"
    return Glance(numbers=_numbers(view), chart=first_panel(entry), next=after, not_covered=left_out)


def response_summary(view: ResponseView) -> list[Block]:
    """Build the summary of a response at the terminal."""
    faults = response_fault_verdict(view)
    return [*faults, response_verdict(view), Facts(summary_rows(view)), level_table(view), *warnings(view)]


def _title(view: ResponseView) -> str:
    return title("Frequency response", view.frf.outputs, view.frf.inputs)


def _overview(view: ResponseView, chart: Chart) -> list[Block]:
    """Singular values or coherence."""
    where = "" if view.complete.all() else " where all entries were measured"
    words = {
        "singular": f"Of the matrix at every frequency point{where}, in the units of its entries. A peak of the largest one is a"
        " mode; where the second one peaks too, there are two. None is farther from its true value than the bound.",
        "coherence": "The part of the power of each output that the inputs explain linearly; the remainder is noise, distortion, or"
        " another cause.",
    }
    return [Heading(chart.panels[0].title), Text(words[chart.name], "soft"), Drawing(chart)]


def _spectra(view: ResponseView, charts: list[Chart]) -> list[Block]:
    if not charts:
        return []
    count = len(view.records)
    what = "the record" if count == 1 else f"the records, root mean square over all {count}"
    words = (
        f"Amplitudes of the sines that make up {what}, over the frequencies of the response. Of periodic excitation, only noise"
        " and leakage are left between its spectral lines."
    )
    return [Heading("Spectra of the records"), Text(words, "soft"), Grid(charts, max(view.nu, view.ny))]


def response_fault_verdict(view: ResponseView) -> list[Verdict]:
    """Verdict on faults of the response and of its records, where there are any."""
    return fault_verdict(view.faults)


def response_verdict(view: ResponseView) -> Verdict:
    """Verdict on the bound: what it promises, in one sentence."""
    frf, points = view.frf, f"at all {counted(view.frf.omega.size, 'frequency point')}"
    where = points + (f" and in all {view.ny * view.nu} entries" if view.ny * view.nu > 1 else "")
    if not view.complete.all():
        where = f"{points}, in all entries measured there,"
    sentences = {
        "hard": f"The true response lies within the bound {where.rstrip(',')}: this is what was stated about the data.",
        "noise_floor": f"The bound was taken from measurements without excitation; it covers what disturbs {where} as it did then.",
        "confidence": "The bound is taken from the scatter of the data; the probability that it holds"
        f" {where} at once isn't stated.",
        "tolerance": f"The bound is meant for the response in the next record, {where} at once{_chance(frf.bound)}.",
    }
    if frf.bound is None:
        sentence = "Nothing is known about the errors: give a bound, or estimate it from the records."
    elif frf.bound.kind != "confidence" or frf.bound.probability is None:
        sentence = sentences[frf.bound.kind]
    else:
        chance = f"{number(100 * frf.bound.probability, 6)} %"
        what = "true" if frf.bound.excitations is None else "mean"
        sentence = f"With a probability of {chance} the {what} response lies within the bound {where} at once."
        if frf.bound.excitations == 1:
            sentence = (
                f"{frf.bound.about} With a probability of {chance} what one excitation shows, noise and the distortion on unexcited"
                f" lines, stays within the bound {where} at once."
            )
        elif Caveat.CHANGING in frf.bound.caveats:
            sentence = f"{frf.bound.about} {sentence}"
        if frf.bound.caveats:
            sentence += " The warnings say what this leaves out."
    alone = frf.bound is not None and frf.bound.excitations == 1
    weak = alone or bool(view.faults) or bool(warning_sentences(view))
    key = "undecided" if frf.bound is None else "weak" if weak else "consistent"
    word = "No bound" if frf.bound is None else frf.bound.heading
    return Verdict(key, word, sentence, tuple(_numbers(view)))


def _chance(bound: Bound | None) -> str:
    if bound is None or bound.probability is None:
        return ""
    return f", with a probability of {number(100 * bound.probability, 6)} %"


def _numbers(view: ResponseView) -> list[tuple[str, str]]:
    found = [("frequency points", str(view.frf.omega.size))]
    if view.radius is not None:
        share = view.relative(view.radius)
        worst = ", worst entry" if share.size > 1 else ""
        found.append((f"median bound / response{worst}", percent(np.fmax.reduce(share, axis=None))))
    return found


def summary_rows(view: ResponseView) -> list[tuple[str, str]]:
    """Facts about the measurement, and how sure it is."""
    frf, hz = view.frf, view.frf.freq_hz
    points = in_hz(hz[0])
    if hz.size > 1:
        points = f"{counted(hz.size, 'point')}, {in_hz_span(hz[0], hz[-1])}"
    steps = np.diff(hz)[np.diff(hz) > 0]
    if steps.size:
        even = steps.max() <= 1.001 * steps.min()
        points += f", {'' if even else 'at least '}{in_hz(float(np.min(steps)))} apart"
    names = [", ".join(map(str, group)) for group in (frf.outputs, frf.inputs)]
    rows = [
        ("Frequency points", points),
        ("Signals", f"{view.ny} × {view.nu} (outputs × inputs): {names[0]} / {names[1]}"),
        ("Time", "continuous" if frf.dt is None else f"sample time {number(frf.dt, 6)} s"),
    ]
    if not view.complete.all():
        rows.append(("Missing", _missing_words(view)))
    if frf.bound is not None:
        rows.append(("Bound", ". ".join(words for words in (bound_source(frf), frf.bound.shape_words) if words)))
    if frf.dof is not None:
        rows.append(("Degrees of freedom", f"{number(frf.dof)} of the covariance at every frequency point"))
    if frf.coherence is not None:
        rows.append(("Coherence", _coherence_words(view)))
    return rows


def _missing_words(view: ResponseView) -> str:
    """Say how much was not measured, and where."""
    points, parts = view.frf.omega.size, list[str]()
    for i, j in np.argwhere(view.measured < points).tolist():
        gone = points - int(view.measured[i, j])
        where = "every point" if gone == points else f"{gone} point{plural(gone)}"
        parts.append(f"{view.entry(i, j)} at {where}")
    more = f" and {counted(len(parts) - _LISTED, 'more entry')}" if len(parts) > _LISTED else ""
    return (
        f"{int(view.frf.missing.sum())} of {view.frf.values.size} values: {', '.join(parts[:_LISTED])}{more}. Every entry was"
        f" measured at {int(view.complete.sum())} of the {points} frequency points."
    )


def _coherence_words(view: ResponseView) -> str:
    words: list[str] = []
    for i, output in enumerate(view.frf.outputs):
        part = view.frf.coherence[:, i]
        worst = int(np.argmin(part))
        lowest = f"lowest {number(float(part[worst]), 3)} at {in_hz(view.frf.freq_hz[worst])}"
        words.append(f"{output.name}: median {number(float(np.median(part)), 4)}, {lowest}")
    return "; ".join(words)


def level_table(view: ResponseView) -> Table:
    """A row an entry: medians over the frequency points, the levels relative to the response."""
    shares = [None if array is None else view.relative(array) for array in (view.radius, *view.levels.values())]
    rows, sizes = list[tuple[str, ...]](), view.median(view.size)
    for i, j in np.ndindex(view.ny, view.nu):
        cells = ["–" if share is None else percent(float(share[i, j])) for share in shares]
        silent = "–"
        if view.frf.bound is not None:
            silent = f"{int(view.silent[:, i, j].sum())} of {view.measured[i, j]}"
        rows.append((view.entry(i, j), number(float(sizes[i, j]), 3), *cells, silent))
    heads = ("|G|", "Bound", *(f"σ, {name}" for name in view.levels))
    columns = [Column("Response", "text"), *(Column(head, "n") for head in (*heads, "Points below\ntheir bound"))]
    title = "Medians over the frequency points, relative to the response"
    return Table(columns, rows, title=title, most=_MOST_ENTRIES)


def warnings(view: ResponseView) -> list[Text]:
    """Warnings that must be seen before this is used."""
    return [Text(sentence, "warning", head="Warning") for sentence in warning_sentences(view)]


def warning_sentences(view: ResponseView) -> list[str]:
    """Sentences on what is wrong with the data, or left open by them."""
    found = further_faults(view.faults)
    found += [] if view.frf.bound is None else [_CAVEATS[caveat] for caveat in view.frf.bound.caveats]
    return [*found, *_silent_words(view), *_low_coherence_words(view), *_few_data_words(view)]


def _silent_words(view: ResponseView) -> list[str]:
    share = view.silent.sum(axis=0) / np.maximum(view.measured, 1)
    if share.max() <= _TOLERATED:
        return []
    i, j = np.unravel_index(np.argmax(share), share.shape)
    count, points, bad = int(view.silent[:, i, j].sum()), int(view.measured[i, j]), int(np.sum(share > _TOLERATED))
    where = f" of {view.entry(int(i), int(j))}" if share.size > 1 else ""
    more = f" (the worst of {bad} such entries)" if bad > 1 else ""
    return [
        f"At {count} of {counted(points, 'frequency point')}{where}{more} the bound exceeds the response: these"
        " points say nothing of its"
        " phase. Measure longer, excite more, or leave them out."
    ]


def _low_coherence_words(view: ResponseView) -> list[str]:
    if view.frf.coherence is None:
        return []
    low = [
        f"{output.name} at {int(bad.sum())} of {bad.size} frequency points"
        for output, bad in zip(view.frf.outputs, view.frf.coherence.T < _LOW_COHERENCE, strict=True)
        if bad.mean() > _TOLERATED
    ]
    if not low:
        return []
    return [
        f"The coherence is below {_LOW_COHERENCE}: {', '.join(low)}. There the output is mostly noise, or not caused by these"
        " inputs."
    ]


def _few_data_words(view: ResponseView) -> list[str]:
    frf = view.frf
    probability = None if frf.bound is None else frf.bound.probability
    if probability is None or frf.dof is None or frf.dof > _FEW_DOF:
        return []
    known, estimated = (joint_radius(probability, view.size.size, dof) for dof in (None, frf.dof))
    return [
        f"The covariance has only {number(frf.dof)} degree{plural(frf.dof)} of freedom: the bound is"
        f" {number((estimated / known).item(), 2)} times as wide as with a known one. More periods or realisations narrow it."
    ]

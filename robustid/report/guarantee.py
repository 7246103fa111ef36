"""The guaranteed error of a model: the sentence, the worst frequencies, the certificates, and the band of the response."""

from __future__ import annotations

import numpy as np

from robustid.core import Real, counted
from robustid.guarantees import WorstCaseError
from robustid.identification import Identification
from robustid.report.assumptions import CAUTION
from robustid.report.charts import (
    ALERT,
    DATA,
    FAINT,
    MARKERS,
    REACHED,
    Axis,
    Chart,
    Layer,
    Panel,
    lighter,
    named,
    side_by_side,
)
from robustid.report.document import Block, Column, Drawing, Facts, Grid, Heading, Table, Text, certificates
from robustid.report.frequency import frequency_charts, size_panel
from robustid.report.identified import (
    about,
    bounded_model,
    checked,
    entry_unit,
    error_label,
    in_unit,
    model_size,
    sample_words,
    siso,
    transfer,
    unit,
)
from robustid.report.magnitude_phase import band_around, behind, error_panel
from robustid.report.value_sets import nyquist_chart
from robustid.report.words import HZ, at_frequencies, at_hz, at_least, at_most, in_hz, number

_ROWS = 8  # worst frequencies
_TINY = np.finfo(float).tiny


def guarantee_section(identification: Identification, error: WorstCaseError, holds: bool | None = None) -> list[Block]:
    """Build the section of what is guaranteed of the response, with its certificates; `holds`: they were evaluated again."""
    checked("worst_case", error, WorstCaseError, "worst_case_error", identification)
    alone, entries = siso(identification), worst_case_charts(error)
    blocks: list[Block] = [Heading("What is guaranteed", guarantee=True)]
    if error.missing.size:
        blocks.append(Text(error.unfinished))
    blocks += [
        Text(f"{about(identification)}{guarantee_sentence(error)}", id="guarantee-sentence"),
        certificates(error.claim_count, error.verify() if holds is None else holds, "certificates"),
        Facts(guarantee_rows(error)),
        Heading("Worst frequencies", 3),
        worst_table(error),
        Text(_worst_words(alone), "soft"),
    ]
    if not alone:
        blocks += [Heading("Largest error of every entry", 3), entry_table(error)]
    blocks += [
        Heading("Response with its guaranteed range", 3),
        Text(
            f"The range is proved at the frequencies that are marked in the {'lower' if alone else 'lowest'} panel; between them"
            " it is interpolated for the eye. Where the response may be 0 its phase can be anything.",
            "soft",
        ),
    ]
    if alone:
        blocks += [Drawing(entries[0]), Drawing(nyquist_chart(error), beside=True)]
    else:
        blocks += [
            Grid(lighter(entries), len(identification.problem.inputs)),
            Heading("Singular values with the guaranteed range of the largest one", 3),
            Text(
                "No singular value of a consistent system is farther from that of the model than the largest one of the"
                " difference.",
                "soft",
            ),
            Drawing(worst_case_sigma_chart(error)),
        ]
    if np.any(np.isfinite(error.parameters.lower)) and identification.problem.functions:
        blocks += [Heading("Intervals of the parametric coefficients", 3), parameter_table(error)]
    return blocks


def guarantee_sentence(error: WorstCaseError) -> str:
    """The guarantee in plain words."""
    upper, omega, alone = error.sigma_upper, error.omega, siso(error.identification)
    norm = "" if alone else " (largest singular value of the difference)"
    model = bounded_model(error.identification, error.model)[0]
    worst = ""
    if omega.size > 1:
        worst = f" The largest error is possible at {in_hz(omega[np.argmax(upper)] / HZ)};"
    return (
        "Every plant that agrees with the data and the assumptions has a response within"
        f" {in_unit(at_most(upper.max()), error.identification)} of the {model}{norm},"
        f" {at_frequencies(omega)}.{worst} {'the' if worst else 'The'} median is {error.relative.words}."
    )


def guarantee_rows(error: WorstCaseError) -> list[tuple[str, str]]:
    """Reach, gap, the whole circle, what is assumed and what was tested, with their words."""
    identification, upper, lower = error.identification, error.sigma_upper, error.sigma_lower
    gap = float(np.max(1 - lower / np.maximum(upper, _TINY)))
    poles = (
        " The guarantee is conditional on the poles: data that are consistent with them don’t validate them."
        if identification.problem.parametric is not None
        else ""
    )
    return [
        (
            "Reached",
            f"A consistent system was found that is {in_unit(at_least(lower.max()), identification)} away from the model: no"
            " bound can be smaller.",
        ),
        (
            "Gap",
            f"The guaranteed errors exceed those that are reached by {at_most(100 * gap)} % of themselves at most.",
        ),
        ("Between the frequencies", circle_words(error)),
        (
            "Assumed",
            f"The class named above: {_class_words(identification)}; and that every sample"
            f" lies within its bound.{poles} {CAUTION}",
        ),
        (
            "Tested",
            f"That the assumptions and all {counted(identification.problem.samples, 'sample')} don’t contradict each"
            " other (see the margin);"
            " that every bound follows from its certificate; that the systems said to reach an error keep every sample within"
            " its bound.",
        ),
    ]


def _class_words(identification: Identification) -> str:
    """The assumptions of a class."""
    if identification.problem.prior.physical:
        return "passivity, with the decay that is stated"
    return f"gain bound, decay{_further(identification)} and the poles of the parametric part"


def _further(identification: Identification) -> str:
    """Further assumptions of the class: how its bound falls; of MIMO problems scaling and symmetry."""
    problem = identification.problem
    falls = ", how the bound depends on the frequency" * problem.prior.weighted
    return falls + ", the scaling" * (problem.prior.scaling is not None) + ", the symmetry" * problem.entries.symmetric


def circle_words(error: WorstCaseError) -> str:
    """The bound on the whole circle, where it has been computed; it takes long, and isn't computed here."""
    circle = error.known_circle
    if circle is None:
        return (
            "Nothing is claimed here: the bounds hold at the frequencies. A bound that holds on the whole circle was not"
            " computed (WorstCaseError.hinf)."
        )
    start, whole = (
        circle.edges[0] / HZ,
        "the whole circle" if error.identification.problem.dt else "the whole axis, to infinity,",
    )
    reach = whole if start == 0 else f"all frequencies from {in_hz(start, 4)} on"
    rough = "" if circle.converged else " It was left coarser than asked."
    return (
        f"Over {reach} the error stays below {in_unit(at_most(circle.largest), error.identification)} (H-infinity norm of plant"
        f" minus model), by {circle.bound.size} arcs and bounds of the second derivative between their ends.{rough}"
    )


def _bracketed(identification: Identification) -> str:
    what = unit(identification)
    return f" [{what}]" if what else ""


def _worst_words(alone: bool) -> str:
    norm = (
        ""
        if alone
        else ", in the largest singular value of the difference: at most the norm of the matrix of the bounds of its entries"
    )
    return (
        f"Guaranteed: no consistent system is farther from the model there{norm}. Reached: one that far away was found. The most"
        " active constraint is the sample with the largest dual weight in the proofs: a smaller bound there helps first."
    )


def worst_table(error: WorstCaseError) -> Table:
    """The frequencies with the largest guaranteed errors, largest first."""
    size = dict(zip(error.omega.tolist(), model_size(error).tolist(), strict=True))
    label = _bracketed(error.identification)
    columns = [
        Column("f [Hz]", "n"),
        Column(f"guaranteed{label}", "n"),
        Column(f"reached{label}", "n"),
        *(Column("gap", "n"), Column("of the response", "n"), Column("most active constraint", "text")),
    ]
    rows = [
        (
            number(w / HZ, 5),
            at_most(high),
            at_least(low),
            f"{number(100 * (1 - low / high), 2)} %" if high else "–",
            f"{at_most(100 * high / size[w])} %" if size[w] else "–",
            sample_words(error.identification, sample),
        )
        for w, high, low, sample in error.worst(_ROWS)
    ]
    return Table(columns, rows)


def entry_table(error: WorstCaseError) -> Table:
    """The largest error of every entry."""
    size, rows = np.abs(error.nominal.reshape(error.upper.shape)), list[tuple[str, ...]]()
    share = (error.upper / np.maximum(size, _TINY))[np.isin(error.omega, error.relative.omega)]
    for i, j in np.ndindex(size.shape[1:]):
        k = int(np.argmax(error.upper[:, i, j]))
        relative = float(np.median(share[:, i, j]))
        name, hz = transfer(error.identification, i, j), number(error.omega[k] / HZ, 5)
        ends = at_most(error.upper[k, i, j]), at_least(error.lower[k, i, j])
        rows.append((name, hz, *ends, f"{at_most(100 * relative)} %"))
    columns = [
        *(Column("Entry", "text"), Column("at [Hz]", "n")),
        Column(f"guaranteed{_bracketed(error.identification)}", "n"),
        *(Column("reached", "n"), Column("of the response (median)", "n")),
    ]
    return Table(columns, rows)


def parameter_table(error: WorstCaseError) -> Table:
    """The interval that holds every coefficient of the parametric part in every consistent system."""
    identification, found = error.identification, error.parameters
    rows, values = list[tuple[str, ...]](), identification.parameters
    for place in np.ndindex(found.lower.shape):
        if not np.isfinite(found.lower[place]):
            continue
        label = identification.problem.parametric.functions[place[0]].name
        if not siso(identification):
            label += f": {transfer(identification, *place[1:])}"
        low, high, value = (float(part[place]) for part in (found.lower, found.upper, values))
        first, last = found.attained[place]
        interval, reached = f"{at_least(low)} … {at_most(high)}", f"{number(first)} … {number(last)}"
        rows.append((label, interval, reached, number(value)))
    columns = [
        *(Column("Function", "text"), Column(f"guaranteed{_bracketed(identification)}", "n")),
        *(Column("reached", "n"), Column("nominal model", "n")),
    ]
    return Table(columns, rows)


def guaranteed_bode(error: WorstCaseError) -> Chart:
    """Every entry with the range that no consistent system leaves; of a MIMO problem the singular values below."""
    found = worst_case_charts(error)
    if siso(error.identification):
        return found[0]
    sigma = worst_case_sigma_chart(error).panels
    return side_by_side("guarantee", lighter(found), len(error.identification.problem.inputs), sigma)


def worst_case_charts(error: WorstCaseError) -> list[Chart]:
    """Magnitude and phase of every entry with their guaranteed ranges, and the guaranteed error with the one that is reached.

    Between the frequencies the distance of each end of a range from the model is interpolated: nothing is proved there.
    """
    name, further = bounded_model(error.identification, error.model)
    drawn = frequency_charts(error.identification, further, error.omega)
    entries = np.ndindex(error.upper.shape[1:])
    return [_with_range(error, chart, entry, name) for chart, entry in zip(drawn, entries, strict=True)]


def _with_range(error: WorstCaseError, chart: Chart, entry: tuple[int, int], name: str) -> Chart:
    magnitude, phase = chart.panels
    proved = error.omega > 0  # a logarithmic axis has no 0
    at, place = error.omega[proved] / HZ, (proved, *entry)
    nominal = error.nominal.reshape(error.upper.shape)[place]
    sizes, angles = (part.reshape(*error.upper.shape, 2)[place] for part in (error.magnitude, error.phase))
    bottom, top = magnitude.y.range or (0.0, 1.0)
    words = f"guaranteed range ({counted(error.omega.size, 'frequency')})"
    areas = band_around(words, named(magnitude, name), at, sizes - np.abs(nominal)[:, None], bottom)
    span = bottom, max(top, 1.2 * float(sizes.max(initial=0.0)))
    turns = band_around(words, named(phase, name), at, _turns(angles, nominal))
    single = siso(error.identification)
    panels = (
        behind(magnitude, areas, span),
        behind(phase, turns, _widened(phase.y.range or (-225.0, 225.0), turns)),
        _error_panel(error, magnitude.x, entry),
    )
    chart_name = "guarantee" if single else f"guarantee-{entry[0]}-{entry[1]}"
    return Chart(chart_name, panels, linked=True, grid=not single)


def worst_case_sigma_chart(error: WorstCaseError) -> Chart:
    """Singular values with the guaranteed range of the largest one, and that of F - model, guaranteed and reached."""
    name, panel = size_panel(error.identification, error.model, error.omega)
    proved = error.omega > 0
    # No singular value moves by more than the largest one of what is added.
    offsets = error.sigma_upper[proved, None] * np.array([-1.0, 1.0])
    bottom, top = panel.y.range or (0.0, 1.0)
    words = f"guaranteed range of σmax ({counted(error.omega.size, 'frequency')})"
    areas = band_around(words, named(panel, name), error.omega[proved] / HZ, offsets, bottom)
    span = bottom, max(top, *(1.2 * float(area.high.max()) for area in areas if area.high is not None))
    errors = _error_panel(error, panel.x, None)
    return Chart("guarantee-sigma", (behind(panel, areas, span), errors), linked=True)


def _turns(phase: np.ndarray, nominal: np.ndarray) -> np.ndarray:
    """Ends of the ranges of the phase less the phase of the model, in degrees, (F, 2); NaN where the phase can be anything."""
    centred: Real = phase - np.angle(nominal)[:, None]
    middle: Real = np.mean(centred, axis=1, keepdims=True)
    offset = centred - 2 * np.pi * np.round(middle / (2 * np.pi))
    anything = phase[:, 1] - phase[:, 0] >= 2 * np.pi * (1 - 1e-12)
    return np.where(anything[:, None], np.nan, np.degrees(offset))


def _widened(span: tuple[float, float], areas: list[Layer]) -> tuple[float, float]:
    """A range of degrees that holds the areas too."""
    lows, highs = ([limit(end) for end in ends] for limit, ends in zip((np.min, np.max), _ends(areas), strict=True))
    return 90 * np.floor(min([span[0], *lows]) / 90 + 0.5) - 45, 90 * np.ceil(max([span[1], *highs]) / 90 - 0.5) + 45


def _ends(areas: list[Layer]) -> tuple[list[np.ndarray], list[np.ndarray]]:
    return [a.low for a in areas if a.low is not None], [a.high for a in areas if a.high is not None]


def _error_panel(error: WorstCaseError, x: Axis, entry: tuple[int, int] | None) -> Panel:
    """Panel of the error of an entry, or of the largest singular value."""
    identification, place = error.identification, (slice(None), *(entry or ()))
    left = x.range[0] if x.range else 0.0
    at = np.maximum(error.omega / HZ, left)
    upper, lower = (error.sigma_upper, error.sigma_lower) if entry is None else (error.upper[place], error.lower[place])
    hover = at_hz(error.omega / HZ, "at most {}, reached {}", upper, lower)
    layers: list[Layer] = []
    if (circle := error.known_circle) is not None:  # what has been computed; nothing is computed here
        right = x.range[1] if x.range else np.inf
        edges = np.clip(np.repeat(circle.edges, 2)[1:-1] / HZ, left, right)
        own = entry is not None and not siso(identification)
        bounds = np.repeat(circle.entries[place] if own else circle.bound, 2)
        layers.append(Layer("guaranteed between them too", edges, bounds, FAINT, dash="solid"))
    name = "guaranteed error"
    layers.append(Layer(name, at, upper, ALERT, dash="dash", marker="circle", hover=hover))
    reached = np.where(lower > 0, lower, np.nan)
    layers.append(Layer(REACHED, at, reached, DATA, marker=MARKERS[2], hover=hover))
    title = "Error of the model: the farthest consistent system"
    title += ", 0 Hz drawn at the left end" if error.omega[0] == 0 else ""
    label = error_label(identification)
    if entry is not None and not siso(identification):  # the name stands above
        title, label = "", f"error{entry_unit(identification, *entry)}"
    return error_panel(title, x, label, layers)

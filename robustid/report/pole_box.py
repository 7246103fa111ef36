"""The guarantee over a pole-uncertainty box: the sentence, the box before and after its cells are refuted, and the chart."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np

from robustid.guarantees import WorstCaseError, WorstCaseOverPoles
from robustid.identification import Identification
from robustid.report.charts import ALERT, BAND, FAINT, FURTHER, Axis, Chart, Layer, Panel, named
from robustid.report.document import (
    Block,
    Column,
    Drawing,
    Facts,
    Heading,
    Table,
    Text,
    Verdict,
    certificates,
    of_numbers,
)
from robustid.report.frequency import size_panel
from robustid.report.identified import Bounded, about, bounded_model, checked, error_label, in_unit, model_size, siso
from robustid.report.magnitude_phase import band_around, behind, error_range
from robustid.report.words import HZ, at_frequencies, at_hz, at_least, at_most, in_hz, number

BOX = FURTHER[2]
_ROUNDING = 1e-12  # of ends, relative: 0.7 × 0.1 is printed as 0.07


def pole_box_section(
    identification: Identification, band: WorstCaseOverPoles, error: WorstCaseError | None, holds: bool | None = None
) -> list[Block]:
    """Build the section of what is guaranteed with the poles anywhere in their box; `holds`: the proofs were evaluated again."""
    checked("over_poles", band, WorstCaseOverPoles, "worst_case_over_poles", identification)
    words = "Proved at the marked frequencies; between them the ranges are interpolated for the eye."
    words += " 0 Hz is drawn at the left end." if band.omega[0] == 0 else ""
    single = siso(identification)
    if not single:
        words += " No singular value is farther from that of the model than the largest one of the difference."
    return [
        Heading("Guarantee over a pole-uncertainty box"),
        Text(f"{about(identification)}{box_sentence(band)}", id="box-sentence"),
        box_verdict(band, holds),
        Facts(box_rows(band, error)),
        Heading("The pole-uncertainty box", 3),
        box_table(band),
        Text("f is the natural frequency. Left: the smallest box around the cells that are not refuted.", "soft"),
        *([] if single else [Heading("Every entry", 3), box_entries(band)]),
        Heading(f"{'Response' if single else 'Largest singular value'} with its guaranteed ranges", 3),
        Text(words, "soft"),
        Drawing(pole_box_chart(band, error)),
    ]


def pole_box_chart(band: WorstCaseOverPoles, error: WorstCaseError | None = None) -> Chart:
    """Magnitude (MIMO: largest singular value) with its guaranteed range over the pole-uncertainty box, beside that at the fixed
    poles, and both errors. Proved at the frequencies of the band; between them distances from the model are interpolated.
    """
    fixed = _beside(band, error)
    omega = band.omega if fixed is None else np.union1d(band.omega, fixed.omega)
    name, magnitude = size_panel(band.identification, band.model, omega)
    x = _reach(band, magnitude.x)
    curve, bottom = named(magnitude, name), (magnitude.y.range or (0.0, 1.0))[0]
    shown = curve.y[(curve.x >= x.range[0]) & (curve.x <= x.range[1])] if x.range else curve.y
    ends = _sizes(band)
    ends = ends[np.isfinite(ends)]
    span = max(bottom, 0.5 * float(shown.min())), 1.5 * float(max(shown.max(), ends.max(initial=0.0)))
    areas = _area(f"any pole in the box ({band.omega.size} frequencies)", BOX, curve, band, span)
    if fixed is not None:
        areas += _area(f"the fixed poles ({fixed.omega.size} frequencies)", BAND, curve, fixed, span)
    panels = (dataclasses.replace(behind(magnitude, areas, span), x=x), _errors(band, fixed, x))
    return Chart("over_poles", panels, linked=True)


def _beside(band: WorstCaseOverPoles, error: WorstCaseError | None) -> WorstCaseError | None:
    """The error at the fixed poles, of the model of the band, in its range of frequencies; None where there is none."""
    if error is None:
        return None
    low, high = band.omega[0], band.omega[-1]
    inside = tuple(v for v in error.values if low * (1 - 1e-9) <= v.omega <= high * (1 + 1e-9))
    return dataclasses.replace(error.with_model(band.model), values=inside) if inside else None


def _reach(band: WorstCaseOverPoles, axis: Axis) -> Axis:
    """The axis over the frequencies of the band; as it was where they are none or one."""
    hz = band.omega[band.omega > 0] / HZ
    if hz.size < 2 or axis.range is None:
        return axis
    return dataclasses.replace(
        axis, range=(float(max(hz[0] / 1.05, axis.range[0])), float(min(hz[-1] * 1.05, axis.range[1])))
    )


def _area(name: str, colour: str, curve: Layer, bounded: Bounded, span: tuple[float, float]) -> list[Layer]:
    """The ranges of one guarantee around the curve of the model; one without an end reaches beyond the axis."""
    proved = bounded.omega > 0  # a logarithmic axis has no 0
    offsets = np.minimum(_sizes(bounded), 10 * span[1]) - model_size(bounded)[:, None]
    found = band_around(name, curve, bounded.omega[proved] / HZ, offsets[proved], span[0])
    return [dataclasses.replace(layer, colour=colour) for layer in found]


def _sizes(bounded: Bounded) -> np.ndarray:
    """Guaranteed range of the size of the response, (F, 2); MIMO: of its largest singular value."""
    if siso(bounded.identification):
        return bounded.magnitude
    # No singular value moves by more than the largest one of what is added.
    return np.maximum(model_size(bounded)[:, None] + bounded.sigma_upper[:, None] * np.array([-1.0, 1.0]), 0.0)


def _errors(band: WorstCaseOverPoles, fixed: WorstCaseError | None, x: Axis) -> Panel:
    left = x.range[0] if x.range else 0.0
    shown = [("error over the box", band.omega, band.sigma_upper, BOX, "solid", "square")]
    if fixed is not None:
        shown.append(("error at the fixed poles", fixed.omega, fixed.sigma_upper, ALERT, "dash", "circle"))
    layers: list[Layer] = []
    for name, omega, upper, colour, dash, marker in shown:
        hover = at_hz(omega / HZ, "at most {}", upper)
        y = np.where(np.isfinite(upper) & (upper > 0), upper, np.nan)
        layers.append(Layer(name, np.maximum(omega / HZ, left), y, colour, dash=dash, marker=marker, hover=hover))
    span = error_range(layers) or (0.1, 1.0)
    at = np.full(2, max(band.next_line / HZ, left))
    layers.append(Layer(f"measure next: {_next(band)}", at, np.array(span), FAINT, dash="dot"))
    y_axis = Axis(error_label(band.identification), log=True, range=span)
    title = "Guaranteed error of the model" + (", 0 Hz drawn at the left end" if np.any(shown[0][1] == 0) else "")
    return Panel(title, x, y_axis, layers)


def _next(band: WorstCaseOverPoles) -> str:
    return in_hz(band.next_line / HZ)


def box_sentence(band: WorstCaseOverPoles) -> str:
    """The guarantee in plain words."""
    upper = band.sigma_upper
    known = np.isfinite(upper)
    open_ = (
        f"The box is too wide: at {np.sum(~known)} of the frequencies nothing is guaranteed ({at_frequencies(band.omega[~known])}),"
        " so that a plant whose poles lie elsewhere in it may be arbitrarily far from the model."
        if not known.all()
        else ""
    )
    if not known.any():
        return open_
    norm = "" if siso(band.identification) else " (largest singular value of the difference)"
    model = bounded_model(band.identification, band.model)[0]
    return (
        "Every plant that agrees with the data and the assumptions, its poles anywhere in the box"
        " below, has a response within"
        f" {in_unit(at_most(upper[known].max()), band.identification)} of the {model}{norm},"
        f" {at_frequencies(band.omega[known])}; the median is {band.relative.words}. {open_}"
    ).rstrip()


def box_rows(band: WorstCaseOverPoles, error: WorstCaseError | None) -> list[tuple[str, str]]:
    """The fixed poles, the cells, what to measure next and what is assumed, with their words."""
    out: list[tuple[str, str]] = []
    if (fixed := _beside(band, error)) is not None:
        largest = in_unit(at_most(fixed.sigma_upper.max()), band.identification)
        words = f"With the poles of the model the error at {fixed.omega.size} frequencies in this range is at most {largest}."
        words += " Poles that were taken from data are known up to a box: then that over the box is the guarantee that holds."
        out.append(("At the fixed poles", words))
    left, gone = len(band.cells), len(band.refuted)
    cells = f"{left + gone} cells cover the box; {gone} of them proved not to hold the poles, and left out."
    out.append(("Cells", cells if left + gone > 1 else "The box was covered in one piece."))
    out.append(("Measure next", f"A frequency point near {_next(band)}: the guaranteed error is largest there."))
    out.append(
        (
            "Assumed",
            "Besides the class named above, in place of its poles: as many modes as the model has, and poles inside the box."
            " Data can refute assumptions, never prove them.",
        )
    )
    return out


def box_verdict(band: WorstCaseOverPoles, holds: bool | None = None) -> Verdict:
    """Verdict on the cells, which must cover the box, and on the certificates, which must support their bounds now."""
    if band.covered:
        return certificates(band.claim_count, band.verify() if holds is None else holds, "box-certificates")
    sentence = (
        "The cells leave out a part of the box: the numbers are about poles inside the cells alone, and poles in the rest of the"
        " box may give larger errors."
    )
    return Verdict("failed", "Not proved", sentence, id="box-certificates")


def box_entries(band: WorstCaseOverPoles) -> Table:
    """Largest guaranteed error of every entry, and where it is possible."""
    problem, rows = band.identification.problem, list[tuple[str, ...]]()
    for (i, output), (j, input_) in itertools.product(enumerate(problem.outputs), enumerate(problem.inputs)):
        k = int(np.argmax(band.upper[:, i, j]))
        at = number(float(band.omega[k]) / HZ, 5)
        rows.append((str(output), str(input_), at_most(float(band.upper[k, i, j])), at))
    heads = Column("output"), Column("input"), Column("error at most", "n"), Column("at [Hz]", "n")
    return Table(list(heads), rows)


def box_table(band: WorstCaseOverPoles) -> Table:
    """Natural frequency and damping of every mode, as stated and after the cells that are refuted."""
    (omega, damping), box = band.poles, band.box
    rows = [
        (
            f"{mode + 1}",
            *(_interval(*hz / HZ) for hz in (box.omega[mode], omega[mode])),
            *(_interval(*ratio) for ratio in (box.damping[mode], damping[mode])),
        )
        for mode in range(box.omega.shape[0])
    ]
    heads = ("mode", "f stated [Hz]", "f left [Hz]", "damping stated", "damping left")
    return Table(of_numbers(*heads), rows)


def _interval(low: float, high: float) -> str:
    """Ends with as many digits as tell them apart, rounded outwards from beyond the rounding of the stated ones."""
    digits = int(np.clip(2 + np.ceil(np.log10(high / max(high - low, 1e-9 * high))), 4, 10))
    return f"{at_least(low * (1 + _ROUNDING), digits)} … {at_most(high * (1 - _ROUNDING), digits)}"

"""The band that is proved at every frequency: the sentence, what it stands on, the check of its sums, and the chart."""

from __future__ import annotations

import numpy as np

from robustid.core import describe
from robustid.errors import InputError, InputTypeError
from robustid.guarantees import Band, norm_of_bounds
from robustid.identification import Identification
from robustid.report.charts import Axis, Chart, Layer, Panel, behind, named
from robustid.report.document import Block, Drawing, Facts, Heading, Text, Verdict
from robustid.report.identified import Posed, about, in_unit, shown_models, sigma_unit, siso, transfer
from robustid.report.sections.assumptions import CAUTION
from robustid.report.sections.frequency import LARGEST, frequency_charts, sigma_chart
from robustid.report.sections.guarantee_charts import BAND, error_range
from robustid.report.style import ALERT
from robustid.report.words import HZ, at_most, number

_TINY = np.finfo(float).tiny
_ENDLESS, _TALL = 1e6, 30.0  # times the largest response: where a range without end is drawn, and where the axis ends


def proved_band_section(identification: Identification, band: Band) -> list[Block]:
    """Build the section of what is proved at every frequency."""
    check_band(identification, band)
    return [
        Heading("What is guaranteed at every frequency"),
        Text(sentence(identification, band), id="band-sentence"),
        verdict(band),
        Facts(rows(identification, band)),
        Drawing(band_chart(identification, band)),
    ]


def check_band(identification: Identification, band: Band) -> None:
    """Refuse a band of another problem than the one that is reported, or one without a model."""
    if not isinstance(band, Band):
        raise InputTypeError(f"`band` must be a Band, from band(); got {type(band).__name__}")
    if band.model is None:
        raise InputError("`band` has no model that errors are measured from; give band.with_model(model)")
    if band.problem is not identification.problem:
        digests = describe(band)[0]["problem_digest"], describe(identification)[0]["problem_digest"]
        if digests[0] != digests[1]:
            raise InputError(
                "`band` is about another problem than the identification reported; compute band(identification)"
            )


def poles_words(band: Band) -> str:
    """Say what the band takes the poles of the parametric part to be."""
    if band.problem.parametric is None:
        return "without modes"
    if band.box is None:
        return "with the poles exactly as they stand in the class"
    count = len(band.box[0])
    return f"with the pole{'s' * (count > 1)} of {count} mode{'s' * (count > 1)} anywhere in their uncertainty box"


def sentence(identification: Posed, band: Band) -> str:
    """The guarantee in plain words; of a problem that was not identified its band takes that place."""
    upper, known = band.sigma_upper, band.bounded
    start = about(identification)
    if not known.any():
        return f"{start}Nothing is proved of the error: the data do not tell the amplitudes apart, {poles_words(band)}."
    relative = float(np.median((upper / np.maximum(_size(band), _TINY))[known]))
    norm = "" if siso(identification) else " (largest singular value of the difference)"
    largest = np.where(known, upper, -1.0)
    but = ""
    if band.open_ranges:
        but = f" but from {band.open_words}, where nothing is proved, since a mode there may be undamped for all the data say"
    nominal = "centre of the band" if band.model is None else f"model of order {band.model.nstates}"
    return (
        f"{start}Proved at every frequency{but}, {poles_words(band)}: every plant that agrees with the data and the assumptions"
        f" has a response within {in_unit(at_most(largest.max()), identification)} of the {nominal}{norm};"
        f" the largest error is possible near {number(band.omega[np.argmax(largest)] / HZ, 5)} Hz, the median over"
        f" {int(known.sum())} frequencies is {at_most(100 * relative)} % of the response."
    )


def _size(band: Band) -> np.ndarray:
    """Size of the response of the model, (F,)."""
    return np.linalg.norm(band.nominal, 2, axis=(1, 2))


def verdict(band: Band) -> Verdict:
    """Verdict on the sums, which are evaluated again."""
    count = sum(one.angles.size for one in band.bands)
    if band.certified:
        words = (
            f"{count} discs, each from two sums over the samples, were evaluated again for this page, without a solver."
        )
        return Verdict("consistent", "Proved", words, id="band-certificates")
    return Verdict("failed", "Not proved", "The sums do not give the stated discs.", id="band-certificates")


def rows(identification: Identification, band: Band) -> list[tuple[str, str]]:
    """Facts: on what the band stands, between the frequencies and in its assumptions."""
    found = [
        (
            "Stands on",
            "Combinations of the samples: what a combination leaves of any system of the class is a closed formula, so that"
            " nobody needs to trust how it was found.",
        ),
        (
            "Between the frequencies",
            "Combinations at neighbouring frequencies are mixed in proportion, which gives a combination again: the curve that is"
            " drawn is proved wherever it is drawn.",
        ),
        ("Poles", f"The band holds {poles_words(band)}."),
    ]
    if band.assumed_modes:
        names = ", ".join(f"{number(band.box[0][k].mean() / HZ, 4)} Hz" for k in band.assumed_modes)
        found.append(
            (
                "Amplitudes",
                f"The boxes of the modes at {names} are so wide that the data do not bound their amplitudes: these are"
                " assumed to be at most twice those of a fit. Frequency points around these modes would help.",
            )
        )
    found.append(
        (
            "Assumed",
            "Gain bound, decay and the number of modes of the class named above, and that every sample lies within its bound."
            f" {CAUTION}",
        )
    )
    return found


def band_chart(identification: Identification, band: Band) -> Chart:
    """Magnitude with its proved range, and the proved error; of matrices the largest singular value."""
    name, own = shown_models(identification)[0][:2]
    further = None
    if not all(np.array_equal(getattr(band.model, part), getattr(own, part)) for part in "ABCD"):
        name = f"model, order {band.model.nstates}"
        further = {name: band.model}
    if siso(identification):
        panel = frequency_charts(identification, further, band.omega)[0].panels[0]
    else:
        name, panel = LARGEST + name, sigma_chart(identification, further, band.omega).panels[0]
    curve, bottom = named(panel, name), (panel.y.range or (0.0, 1.0))[0]
    last = band.bands[0].angles[[0, -1]]
    low, high = band.problem.plane.omega(last) / HZ
    x = curve.x[(curve.x >= low) & (curve.x <= high * (1 - 1e-12)) & np.isfinite(curve.y)]
    y = curve.y[np.isin(curve.x, x)]
    centre, radius = band.at(x * HZ)
    if siso(identification):
        middle, half = np.abs(centre[:, 0, 0]), radius[:, 0, 0]
    else:
        middle, half = np.linalg.norm(centre, 2, axis=(1, 2)), norm_of_bounds(radius)
    ends = np.maximum(middle - half, bottom), np.maximum(middle + half, bottom)
    ends = ends[0], np.minimum(ends[1], _ENDLESS * max(float(y.max(initial=0.0)), _TINY))
    area = Layer(name="proved range, at every frequency", x=x, y=y, colour=BAND, low=ends[0], high=ends[1], fill=True)
    top = (panel.y.range or (0.0, 1.0))[1]
    known = (middle + half)[np.isfinite(half) & ~np.isin(x, x[half > np.abs(y).max(initial=0.0)])]
    span = bottom, max(top, min(1.2 * float(known.max(initial=0.0)), _TALL * top))
    error = norm_of_bounds(band.error_at(x * HZ))
    error = np.where(np.isfinite(error), error, np.nan)
    hover = tuple(f"{number(f, 6)} Hz: at most {number(e)}" for f, e in zip(x, error, strict=True))
    line = Layer(name="proved error", x=x, y=error, colour=ALERT, dash="solid", hover=hover)
    label = f"error |F − model| of\n{transfer(identification)}"
    if not siso(identification):
        label = f"σmax(F − model)\n{sigma_unit(identification).strip()}".strip()
    errors = Panel(
        title="Error of the model: no consistent system is farther",
        x=panel.x,
        y=Axis(label=label, log=True, range=error_range([line])),
        layers=(line,),
    )
    return Chart(name="proved-band", panels=(behind(panel, [area], span), errors), linked=True)

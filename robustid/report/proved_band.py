"""The band that is proved at every frequency: the sentence, what it stands on, the check of its sums, and the chart."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Sequence

import numpy as np

from robustid.core import as_kind, counted, fingerprint
from robustid.errors import InputError
from robustid.guarantees import Band, Peak, WorstCaseError, in_box, largest_error, norm_of_bounds, real_poles
from robustid.identification import Identification
from robustid.report.assumptions import CAUTION
from robustid.report.charts import ALERT, BAND, FINE, NOMINAL, Chart, Layer, Panel, lighter, named, side_by_side
from robustid.report.document import Block, Drawing, Facts, Heading, Text, Verdict, proved
from robustid.report.frequency import Curve, entry_chart, size_panel
from robustid.report.identified import Posed, about, error_label, in_unit, model_size, shown_band, siso
from robustid.report.largest_response import measured_band
from robustid.report.magnitude_phase import behind, error_panel
from robustid.report.words import HZ, at_hz, at_most, in_hz

_TALL = 30.0  # times the largest response: where the axis ends


def proved_band_section(
    identification: Identification, band: Band, error: WorstCaseError | None = None, holds: bool = True
) -> list[Block]:
    """Build the section of what is proved at every frequency.

    `error` is the sweep of exact poles on the same page; `holds` says whether the polygons of the band, evaluated again, do.
    """
    check_band(identification, band)
    words = stands_on(band, error)
    said = Text(f"{about(identification)}{band_sentence(identification, band)}", id="band-sentence")
    if not band.bounded.any():
        left_out = [Text(band.unfinished, id="band-unfinished")] if band.unfinished else []
        return [Heading("What is guaranteed at every frequency: nothing"), said, *left_out]
    return [
        Heading("What is guaranteed at every frequency", guarantee=True),
        said,
        *([Text(words, id="band-stands-on")] if words else []),
        *([Text(band.unfinished, id="band-unfinished")] if band.unfinished else []),
        band_verdict(band, holds),
        Facts(band_rows(band)),
        Drawing(band_chart(identification, band)),
    ]


def check_band(identification: Identification, band: Band) -> None:
    """Refuse a band of another problem than the one that is reported, or one without a model."""
    as_kind("band", band, Band, "a Band, from band()")
    if band.model is None:
        raise InputError("`band` has no model that errors are measured from; give band.with_model(model)")
    mine, other = band.problem, identification.problem
    if mine is not other and fingerprint(mine) != fingerprint(other):
        raise InputError(
            "`band` is about another problem than the identification reported; compute band(identification)"
        )


def poles_words(band: Band) -> str:
    """Say what the band takes the poles of the parametric part to be."""
    if band.problem.parametric is None:
        return "without modes"
    if band.box is None:
        return "with the poles taken as exact"
    count, all_modes = in_box(band.box), len(band.box[0])
    poles, their = ("pole of 1 mode", "its") if count == 1 else (f"poles of {count} modes", "their")
    words = f"with the {poles} anywhere in {their} uncertainty box"
    words = words if count == all_modes else f"{words}, of {all_modes - count} taken as exact"
    real = real_poles(band.problem)
    return f"{words}, the real pole{'s' * (real > 1)} beside taken as exact" if real else words


def band_sentence(identification: Posed, band: Band) -> str:
    """The guarantee in plain words; of a problem that was not identified its band takes that place."""
    if not band.bounded.any():
        return f"Nothing is proved of the error: {band.why_nothing}, {poles_words(band)}."
    norm = "" if siso(identification) else " (largest singular value of the difference)"
    largest = largest_error(band)
    but = ""
    if band.open_ranges:
        but = f" but from {band.open_words}, where nothing is proved, since a mode there may be undamped for all the data say"
    nominal = "centre of the band" if band.model is None else f"model of order {band.order}"
    return (
        f"Proved at every frequency{but}, {poles_words(band)}: every plant that agrees with the data and the assumptions"
        f" has a response within {in_unit(at_most(largest.value), identification)} of the {nominal}{norm};"
        f" the largest error is possible near {in_hz(largest.omega / HZ)}{_beyond(identification, band, largest)}, the median is"
        f" {band.relative.words}."
    )


def _beyond(identification: Posed, band: Band, largest: Peak) -> str:
    """Words on a largest error beyond the data, and on that among them; empty where it is among them."""
    low, high = measured_band(band.problem) or (0.0, np.inf)
    if band.model is None or low <= largest.omega <= high:
        return ""
    among = largest_error(band, (low, high)).value
    return f", beyond the data (in their range at most {in_unit(at_most(among), identification)})" if among else ""


def stands_on(band: Band, error: WorstCaseError | None) -> str:
    """Say in one sentence where the band stands on sums and where on polygons; empty where it has only sums.

    A sweep of exact poles beside a band over a box is no part of it, and said to be none.
    """
    if error is None or band.box is None or not error.omega.size:
        return band.narrowing_words and f"{band.narrowing_words}."
    words = band.narrowing_words or "The band of sums stands at every frequency"
    return (
        f"{words}; the numbers of the sweep at {counted(error.omega.size, 'frequency')} stand on exact poles and are not part of"
        " the curve."
    )


def band_verdict(band: Band, holds: bool) -> Verdict:
    """Verdict on the sums, which are evaluated again, and on the polygons, which were."""
    count, polygons = sum(one.angles.size for one in band.bands), band.polygons
    further = "" if polygons is None else f" and {polygons.claim_count} certificates of polygons"
    words = f"{count} discs, each from two sums over the samples,{further} were evaluated again for this page, without a solver."
    holds = holds and dataclasses.replace(band, polygons=None).certified
    return proved(holds, words, "The proofs do not give what is stated.", "band-certificates")


def band_rows(band: Band) -> list[tuple[str, str]]:
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
    found.append(
        (
            "Assumed",
            "Gain bound, decay and the number of modes of the class named above, and that every sample lies within its bound."
            f" {CAUTION}",
        )
    )
    return found


@functools.lru_cache(maxsize=1)  # the first screen of a page shows its first panel
def band_chart(identification: Identification, band: Band) -> Chart:
    """Magnitude with its proved range, and the proved error; of matrices the largest singular value."""
    name, panel = size_panel(identification, band.model, band.omega)
    curve, bottom = named(panel, name), (panel.y.range or (0.0, 1.0))[0]
    last = band.bands[0].angles[[0, -1]]
    low, high = band.problem.plane.omega(last) / HZ
    x = curve.x[(curve.x >= low) & (curve.x <= high * (1 - 1e-12)) & np.isfinite(curve.y)]
    y = curve.y[np.isin(curve.x, x)]
    sums = dataclasses.replace(band, polygons=None)  # at the frequencies of the curves; polygons stand at their own
    middle, half = _sizes(*band.at(x * HZ))
    nothing = band.is_open(x * HZ)
    half = np.where(nothing, np.nan, half)  # a gap
    ends = np.maximum(middle - half, bottom), np.maximum(middle + half, bottom)
    where = f"but from {band.open_words}" if nothing.any() else "at every frequency"
    area = Layer(f"proved range, {where}", x, y, BAND, low=ends[0], high=ends[1], fill=True)
    top = (panel.y.range or (0.0, 1.0))[1]
    known = (middle + half)[np.isfinite(half) & ~np.isin(x, x[half > np.abs(y).max(initial=0.0)])]
    span = bottom, max(top, min(1.2 * float(known.max(initial=0.0)), _TALL * top))
    error = norm_of_bounds(sums.error_at(x * HZ))
    error = np.where(nothing, np.nan, error)
    hover = at_hz(x, "at most {}", error)
    line = Layer("proved error", x, error, ALERT, dash="solid", hover=hover)
    bars, dots = _refined(band, bottom)
    title = "Error of the model: no consistent system is farther"
    errors = error_panel(title, panel.x, error_label(identification), (line, *dots))
    return Chart("proved-band", (behind(panel, [area, *bars], span), errors), linked=True)


@functools.lru_cache(maxsize=3)  # a page is drawn again for every frequency that is bounded, with a band that was kept
def drawn_band(band: Band, entry: tuple[int, int] = (0, 0)) -> tuple[np.ndarray, ...]:
    """Frequencies in rad/s at which a band is drawn, its knots and the middles between them; centres, radii and errors there."""
    knots = (band.directed or band.bands)[0].angles
    angles = np.sort(np.concatenate([knots, (knots[1:] + knots[:-1]) / 2]))
    omega = np.clip(band.problem.plane.omega(angles), *band.range)
    centre, radius = band.at(omega)
    error = radius if band.model is None else band.error_at(omega)
    return omega, *(one[:, *entry] for one in (centre, radius, error))


def with_band(band: Band, panels: Sequence[Panel], entry: tuple[int, int] = (0, 0)) -> tuple[Panel, ...]:
    """Magnitude, phase, and perhaps errors, with the proved band behind them, and the proved error of its model, or the radius.

    As they are where nothing is proved.
    """
    if not band.bounded.any():
        return tuple(panels)
    magnitude, phase, *rest = panels
    below = rest[0] if rest else None
    left, right = magnitude.x.range or (0.0, np.inf)
    drawn = drawn_band(band, entry)
    seen = (drawn[0] >= left * HZ) & (drawn[0] <= right * HZ)
    omega, centre, radius, error = (one[seen] for one in drawn)
    bottom, top = magnitude.y.range or (0.0, 1.0)
    ends = np.maximum(np.abs(centre) - radius, bottom), np.minimum(np.abs(centre) + radius, _TALL * top)
    poles = _poles(band)
    name, x = f"proved band{poles}", omega / HZ
    area = Layer(name, x, np.clip(np.abs(centre), *ends), BAND, low=ends[0], high=ends[1], fill=True)
    high = ends[1][np.isfinite(radius)].max(initial=0.0)
    first = behind(magnitude, [area], (bottom, max(top, 1.2 * float(high))))
    about = "proved error" if band.model is not None else "radius of the band"
    line = Layer(about + poles, x, np.where(np.isfinite(error), error, np.nan), BAND, dash="solid")
    layers = (line, *(() if below is None else below.layers))
    title = "Error: no consistent system is farther" if below is None else below.title
    return first, phase, error_panel(title, magnitude.x, "", layers)


def _poles(band: Band) -> str:
    """Words on the poles, for a legend."""
    if band.problem.parametric is None:
        return ""
    if band.box is None:
        return ", poles taken as exact"
    free, modes = in_box(band.box), len(band.box[0])
    return (
        ", poles anywhere in their box"
        if free == modes
        else f", poles of {free} of {modes} modes anywhere in their box"
    )


def centre_chart(band: Band) -> Chart:
    """Every entry of a band about its centre, or its model: magnitude with the proved range and samples, phase, proved error."""
    outputs, inputs = band.problem.entries.shape
    found: list[Chart] = []
    for entry in np.ndindex(outputs, inputs):
        omega, centre, *_ = drawn_band(band, entry)
        name = "centre of the band"
        if band.model is not None:
            name, centre = (f"model, order {band.order}", band.problem.plane.values_at(band.model, omega)[:, *entry])
        above = omega > 0  # a logarithmic axis has no 0
        curve = Curve(name, centre[above], NOMINAL, "solid")
        one = entry_chart(band, entry, omega[above], [curve], shown_band(band))
        found.append(dataclasses.replace(one, panels=with_band(band, one.panels, entry)))
    return found[0] if len(found) == 1 else side_by_side("proved-band", lighter(found), inputs)


def _sizes(centre: np.ndarray, radius: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Size of the responses at the centres of discs, (F,), and how far that of others in them is from it at most."""
    return np.linalg.norm(centre, 2, axis=(1, 2)), norm_of_bounds(radius)


def _refined(band: Band, bottom: float) -> tuple[list[Layer], list[Layer]]:
    """Layers where polygons narrow the band: ranges of the magnitude, and dots of the error."""
    here = band.narrowed & (band.omega > 0)  # a logarithmic axis has no 0
    if not here.any():
        return [], []
    x, size, upper = band.omega[here] / HZ, model_size(band)[here], band.sigma_upper[here]
    middle, half = _sizes(*(part[here] for part in (band.centre, band.radius)))
    hover = at_hz(x, "at most {}", upper)
    words = f"narrowed by a polygon ({x.size} frequenc{'y' if x.size == 1 else 'ies'})"
    ends = np.maximum(size - upper, middle - half), np.minimum(size + upper, middle + half)
    ends = tuple(np.maximum(end, bottom) for end in ends)
    bars = Layer(words, x, size, ALERT, marker="circle", low=ends[0], high=ends[1], size=FINE)
    return [bars], [Layer(words, x, upper, ALERT, marker="circle", hover=hover)]

"""The picture and the words of a page that follows every choice: a first look, then an identification and its error."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from robustid.core import counted
from robustid.data import FrequencyResponse
from robustid.errors import Status
from robustid.guarantees import Band, Sample, SampleCheck, WorstCaseError, largest_error
from robustid.identification import Identification
from robustid.report.charts import ALERT, BAND, FAINT, FINE, FURTHER, NOMINAL, Layer, Panel
from robustid.report.data_faults import problem_verdict
from robustid.report.frequency import Curve, entry_chart, frequency_charts
from robustid.report.guarantee import guarantee_sentence, worst_case_charts
from robustid.report.identification_page import identification_verdict, margin_interval
from robustid.report.identified import Posed, about, in_unit, sample_words, shown_band, unit
from robustid.report.proved_band import band_sentence, drawn_band, with_band
from robustid.report.with_plotly import Drawn, plotly_figure
from robustid.report.words import HZ, at_most, in_hz, number, percent

LEFT_OUT = "left out"
_KEPT = "kept choice"
_WITHHELD = "withheld, to test the result"
_ACTIVE = "active constraints"
_CONTRADICTED = "contradicted by the others"
_SHARE, _MOST = 0.05, 5  # of the proof, and of the samples that are named
_HEIGHT = 760  # pixels
_DOMAINS = {2: ((0.3, 1.0), (0.0, 0.25)), 3: ((0.48, 1.0), (0.26, 0.44), (0.0, 0.22))}  # of the panels, by their number


def live_figure(
    identification: Identification,
    error: WorstCaseError | None = None,
    band: Band | None = None,
    left_out: Sequence[FrequencyResponse] = (),
    withheld: Sequence[FrequencyResponse] = (),
    kept: Band | None = None,
) -> Drawn:
    """Magnitude, phase and error of a SISO identification as plotly draws them: the error is that of the nominal model, drawn
    between the frequencies where the band is; the band of another choice that was `kept` stands lightly behind. Points that are
    used or `left_out` carry their frequency in Hz as `customdata`.
    """
    panels = (frequency_charts(identification) if error is None else worst_case_charts(error))[0].panels
    if error is not None:
        panels = _at_frequencies(error, *panels)
    panels = _with_active(identification, *panels)
    if band is not None:
        panels = with_band(band, panels)
    return _figure(identification, panels, left_out, withheld, kept)


def look_figure(
    check: SampleCheck,
    band: Band | None = None,
    left_out: Sequence[FrequencyResponse] = (),
    withheld: Sequence[FrequencyResponse] = (),
    kept: Band | None = None,
) -> Drawn:
    """Magnitude and phase before there is a model, as `live_figure` draws them: the band around its centre.

    Where there is none: the sample that the others contradict, and the response that they prove.
    """
    name, omega, values = "response as the other samples prove it", check.omega, check.centre
    if band is not None:
        name, (omega, values, *_) = "centre of the band", drawn_band(band)
    above = omega > 0  # a logarithmic axis has no 0
    curve = Curve(name, values[above], NOMINAL if band is not None else ALERT, "dot")
    panels = entry_chart(check, (0, 0), omega[above], [curve], shown_band(check)).panels
    if band is not None:
        return _figure(check, with_band(band, panels), left_out, withheld, kept)
    worst = int(np.argmax(check.ratio))
    ring = _ring(_CONTRADICTED, check.omega[[worst]], check.values[[worst]])
    first = replace(panels[0], layers=(*panels[0].layers, ring))
    return _figure(check, (first, *panels[1:]), left_out, withheld, kept)


def _figure(
    posed: Posed,
    panels: Sequence[Panel],
    left_out: Sequence[FrequencyResponse],
    withheld: Sequence[FrequencyResponse],
    kept: Band | None,
) -> Drawn:
    """Panels with the points that are not used and the band of a choice that was kept, as plotly draws them."""
    if kept is not None and kept.bounded.any():
        panels = _with_kept(kept, *panels)
    under, over = _points(withheld, _WITHHELD, "circle", 0.6), _points(left_out, LEFT_OUT, "x", 1.4, choice=True)
    first = replace(panels[0], layers=(*under, *panels[0].layers, *over))
    what = f" [{unit(posed)}]" if unit(posed) else ""
    labels = f"magnitude{what}", "phase [°]", f"error{what}"
    drawn = [
        replace(panel, y=replace(panel.y, label=label))
        for panel, label in zip((first, *panels[1:]), labels, strict=False)
    ]
    return plotly_figure(drawn, _HEIGHT, domains=_DOMAINS[len(drawn)])


@functools.lru_cache(maxsize=2)
def _band_words(posed: Identification | Band, band: Band) -> str:
    return f"{about(posed)}{band_sentence(posed, band)}"


def live_words(
    identification: Identification, error: WorstCaseError | None = None, band: Band | None = None
) -> tuple[str, str, str]:
    """Key of the verdict, the verdict with its margin, and what is guaranteed or what contradicts the class."""
    nothing = error is None and band is not None and not band.bounded.any()
    said = identification_verdict(identification, nothing=nothing)
    words = f"{said.word}, margin {margin_interval(identification)} (proved). {said.sentence}"
    for before in problem_verdict(identification.problem):
        words = f"{before.words}. {words}"
        said = replace(said, key=said.key if said.key in ("inconsistent", "failed") else before.key)
    if identification.status is Status.INCONSISTENT:
        parts = [
            f"{sample_words(identification, Sample(*one[:3]))} ({percent(one[3])})"
            for one in identification.conflicting_samples(_SHARE)[:_MOST]
        ]
        return said.key, words, f"These samples carry the proof: {'; '.join(parts)}."
    if band is not None:
        return said.key, words, _band_words(identification, band)
    return said.key, words, "" if error is None else f"{about(identification)}{guarantee_sentence(error)}"


def look_words(check: SampleCheck, band: Band | None = None) -> tuple[str, str, str]:
    """The same before the margin is known."""
    if not check.contradicts:
        words = "No sample contradicts the others; whether all of them agree is being computed."
        return "", words, "" if band is None else _band_words(band, band)
    words = (
        f"Inconsistent, margin at least {number(check.margin)} (proved). The sample at {in_hz(check.worst / HZ)} lies where"
        " the other samples and the assumptions leave no room for it."
    )
    return "inconsistent", words, "No band is drawn: there is no system that it could hold."


def live_numbers(identification: Identification, band: Band | None = None) -> list[tuple[str, str]]:
    """Margin and largest proved error, to be compared with those of another choice."""
    error = "none is proved"
    if band is not None and band.bounded.any():
        error = in_unit(at_most(largest_error(band).value), identification)
    return [("margin", margin_interval(identification)), ("proved error, largest", error)]


def _with_kept(band: Band, magnitude: Panel, phase: Panel, *below: Panel) -> tuple[Panel, ...]:
    """The panels with a band of another choice behind what they show, and its error."""
    omega, centre, radius, error = drawn_band(band)
    (left, right), (bottom, top) = magnitude.x.range or (0.0, np.inf), magnitude.y.range or (0.0, np.inf)
    seen = (omega >= left * HZ) & (omega <= right * HZ)
    x, middle, half, error = omega[seen] / HZ, np.abs(centre[seen]), radius[seen], error[seen]
    low, high = np.clip([middle - half, middle + half], bottom, top)
    area = Layer(f"{_KEPT}: proved band", x, np.clip(middle, low, high), FAINT, low=low, high=high, fill=True)
    line = Layer(
        f"{_KEPT}: proved error", x, np.where(np.isfinite(error), error, np.nan), FAINT, dash="dash", size=FINE
    )
    after = [replace(one, layers=(line, *one.layers)) for one in below]
    return replace(magnitude, layers=(area, *magnitude.layers)), phase, *after


def _at_frequencies(error: WorstCaseError, magnitude: Panel, phase: Panel, below: Panel) -> tuple[Panel, Panel, Panel]:
    """The panels with bars at the frequencies that are bounded, in place of areas and lines between them."""
    plain = [
        replace(one, layers=tuple(layer for layer in one.layers if layer.colour != BAND)) for one in (magnitude, phase)
    ]
    proved = error.omega > 0  # a logarithmic axis has no 0
    low, high = np.maximum(error.magnitude[proved].T, (magnitude.y.range or (0.0, 1.0))[0])
    name = f"guaranteed range ({counted(error.omega.size, 'frequency')}, poles taken as exact)"
    middle = np.clip(np.abs(error.nominal[proved]), low, high)
    at = error.omega[proved] / HZ
    bars = Layer(name, at, middle, FURTHER[0], marker="line-ew-open", low=low, high=high, size=2.0)
    points = tuple(replace(layer, dash="") if layer.colour == ALERT else layer for layer in below.layers)
    first = replace(plain[0], layers=(bars, *plain[0].layers))
    return first, plain[1], replace(below, layers=points)


def _points(
    responses: Sequence[FrequencyResponse], name: str, marker: str, size: float, choice: bool = False
) -> list[Layer]:
    """Magnitudes of points that are not used."""
    return [
        Layer(name, frf.freq_hz, np.abs(frf.values[:, 0, 0]), FAINT, marker=marker, size=size, choice=choice)
        for frf in responses
    ]


def _with_active(identification: Identification, first: Panel, *others: Panel) -> tuple[Panel, ...]:
    """The panels with rings around the frequency points that carry the proof of the margin."""
    found: dict[int, list[float]] = {}
    for kind, index, at, _ in identification.conflicting_samples(_SHARE):
        if kind == "frequency":
            found.setdefault(index, []).append(at)
    layers: list[Layer] = []
    for index, places in found.items():
        frf = identification.problem.frequency[index]
        if not isinstance(frf, FrequencyResponse):
            continue
        kept = frf.select(np.isin(frf.omega, places))
        layers.append(_ring(_ACTIVE, kept.omega, kept.values[:, 0, 0]))
    return replace(first, layers=(*first.layers, *layers)), *others


def _ring(name: str, omega: np.ndarray, values: np.ndarray) -> Layer:
    return Layer(name, omega / HZ, np.abs(values), ALERT, marker="circle-open", size=2.2)

"""The picture and the words of a page that follows every choice: an identification, and its error as far as it is bounded."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np

from robustid.data import FrequencyResponse
from robustid.errors import Status
from robustid.guarantees import WorstCaseError
from robustid.identification import Identification
from robustid.report.charts import Layer, Panel, named
from robustid.report.identified import sample_words, shown_models, unit
from robustid.report.sections.frequency import frequency_charts
from robustid.report.sections.guarantee import sentence
from robustid.report.sections.guarantee_charts import BAND, band_around, worst_case_charts
from robustid.report.sections.identification import identification_verdict, margin_interval
from robustid.report.style import ALERT, FAINT
from robustid.report.with_plotly import plotly_figure
from robustid.report.words import HZ, number, percent

LEFT_OUT = "left out"
_WITHHELD = "withheld, to test the result"
_ESTIMATE = "estimate, not proved"
_ACTIVE = "active constraints"
_SHARE, _MOST = 0.05, 5  # of the proof, and of the samples that are named
_HEIGHT = 760  # pixels
_DOMAINS = {2: ([0.3, 1.0], [0.0, 0.25]), 3: ([0.48, 1.0], [0.26, 0.44], [0.0, 0.22])}  # of the panels, by their number

Estimate = tuple[np.ndarray, np.ndarray]  # frequencies in rad/s and errors


def live_figure(
    identification: Identification,
    error: WorstCaseError | None = None,
    estimate: Estimate | None = None,
    left_out: Sequence[FrequencyResponse] = (),
    withheld: Sequence[FrequencyResponse] = (),
    *,
    complete: bool = True,
) -> dict[str, Any]:
    """Magnitude, phase and error of a SISO identification as plotly draws them: data and layout.

    The points of the data that are used or `left_out` carry their frequency in Hz as `customdata`. The error is that of the
    nominal model, as far as it is bounded; until that is `complete`, nothing is drawn between the frequencies.
    """
    chart = (frequency_charts(identification) if error is None else worst_case_charts(error))[0]
    panels = chart.panels
    if error is not None and not complete:
        panels = _at_frequencies(error, *panels)
    if estimate is not None:
        panels = _with_estimate(identification, estimate, *panels)
    under, over = _points(withheld, _WITHHELD, "circle", 0.6), _points(left_out, LEFT_OUT, "x", 1.4)
    first = dataclasses.replace(panels[0], layers=(*under, *panels[0].layers, *over, *_active(identification)))
    labels = f"magnitude{_in(identification)}", "phase [°]", f"error{_in(identification)}"
    drawn = [_labelled(*one) for one in zip((first, *panels[1:]), labels, strict=False)]
    figure = plotly_figure(tuple(drawn), _HEIGHT)
    figure["layout"]["legend"]["font"] = {"size": 12}
    for name, domain in zip(("yaxis", "yaxis2", "yaxis3"), _DOMAINS[len(drawn)], strict=False):
        figure["layout"][name]["domain"] = domain
    for trace in figure["data"]:
        if "markers" in trace.get("mode", "") and trace["name"].startswith(("data", LEFT_OUT)):
            trace["customdata"] = trace["x"]
    return figure


def _in(identification: Identification) -> str:
    return f" [{unit(identification)}]" if unit(identification) else ""


def _labelled(panel: Panel, label: str) -> Panel:
    return dataclasses.replace(panel, y=dataclasses.replace(panel.y, label=label))


def live_words(identification: Identification, error: WorstCaseError | None = None) -> tuple[str, str, str]:
    """Key of the verdict, the verdict with its margin, and what is guaranteed or what contradicts the class."""
    said = identification_verdict(identification)
    words = f"{said.word}, margin {margin_interval(identification)} (proved). {said.sentence}"
    if error is not None:
        return said.key, words, sentence(error)
    if identification.status is Status.INCONSISTENT:
        parts = [
            f"{sample_words(identification, _sample(*one[:3]))} ({percent(one[3])})"
            for one in identification.conflicting_samples(_SHARE)[:_MOST]
        ]
        return said.key, words, f"These samples carry the proof: {'; '.join(parts)}."
    return said.key, words, ""


def _sample(kind: str, index: int, at: float) -> str:
    """Name of a sample, as results name them."""
    return (
        f"{kind} {index + 1} at {number(at / HZ, 5)} Hz" if kind == "frequency" else f"time {index + 1} at {at:.5g} s"
    )


def _at_frequencies(error: WorstCaseError, magnitude: Panel, phase: Panel, below: Panel) -> tuple[Panel, Panel, Panel]:
    """The panels with bars at the frequencies that are bounded, in place of areas and lines between them."""
    plain = [
        dataclasses.replace(one, layers=tuple(layer for layer in one.layers if layer.colour != BAND))
        for one in (magnitude, phase)
    ]
    proved = error.omega > 0  # a logarithmic axis has no 0
    low, high = np.maximum(error.magnitude[proved].T, (magnitude.y.range or (0.0, 1.0))[0])
    name = f"guaranteed range ({error.omega.size} frequencies)"
    middle = np.clip(np.abs(error.nominal[proved]), low, high)
    at = error.omega[proved] / HZ
    bars = Layer(name=name, x=at, y=middle, colour=BAND, marker="line-ew-open", low=low, high=high, size=2.0)
    points = tuple(dataclasses.replace(layer, dash="") if layer.colour == ALERT else layer for layer in below.layers)
    first = dataclasses.replace(plain[0], layers=(bars, *plain[0].layers))
    return first, plain[1], dataclasses.replace(below, layers=points)


def _with_estimate(
    identification: Identification, estimate: Estimate, magnitude: Panel, phase: Panel, below: Panel | None = None
) -> tuple[Panel, ...]:
    """The panels of magnitude and error with an estimate, which is drawn apart from what is proved."""
    omega, width = estimate
    curve = named(magnitude, shown_models(identification)[0].name)
    bottom = (magnitude.y.range or (0.0, 1.0))[0]
    areas = band_around(_ESTIMATE, curve, omega / HZ, width[:, None] * np.array([-1.0, 1.0]), bottom)
    areas = [dataclasses.replace(area, colour=FAINT) for area in areas]
    magnitude = dataclasses.replace(magnitude, layers=(*areas, *magnitude.layers))
    if below is None:
        return magnitude, phase
    line = Layer(name=_ESTIMATE, x=omega / HZ, y=width, colour=FAINT, dash="dot")
    low, high = below.y.range or (np.inf, 0.0)
    axis = dataclasses.replace(below.y, range=(min(low, 0.8 * float(width.min())), max(high, 1.2 * float(width.max()))))
    return magnitude, phase, dataclasses.replace(below, layers=(line, *below.layers), y=axis)


def _points(responses: Sequence[FrequencyResponse], name: str, marker: str, size: float) -> list[Layer]:
    """Magnitudes of points that are not used."""
    return [
        Layer(name=name, x=frf.freq_hz, y=np.abs(frf.values[:, 0, 0]), colour=FAINT, marker=marker, size=size)
        for frf in responses
    ]


def _active(identification: Identification) -> list[Layer]:
    """Rings around the frequency points that carry the proof of the margin."""
    found: dict[int, list[float]] = {}
    for kind, index, at, _ in identification.conflicting_samples(_SHARE):
        if kind == "frequency":
            found.setdefault(index, []).append(at)
    layers = []
    for index, places in found.items():
        frf = identification.problem.frequency[index]
        if not isinstance(frf, FrequencyResponse):
            continue
        kept = frf.select(np.isin(frf.omega, places))
        size = np.abs(kept.values[:, 0, 0])
        layers.append(Layer(name=_ACTIVE, x=kept.freq_hz, y=size, colour=ALERT, marker="circle-open", size=2.2))
    return layers

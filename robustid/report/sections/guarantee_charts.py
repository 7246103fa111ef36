"""Charts of a guarantee: the band of the response, and the sets of values in the complex plane."""

from __future__ import annotations

from typing import Any

import numpy as np

from robustid.data import FrequencyResponse
from robustid.guarantees import ValueSet, WorstCaseError, WorstCaseOverPoles
from robustid.identification import MixedProblem
from robustid.report.charts import Axis, Chart, Layer, Panel, behind, named
from robustid.report.identified import responses, shown_band, shown_models, sigma_unit, siso, transfer
from robustid.report.sections.frequency import LARGEST, frequency_charts, sigma_chart
from robustid.report.style import ALERT, DATA, FAINT, FINE, FURTHER, MARKERS, NOMINAL
from robustid.report.words import HZ, number, unit_label

BAND = FURTHER[3]
REACHED = "reached by consistent systems"
_TURN = np.exp(1j * np.linspace(0, 2 * np.pi, 73))
_CLOSE_UP = 4  # frequencies drawn around the model


def worst_case_charts(error: WorstCaseError) -> list[Chart]:
    """Magnitude and phase of every entry with their guaranteed ranges, and the guaranteed error with the one that is reached.

    Between the frequencies the distance of each end of a range from the model is interpolated: nothing is proved there.
    """
    name, model, own = bounded_model(error)
    drawn = frequency_charts(error.identification, None if own else {name: model}, error.omega)
    entries = np.ndindex(error.upper.shape[1:])
    return [_with_range(error, chart, entry, name) for chart, entry in zip(drawn, entries, strict=True)]


def _with_range(error: WorstCaseError, chart: Chart, entry: tuple[int, int], name: str) -> Chart:
    magnitude, phase = chart.panels
    proved = error.omega > 0  # a logarithmic axis has no 0
    at, place = error.omega[proved] / HZ, (proved, *entry)
    nominal = error.nominal.reshape(error.upper.shape)[place]
    sizes, angles = (part.reshape(*error.upper.shape, 2)[place] for part in (error.magnitude, error.phase))
    bottom, top = magnitude.y.range or (0.0, 1.0)
    words = f"guaranteed range ({error.omega.size} frequencies)"
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
    return Chart(name=chart_name, panels=panels, linked=True, grid=not single)


def worst_case_sigma_chart(error: WorstCaseError) -> Chart:
    """Singular values with the guaranteed range of the largest one, and that of F - model, guaranteed and reached."""
    name, model, own = bounded_model(error)
    sigma = sigma_chart(error.identification, None if own else {name: model}, error.omega)
    (panel,) = sigma.panels
    proved = error.omega > 0
    # No singular value moves by more than the largest one of what is added.
    offsets = error.sigma_upper[proved, None] * np.array([-1.0, 1.0])
    bottom, top = panel.y.range or (0.0, 1.0)
    words = f"guaranteed range of σmax ({error.omega.size} frequencies)"
    areas = band_around(words, named(panel, LARGEST + name), error.omega[proved] / HZ, offsets, bottom)
    span = bottom, max(top, *(1.2 * float(area.high.max()) for area in areas if area.high is not None))
    errors = _error_panel(error, panel.x, None)
    return Chart(name="guarantee-sigma", panels=(behind(panel, areas, span), errors), linked=True)


def bounded_model(bounded: WorstCaseError | WorstCaseOverPoles) -> tuple[str, Any, bool]:
    """Name and model that the errors are measured from, and whether it is the nominal one (or a copy of it)."""
    name, own = shown_models(bounded.identification)[0][:2]
    if all(np.array_equal(getattr(bounded.model, part), getattr(own, part)) for part in "ABCD"):
        return name, own, True
    return f"model, order {bounded.model.nstates}", bounded.model, False


def _turns(phase: np.ndarray, nominal: np.ndarray) -> np.ndarray:
    """Ends of the ranges of the phase less the phase of the model, in degrees, (F, 2); NaN where the phase can be anything."""
    offset = phase - np.angle(nominal)[:, None]
    offset -= 2 * np.pi * np.round(offset.mean(axis=1, keepdims=True) / (2 * np.pi))
    anything = phase[:, 1] - phase[:, 0] >= 2 * np.pi * (1 - 1e-12)
    return np.where(anything[:, None], np.nan, np.degrees(offset))


def band_around(name: str, curve: Layer, at: np.ndarray, offsets: np.ndarray, bottom: float = -np.inf) -> list[Layer]:
    """Areas around a curve, exact at the frequencies `at` in Hz; one for each piece of a curve with gaps.

    Between them the offsets are interpolated in the logarithm. One of NaN is a phase that can be anything: half a turn to both
    sides, up to the next frequencies.
    """
    if not at.size:
        return []
    inside = (curve.x >= at[0]) & (curve.x <= at[-1])
    x, y = curve.x[inside], curve.y[inside]
    known = np.interp(np.log(x), np.log(at), np.isnan(offsets[:, 0])) == 0
    low, high = (
        np.maximum(y + np.where(known, _between(x, at, end), any_phase), bottom)
        for end, any_phase in zip(offsets.T, (-180.0, 180.0), strict=True)
    )
    pieces = np.split(np.arange(x.size), np.flatnonzero(~np.isfinite(y)))
    kept = [piece[np.isfinite(y[piece])] for piece in pieces]
    return [Layer(name=name, x=x[k], y=y[k], colour=BAND, low=low[k], high=high[k], fill=True) for k in kept if k.size]


def _between(x: np.ndarray, at: np.ndarray, offset: np.ndarray) -> np.ndarray:
    """Offsets between the frequencies: straight on logarithmic axes, as errors are drawn; linear where the sign changes."""
    sign = np.sign(offset[0])
    if sign and np.all(sign * offset > 0):
        return sign * np.exp(np.interp(np.log(x), np.log(at), np.log(np.abs(offset))))
    return np.interp(np.log(x), np.log(at), np.nan_to_num(offset))


def _widened(span: tuple[float, float], areas: list[Layer]) -> tuple[float, float]:
    """A range of degrees that holds the areas too."""
    lows, highs = ([limit(end) for end in ends] for limit, ends in zip((np.min, np.max), _ends(areas), strict=True))
    return 90 * np.floor(min([span[0], *lows]) / 90 + 0.5) - 45, 90 * np.ceil(max([span[1], *highs]) / 90 - 0.5) + 45


def _ends(areas: list[Layer]) -> tuple[list[Any], list[Any]]:
    return [a.low for a in areas], [a.high for a in areas]


def _error_panel(error: WorstCaseError, x: Axis, entry: tuple[int, int] | None) -> Panel:
    """Panel of the error of an entry, or of the largest singular value."""
    identification, place = error.identification, (slice(None), *(entry or ()))
    left = x.range[0] if x.range else 0.0
    at = np.maximum(error.omega / HZ, left)
    upper, lower = (error.sigma_upper, error.sigma_lower) if entry is None else (error.upper[place], error.lower[place])
    hover = tuple(
        f"{number(w / HZ, 6)} Hz: at most {number(high)}, reached {number(low)}"
        for w, high, low in zip(error.omega, upper, lower, strict=True)
    )
    layers = []
    if (circle := error.known_circle) is not None:  # what has been computed; nothing is computed here
        right = x.range[1] if x.range else np.inf
        edges = np.clip(np.repeat(circle.edges, 2)[1:-1] / HZ, left, right)
        own = entry is not None and not siso(identification)
        bounds = np.repeat(circle.entries[place] if own else circle.bound, 2)
        layers.append(Layer(name="guaranteed between them too", x=edges, y=bounds, colour=FAINT, dash="solid"))
    name = "guaranteed error"
    layers.append(Layer(name=name, x=at, y=upper, colour=ALERT, dash="dash", marker="circle", hover=hover))
    reached = np.where(lower > 0, lower, np.nan)
    layers.append(Layer(name=REACHED, x=at, y=reached, colour=DATA, marker=MARKERS[2], hover=hover))
    span = error_range(layers)  # none where nothing is uncertain
    title = "Error of the model: the farthest consistent system"
    title += ", 0 Hz drawn at the left end" if error.omega[0] == 0 else ""
    label = f"error |F − model| of\n{transfer(identification)}"
    if entry is None:
        label = f"σmax(F − model)\n{sigma_unit(identification).strip()}".strip()
    elif not siso(identification):  # the name stands above
        output, input_ = identification.problem.outputs[entry[0]], identification.problem.inputs[entry[1]]
        title, label = "", f"error{unit_label(output.unit, input_.unit)}"
    return Panel(
        title=title,
        x=x,
        y=Axis(label=label, log=True, range=span),
        layers=tuple(layers),
    )


def error_range(layers: list[Layer]) -> tuple[float, float] | None:
    """Range of an axis of errors; None where there are none."""
    values = np.concatenate([layer.y for layer in layers])
    values = values[np.isfinite(values) & (values > 0)]
    return (0.6 * float(values.min()), 1.6 * float(values.max())) if values.size else None


def nyquist_chart(error: WorstCaseError) -> Chart:
    """The sets of values of every entry in the complex plane: polygons that hold every consistent one, points that are reached.

    All of them with the discs of the data, and those of the worst frequencies around the model.
    """
    identification, (name, model, _) = error.identification, bounded_model(error)
    ends = shown_band(identification, error.omega)
    _, (response,) = responses([model], identification.problem, ends, error.omega)
    panels = []
    for entry in np.ndindex(error.upper.shape[1:]):
        panels += _nyquist_panels(error, entry, name, response[:, *entry])
    return Chart(name="nyquist", panels=tuple(panels), columns=2)


def _nyquist_panels(error: WorstCaseError, entry: tuple[int, int], name: str, response: np.ndarray) -> list[Panel]:
    problem = error.identification.problem
    sets, nominal = error.of_entry(*entry), error.nominal.reshape(error.upper.shape)[:, *entry]
    layers = [
        _plane(name, response, NOMINAL, dash="solid", size=FINE),
        *data_discs(problem, entry),
        _plane("holds every consistent value", _joined([_outline(v) for v in sets]), ALERT, dash="solid"),
        _plane(REACHED, np.concatenate([v.points for v in sets]), DATA, marker=MARKERS[2], size=0.6),
        _plane(f"model at the {error.omega.size} frequencies", nominal, NOMINAL, marker="circle", size=0.6),
    ]
    worst = np.argsort(-error.sigma_upper)[:_CLOSE_UP]  # the same ones, in the same colours, for every entry
    near = []
    for colour, k in zip((ALERT, *FURTHER), worst.tolist(), strict=False):
        words = f"{number(float(error.omega[k]) / HZ, 5)} Hz"
        near.append(_plane(words, _outline(sets[k]) - nominal[k], colour, dash="solid"))
    points = np.concatenate([sets[k].points - nominal[k] for k in worst])
    near += [
        _plane(REACHED, points, DATA, marker=MARKERS[2], size=0.6),
        _plane("model", np.zeros(1), NOMINAL, marker="x"),
    ]
    what = unit_label(problem.outputs[entry[0]].unit, problem.inputs[entry[1]].unit) or " [–]"
    return [
        _square("Values at the frequencies", f"of {transfer(error.identification, *entry)}", layers),
        _square("Largest errors, around the model", f"of F − model{what}", near),
    ]


def _plane(name: str, values: np.ndarray, colour: str, **style: Any) -> Layer:
    return Layer(name=name, x=np.real(values), y=np.imag(values), colour=colour, **style)


def _outline(values: ValueSet) -> np.ndarray:
    return np.append(values.vertices, values.vertices[0])


def _joined(outlines: list[np.ndarray]) -> np.ndarray:
    """One curve with gaps."""
    return np.concatenate([np.append(outline, np.nan) for outline in outlines])


def data_discs(problem: MixedProblem, entry: tuple[int, int]) -> list[Layer]:
    """The borders |e + kappa conj(e)| = bound around every sample: e = bound (u - kappa conj(u))/(1 - |kappa|^2), |u| = 1."""
    outlines, place = [], (slice(None), *entry)
    for frf in problem.frequency:
        if not isinstance(frf, FrequencyResponse):
            continue
        tilt = np.zeros(frf.omega.size) if frf.bound.tilt is None else frf.bound.tilt[place]
        for value, bound, kappa in zip(frf.values[place], frf.bound.radius[place], tilt, strict=True):
            if np.isfinite(bound):
                outlines.append(value + bound * (_TURN - kappa * _TURN.conj()) / (1 - abs(kappa) ** 2))
    return [_plane("bounds of the data", _joined(outlines), FAINT, dash="solid")] if outlines else []


def _square(title: str, what: str, layers: list[Layer]) -> Panel:
    """A panel of the complex plane with equal axes around everything that is drawn."""
    axes = [np.concatenate([getattr(layer, part) for layer in layers]) for part in "xy"]
    lows, highs = (np.array([limit(values) for values in axes]) for limit in (np.nanmin, np.nanmax))
    half = 0.54 * float((highs - lows).max()) or 1.0
    spans = [(float(middle - half), float(middle + half)) for middle in (lows + highs) / 2]
    x, y = (
        Axis(label=f"{part} part\n{what}", range=span) for part, span in zip(("real", "imaginary"), spans, strict=True)
    )
    return Panel(title=title, x=x, y=y, layers=tuple(layers), square=True)

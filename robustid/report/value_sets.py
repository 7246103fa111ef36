"""Sets of the values of a response in the complex plane: polygons that hold every consistent one, and points that are reached."""

from __future__ import annotations

import numpy as np

from robustid.core import counted
from robustid.data import FrequencyResponse
from robustid.guarantees import ValueSet, WorstCaseError
from robustid.identification import MixedProblem
from robustid.report.charts import (
    ALERT,
    DATA,
    FAINT,
    FINE,
    FURTHER,
    MARKERS,
    NOMINAL,
    REACHED,
    Axis,
    Chart,
    Layer,
    Panel,
)
from robustid.report.identified import bounded_model, entry_unit, responses, shown_band, transfer
from robustid.report.words import HZ, in_hz

TURN = np.exp(1j * np.linspace(0, 2 * np.pi, 73))
_CLOSE_UP = 4  # frequencies drawn around the model


def nyquist_chart(error: WorstCaseError) -> Chart:
    """The sets of values of every entry in the complex plane: polygons that hold every consistent one, points that are reached.

    All of them with the discs of the data, and those of the worst frequencies around the model.
    """
    identification, name = error.identification, bounded_model(error.identification, error.model)[0]
    ends = shown_band(identification, error.omega)
    _, (response,) = responses([error.model], identification.problem, ends, error.omega)
    panels: list[Panel] = []
    for entry in np.ndindex(error.upper.shape[1:]):
        panels += _nyquist_panels(error, entry, name, response[:, *entry])
    return Chart("nyquist", panels, columns=2)


def _nyquist_panels(error: WorstCaseError, entry: tuple[int, int], name: str, response: np.ndarray) -> list[Panel]:
    problem = error.identification.problem
    sets, nominal = error.of_entry(*entry), error.nominal.reshape(error.upper.shape)[:, *entry]
    layers = [
        plane_layer(name, response, NOMINAL, dash="solid", size=FINE),
        *data_discs(problem, entry),
        plane_layer("holds every consistent value", with_gaps([_outline(v) for v in sets]), ALERT, dash="solid"),
        plane_layer(REACHED, np.concatenate([v.points for v in sets]), DATA, marker=MARKERS[2], size=0.6),
        plane_layer(
            f"model at the {counted(error.omega.size, 'frequency')}", nominal, NOMINAL, marker="circle", size=0.6
        ),
    ]
    worst: list[int] = np.argsort(-error.sigma_upper)[
        :_CLOSE_UP
    ].tolist()  # the same, in the same colours, of every entry
    near: list[Layer] = []
    for colour, k in zip((ALERT, *FURTHER), worst, strict=False):
        words = in_hz(float(error.omega[k]) / HZ)
        near.append(plane_layer(words, _outline(sets[k]) - nominal[k], colour, dash="solid"))
    points = np.concatenate([sets[k].points - nominal[k] for k in worst])
    near += [
        plane_layer(REACHED, points, DATA, marker=MARKERS[2], size=0.6),
        plane_layer("model", np.zeros(1), NOMINAL, marker="x"),
    ]
    what = entry_unit(error.identification, *entry) or " [–]"
    return [
        square_panel("Values at the frequencies", f"of {transfer(error.identification, *entry)}", layers),
        square_panel("Largest errors, around the model", f"of F − model{what}", near),
    ]


def plane_layer(
    name: str, values: np.ndarray, colour: str, *, dash: str = "", marker: str = "", size: float = 1.0
) -> Layer:
    """A layer of values in the complex plane."""
    return Layer(name, np.real(values), np.imag(values), colour, dash=dash, marker=marker, size=size)


def _outline(values: ValueSet) -> np.ndarray:
    return np.append(values.vertices, values.vertices[0])


def with_gaps(outlines: list[np.ndarray]) -> np.ndarray:
    """One curve with gaps."""
    return np.concatenate([np.append(outline, np.nan) for outline in outlines])


def data_discs(problem: MixedProblem, entry: tuple[int, int]) -> list[Layer]:
    """The borders |e + kappa conj(e)| = bound around every sample: e = bound (u - kappa conj(u))/(1 - |kappa|^2), |u| = 1."""
    place = (slice(None), *entry)
    outlines: list[np.ndarray] = []
    for frf in problem.frequency:
        if not isinstance(frf, FrequencyResponse):
            continue
        tilt = np.zeros(frf.omega.size) if frf.bound.tilt is None else frf.bound.tilt[place]
        for value, bound, kappa in zip(frf.values[place], frf.bound.radius[place], tilt, strict=True):
            if np.isfinite(bound):
                outlines.append(value + bound * (TURN - kappa * TURN.conj()) / (1 - abs(kappa) ** 2))
    return [plane_layer("bounds of the data", with_gaps(outlines), FAINT, dash="solid")] if outlines else []


def square_panel(title: str, what: str, layers: list[Layer]) -> Panel:
    """A panel of the complex plane with equal axes around everything that is drawn."""
    axes = [np.concatenate([getattr(layer, part) for layer in layers]) for part in "xy"]
    lows, highs = (np.array([limit(values) for values in axes]) for limit in (np.nanmin, np.nanmax))
    half = 0.54 * float((highs - lows).max()) or 1.0
    spans = [(float(middle - half), float(middle + half)) for middle in (lows + highs) / 2]
    x, y = (Axis(f"{part} part\n{what}", range=span) for part, span in zip(("real", "imaginary"), spans, strict=True))
    return Panel(title, x, y, layers, square=True)

"""The frequency response of an identification: models against samples with their discs, entry by entry, and singular values."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from robustid.data import FrequencyResponse
from robustid.identification import Identification, MixedProblem
from robustid.report.assumptions import shared_words
from robustid.report.charts import DATA, FAINT, Axis, Chart, Layer, Panel, lighter, side_by_side
from robustid.report.curves import half_angle, low_quantile, magnitude_range, next_to, phase_curves, with_gaps
from robustid.report.document import Block, Drawing, Grid, Heading, Text
from robustid.report.identified import (
    Models,
    Posed,
    bounded_model,
    entry_unit,
    hertz,
    numbered,
    responses,
    shown_band,
    shown_models,
    sigma_unit,
    siso,
    transfer,
)
from robustid.report.magnitude_phase import Look, MagnitudePhase, Ranged, phase_axis
from robustid.report.words import HZ, at_hz

LARGEST = "σmax of the "
if TYPE_CHECKING:
    import control

_MANY = 300  # points, above which their bars run into one another
_NOWHERE = np.zeros(0)
_SIGMA = (
    "Of the response as a matrix, in the units of its entries: the largest amplification of any combination of the inputs. A"
    " peak of the largest one is a mode. The data stand where every entry was measured; bars: the norm of the matrix of bounds."
)
_TALL = 30.0  # times the largest response of a model: samples that say nothing are not followed beyond


def frequency_section(identification: Identification, models: Models) -> list[Block]:
    """Build the section of the frequency response, with the singular values of a MIMO one."""
    entries, blocks = frequency_charts(identification, models), [Heading("Frequency response")]
    bars = bars_words(identification)
    if siso(identification):
        return [*blocks, Text(bars, "soft"), Drawing(entries[0])]
    drag = "outputs below each other, inputs beside each other. Drag to zoom, double click to go back."
    return [
        *blocks,
        Text(f"Magnitude and phase of every entry; {drag}", "soft"),
        Text(bars, "soft"),
        Grid(lighter(entries), len(identification.problem.inputs)),
        Heading("Singular values", 3),
        Text(_SIGMA, "soft"),
        Drawing(sigma_chart(identification, models)),
    ]


def bars_words(identification: Identification) -> str:
    """Say what is drawn of the frequency samples."""
    if not identification.problem.frequency:
        return "No frequency samples were given; this is what the time records imply."
    words = "Bars are the disc of each sample: magnitude ± bound, and the phases inside it."
    if shared_words(identification):
        words += " Of a bound that entries share they show what it leaves to one entry alone."
    if not all(isinstance(f, FrequencyResponse) for f in identification.problem.frequency):
        words += " Samples of combinations of signals aren’t drawn here; their residuals are, below."
    return words


def frequency_charts(
    identification: Identification, models: Models = None, omega: np.ndarray = _NOWHERE
) -> list[Chart]:
    """Magnitude and phase of every entry, row by row: the models, at `omega` (rad/s) too, and every sample with its disc."""
    problem, ends, shown = (
        identification.problem,
        shown_band(identification, omega),
        shown_models(identification, models),
    )
    omega, values = responses([one.model for one in shown], problem, ends, omega)
    charts: list[Chart] = []
    for i, j in np.ndindex(problem.entries.shape):
        curves = [Curve(one.name, v[:, i, j], one.colour, one.dash) for one, v in zip(shown, values, strict=True)]
        charts.append(entry_chart(identification, (i, j), omega, curves, ends))
    return charts


class Curve(NamedTuple):
    """A response to be drawn, under its name and with its looks."""

    name: str
    values: np.ndarray  # (F,) complex
    colour: str
    dash: str


def entry_chart(
    identification: Posed, entry: tuple[int, int], omega: np.ndarray, curves: list[Curve], band: tuple[float, float]
) -> Chart:
    """Magnitude and phase of an entry: curves at `omega`, and every sample with its disc."""
    problem = identification.problem
    values = [one.values for one in curves]
    phases, span = phase_curves(values)
    measured = _measured(problem, *entry)
    reach = _range(measured, values)
    drawn = MagnitudePhase()
    for one, angle in zip(curves, phases, strict=True):
        drawn.add(one.name, omega / HZ, np.abs(one.values), with_gaps(angle), colour=one.colour, dash=one.dash)
    for what, at, value, bound in measured:
        size, angle = np.abs(value), np.degrees(np.angle(value))
        turn = np.where(bound >= size, 180.0, half_angle(size, bound))  # the disc holds 0: any phase
        angle = next_to(angle, phases[0][np.searchsorted(omega, at).clip(0, omega.size - 1)])
        hover = at_hz(at / HZ, "{} ± {}, {}°", size, bound, angle)
        sizes = Ranged(np.maximum(size, reach[0]), np.maximum(size - bound, reach[0]), size + bound)
        angles = Ranged(angle, angle - turn, angle + turn)
        _add_samples(drawn, what, np.maximum(at, band[0]) / HZ, sizes, angles, hover)
    x, name = hertz(problem, *band), transfer(identification, *entry)
    if siso(identification):
        turn_axis = phase_axis(span, f"phase [°] of\n{problem.outputs[0].name} / {problem.inputs[0].name}")
        return drawn.chart("frequency", x, Axis(name, log=True, range=reach), turn_axis, "Magnitude", "Phase")
    size_axis = Axis(f"magnitude{entry_unit(identification, *entry)}", log=True, range=reach)  # the name stands above
    return drawn.chart(f"entry-{entry[0]}-{entry[1]}", x, size_axis, phase_axis(span), name, grid=True)


class Named(NamedTuple):
    """Names of samples: with their bars; without them; of the area that stands for bars."""

    both: str
    alone: str
    area: str


Samples = tuple[Named, np.ndarray, np.ndarray, np.ndarray]


def _measured(problem: MixedProblem, output: int, input_: int) -> list[Samples]:
    """Samples of an entry: names, frequencies in rad/s, values, and radius of the disc around what the bound leaves to it alone."""
    responses = [f for f in problem.frequency if isinstance(f, FrequencyResponse)]
    out: list[Samples] = []
    for k, frf in enumerate(responses):
        used, place = frf.bound.used[:, output, input_], (slice(None), output, input_)
        if not used.any():
            continue
        names = ("data with their bounds", "data", "bounds of the data")
        if frf.bound.tilt is not None:
            names = ("data with discs around their ellipses",) * 3
        shared = "" if frf.bound.joint == "entry" else " (shared bound)"
        named = Named(*(numbered(name + shared, k, len(responses)) for name in names))
        out.append((named, frf.omega[used], frf.values[place][used], frf.bound.outer_radius[place][used]))
    return out


def _add_samples(
    drawn: MagnitudePhase, named: Named, x: np.ndarray, size: Ranged, angle: Ranged, hover: tuple[str, ...]
) -> None:
    """Samples with bars; so many that bars would hide everything: small ones on an area, behind the models."""
    if x.size <= _MANY:
        drawn.add(named.both, x, size, angle, colour=DATA, marker="circle", hover=hover, choice=True)
        return
    look: Look = {"marker": "circle", "hover": hover, "choice": True, "size": 0.4}
    drawn.add(named.alone, x, size.y, angle.y, colour=DATA, under=True, **look)
    drawn.add(named.area, x, size, angle, under=True, colour=DATA, fill=True)


def _range(measured: list[Samples], values: list[np.ndarray]) -> tuple[float, float]:
    """Range that holds the curves and all samples that say something, but not the bottom of deep notches.

    A sample below its own bound, as where a sweep has hardly any power, may lie far above: it does not stretch the axis.
    """
    sizes, highest = [np.abs(value) for *_, value, _ in measured], float(np.max(np.abs(np.concatenate(values))))
    tops = [
        np.where(bound < size, size + bound, np.minimum(size + bound, _TALL * highest))
        for size, (*_, bound) in zip(sizes, measured, strict=True)
    ]
    top = max(highest, *(float(one.max(initial=0.0)) for one in tops), 0.0)
    floors = [low_quantile(np.abs(values[0])), *(float(s[s > 0].min(initial=top)) for s in sizes)]
    return magnitude_range(top, floors)


def sigma_chart(identification: Identification, models: Models = None, omega: np.ndarray = _NOWHERE) -> Chart:
    """Singular values of the models over frequency, at `omega` (rad/s) too, and the largest one of what was measured."""
    problem, shown = identification.problem, shown_models(identification, models)
    ends = shown_band(identification, omega)
    at, values = responses([one.model for one in shown], problem, ends, omega)
    sizes = [np.linalg.svd(value, compute_uv=False) for value in values]
    layers = [Layer("further singular values", at / HZ, size, FAINT, dash="solid") for size in sizes[0].T[1:]]
    for one, size in zip(shown, sizes, strict=True):
        layers.append(Layer(LARGEST + one.name, at / HZ, size[:, 0], one.colour, dash=one.dash))
    points, sigma, radius = measured_sigma(problem)
    top = max(float(size.max()) for size in (*sizes, sigma + radius) if size.size)
    low = min(float(size.min()) for size in (sizes[0][:, 0], sigma[sigma > 0]) if size.size)
    reach = magnitude_range(top, [low, 2 * low_quantile(sizes[0])])
    if points.size:
        hover = at_hz(points / HZ, "{} ± {}", sigma, radius)
        low, high = np.maximum(sigma - radius, reach[0]), sigma + radius
        x, y = np.maximum(points, ends[0]) / HZ, np.maximum(sigma, reach[0])
        layers.append(Layer("σmax of the data", x, y, DATA, marker="circle", hover=hover, low=low, high=high))
    y_axis = Axis(f"singular value{sigma_unit(identification)}", log=True, range=reach)
    panel = Panel("Singular values", hertz(problem, *ends), y_axis, layers)
    return Chart("sigma", (panel,), linked=True)


def size_panel(identification: Identification, model: control.StateSpace, omega: np.ndarray) -> tuple[str, Panel]:
    """Name of the curve of `model` and the panel that holds it: magnitude of a SISO response, largest singular value of others."""
    name, further = bounded_model(identification, model)
    if siso(identification):
        return name, frequency_charts(identification, further, omega)[0].panels[0]
    return LARGEST + name, sigma_chart(identification, further, omega).panels[0]


def measured_sigma(problem: MixedProblem) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Frequencies (rad/s) at which every entry was measured, the largest singular value there, and how far the true one can be.

    |E| <= R entry by entry has ||E|| <= ||R||. Of several experiments the one with the smallest bound counts, by entry.
    """
    shape = problem.angles.size, len(problem.outputs), len(problem.inputs)
    values, radius = np.zeros(shape, complex), np.full(shape, np.inf)
    for frf in problem.frequency:
        if not isinstance(frf, FrequencyResponse):
            continue
        for k, node in enumerate(problem.node_index(problem.plane.angles(frf.omega))):
            better = frf.bound.outer_radius[k] < radius[node]
            values[node][better], radius[node][better] = frf.values[k][better], frf.bound.outer_radius[k][better]
    known = np.isfinite(radius).all(axis=(1, 2))
    sigma, reach = (np.linalg.norm(part[known], 2, axis=(1, 2)) for part in (values, radius))
    return problem.plane.omega(problem.angles[known]), sigma, reach


def identified_bode(identification: Identification, models: Models = None) -> Chart:
    """Every entry with its samples and models; of a MIMO problem the singular values below."""
    found = frequency_charts(identification, models)
    if siso(identification):
        return found[0]
    sigma = sigma_chart(identification, models).panels
    return side_by_side("frequency", lighter(found), len(identification.problem.inputs), sigma)

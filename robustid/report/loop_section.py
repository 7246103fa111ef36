"""A plant in a loop: its model, worst cases of the loop over every consistent plant, and the margins of all of them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from robustid.errors import InputError
from robustid.guarantees import LoopBounds
from robustid.report.charts import ALERT, BAND, NOMINAL, Axis, Chart, Layer, Panel, first_panel, frequency_axis
from robustid.report.data_faults import steps_with_faults
from robustid.report.document import Block, Column, Drawing, Facts, Glance, Heading, Table, Text, Verdict, of_numbers
from robustid.report.identified import scope
from robustid.report.proved_band import poles_words
from robustid.report.words import HZ, at_least, at_most, number

if TYPE_CHECKING:
    from robustid.identification import Identification
    from robustid.reduction import PlantReduction
    from robustid.report.identified import Parts

_POINTS = 1500
_NAMES = {
    "sensitivity": "S, from a disturbance at the output to the output",
    "complementary_sensitivity": "T = I - S",
    "process_sensitivity": "P S, from a disturbance at the input to the output",
    "control_sensitivity": "C S, from a disturbance at the output to the input",
}


def loop_section(
    identification: Identification, bounds: LoopBounds | None, plant: PlantReduction | None
) -> list[Block]:
    """Build the section of a plant in a loop; nothing where there is none."""
    if bounds is None and plant is None:
        return []
    if bounds is not None and bounds.band.problem.plane != identification.problem.plane:
        raise InputError("`loop` must be about the identification reported; take loop_bounds(band, loop) of its band")
    intro = "The identification is that of the stable system R of a loop: every plant that the controller stabilises is P(R), and R"
    intro += " is seen in open loop, by a signal without noise."
    found: list[Block] = [Heading("The plant and its loop", guarantee=True), Text(intro)]
    if plant is not None:
        found.append(Facts(_plant_rows(plant)))
    if bounds is None:
        return [*found, Text("There is no band of R that worst cases of the loop could be taken from.", "soft")]
    return [*found, loop_verdict(bounds), Drawing(loop_chart(bounds, plant)), peaks_table(bounds), Facts(_rows(bounds))]


def loop_glance(identification: Identification, bounds: LoopBounds, parts: Parts) -> Glance:
    """Build the first screen of a plant in a loop: its model, and what holds of the loop."""
    margins, plant = bounds.margins, parts.get("plant")
    low, high = margins.gain
    numbers = [
        ("peak of S, every consistent plant", f"≤ {at_most(bounds.peaks['sensitivity'].value, 3)}"),
        ("gain", f"{at_most(low, 3)} … {at_least(high, 3)}"),
        ("phase", f"≥ {at_least(float(np.degrees(margins.phase)), 3)}°"),
        ("delay", f"≥ {at_least(margins.delay, 3)} s"),
    ]
    if plant is not None:
        numbers.insert(0, ("model of the plant, order", str(plant.order)))
    words = "Every plant that agrees with the data and the assumptions is in the range that is drawn, and keeps these margins with"
    words += f" the controller that ran, u = {bounds.loop.law}, proved at every frequency{scope(identification)}"
    words += f"; of R {poles_words(bounds.band)}." if bounds.band.problem.parametric is not None else "."
    own = [
        Text(
            "Try another controller: loop_bounds(band, loop, controller)", code=("loop_bounds(band, loop, controller)",)
        )
    ]
    steps = steps_with_faults(identification.problem.placed_faults, parts.get("undoing"), own)
    return Glance(numbers=numbers, words=words, chart=first_panel(loop_chart(bounds, plant)), next=steps)


def loop_summary(bounds: LoopBounds) -> list[Block]:
    """Build the summary at the terminal."""
    return [loop_verdict(bounds), peaks_table(bounds), Facts(_rows(bounds))]


def _plant_rows(plant: PlantReduction) -> list[tuple[str, str]]:
    poles = plant.model.poles()
    rate = np.log(np.abs(poles)) / plant.model.dt if plant.model.dt else np.real(poles)
    unstable = poles[rate > 0]
    words = "none is unstable"
    if unstable.size:
        rates = ", ".join(f"{one:.4g} 1/s" for one in np.sort(rate[rate > 0])[::-1])
        words = f"{unstable.size} of {poles.size} unstable, growing with {rates}"
    return [
        ("Model of the plant", f"Order {plant.order}; the controller that ran stabilises it."),
        ("Its poles", words),
        ("Its R", f"Every sample is within {at_most(plant.margin)} of its bound."),
    ]


def loop_verdict(bounds: LoopBounds) -> Verdict:
    """Verdict on a controller with every consistent plant."""
    peak = bounds.peaks["sensitivity"]
    numbers = (("peak of S", at_most(peak.value, 3)), ("zone", bounds.zone))
    if not bounds.guaranteed:
        words = "Not every consistent plant is proved to be stabilised by the controller."
        return Verdict("weak", "Not guaranteed", words, numbers, id="loop-verdict")
    which = "The controller that ran" if bounds.stability is None else "The controller"
    words = (
        f"{which} stabilises every consistent plant; the sensitivity is at most {at_most(peak.value)} with any of them."
    )
    return Verdict("consistent", "Stable with every consistent plant", words, numbers, id="loop-verdict")


def peaks_table(bounds: LoopBounds) -> Table:
    """Peaks of the maps of the loop on the whole axis."""
    rows = [
        [words, at_most(bounds.peaks[name].value), number(bounds.peaks[name].omega / HZ, 5)]
        for name, words in _NAMES.items()
        if np.isfinite(bounds.peaks[name].value)
    ]
    heads = Column("map of the loop"), *of_numbers("largest, for every consistent plant", "near [Hz]")
    return Table(heads, rows, empty="No peak is bounded.")


def _rows(bounds: LoopBounds) -> list[tuple[str, str]]:
    margins = bounds.margins
    low, high = margins.gain
    return [
        (
            "Gain",
            f"Stable for {at_most(low)} to {at_least(high)} times the gain of the controller, for every consistent plant.",
        ),
        ("Phase", f"At least {at_least(float(np.degrees(margins.phase)))} degrees, either way."),
        ("Delay", f"At least {at_least(margins.delay)} s more."),
        ("Modulus", f"At least {at_least(margins.modulus)} from -1; disc margin {at_least(margins.disk)}."),
        (
            "ISO 14839-3",
            f"Zone {bounds.zone} of the edition of 2006 for magnetic bearings (A: S up to 3, B: 4, C: 5), by the peak of S alone.",
        ),
        ("Assumed", f"The class of R, the bounds of its samples, and that this controller ran: u = {bounds.loop.law}."),
    ]


def loop_chart(bounds: LoopBounds, plant: PlantReduction | None = None) -> Chart:
    """Magnitudes of the plant with the range of all consistent ones, and the largest S and T."""
    low, high = bounds.band.range
    low = max(low, float(bounds.omega[bounds.omega > 0].min()) / 3)
    high = min(high, 3 * float(bounds.omega.max()))
    omega = np.geomspace(low, high, _POINTS)
    x, axis = omega / HZ, frequency_axis(omega)
    centre, radius = bounds.plant_at(omega)
    size = np.linalg.norm(centre, 2, axis=(1, 2))
    about = size if plant is None else np.linalg.norm(bounds.loop.response_of(plant.model, omega), 2, axis=(1, 2))
    floor, top = 0.2 * float(about.min()), 5.0 * float(about.max())
    ends = np.clip(size - radius, floor, top), np.clip(size + radius, floor, top)
    area = Layer("range of every consistent plant", x, np.clip(size, *ends), BAND, low=ends[0], high=ends[1], fill=True)
    line = Layer("centre" if plant is None else f"model, order {plant.order}", x, about, NOMINAL, dash="solid")
    maps = bounds.at(omega)
    curves = [
        Layer(name, x, _drawn(*maps[of]), colour, dash="solid")
        for name, of, colour in (("S", "sensitivity", ALERT), ("T", "complementary_sensitivity", NOMINAL))
    ]
    drawn = np.concatenate([one.y for one in curves])
    known = drawn[np.isfinite(drawn) & (drawn > 0)]
    span = (max(1e-3 * known.max(), known.min() / 1.5), 1.5 * known.max()) if known.size else None
    return Chart(
        "loop",
        (
            Panel("Plant", axis, Axis("magnitude", log=True, range=(floor, top)), (area, line)),
            Panel(
                "Loop: largest for every consistent plant", axis, Axis("largest value", log=True, range=span), curves
            ),
        ),
        linked=True,
    )


def _drawn(centre: np.ndarray, radius: np.ndarray) -> np.ndarray:
    """Largest values; nan where nothing is bounded."""
    size = np.linalg.norm(centre, 2, axis=(1, 2)) + radius
    return np.where(np.isfinite(size), size, np.nan)

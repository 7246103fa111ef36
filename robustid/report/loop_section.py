"""A plant in a loop: its model, worst cases of the loop over every consistent plant, and the margins of all of them."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from robustid.errors import InputError
from robustid.guarantees import LoopBounds, margins_by_loop
from robustid.identification import describe_poles
from robustid.report.charts import ALERT, BAND, FURTHER, NOMINAL, Axis, Chart, Layer, Panel, first_panel, frequency_axis
from robustid.report.data_faults import steps_with_faults
from robustid.report.document import Block, Column, Drawing, Facts, Glance, Heading, Table, Text, Verdict, of_numbers
from robustid.report.identified import scope, sigma_unit, siso, transfer
from robustid.report.proved_band import poles_words
from robustid.report.words import HZ, at_least, at_most, matrix_unit_label, number

if TYPE_CHECKING:
    from robustid.identification import Identification
    from robustid.reduction import PlantReduction
    from robustid.report.identified import Parts

_POINTS = 1500
_NAMES = {
    "sensitivity": "S, from a disturbance at the output to the output",
    "complementary_sensitivity": "T = I − S, from the set point to the output",
    "process_sensitivity": "P S, from a disturbance at the input to the output",
    "control_sensitivity": "C S, from a disturbance at the output to the input",
}
_AT_INPUTS = {
    **_NAMES,
    "sensitivity": "S at the inputs, (I + C P)⁻¹, from a disturbance at the input to the input",
    "complementary_sensitivity": "T = I − S at the inputs, from a disturbance at the input to what answers it",
}  # of fewer inputs than outputs
_ZERO = 1e-2  # of the lowest frequency of a band: a peak that is found below is at 0


def loop_section(
    identification: Identification,
    bounds: LoopBounds | None,
    plant: PlantReduction | None,
    candidates: Mapping[str, LoopBounds] | None = None,
) -> list[Block]:
    """Build the section of a plant in a loop; nothing where there is none."""
    if bounds is None and plant is None:
        return []
    if bounds is not None and bounds.band.problem.plane != identification.problem.plane:
        raise InputError("`loop` must be about the identification reported; take loop_bounds(band, loop) of its band")
    intro = "The identification is that of the stable system R of a loop: every plant that the controller stabilises is P(R), and R"
    intro += " is seen in open loop, by a signal without noise. R is what the auxiliary plant leaves: parts of its response, in"
    intro += " the sections whose titles begin with R, say nothing of parts of the plant's."
    found: list[Block] = [Heading("The plant and its loop", guarantee=True), Text(intro)]
    if plant is not None:
        found.append(Facts(_plant_rows(plant)))
    if bounds is None:
        return [*found, Text("There is no band of R that worst cases of the loop could be taken from.", "soft")]
    found += [loop_verdict(bounds), Drawing(loop_chart(bounds, plant)), peaks_table(bounds), Facts(loop_rows(bounds))]
    return [*found, *candidates_section(candidates)]


def loop_glance(identification: Identification, bounds: LoopBounds, parts: Parts) -> Glance:
    """Build the first screen of a plant in a loop: its model, and what holds of the loop."""
    plant, candidates = parts.get("plant"), parts.get("candidates")
    numbers = loop_numbers(bounds)
    if plant is not None:
        numbers.insert(0, ("model of the plant, order", str(plant.order)))
    words = "Every plant that agrees with the data and the assumptions is in the range that is drawn, and keeps these margins with"
    words += f" the controller that ran, u = {bounds.loop.law}, proved at every frequency{scope(identification)}"
    if bounds.unbounded:
        words = f"The controller that ran, u = {bounds.loop.law}, stabilises every plant that agrees with the data; of its margins"
        words += f" {bounds.unbounded}{scope(identification)}"
    words += f"; of R {poles_words(bounds.band)}." if bounds.band.problem.parametric is not None else "."
    if candidates:
        words += (
            " Tried: "
            + "; ".join(f"{name}: {loop_verdict(one).word.lower()}" for name, one in candidates.items())
            + "."
        )
    code = "robustid loop FOLDER --controller NEW.npz"
    own = [Text(f"Try another controller: {code}", code=(code,))]
    steps = steps_with_faults(identification.problem.placed_faults, parts.get("undoing"), own)
    return Glance(numbers=numbers, words=words, chart=first_panel(loop_chart(bounds, plant)), next=steps)


def loop_numbers(bounds: LoopBounds) -> list[tuple[str, str]]:
    """Numbers of the first screen: peak and margins that hold for every consistent plant; none where nothing is bounded."""
    if bounds.unbounded:
        return []
    low, high = bounds.margins.gain
    return [
        ("peak of S, every consistent plant", f"≤ {at_most(bounds.peaks['sensitivity'].value, 3)}"),
        ("gain margin", f"{at_most(low, 3)} … {at_least(high, 3)}"),
        ("phase margin", f"≥ {at_least(float(np.degrees(bounds.margins.phase)), 3)}°"),
        ("delay margin", f"≥ {at_least(bounds.margins.delay, 3)} s"),
    ]


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
    peak, ran = bounds.peaks["sensitivity"], bounds.stability is None
    numbers = () if bounds.unbounded else (("peak of S", at_most(peak.value, 3)), ("zone", bounds.zone))
    if (plant := bounds.refuted_by) is not None:
        words = f"A plant that the data allow is not stabilised by the controller: their loop has a {plant.pole_words}."
        return Verdict("inconsistent", "Refused", words, (), id="loop-verdict")
    if not bounds.guaranteed:
        margin = 0.0 if bounds.stability is None else bounds.stability.margin
        words = (
            "Not every consistent plant is proved to be stabilised by the controller, and none was found that is not."
        )
        size = (("margin (1 is needed)", at_least(margin, 3)),)
        return Verdict("weak", "Undecided", words, size, id="loop-verdict")
    words = f"The controller{' that ran' * ran} stabilises every consistent plant"
    words += "." if bounds.unbounded else f"; the sensitivity is at most {at_most(peak.value)} with any of them."
    if bounds.unbounded:
        words += f" Of the maps of the loop {bounds.unbounded}."
    key = "weak" if bounds.band.problem.open_faults else "consistent"
    return Verdict(key, "Stable with every consistent plant", words, numbers, id="loop-verdict")


def peaks_table(bounds: LoopBounds) -> Table:
    """Peaks of the maps of the loop on the whole axis."""
    known, units_of, lowest = bounds.peaks, map_units(bounds), bounds.omega[bounds.omega > 0].min()
    rows = [
        [
            words,
            f"{at_most(known[name].value)} {units_of[name].strip(' []')}".rstrip(),
            number(known[name].omega / HZ if known[name].omega > _ZERO * lowest else 0.0, 5),
        ]
        for name, words in _names(bounds).items()
        if np.isfinite(known[name].value)
    ]
    heads = Column("map of the loop"), *of_numbers("largest with any plant", "near [Hz]")
    return Table(heads, rows, empty=f"No peak is bounded: {bounds.unbounded}.")


def _names(bounds: LoopBounds) -> dict[str, str]:
    nu, ny = bounds.loop.shape
    return _AT_INPUTS if nu < ny else _NAMES


def map_units(bounds: LoopBounds) -> dict[str, str]:
    """Units of the maps of the loop, in brackets after a space."""
    outputs, inputs = bounds.band.problem.outputs, bounds.band.problem.inputs
    plant, controller = matrix_unit_label(outputs, inputs), matrix_unit_label(inputs, outputs)
    return {**dict.fromkeys(_NAMES, ""), "process_sensitivity": plant, "control_sensitivity": controller}


def loop_rows(bounds: LoopBounds) -> list[tuple[str, str]]:
    """Facts on the margins, the zone and what is assumed."""
    ran = f", and that {'this controller' if bounds.stability is None else 'the controller stated'} ran: u = {bounds.loop.law}."
    what = "The class of the plant and the bounds of its samples." if bounds.in_open_loop else None
    assumed = ("Assumed", what or f"The class of R, the bounds of its samples{ran}")
    margins = bounds.margins
    low, high = margins.gain
    if bounds.unbounded:
        return [("Margins", f"None: {bounds.unbounded}."), assumed]
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
        assumed,
    ]


def single_loops(bounds: LoopBounds) -> list[Block]:
    """Margins at one output or input of the plant at a time, of a matrix whose controller is proved."""
    if bounds.loop.shape == (1, 1) or not bounds.guaranteed or bounds.unbounded:
        return []
    found, problem = margins_by_loop(bounds), bounds.band.problem
    rows = [
        [
            signal.name,
            f"{at_most(one.gain[0])} to {at_least(one.gain[1])}",
            at_least(float(np.degrees(one.phase))),
            at_least(one.delay),
            at_least(one.modulus),
        ]
        for signals, margins in zip((problem.outputs, problem.inputs), found, strict=True)
        for signal, one in zip(signals, margins, strict=True)
    ]
    heads = Column("opened at"), Column("gain"), *of_numbers("phase [°]", "delay [s]", "modulus")
    words = "A change in one loop alone, the others as they are; those above hold for changes in all of them at once."
    return [Text(words, "soft"), Table(heads, rows)]


def refuting_plant(bounds: LoopBounds) -> list[Block]:
    """Blocks on the plant that refutes a controller; none of one that is not refuted."""
    if (found := bounds.refuted_by) is None:
        return []
    return [
        Heading("The plant that is not stabilised", 3),
        Facts(
            [
                ("Order", f"{found.plant.nstates}"),
                ("Data", f"Every sample is within {at_most(found.margin)} of its bound."),
                ("Closed loop", f"A {describe_poles(found.unstable_poles, found.plant.dt)}."),
            ]
        ),
    ]


def candidates_table(candidates: Mapping[str, LoopBounds]) -> Table:
    """Controllers that were tried: verdict, worst cases and margins of each."""
    rows: list[list[str]] = []
    for name, one in candidates.items():
        word, margins = loop_verdict(one).word.split()[0], one.margins
        if one.unbounded:
            rows.append([name, word, *["–"] * 4])
            continue
        low, high = margins.gain
        peak, phase = one.peaks["sensitivity"].value, float(np.degrees(margins.phase))
        rows.append(
            [name, word, at_most(peak, 3), f"{at_most(low, 3)} to {at_least(high, 3)}", at_least(phase, 3), one.zone]
        )
    heads = Column("controller"), Column("verdict")
    return Table([*heads, *of_numbers("peak of S", "gain margin", "phase margin [°]"), Column("zone")], rows)


def candidates_section(candidates: Mapping[str, LoopBounds] | None, level: int = 3) -> list[Block]:
    """Build the part on the controllers that were tried, under a heading of a level; nothing where there are none."""
    if not candidates:
        return []
    refused = [
        Text(f"{name}: {loop_verdict(one).sentence}") for name, one in candidates.items() if one.refuted_by is not None
    ]
    return [Heading("Controllers that were tried", level), candidates_table(candidates), *refused]


@functools.lru_cache(maxsize=1)  # the first screen of a page shows its first panel
def loop_chart(bounds: LoopBounds, plant: PlantReduction | None = None) -> Chart:
    """Magnitudes of the plant with the range of all consistent ones, and the largest S and T."""
    low, high = bounds.band.range
    low = max(low, float(bounds.omega[bounds.omega > 0].min()) / 3)
    high = min(high, 3 * float(bounds.omega.max()))
    omega = np.geomspace(low, high, _POINTS)
    x, axis = omega / HZ, frequency_axis(omega)
    (centre, radius), maps = bounds.all_at(omega)
    size = np.linalg.norm(centre, 2, axis=(1, 2))
    about = size if plant is None else np.linalg.norm(bounds.loop.response_of(plant.model, omega), 2, axis=(1, 2))
    floor, top = 0.2 * float(about.min()), 5.0 * float(about.max())
    ends = np.clip(size - radius, floor, top), np.clip(size + radius, floor, top)
    area = Layer("range of every consistent plant", x, np.clip(size, *ends), BAND, low=ends[0], high=ends[1], fill=True)
    line = Layer("centre" if plant is None else f"model, order {plant.order}", x, about, NOMINAL, dash="solid")
    curves = [
        Layer(name, x, _drawn(*maps[of]), colour, dash=dash)
        for name, of, colour, dash in (
            ("S", "sensitivity", ALERT, "solid"),
            ("T", "complementary_sensitivity", FURTHER[0], "dash"),
        )
    ]
    drawn = np.concatenate([one.y for one in curves])
    known = drawn[np.isfinite(drawn) & (drawn > 0)]
    span = (max(1e-3 * known.max(), known.min() / 1.5), 1.5 * known.max()) if known.size else None
    panels = [Panel("Plant", axis, Axis(_plant_label(bounds), log=True, range=(floor, top)), (area, line))]
    if bounds.refuted_by is None:
        largest = Axis("largest |S|, |T| [–]", log=True, range=span)
        panels.append(Panel("Loop: largest for every consistent plant", axis, largest, curves))
    return Chart("loop", panels, linked=True)


def _plant_label(bounds: LoopBounds) -> str:
    """Label of the magnitude of the plant."""
    return transfer(bounds.band) if siso(bounds.band) else f"σmax of the plant{sigma_unit(bounds.band)}"


def _drawn(centre: np.ndarray, radius: np.ndarray) -> np.ndarray:
    """Largest values; nan where nothing is bounded."""
    size = np.linalg.norm(centre, 2, axis=(1, 2)) + radius
    return np.where(np.isfinite(size), size, np.nan)

"""A designed controller: its page, the verdict first, what limits it, its loop with every consistent plant, and what it is."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, cast

import numpy as np

from robustid.controllers import ControllerDesign, DesignStatus, Improvement, Limits, integral_gain
from robustid.core import Complex, StateMatrices, response_at
from robustid.identification import as_system
from robustid.report.charts import Chart, first_panel
from robustid.report.data_faults import shown_faults
from robustid.report.design_charts import MAPS, asked_of, design_chart, nyquist_charts, open_loop_bode
from robustid.report.design_improvements import as_improvements, improvements_section, where_to_measure
from robustid.report.design_steps import steps_section
from robustid.report.design_structure import SINGLE, loop_size, structure_rows
from robustid.report.document import (
    Block,
    Code,
    Column,
    Document,
    Drawing,
    Facts,
    Glance,
    Grid,
    Heading,
    Share,
    Table,
    Text,
    Verdict,
    checked_by_another,
    of_numbers,
    proved,
    unfinished_notice,
)
from robustid.report.identified import Parts
from robustid.report.loop_page import NOT_IN_LOOP, loop_stands_on
from robustid.report.loop_section import loop_numbers, loop_rows, peaks_table, single_loops
from robustid.report.poles import pole_cells, pole_rows
from robustid.report.small_model import model_chart, model_charts
from robustid.report.words import HZ, at_most, in_hz, in_hz_span, number, percent, unit_label
from robustid.report.words import title as heading

if TYPE_CHECKING:
    import control

_ROUNDING = 1e-13  # relative: of a sum of a few terms
_KEPT = "\u00a0"  # a space that no line ends with
_KEYS = {
    DesignStatus.PROVED: ("consistent", "Proved"),
    DesignStatus.FOUND: ("weak", "Not proved"),
    DesignStatus.NONE: ("inconsistent", "None found"),
    DesignStatus.UNFINISHED: ("weak", "Unfinished"),
}


def design_page(design: ControllerDesign, title: str | None, parts: Parts) -> Document:
    """Build the page of a designed controller."""
    improved, head = _improved(parts), design_head(design, title, parts)
    body = design_blocks(design)
    curves = next((block.chart for block in body if isinstance(block, Drawing)), None)
    further = improvements_section(design, improved) if improved else []
    return dataclasses.replace(
        head,
        body=[*body, *further, Heading("In plain text"), Code(design.summary())],
        glance=dataclasses.replace(head.glance, chart=None if curves is None else first_panel(curves)),
    )


def design_head(design: ControllerDesign, title: str | None, parts: Parts) -> Document:
    """Build the first screen of a designed controller, which is soon there, without its plot."""
    improved = _improved(parts)
    if title is None and design.proofs:
        problem = design.proofs[0].band.problem
        title = heading("Controller", problem.inputs, problem.outputs)
    return Document(
        title or "Controller",
        head=[
            *shown_faults([one.band.problem for one in design.proofs]),
            design_verdict(design),
            *checked_by_another(parts.get("independent")),
        ],
        body=[],
        notice=None if design.status is DesignStatus.UNFINISHED else unfinished_notice(design.unfinished),
        glance=Glance(
            numbers=_numbers(design),
            words=_words(design),
            next=[*_next(design), *([Text(where)] if (where := where_to_measure(design, improved)) else [])],
            not_covered=NOT_IN_LOOP if design.status is DesignStatus.PROVED else "",
        ),
    )


def _improved(parts: Parts) -> tuple[Improvement, ...]:
    given = parts.get("sensitivity")
    return () if given is None else as_improvements(given)


def design_section(design: ControllerDesign) -> list[Block]:
    """Build the section on a controller of the page of an identification."""
    parts = [
        dataclasses.replace(one, level=one.level + 1) if isinstance(one, Heading) else one
        for one in design_blocks(design)
    ]
    return [Heading("The controller that was designed", guarantee=True), design_verdict(design), *parts]


def design_blocks(design: ControllerDesign) -> list[Block]:
    """Build the sections on a controller, each under its heading."""
    if not design.proofs:
        asked = asked_words(design.limits, loop_size(design))
        return [Heading("What was asked"), Facts([*asked, *structure_rows(design)])]
    single = design.proofs[0].loop.shape == (1, 1)
    nu, ny = design.proofs[0].loop.shape
    words = (
        "Of each limit the largest share that any consistent plant takes, at any frequency. At 1 it would be reached."
    )
    return [
        Heading("Limits", guarantee=True),
        Text(f"{words} S, T and the bandwidth are those at the inputs, which are fewer." if nu < ny else words),
        shares_table(design),
        *expensive_members(design),
        Drawing(design_chart(design)),
        *(_open_loop(design) if single else []),
        Heading("The controller"),
        *_controller(design, single),
        *steps_section(design),
        Heading("Peaks and margins", guarantee=True),
        *_margins(design),
        Heading("What it stands on"),
        Facts(_stands_on(design)),
        proved(
            all(one.band.certified for one in design.proofs),
            "The sums of the bands were evaluated again for this page, without a solver.",
            "The proofs do not give what is stated.",
            "design-certificates",
        ),
    ]


def expensive_members(design: ControllerDesign) -> list[Block]:
    """Members whose plants take most of a limit, where the controller is for several."""
    if not design.limiting_bands:
        return []
    dear = [f"{k + 1} ({name}, {percent(share, 3)})" for k, name, share in design.limiting_bands[:3]]
    words = f"Most of a limit is taken by the plants of the members {', '.join(dear)} of {len(design.by_band)}, by their numbers in"
    return [Text(f"{words} the order in which they were given.")]


def design_verdict(design: ControllerDesign) -> Verdict:
    """Verdict on a design, in one sentence."""
    key, word = _KEYS[design.status]
    if design.status is DesignStatus.UNFINISHED:
        words = "The time was over before a controller was found that keeps the limits."
        return Verdict(key, word, words, id="design-verdict")
    if design.status is DesignStatus.NONE:
        law = design.obstacle()
        words = "No controller of this structure was found that keeps the limits with every consistent plant."
        if law is not None:
            words = f"No controller at all keeps these limits: {law.sentence}."
        return Verdict(key, word, words, id="design-verdict")
    if not design.proofs:
        words = "It was found at frequencies; the time was over before it could be proved."
        return Verdict(key, word, words, id="design-verdict")
    reached = f"{design.goal.name} {design.goal.told(design.level)}"
    if design.status is DesignStatus.PROVED:
        key = "weak" if any(one.band.problem.open_faults for one in design.proofs) else key
        words = f"Every consistent plant keeps all limits with this controller, at every frequency{design.scope}: {reached}."
        return Verdict(key, word, words, id="design-verdict")
    if not all(one.guaranteed for one in design.proofs):
        words = "It was found at frequencies; that it stabilises every consistent plant is not proved."
    else:
        over = [name for name, (share, _) in design.shares.items() if share > 1]
        words = f"It was found at frequencies; with some plant it may exceed the limit{'s' * (len(over) > 1)}: {', '.join(over)}."
    return Verdict(key, word, words, id="design-verdict")


def _numbers(design: ControllerDesign) -> list[tuple[str, str]]:
    """Numbers of the first screen."""
    if design.controller is None or not design.proofs:
        return []
    if design.status is DesignStatus.NONE:
        return (
            [("closest, limited by", f"{limit[0]}{_near(limit[1])}")]
            if (limit := design.limited_by) is not None
            else []
        )
    found = [(design.goal.name, design.goal.told(design.level)), ("order", str(design.controller.nstates))]
    if (limit := design.limited_by) is not None:
        found.append(("limited by", f"{limit[0]}{_near(limit[1])}"))
    return [*found, *(loop_numbers(design.proofs[0]) if len(design.proofs) == 1 else [])]


def _near(omega: float) -> str:
    return "" if math.isnan(omega) else f", near {in_hz(omega / HZ, 4)}"


def _words(design: ControllerDesign) -> str:
    if design.status is DesignStatus.NONE and design.proofs:
        return "What follows is of the closest controller, which exceeds its limits by the least factor."
    if design.status is DesignStatus.NONE:
        return "That none was found is a search, and no proof that there is none."
    if (limit := design.limited_by) is None:
        return ""
    share = design.shares[limit[0]][0]
    taken = f"some consistent plant takes {at_most(100 * share, 4)} % of it"
    return f"What limits it is the {limit[0]}{_near(limit[1])}: {taken}."


def _next(design: ControllerDesign) -> list[Text]:
    if design.status is DesignStatus.UNFINISHED or not (design.proofs or design.controller is None):
        return [Text("Give it more time: time_limit, or --time-limit.")]
    if design.status is DesignStatus.NONE:
        return [
            Text("Ask for less, or give the structure more: a derivative, a lead, a notch where the plant has a mode.")
        ]
    if design.status is DesignStatus.FOUND:
        return [Text("Ask for limits that are a few percent wider, or measure better where they are exceeded.")]
    steps = [
        Text(
            "Before it runs: limits of the actuator are in none of these proofs, a delay of the computer only if the data have it."
        )
    ]
    if design.proofs[0].loop.dt:
        code = 'rid.save("controller.c", design)'
        steps.append(Text(f"For the machine: {code}", code=(code,)))
    return steps


def shares_table(design: ControllerDesign) -> Table:
    """Limits with what was asked, the share that is taken, and where."""
    asked = asked_in_lines(asked_of(design), loop_size(design))
    rows = [
        [name, asked.get(name, ""), Share(at_most(share, 3), min(share, 1.0)), number(omega / HZ, 4)]
        for name, (share, omega) in design.asked_shares.items()
    ]
    columns = Column("limit"), Column("asked"), Column("share that is taken", "share"), *of_numbers("near [Hz]")
    return Table(columns, rows, marks=[share <= 1 for share, _ in design.asked_shares.values()])


def asked_in_lines(limits: Limits, loop: str = SINGLE) -> dict[str, str]:
    """Limits by their names, in words that narrow columns break after commas alone."""
    return {
        name: ", ".join(part.replace(" ", _KEPT) for part in words.split(", "))
        for name, words in asked_words(limits, loop)
    }


def asked_words(limits: Limits, loop: str = SINGLE) -> Iterator[tuple[str, str]]:
    """Limits by their names, in words, with those of `loop_size`."""
    signs = {
        "sensitivity_peak": "|S| ≤ {}",
        "complementary_peak": "|T| ≤ {}",
        "control_peak": "|C S| ≤ {}",
        "process_peak": "|P S| ≤ {}",
        "gain_margin": "at least {}",
        "integral_gain": "at least {}",
        "delay_margin": "at least {} s",
    }
    for name, sign in signs.items():
        if (value := getattr(limits, name)) is not None:
            yield name.replace("_", " "), sign.format(number(value))
    if limits.phase_margin is not None:
        yield "phase margin", f"at least {number(math.degrees(limits.phase_margin))}°"
    for template in dict.fromkeys(template for template, *_ in limits.rows):
        letters, sign = MAPS[template.map][0], "≥" if template.least else "≤"
        yield (
            template.name,
            "; ".join(
                f"|{letters}| {sign} {number(value)}, {in_hz_span(low / HZ, high / HZ, 3)}"
                for one, low, high, value in limits.rows
                if one is template
            ),
        )
    if limits.bandwidth is not None:
        yield "bandwidth", f"{loop} ≥ 1 up to {in_hz(limits.bandwidth / HZ, 4)}"


def _open_loop(design: ControllerDesign) -> list[Block]:
    charts = nyquist_charts(design)
    words = "Each outline holds the open loops of all consistent plants at a frequency; limits keep them out of what is dashed."
    return [
        Heading("Open loop", guarantee=True),
        Drawing(open_loop_bode(design)),
        *([Text(words, "soft")] if charts and design.status is DesignStatus.PROVED else []),
        *(Drawing(one, beside=True) for one in charts),
    ]


def _controller(design: ControllerDesign, single: bool) -> list[Block]:
    if design.controller is None:
        return []
    found: list[Block] = [Facts([*structure_rows(design), *(_gain_rows if single else _least_gain_rows)(design)])]
    if single:
        found.append(_roots_table(design))
        # with its signals in the label of the magnitude, from the output of the plant to the input
        chart = model_chart(design.controller, "controller")
        problem, (size, phase) = design.proofs[0].band.problem, chart.panels
        axis = dataclasses.replace(size.y, label=f"{problem.inputs[0]} / {problem.outputs[0]}")
        return [*found, Drawing(dataclasses.replace(chart, panels=(dataclasses.replace(size, y=axis), phase)))]
    return [*found, Grid(list(_entries(design, design.controller)), design.controller.ninputs)]


def _entries(design: ControllerDesign, controller: control.StateSpace) -> Iterator[Chart]:
    """Charts of the entries of a matrix that are not zero."""
    problem = design.proofs[0].band.problem
    inputs, outputs = problem.inputs, problem.outputs
    charts = model_charts(controller, "controller")
    for (i, j), chart in zip(np.ndindex(controller.noutputs, controller.ninputs), charts, strict=True):
        if np.nanmax(chart.panels[0].layers[0].y) > 0:
            first, y, u = chart.panels[0], outputs[int(j)], inputs[int(i)]
            size = dataclasses.replace(first.y, label=f"size{unit_label(u.unit, y.unit)}")
            first = dataclasses.replace(first, title=f"From {y.name} to {u.name}", y=size)
            yield dataclasses.replace(chart, name=f"controller-{i}-{j}", panels=(first, *chart.panels[1:]))


def _gain_rows(design: ControllerDesign) -> list[tuple[str, str]]:
    """Gains of a controller of one input and one output."""
    system, dt = as_system("controller", design.controller)[0], design.proofs[0].loop.dt
    integral = integral_gain(system, dt)
    size = "∞, it has an integrator" if integral else number(_at(system, 1.0 if dt else 0.0))
    end = f"{number(_at(system, -1.0))}, at {in_hz(0.5 / dt, 4)}" if dt else number(float(system.D[0, 0]))
    rows = [("Gain at frequency 0", size), ("Gain at the end of the axis", end)]
    return [*rows, *([("Gain of the integrator", f"{number(integral, 5)} 1/s")] if integral else [])]


def _least_gain_rows(design: ControllerDesign) -> list[tuple[str, str]]:
    """Least gain of the integrators of a matrix; of one input, or one output, that of its integrator."""
    gain = integral_gain(as_system("controller", design.controller)[0], design.proofs[0].loop.dt)
    if not gain:
        return []
    if 1 in design.proofs[0].loop.shape:
        return [("Gain of the integrator", f"{number(gain, 5)} 1/s, in size")]
    return [("Least gain of the integrators", f"{number(gain, 5)} 1/s, their smallest singular value")]


def _at(system: StateMatrices, point: float) -> float:
    """Value at a real point; 0 where rounding of the terms C_i x_i and D that it is the sum of is as large."""
    A, B, C, D = system
    value = float(response_at(system, [point])[0, 0, 0].real)
    states = response_at((A, B, np.eye(len(A)), np.zeros(B.shape)), [point])[0, :, 0]
    terms = np.abs(C[0]) @ np.abs(states) + abs(D[0, 0])
    return 0.0 if abs(value) <= _ROUNDING * terms else value


def _roots_table(design: ControllerDesign) -> Table:
    """Zeros and poles of a controller of one input and one output."""
    dt = design.proofs[0].loop.dt
    found = _zeros_and_poles(as_system("controller", design.controller)[0])
    rows = [
        [name, *pole_cells(row)]
        for name, roots in (("zero", found[0]), ("pole", found[1]))
        for row in pole_rows(roots, dt)
    ]
    heads = Column("zero or pole"), *of_numbers("f [Hz]", "damping", "|z|", "τ [s]", "number")
    return Table(heads, rows, empty="No zeros and no poles: a gain.")


def _zeros_and_poles(system: StateMatrices) -> tuple[Complex, Complex]:
    import scipy.signal

    A, B, C, D = system
    found = cast("tuple[Complex, Complex, float]", scipy.signal.ss2zpk(A, B, C, D))
    return np.asarray(found[0], dtype=complex), np.asarray(found[1], dtype=complex)


def _margins(design: ControllerDesign) -> list[Block]:
    found: list[Block] = []
    for k, one in enumerate(design.proofs, start=1):
        found += [Heading(f"Band {k}", 3)] if len(design.proofs) > 1 else []
        found += [peaks_table(one), Facts([row for row in loop_rows(one) if row[0] != "Assumed"]), *single_loops(one)]
    return found


def _stands_on(design: ControllerDesign) -> list[tuple[str, str]]:
    """Measurements, and what is assumed."""
    several = len(design.proofs) > 1
    rows = [(f"Band {k}" if several else "Band", loop_stands_on(one)) for k, one in enumerate(design.proofs, start=1)]
    dt = design.proofs[0].loop.dt
    runs = (
        f"It runs as it stands here, every {number(dt, 6)} s" if dt else "It runs as it stands here, in continuous time"
    )
    return [
        *rows,
        ("Class", "Every plant is of the class of its band, and every sample within its bound."),
        ("Controller", f"{runs}, u = −C y beside what the operator adds; nothing saturates."),
    ]

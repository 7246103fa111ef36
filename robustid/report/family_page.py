"""A family of plants: its page, its band beside the bounds of the members, and how these move with the condition."""

from __future__ import annotations

import dataclasses
from functools import partial

import numpy as np

from robustid.core import Complex, Real, counted
from robustid.errors import InputError
from robustid.guarantees import Coverage, Family, WorstCaseOverPoles
from robustid.report.charts import (
    ALERT,
    DASHES,
    DATA,
    FAINT,
    FURTHER,
    MARKERS,
    NOMINAL,
    Axis,
    Chart,
    Layer,
    Panel,
    first_panel,
    frequency_axis,
    side_by_side,
)
from robustid.report.curves import magnitude_range, spread
from robustid.report.data_faults import problem_verdict, steps_with_faults
from robustid.report.design_page import design_section
from robustid.report.document import (
    Block,
    Column,
    Document,
    Drawing,
    Facts,
    Glance,
    Grid,
    Heading,
    Table,
    Text,
    Verdict,
    certificates,
    unfinished_notice,
)
from robustid.report.identification_page import findings_section, run_file_section
from robustid.report.identified import Bounded, Parts, transfer
from robustid.report.withheld_data import not_guaranteed, withheld_section, withheld_verdict
from robustid.report.words import HZ, at_frequencies, at_hz, at_most, in_hz, number
from robustid.report.words import title as heading

_CURVE = 800  # frequencies of the curve of the nominal
_SHOWN = 4  # frequencies at which the band is shown over the condition


def family_page(family: Family, title: str | None, parts: Parts) -> Document:
    """Build the page of a family."""
    withheld = parts.get("withheld")
    problem = family.members[0].identification.problem
    charts = family_charts(family)
    drawn: list[Block] = [Drawing(charts[0])] if len(charts) == 1 else [Grid(charts, len(problem.inputs))]
    count = sum(error.claim_count for error in family.errors)
    moving: list[Block] = []
    if family.schedule is not None:
        moving = [
            Heading(f"How band and poles move with the {family.schedule}"),
            Text("Between the members, and beyond them, lines are drawn for the eye alone."),
            Drawing(schedule_chart(family)),
        ]
    return Document(
        title or heading("Family", problem.outputs, problem.inputs),
        head=[*_fault_verdict(family), *_verdicts(family, withheld), *_fault_warnings(family)],
        notice=unfinished_notice(parts.get("unfinished") or family.unfinished),
        body=not_guaranteed(
            [
                *findings_section(parts.get("findings", ())),
                Heading("Members"),
                member_table(family),
                *(Text(sentence) for sentence in family.matched),
                Heading("What is guaranteed", guarantee=True),
                Text(guarantee_words(family), id="guarantee-sentence"),
                certificates(count, family.certified, "certificates"),
                Facts(_facts(family)),
                Heading("Who drives the band where", 3),
                driver_table(family),
                Heading("Response with the band of the family", 3),
                Text("Proved at the marked frequencies; between them the band is interpolated for the eye.", "soft"),
                *drawn,
                *moving,
                Heading("What is not known"),
                *(Text(sentence) for sentence in family.not_known),
                *_controller(family, parts),
                *withheld_section(withheld),
                *run_file_section(parts.get("run_file")),
            ],
            withheld,
        ),
        glance=_glance(family, charts[0], parts),
    )


def _controller(family: Family, parts: Parts) -> list[Block]:
    """The section on the controller for all members, and which band is of which."""
    if (design := parts.get("design")) is None:
        return []
    heading, verdict, *found = design_section(design)
    bands = "; ".join(f"band {k} is that of {m.name}" for k, m in enumerate(family.members, start=1))
    return [heading, verdict, *([Text(f"{bands[:1].upper()}{bands[1:]}.")] if design.proofs else []), *found]


def _fault_verdict(family: Family) -> list[Verdict]:
    """The verdict on the data of the first member that have a fault which nothing has undone, with its name."""
    for m in family.members:
        for said in problem_verdict(m.identification.problem):
            return [dataclasses.replace(said, numbers=(("member", m.name), *said.numbers))]
    return []


def _fault_warnings(family: Family) -> list[Text]:
    """Warnings of the further faults, each with the name of its member."""
    faults = [(m.name, fault) for m in family.members for fault in m.identification.problem.data_faults]
    first = next((k for k, (_, fault) in enumerate(faults) if not fault.undone), None)
    return [
        Text(f"{fault.heading} of {name}: {fault}.", "warning") for k, (name, fault) in enumerate(faults) if k != first
    ]


def _glance(family: Family, entry: Chart, parts: Parts) -> Glance:
    """The first screen: order, band in words, the first entry, what to do next."""
    withheld = parts.get("withheld")
    contradicted = withheld is not None and withheld.contradicted
    worst = max(family.drivers(), key=lambda row: row.upper)
    reach = f"between {number(worst.low / HZ, 5)} and {in_hz(worst.high / HZ)}"
    if worst.low == worst.high:
        reach = f"at {in_hz(worst.low / HZ)}"
    numbers = [
        ("members", f"{len(family.members)}"),
        ("model order", f"{family.model.nstates}"),
        *([] if contradicted else [(f"guaranteed error{family.scope}", f"≤ {at_most(family.sigma_upper.max(), 3)}")]),
    ]
    steps = [
        f"The error is largest {reach}, where {worst.member} drives the band: more data of this member narrow it first."
    ]
    if contradicted:
        steps = ["Take the withheld data into the family as a further member: see “Withheld data”."]
    return Glance(
        numbers=numbers,
        words="" if contradicted else guarantee_words(family),
        chart=first_panel(entry),
        next=steps_with_faults(
            [one for m in family.members for one in m.identification.problem.placed_faults],
            parts.get("undoing"),
            [Text(step) for step in steps],
        ),
    )


def _verdicts(family: Family, withheld: Coverage | None) -> list[Verdict]:
    """Verdict of the family and that of withheld data, which comes first where it contradicts the band."""
    if withheld is None:
        return [family_verdict(family)]
    both = [family_verdict(family), withheld_verdict(withheld)]
    return both[::-1] if withheld.contradicted else both


def family_verdict(family: Family) -> Verdict:
    """Verdict: every member consistent with the one class."""
    worst = max(m.identification.margin for m in family.members)
    sentence = (
        f"The data of each of {len(family.members)} members are consistent with one class; the band holds every system that is"
        " consistent with any of them."
    )
    faulty = any(m.identification.problem.open_faults for m in family.members)
    return Verdict(
        "weak" if faulty else "consistent",
        f"One class{family.scope}",
        sentence,
        (("largest margin", number(worst)), ("order", f"{family.model.nstates}")),
    )


def guarantee_words(family: Family) -> str:
    """The guarantee in plain words."""
    about = sorted({words for m in family.members for words in m.identification.problem.about})
    if any(m.identification.problem.open_faults for m in family.members):
        about.append("The data of a member have a fault that nothing has undone.")
    return " ".join(
        [
            *about,
            f"Every system of the class that is consistent with the data of a member is within {at_most(family.sigma_upper.max())}"
            f" of the nominal {at_frequencies(family.omega)}, the median is {family.relative.words}.",
        ]
    )


def _facts(family: Family) -> list[tuple[str, str]]:
    ratio = float((family.upper / family.centres.radius).max())
    rows = [
        (
            "Nominal",
            f"Order {family.model.nstates}, fitted to the centres of the smallest discs that hold the values of all members; its"
            f" band is at most {number(ratio, 3)} times their radius, below which no nominal gets.",
        )
    ]
    circles = [getattr(error, "known_circle", None) for error in family.errors]
    if all(circle is not None for circle in circles):
        rows.append(("Whole circle", f"Within {at_most(family.hinf)} of the nominal at all frequencies."))
    return rows


def member_table(family: Family) -> Table:
    """Members with their conditions, margins and bounds."""
    rows: list[tuple[str, ...]] = []
    for m, error in zip(family.members, family.errors, strict=True):
        said = ", ".join(f"{what} {number(v) if isinstance(v, float) else v}" for what, v in m.condition.items())
        poles = "in their box" if isinstance(error, WorstCaseOverPoles) else "fixed"
        samples = m.identification.problem.samples
        rows.append(
            (m.name, said or "–", f"{samples}", poles, number(m.identification.margin), at_most(error.upper.max()))
        )
    heads = [Column("member"), Column("condition"), Column("samples", "n"), Column("poles")]
    return Table([*heads, Column("margin", "n"), Column("largest error", "n")], rows)


def driver_table(family: Family) -> Table:
    """Ranges of frequencies with the member whose bound is largest there."""
    rows = [
        (number(row.low / HZ, 5), number(row.high / HZ, 5), row.member, at_most(row.upper), at_most(row.second))
        for row in family.drivers()
    ]
    heads = Column("from [Hz]", "n"), Column("to [Hz]", "n"), Column("driven by")
    return Table([*heads, Column("error at most", "n"), Column("the others", "n")], rows)


def family_chart(family: Family) -> Chart:
    """All entries in one chart."""
    charts = family_charts(family)
    if len(charts) == 1:
        return charts[0]
    return side_by_side("family", charts, family.members[0].identification.problem.entries.inputs)


def family_charts(family: Family) -> list[Chart]:
    """Charts of every entry: the magnitude of the nominal with the band, the ranges of the members, and the errors of these."""
    at = family.omega[family.omega > 0]
    low, high = (at[0], at[-1]) if at.size > 1 else (at[0] / 2, min(2 * at[0], family.plane.top))
    fine = np.unique(np.concatenate([*(spread(low, high, _CURVE // 2, log) for log in (True, False)), at]))
    curve: Real = np.abs(family.plane.values_at(family.model, fine))
    return [_entry_chart(family, entry, fine, curve[:, *entry]) for entry in np.ndindex(family.upper.shape[1:])]


def _entry_chart(family: Family, entry: tuple[int, int], fine: np.ndarray, curve: np.ndarray) -> Chart:
    proved, place = family.omega > 0, (slice(None), *entry)
    hz, upper = family.omega[proved] / HZ, family.upper[place][proved]
    reach = np.interp(np.log(fine / HZ), np.log(hz), upper)
    span = magnitude_range(float((curve + reach).max()), [float(np.quantile(curve, 0.02))])
    band = Layer(
        f"band of the family ({counted(hz.size, 'frequency')})",
        fine / HZ,
        np.maximum(curve, span[0]),
        FURTHER[3],
        low=np.maximum(curve - reach, span[0]),
        high=curve + reach,
        fill=True,
    )
    sizes = [band, Layer("nominal", fine / HZ, curve, NOMINAL, dash="solid")]
    errors: list[Layer] = []
    for k, (member, error) in enumerate(zip(family.members, family.errors, strict=True)):
        ends = np.reshape(error.magnitude, (*family.upper.shape, 2))[place][proved]
        drawn = partial(Layer, colour=FURTHER[k % 3], marker=MARKERS[k % len(MARKERS)])
        middle = np.maximum(ends.mean(axis=1), span[0])
        low, high = np.maximum(ends[:, 0], span[0]), ends[:, 1]
        sizes.append(drawn(member.name, hz, middle, size=0.5, low=low, high=high))
        own = error.upper[place][proved]
        said = at_hz(hz, "at most {}", own)
        errors.append(drawn(f"{member.name}: error", hz, own, dash=DASHES[k % len(DASHES)], hover=said))
    radius = family.centres.radius[place][proved]
    errors.append(Layer("smallest disc that holds all", hz, radius, FAINT, dash="solid"))
    x = frequency_axis(family.omega[proved])
    label = transfer(family.members[0].identification, *entry)
    panels = (
        Panel("Magnitude", x, Axis(label, log=True, range=span), sizes),
        Panel("Error of the nominal, member by member", x, Axis("guaranteed error", log=True), errors),
    )
    return Chart(f"family-{entry[0]}-{entry[1]}", panels, linked=True, grid=family.upper[0].size > 1)


def schedule_chart(family: Family) -> Chart:
    """Band, natural frequencies and damping of the members over the condition that is told apart."""
    if family.schedule is None:
        raise InputError(
            "`result` is a family without a schedule: give every member a number for amplitude, position or load"
        )
    values = np.array(family.values)
    order = np.argsort(values)
    low, high = family.interval or (values.min(), values.max())
    margin = 0.05 * max(high - low, np.ptp(values), 1e-12)
    x = Axis(family.schedule, range=(min(low, values.min()) - margin, max(high, values.max()) + margin))
    worst = np.argsort(-family.sigma_upper)
    bands: list[Layer] = []
    places = np.sort(worst[:_SHOWN])
    for k, place in enumerate(places):
        ends = np.array([_range_of(e, int(place), family) for e in family.errors])[order]
        colour, marker = (DATA, NOMINAL, ALERT, FURTHER[0])[k % 4], MARKERS[k % 3]
        name = in_hz(float(family.omega[place]) / HZ)
        middle, bottom, top = ends.mean(axis=1), ends[:, 0], ends[:, 1]
        bands.append(Layer(name, values[order], middle, colour, dash="dot", marker=marker, low=bottom, high=top))
    panels = [Panel("Range of the magnitude where the band is widest", x, Axis("magnitude", log=True), bands)]
    poles = paired_modes([_poles_of(family.errors[int(k)]) for k in order])
    if poles:
        for part, label in enumerate(("change of the natural frequency [%]", "damping ratio [–]")):
            layers: list[Layer] = []
            for mode, found in enumerate(poles):
                known = np.isfinite(found[:, part, 0])
                first = found[known, 0, 0][
                    0
                ]  # in Hz; shifts are too small to be seen beside the frequencies themselves
                shown = found[known, part] if part else 100 * (found[known, 0] / first - 1)
                middle, bottom, top = shown.T
                colour, marker = (NOMINAL, ALERT, *FURTHER)[mode % 6], MARKERS[mode % 3]
                name, at = f"mode {mode + 1}, {in_hz(first, 4)}", values[order][known]
                layers.append(Layer(name, at, middle, colour, dash="dot", marker=marker, low=bottom, high=top))
            title = ("Natural frequency, from that of the first member", "Damping ratio")[part]
            panels.append(Panel(title, x, Axis(label), layers))
    return Chart("schedule", panels, columns=1)


def _range_of(error: Bounded, place: int, family: Family) -> np.ndarray:
    """Range of the magnitude at a frequency, of the entry with the largest bound."""
    ends = np.reshape(error.magnitude, (*family.upper.shape, 2))[place]
    entry = np.unravel_index(np.argmax(family.upper[place]), family.upper.shape[1:])
    return ends[entry]


def _poles_of(error: Bounded) -> np.ndarray:
    """(modes, 2, 3): natural frequency in Hz and damping, each as it is and with the ends of its box."""
    if isinstance(error, WorstCaseOverPoles):
        omega, damping = error.poles
        ends = np.stack([omega / HZ, damping], axis=1)
        return np.concatenate([ends.mean(axis=2, keepdims=True), ends], axis=2)
    basis = error.identification.problem.parametric
    found: Complex = np.zeros(0, complex) if basis is None else np.asarray(basis.poles, complex)
    found = np.unique(np.round(found[(found.imag > 0) & (np.abs(found) > 0)], 12)).astype(complex)
    logs: Complex = error.identification.problem.plane.exponents(found)
    each = np.stack([np.abs(logs) / HZ, -logs.real / np.abs(logs)], axis=1)
    return np.repeat(each[np.argsort(each[:, 0])][:, :, None], 3, axis=2)


def paired_modes(poles: list[np.ndarray]) -> list[np.ndarray]:
    """Modes of all members, (members, 2, 3) each: those that are each other's nearest from member to member; NaN where one ends."""
    chains: list[dict[int, int]] = []  # from the number of the member to that of its mode
    for k, found in enumerate(poles):
        before = poles[k - 1][:, 0, 0] if k else np.zeros(0)
        away = np.abs(found[:, 0, 0][:, None] - before)
        for mode in range(len(found)):
            nearest = int(np.argmin(away[mode])) if before.size else -1
            mutual = nearest >= 0 and int(np.argmin(away[:, nearest])) == mode
            chain = next((c for c in chains if mutual and c.get(k - 1) == nearest), None)
            if chain is None:
                chains.append({k: mode})
            else:
                chain[k] = mode
    nothing = np.full((2, 3), np.nan)
    made = [np.stack([poles[k][c[k]] if k in c else nothing for k in range(len(poles))]) for c in chains]
    return sorted(made, key=lambda one: float(np.nanmin(one[:, 0, 0])))

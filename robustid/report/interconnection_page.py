"""Two measured things in one loop: the page of the verdict on all pairs, what limits it, and what to measure."""

from __future__ import annotations

import dataclasses

import numpy as np

from robustid.core import counted
from robustid.guarantees import Band, Interconnection, InterconnectionStatus
from robustid.identification import describe_poles
from robustid.report.charts import ALERT, FINE, FURTHER, NOMINAL, Axis, Chart, Layer, Panel, first_panel
from robustid.report.curves import span_of
from robustid.report.document import (
    Block,
    Document,
    Drawing,
    Facts,
    Glance,
    Heading,
    Table,
    Text,
    Verdict,
    of_numbers,
    proved,
)
from robustid.report.identified import Parts
from robustid.report.loci import loci_chart
from robustid.report.words import HZ, at_least, at_most, in_hz, in_hz_span, number, plural

_KEYS = {
    InterconnectionStatus.STABLE: ("consistent", "Stable for every pair"),
    InterconnectionStatus.UNSTABLE: ("inconsistent", "Unstable"),
    InterconnectionStatus.UNDECIDED: ("weak", "Undecided"),
}
_TALL = 1e3  # margins beyond are drawn there
_NEAR = 5e-3  # relative: ranges so near to each other are told as one
_ROWS = 12  # arcs in the table


def interconnection_page(result: Interconnection, title: str | None, parts: Parts) -> Document:
    """Build the page of two things in one loop."""
    region = parts.get("forbidden")
    drawn = loci_chart(result, region)
    first = first_panel(margin_chart(result) if np.isfinite(result.margin) else drawn)
    margin = "infinite" if np.isinf(result.margin) else at_least(result.margin, 3)
    found = [("factor on both errors that is allowed", margin)]
    if np.isfinite(result.margin):
        found += [("least at", in_hz(result.frequency / HZ, 4)), ("limited most by", f"the {result.limited_by}")]
    if result.passive.any():
        found.append(("arcs proved by passivity", f"{int(result.passive.sum())} of {result.passive.size}"))
    return Document(
        title or "Source and load in one loop",
        head=[interconnection_verdict(result)],
        body=[
            *_limit(result),
            *_over_frequency(result),
            Heading("Eigenvalue loci"),
            Text(
                "Eigenvalues of the product of both models at the middle of every arc, with some of the discs whose union holds"
                " those of every pair there. They are wider than what proves the verdict: a disc over -1 refutes nothing.",
                "soft",
            ),
            Drawing(drawn),
            *_region(result, region),
            Heading("What it stands on"),
            Facts(_sides(result)),
            *_proofs(result),
        ],
        glance=Glance(
            found,
            _words(result),
            first,
            [Text(one) for one in _next(result)],
            "parts outside their classes" if result.stable and not _known(result) else "",
        ),
    )


def _over_frequency(result: Interconnection) -> list[Block]:
    """Section on the margin; none of two known systems, of which there is no margin."""
    if np.isinf(result.margin):
        return []
    rows = [
        [number(low / HZ, 5), number(high / HZ, 5), at_least(margin)] for low, high, margin in _ranges(result)[:_ROWS]
    ]
    heads = of_numbers("from [Hz]", "to [Hz]", "least margin")
    return [
        Heading("Margin over frequency", guarantee=True),
        Text(
            "The factor by which the bounds of both sides could grow before the determinant may vanish there, on whole arcs,"
            " between the frequencies too, from 0 to the end of the axis. Above 1 at every frequency all pairs are alike."
        ),
        Drawing(margin_chart(result)),
        Table(heads, rows, title="Not proved", empty="Every arc is proved."),
    ]


def interconnection_verdict(result: Interconnection) -> Verdict:
    """Verdict on all pairs."""
    key, word = _KEYS[result.status]
    sentence = result.status.value.split(": ", 1)[1]
    if result.status is InterconnectionStatus.UNSTABLE and result.pair is None:
        sentence = "every pair of consistent systems makes an unstable loop, proved on the whole axis"
    words = f"{sentence[0].upper()}{sentence[1:]}."
    if result.poles.size and not result.stable:
        whose = "that pair" if result.pair is not None else "the two models"
        words += f" The loop of {whose} has a {describe_poles(result.poles[np.imag(result.poles) >= 0], result.dt)}."
    return Verdict(key, word, words, id="interconnection-verdict")


def _words(result: Interconnection) -> str:
    if _known(result):
        return "Both sides are taken as known without error: this is about these two models alone."
    if result.stable:
        words = "No source and no load that agree with their data and assumptions make an unstable loop"
        return f"{words}, whatever lies between the lines."
    hz, share = _open(result)
    if not hz:
        return ""
    words = f"The determinant is kept from zero for every pair at every frequency but from {hz}"
    return f"{words} ({share} of {result.margins.size} arcs)."


def _known(result: Interconnection) -> bool:
    return not any(hasattr(side, "problem") or hasattr(side, "members") for side in (result.source, result.load))


def _open(result: Interconnection) -> tuple[str, int]:
    """Ranges in which nothing is proved, and the number of their arcs."""
    ranges = _ranges(result)
    words = [in_hz_span(low / HZ, high / HZ, 4) for low, high, _ in ranges[:3]]
    more = f" and {len(ranges) - 3} range{plural(len(ranges) - 3)} more" if len(ranges) > 3 else ""
    return ", ".join(words) + more, int(np.sum(result.margins <= 1))


def _ranges(result: Interconnection) -> list[tuple[float, float, float]]:
    """Runs of arcs that are not proved: their ends, and the least margin."""
    found: list[tuple[float, float, float]] = []
    for k in np.flatnonzero(result.margins <= 1).tolist():
        low, high, margin = float(result.edges[k]), float(result.edges[k + 1]), float(result.margins[k])
        if found and low <= found[-1][1] * (1 + _NEAR):
            found[-1] = found[-1][0], high, min(margin, found[-1][2])
        else:
            found.append((low, high, margin))
    return found


def _next(result: Interconnection) -> list[str]:
    if _known(result):
        return ["Measure them, or state how far they are known: a band of each takes the place of its model."]
    if result.stable:
        near = f" Its margin is least near {in_hz(result.frequency / HZ, 4)}." if np.isfinite(result.margin) else ""
        return [
            f"The verdict holds for these two as they were measured; after a setting was changed measure again.{near}"
        ]
    if result.status is InterconnectionStatus.UNSTABLE and result.pair is None:
        return ["Change one of the two: no better measurement makes this loop stable."]
    return [f"Measure better: {one}." for one in result.wanted]


def _limit(result: Interconnection) -> list[Block]:
    """Section on what limits."""
    if np.isinf(result.margin):
        return []
    rows = [("Frequency", in_hz(result.frequency / HZ)), ("Margin", f"{at_least(result.margin)} there; 1 is needed.")]
    for name, share, bound in zip(("Source", "Load"), result.shares, result.bounds, strict=True):
        if share.any():
            i, j = (int(one) for one in np.unravel_index(np.argmax(share), share.shape))
            size = at_most(float(bound[i, j])) if np.isfinite(bound[i, j]) else "nothing"
            part = f"{number(100 * float(share.sum()), 3)} % of what limits"
            rows.append((name, f"{part}, most of it entry ({i + 1}, {j + 1}), whose error is bounded by {size} there."))
    rows += [("To measure", f"{one}.") for one in result.wanted]
    return [Heading("What limits"), Facts(rows)]


def margin_chart(result: Interconnection) -> Chart:
    """The margin of every arc; those that passivity proves in another colour."""
    inside = result.edges[np.isfinite(result.edges) & (result.edges > 0)] / HZ
    low, high = float(inside.min(initial=1.0)), float(inside.max(initial=1.0))
    axis = Axis("frequency [Hz]", log=True, range=(low, high))
    hz = np.clip(np.repeat(result.edges, 2)[1:-1] / HZ, low, high)
    sizes = np.repeat(np.clip(result.margins, 1e-3, _TALL), 2)
    passive = np.repeat(result.passive, 2)
    layers = [Layer("small gain", hz, np.where(passive, np.nan, sizes), NOMINAL, dash="solid", size=FINE)]
    if result.passive.any():
        layers.append(Layer("passivity of both sides", hz, np.where(passive, sizes, np.nan), FURTHER[0], dash="solid"))
    layers.append(Layer("needed", np.array([low, high]), np.ones(2), ALERT, dash="dot"))
    if np.isfinite(result.margin):
        place = np.array([np.clip(result.frequency / HZ, low, high)]), np.array([max(result.margin, 1e-3)])
        layers.append(Layer("least", *place, ALERT, marker="diamond"))
    span = span_of(np.concatenate([layer.y for layer in layers]), 1.5)
    return Chart("margins", (Panel("Margin of every arc", axis, Axis("margin [–]", log=True, range=span), layers),))


def _region(result: Interconnection, region: tuple[float, float] | None) -> list[Block]:
    """Words on a forbidden region; nothing where none is asked for."""
    if region is None:
        return []
    gain, phase = region
    out = result.keeps_out(gain, phase)
    words = f"Forbidden region of {gain:g} dB and {phase:g}°: "
    if out.all():
        words += "no eigenvalue of any pair is in it at any of the frequencies."
    else:
        hz = result.omega[~out] / HZ
        words += (
            f"proved to be kept out of at {int(out.sum())} of {out.size} frequencies; not at some between"
            f" {number(float(hz.min()), 4)} and {in_hz(float(hz.max()), 4)}."
        )
    return [Text(words, id="forbidden"), Text("Between the frequencies nothing is said of it.", "soft")]


def _sides(result: Interconnection) -> list[tuple[str, str]]:
    rows: list[tuple[str, str]] = []
    for name, side in (("Source", result.source), ("Load", result.load)):
        problem = getattr(side, "problem", None)
        if isinstance(side, Band) and problem is not None:
            at = in_hz_span(float(side.omega.min()) / HZ, float(side.omega.max()) / HZ)
            rows.append(
                (name, f"A band from {counted(problem.samples, 'sample')}, {at}, about a model of order {side.order}.")
            )
        elif problem is not None:
            rows.append((name, f"A worst-case error from {counted(problem.samples, 'sample')}."))
        else:
            rows.append((name, f"Known without error: a model of order {getattr(side, 'nstates', 0)}."))
    both = "Both are stable standing alone; what their bands assume: class, poles, bounds of the samples."
    return [*rows, ("Assumed", both)]


def _proofs(result: Interconnection) -> list[Block]:
    """Verdict on the sums of the bands, which are evaluated again."""
    bands = [side for side in (result.source, result.load) if isinstance(side, Band)]
    if not bands:
        return []
    words = "The sums of the bands were evaluated again for this page, without a solver."
    found = proved(all(one.certified for one in bands), words, "The proofs do not give what is stated.", "certificates")
    return [dataclasses.replace(found, word="Bands proved") if found.key == "consistent" else found]

"""The picture, the words and the numbers of a controller that is tuned by hand: worst cases at frequencies, as it is turned."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence

import numpy as np

from robustid.controllers import Limits, Proof, WorstAt
from robustid.core import counted
from robustid.guarantees import scope_of
from robustid.report.charts import BAND, FAINT, FURTHER, NOMINAL, Axis, Layer, Panel, frequency_axis
from robustid.report.curves import span_of
from robustid.report.design_charts import LARGEST, MAPS, SMALLEST, bounded_below, curve, kept_out, limit_layers
from robustid.report.design_page import asked_in_lines
from robustid.report.loci import open_loop_panel
from robustid.report.with_plotly import Drawn, plotly_figure
from robustid.report.words import HZ, at_least, at_most, in_hz, number

Shares = Mapping[str, tuple[float, float]]
_HEIGHT, _PLANE = 1080, 400  # pixels
_ROOM, _GAP = 0.17, 0.0375  # of the height: a panel, and what is between two
_DOMAINS = tuple((k * (_ROOM + _GAP), k * (_ROOM + _GAP) + _ROOM) for k in (4, 3, 2, 1, 0))
_NEAR = ((-2.1, 0.5), (-1.3, 1.3))  # of the plane that is drawn
_DEEP, _HIGH = 1e-3, 10.0  # times the largest value with the design: what is beyond is not drawn, but for limits
_BEFORE = "with the controller of the design"
_MARGIN = 1.3  # of the axes
_LOW = 1e-3  # smaller open loops are not drawn
_TICKS = 4  # of a frequency axis as narrow as a telephone: powers of ten where 1, 2, 5 have no place


def tuning_bode(found: Sequence[WorstAt], before: Sequence[WorstAt], limits: Limits) -> Drawn:
    """|L| in its range, and the largest |S|, |T|, |P S| and |C S| with their limits, of every band; and as they were before."""
    omega = np.sort(np.concatenate([one.omega for one in found]))
    axis = frequency_axis(omega)
    panels = [_open_loop(found, before, axis)]
    for name, (letters, _) in MAPS.items():
        layers = [
            dataclasses.replace(curve(_BEFORE, one.omega, one.largest[name], FAINT), dash="dot") for one in before
        ]
        size = max(float(np.nanmax(layer.y, initial=0.0)) for layer in layers) or 1.0
        layers += [curve(LARGEST, one.omega, one.largest[name], NOMINAL) for one in found]
        values = np.clip(np.concatenate([layer.y for layer in layers]), _DEEP * size, _HIGH * size)
        if bounded_below(limits, name):
            layers += [curve(SMALLEST, one.omega, one.smallest[name], FURTHER[0]) for one in found]
        asked = limit_layers(limits, name, omega)
        span = span_of(np.concatenate([values, *(layer.y for layer in asked)]), _MARGIN)
        label = f"{'largest ' * (not bounded_below(limits, name))}|{letters}|"
        panels.append(Panel(letters, axis, Axis(label, log=True, range=span), [*layers, *asked]))
    drawn = plotly_figure(panels, _HEIGHT, domains=_DOMAINS)
    drawn["layout"]["xaxis"]["nticks"] = _TICKS
    return drawn


def _open_loop(found: Sequence[WorstAt], before: Sequence[WorstAt], axis: Axis) -> Panel:
    """Magnitudes of open loops, in the range of all consistent plants."""
    sizes = np.concatenate([np.abs(one.centre) for one in (*found, *before)])
    floor, top = max(0.5 * float(sizes.min()), _LOW), max(2 * float(sizes.max()), 2 * _LOW)
    layers = list[Layer]()
    for one in found:
        size = np.abs(one.centre)
        least = np.where(np.isinf(one.radius), one.least, size - one.radius)  # the plant may be infinite
        low, high = (np.clip(edge, floor, top) for edge in (least, size + one.radius))
        layers.append(Layer("|L| of every consistent plant", one.omega / HZ, size, BAND, low=low, high=high, fill=True))
    layers += [Layer(_BEFORE, one.omega / HZ, np.abs(one.centre), FAINT, dash="dot", size=0.6) for one in before]
    layers += [Layer("|L|, centre", one.omega / HZ, np.abs(one.centre), NOMINAL, dash="solid") for one in found]
    return Panel("L", axis, Axis("|L|, L = P C", log=True, range=(floor, top)), layers)


def tuning_nyquist(found: Sequence[WorstAt], limits: Limits) -> Drawn:
    """Open loops near -1 in their discs, and what limits keep them out of."""
    layers = kept_out(limits, "")
    for one in found:
        panel = open_loop_panel(one.centre, one.radius, corners=one.corners)
        layers += [] if panel is None else panel.layers
    x, y = (Axis(f"{part} part of L", range=span) for part, span in zip(("real", "imaginary"), _NEAR, strict=True))
    drawn = plotly_figure([Panel("", x, y, layers, square=True)], _PLANE)
    drawn["layout"]["margin"] |= {"l": 60, "r": 40}
    return drawn


def tuning_words(found: Sequence[WorstAt], shares: Shares, proof: Proof | None = None) -> tuple[str, str]:
    """Key of the verdict, and the verdict: of the loop at frequencies, or of the proof where there is one."""
    if proof is not None:
        return _proved_words(proof)
    count = sum(one.omega.size for one in found)
    if not all(one.stable for one in found):
        return "inconsistent", "Not stable: the loop with the model itself is unstable."
    if (open_ := next((one for one in found if not one.clear), None)) is not None:
        hz = float(open_.omega[np.argmax(~np.isfinite(open_.largest["sensitivity"]))]) / HZ
        return (
            "inconsistent",
            f"Not stable with every consistent plant: near {in_hz(hz, 4)} one may have its loop at −1.",
        )
    over = [f"{name}, {_of_limit(*one)}" for name, one in shares.items() if one[0] > 1]
    if over:
        return "inconsistent", f"Stable with the model. Exceeded: {'; '.join(over)}."
    asked = "All limits are kept" if shares else "The loop is stable"
    return (
        "",
        f"{asked} at {counted(count, 'frequency')} with every consistent plant. Between them nothing is proved yet.",
    )


def _of_limit(share: float, omega: float) -> str:
    near = "" if math.isnan(omega) else f", near {in_hz(omega / HZ, 4)}"
    return f"{at_most(share)} times its limit{near}"


def _proved_words(proof: Proof) -> tuple[str, str]:
    scope = scope_of([one.band for one in proof.proofs])
    if proof.kept:
        kept = " and keeps all limits" if proof.shares else ""
        return "consistent", f"PROVED: every consistent plant is stable{kept}, at every frequency{scope}."
    failed = [one for one in proof.proofs if not one.guaranteed]
    if failed:
        return "inconsistent", f"Not proved: {failed[0].status.value}."
    over = [f"{name}, {_of_limit(*one)}" for name, one in proof.shares.items() if one[0] > 1]
    return "inconsistent", f"Not proved: some consistent plant may exceed {'; '.join(over)}."


def tuning_numbers(found: Sequence[WorstAt]) -> list[tuple[str, str]]:
    """Worst-case numbers over all bands, each with its name."""
    if not all(one.clear for one in found):
        names = ("peak of |S|", "modulus margin", "gain margin", "phase margin", "delay margin")
        return [(name, "–") for name in names] + [_bandwidth(found)]
    margins = [one.margins for one in found]
    gain, delay = min(one.gain[1] for one in margins), min(one.delay for one in margins)
    return [
        ("peak of |S|", at_most(1 / min(one.modulus for one in margins))),
        ("modulus margin", at_least(min(one.modulus for one in margins), 3)),
        ("gain margin", f"{at_least(gain, 3)} ({at_least(20 * math.log10(gain), 3)} dB)"),
        ("phase margin", f"{at_least(math.degrees(min(one.phase for one in margins)), 3)}°"),
        ("delay margin", f"{at_least(1e3 * delay, 3)} ms"),
        _bandwidth(found),
    ]


def _bandwidth(found: Sequence[WorstAt]) -> tuple[str, str]:
    return "bandwidth", f"{at_least(min(one.bandwidth for one in found) / HZ)} Hz"


def tuning_limits(shares: Shares, limits: Limits) -> list[tuple[str, str, str, str, bool]]:
    """Limits: name, what is asked, the share that is taken, near which frequency in Hz, and if it is kept."""
    asked = asked_in_lines(limits)
    return [
        (name, asked.get(name, ""), at_most(share, 3), number(omega / HZ), share <= 1)
        for name, (share, omega) in shares.items()
    ]

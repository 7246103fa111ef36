"""The small model: its order and the reduction, its worth beside the best fits, its matrices, its response."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from robustid.core import StateMatrices, points_of, response_at
from robustid.errors import InputError
from robustid.fitting import continuous
from robustid.identification import Identification, check_model, largest_ratio
from robustid.reduction import ModelWorth
from robustid.report.charts import (
    ALERT,
    DATA,
    FAINT,
    NOMINAL,
    Axis,
    Chart,
    Layer,
    Panel,
    frequency_axis,
    side_by_side,
    whole_axis,
)
from robustid.report.curves import low_quantile, magnitude_range, phase_curves, resolved, span_of, spread, with_gaps
from robustid.report.document import Block, Code, Drawing, Heading, Text, Verdict
from robustid.report.identified import in_unit, siso, transfer, unit
from robustid.report.magnitude_phase import MagnitudePhase, phase_axis
from robustid.report.words import HZ, number

if TYPE_CHECKING:
    import control

    from robustid.reduction import Reduction

_HANKEL_FLOOR = 1e-8  # of the largest Hankel singular value
_ROUNDING = 1e-9  # of the largest response: what is lower has no phase
_FLOOR = 1e-3  # what lies below, an interpolation of the samples, is drawn here
_MOST = 400  # numbers in the matrices that are printed
_SAVE = 'rid.save("model.mat", model)'
_POINTS, _AROUND = 600, np.linspace(-1.55, 1.55, 61)
_BESIDE = 30  # times the slowest and the fastest pole


def order_section(identification: Identification, reduction: Reduction | None) -> list[Block]:
    """Build the section of the order of the model and of the reduced one."""
    blocks: list[Block] = [Heading("Order")]
    if reduction is not None:
        blocks.append(Text(reduction_words(identification, reduction)))
        if reduction.tried:
            blocks.append(Drawing(margin_chart(reduction)))
    return [*blocks, Drawing(hankel_chart(identification, reduction))]


def reduction_words(identification: Identification, reduction: Reduction) -> str:
    """Say how small and how close the reduced model is, and whether the samples are still kept."""
    ratio = largest_ratio(identification.problem, reduction.model)
    kept = "every sample stays within its bound" if ratio <= 1 else "not every sample stays within its bound"
    size = in_unit(number(reduction.bound, 3), identification)
    norm = "" if siso(identification) else " (largest singular value)"
    near = f" The frequency responses differ by at most {size}{norm}." if np.isfinite(reduction.bound) else ""
    early = f"; {reduction.stopped}" if reduction.stopped else ""
    return (
        f"Order {reduction.order} instead of {identification.order}.{near} Samples:"
        f" {kept} (largest |residual|/bound {number(ratio)}). Status: {reduction.status.value}{early}."
    )


def margin_chart(reduction: Reduction) -> Chart:
    """Largest error over what is allowed, with the limit itself, against the order; and the order that was chosen."""
    orders, margins = np.array(reduction.tried, dtype=float).T
    shown = np.maximum(margins, _FLOOR)
    within, chosen = margins <= 1, orders == reduction.order
    words = tuple(f"order {k:.0f}: {m:.4g}" for k, m in reduction.tried)
    layers = [Layer("smallest found", orders, shown, FAINT, dash="solid")]
    groups = (
        (within & ~chosen, "within", NOMINAL, "circle-open"),
        (~within & ~chosen, "beyond the bounds", FAINT, "circle-open"),
        (chosen, f"chosen order {reduction.order}", NOMINAL, "circle"),
    )
    for mask, name, colour, marker in groups:
        if np.any(mask):
            hover = tuple(np.array(words)[mask])
            layers.append(Layer(name, orders[mask], shown[mask], colour, marker=marker, hover=hover))
    x = whole_axis(float(orders.min()), float(orders.max()), 0.5)
    layers.append(Layer("bound", np.array(x.range), np.ones(2), ALERT, dash="dash"))
    span = min(0.5, float(shown.min()) / 2), max(2.0, 2 * float(shown.max()))
    panel = Panel(
        "Best model of every order: at the samples, and where nothing was measured",
        x,
        Axis("largest |error| / allowed [–]", log=True, range=span),
        layers,
    )
    return Chart("margins", (panel,))


def hankel_chart(identification: Identification, reduction: Reduction | None = None) -> Chart:
    """Hankel singular values, and the order that was chosen.

    Those of the reduction where there is one, else of the model; integrators have none and are always kept.
    """
    from robustid.reduction import balanced_truncation

    shown = reduction
    if shown is None:
        shown = balanced_truncation(identification.model, order=identification.order, unstable="keep")
    values = shown.hankel
    held = shown.bounds.size - 1 - values.size
    top = float(values.max(initial=0.0)) or 1.0
    floor = _HANKEL_FLOOR * top
    values = values[: max(np.count_nonzero(values >= floor), shown.order - held, 1)]  # the others are rounding
    index = np.arange(1, values.size + 1)
    kept = index <= shown.order - held
    groups = [(kept, "kept", NOMINAL, "circle"), (~kept, "truncated", FAINT, "circle-open")]
    if reduction is None or reduction.tried:  # a search truncates nothing
        groups = [(np.ones(index.size, bool), "of the nominal model", NOMINAL, "circle")]
    y = np.maximum(values, floor)
    layers = [
        Layer(name, index[mask].astype(float), y[mask], colour, marker=marker)
        for mask, name, colour, marker in groups
        if np.any(mask)
    ]
    span = (max(float(y.min(initial=top)), floor) / 3, 3 * top)
    if reduction is not None:
        place = np.full(2, shown.order - held + 0.5)
        name = f"chosen order {shown.order}"
        layers.append(Layer(name, place, np.array(span), ALERT, dash="dash"))
    title = "Hankel singular values"
    if held:
        title += f" of the stable part ({held} state{'s' * (held > 1)} on the stability boundary always kept)"
    x, what = Axis("number [–]", range=(0.0, index.size + 1.0)), unit(identification)
    name = f"\n{transfer(identification)}" if siso(identification) else f" [{what}]" if what else ""
    y_axis = Axis(f"Hankel singular value{name}", log=True, range=span)
    return Chart("hankel", (Panel(title, x, y_axis, layers),))


def tried_orders(reduction: Reduction) -> Chart:
    """Margins of the orders that were tried; InputError of a truncation, which tried none."""
    if not reduction.tried:
        raise InputError("`result` must be from reduce_within_bounds: a truncation tries no orders against the samples")
    return margin_chart(reduction)


def worth_verdict(found: ModelWorth) -> Verdict:
    """Verdict on the small model: about as good as the best fit of the order that the data carry, or worse."""
    key, word = "consistent", "The small model fits about as well as the best fit"
    if found.worse:
        key, word = "weak", "The small model fits worse than the best fit"
    numbers = (("misfit", number(found.misfit, 3)), ("best fit", number(found.best, 3)))
    return Verdict(key, word, found.summary(), numbers, id="worth")


def worth_section(found: ModelWorth | None) -> list[Block]:
    """Build the section of the comparison; nothing where there was none."""
    if found is None:
        return []
    words = (
        "Misfit: root mean square of the residuals at the used frequency points in units of their bounds, as measured, without any"
        " factor (of their covariance, where there is one)."
        if found.of_response
        else "Misfit: root mean square of the error of simulations over that of the outputs, from the initial state that fits best."
    )
    return [
        Heading("What the small model is worth"),
        Text(found.summary()),
        Text(words, "soft"),
        Drawing(worth_chart(found)),
    ]


def worth_chart(found: ModelWorth) -> Chart:
    """Misfit of the best fits against their order with the small models, and the error of the fits at withheld points."""
    points = [(float(found.reduction.order), found.misfit, f"small model, order {found.reduction.order}", NOMINAL)]
    if found.reduction.order != found.smallest:
        name = f"smallest inside the bounds, order {found.smallest}"
        points.append((float(found.smallest), found.smallest_misfit, name, ALERT))
    layers = [Layer("best fits", found.orders, found.misfits, FAINT, dash="solid", marker="circle-open")]
    layers += [
        Layer(name, np.array([order]), np.array([misfit]), colour, marker="diamond", size=1.5)
        for order, misfit, name, colour in points
    ]
    span = span_of(np.concatenate([layer.y for layer in layers]), 2) or (0.1, 1.0)
    name = f"order {found.carried}, which the data carry"
    layers.append(Layer(name, np.full(2, float(found.carried)), np.array(span), DATA, dash="dot"))
    orders = np.append(found.orders, [point[0] for point in points])
    x = whole_axis(float(orders.min()), float(orders.max()), 0.7)
    panels = [Panel("Misfit", x, Axis("misfit [–]", log=True, range=span), layers)]
    judged = np.isfinite(found.withheld)
    if np.any(judged):
        error = 100 * found.withheld[judged]
        curve = Layer("best fits", found.orders[judged], error, FAINT, dash="solid", marker="circle-open")
        y = Axis("error [% of the response]", log=True, range=span_of(error, 2) or (1.0, 100.0))
        panels.append(Panel("Best fits at points that were kept out of them", x, y, (curve,)))
    return Chart("worth", panels)


def matrices_section(name: str, model: control.StateSpace, dt: float) -> list[Block]:
    """Build the section of the matrices of a `control.StateSpace`."""
    where = f"discrete, sample time {number(dt, 6)} s" if dt else "continuous time"
    size = sum(np.size(getattr(model, part)) for part in "ABCD")
    said = f"{name[0].upper()}{name[1:]}, {where}. As a file for MATLAB or Python: {_SAVE}"
    blocks: list[Block] = [Heading("Model in numbers"), Text(said, code=(_SAVE,))]
    if size > _MOST:
        return [*blocks, Text(f"Its matrices have {size} numbers, too many to be printed here: take the file.")]
    return [
        *blocks,
        Code("\n".join(_printed(part, np.asarray(getattr(model, part))) for part in "ABCD"), id="matrices"),
    ]


def _printed(name: str, matrix: np.ndarray) -> str:
    """One matrix in full precision, as MATLAB reads it; row by row."""
    rows = ";\n     ".join(" ".join(repr(float(value)) for value in row) for row in np.atleast_2d(matrix))
    return f"{name} = [{rows}];"


def model_chart(model: control.StateSpace, called: str = "model") -> Chart:
    """Magnitude and phase of every entry of a `control.StateSpace`, around its poles and up to the Nyquist frequency."""
    return side_by_side(called, model_charts(model, called), check_model("result", model).ninputs)


def model_charts(model: control.StateSpace, called: str) -> list[Chart]:
    """The same, a chart of each entry, row by row."""
    system = check_model("result", model)
    if system.dt is True:
        raise InputError("`result` is discrete without a sample time; give it its dt in s")
    dt = system.dt or 0.0
    s = np.array([continuous(pole, dt) for pole in system.poles()], dtype=complex)
    s = s[np.isfinite(s) & (np.abs(s) > 0)]
    sizes = np.abs(s) if s.size else np.ones(1)
    high = np.pi / dt if dt else _BESIDE * sizes.max()
    low = min(sizes.min(), high) / _BESIDE
    omega = resolved(spread(low, high, _POINTS, log=True), s, _AROUND, low, high)
    values = response_at(StateMatrices.of(system), points_of(omega, dt))
    name = f"{called}, order {system.nstates}"
    return [_entry(system, i, j, omega, values[:, i, j], name) for i, j in np.ndindex(values.shape[1:])]


def _entry(system: control.StateSpace, i: int, j: int, omega: np.ndarray, values: np.ndarray, name: str) -> Chart:
    size, ((angle,), span) = np.abs(values), phase_curves([values])
    angle = np.where(size > _ROUNDING * size.max(), angle, np.nan)
    drawn = MagnitudePhase()
    drawn.add(name, omega / HZ, size, with_gaps(angle), colour=NOMINAL, dash="solid")
    y = Axis("magnitude", log=True, range=magnitude_range(float(size.max()), [low_quantile(size)]))
    title = f"{system.output_labels[i]} / {system.input_labels[j]}"
    return drawn.chart(f"entry-{i}-{j}", frequency_axis(omega), y, phase_axis(span), title)

"""A matrix-fraction fit: its verdict, cost, checks, response, convergence and modes; its page and its summary."""

from __future__ import annotations

import numpy as np

from robustid.core import counted
from robustid.data import expected_feedthrough
from robustid.fitting import FitStatus, MatrixFraction, ModeRow
from robustid.report.charts import Chart, first_panel
from robustid.report.curves import most_drawn
from robustid.report.data_faults import fault_verdict, faults_of_response, placed, steps_with_faults
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
    checks_table,
    pasted,
    unfinished_notice,
)
from robustid.report.fit_charts import convergence_chart, fit_pole_chart, response_charts, with_deviation
from robustid.report.fit_view import FitView
from robustid.report.identified import Parts
from robustid.report.order_sweep_section import order_sweep_section
from robustid.report.small_model import matrices_section
from robustid.report.words import HZ, drawn_words, in_hz_span, number, title

_KEYS = {FitStatus.BOUNDARY: "weak", FitStatus.SLOW: "weak"} | dict.fromkeys(
    (FitStatus.LIMIT, FitStatus.TIME, FitStatus.INTERRUPTED, FitStatus.STALLED), "undecided"
)
SIGMA = (
    "±: one standard deviation, from what the fit leaves: errors of the model count as noise, and data with errors that"
    " are correlated between frequency points are less sure than this says."
)
_CONVERGENCE = (
    "Cost after every iteration. The polynomials are orthonormal for the data of each iteration, so that its normal matrix is"
    " the identity but for rounding: κ − 1 lies near machine epsilon."
)
_PARTICIPATION = (
    "f is the natural frequency |s|/2π. Participation: peak of the mode’s own response, every entry relative to the largest such"
    " peak of that entry, relative to that of the largest mode."
)
_COMMANDS = ("robustid identify --frequency FILE --report report.html", "--time-limit", "--order auto", "--band")
_WORTH = 50.0  # per cent of fit, below which a model leaves more than half of what the data do
_MOST_MODES = 40  # at the terminal


def fit_page(fit: MatrixFraction, title: str | None, parts: Parts) -> Document:
    """Build the page of a fit."""
    order_sweep = parts.get("order_sweep")
    view = FitView(fit, parts.get("data"), order_sweep)
    sure = view.covariance is not None
    entries = response_charts(view)
    return Document(
        title or _title(view),
        head=[*_data_faults(view), fit_verdict(view)],
        body=[
            Heading("Fit"),
            Facts(summary_rows(view)),
            Heading("Verification"),
            Text("Evaluated again from the state-space model and the numbers of the fit."),
            checks_table(view.checks),
            Heading("Frequency response"),
            Text(_response_words(view, sure), "soft"),
            Grid(entries, view.nu),
            Heading("Convergence"),
            Text(_CONVERGENCE, "soft"),
            Drawing(convergence_chart(view)),
            Heading("Poles and modes"),
            Drawing(fit_pole_chart(view), beside=True),
            modes_table(view),
            Text(f"{_PARTICIPATION} {SIGMA if sure else ''}".rstrip(), "soft"),
            *([] if order_sweep is None else order_sweep_section(order_sweep)),
            *matrices_section(f"model, order {view.model.nstates}", view.model, view.dt or 0.0),
        ],
        glance=_glance(view, entries[0], parts),
        notice=unfinished_notice(view.unfinished),
    )


def _glance(view: FitView, entry: Chart, parts: Parts) -> Glance:
    """The first screen: order, fit, residual, the first entry, what to do next."""
    said = fit_verdict(view)
    worst = ", worst entry" if view.ny * view.nu > 1 else ""
    fits = [(f"fit of the response{worst}", view.fit_percent), ("fit at withheld points", view.withheld_percent)]
    shown = [(name, f"{number(value, 3)} %") for name, value in fits if np.isfinite(value)]
    numbers = [said.numbers[0], *shown, *said.numbers[1:]]
    steps = ["A model with a proof, and a bound of its error: robustid identify --frequency FILE --report report.html"]
    if _judged(view) < _WORTH:
        steps = ["Fit a higher order (--order auto compares them), another weight, or a narrower band (--band)."]
    elif said.key in ("undecided", "failed"):
        steps = ["Let it run longer (--time-limit), or fit a lower order: --order auto compares them."]
    elif said.key == "weak" and view.fit.status is FitStatus.BOUNDARY:
        steps = ["A lower order, or a narrower band (--band), often leaves the stability boundary."]
    told = pasted(parts.get("steps", ())) or [Text(step, code=_COMMANDS) for step in steps]
    told.append(
        Text("A least-squares fit guarantees nothing about the machine: look at the residuals in the plot first.")
    )
    faults = [] if view.data is None else placed(view.data)
    after = steps_with_faults(faults, parts.get("undoing"), told)
    left_out = "how far the machine is from this model, between the frequency points and on them"
    return Glance(numbers=numbers, chart=first_panel(entry), next=after, not_covered=left_out)


def fit_summary(view: FitView) -> list[Block]:
    """Build the summary of a fit at the terminal."""
    sure = [Text(SIGMA, "soft")] if view.covariance is not None else []
    notice = unfinished_notice(view.unfinished)
    return [
        *([] if notice is None else [notice]),
        *_data_faults(view),
        fit_verdict(view),
        Facts(summary_rows(view)),
        checks_table(view.checks),
        modes_table(view),
        *sure,
    ]


def _data_faults(view: FitView) -> list[Verdict]:
    """The verdict on faults of the response that was fitted, where it is at hand."""
    if view.data is None:
        return []
    return fault_verdict(faults_of_response(view.data))


def _title(view: FitView) -> str:
    return title("Matrix fraction", view.outputs, view.inputs)


def _response_words(view: FitView, sure: bool) -> str:
    points = view.omega.size
    words = (
        "Magnitude and phase of every entry; outputs below each other, inputs beside each other. Drag to zoom, double click to"
        f" go back.{drawn_words(points, most_drawn(points, view.ny * view.nu), 'residual')}"
    )
    if sure:
        return f"{words} σ is one standard deviation."
    if view.too_many:
        return (
            f"{words} Without standard deviations, which take long for so many residues: `fit_covariance` gives them."
        )
    return f"{words} Without standard deviations: the fit is not at an optimum that leaves noise."


def fit_verdict(view: FitView) -> Verdict:
    """The outcome in one word and one sentence; a model that failed a check is never called converged, nor is one good that
    misses the data.
    """
    status, failed = view.fit.status, [claim for claim, check in view.claims if not check.holds]
    if failed:
        key, word = "failed", "Not verified"
        sentence = f"The fit ended with “{status.value}”, but this doesn't hold: {'; '.join(failed)}."
    else:
        key, word = _KEYS.get(status, "consistent"), f"{status.head[0].upper()}{status.head[1:]}"
        sentence = f"{status.reason[0].upper()}{status.reason[1:]}."
        judged, fit = _judged(view), f"fit {number(view.output_fit_percent, 3)} %{', worst output' * (view.ny > 1)}"
        if judged < view.output_fit_percent:
            fit = f"{fit}; {number(judged, 3)} % at frequency points that were withheld"
        if judged < 0:
            key, word = "failed", f"{word}, but worth nothing"
            sentence += f" The model is farther from the data than their mean value ({fit})."
        elif judged < _WORTH:
            key, word = ("weak" if key == "consistent" else key), f"{word}, but the model misses much of the response"
            sentence += f" 100 % would be every sample, 0 % their mean value: {fit}."
        elif view.fit_percent < 0:
            key, word = ("weak" if key == "consistent" else key), f"{word}, but the model misses an entry"
            sentence += f" Of one entry it is farther from the data than their mean value (fit {number(view.fit_percent, 3)} %)."
    order = f"{view.fit.fraction.A.shape[0]}"
    return Verdict(key, word, sentence, (("order", order), ("weighted residual, rms", number(_rms(view), 3))))


def _judged(view: FitView) -> float:
    """The fit that a model is judged by, in per cent: of its worst output, or at withheld frequency points where it is lower."""
    return float(np.fmin(view.output_fit_percent, view.withheld_percent))


def _rms(view: FitView) -> float:
    """Root mean square of the weighted residual, per complex sample."""
    return float(np.sqrt(2 * view.fit.cost / view.equations))


def summary_rows(view: FitView) -> list[tuple[str, str]]:
    """Facts about the fit: the data, the model, the cost."""
    fit = view.fit
    points = int(np.sum(np.any(view.used, axis=(1, 2))))
    hz = view.omega / HZ
    data = f"{counted(points, 'frequency point')}, {in_hz_span(hz[0], hz[-1], 4)}; {view.ny} × {view.nu} (outputs × inputs)"
    if points < view.omega.size:
        data += f"; {view.omega.size - points} further points have no weight"
    domain = "s" if view.dt is None else f"z, sample time {number(view.dt, 6)} s"
    rows = [("Data", data), ("Model", f"{_form_words(view)}, in {domain}")]
    if fit.modal is not None:
        rows.append(("Structure", f"{fit.modal.words[0].upper()}{fit.modal.words[1:]}"))
    if fit.fraction.rigid_count:
        rows.append(("Rigid body", _rigid_words(view)))
    if fit.problem.feedthrough:
        why = None if view.data is None else expected_feedthrough(view.data)
        words = "The response may differ from 0 at infinite frequency"
        rows.append(
            ("Feed-through", words if why is None else f"{words}: {why.value} (--no-feedthrough, feedthrough=False)")
        )
    rows += [
        ("Weight", f"{fit.weight_choice[0].upper()}{fit.weight_choice[1:]}"),
        ("Cost", f"{number(fit.cost, 5)} = Σ |W (data − model)|²; the start had {number(fit.start_cost, 5)}"),
        ("Per real equation", f"{number(fit.cost / view.equations)} ({view.equations} real equations)"),
        ("Weighted residual", f"{number(_rms(view))} root mean square per sample"),
        ("Iterations", _iterations(view)),
    ]
    if fit.reflected:
        words = f"{fit.reflected} of the best fit (cost {number(fit.unstable_cost, 5)}), reflected and fitted again"
        rows.append(("Unstable poles", words))
    return rows


def _form_words(view: FitView) -> str:
    fraction = view.fit.fraction
    order = len(fraction.A)
    if fraction.form == "shared":
        return f"N/d, {order} poles that all entries share, residues of any rank: {fraction.states_in_all} states"
    return f"{'D⁻¹ N' if fraction.form == 'left' else 'N D⁻¹'}, McMillan degree {order}"


def _rigid_words(view: FitView) -> str:
    count, directions = view.fit.fraction.rigid_count, view.fit.rigid_directions
    words = f"{count} undamped mode{'s' * (count > 1)}, {2 * count} states"
    if directions is None:
        return words
    side = "shapes at the outputs" if view.fit.fraction.form == "left" else "driven by the inputs in the directions"
    rows = directions.T if view.fit.fraction.form == "left" else directions
    listed = "; ".join(f"({', '.join(number(value, 4) for value in row)})" for row in rows)
    return f"{words}, {side} {listed}"


def _iterations(view: FitView) -> str:
    methods = [step.words for step in view.fit.history]
    if not methods:
        return "none: the start was the end"
    counts = ", ".join(f"{methods.count(name)} {name}" for name in dict.fromkeys(methods))
    return f"{len(methods)} ({counts})"


def modes_table(view: FitView) -> Table:
    """Modes of the model, with their standard deviations where there are any."""
    columns = [
        Column("f [Hz]", "n", "Hz"),
        Column("damping", "n", "Damping"),
        Column("participation", "n", "Peak"),
        Column("largest in", "text", "Largest in"),
        Column("states", "n", "States"),
    ]
    rows, words = [mode_cells(view, row) for row in view.modes], "Modes; peak: relative to that of the largest"
    return Table(columns, rows, empty="no poles", title=words, most=_MOST_MODES)


def mode_cells(view: FitView, row: ModeRow) -> tuple[str, str, str, str, str]:
    """Hz, damping, participation, where it is largest, and the number of states."""
    where = view.entry(row.output, row.input)
    if row.rigid:
        return "rigid body", "–", "–", where, str(row.count)
    if row.count == 1:
        kind = f"{with_deviation(row.hz, row.hz_std)} (real)"
        return kind, number(row.damping, 3), number(row.participation, 3), where, "1"
    hz, damping = with_deviation(row.hz, row.hz_std), with_deviation(row.damping, row.damping_std)
    return hz, damping, number(row.participation, 3), where, str(row.count)

"""What is said of a matrix-fraction fit, in words and tables, before any medium."""

from __future__ import annotations

import numpy as np

from robustid.mfd import FitStatus, ModeRow, OrderSweep
from robustid.report.facts import Verdict
from robustid.report.mfd_view import FitView
from robustid.report.style import number

_WORDS = {
    FitStatus.STATIONARY: ("consistent", "Converged"),
    FitStatus.FLAT: ("consistent", "Converged"),
    FitStatus.EXACT: ("consistent", "Exact"),
    FitStatus.BOUNDARY: ("weak", "At the stability boundary"),
    FitStatus.LIMIT: ("undecided", "Not converged"),
    FitStatus.STALLED: ("undecided", "Not converged"),
}
SIGMA = (
    "±: one standard deviation, from what the fit leaves: errors of the model count as noise, and data with errors that"
    " are correlated between lines are less sure than this says."
)


def verdict(view: FitView) -> Verdict:
    """The outcome in one word and one sentence; a model that failed a check is never called converged."""
    failed = [check.name.split(":")[0] for check in view.checks if not check.holds]
    if failed:
        sentence = f"The fit ended with “{view.fit.status.value}”, but this doesn't hold: {'; '.join(failed)}."
        return Verdict("failed", "Not verified", sentence)
    key, word = _WORDS[view.fit.status]
    sentence = view.fit.status.value.removeprefix(f"{word.lower()}: ")
    return Verdict(key, word, f"{sentence[0].upper()}{sentence[1:]}.")


def root_mean_square(view: FitView) -> float:
    """Of the weighted residual, per complex sample."""
    return float(np.sqrt(2 * view.fit.cost / view.equations))


def summary_rows(view: FitView) -> list[tuple[str, str]]:
    """What was fitted to what, and how well: (what, in which words)."""
    fit = view.fit
    lines = int(np.sum(np.any(view.used, axis=(1, 2))))
    hz = view.omega / (2 * np.pi)
    data = f"{lines} lines, {number(hz[0])} to {number(hz[-1])} Hz; {view.ny} × {view.nu} (outputs × inputs)"
    if lines < view.omega.size:
        data += f"; {view.omega.size - lines} further lines have no weight"
    domain = "s" if view.dt is None else f"z, sample time {number(view.dt, 6)} s"
    form = {"right": "N D⁻¹", "left": "D⁻¹ N"}[fit.fraction.form]
    rows = [
        ("Data", data),
        ("Model", f"{form}, McMillan degree {fit.fraction.A.shape[0]}, in {domain}"),
    ]
    if fit.fraction.rigid_count:
        rows.append(("Rigid body", _rigid_words(view)))
    rows += [
        ("Cost", f"{number(fit.cost, 5)} = Σ |W (P_o − P)|²; the start had {number(fit.start_cost, 5)}"),
        ("Per real equation", f"{number(fit.cost / view.equations)} ({view.equations} real equations)"),
        ("Weighted residual", f"{number(root_mean_square(view))} root mean square per sample"),
        ("Iterations", _iterations(view)),
    ]
    if fit.reflected:
        words = f"{fit.reflected} of the best fit (cost {number(fit.unstable_cost, 5)}), reflected and fitted again"
        rows.append(("Unstable poles", words))
    return rows


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
    methods = [step.method for step in view.fit.history]
    if not methods:
        return "none: the start was the end"
    counts = ", ".join(f"{methods.count(name)} {name}" for name in dict.fromkeys(methods))
    return f"{len(methods)} ({counts})"


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


def with_deviation(value: float, deviation: float) -> str:
    """The value with as many digits as its standard deviation leaves.

    Examples
    --------
    >>> with_deviation(635.12345, 0.0213), with_deviation(0.0123456, 4e-5), with_deviation(17.67, float("nan"))
    ('635.123 ± 0.021', '0.012346 ± 0.000040', '17.67')
    """
    if np.isnan(deviation) or deviation <= 0:
        return number(value, 5)
    if np.isinf(deviation):
        return f"{number(value, 5)} (not determined)"
    decimals = 1 - int(np.floor(np.log10(deviation)))
    if not 0 <= decimals <= 9:
        return f"{number(value, 6)} ± {number(deviation, 2)}"
    return f"{value:.{decimals}f} ± {deviation:.{decimals}f}"


def order_words(sweep: OrderSweep) -> str:
    """Which order the data carry, and by which rule."""
    noise = "known from the covariance of the data" if sweep.noise_known else "of unknown level"
    words = (
        f"Order {sweep.suggested} has the smallest description length (MDL) of the {sweep.orders.size} orders tried,"
        f" {sweep.orders[0]} to {sweep.orders[-1]}, with noise {noise}; {sweep.subspace_order} singular values lie above"
        " the noise."
    )
    if sweep.failures:
        words += f" Not fitted: {', '.join(f'order {order}' for order in sweep.failures)}."
    if sweep.orders.size > 1 and sweep.suggested == sweep.orders[-1]:
        words += " It is the largest order tried: try larger ones."
    return words

"""What a report says, in words and tables, before any medium: text and HTML both print this."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from robustid.data import FrequencyResponse
from robustid.errors import Status
from robustid.identification import Identification
from robustid.identification.residuals import largest_ratio
from robustid.report.poles import delay_words, describe_pole, pole_rows
from robustid.report.style import number

_HZ = 2 * np.pi

CHOSEN = "Chosen by the program from these data"
CAUTION = (
    "These are assumptions. Data can refute them, never prove them: a consistent result says that nothing"
    " measured so far contradicts them."
)


class Verdict(NamedTuple):
    """The result in one word and one sentence; `key` chooses the colour."""

    key: str
    word: str
    sentence: str


def unit(identification: Identification) -> str:
    """Unit of the transfer function, "mm/N"; empty where neither channel has one."""
    output, input_ = identification.problem.channel
    if not input_.unit:
        return output.unit
    return f"{output.unit or '1'}/{input_.unit}"


def transfer(identification: Identification) -> str:
    """Name of the transfer function, "displacement [mm] / force [N]"."""
    output, input_ = identification.problem.channel
    return f"{output} / {input_}"


def verdict(identification: Identification) -> Verdict:
    """The verdict in plain words; a model that failed its verification is never called consistent."""
    count = identification.problem.samples
    if identification.status is not Status.FAILED and not identification.verification.passed:
        failed = "; ".join(c.name for c in identification.verification.checks if not c.holds)
        return Verdict(
            "failed",
            "Not verified",
            f"The solver's answer was “{identification.status.name.lower()}”, but the numbers don't support"
            f" it: {failed}. Don't rely on this result.",
        )
    sentences = {
        Status.CONSISTENT: f"A system of the assumed class keeps all {count} samples within their bounds.",
        Status.INCONSISTENT: f"It is proved that no system of the assumed class keeps all {count} samples within"
        " their bounds: a bound is too small, or an assumption is wrong.",
        Status.UNDECIDED: "The proven interval of the margin contains 1: ask for a smaller `accuracy`.",
        Status.FAILED: "No solver returned numbers that could be verified to the accuracy asked.",
    }
    status = identification.status
    if status is Status.CONSISTENT and identification.warnings:
        return Verdict("weak", "Consistent, but the class says little", sentences[status])
    return Verdict(status.name.lower(), status.name.capitalize(), sentences[status])


def margin_interval(identification: Identification) -> str:
    """The proven interval of the margin."""
    lower, upper = identification.margin_lower, identification.margin
    if not 1e-3 < upper < 1e6:
        first, last = number(lower, 2), number(upper, 2)
    else:  # as many decimals in both
        decimals = 5 - int(np.floor(np.log10(upper)))
        first, last = (f"{value:.{decimals}f}" if value > 0 else "0" for value in (lower, upper))
    return last if first == last else f"{first} … {last}"


def margin_words(identification: Identification) -> str:
    """What the margin means here."""
    upper = identification.margin
    meaning = (
        "The margin is the smallest factor on all bounds at which a system of the class still keeps every sample."
        " Its upper end is reached by a system, its lower end is proved by a certificate; both were recomputed"
        " from the numbers."
    )
    if identification.length:
        meaning += (
            f" They were found in a finite form of G, {identification.form}; what it leaves out moves no sample by more"
            f" than {number(identification.tail, 2)} of its bound, and both ends allow for that."
        )
    if identification.status is Status.INCONSISTENT:
        return f"{meaning} Here every bound would have to be {number(upper)} times as large."
    if identification.status is not Status.CONSISTENT:
        return meaning
    if upper < 1e-3:
        return f"{meaning} Here it is practically 0: the class could follow these samples exactly."
    return f"{meaning} Here every bound could shrink to {number(100 * upper, 3)} % of its size."


def assumptions(identification: Identification) -> list[tuple[str, str]]:
    """What was assumed: (what, in which words)."""
    problem, prior = identification.problem, identification.problem.prior
    size = f"{number(prior.gain_bound)} {unit(identification)}".rstrip()
    tau = problem.dt / np.log(prior.decay_rate)
    words = (
        f"The non-parametric part G satisfies |G| ≤ K = {size} in |z| < ρ = {number(prior.decay_rate, 6)}"
        f" (z: one sample of delay): its poles lie within |z| ≤ {number(1 / prior.decay_rate, 6)}, and its impulse"
        f" response stays below K ρ⁻ᵏ, a time constant of {number(tau, 3)} s."
    )
    if identification.prior != prior:
        words += f" The model itself needs only K = {number(identification.prior.gain_bound)}."
    out = [("Prior", words)]
    basis = problem.parametric
    if basis is None:
        out.append(("Parametric part", "None: nothing is known about single modes."))
    else:
        rows = pole_rows(basis.poles, problem.dt)
        listed = [describe_pole(row) for row in rows if row.modulus > 0]
        if len(listed) < len(rows):  # poles at z = 0
            listed.append(delay_words(basis))
        words = "; ".join(listed) or "none"
        free = "free " if problem.parameter_bounds is None else ""
        out.append(("Parametric part", f"{basis.size} functions with {free}coefficients and fixed poles: {words}."))
    if problem.parameter_bounds is not None:
        out.append(("Intervals", _interval_words(identification)))
    out.append(("Bounds", "Every sample lies within its bound of the response of the plant; see the table."))
    return out


def _interval_words(identification: Identification) -> str:
    """The intervals of the parameters, and which of their ends are reached."""
    problem, words = identification.problem, []
    for name, (low, high) in zip(problem.parametric.labels, problem.parameter_bounds, strict=True):
        if np.isfinite(low):
            words.append(f"{name} {number(low)}" if low == high else f"{name} {number(low)} … {number(high)}")
    if not words:
        return "None of the coefficients of the parametric functions is bounded."
    reached = [f"{name} is at the end {number(end)}" for name, end in identification.active_intervals]
    what = f"Coefficients of the parametric functions, known beforehand: {'; '.join(words)}."
    return f"{what} Where the margin is reached, or in the model, {'; '.join(reached)}." if reached else what


class Experiment(NamedTuple):
    """One row of the table of experiments."""

    name: str
    channel: str
    samples: int
    span: str
    bound: str
    source: str


def experiments(identification: Identification) -> list[Experiment]:
    """What was measured, and where the bounds come from."""
    problem = identification.problem
    return [
        _experiment(r.kind, data, r.axis, r.bound)
        for r, data in zip(identification.residuals, (*problem.frequency, *problem.time), strict=True)
    ]


def _experiment(kind: str, data: Any, axis: np.ndarray, bound: np.ndarray) -> Experiment:
    low, high = number(bound.min(), 3), number(bound.max(), 3)
    radius = f"± {low}" if low == high else f"± {low} … {high}"
    if isinstance(data, FrequencyResponse):
        if data.tilt is not None:
            ends = number(data.inner_radius.min(), 3), number(data.outer_radius.max(), 3)
            radius = "ellipses, half-axes {} … {}".format(*ends)
        channel, symbol, name = f"{data.outputs[0]} / {data.inputs[0]}", "Hz", "frequency response"
        axis = axis / _HZ
    else:
        channel, symbol, name = f"{data.outputs[0]}, input {data.inputs[0]}", "s", f"time record, {started(data)}"
    span = f"{number(axis.min())} … {number(axis.max())} {symbol}" if axis.size > 1 else f"{number(axis[0])} {symbol}"
    return Experiment(name, channel, axis.size, span, radius, bound_source(data))


def bound_source(data: Any) -> str:
    """Of a response or record: what kind of bound it has, and where it comes from.

    Examples
    --------
    >>> bound_source(FrequencyResponse([1.0], [1.0], bound=0.1))
    'hard: source not stated'
    """
    name = {"hard": "hard", "rest": "from rest", "statistical": "statistical"}[data.bound_kind]
    if data.note.startswith(name):
        return data.note
    if getattr(data, "probability", None) is not None:
        name += f", {number(100 * data.probability, 6)} % jointly"
    return f"{name}: {data.note or 'source not stated'}"


def started(record: Any) -> str:
    """How a time record begins, in words."""
    words = {"rest": "from rest", "free": "from an unknown state", "periodic": "in periodic steady state"}
    return words[record.initial]


class Limiting(NamedTuple):
    """A sample that carries the proof."""

    experiment: str
    place: str
    share: float
    ratio: float


def limiting(identification: Identification) -> list[Limiting]:
    """Samples that limit the margin or contradict each other, with their part in the proof, largest first.

    None where nothing was proved: a margin of 0 has no limiting samples.
    """
    if identification.margin_lower <= 0:
        return []
    residuals = {(r.kind, r.index): r for r in identification.residuals}
    rows = []
    for kind, index, at, share in identification.conflicting_samples():
        residual = residuals[kind, index]
        ratio = float(residual.ratio[residual.axis == at].max())  # of repeated lines the worst
        place = f"{number(at / _HZ, 5)} Hz" if kind == "frequency" else f"{number(at, 5)} s"
        rows.append(Limiting(f"{kind} {index + 1}", place, share, ratio))
    return rows


def reduction_words(identification: Identification, reduction: Any) -> str:
    """How small, how near, and whether the samples are still kept."""
    ratio = largest_ratio(identification.problem, reduction.model)
    kept = "every sample stays within its bound" if ratio <= 1 else "not every sample stays within its bound"
    size = f"{number(reduction.bound, 3)} {unit(identification)}".rstrip()
    near = f" The frequency responses differ by at most {size}." if np.isfinite(reduction.bound) else ""
    return (
        f"Order {reduction.order} instead of {identification.order}.{near} Samples:"
        f" {kept} (largest |residual|/bound {number(ratio)}). Status: {reduction.status.value}."
    )

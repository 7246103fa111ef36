"""What a report says, in words and tables, before any medium: text and HTML both print this."""

from __future__ import annotations

from collections import Counter
from typing import Any, NamedTuple

import numpy as np

from robustid.data import FrequencyResponse, TimeRecord
from robustid.errors import Status
from robustid.identification import Identification, Residual, largest_ratio
from robustid.report.poles import delay_words, describe_pole, pole_rows
from robustid.report.style import number

_HZ = 2 * np.pi
_LONG = 100  # letters of a heading
_DIRECTIONS = "combinations of outputs / combinations of inputs"

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


def unit_label(above: str, below: str) -> str:
    """Unit of a quotient in brackets, after a space; empty where neither has one."""
    quotient = _quotient(above, below)
    return f" [{quotient}]" if quotient else ""


def _quotient(above: str, below: str) -> str:
    return f"{above or '1'}/{below}" if below else above


def unit(identification: Identification) -> str:
    """Unit of the transfer function, "mm/N"; empty where neither channel has one, or entries have different ones."""
    problem = identification.problem
    units = {_quotient(y.unit, u.unit) for y in problem.outputs for u in problem.inputs}
    return units.pop() if len(units) == 1 else ""


def mixed(identification: Identification) -> bool:
    """Whether the entries have different units."""
    problem = identification.problem
    return len({y.unit for y in problem.outputs}) > 1 or len({u.unit for u in problem.inputs}) > 1


def transfer(identification: Identification, output: int = 0, input_: int = 0) -> str:
    """Name of an entry of the transfer function, "displacement [mm] / force [N]"."""
    problem = identification.problem
    return f"{problem.outputs[output]} / {problem.inputs[input_]}"


def heading(identification: Identification) -> str:
    """What was identified, for the title of a page."""
    problem = identification.problem
    if problem.entries.single:
        return f"Identification of {transfer(identification)}"
    names = [", ".join(channel.name for channel in group) for group in (problem.inputs, problem.outputs)]
    if sum(map(len, names)) > _LONG:
        names = [f"{len(problem.inputs)} inputs", f"{len(problem.outputs)} outputs"]
    return f"Identification from {names[0]} to {names[1]}"


def where(identification: Identification, residual: Residual) -> str:
    """What of the matrix, or of a record, these residuals are about."""
    problem, (output, input_) = identification.problem, residual.entry
    if residual.kind == "time":
        return str(problem.outputs[output or 0])
    if output is not None and input_ is not None:
        return transfer(identification, output, input_)
    if input_ is not None:
        return f"all outputs / {problem.inputs[input_]}, one bound"
    if isinstance(problem.frequency[residual.index], FrequencyResponse):
        return "all entries, one bound"
    return _DIRECTIONS


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
    tau = problem.dt / np.log(prior.decay_rate)
    words = (
        f"The non-parametric part G satisfies {_size_words(identification)} in |z| < ρ = {number(prior.decay_rate, 6)}"
        f" (z: one sample of delay): its poles lie within |z| ≤ {number(1 / prior.decay_rate, 6)}, and its impulse"
        f" response stays below K ρ⁻ᵏ{'' if problem.entries.single else ' in the same sense'}, a time constant of"
        f" {number(tau, 3)} s."
    )
    if identification.prior != prior:
        words += f" The model itself needs only K = {number(identification.prior.gain_bound)}."
    out = [("Prior", words)]
    if prior.scaling is not None:
        out.append(("Scaling", _scaling_words(identification)))
    if problem.entries.symmetric:
        out.append(
            ("Symmetry", "The response is a symmetric matrix: what one input does at another, that does at this.")
        )
    basis = problem.parametric
    if basis is None:
        out.append(("Parametric part", "None: nothing is known about single modes."))
    else:
        rows = pole_rows(basis.poles, problem.dt)
        times = Counter(describe_pole(row) for row in rows if row.modulus > 0)
        listed = [words if count == 1 else f"{words} ({count} times)" for words, count in times.items()]
        if times.total() < len(rows):  # poles at z = 0
            listed.append(delay_words(basis))
        words = "; ".join(listed) or "none"
        free = "free " if problem.parameter_bounds is None else ""
        kind = "coefficients" if problem.entries.single else "matrices as coefficients"
        out.append(("Parametric part", f"{basis.size} functions with {free}{kind} and fixed poles: {words}."))
    if problem.parameter_bounds is not None:
        out.append(("Intervals", _interval_words(identification)))
    shared = shared_words(identification)
    words = "Every sample lies within its bound of the response of the plant; see the table."
    out.append(("Bounds", f"{words} {shared}".rstrip()))
    return out


def _size_words(identification: Identification) -> str:
    """How K bounds the non-parametric part."""
    prior = identification.problem.prior
    K, what = number(prior.gain_bound), unit(identification)
    if identification.problem.entries.single:
        return f"|G| ≤ K = {K} {what}".rstrip()
    if prior.scaling is not None:
        return f"σmax(G ./ S) ≤ K = {K} (largest singular value, every entry divided by its S)"
    if mixed(identification):
        return f"σmax(G) ≤ K = {K} (largest singular value, in the different units of the entries)"
    return f"σmax(G) ≤ K = {K} {what}".rstrip() + " (largest singular value)"


def _scaling_words(identification: Identification) -> str:
    problem = identification.problem
    rows = problem.prior.scales(len(problem.outputs), len(problem.inputs))
    listed = "; ".join(
        f"{output.name}: {', '.join(number(value) for value in row)}"
        for output, row in zip(problem.outputs, rows, strict=True)
    )
    return f"S, the sizes that count as alike, by output, for {', '.join(u.name for u in problem.inputs)}: {listed}."


def bars_words(identification: Identification) -> str:
    """What is drawn of the frequency samples."""
    words = "Bars are the disc of each sample: magnitude ± bound, and the phases inside it."
    if shared_words(identification):
        words += " Of a bound that entries share they show what it leaves to one entry alone."
    if not all(isinstance(f, FrequencyResponse) for f in identification.problem.frequency):
        words += " Samples of combinations of channels aren’t drawn here; their residuals are, below."
    return words


def shared_words(identification: Identification) -> str:
    """What bounds that several samples share mean; empty where each has its own."""
    return joint_words({getattr(f, "joint", "entry") for f in identification.problem.frequency})


def joint_words(kinds: set[str]) -> str:
    """What the bounds of these kinds (`FrequencyResponse.joint`) mean that several samples share."""
    words = ""
    if "column" in kinds:
        words += (
            " The entries of a column share one bound: the errors of all outputs to one input, each divided by its bound, have a"
            " root sum of squares of at most 1."
        )
    if "matrix" in kinds:
        words += " All entries at a line share one bound: their errors together lie in one ellipsoid."
    return words.strip()


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
    """What was measured, and where the bounds come from: of several channels for each entry or output that has bounds."""
    problem = identification.problem
    given = {"frequency": problem.frequency, "time": problem.time}
    alike: dict[tuple[Any, ...], list[Experiment]] = {}
    for r in identification.residuals:
        row = _experiment(identification, r, given[r.kind][r.index])
        shared = row.channel if r.kind == "frequency" and None in r.entry else ""
        alike.setdefault((r.kind, r.index, row._replace(channel=shared)), []).append(row)
    return [row for rows in alike.values() for row in _together(rows)]


def _together(rows: list[Experiment]) -> list[Experiment]:
    """Entries of one experiment that differ in nothing but their names, in one row."""
    if len(rows) == 1:
        return rows
    if rows[0].channel == _DIRECTIONS:
        return [rows[0]._replace(samples=sum(row.samples for row in rows))]
    what = "outputs" if rows[0].name.startswith("time") else "entries"
    names = "; ".join(row.channel for row in rows)
    named = f": {names}" if len(names) <= _LONG else ""
    return [rows[0]._replace(channel=f"each of {len(rows)} {what}{named}")]


def _experiment(identification: Identification, residual: Residual, data: Any) -> Experiment:
    axis, bound, alone = residual.axis, residual.bound, identification.problem.entries.single
    if getattr(data, "joint", "entry") == "matrix":
        bound = data.bound
    used = bound[np.isfinite(bound)]
    low, high = number(used.min(), 3), number(used.max(), 3)
    radius = f"± {low}" if low == high else f"± {low} … {high}"
    if getattr(data, "joint", "entry") != "entry":
        radius += " for one alone"
    if isinstance(data, TimeRecord):
        symbol, name = "s", f"time record, {started(data)}"
        channel = f"{data.outputs[0]}, input {data.inputs[0]}" if alone else where(identification, residual)
    else:
        if residual.tilt is not None:
            size = np.abs(residual.tilt)
            ends = number((bound / (1 + size)).min(), 3), number((bound / (1 - size)).max(), 3)
            radius = "ellipses, half-axes {} … {}".format(*ends)
        channel, symbol, name = where(identification, residual), "Hz", "frequency response"
        axis = axis / _HZ
    span = f"{number(axis.min())} … {number(axis.max())} {symbol}" if axis.size > 1 else f"{number(axis[0])} {symbol}"
    return Experiment(name, channel, used.size, span, radius, bound_source(data))


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
    channel: str
    place: str
    share: float
    ratio: float


def limiting(identification: Identification) -> list[Limiting]:
    """Samples that limit the margin or contradict each other, with their part in the proof, largest first.

    None where nothing was proved: a margin of 0 has no limiting samples.
    """
    if identification.margin_lower <= 0:
        return []
    rows = []
    for residual, number_, share in identification.limiting():
        at = residual.axis[number_]
        ratio = float(residual.ratio[residual.axis == at].max())  # of repeated lines the worst
        place = f"{number(at / _HZ, 5)} Hz" if residual.kind == "frequency" else f"{number(at, 5)} s"
        experiment = f"{residual.kind} {residual.index + 1}"
        rows.append(Limiting(experiment, where(identification, residual), place, share, ratio))
    return rows


def reduction_words(identification: Identification, reduction: Any) -> str:
    """How small, how near, and whether the samples are still kept."""
    ratio = largest_ratio(identification.problem, reduction.model)
    kept = "every sample stays within its bound" if ratio <= 1 else "not every sample stays within its bound"
    size = f"{number(reduction.bound, 3)} {unit(identification)}".rstrip()
    norm = "" if identification.problem.entries.single else " (largest singular value)"
    near = f" The frequency responses differ by at most {size}{norm}." if np.isfinite(reduction.bound) else ""
    return (
        f"Order {reduction.order} instead of {identification.order}.{near} Samples:"
        f" {kept} (largest |residual|/bound {number(ratio)}). Status: {reduction.status.value}."
    )

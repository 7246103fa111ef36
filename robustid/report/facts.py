"""What a report says, in words and tables, before any medium: text and HTML both print this."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from robustid.data import FrequencyResponse
from robustid.errors import InputError, Status
from robustid.identification import Identification
from robustid.identification.validation import check_model
from robustid.identification.verification import largest_ratio
from robustid.report.style import number

if TYPE_CHECKING:
    import control

# The rounded pole of a (double) integrator lies this close to z = 1.
_INTEGRATOR = 1e-7
_HZ = 2 * np.pi

CAUTION = (
    "These are assumptions. Data can refute them, never prove them: a consistent result says that nothing"
    " measured so far contradicts them."
)


class Verdict(NamedTuple):
    """The result in one word and one sentence; `key` chooses the colour."""

    key: str
    word: str
    sentence: str


@dataclasses.dataclass(frozen=True)
class PoleRow:
    """A real pole or a conjugate pair, in engineer's terms.

    Attributes
    ----------
    pole : complex
        In the plane of the model (z, or s where it is continuous); of a pair the one above the real axis.
    count : int
        1, or 2 for a pair.
    hz : float
        Natural frequency |s|/2π in Hz, s = log(z)/dt; 0 for an integrator, nan for a pole at z = 0.
    damping : float
        -Re(s)/|s|; nan for an integrator.
    modulus : float
        |z|; nan for a continuous model.
    time_constant : float
        -1/Re(s) in s: inf on the stability boundary, negative beyond it.
    """

    pole: complex
    count: int
    hz: float
    damping: float
    modulus: float
    time_constant: float


def pole_table(model: control.StateSpace) -> list[PoleRow]:
    """Poles of a model with their natural frequency, damping and time constant, by frequency.

    ``s = log(z)/dt``, ``hz = |s|/2π``, ``damping = -Re(s)/|s|``.

    Parameters
    ----------
    model : control.StateSpace
        Discrete with its sample time, or continuous.

    Returns
    -------
    list of PoleRow

    Raises
    ------
    InputError, InputTypeError
        If `model` isn't a finite StateSpace, or is discrete without a sample time.

    Examples
    --------
    >>> import control, robustid as rid
    >>> experiment = rid.flexible_structure()
    >>> [(round(row.hz, 2), round(row.damping, 4)) for row in pole_table(experiment.truth)]
    [(9.0, 0.1), (17.67, 0.004)]
    """
    system = check_model("model", model)
    if system.dt is True:
        raise InputError("`model` is discrete without a sample time; give it its dt in s")
    return pole_rows(system.poles(), system.dt or 0)


def pole_rows(poles: Any, dt: float) -> list[PoleRow]:
    """As `pole_table`, from the poles."""
    upper = sorted((complex(p) for p in np.atleast_1d(poles) if p.imag >= 0), key=lambda p: (p.imag, p.real))
    rows = [_pole_row(pole, dt) for pole in upper]
    return sorted(rows, key=lambda row: (np.isnan(row.hz), row.hz))


def _pole_row(pole: complex, dt: float) -> PoleRow:
    count, modulus = 1 + (pole.imag > 0), abs(pole) if dt else np.nan
    if dt and pole == 0:
        return PoleRow(pole, count, np.nan, 1.0, 0.0, 0.0)
    if dt and abs(pole - 1) <= _INTEGRATOR:
        return PoleRow(pole, count, 0.0, np.nan, modulus, np.inf)
    s = complex(np.log(pole)) / dt if dt else pole
    damping = -s.real / abs(s) if s else np.nan
    return PoleRow(pole, count, abs(s) / _HZ, damping, modulus, -1 / s.real if s.real else np.inf)


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
    return Verdict(status.name.lower(), status.name.capitalize(), sentences[status])


def margin_interval(identification: Identification) -> str:
    """The proven interval of the margin."""
    digits = 6 if identification.margin > 1e-3 else 2
    lower, upper = (number(v, digits) for v in (identification.margin_lower, identification.margin))
    return upper if lower == upper else f"{lower} … {upper}"


def margin_words(identification: Identification) -> str:
    """What the margin means here."""
    upper = identification.margin
    meaning = (
        "The margin is the smallest factor on all bounds at which a system of the class still keeps every sample."
        " Its upper end is reached by a system, its lower end is proved by a certificate; both were recomputed"
        " from the numbers."
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
        listed = "; ".join(describe_pole(row) for row in pole_rows(basis.poles, problem.dt))
        out.append(
            ("Parametric part", f"{basis.size} functions with free coefficients and fixed poles: {listed or 'none'}.")
        )
    out.append(("Bounds", "Every sample lies within its bound of the response of the plant; see the table."))
    return out


def describe_pole(row: PoleRow) -> str:
    """One pole in words."""
    if row.hz == 0:
        return "integrator"
    if row.count == 1:
        return f"time constant {number(row.time_constant)} s"
    return f"{number(row.hz)} Hz with damping {number(row.damping, 3)}"


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
        channel, symbol, name = f"{data.outputs[0]} / {data.inputs[0]}", "Hz", "frequency response"
        axis = axis / _HZ
    else:
        channel, symbol, name = f"{data.outputs[0]}, input {data.inputs[0]}", "s", f"time record, {started(data)}"
    span = f"{number(axis.min())} … {number(axis.max())} {symbol}" if axis.size > 1 else f"{number(axis[0])} {symbol}"
    return Experiment(name, channel, axis.size, span, radius, data.note or "not stated")


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

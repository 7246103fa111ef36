"""Assumptions of an identification: the prior, the parametric part, and the experiments with their bounds."""

from __future__ import annotations

from collections import Counter
from typing import NamedTuple

import numpy as np

from robustid.core import Unfinished
from robustid.data import FrequencyResponse, TimeRecord
from robustid.identification import Identification, Residual
from robustid.report.document import Block, Code, Column, Facts, Heading, Table, Text
from robustid.report.identified import DIRECTIONS, mixed, siso, started, unit, where
from robustid.report.poles import delay_words, describe_pole, pole_rows
from robustid.report.words import HZ, SUPERSCRIPT, number

_LONG = 100  # letters of the names in one cell
CHOSEN = "Chosen by the program from these data"
CAUTION = (
    "These are assumptions. Data can refute them, never prove them: a consistent result says that nothing"
    " measured so far contradicts them."
)


def assumptions_section(identification: Identification) -> list[Block]:
    """Build the section of what was assumed, what the program chose, and what was measured."""
    return [
        Heading("What was assumed"),
        Facts(assumptions(identification)),
        *chosen(identification, details=False),
        Text(CAUTION, "caution"),
        Table(
            [
                *(Column("Measured"), Column("Entry or signal", "text"), Column("Samples", "n")),
                *(Column("Range", "whole"), Column("Bound", "whole"), Column("Source of the bound", "text")),
            ],
            [(row.name, row.of, str(row.samples), *row[3:]) for row in experiments(identification)],
        ),
    ]


def chosen(identification: Identification, *, details: bool = True) -> list[Block]:
    """Choices of the program, with their reasons, and with the numbers behind them."""
    choices = [one for one in identification.choices.values() if not isinstance(one.value, Unfinished)]
    if not choices:
        return []
    return [Heading(CHOSEN, 3), *(Code(choice.note if details else choice.reason) for choice in choices)]


def assumptions(identification: Identification) -> list[tuple[str, str]]:
    """Names of the assumptions, with their words."""
    problem, prior = identification.problem, identification.problem.prior
    words = f"The non-parametric part G satisfies {_size_words(identification)} {_region_words(identification)}."
    if prior.physical:
        words = f"The plant F is passive: {_physical_words(identification)} {_region_words(identification)}."
        if problem.functions:
            words = (
                "The plant is passive: a sum of passive modes and of F, which is passive too:"
                f" {_physical_words(identification)} {_region_words(identification)}."
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
    out.append(("Parametric part", _parametric_words(identification)))
    if problem.parameter_bounds is not None and not prior.positive_real:
        out.append(("Intervals", _interval_words(identification)))
    words = "Every sample lies within its bound of the response of the plant; see the table."
    out.append(("Bounds", f"{words} {shared_words(identification)}".rstrip()))
    return out


def _physical_words(identification: Identification) -> str:
    """Say what a passive plant satisfies."""
    prior = identification.problem.prior
    if not prior.positive_real:
        return "|F| ≤ 1 (scattering)" if siso(identification) else "σmax(F) ≤ 1 (scattering)"
    if prior.passive == "negative imaginary":
        return "s F is positive real (force and displacement)" + (
            f" but for {number(-prior.least)}" if prior.least else ""
        )
    least = "0" if not prior.least else f"−{number(-prior.least)}"
    return f"Re F ≥ {least}" if siso(identification) else f"the eigenvalues of its Hermitian part are at least {least}"


def _region_words(identification: Identification) -> str:
    """Words on the region in which the non-parametric part is analytic, and on what follows from it."""
    problem, prior = identification.problem, identification.problem.prior
    if not problem.dt and problem.prior.physical:
        return f"in Re s > −α = −{number(prior.decay, 6)} 1/s, not only on the axis: its poles lie to the left of that line"
    if problem.prior.physical:
        return f"in |z| < ρ = {number(prior.decay_rate, 6)} (z: one sample of delay), not only on the circle"
    if not problem.dt:
        return (
            f"in Re s > −α = −{number(prior.decay, 6)} 1/s: its poles lie to the left of that line, and it decays with a time"
            f" constant of {number(1 / prior.decay, 3)} s or less"
        )
    return (
        f"in |z| < ρ = {number(prior.decay_rate, 6)} (z: one sample of delay): its poles lie within"
        f" |z| ≤ {number(1 / prior.decay_rate, 6)}, and its impulse response stays below"
        f" K ρ⁻ᵏ{'' if siso(identification) else ' in the same sense'}, a time constant of"
        f" {number(problem.dt / np.log(prior.decay_rate), 3)} s"
    )


def _parametric_words(identification: Identification) -> str:
    problem, basis = identification.problem, identification.problem.parametric
    if problem.prior.physical and not problem.functions:
        return "None: the class is about the whole plant."
    if basis is None:
        return "None: nothing is known about single modes."
    rows = pole_rows(basis.in_s().poles, problem.dt)
    times = Counter(describe_pole(row) for row in rows if row.modulus != 0)
    listed = [words if count == 1 else f"{words} ({count} times)" for words, count in times.items()]
    if times.total() < len(rows):  # poles at z = 0
        listed.append(delay_words(basis))
    free = "free " if problem.parameter_bounds is None else ""
    kind = "coefficients" if siso(identification) else "matrices as coefficients"
    return f"{basis.size} functions with {free}{kind} and fixed poles: {'; '.join(listed) or 'none'}."


def _size_words(identification: Identification) -> str:
    """Say how K bounds the non-parametric part."""
    prior = identification.problem.prior
    K, what = number(prior.gain_bound), unit(identification)
    shape = _weight_words(identification)
    if siso(identification):
        return f"|G| ≤ K{' |W|, K' * bool(shape)} = {K} {what}".rstrip() + shape
    name = "σmax(G ./ S)" if prior.scaling is not None else "σmax(G)"
    words = f"{name} ≤ K{' |W|, K' * bool(shape)} = {K}"
    if prior.scaling is not None:
        return f"{words} (largest singular value, every entry divided by its S){shape}"
    if mixed(identification):
        return f"{words} (largest singular value, in the different units of the entries){shape}"
    return f"{words} {what}".rstrip() + f" (largest singular value){shape}"


def _weight_words(identification: Identification) -> str:
    """Words on the weight of the class; empty where it has none."""
    problem, prior = identification.problem, identification.problem.prior
    if not prior.weighted:
        return ""
    if prior.weight is not None:
        return f", W the {str(prior.weight).strip('<>')},"
    power, corner = str(prior.roll_off).translate(SUPERSCRIPT), number(prior.corner / (2 * np.pi), 6)
    shape = f"|1 + jω/ω₀|⁻{power}" if not problem.dt else f"|(1 − a)/(1 − a exp(−jωT))|{power}, a = exp(−ω₀T)"
    return f", |W| = {shape}, ω₀/2π = {corner} Hz,"


def _scaling_words(identification: Identification) -> str:
    problem = identification.problem
    rows = problem.prior.scales(len(problem.outputs), len(problem.inputs))
    listed = "; ".join(
        f"{output.name}: {', '.join(number(value) for value in row)}"
        for output, row in zip(problem.outputs, rows, strict=True)
    )
    return f"S, the sizes that count as alike, by output, for {', '.join(u.name for u in problem.inputs)}: {listed}."


def shared_words(identification: Identification) -> str:
    """Meaning of bounds that several samples share; empty where each has its own."""
    bounds = sorted((f.bound for f in identification.problem.frequency), key=lambda bound: bound.joint)
    return " ".join(dict.fromkeys(words for bound in bounds if (words := bound.shape_words)))


def _interval_words(identification: Identification) -> str:
    """The intervals of the parameters, and which of their ends are reached."""
    problem, words = identification.problem, list[str]()
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
    of: str
    samples: int
    span: str
    bound: str
    source: str


def experiments(identification: Identification) -> list[Experiment]:
    """List what was measured, and where the bounds come from: of a MIMO problem for each entry or output that has bounds."""
    problem = identification.problem
    given = {"frequency": problem.frequency, "time": problem.time}
    alike: dict[tuple[str, int, Experiment], list[Experiment]] = {}
    for r in identification.residuals:
        row = _experiment(identification, r, given[r.kind][r.index])
        shared = row.of if r.kind == "frequency" and None in r.entry else ""
        alike.setdefault((r.kind, r.index, row._replace(of=shared)), []).append(row)
    return [row for (kind, *_), rows in alike.items() for row in _together(kind, rows)]


def _together(kind: str, rows: list[Experiment]) -> list[Experiment]:
    """Entries of one experiment that differ in nothing but their names, in one row."""
    if len(rows) == 1:
        return rows
    if rows[0].of == DIRECTIONS:
        return [rows[0]._replace(samples=sum(row.samples for row in rows))]
    what = "outputs" if kind == "time" else "entries"
    names = "; ".join(row.of for row in rows)
    listed = f": {names}" if len(names) <= _LONG else ""
    return [rows[0]._replace(of=f"each of {len(rows)} {what}{listed}")]


def _experiment(identification: Identification, residual: Residual, data: FrequencyResponse | TimeRecord) -> Experiment:
    axis, bound, alone = residual.axis, residual.bound, siso(identification)
    joint = data.bound.joint
    if joint == "matrix":
        bound = data.bound.radius
    used = bound[np.isfinite(bound)]
    low, high = number(used.min(), 3), number(used.max(), 3)
    radius = f"± {low}" if low == high else f"± {low} … {high}"
    if joint != "entry":
        radius += " for one alone"
    if isinstance(data, TimeRecord):
        symbol, name = "s", "time record"
        of = f"{data.outputs[0]}, input {data.inputs[0]}" if alone else where(identification, residual)
        of += f", {started(data)}"
    else:
        if residual.tilt is not None:
            size = np.abs(residual.tilt)
            ends = number((bound / (1 + size)).min(), 3), number((bound / (1 - size)).max(), 3)
            radius = "ellipses, half-axes {} … {}".format(*ends)
        of, symbol, name = where(identification, residual), "Hz", "frequency response"
        axis = axis / HZ
    span = f"{number(axis.min())} … {number(axis.max())} {symbol}" if axis.size > 1 else f"{number(axis[0])} {symbol}"
    return Experiment(name, of, used.size, span, radius, bound_source(data))


def bound_source(data: FrequencyResponse | TimeRecord) -> str:
    """Kind of the bound of a response or record, and where it comes from."""
    return data.bound.words(data.note or "source not stated")

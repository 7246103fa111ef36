"""What a report says of a guarantee: the sentence, the worst frequencies, the certificates, what is assumed and was tested.

Guaranteed ends are rounded away from what they bound, so that the printed numbers hold too.
"""

from __future__ import annotations

import decimal
from typing import Any, NamedTuple

import numpy as np

from robustid.core import describe, digest
from robustid.errors import InputError, InputTypeError
from robustid.guarantees import WorstCaseError
from robustid.identification import Identification
from robustid.report.facts import CAUTION, Verdict, transfer, unit
from robustid.report.style import number
from robustid.report.worst_case_charts import bounded_model

_HZ = 2 * np.pi
_ROWS = 8  # worst frequencies


def checked(name: str, value: Any, kind: type, function: str, identification: Identification) -> None:
    """Refuse an argument that isn't of its kind, or isn't about this identification or a copy of it (loaded, say)."""
    if not isinstance(value, kind):
        raise InputTypeError(f"`{name}` must be a {kind.__name__}, from {function}(); got {type(value).__name__}")
    if not same(value.identification, identification):
        raise InputError(
            f"`{name}` is about another identification than the one reported; give {name}.identification, or compute"
            f" {function}(identification)"
        )


def same(one: Identification, other: Identification) -> bool:
    """Whether both are one result, as two that were loaded from its files are."""
    if one is other:
        return True
    (first, numbers), (second, others) = describe(one), describe(other)
    return first["problem_digest"] == second["problem_digest"] and digest(numbers) == digest(others)


def at_most(value: float, digits: int = 4) -> str:
    """A number not below the value."""
    return _rounded(value, decimal.ROUND_CEILING, digits)


def at_least(value: float, digits: int = 4) -> str:
    """A number not above the value."""
    return _rounded(value, decimal.ROUND_FLOOR, digits)


def _rounded(value: float, rounding: str, digits: int) -> str:
    if not np.isfinite(value):
        return number(value)
    return number(float(decimal.Context(prec=digits, rounding=rounding).create_decimal_from_float(value)), digits)


def sentence(error: WorstCaseError) -> str:
    """The guarantee in plain words."""
    upper, what, hz = error.sigma_upper, unit(error.identification), error.omega / _HZ
    relative = upper / np.maximum(_response(error), np.finfo(float).tiny)
    norm = "" if error.identification.problem.entries.single else " (largest singular value of the difference)"
    where = (
        f"at {hz.size} frequencies from {number(hz[0])} to {number(hz[-1])} Hz"
        if hz.size > 1
        else f"at {number(hz[0])} Hz"
    )
    worst = f" The largest error is possible at {number(hz[np.argmax(upper)], 5)} Hz;" if hz.size > 1 else ""
    return (
        f"Every plant that agrees with the data and the assumptions has a response within {at_most(upper.max())} {what}".rstrip()
        + f" of the {bounded_model(error)[0]}{norm}, {where}.{worst} the median over the frequencies is"
        f" {at_most(100 * float(np.median(relative)))} % of the response."
    )


def _response(error: WorstCaseError) -> np.ndarray:
    """Size of the response of the model, (F,): its largest singular value."""
    return np.linalg.norm(error.nominal.reshape(error.upper.shape), 2, axis=(1, 2))


def rows(error: WorstCaseError) -> list[tuple[str, str]]:
    """(what, in which words): reach, gap, certificates, the whole circle, what is assumed, what was tested."""
    identification, upper, lower = error.identification, error.sigma_upper, error.sigma_lower
    gap = float(np.max(1 - lower / np.maximum(upper, np.finfo(float).tiny)))
    poles = (
        " The guarantee is conditional on the poles: data that are consistent with them don’t validate them."
        if identification.problem.parametric is not None
        else ""
    )
    return [
        (
            "Reached",
            f"A consistent system was found that is {at_least(lower.max())} {unit(identification)}".rstrip()
            + " away from the model: no bound can be smaller.",
        ),
        (
            "Gap",
            f"The guaranteed errors exceed those that are reached by {at_most(100 * gap)} % of themselves at most.",
        ),
        ("Between the frequencies", circle_words(error)),
        (
            "Assumed",
            f"The class named above: K, ρ{_further(identification)} and the poles of the parametric part; and that every sample"
            f" lies within its bound.{poles} {CAUTION}",
        ),
        (
            "Tested",
            f"That the assumptions and all {identification.problem.samples} samples don’t contradict each other (see the margin);"
            " that every bound follows from its certificate; that the systems said to reach an error keep every sample within"
            " its bound.",
        ),
    ]


def _further(identification: Identification) -> str:
    """What else the class of several channels assumes."""
    problem = identification.problem
    return ", the scaling" * (problem.prior.scaling is not None) + ", the symmetry" * problem.entries.symmetric


def circle_words(error: WorstCaseError) -> str:
    """The bound on the whole circle, where it has been computed; it takes long, and isn't computed here."""
    circle = error.known_circle
    if circle is None:
        return (
            "Nothing is claimed here: the bounds hold at the frequencies. A bound that holds on the whole circle was not"
            " computed (WorstCaseError.hinf)."
        )
    start, what = circle.edges[0] / _HZ, unit(error.identification)
    reach = "the whole circle" if start == 0 else f"all frequencies from {number(start)} Hz on"
    rough = "" if circle.converged else " It was left coarser than asked."
    return (
        f"Over {reach} the error stays below {at_most(circle.largest)} {what}".rstrip()
        + f" (H-infinity norm of plant minus model), by {circle.bound.size} arcs and bounds of the second derivative between their"
        f" ends.{rough}"
    )


def certificates(count: int, hold: bool) -> Verdict:
    """Their number, and whether each supports its bound now."""
    if hold:
        return Verdict(
            "consistent",
            "Proved",
            f"All {count} certificates were evaluated again for this page, without a solver: each supports its bound.",
        )
    return Verdict(
        "failed",
        "Not proved",
        f"Not all of the {count} certificates support their bounds, evaluated again for this page. Don’t rely on these numbers.",
    )


class WorstRow(NamedTuple):
    """One of the worst frequencies, as text."""

    hz: str
    upper: str
    lower: str
    gap: str
    relative: str
    sample: str


def worst_rows(error: WorstCaseError) -> list[WorstRow]:
    """The frequencies with the largest guaranteed errors, largest first."""
    size = dict(zip(error.omega.tolist(), _response(error).tolist(), strict=True))
    return [
        WorstRow(
            number(w / _HZ, 5),
            at_most(high),
            at_least(low),
            f"{number(100 * (1 - low / high), 2)} %" if high else "–",
            f"{at_most(100 * high / size[w])} %" if size[w] else "–",
            sample,
        )
        for w, high, low, sample in error.worst(_ROWS)
    ]


class EntryRow(NamedTuple):
    """The largest guaranteed error of an entry, as text."""

    name: str
    hz: str
    upper: str
    lower: str
    relative: str


def entry_rows(error: WorstCaseError) -> list[EntryRow]:
    """The largest error of every entry; none of one channel."""
    identification, found = error.identification, []
    if identification.problem.entries.single:
        return []
    size = np.abs(error.nominal)
    for i, j in np.ndindex(size.shape[1:]):
        k = int(np.argmax(error.upper[:, i, j]))
        relative = float(np.median(error.upper[:, i, j] / np.maximum(size[:, i, j], np.finfo(float).tiny)))
        found.append(
            EntryRow(
                transfer(identification, i, j),
                number(error.omega[k] / _HZ, 5),
                at_most(error.upper[k, i, j]),
                at_least(error.lower[k, i, j]),
                f"{at_most(100 * relative)} %",
            )
        )
    return found


class ParameterRow(NamedTuple):
    """One coefficient of the parametric part, as text."""

    label: str
    interval: str
    reached: str
    value: str


def parameter_rows(error: WorstCaseError) -> list[ParameterRow]:
    """The interval that holds every coefficient of the parametric part in every consistent system."""
    identification, found = error.identification, error.parameters
    if identification.problem.parametric is None:
        return []
    rows, single = [], identification.problem.entries.single
    values = identification.parameters
    for place in np.ndindex(found.lower.shape):
        label = identification.problem.parametric.labels[place[0]]
        if not single:
            label += f": {transfer(identification, *place[1:])}"
        low, high, value = (float(part[place]) for part in (found.lower, found.upper, values))
        first, last = found.attained[place]
        interval, reached = f"{at_least(low)} … {at_most(high)}", f"{number(first)} … {number(last)}"
        rows.append(ParameterRow(label, interval, reached, number(value)))
    return rows

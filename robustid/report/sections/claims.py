"""Claims that are evaluated again for a report, and what may stand beside an identification in one."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from robustid.core import fingerprint
from robustid.errors import InputError, InputTypeError
from robustid.identification import Check, Identification
from robustid.report.document import Column, Table, Verdict
from robustid.report.words import number


def checks_table(checks: Sequence[Check]) -> Table:
    """Claims with their numbers and limits, and whether they hold."""
    rows = [(check.name, number(check.measured), number(check.limit, 6)) for check in checks]
    columns = [Column("Claim"), Column("Number", "n"), Column("Limit", "n")]
    return Table(columns, rows, marks=[bool(check.holds) for check in checks], title="Verification")


def certificates(count: int, hold: bool, id: str) -> Verdict:
    """Number of the certificates, and whether each supports its bound now."""
    if hold:
        sentence = (
            f"All {count} certificates were evaluated again for this page, without a solver: each supports its bound."
        )
        return Verdict("consistent", "Proved", sentence, id=id)
    sentence = f"Not all of the {count} certificates support their bounds, evaluated again for this page."
    sentence += " Don’t rely on these numbers."
    return Verdict("failed", "Not proved", sentence, id=id)


def kind_of(name: str, value: Any, kinds: Iterable[type]) -> type:
    """Return the kind that an argument is of; refuse one of no kind."""
    for kind in kinds:
        if isinstance(value, kind):
            return kind
    *names, last = (kind.__name__ for kind in kinds)
    wanted = f"{', '.join(names)} or {last}" if names else last
    raise InputTypeError(f"`{name}` must be of class {wanted}; got {type(value).__name__}")


def refuse_foreign(result: Any, given: Iterable[str], belonging: Iterable[str]) -> None:
    """Refuse what doesn't belong to this kind of result."""
    for name in given:
        if name not in belonging:
            raise InputTypeError(f"`{name}` doesn't belong to a {type(result).__name__}; leave it out")


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
    """Return whether both are one result, as two that were loaded from its files are."""
    return one is other or _numbers(one) == _numbers(other)


def _numbers(result: Identification) -> str:
    return fingerprint((result.problem, result.claim, result.coefficients, result.scaled_parameters))

"""Members of a family of plants: what each is proved to be, and under which condition it was measured."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any, cast

import numpy as np

from robustid.core import Frozen, Signal, as_count, as_float, digest, time_words
from robustid.errors import InconsistentDataError, InputError, InputTypeError
from robustid.guarantees.over_poles import Bounded, WorstCaseOverPoles
from robustid.guarantees.worst_case_result import WorstCaseError
from robustid.identification import Identification, prior_fields

CONDITIONS = ("amplitude", "position", "load", "date")
Members = Mapping[str, "Member | Identification | Bounded"] | Sequence["Member | Identification | Bounded"]


@dataclasses.dataclass(frozen=True, eq=False)
class Member(Frozen):
    """One plant of a family: its data with their proof, its name, and the condition under which it was measured.

    Parameters
    ----------
    result : Identification, WorstCaseError or WorstCaseOverPoles
        Of its own data, in the class of the family; of an identification, `family` bounds the values.
    name : str
        Default: its condition, or its number.
    amplitude, position, load : float, optional
        Of the excitation, of the machine, on it: in units of your choice, the same for all members.
    date : str, optional
    poles : pair of (M, 2) arrays, optional
        Pole-uncertainty box of an identification: ends of the natural frequencies in rad/s and of the damping ratios, as in
        `worst_case_over_poles`; the band of the member then covers it.
    delay : int, samples
        Of the pairs, where `poles` are given.

    Raises
    ------
    InputError, InputTypeError
        Another result, a condition that isn't a number, a box for what is bounded already.

    Examples
    --------
    >>> import numpy as np, robustid as rid
    >>> record = rid.TimeRecord(np.eye(1, 2)[0], [0.5, 0.25], dt=1.0, bound=1e-3)
    >>> result = rid.identify(rid.MixedProblem(time=record, prior=rid.Prior(gain_bound=1.0, decay_rate=1.5)))
    >>> rid.guarantee.Member(result, amplitude=0.2).name
    'amplitude 0.2'
    """

    result: Any
    name: str = ""
    _: dataclasses.KW_ONLY
    amplitude: float | None = None
    position: float | None = None
    load: float | None = None
    date: str | None = None
    poles: Any = None
    delay: int = 1

    def __post_init__(self) -> None:
        kinds = (Identification, WorstCaseError, WorstCaseOverPoles)
        if not isinstance(self.result, kinds):
            names = ", ".join(kind.__name__ for kind in kinds)
            raise InputTypeError(f"`result` of a member must be one of {names}; got {type(self.result).__name__}")
        for what in ("name", "date"):
            if not isinstance(getattr(self, what), str | None):
                raise InputTypeError(f"`{what}` of a member must be text; got {getattr(self, what)!r}")
        if self.poles is not None and not isinstance(self.result, Identification):
            raise InputError("`poles` belongs to an Identification: this result is bounded already; leave it out")
        for what in CONDITIONS[:-1]:
            if getattr(self, what) is not None:
                self._set(**{what: as_float(what, getattr(self, what))})
        self._set(delay=as_count("delay", self.delay))
        if not self.name:
            self._set(
                name=", ".join(
                    f"{what} {value:g}" if isinstance(value, float) else str(value)
                    for what, value in self.condition.items()
                )
            )

    @property
    def identification(self) -> Identification:
        """Its data and their proof."""
        return self.result if isinstance(self.result, Identification) else self.result.identification

    @property
    def condition(self) -> dict[str, float | str]:
        """Values of the condition in which the member was measured, by name."""
        return {what: value for what in CONDITIONS if (value := getattr(self, what)) is not None}

    def bounded(self, result: Bounded) -> Member:
        """Return the member with its values bounded."""
        return dataclasses.replace(self, result=result, poles=None)


def as_members(members: object) -> tuple[Member, ...]:
    """Two members or more, each with a name of its own, of one class and of different data, consistent with it.

    InputError, InputTypeError or InconsistentDataError say which members don't fit, and what to do.
    """
    if isinstance(members, Mapping):
        named = cast("Mapping[str, Any]", members)
        found = [_as_member(value, name) for name, value in named.items()]
    elif isinstance(members, Sequence) and not isinstance(members, str):
        found = [_as_member(value, "") for value in cast("Sequence[Any]", members)]
    else:
        raise InputTypeError(
            f"`members` must be a sequence of Member or Identification, or a mapping of names to them; got {type(members).__name__}"
        )
    if len(found) < 2:
        raise InputError(
            f"`members` has {len(found)}: a family is made of two or more, measured under different conditions;"
            " for one plant use worst_case_error"
        )
    found = [m if m.name else dataclasses.replace(m, name=f"member {k}") for k, m in enumerate(found, start=1)]
    names = [m.name for m in found]
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise InputError(
            f"`members`: the name {twice[0]!r} is given to {names.count(twice[0])} of them; give each its own"
        )
    for other in found[1:]:
        _check_alike(found[0], other)
    _check_different(found)
    _check_consistent(found)
    return tuple(found)


def _as_member(value: Member | Identification | Bounded, name: str) -> Member:
    if not isinstance(value, Member):
        return Member(value, name)
    return dataclasses.replace(value, name=name) if name else value


def _check_alike(first: Member, other: Member) -> None:
    """Refuse members of other signals, sample time or class than the first."""
    pair = first.identification.problem, other.identification.problem
    dts = [problem.dt for problem in pair]
    if abs(dts[0] - dts[1]) > 1e-9 * max(dts):
        raise _unlike(first, other, "sample times", time_words(dts[0]), time_words(dts[1]), "resample to one")
    for side in ("outputs", "inputs"):
        one, own = (getattr(problem, side) for problem in pair)
        names = [", ".join(f"{s.name} [{s.unit}]" if s.unit else str(s.name) for s in group) for group in (one, own)]
        if called_otherwise(own, one) is None or [s.unit for s in one] != [s.unit for s in own]:
            raise _unlike(
                first, other, side, names[0], names[1], "a family has the same signals in the same order and units"
            )
    one_class = "a family is one class: identify every member with the same prior, large enough for all"
    priors = [{name: _plain(value) for name, value in prior_fields(p.prior).items()} for p in pair]
    for name in sorted({*priors[0], *priors[1]}):
        if priors[0].get(name) != priors[1].get(name):
            raise _unlike(
                first, other, f"values of {name}", str(priors[0].get(name)), str(priors[1].get(name)), one_class
            )
    sizes = [0 if p.parametric is None else p.parametric.size for p in pair]
    if sizes[0] != sizes[1]:
        one, two = (f"{size} functions" for size in sizes)
        raise _unlike(
            first, other, "parametric parts", one, two, "the poles may differ between members, their number may not"
        )


def called_otherwise(own: Sequence[Signal], first: Sequence[Signal]) -> list[tuple[str, str]] | None:
    """Names of signals that are called otherwise than those at the same place in the first member, each with the name there.

    None where their number is another one, or one of the names stands at another place there: such signals are in another order.
    """
    there = [signal.name for signal in first]
    if len(own) != len(there):
        return None
    pairs = [(signal.name, name) for signal, name in zip(own, there, strict=True) if signal.name != name]
    return None if any(name in there for name, _ in pairs) else pairs


def otherwise_words(name: str, side: str, pairs: Sequence[tuple[str, str]]) -> str:
    """Sentence on signals of a member that are matched by their place."""
    said = ", ".join(f"{own} is taken for {there}" for own, there in pairs)
    return f"The {side} of {name} are called otherwise than those of the first member, and are matched by their place: {said}."


def _unlike(first: Member, other: Member, what: str, one: str, two: str, advice: str) -> InputError:
    return InputError(f"`members` {first.name!r} and {other.name!r} have different {what}: {one} and {two}; {advice}")


def _plain(value: object) -> object:
    return value.tolist() if isinstance(value, np.ndarray) else value


def _check_different(members: Sequence[Member]) -> None:
    """Refuse members that hold the same data."""
    seen: dict[str, str] = {}
    for member in members:
        data = member.identification.problem
        arrays = {
            f"{k}/{name}": np.asarray(part)
            for k, item in enumerate((*data.frequency, *data.time))
            for name in ("omega", "values", "u", "y")
            if (part := getattr(item, name, None)) is not None
        }
        key = digest(arrays)
        if key in seen:
            raise InputError(
                f"`members` {seen[key]!r} and {member.name!r} hold the same data: a band around one plant says nothing of how"
                " plants differ; give data that were measured under different conditions"
            )
        seen[key] = member.name


def _check_consistent(members: Sequence[Member]) -> None:
    """Refuse members whose data refute the class, all of them named."""
    bad = [m for m in members if not m.identification.consistent]
    if bad:
        said = ", ".join(
            f"{m.name!r} ({m.identification.status.name.lower()}, margin {m.identification.margin:.4g})" for m in bad
        )
        worst = max(m.identification.margin for m in bad)
        raise InconsistentDataError(
            f"`members`: {said}: the class has no system that keeps the data of {'it' if len(bad) == 1 else 'these members'} within"
            " their bounds, so that nothing of the family can be bounded; give the same larger prior, or another"
            f" pole, to all, or state bounds {worst:.3g} times as large"
        )

"""One experiment of a problem: its place, the problem without it, and the problem with a correction of it alone."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

from robustid.data import FaultKind, FrequencyResponse
from robustid.errors import InputError
from robustid.estimation import MISTAKES, correct
from robustid.identification import MixedProblem

_SHIFTS = 6  # samples of delay too much, or too little

# Kinds of the corrections that have no number.
_KINDS = {
    "negate": FaultKind.SIGN,
    "conjugate": FaultKind.PHASE_SIGN,
    "transpose": FaultKind.EXCHANGED,
    "exchange": FaultKind.EXCHANGED,
    "times": FaultKind.UNIT,
    "advance": FaultKind.LATE,
    "delay": FaultKind.LATE,
    "integrate": FaultKind.UNIT,
    "differentiate": FaultKind.UNIT,
    "frequency": FaultKind.FREQUENCY_UNIT,
    "phase": FaultKind.PHASE_UNIT,
}
_OF_RESPONSES = (
    "negate", "conjugate", "transpose", "times 0.001", "times 1000", "times 0.5", "times 2", "times 57.29578",
    "times 0.017453293", "times 1e-06", "times 1e+06", "exchange", "integrate", "differentiate", "frequency in Hz",
    "frequency in rad/s", "phase in radians",
)  # fmt: skip
_OF_RECORDS = (
    "negate", "times 0.001", "times 1000", "times 57.29578", "times 0.017453293", "times 1e-06", "times 1e+06", "exchange",
)  # fmt: skip


_NOUNS = {"frequency": "frequency response", "time": "time record"}


class Experiment(NamedTuple):
    """Place of an experiment in a problem: "frequency" or "time", and its number from 0."""

    kind: str
    place: int

    @classmethod
    def named(cls, name: str) -> Experiment:
        """The experiment of a name such as "time 1"."""
        kind, number = name.split()
        return cls(kind, int(number) - 1)

    @property
    def name(self) -> str:
        """Its name in a run file, such as "time 1"."""
        return f"{self.kind} {self.place + 1}"

    def of(self, problem: MixedProblem) -> Any:
        """The data of the experiment."""
        return getattr(problem, self.kind)[self.place]

    def replaced(self, problem: MixedProblem, item: Any) -> MixedProblem:
        """The problem with other data in its place."""
        items = list(getattr(problem, self.kind))
        items[self.place] = item
        return dataclasses.replace(problem, **{self.kind: items, "faults": ()})

    def called(self, problem: MixedProblem) -> str:
        """Noun and number of it, for sentences."""
        return f"{_NOUNS[self.kind]} {self.place + 1}" if self.several(problem) else f"the {_NOUNS[self.kind]}"

    def several(self, problem: MixedProblem) -> bool:
        """Tell whether there are several of its kind."""
        return len(getattr(problem, self.kind)) > 1

    def change(self, problem: MixedProblem, correction: str) -> tuple[str, str]:
        """Spelling of a correction of it in Python, and for the program."""
        name, section = ("record", "record") if self.kind == "time" else ("frf", "frequency")
        change = f'{name} = rid.prepare.correct({name}, "{correction}")'
        if self.several(problem):
            return f"of {self.called(problem)}: {change}", f'correct = ["{correction}"] in its [[{section}]]'
        return change, f'--{self.kind}-correct "{correction}"'

    def corrected(self, problem: MixedProblem, correction: str) -> MixedProblem | None:
        """The problem with a correction of this experiment alone; None where it does not go with the data."""
        try:
            return self.replaced(problem, correct(self.of(problem), correction))
        except InputError:
            return None


def experiments(problem: MixedProblem) -> tuple[Experiment, ...]:
    """All experiments of a problem."""
    sorts = ("frequency", problem.frequency), ("time", problem.time)
    return tuple(Experiment(kind, k) for kind, items in sorts for k in range(len(items)))


def without_experiments(problem: MixedProblem, left_out: Sequence[Experiment]) -> MixedProblem:
    """The problem without some experiments; InputError where the others do not make one."""
    kept = {
        kind: [item for k, item in enumerate(getattr(problem, kind)) if Experiment(kind, k) not in left_out]
        for kind in ("frequency", "time")
    }
    return dataclasses.replace(problem, **kept, faults=())


class Correction(NamedTuple):
    """A correction, what it undoes in words, its kind and the number in it."""

    correction: str
    words: str
    kind: FaultKind
    size: float | None = None


def corrections_for(item: Any) -> Iterator[Correction]:
    """Corrections that can be tried on one experiment: of sign, phase and unit, then of delay."""
    if isinstance(item, FrequencyResponse):
        noun, tried = "response", _OF_RESPONSES
        if item.values.shape[1:] == (1, 1):
            tried = tuple(one for one in tried if one != "transpose")
    else:
        noun, tried = "record", _OF_RECORDS
    for one in tried:
        yield Correction(one, MISTAKES[one].replace("response", noun), _KINDS[one.split()[0]])
    if item.dt:
        for samples in range(1, _SHIFTS + 1):
            many = f"{samples} sample{'s' * (samples > 1)} of delay too"
            yield Correction(f"advance {samples}", f"the {noun} has {many} much", FaultKind.LATE, float(samples))
            yield Correction(f"delay {samples}", f"the {noun} has {many} little", FaultKind.LATE, -float(samples))

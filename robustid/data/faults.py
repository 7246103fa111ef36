"""Fault of measured data: its kind, where it is and how large, in words, and what undoes it."""

from __future__ import annotations

import enum
from collections.abc import Iterable, Sequence
from typing import Any, Literal, NamedTuple

from robustid.errors import InputTypeError


class FaultKind(enum.StrEnum):
    """Kind of a fault of records, of responses, or of the arrays of a file."""

    CONSTANT = "constant"
    SATURATED = "saturated"
    STUCK = "stuck"
    UNSTATED_PERIOD = "unstated period"
    WRONG_PERIOD = "wrong period"
    FEEDBACK = "feedback"
    DRIFT = "drift"  # removed, where periods show it
    DISTURBED = "disturbed"  # one record among others
    NOISY_INPUT = "noisy input"
    FREQUENCY_UNIT = "frequency unit"
    PHASE_SIGN = "phase sign"
    PHASE_UNIT = "phase unit"
    MAGNITUDE_UNIT = "magnitude unit"
    EXCHANGED = "exchanged"  # input and output
    SMALL_BOUND = "small bound"
    NOT_FINITE = "not finite"
    TWO_SIDED = "two-sided"
    UNSTABLE = "unstable"  # an output that grows without end
    SPIKE = "spike"
    WRAPPED = "wrapped"  # beyond the range of an integer, to its other end
    LOST = "lost samples"
    HELD = "held"  # an output, at a lower rate than that of the record
    QUANTISED = "quantised"
    NO_RESPONSE = "no response"  # an output that the input doesn't move
    TONE = "tone"  # hum, and whatever stands out of its neighbours in frequency
    JUMP = "jump"  # of the level, in time
    OFFSET = "offset"  # a point of operation from which nothing is counted
    TRANSIENT = "transient"
    LATE = "late"  # a channel, by samples
    DELAY = "delay"  # that nobody stated: a channel that comes late, or the plant's
    CLOCK = "clock"  # of the output, unlike that of the input
    JITTER = "jitter"
    OTHER_PLANT = "other plant"
    VARYING = "varying"  # the response, within the record
    SIGN = "sign"
    UNIT = "unit"
    SAMPLE_TIME = "sample time"
    NOT_AT_REST = "not at rest"
    OUTLIER = "outlier"  # a frequency point, or a sample, against all others
    SEAM = "seam"  # between two parts of the frequency axis
    NOISE_ONLY = "noise only"  # frequency points that nothing excited
    CONTROLLER = "controller"  # that ran, unlike the stated one
    EXCITATION = "excitation"  # of a loop, at another place
    NO_REFERENCE = "no reference"


# Kinds that a response shows by itself.
_OF_RESPONSES = frozenset(
    {
        FaultKind.FREQUENCY_UNIT,
        FaultKind.PHASE_SIGN,
        FaultKind.PHASE_UNIT,
        FaultKind.MAGNITUDE_UNIT,
        FaultKind.SMALL_BOUND,
        FaultKind.OUTLIER,
        FaultKind.SEAM,
        FaultKind.NOISE_ONLY,
    }
)


class Fault(NamedTuple):
    """Probable fault of measured data; as text one sentence for people.

    Attributes
    ----------
    kind : FaultKind
    words : str
        What is wrong.
    evidence : str
        What shows it; "" where the words do.
    correction : str
        What undoes it (see `correct`); "" where none of its corrections does.
    where : str
        The signals, such as ``"output y"``; "" for the whole.
    record : int
        Number of the record among several, from 1; 0 for all, or the only one.
    size : float, optional
        The number that the words state: samples, a share, or how many times too large or small.
    response : int
        Number of the frequency response that contradicts other experiments, from 1; 0 for any other fault.

    Examples
    --------
    >>> import robustid as rid
    >>> (fault,) = rid.prepare.record_faults(rid.TimeRecord([1.0, 0.0, 2.0], [3.0, 3.0, 3.0], dt=1.0))
    >>> print(fault)
    output y is constant (3): a sensor that is not connected, or saturated
    >>> fault.kind == "constant", fault.where
    (True, 'output y')
    """

    kind: FaultKind
    words: str
    evidence: str = ""
    correction: str = ""
    where: str = ""
    record: int = 0
    size: float | None = None
    response: int = 0

    def __str__(self) -> str:
        return self.said()

    def said(self, by: str = "") -> str:
        """Return the sentence, with what takes the correction before it, such as ", --frequency-correct"."""
        return self.said_alone + (f'{by} "{self.correction}"' if self.correction else "")

    @property
    def said_alone(self) -> str:
        """The sentence without the correction."""
        return self.cause + (f": {self.evidence}" if self.evidence else "")

    @property
    def cause(self) -> str:
        """The fault, with the number of its experiment."""
        of = f"record {self.record}: " if self.record else ""
        of = f"frequency response {self.response}: " if self.response else of
        return f"{of}{self.words}"

    @property
    def asks(self) -> bool:
        """True for what may be right: a question, which a statement or the correction answers."""
        return self.kind is FaultKind.DELAY

    @property
    def heading(self) -> str:
        """Words that come before it."""
        return "Question about the data" if self.asks else "Fault of the data"

    @property
    def step(self) -> str:
        """Words that come before what undoes it."""
        return "Take the delay out, where a channel comes late" if self.asks else "Undo the fault of the data"

    @property
    def of_records(self) -> bool:
        """True for what records show, also where a response brings it: their correction is theirs, not that of the response."""
        return self.record > 0 or (bool(self.where) and self.kind not in _OF_RESPONSES)

    @property
    def undone(self) -> bool:
        """True for what the estimate from the records has removed: it contradicts nothing any more."""
        return self.kind is FaultKind.DRIFT and not self.correction


class PlacedFault(NamedTuple):
    """Fault with the experiment of a problem that it is of: of its responses or of its records, by number from 0.

    `number` is None where a fault is of several records together.
    """

    fault: Fault
    kind: Literal["frequency", "time"]
    number: int | None


class Undoing(NamedTuple):
    """Text that undoes a fault where it is pasted: a command; or a line, its place in a file, and the command that follows."""

    fault: Fault
    paste: str
    place: str = ""
    then: str = ""

    @property
    def said(self) -> str:
        """One sentence with all of it."""
        what = self.fault.step
        if not self.place:
            return f"{what}: {self.paste}"
        return f"{what}: {self.paste} in {self.place}; then {self.then}"


def as_faults(value: Iterable[Sequence[Any]]) -> tuple[Fault, ...]:
    """Faults, also as their parts, which files hold."""
    try:
        given: list[tuple[str, list[Any]]] = [(kind, parts) for kind, *parts in value]
        if all(isinstance(text, str) for _, parts in given for text in parts[:4]):
            return tuple(Fault(FaultKind(kind), *parts) for kind, parts in given)
    except (TypeError, ValueError):
        pass
    raise InputTypeError(f"`faults` must be a sequence of Fault; got {value!r}")

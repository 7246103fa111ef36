"""Faults of the data before anything that was made of them: the verdict on the first one, and the others."""

from __future__ import annotations

from collections.abc import Sequence

from robustid.data import Fault, FaultKind, FrequencyResponse
from robustid.estimation import all_faults
from robustid.identification import MixedProblem
from robustid.report.document import Text, Verdict

_LEAVE_OUT = "leave out "
# Kinds that only responses have, whether or not they were estimated from records.
_OF_RESPONSES = (
    FaultKind.FREQUENCY_UNIT,
    FaultKind.PHASE_SIGN,
    FaultKind.PHASE_UNIT,
    FaultKind.MAGNITUDE_UNIT,
    FaultKind.SMALL_BOUND,
)


def fault_verdict(
    faults: Sequence[Fault], *, estimated: bool = False, problem: MixedProblem | None = None
) -> list[Verdict]:
    """The verdict on data with a fault that nothing has undone, with what undoes it; none where there is no such fault.

    `estimated`: the response was estimated from records. `problem`: whose experiments the faults may be of.
    """
    open_ = [fault for fault in faults if not fault.undone]
    if not open_:
        return []
    first = open_[0]
    said = f"{first.said_alone[0].upper()}{first.said_alone[1:]}."
    if first.correction:
        own = problem is not None and (first in problem.faults or first in problem.record_faults)
        said += f" {_undoing_of(first, problem) if own and problem else undoing(first, estimated)}"
    said += f" And {len(open_) - 1} more: see below." if len(open_) > 1 else ""
    return [Verdict("undecided", "Fault of the data", said, id="data-fault")]


def _undoing_of(fault: Fault, problem: MixedProblem) -> str:
    """Say what undoes a fault of one experiment among those of a problem."""
    words = fault.correction
    if fault.response and getattr(problem.frequency[fault.response - 1], "dof", None) is not None:
        return f'To undo it: rid.prepare.correct(frf, "{words}") of the response.'
    name, several = ("frequency", problem.frequency) if fault.response else ("time", problem.time)
    section = "frequency" if fault.response else "record"
    if len(several) > 1:
        return (
            f'To undo it: correct = ["{words}"] in its [[{section}]] of a run file, or rid.prepare.correct in Python.'
        )
    return f'To undo it: --{name}-correct "{words}" on the command line, correct = ["{words}"] in a run file.'


def undoing(fault: Fault, estimated: bool) -> str:
    """Say what undoes a fault, as it is pasted into a command or a run file."""
    words, points = fault.correction, fault.correction.startswith(_LEAVE_OUT)
    hz = words.removeprefix(_LEAVE_OUT).split()
    if estimated and points and not {"above", "below"} & set(hz):
        return f"To undo it: leave_out_hz = [{', '.join(hz)}] of [frequency_points] in a run file."
    if estimated and (points or fault.kind in _OF_RESPONSES):
        return f'To undo it: rid.prepare.correct(frf, "{words}") of the response.'
    name = "time" if estimated else "frequency"
    return f'To undo it: --{name}-correct "{words}" on the command line, correct = ["{words}"] in a run file.'


def further_faults(faults: Sequence[Fault]) -> list[str]:
    """Sentences on the faults beside the one that the verdict is on."""
    open_ = [fault for fault in faults if not fault.undone]
    return [f"Fault of the data: {fault}." for fault in faults if fault not in open_[:1]]


def problem_verdict(problem: MixedProblem) -> list[Verdict]:
    """The verdict on faults of the data of a problem."""
    responses = [one for one in problem.frequency if isinstance(one, FrequencyResponse)]
    estimated = any(one.dof is not None for one in responses)
    return fault_verdict(problem.data_faults, estimated=estimated, problem=problem)


def problem_warnings(problem: MixedProblem) -> list[Text]:
    """Warnings of the other faults."""
    return [Text(sentence, "warning") for sentence in further_faults(problem.data_faults)]


def faults_of_response(frf: FrequencyResponse) -> tuple[Fault, ...]:
    """Faults of the records of a response, and of itself, each once."""
    return tuple({str(fault): fault for fault in all_faults(frf)}.values())

"""Faults of the data before anything that was made of them: the verdict on the first one, and the others."""

from __future__ import annotations

from collections.abc import Sequence

from robustid.data import Fault, FrequencyResponse
from robustid.estimation import response_faults
from robustid.identification import MixedProblem
from robustid.report.document import Text, Verdict

_LEAVE_OUT = "leave out "


def fault_verdict(
    faults: Sequence[Fault], of_records: Sequence[Fault] = (), *, estimated: bool = False
) -> list[Verdict]:
    """The verdict on data with a fault that nothing has undone, with what undoes it; none where there is no such fault.

    `of_records`: those among them that records show; `estimated`: the response was estimated from records.
    """
    open_ = [fault for fault in faults if not fault.undone]
    if not open_:
        return []
    first = open_[0]
    said = f"{first.said_alone[0].upper()}{first.said_alone[1:]}."
    points = first.correction.startswith(_LEAVE_OUT)  # of the response, whoever found it
    said += f" {undoing(first, first in of_records and not points, estimated)}" if first.correction else ""
    said += f" And {len(open_) - 1} more: see below." if len(open_) > 1 else ""
    return [Verdict("undecided", "Fault of the data", said, id="data-fault")]


def undoing(fault: Fault, of_records: bool, estimated: bool) -> str:
    """Say what undoes a fault, as it is pasted into a command or a run file."""
    name, words = "time" if of_records else "frequency", fault.correction
    pasted = f'To undo it: --{name}-correct "{words}" on the command line, correct = ["{words}"] in a run file.'
    if of_records or not estimated:
        return pasted
    hz = fault.correction.removeprefix(_LEAVE_OUT).split()
    if fault.correction.startswith(_LEAVE_OUT) and not {"above", "below"} & set(hz):
        return f"To undo it: leave_out_hz = [{', '.join(hz)}] of [frequency_points] in a run file."
    return pasted


def further_faults(faults: Sequence[Fault]) -> list[str]:
    """Sentences on the faults beside the one that the verdict is on."""
    open_ = [fault for fault in faults if not fault.undone]
    return [f"Fault of the data: {fault}." for fault in faults if fault not in open_[:1]]


def problem_verdict(problem: MixedProblem) -> list[Verdict]:
    """The verdict on faults of the data of a problem."""
    responses = [one for one in problem.frequency if isinstance(one, FrequencyResponse)]
    records = [fault for one in responses for fault in one.faults]
    return fault_verdict(problem.data_faults, records, estimated=any(one.dof is not None for one in responses))


def problem_warnings(problem: MixedProblem) -> list[Text]:
    """Warnings of the other faults."""
    return [Text(sentence, "warning") for sentence in further_faults(problem.data_faults)]


def faults_of_response(frf: FrequencyResponse) -> tuple[Fault, ...]:
    """Faults of the records of a response, and of itself, each once."""
    return tuple({str(fault): fault for fault in (*frf.faults, *response_faults(frf))}.values())

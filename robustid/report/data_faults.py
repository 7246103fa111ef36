"""Faults of the data before anything that was made of them: the verdict on the first one, what undoes it, and the others."""

from __future__ import annotations

from collections.abc import Sequence

from robustid.data import Fault, FrequencyResponse, PlacedFault, Undoing
from robustid.estimation import all_faults
from robustid.identification import MixedProblem
from robustid.report.document import Text, Verdict

_SETTLE = "Settle the fault of the data first: all that follows from data with a fault is no better than they are."


def fault_verdict(faults: Sequence[Fault]) -> list[Verdict]:
    """The verdict on data with a fault that nothing has undone, with where it is and what undoes it; none without such a fault."""
    open_ = [fault for fault in faults if not fault.undone]
    if not open_:
        return []
    first = open_[0]
    record = [f"record {first.record}"] if first.record else []
    record = [f"frequency response {first.response}"] if first.response else record
    place = ", ".join([*([first.where] if first.where else []), *record])
    numbers = [("where", place)] if place else []
    numbers += [("undone by", f'"{first.correction}"')] if first.correction else []
    numbers += [("further faults", f"{len(open_) - 1}, see the warnings")] if len(open_) > 1 else []
    said = f"{first.words[0].upper()}{first.words[1:]}{':' if first.evidence else '.'}"
    more = f"{first.evidence}." if first.evidence else ""
    return [Verdict("undecided", first.heading, said, tuple(numbers), id="data-fault", ahead=True, more=more)]


def steps_with_faults(faults: Sequence[PlacedFault], undoing: Undoing | None, others: Sequence[Text]) -> list[Text]:
    """The next steps: with a fault of the data what undoes it, before which no other step makes sense; the others without."""
    if all(one.fault.undone for one in faults):
        return list(others)
    return undoing_steps(faults, undoing) or [Text(_SETTLE), *others]


def undoing_steps(faults: Sequence[PlacedFault], undoing: Undoing | None) -> list[Text]:
    """The step that undoes a fault of the data, as it is pasted, or else the correction and what takes it; none without one."""
    if undoing is not None:
        return [Text(undoing.said, code=(undoing.paste, undoing.then) if undoing.then else (undoing.paste,))]
    first = next((one for one in faults if one.fault.correction and not one.fault.undone), None)
    if first is None:
        return []
    fault, of_record = first.fault, first.kind == "time" or first.fault.of_records
    data, flag = ("record", "--time-correct") if of_record else ("response", "--frequency-correct")
    words = f'rid.prepare.correct({data}, "{fault.correction}")'
    option, line = f'{flag} "{fault.correction}"', f'correct = ["{fault.correction}"]'
    return [Text(f"{fault.step}: {words}; {option}; or {line} in a run file.", code=(words, option, line))]


def further_faults(faults: Sequence[Fault]) -> list[str]:
    """Sentences on the faults beside the one that the verdict is on."""
    open_ = [fault for fault in faults if not fault.undone]
    return [f"{fault.heading}: {fault}." for fault in faults if fault not in open_[:1]]


def problem_verdict(problem: MixedProblem) -> list[Verdict]:
    """The verdict on faults of the data of a problem."""
    return fault_verdict(problem.data_faults)


def problem_warnings(problem: MixedProblem) -> list[Text]:
    """Warnings of the other faults."""
    return [Text(sentence, "warning") for sentence in further_faults(problem.data_faults)]


def shown_faults(problems: Sequence[MixedProblem]) -> list[Verdict | Text]:
    """The verdict on faults of the data of several problems, and warnings of the others, each fault once."""
    faults = list({str(fault): fault for problem in problems for fault in problem.data_faults}.values())
    return [*fault_verdict(faults), *(Text(sentence, "warning") for sentence in further_faults(faults))]


def placed(frf: FrequencyResponse) -> list[PlacedFault]:
    """Faults of a response alone, as those of a problem are placed."""
    return [PlacedFault(fault, "frequency", 0) for fault in faults_of_response(frf)]


def faults_of_response(frf: FrequencyResponse) -> tuple[Fault, ...]:
    """Faults of the records of a response, and of itself, each once."""
    return tuple({str(fault): fault for fault in all_faults(frf)}.values())

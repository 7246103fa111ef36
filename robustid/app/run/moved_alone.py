"""Records that were measured one input after the other: of the inputs that a record does not name it says that they rest."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from robustid.data import TimeRecord


def with_all_inputs(records: Sequence[TimeRecord]) -> tuple[list[TimeRecord], str]:
    """The records with every input that one of them names, zero where it is another's, and a sentence; else as they are.

    So it is where all have the same outputs, and none of one record's inputs is named like one of another's.
    """
    every = [tuple(one.name for one in record.inputs) for record in records]
    groups = list(dict.fromkeys(every))
    names = [name.lower() for group in groups for name in group]
    outputs = {tuple(one.name for one in record.outputs) for record in records}
    unnamed = any(name[:1] == "u" and not name[1:].strip("0123456789") for name in names)
    if len(groups) < 2 or len(outputs) > 1 or len(set(names)) < len(names) or unnamed:
        return list(records), ""
    signals = [next(one for one in records if tuple(s.name for s in one.inputs) == group).inputs for group in groups]
    inputs, starts = [signal for group in signals for signal in group], np.cumsum([0, *map(len, groups)])
    made: list[TimeRecord] = []
    for record, group in zip(records, every, strict=True):
        first = starts[groups.index(group)]
        u = np.zeros((len(record.u), len(inputs)))
        u[:, first : first + len(group)] = record.u
        made.append(dataclasses.replace(record, u=u, inputs=inputs))
    said = ", then ".join(" and ".join(group) for group in groups)
    return made, f"the records move {said}: each input is taken to rest where another is moved"

"""Causes that lie in single experiments: faults that the others show, each with the margin once all of them are undone."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence

from robustid.advice.causes import Cause, judged_margin
from robustid.advice.experiment_corrections import Experiment
from robustid.core import Budget
from robustid.data import Fault
from robustid.errors import InputError
from robustid.identification import MixedProblem


def causes_of_experiments(problem: MixedProblem, faults: Sequence[Fault], margin: float, budget: Budget) -> list[Cause]:
    """Causes that are faults of single experiments; their corrections are tried together."""
    if not faults:
        return []
    changed: MixedProblem | None = problem
    for fault in faults:
        if fault.correction and changed is not None:
            changed = _place(fault).corrected(changed, fault.correction)
    after = None
    if changed is not None and changed is not problem:
        with contextlib.suppress(InputError):
            after = judged_margin(changed, 1.0, budget)
    causes: list[Cause] = []
    for fault in faults:
        if not fault.correction or changed is None or after is None:
            causes.append(Cause(fault.cause, "", "", problem, evidence=fault.evidence))
            continue
        change, option = _place(fault).change(problem, fault.correction)
        shown = f"with the correction the margin is {after:.3g} in place of {margin:.4g}"
        causes.append(Cause(fault.cause, change, option, changed, evidence=shown, margin=after))
    return causes


def _place(fault: Fault) -> Experiment:
    """The experiment that a fault is of."""
    return (
        Experiment("frequency", fault.response - 1) if fault.response else Experiment("time", max(fault.record - 1, 0))
    )

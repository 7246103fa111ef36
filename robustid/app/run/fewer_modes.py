"""Modes that the program chose and that the data cannot tell apart: left out, the least important first; stated ones never."""

from __future__ import annotations

import dataclasses

import numpy as np

from robustid.app.run.settings import Modes
from robustid.bases import FunctionKind
from robustid.core import Record, hz_words
from robustid.identification import MixedProblem, told_apart_functions

_BY_MODE = ("hz", "damping", "hz_interval", "damping_interval")
_WORDS = "Left out, because the data cannot tell it apart from the others"
INTEGRATOR = -1  # in place of the number of a mode


def without_dependent(modes: Modes, asked: Modes, problem: MixedProblem) -> Modes | None:
    """The modes without the one that `superfluous` names, which their note says; None where it names none."""
    number = superfluous(modes, asked, problem)
    return None if number is None else without_mode(modes, number)


def superfluous(modes: Modes, asked: Modes, problem: MixedProblem) -> int | None:
    """Number of the mode, among those that the program chose (`asked` are the stated ones), that takes part in a linear
    dependence on the samples of a problem and does the least there; `INTEGRATOR` for the highest integrator. None where the
    data tell all functions apart, or none of them was chosen.
    """
    basis = problem.parametric
    if asked.hz is not None or basis is None or any(f.kind is FunctionKind.PASSIVE for f in basis.functions):
        return None
    functions = _functions(modes)
    found = told_apart_functions(problem)
    chosen = {k: own for k, own in functions.items() if k != INTEGRATOR or modes.integrators > asked.integrators}
    if (found.complete and not found.dependent.any()) or not chosen:
        return None
    involved = {k: own for k, own in chosen.items() if found.dependent[own].any()} or chosen
    return min(involved, key=lambda k: float(np.linalg.norm(found.parts[:, involved[k]].sum(axis=1))))


def without_mode(modes: Modes, number: int) -> Modes:
    """The modes without one of them, or without the highest integrator."""
    if number == INTEGRATOR:
        kind = "double integrator" if modes.integrators == 2 else "integrator"
        note = f"{modes.note}\n{_WORDS}: the {kind}."
        return dataclasses.replace(modes, integrators=modes.integrators - 1, note=note)
    hz, damping = (modes.hz or ())[number], (modes.damping or ())[number]
    note = f"{modes.note}\n{_WORDS}: {hz_words(hz)}, damping {damping:.3g}."
    return dataclasses.replace(modes, **without_number(modes, number), note=note)


def without_number(stated: object, number: int) -> Record:
    """Frequencies, damping ratios and boxes, of modes or of a member, without those of one mode."""
    kept = {name: getattr(stated, name) for name in _BY_MODE}
    return {name: None if values is None else values[:number] + values[number + 1 :] for name, values in kept.items()}


def _functions(modes: Modes) -> dict[int, list[int]]:
    """Numbers of the functions of every mode in the basis, and of the highest integrator."""
    at = modes.integrators
    functions = {INTEGRATOR: [at - 1]} if at else {}
    for k, damping in enumerate(modes.damping or ()):
        count = modes.repeat * (1 if damping == 1 else 2)
        functions[k] = list(range(at, at + count))
        at += count
    return functions

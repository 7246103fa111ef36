"""Choosing the finite formulation of a problem: by name, by the least work, over a horizon, or as it was saved."""

from __future__ import annotations

import math
from collections.abc import Sequence

from robustid.bases import Sections
from robustid.errors import InputError, Remedy, SizeError
from robustid.identification.formulation.base import LARGEST_EXACT, Formulation
from robustid.identification.formulation.classical import ClassicalFormulation
from robustid.identification.formulation.exact import ExactFormulation
from robustid.identification.formulation.passive import PassiveFormulation
from robustid.identification.formulation.sections import SectionsFormulation, of_sections
from robustid.identification.formulation.taylor import LONGEST_TAYLOR, TaylorFormulation, taylor_length
from robustid.identification.problem import MixedProblem

_KINDS = {kind.name: kind for kind in (ExactFormulation, ClassicalFormulation, TaylorFormulation, SectionsFormulation)}
FORMS = ("auto", *_KINDS)

_QUICK = 5e8  # multiplications per Newton step up to which no other form is looked for: a second in all
_FINITE = 1e300  # multiplications: beyond are those of forms that are too large
_CLEARLY = 0.5  # of the work of the other forms: what sections may take
_MANY, _FAR_LESS = 60, 0.03  # coefficients of an exact form that is slow in bounds; of its work what replaces it takes
_BALANCE = 30  # measured: n coefficients of the exact form (n^4 work a step) take as long as n^2/30 Taylor coefficients


def formulate(problem: MixedProblem, form: str = "auto", accuracy: float = 1e-4) -> Formulation:
    """The formulation that is called `form`, with tails below a tenth of the accuracy."""
    # "auto" takes the exact form while it is quick, then the form with the least work; sections only where they clearly save,
    # for MIMO only where the others are too large: far from the frequency points their tails are as large as the class.
    if problem.prior.positive_real:
        if form not in ("auto", PassiveFormulation.name):
            raise InputError(
                f'`form` = "{form}" does not take PositiveReal classes; take "auto" or "{PassiveFormulation.name}"'
            )
        found = PassiveFormulation(problem)
    elif form == "auto":
        found = _quickest(problem, accuracy)
    elif not _KINDS[form].takes(problem):
        raise InputError(f'`form` = "{form}" {_KINDS[form].refusal(problem)}')
    else:
        found = _KINDS[form].within(problem, accuracy)
    found.check_size(accuracy)
    return found


def _quickest(problem: MixedProblem, accuracy: float) -> Formulation:
    exact = ExactFormulation(problem)
    if exact.quick:
        return exact
    others = [TaylorFormulation.within(problem, accuracy)] if TaylorFormulation.takes(problem) else []
    best = min((*others, exact), key=lambda form: form.work)
    if best.work > (_QUICK if problem.entries.single else _FINITE):
        found = SectionsFormulation.within(problem, accuracy)
        if found.work < _CLEARLY * best.work:
            return found
        if math.isinf(best.work) and math.isinf(found.work):
            raise _too_large([exact, *others, found], accuracy)
    return best


def _too_large(forms: Sequence[Formulation], accuracy: float) -> SizeError:
    """Say what every form would need, and the ways out."""
    problem = forms[0].problem
    needs = "; ".join(form.size_words for form in forms)
    ports = "" if problem.entries.single else "single entries (frf.entry(output, input)), "
    return SizeError(
        f"`problem` is too large for every form of the class at accuracy {accuracy:g} and {problem.prior.decay_words}: {needs}. ",
        Remedy(
            {},
            f"A larger decay, less accuracy, {ports}lightly damped modes in `parametric`, or less data make it smaller: thin the"
            " data, frf.select(slice(None, None, step)), or take a narrower band or a shorter record",
        ),
    )


def lightest(formulation: Formulation, accuracy: float) -> Formulation:
    """A finite form of the same problem where an exact one of many coefficients takes many times its work; else as it is.

    Bounds solve one problem after the other: a slow exact form that is one solution's matter of a second takes minutes there.
    """
    problem = formulation.problem
    if not (formulation.exact and problem.entries.single) or problem.prior.positive_real or formulation.count < _MANY:
        return formulation
    kind = TaylorFormulation if TaylorFormulation.takes(problem) else SectionsFormulation
    finite = kind.within(problem, accuracy)
    return finite if finite.work < _FAR_LESS * formulation.work else formulation


def formulate_over(problem: MixedProblem, horizon: int, accuracy: float) -> Formulation | None:
    """The smaller formulation that determines a number of Taylor coefficients; None where none is small enough."""
    exact = ExactFormulation(problem, max(horizon, problem.taylor))
    length = max(horizon, taylor_length(problem, accuracy))
    count = exact.count - exact.determined + horizon
    if count <= LARGEST_EXACT and count**2 <= _BALANCE * length:
        return exact
    return TaylorFormulation(problem, length) if length <= LONGEST_TAYLOR else None


def formulate_in(problem: MixedProblem, sections: Sections | None) -> Formulation:
    """The formulation whose `repeated` sections these are."""
    if problem.prior.positive_real:
        return PassiveFormulation(problem)
    return ExactFormulation(problem) if sections is None else of_sections(problem, sections)

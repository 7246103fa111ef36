"""The first screen of an identification: order, guaranteed error, the same at the largest response, fit, one plot, next steps."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from robustid.controllers import ControllerDesign, DesignStatus
from robustid.errors import Status
from robustid.guarantees import Band, WorstCaseError, largest_error
from robustid.identification import Identification, fit_percent
from robustid.report.assumptions import chosen
from robustid.report.charts import Chart, first_panel
from robustid.report.data_faults import steps_with_faults
from robustid.report.document import Glance, Text
from robustid.report.frequency import frequency_charts, sigma_chart
from robustid.report.guarantee import guarantee_sentence, worst_case_charts, worst_case_sigma_chart
from robustid.report.identified import Bounded, Parts, further_models, in_unit, sample_words, scope, siso
from robustid.report.largest_response import at_largest, beyond_measured, measured_band
from robustid.report.loop_section import loop_glance
from robustid.report.pole_box import box_sentence
from robustid.report.proved_band import band_chart, band_sentence, stands_on
from robustid.report.time_response import time_chart
from robustid.report.words import HZ, at_most, in_hz, number

if TYPE_CHECKING:
    from robustid.reduction import Reduction

_FIT = {"frequency": "fit of the response", "time": "fit of the records"}
BOUND = "robustid bounds RESULT --report bounds.html"
_STABLE = "robust_stability_margin(K)"
_UNBOUNDED = (
    "How far the machine may be from this model is not bounded on this page yet: samples are kept, and nothing is said between"
    " them."
)


def glance(
    identification: Identification,
    margin: str,
    parts: Parts,
    advice: Sequence[str] = (),
    *,
    drawn: bool = True,
    bounding: str = BOUND,
) -> Glance:
    """Return numbers, words, plot and next steps; `advice`: what would make inconsistent data consistent, `drawn`: the words
    stand beside the plot, `bounding`: the command that bounds the error.
    """
    reduction, band, withheld = parts.get("reduction"), parts.get("band"), parts.get("withheld")
    if (looped := parts.get("loop")) is not None and not (withheld is not None and withheld.contradicted):
        return loop_glance(identification, looped, parts)
    worst_case, bound = parts.get("worst_case"), _shown_bound(parts)
    contradicted = withheld is not None and withheld.contradicted
    words = ""
    if bound is not None and not contradicted:
        words = _sentence(identification, bound, drawn)  # a warning says what it is about
    elif bound is None and identification.status is Status.CONSISTENT:
        words = _UNBOUNDED if band is None else band_sentence(identification, band)
    if isinstance(bound, Band) and words:
        words = f"{words} {stands_on(bound, worst_case)}".rstrip()
    if bound is not None and words and (said := scope(identification).removeprefix(", ")):
        words = f"{said[0].upper()}{said[1:]}: {words[0].lower()}{words[1:]}"
    return Glance(
        numbers=[
            *_numbers(identification, reduction, None if contradicted else bound),
            *[("margin: factor on all bounds", margin)] * (identification.status is not Status.CONSISTENT),
        ],
        words=words,
        chart=_chart(identification, parts) if drawn else None,
        next=steps_with_faults(
            identification.problem.placed_faults,
            parts.get("undoing"),
            _next(identification, worst_case, band, contradicted, advice, bounding, parts.get("design")),
        ),
        not_covered="" if bound is None or contradicted else _not_covered(identification, bound),
    )


def _shown_bound(parts: Parts) -> Bounded | Band | None:
    """The bound of the error that the first screen is about; None where none says anything."""
    band, over_poles = parts.get("band"), parts.get("over_poles")
    if band is not None and band.bounded.any():
        return band
    if over_poles is not None and np.isfinite(over_poles.sigma_upper).any():
        return over_poles
    return parts.get("worst_case")


def proves_nothing(parts: Parts) -> bool:
    """Return whether a band is there that bounds the error at no frequency, and nothing else that does."""
    return parts.get("band") is not None and parts.get("loop") is None and _shown_bound(parts) is None


def _not_covered(identification: Identification, bound: Bounded | Band) -> str:
    """Say for what the guarantee does not hold."""
    which = ", which was chosen from these data" if chosen(identification) else ""
    if which and isinstance(bound, Band) and (beyond := beyond_measured(identification.problem)):
        which = f"{which} and alone bounds the response {beyond}"
    found = [f"a machine outside the class{which}", "samples with errors above their bounds"]
    if identification.problem.parametric is not None and (
        isinstance(bound, WorstCaseError) or getattr(bound, "box", None) is None
    ):
        found.append("other poles than those assumed")
    if isinstance(bound, Band):
        found += [f"frequencies from {bound.open_words}"] if bound.open_ranges else []
    elif getattr(bound, "known_circle", None) is None:
        found.append("what lies between the frequencies")
    return ", ".join(found)


def _sentence(identification: Identification, bound: Bounded | Band, drawn: bool) -> str:
    """The guarantee in words; what is drawn between frequencies where it isn't proved there."""
    if isinstance(bound, Band):
        return band_sentence(identification, bound)
    words = guarantee_sentence(bound) if isinstance(bound, WorstCaseError) else box_sentence(bound)
    return f"{words} The plot interpolates between them." if drawn else words


def _numbers(
    identification: Identification, reduction: Reduction | None, bound: Bounded | Band | None
) -> list[tuple[str, str]]:
    reduced = bound if reduction is None else reduction
    small = (None if reduced is None else reduced.model) or identification.model
    order = f"{identification.order}" + (f" → {small.nstates}" if small.nstates != identification.order else "")
    found = [("model order", order)]
    if bound is not None:
        known = np.isfinite(bound.sigma_upper)
        proved = largest_error(bound).value if isinstance(bound, Band) else float(bound.sigma_upper[known].max())
        largest = in_unit(at_most(proved, 3), identification)
        where, share = at_largest(identification, bound)
        name = f"guaranteed error, order {small.nstates if bound.model is None else bound.model.nstates}"
        found += [
            (f"{name}{_but(bound)}{scope(identification)}", f"≤ {largest}"),
            (f"{where}{scope(identification)}", f"≤ {at_most(100 * share, 2)} %"),
        ]
    if identification.status is Status.CONSISTENT:
        worst = ("" if siso(identification) else ", worst entry") + f", order {small.nstates}"
        fits = fit_percent(identification.problem, small)
        found += [(f"{_FIT[kind]}{worst}", f"{number(value, 3)} %") for kind, value in fits.items()]
    return found


def _but(bound: Bounded | Band) -> str:
    """Words on the frequencies at which nothing is bounded; empty where every one is."""
    if isinstance(bound, Band):
        return f", but from {bound.open_words}" if bound.open_ranges else ""
    known, count = int(np.isfinite(bound.sigma_upper).sum()), bound.omega.size
    return f", at {known} frequenc{'y' if known == 1 else 'ies'}" + f" of {count}" * (known < count)


def _chart(identification: Identification, parts: Parts) -> Chart:
    """The magnitude with its guaranteed range; of a matrix the singular values; of records alone the first of them."""
    models, single = further_models(parts.get("reduction"), parts.get("models")), siso(identification)
    if (band := parts.get("band")) is not None and band.bounded.any():
        whole = band_chart(identification, band)
    elif (error := parts.get("worst_case")) is not None:
        whole = worst_case_charts(error)[0] if single else worst_case_sigma_chart(error)
    elif not identification.problem.frequency:
        whole = time_chart(identification, models)
    else:
        whole = frequency_charts(identification, models)[0] if single else sigma_chart(identification, models)
    return first_panel(whole)


def _next(
    identification: Identification,
    error: WorstCaseError | None,
    band: Band | None,
    contradicted: bool,
    advice: Sequence[str],
    bounding: str,
    design: ControllerDesign | None,
) -> list[Text]:
    if identification.status is Status.INCONSISTENT:
        return [Text(line) for line in advice] or [
            Text("Find the cause: rid.diagnose(result) ranks what would help.", code=("rid.diagnose(result)",))
        ]
    if identification.status is not Status.CONSISTENT:
        return [Text("Ask for a smaller accuracy, or give it more time: see the verdict.")]
    if contradicted:
        return [Text("Take the withheld data into the identification, or allow for more: see “Withheld data”.")]
    if band is not None and band.bounded.any():
        among = largest_error(band, measured_band(band.problem) or (0.0, np.inf))  # a point beyond them is no advice
        where = in_hz((among if among.value else largest_error(band)).omega / HZ)
        narrower = f"The error is largest near {where}: a frequency point or a smaller bound there helps first."
        if band.open_ranges:
            narrower = f"Measure frequency points from {band.open_words}: nothing is proved there."
        return [_check(f"band.{_STABLE}", design), Text(narrower)]
    if error is None and band is not None and band.searched:
        return [
            Text(
                "Measure frequency points around the modes: their amplitudes are not told apart, and no error is proved."
            )
        ]
    if error is None or not error.omega.size:
        return [Text(f"Bound the error of the model: {bounding}", code=(bounding,))]
    at, *_, sample = error.worst(1)[0]
    where, what = in_hz(at / HZ), sample_words(identification, sample)
    narrower = f"The error is largest at {where}. A smaller bound of one sample helps first there: {what}."
    return [_check(f"error.{_STABLE}", design), Text(narrower)]


def _check(check: str, design: ControllerDesign | None) -> Text:
    """Step about a controller: to take the one that was designed and proved, else to check one."""
    if design is not None and design.status is DesignStatus.PROVED:
        return Text(
            f"A controller is proved for every consistent plant, {design.goal.name} {design.goal.told(design.level)}: see “The"
            " controller that was designed”."
        )
    return Text(f"Check a controller K against this error: {check}", code=(check,))

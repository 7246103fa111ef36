"""The front of the room: a page, a summary, or a head for notebooks of whatever kind of result is given."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Unpack, cast

from robustid.advice import CommonModes
from robustid.controllers import ControllerDesign
from robustid.core import Budget, Progress, Unfinished, as_flag, as_kind, atomic_write
from robustid.data import FrequencyResponse
from robustid.errors import InputTypeError
from robustid.fitting import MatrixFraction
from robustid.guarantees import (
    Family,
    Fleet,
    Interconnection,
    LoopBounds,
    RobustStabilityMargin,
    StructuredWeight,
    Watch,
)
from robustid.identification import Comparison, Identification
from robustid.report import html, with_rich
from robustid.report.comparison_page import comparison_page
from robustid.report.design_page import design_head, design_page
from robustid.report.document import Document, Verdict
from robustid.report.family_page import family_page
from robustid.report.fit_page import fit_page, fit_summary, fit_verdict
from robustid.report.fit_view import FitView
from robustid.report.fleet_page import fleet_page
from robustid.report.identification_page import (
    identification_head,
    identification_page,
    identification_summary,
    identification_verdict,
)
from robustid.report.identified import Parts
from robustid.report.interconnection_page import interconnection_page
from robustid.report.loop_page import loop_page
from robustid.report.response_charts import ResponseView
from robustid.report.response_page import response_page, response_summary, response_verdict
from robustid.report.setups_page import setups_page
from robustid.report.stability import stability_summary, stability_verdict, weights_summary
from robustid.report.watch_page import watch_page

if TYPE_CHECKING:
    from rich.console import Group

    from robustid.fitting import OrderSweep
    from robustid.reduction import Reduction

_LINES = 18  # of a summary
_STAGES = 2  # of a page: its parts, whose certificates are verified, and its file
Shown = (
    Identification
    | MatrixFraction
    | FrequencyResponse
    | Family
    | LoopBounds
    | Interconnection
    | ControllerDesign
    | Comparison
    | CommonModes
    | Watch
    | Fleet
)


def write_report(
    identification: Shown,
    path: str | os.PathLike[str],
    *,
    title: str | None = None,
    static: bool = False,
    progress: Progress | None = None,
    **parts: Unpack[Parts],
) -> None:
    """Write everything there is to know about a result as one self-contained HTML page.

    The first screen has the verdict, the order, the guaranteed error, one plot, at most three warnings and what to do next;
    everything else is folded under headings. Of an identification: verdict, margin, assumptions, what is guaranteed, every sample
    against the models, residuals against their bounds, the active constraints, order, poles, verification, versions; of a MIMO
    problem every entry, the singular values, and the modes with the ranks of their residues. Of a fitted matrix fraction: cost,
    status, verification, every entry of the response with its residual, convergence and condition numbers, poles, modes, and the
    choice of the order. Of a frequency response: what its bound promises, every entry with bound, noise and distortion, coherence,
    and the spectra of the records. Of a family: its members, its band, who drives it where, and what is not known. Of LoopBounds:
    verdict on every consistent plant, peaks, margins, the plant that refutes it. Of an Interconnection: the verdict on all pairs,
    the margin over frequency, the eigenvalue loci, what limits and what to measure. Of a ControllerDesign: what is proved of it,
    what limits it and where, its loop with every consistent plant, its factors and gains. Of a Comparison: where and how probably
    two measurements differ. Of CommonModes: the modes of several setups, and contradictions. Of a Watch: alarms, scores, and which
    mode moved. Of a Fleet: verdicts, worst cases and outliers of many machines. The page works offline.

    Parameters
    ----------
    identification : Identification, MatrixFraction, FrequencyResponse, Family, LoopBounds, Interconnection, ControllerDesign,
        Comparison, CommonModes, Watch or Fleet
        Whatever its outcome. What is said of it below must be about it, or about its saved copy.
    path : str or path
        The file to create or replace; what was there stays if anything goes wrong.
    title : str, optional
        Heading; default: the names of the signals.
    static : bool
        Pictures in place of plots that can be zoomed: a page without scripts, mostly below 500 kB, that any mail program shows.
    progress : callable (text, done, count), optional
        Told how far it is, such as `show_progress`.
    **parts
        What stands beside the result on its page, listed below.

    Other Parameters
    ----------------
    reduction : Reduction, optional
        Of `identification.model`; shown beside the nominal model. Not for a MatrixFraction.
    models : mapping of str to control.StateSpace, optional
        Further models with the sample time of the data. Not for a MatrixFraction.
    worst_case : WorstCaseError, optional
        From `worst_case_error(identification)`, of any model: adds the guarantee, its proof and what it assumes. All
        certificates are evaluated again; the bound on the whole circle is shown if it has been computed.
    tube : ResponseTube, optional
        From `response_tube(identification)`: adds the guaranteed range in time, with the records of the same input.
    over_poles : WorstCaseOverPoles, optional
        From `worst_case_over_poles(identification, ...)`: adds the guarantee over a pole-uncertainty box, beside `worst_case`.
    stability : RobustStabilityMargin or mapping of str to RobustStabilityMargin, optional
        From `worst_case.robust_stability_margin(controller)`, by the names of the controllers: adds verdicts, and the upper bound
        over frequency.
    weights : StructuredWeight or sequence of StructuredWeight, optional
        From `structured_weights`, the first one drawn: adds what each structure costs.
    sensitivity : Sensitivity or sequence of Improvement, optional
        From `sensitivity(identification.problem)`: adds how the guarantee moves with the assumptions. Of a design from its
        `improvements()`: adds what smaller bounds and wider limits would bring, and where to measure.
    independent : mapping of str to bool, optional
        Whether another program than this package proved what the names say; adds a verdict. Of an identification, LoopBounds or a
        ControllerDesign.
    data : FrequencyResponse, optional
        What the matrix fraction was fitted to: names of the signals, and the noise.
    order_sweep : OrderSweep, optional
        From `suggest_order`, with a MatrixFraction.
    records : TimeRecord or sequence of TimeRecord, optional
        What the frequency response was estimated from.
    withheld : Coverage, optional
        What data that were kept out say of `worst_case`: a section, and the verdict, where they contradict it.
    content : Content, optional
        From `content(identification)`: whether the class says something between the frequency points, a verdict and a section.
    worth : ModelWorth, optional
        From `model_worth_having`: the small model beside the best least-squares fits, a verdict and a section.
    findings : sequence of str
        What can be said, in sentences, shown first; of `identify_reduced`. Not for a MatrixFraction.
    diagnosis : Diagnosis, optional
        From `diagnose(identification)`: cause and change stand on the first screen as the next step, all of it below.
    run_file : str, optional
        The text of the run file that gives this result again, shown last. Not for a MatrixFraction.
    band : Band, optional
        From `band(identification, model=...)`: the guarantee that is proved at every frequency, shown first.
    unfinished : Unfinished, optional
        What Ctrl-C or the time limit of a run has left out: the first line.
    undoing : Undoing, optional
        What undoes a fault of the data, as it is pasted: the first of the next steps.
    steps : sequence of (str, str)
        Commands to go on with as they are pasted, each behind what it is for, with the names of one's own files: the next steps of
        a MatrixFraction or a frequency response.
    loop : LoopBounds, optional
        Of a plant in a loop, from `loop_bounds(band, loop)`: worst cases and margins over every consistent plant, a section.
    plant : PlantReduction, optional
        Of a plant in a loop, from `reduce_plant(identification, loop)`: its small model, in the same section.
    candidates : mapping of str to LoopBounds, optional
        Other controllers by their names, from `loop_bounds(band, loop, controller)`: their verdicts, worst cases and margins.
    design : ControllerDesign, optional
        From `design_controller`: the controller, what is proved of it and what limits it, a section.
    forbidden : (float, float), optional
        Of an Interconnection: gain margin in dB and phase margin in degrees of a forbidden region, drawn and decided.

    Raises
    ------
    InputError, InputTypeError
        If a model has other signals or another sample time, `data` isn't what was fitted, an argument doesn't belong
        to this kind of result, or the file can't be written.

    Examples
    --------
    >>> import pathlib, tempfile, numpy as np, robustid as rid
    >>> record = rid.TimeRecord(np.ones(4), [0.5, 0.75, 0.875, 0.94], dt=0.01, bound=0.01)
    >>> prior = rid.Prior(gain_bound=2.0, decay_rate=1.2)
    >>> result = rid.identify(rid.MixedProblem(time=record, prior=prior))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     page = pathlib.Path(folder) / "report.html"
    ...     write_report(result, page, title="Four samples")
    ...     "Four samples" in page.read_text()
    True
    """
    text = render_report(identification, title=title, static=static, progress=progress, **parts)
    with atomic_write(path) as file:
        file.write(text)


def render_report(
    identification: Shown,
    *,
    title: str | None = None,
    static: bool = False,
    progress: Progress | None = None,
    **parts: Unpack[Parts],
) -> str:
    """Return the page of `write_report`, which names the parts, as text."""
    static = as_flag("static", static)
    kind = kind_of("identification", identification, _PAGES)
    if title is not None:
        as_kind("title", title, str, "text")
    build, belonging = _PAGES[kind]
    given = _given(parts)
    refuse_foreign(identification, given, belonging)
    budget = Budget(None, progress, "drawing the report")
    budget.tell(0, _STAGES)
    document = build(identification, title, given)
    budget.tell(1, _STAGES)
    return html.render(document, static=static, progress=progress)


def first_screen(result: Shown, **parts: Unpack[Parts]) -> Document:
    """Build the page of `write_report`, which names the parts, as far as a terminal shows it: without plots that take long."""
    kind = kind_of("result", result, _PAGES)
    build = _HEADS.get(kind, _PAGES[kind][0])
    return build(result, None, _given(parts))


def _given(parts: Parts) -> Parts:
    """Parts that are something."""
    return cast("Parts", {name: part for name, part in parts.items() if part is not None and part != ()})


_OF_DATA = ("data", "order_sweep", "records", "forbidden", "steps")
_PAGES: dict[type, tuple[Callable[..., Document], tuple[str, ...]]] = {
    Identification: (identification_page, tuple(name for name in Parts.__annotations__ if name not in _OF_DATA)),
    MatrixFraction: (fit_page, (*_OF_DATA[:2], "undoing", "steps")),
    FrequencyResponse: (response_page, ("records", "undoing", "steps")),
    Family: (family_page, ("findings", "withheld", "run_file", "unfinished", "undoing", "design")),
    LoopBounds: (loop_page, ("candidates", "independent")),
    Interconnection: (interconnection_page, ("forbidden",)),
    ControllerDesign: (design_page, ("sensitivity", "independent")),
    Comparison: (comparison_page, ()),
    CommonModes: (setups_page, ()),
    Watch: (watch_page, ()),
    Fleet: (fleet_page, ()),
}
_HEADS: dict[type, Callable[..., Document]] = {Identification: identification_head, ControllerDesign: design_head}


def render_summary(
    identification: Identification | MatrixFraction | FrequencyResponse | RobustStabilityMargin | StructuredWeight,
    reduction: Reduction | None = None,
    *,
    data: FrequencyResponse | None = None,
    order_sweep: OrderSweep | None = None,
    unfinished: Unfinished | None = None,
) -> Group:
    """Render verdict, margin or cost, checks, active constraints, poles or modes for ``rich.print`` or a rich console.

    Of a frequency response: what its bound promises, frequency points, levels of every entry, warnings. Of a robust stability
    margin: the verdict, where the bound is largest, and whose error limits it; of a structured weight what it costs.

    Parameters
    ----------
    identification : Identification, MatrixFraction, FrequencyResponse, RobustStabilityMargin or StructuredWeight
    reduction : Reduction, optional
        Of the model of an identification; its poles are then shown instead.
    data : FrequencyResponse, optional
        What a matrix fraction was fitted to, for the names of its signals.
    order_sweep : OrderSweep, optional
        From `suggest_order`, with a MatrixFraction: what withheld frequency points say of it.
    unfinished : Unfinished, optional
        What the run of an identification has left out, which is said before the verdict.

    Returns
    -------
    rich.console.Group

    Examples
    --------
    >>> import io, numpy as np, rich.console, robustid as rid
    >>> record = rid.TimeRecord(np.ones(4), [0.5, 0.75, 0.875, 0.94], dt=0.01, bound=0.01)
    >>> prior = rid.Prior(gain_bound=2.0, decay_rate=1.2)
    >>> result = rid.identify(rid.MixedProblem(time=record, prior=prior))
    >>> console = rich.console.Console(file=io.StringIO(), width=100)
    >>> console.print(render_summary(result))
    >>> "Consistent" in console.file.getvalue()
    True
    """
    if isinstance(identification, MatrixFraction):
        return with_rich.render(fit_summary(FitView(identification, data, order_sweep)))
    if isinstance(identification, FrequencyResponse):
        return with_rich.render(response_summary(ResponseView(identification)))
    if isinstance(identification, RobustStabilityMargin):
        return with_rich.render(stability_summary(identification))
    if isinstance(identification, StructuredWeight):
        return with_rich.render(weights_summary(identification))
    return with_rich.render(identification_summary(identification, reduction, unfinished))


def head_at_terminal(document: Document, width: int, most: int) -> Group:
    """Render the first screen of a page for a rich console of a width, in at most so many lines, but for files and next steps."""
    return with_rich.render_head(document, width, most)


def verdict(
    result: Identification | MatrixFraction | FrequencyResponse | RobustStabilityMargin,
    order_sweep: OrderSweep | None = None,
) -> Verdict:
    """Return the outcome of a result in one word and one sentence; its `key` is "consistent" where nothing is wrong.

    Examples
    --------
    >>> import robustid as rid
    >>> said = verdict(rid.FrequencyResponse([1.0], [1.0], bound=0.1))
    >>> said.key, said.word
    ('consistent', 'Hard bound')
    """
    if isinstance(result, MatrixFraction):
        return fit_verdict(FitView(result, sweep=order_sweep))
    if isinstance(result, FrequencyResponse):
        return response_verdict(ResponseView(result))
    if isinstance(result, RobustStabilityMargin):
        return stability_verdict(result)
    return identification_verdict(result)


def kind_of(name: str, value: object, kinds: Iterable[type]) -> type:
    """Return the kind that an argument is of; refuse one of no kind."""
    for kind in kinds:
        if isinstance(value, kind):
            return kind
    *names, last = (kind.__name__ for kind in kinds)
    wanted = f"{', '.join(names)} or {last}" if names else last
    raise InputTypeError(f"`{name}` must be of class {wanted}; got {type(value).__name__}")


def has_page(result: object) -> bool:
    """Return whether `write_report` has a page about this kind of result."""
    return isinstance(result, tuple(_PAGES))


def refuse_foreign(result: object, given: Iterable[str], belonging: Iterable[str]) -> None:
    """Refuse what doesn't belong to this kind of result."""
    for name in given:
        if name not in belonging:
            raise InputTypeError(f"`{name}` doesn't belong to a {type(result).__name__}; leave it out")

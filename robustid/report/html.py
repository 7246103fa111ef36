"""The report as one HTML file that needs nothing else: no network, no server, no other file."""

from __future__ import annotations

import datetime
import functools
import importlib.metadata
import json
import os
import platform
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from robustid._version import __version__
from robustid.core import atomic_write
from robustid.data import FrequencyResponse
from robustid.errors import InputTypeError
from robustid.identification import Identification
from robustid.mfd import MatrixFraction
from robustid.report import charts, evidence, facts, matrix_charts, modes, rests_on, worst_case_charts, worst_case_facts
from robustid.report import over_poles as over_poles_section
from robustid.report import tube as tube_section
from robustid.report.grids import Grid, grid_of
from robustid.report.margin_by_order import margin_chart
from robustid.report.plotly_figures import Figure, figures, plotly_figure
from robustid.report.poles import pole_table
from robustid.report.style import number

if TYPE_CHECKING:
    import control

    from robustid.advice import Sensitivity
    from robustid.data import TimeRecord
    from robustid.guarantees import ResponseTube, WorstCaseError, WorstCaseOverPoles
    from robustid.mfd import OrderSweep
    from robustid.reduction import Reduction

__all__ = ["page", "plotly_figure", "render_report", "write_report"]

_PACKAGES = ("numpy", "scipy", "cvxpy", "clarabel", "control")


def write_report(
    identification: Identification | MatrixFraction | FrequencyResponse,
    path: str | os.PathLike[str],
    *,
    reduction: Reduction | None = None,
    title: str | None = None,
    models: Mapping[str, control.StateSpace] | None = None,
    worst_case: WorstCaseError | None = None,
    tube: ResponseTube | None = None,
    over_poles: WorstCaseOverPoles | None = None,
    sensitivity: Sensitivity | None = None,
    data: FrequencyResponse | None = None,
    order_sweep: OrderSweep | None = None,
    records: TimeRecord | Sequence[TimeRecord] | None = None,
    findings: Sequence[str] = (),
    run_file: str | None = None,
) -> None:
    """Write everything there is to know about a result as one self-contained HTML page.

    Of an identification: verdict, margin, assumptions, what is guaranteed, every sample against the models, residuals
    against their bounds, the samples that limit the result, order, poles, verification, versions; of several channels every
    entry, the singular values, and the modes with the ranks of their residues. Of a fitted matrix
    fraction: cost, status, verification, every entry of the response with its residual, convergence and condition
    numbers, poles, modes, and the choice of the order. Of a frequency response: what its bound promises, every entry with
    bound, noise and distortion, coherence, and the spectra of the records. The page works offline and fetches nothing.

    Parameters
    ----------
    identification : Identification, MatrixFraction or FrequencyResponse
        Whatever its outcome. What is said of it below must be about it, or about its saved copy.
    path : str or path
        The file to create or replace; what was there stays if anything goes wrong.
    reduction : Reduction, optional
        Of `identification.model`; shown beside the nominal model. Not for a MatrixFraction.
    title : str, optional
        Heading; default: the names of the channels.
    models : mapping of str to control.StateSpace, optional
        Further models with the sample time of the data. Not for a MatrixFraction.
    worst_case : WorstCaseError, optional
        From `worst_case_error(identification)`, of any model: adds the guarantee, its proof and what it assumes. All
        certificates are evaluated again; the bound on the whole circle is shown if it has been computed.
    tube : ResponseTube, optional
        From `response_tube(identification)`: adds the guaranteed range in time, with the records of the same input.
    over_poles : WorstCaseOverPoles, optional
        From `worst_case_over_poles(identification, ...)`: adds the guarantee that covers a box of poles, beside `worst_case`.
    sensitivity : Sensitivity, optional
        From `sensitivity(identification.problem)`: adds how the guarantee moves with the assumptions.
    data : FrequencyResponse, optional
        What the matrix fraction was fitted to: names of the channels, and the noise.
    order_sweep : OrderSweep, optional
        From `suggest_order`, with a MatrixFraction.
    records : TimeRecord or sequence of TimeRecord, optional
        What the frequency response was estimated from.
    findings : sequence of str
        What can be said, in sentences, shown first; of `identify_reduced`. Not for a MatrixFraction.
    run_file : str, optional
        The text of the run file that gives this result again, shown last. Not for a MatrixFraction.

    Raises
    ------
    InputError, InputTypeError
        If a model has other channels or another sample time, `data` isn't what was fitted, an argument doesn't belong
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
    text = render_report(
        identification,
        reduction=reduction,
        title=title,
        models=models,
        worst_case=worst_case,
        tube=tube,
        over_poles=over_poles,
        sensitivity=sensitivity,
        data=data,
        order_sweep=order_sweep,
        records=records,
        findings=findings,
        run_file=run_file,
    )
    with atomic_write(path) as file:
        file.write(text)


def render_report(
    identification: Identification | MatrixFraction | FrequencyResponse,
    *,
    reduction: Reduction | None = None,
    title: str | None = None,
    models: Mapping[str, control.StateSpace] | None = None,
    worst_case: WorstCaseError | None = None,
    tube: ResponseTube | None = None,
    over_poles: WorstCaseOverPoles | None = None,
    sensitivity: Sensitivity | None = None,
    data: FrequencyResponse | None = None,
    order_sweep: OrderSweep | None = None,
    records: TimeRecord | Sequence[TimeRecord] | None = None,
    findings: Sequence[str] = (),
    run_file: str | None = None,
) -> str:
    """The page of `write_report` as text."""
    guarantees = {"worst_case": worst_case, "tube": tube, "over_poles": over_poles, "sensitivity": sensitivity}
    belongs = {
        Identification: {
            "reduction": reduction,
            "models": models,
            "findings": findings or None,
            "run_file": run_file,
            **guarantees,
        },
        MatrixFraction: {"data": data, "order_sweep": order_sweep},
        FrequencyResponse: {"records": records},
    }
    kind = next((kind for kind in belongs if isinstance(identification, kind)), None)
    if kind is None:
        raise InputTypeError(
            "`identification` must be an Identification, a MatrixFraction or a FrequencyResponse; got"
            f" {type(identification).__name__}"
        )
    if title is not None and not isinstance(title, str):
        raise InputTypeError(f"`title` must be text; got {type(title).__name__}")
    foreign = [pair for other, given in belongs.items() if other is not kind for pair in given.items()]
    for name, value in foreign:
        if value is not None:
            raise InputTypeError(f"`{name}` doesn't belong to a {type(identification).__name__}; leave it out")
    if isinstance(identification, MatrixFraction):
        from robustid.report.mfd_page import fit_page

        return fit_page(identification, data, order_sweep, title)
    if isinstance(identification, FrequencyResponse):
        from robustid.report.frf_page import frf_page

        return frf_page(identification, records, title)
    drawn, context = _guarantees(identification, worst_case, tube, over_poles, sensitivity)
    context |= {"title": title or facts.heading(identification), "findings": findings, "run_file": run_file}
    return _identification_page(identification, reduction, models, drawn, context)


def _identification_page(
    identification: Identification,
    reduction: Reduction | None,
    models: Mapping[str, control.StateSpace] | None,
    drawn: dict[str, list[Figure]],
    context: dict[str, Any],
) -> str:
    """The page with the figures and the context of what is guaranteed."""
    shown = further_models(reduction, models)
    found = [
        charts.time_chart(identification, shown),
        evidence.hankel_chart(identification, reduction),
        evidence.pole_chart(identification, shown),
    ]
    entries, residuals = charts.frequency_charts(identification, shown), evidence.residual_chart(identification, shown)
    grids: dict[str, Grid] = {}
    if identification.problem.entries.single:
        found += [*entries, residuals]
    else:
        found.append(matrix_charts.sigma_chart(identification, shown))
        answers = matrix_charts.answer_charts(identification, shown)
        columns = len(identification.problem.inputs)
        grids = {
            "frequency": grid_of(matrix_charts.lighter(entries), columns),
            "answers": grid_of(matrix_charts.lighter(answers), columns),
            "residuals": grid_of(matrix_charts.lighter([residuals]), columns),
        }
    if reduction is not None and reduction.tried:
        found.append(margin_chart(reduction))
    drawn |= {name: figure for grid in grids.values() for name, figure in grid.drawn.items()}
    return page(
        "template.html.j2",
        {chart.name: figures(chart) for chart in found} | drawn,
        grids=grids,
        result=identification,
        facts=facts,
        modes=modes,
        tables=[(name, pole_table(model)) for name, model, *_ in charts.curves(identification, shown)],
        reduction=reduction,
        **context,
    )


def _guarantees(
    identification: Identification,
    worst_case: WorstCaseError | None,
    tube: ResponseTube | None,
    over_poles: WorstCaseOverPoles | None,
    sensitivity: Sensitivity | None,
) -> tuple[dict[str, list[Figure]], dict[str, Any]]:
    """Figures of what is guaranteed, by the name of their chart, and what the templates of the sections are given."""
    from robustid.guarantees import ResponseTube, WorstCaseError, WorstCaseOverPoles

    check, found, drawn, guaranteed = worst_case_facts.checked, [], {}, None
    if worst_case is not None:
        check("worst_case", worst_case, WorstCaseError, "worst_case_error", identification)
        entries = worst_case_charts.worst_case_charts(worst_case)
        if identification.problem.entries.single:
            found += [*entries, worst_case_charts.nyquist_chart(worst_case)]
        else:
            found.append(worst_case_charts.worst_case_sigma_chart(worst_case))
            guaranteed = grid_of(matrix_charts.lighter(entries), len(identification.problem.inputs))
            drawn |= guaranteed.drawn
    if over_poles is not None:
        check("over_poles", over_poles, WorstCaseOverPoles, "worst_case_over_poles", identification)
        found.append(over_poles_section.chart(over_poles, worst_case))
    if tube is not None:
        check("tube", tube, ResponseTube, "response_tube", identification)
        found.append(tube_section.chart(tube))
    if sensitivity is not None:
        rests_on.checked(sensitivity, identification)
        drawn["sensitivity"] = figures(rests_on.chart(sensitivity, identification), small=True)
    context = {
        "worst_case": worst_case,
        "guaranteed": guaranteed,
        "guarantee": worst_case_facts,
        "over_poles": over_poles,
        "box": over_poles_section,
        "tube": tube,
        "in_time": tube_section,
        "sensitivity": sensitivity,
        "rests_on": rests_on,
    }
    return drawn | {chart.name: figures(chart) for chart in found}, context


def page(template: str, drawn: dict[str, list[Figure]], **context: Any) -> str:
    """A page with its figures, by the name of their chart, as text."""
    from plotly.offline import get_plotlyjs

    return (
        _environment()
        .get_template(template)
        .render(
            figures=drawn,
            versions=versions(),
            date=datetime.datetime.now().astimezone().strftime("%Y-%m-%d %H:%M %Z"),
            # The only text that isn't escaped: the library itself, and JSON made safe below.
            plotly=_script(get_plotlyjs()),
            data=_json({figure.id: figure.spec for parts in drawn.values() for figure in parts}),
            **context,
        )
    )


@functools.cache  # it keeps the compiled templates, which take longer than a page
def _environment() -> Any:
    import jinja2

    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("robustid.report", "."),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["number"] = number
    return environment


def further_models(reduction: Reduction | None, models: Mapping[str, control.StateSpace] | None) -> dict[str, Any]:
    """The reduced model under its name, and the other ones."""
    out: dict[str, Any] = {}
    if reduction is not None:
        out[f"reduced model, order {reduction.order}"] = reduction.model
    if models is not None and not isinstance(models, Mapping):
        raise InputTypeError(f"`models` must map names to control.StateSpace; got {type(models).__name__}")
    return out | dict(models or {})


def versions() -> list[tuple[str, str]]:
    """What computed this."""
    first = [("robustid", __version__), ("Python", platform.python_version())]
    return first + [(name, importlib.metadata.version(name)) for name in _PACKAGES]


def _json(value: Any) -> Any:
    """JSON that can't end the script element it stands in."""
    import markupsafe

    text = json.dumps(value, allow_nan=False, separators=(",", ":"))
    for sign in "<>&":
        text = text.replace(sign, f"\\u{ord(sign):04x}")
    return markupsafe.Markup(text)


def _script(source: str) -> Any:
    """The source of a library, in whose strings an end tag may stand."""
    import markupsafe

    return markupsafe.Markup(source.replace("</script", "<\\/script"))

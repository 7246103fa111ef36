"""Charts of a result put together as one figure: panels of the entries in rows and columns, with what belongs below them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from robustid.data import FrequencyResponse
from robustid.errors import InputError
from robustid.fitting import MatrixFraction
from robustid.guarantees import WorstCaseError
from robustid.identification import Identification
from robustid.reduction import Reduction
from robustid.report.charts import Chart, in_rows, lighter, side_by_side
from robustid.report.identified import siso
from robustid.report.sections import fit_charts, frequency, guarantee_charts, response_charts
from robustid.report.sections.fit_view import FitView
from robustid.report.sections.reduction import margin_chart
from robustid.report.sections.residuals import residual_chart
from robustid.report.sections.response_view import ResponseView
from robustid.report.sections.time import answer_charts, time_chart

if TYPE_CHECKING:
    import control

    Models = Mapping[str, control.StateSpace] | None


def identified_bode(identification: Identification, models: Models = None) -> Chart:
    """Every entry with its samples and models; of a MIMO problem the singular values below."""
    found = frequency.frequency_charts(identification, models)
    if siso(identification):
        return found[0]
    sigma = frequency.sigma_chart(identification, models).panels
    return side_by_side("frequency", lighter(found), len(identification.problem.inputs), sigma)


def guaranteed_bode(error: WorstCaseError) -> Chart:
    """Every entry with the range that no consistent system leaves; of a MIMO problem the singular values below."""
    found = guarantee_charts.worst_case_charts(error)
    if siso(error.identification):
        return found[0]
    sigma = guarantee_charts.worst_case_sigma_chart(error).panels
    return side_by_side("guarantee", lighter(found), len(error.identification.problem.inputs), sigma)


def fit_bode(fit: MatrixFraction, data: FrequencyResponse | None = None) -> Chart:
    """Every entry of a fit, outputs below each other."""
    view = FitView(fit, data)
    return side_by_side("fit", fit_charts.response_charts(view), view.nu)


def response_bode(frf: FrequencyResponse, records: Any = None) -> Chart:
    """Every entry of a response, then overviews, and the spectra of its records."""
    view = ResponseView(frf, records)
    spectra = response_charts.spectrum_charts(view)
    further = (response_charts.overview_charts(view), spectra[: view.nu], spectra[view.nu :])
    groups = ([panel for chart in group for panel in chart.panels] for group in further)
    return side_by_side("frf", response_charts.entry_charts(view), view.nu, *groups)


def identified_time(identification: Identification, models: Models = None) -> Chart:
    """The records, then the step and pulse responses."""
    chart, columns = time_chart(identification, models), len(identification.problem.inputs)
    if siso(identification):
        return chart
    answers = side_by_side("answers", lighter(answer_charts(identification, models)), columns)
    return in_rows(chart, columns, answers.panels)


def identified_residuals(identification: Identification, models: Models = None) -> Chart:
    """The residuals, a row for every output where entries have panels of their own."""
    chart = residual_chart(identification, models)
    return in_rows(chart, len(identification.problem.inputs)) if chart.grid else chart


def fit_poles(fit: MatrixFraction, data: FrequencyResponse | None = None) -> Chart:
    """Poles of a fit and their damping."""
    return fit_charts.fit_pole_chart(FitView(fit, data))


def fit_convergence(fit: MatrixFraction) -> Chart:
    """Cost and condition number after every iteration of a fit."""
    return fit_charts.convergence_chart(FitView(fit))


def tried_orders(reduction: Reduction) -> Chart:
    """Margins of the orders that were tried; InputError of a truncation, which tried none."""
    if not reduction.tried:
        raise InputError("`result` must be from reduce_within_bounds: a truncation tries no orders against the samples")
    return margin_chart(reduction)

"""Guarantees with matplotlib."""

from __future__ import annotations

from typing import TYPE_CHECKING

from robustid.errors import InputTypeError
from robustid.guarantees import ResponseTube, WorstCaseError
from robustid.report import worst_case_charts as charts
from robustid.report.matrix_charts import lighter, side_by_side
from robustid.report.plots import draw
from robustid.report.tube import chart

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def plot_worst_case(error: WorstCaseError) -> Figure:
    """Bode plot with the range that no consistent system leaves, and the error of the model, guaranteed and reached.

    The ranges are proved at the frequencies of `error`; between them the distance from the model is interpolated for the eye.
    Where ``error.circle`` has been computed it is drawn: that bound holds on the whole circle.

    Parameters
    ----------
    error : WorstCaseError

    Returns
    -------
    matplotlib.figure.Figure
        Magnitude and phase with the samples and their discs, and the error, of every entry; the phase range is a full turn where
        the response may be 0. Of several channels also the singular values, and the largest one of the error.

    Raises
    ------
    InputTypeError
        If `error` isn't a WorstCaseError.

    Examples
    --------
    >>> import numpy as np, robustid as rid
    >>> frf = rid.FrequencyResponse([1.0, 5.0], [1.0, 0.9 - 0.2j], bound=0.05, dt=0.1)
    >>> result = rid.identify(rid.MixedProblem(frequency=frf, prior=rid.Prior(gain_bound=1.5, decay_rate=1.4)))
    >>> figure = plot_worst_case(rid.worst_case_error(result, omega=[0.5, 2.0, 10.0], directions=4))
    >>> len(figure.axes), figure.axes[-1].get_xlabel()
    (3, 'frequency [Hz]')
    """
    found, problem = charts.worst_case_charts(_checked(error)), error.identification.problem
    if problem.entries.single:
        return draw(found[0])
    sigma = charts.worst_case_sigma_chart(error).panels
    return draw(side_by_side("guarantee", lighter(found), len(problem.inputs), sigma))


def plot_nyquist(error: WorstCaseError) -> Figure:
    """Nyquist plot: at every frequency the polygon that holds every consistent value, and values that are reached.

    With the model and the discs of the data; beside it the polygons of the largest errors around the model, to scale. Several
    channels: a row for every entry, the frequencies at which the largest singular value of the error is largest.
    Parameters and errors as for `plot_worst_case`.

    Examples
    --------
    >>> import numpy as np, robustid as rid
    >>> frf = rid.FrequencyResponse([1.0, 5.0], [1.0, 0.9 - 0.2j], bound=0.05, dt=0.1)
    >>> result = rid.identify(rid.MixedProblem(frequency=frf, prior=rid.Prior(gain_bound=1.5, decay_rate=1.4)))
    >>> figure = plot_nyquist(rid.worst_case_error(result, omega=[2.0], directions=4))
    >>> [axes.get_title(loc="left") for axes in figure.axes]
    ['Values at the frequencies', 'Largest errors, around the model']
    """
    return draw(charts.nyquist_chart(_checked(error)))


def plot_tube(tube: ResponseTube) -> Figure:
    """Response in time of the model, inside the tube that no consistent system leaves, and the records of the same input.

    The tube is proved at the samples of `tube`; between them the distance from the model is interpolated for the eye.

    Parameters
    ----------
    tube : ResponseTube
        From `response_tube`.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    InputTypeError
        If `tube` isn't a ResponseTube.

    Examples
    --------
    >>> import robustid as rid
    >>> from robustid.guarantees import response_tube
    >>> record = rid.TimeRecord([1.0, 1.0], [0.5, 0.7], dt=0.1, bound=0.01, outputs=["angle [rad]"])
    >>> result = rid.identify(rid.MixedProblem(time=record, prior=rid.Prior(gain_bound=1.0, decay_rate=2.0)))
    >>> figure = plot_tube(response_tube(result, input="step", horizon=4))
    >>> figure.axes[0].get_ylabel()
    'angle [rad]'
    """
    if not isinstance(tube, ResponseTube):
        raise InputTypeError(f"`tube` must be a ResponseTube, from response_tube(); got {type(tube).__name__}")
    return draw(chart(tube))


def _checked(error: WorstCaseError) -> WorstCaseError:
    if not isinstance(error, WorstCaseError):
        raise InputTypeError(f"`error` must be a WorstCaseError, from worst_case_error(); got {type(error).__name__}")
    return error

"""Guarantees with matplotlib."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from robustid.certify import WorstCaseError
from robustid.errors import InputTypeError
from robustid.report import worst_case_charts as charts
from robustid.report.plots import draw

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
        Magnitude and phase with the samples and their discs, and the error; the phase range is a full turn where the
        response may be 0.

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
    return draw(charts.worst_case_chart(_checked(error)))


def plot_nyquist(error: WorstCaseError) -> Figure:
    """Nyquist plot: at every frequency the polygon that holds every consistent value, and values that are reached.

    With the model and the discs of the data; beside it the polygons of the largest errors around the model, to scale.
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


def plot_tube(tube: Any) -> Figure:
    """Response in time of the model, inside the tube that no consistent system leaves.

    Parameters
    ----------
    tube : ResponseTube
        From `response_tube`.

    Returns
    -------
    matplotlib.figure.Figure
    """
    return draw(charts.tube_chart(tube))


def _checked(error: WorstCaseError) -> WorstCaseError:
    if not isinstance(error, WorstCaseError):
        raise InputTypeError(f"`error` must be a WorstCaseError, from worst_case_error(); got {type(error).__name__}")
    return error

"""Fits of matrix fractions with matplotlib."""

from __future__ import annotations

from typing import TYPE_CHECKING

from robustid.data import FrequencyResponse
from robustid.report import mfd_charts, mfd_order_charts
from robustid.report.matrix_charts import side_by_side
from robustid.report.mfd_view import FitView
from robustid.report.plots import draw

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from robustid.mfd import MatrixFraction, OrderSweep


def plot_fit(fit: MatrixFraction, data: FrequencyResponse | None = None) -> Figure:
    """Magnitude and phase of every entry: samples, model with its standard deviation, residual |P_o - P|.

    Parameters
    ----------
    fit : MatrixFraction
    data : FrequencyResponse, optional
        What was fitted: gives the names of the channels and the noise.

    Returns
    -------
    matplotlib.figure.Figure
        Outputs below each other, inputs beside each other; of many lines the smallest and largest values of short
        intervals are drawn.

    Raises
    ------
    InputError, InputTypeError
        If `data` are other ones than those that were fitted.

    Examples
    --------
    >>> import numpy as np, robustid as rid
    >>> omega = np.linspace(1, 9, 60)
    >>> frf = rid.FrequencyResponse(omega, 1 / ((1j * omega) ** 2 + 0.2j * omega + 16), outputs=["x [m]"])
    >>> plot_fit(rid.fit_mfd(frf, order=2), frf).axes[1].get_xlabel()
    'frequency [Hz]'
    """
    view = FitView(fit, data)
    return draw(side_by_side("fit", mfd_charts.response_charts(view), view.nu))


def plot_fit_poles(fit: MatrixFraction, data: FrequencyResponse | None = None) -> Figure:
    """Poles in the plane of the model, and damping over frequency with one standard deviation.

    Parameters and errors as for `plot_fit`.

    Examples
    --------
    >>> import numpy as np, robustid as rid
    >>> omega = np.linspace(1, 9, 60)
    >>> fit = rid.fit_mfd(rid.FrequencyResponse(omega, 1 / ((1j * omega) ** 2 + 0.2j * omega + 16)), order=2)
    >>> [axes.get_xlabel() for axes in plot_fit_poles(fit).axes]
    ['real part of s/2π [Hz]', 'natural frequency [Hz]']
    """
    return draw(mfd_charts.pole_chart(FitView(fit, data)))


def plot_convergence(fit: MatrixFraction) -> Figure:
    """Cost after every iteration, and the condition number of its normal matrix less one, not below machine epsilon.

    Source: `voorhoeve2016` figure 5.

    Examples
    --------
    >>> import numpy as np, robustid as rid
    >>> omega = np.linspace(1, 9, 60)
    >>> values = (1 + 0.1 * np.cos(9 * omega)) / ((1j * omega) ** 2 + 0.2j * omega + 16)
    >>> [axes.get_ylabel() for axes in plot_convergence(rid.fit_mfd(rid.FrequencyResponse(omega, values), order=2)).axes]
    ['cost [–]', 'κ − 1 [–]']
    """
    return draw(mfd_charts.convergence_chart(FitView(fit)))


def plot_orders(order_sweep: OrderSweep) -> Figure:
    """Singular values of the subspace estimate; cost, MDL and AIC against the order.

    Parameters
    ----------
    order_sweep : OrderSweep
        From `suggest_order`.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    InputTypeError
        `order_sweep` isn't one.

    Examples
    --------
    >>> import numpy as np, robustid as rid
    >>> from robustid.mfd import suggest_order
    >>> s = 1j * np.linspace(1, 9, 60)
    >>> noise = 0.003 * np.exp(1j * np.random.default_rng(0).uniform(0, 7, 60))
    >>> frf = rid.FrequencyResponse(s.imag, (1 + noise) / (s**2 + 0.2 * s + 16))
    >>> [axes.get_xlabel() for axes in plot_orders(suggest_order(frf, orders=range(1, 5))).axes]
    ['number [–]', 'order [–]', 'order [–]']
    """
    return draw(mfd_order_charts.order_chart(mfd_order_charts.checked_sweep(order_sweep)))


def plot_stabilisation(order_sweep: OrderSweep) -> Figure:
    """Every oscillating pole of every order at its frequency, over the sum of all magnitudes.

    Parameters and errors as for `plot_orders`. A physical mode keeps its frequency and damping from order to order.

    Examples
    --------
    >>> import numpy as np, robustid as rid
    >>> from robustid.mfd import suggest_order
    >>> s = 1j * np.linspace(1, 9, 60)
    >>> noise = 0.003 * np.exp(1j * np.random.default_rng(0).uniform(0, 7, 60))
    >>> frf = rid.FrequencyResponse(s.imag, (1 + noise) / (s**2 + 0.2 * s + 16))
    >>> plot_stabilisation(suggest_order(frf, orders=[2, 3])).axes[0].get_ylabel()
    'order [–]'
    """
    return draw(mfd_order_charts.stabilisation_chart(mfd_order_charts.checked_sweep(order_sweep)))

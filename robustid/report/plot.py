"""Figures with matplotlib, of whatever result is given: `robustid.plot.bode(result)`.

Each returns a `matplotlib.figure.Figure`. With `ax`, matplotlib axes or a sequence of them (one for each panel, in the order of the
figure), it is drawn there instead, in the style of these axes; their figure is returned.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from robustid.controllers import ControllerDesign
from robustid.core import as_state_space, explain
from robustid.data import FrequencyResponse, TimeRecord, as_frequency_response
from robustid.fitting import MatrixFraction, OrderSweep
from robustid.guarantees import (
    Band,
    Family,
    Interconnection,
    LoopBounds,
    ResponseTube,
    RobustStabilityMargin,
    StructuredWeight,
    Watch,
    WorstCaseError,
    WorstCaseOverPoles,
)
from robustid.identification import Comparison, Identification
from robustid.reduction import ModelWorth, Reduction
from robustid.report.charts import Chart
from robustid.report.design_charts import open_loop_bode
from robustid.report.design_steps import step_chart
from robustid.report.drawn import drawn
from robustid.report.family_page import family_chart, schedule_chart
from robustid.report.fit_charts import fit_bode, fit_convergence, fit_poles
from robustid.report.frequency import identified_bode
from robustid.report.guarantee import guaranteed_bode
from robustid.report.order_sweep_section import order_chart, stabilisation_chart
from robustid.report.plot_data import comparison, history, record
from robustid.report.plot_loops import design, loop, nyquist, stability
from robustid.report.pole_box import pole_box_chart
from robustid.report.poles import pole_chart
from robustid.report.proved_band import centre_chart
from robustid.report.residual_charts import identified_residuals
from robustid.report.response_charts import response_bode
from robustid.report.small_model import hankel_chart, model_chart, tried_orders, worth_chart
from robustid.report.stability import weights_chart
from robustid.report.time_response import identified_time, tube_chart

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from robustid.report.drawn import Where
    from robustid.report.identified import Models

__all__ = [
    "bode",
    "comparison",
    "convergence",
    "design",
    "hankel",
    "history",
    "loop",
    "nyquist",
    "of",
    "orders",
    "poles",
    "record",
    "residuals",
    "schedule",
    "stabilisation",
    "stability",
    "time_response",
]


def __dir__() -> list[str]:
    return __all__


def of(result: object, **options: Any) -> Figure:
    """Draw the figure that shows a result best; ``result.plot()`` is this.

    Of a ResponseTube the `time_response`, of an OrderSweep, or a Reduction from `reduce_within_bounds`, the `orders`, of a
    RobustStabilityMargin the `stability`, of an Interconnection the `nyquist`, of LoopBounds the `loop`, of a ControllerDesign the
    `design`, of a TimeRecord the `record`, of a Comparison the `comparison`, of a Watch the `history`, of everything else `bode`.

    Parameters
    ----------
    result : Identification, FrequencyResponse, MatrixFraction, WorstCaseError, ...
        Whatever one of these figures is drawn of.
    **options
        Those of the figure.

    Returns
    -------
    matplotlib.figure.Figure

    Examples
    --------
    >>> import robustid as rid
    >>> frf = rid.FrequencyResponse([10.0, 20.0, 30.0], [1 - 0.1j, -2j, -0.3], bound=0.02, outputs=["x [m]"])
    >>> [axes.get_ylabel() for axes in frf.plot().axes]
    ['magnitude [m]', 'phase [°]']
    """
    figures: dict[type, Callable[..., Figure]] = {ResponseTube: time_response, RobustStabilityMargin: stability}
    figures |= {OrderSweep: orders, Reduction: orders, Interconnection: nyquist, LoopBounds: loop}
    figures |= {ControllerDesign: design, TimeRecord: record, Comparison: comparison, Watch: history}
    return next((figure for kind, figure in figures.items() if isinstance(result, kind)), bode)(result, **options)


def bode(
    result: object,
    *,
    models: Models = None,
    data: FrequencyResponse | None = None,
    records: TimeRecord | Sequence[TimeRecord] | None = None,
    ax: Where = None,
) -> Figure:
    r"""Draw magnitude and phase, entry by entry: outputs below each other, inputs beside each other.

    Of an Identification: the models, and every sample with its disc (bars: \|value\| ± bound, and the phase
    ± arcsin(bound/\|value\|) of that disc; any phase where it holds 0); of a MIMO problem also the singular values. Of a
    WorstCaseError or a WorstCaseOverPoles: the range that no consistent system leaves, and the error of the model, guaranteed and
    reached; proved at their frequencies, interpolated for the eye between them; a bound on the whole circle is drawn if it
    has been computed. Of a Band the same at every frequency, about its centre or its model. Of a
    MatrixFraction: samples, model with its standard deviation, residual. Of a FrequencyResponse:
    bound, noise and distortion, singular values, coherence, and the spectra of the records. Of a StructuredWeight
    the weight of every block above its bound. Of a model its response. Of a ControllerDesign the open loop of every plant.

    Parameters
    ----------
    result : Identification, Band, WorstCaseError, WorstCaseOverPoles, MatrixFraction, FrequencyResponse, StructuredWeight or
        control.StateSpace
    models : model, sequence of models, or mapping from names to them, optional
        Of an Identification or a FrequencyResponse: further models with the sample time of the data, or results that have one.
    data : FrequencyResponse, optional
        What a MatrixFraction was fitted to: gives the names of the signals and the noise.
    records : TimeRecord or sequence of TimeRecord, optional
        What a FrequencyResponse was estimated from.
    ax : matplotlib axes or sequence of them, optional
        One for each panel.

    Returns
    -------
    matplotlib.figure.Figure
        Of many frequency points the smallest and largest values of short intervals are drawn.

    Raises
    ------
    InputError, InputTypeError
        If a model has other signals or another sample time, `data` isn't what was fitted, or an argument doesn't belong
        to this kind of result.

    Examples
    --------
    >>> import robustid as rid
    >>> experiment = rid.datasets.flexible_structure(lines=5)
    >>> prior = rid.Prior(gain_bound=20.0, decay_rate=1.04)
    >>> result = rid.identify(rid.MixedProblem(frequency=experiment.frequency, prior=prior))
    >>> figure = rid.plot.bode(result, models={"the plant itself": experiment.truth})
    >>> figure.axes[1].get_xlabel()
    'frequency [Hz]'
    """
    import control

    result = as_frequency_response("result", result) if hasattr(result, "frdata") else as_state_space("result", result)
    kinds: dict[type, tuple[Callable[..., Chart], tuple[str, ...]]] = {
        Identification: (identified_bode, ("models",)),
        WorstCaseError: (guaranteed_bode, ()),
        WorstCaseOverPoles: (pole_box_chart, ()),
        Band: (centre_chart, ()),
        StructuredWeight: (weights_chart, ()),
        MatrixFraction: (fit_bode, ("data",)),
        FrequencyResponse: (response_bode, ("records", "models")),
        control.StateSpace: (model_chart, ()),
        Family: (family_chart, ()),
        ControllerDesign: (open_loop_bode, ()),
    }
    return drawn(kinds, result, {"models": models, "data": data, "records": records}, ax)


def time_response(result: Identification | ResponseTube, *, models: Models = None, ax: Where = None) -> Figure:
    """Draw a response in time.

    Of an Identification: every record with the interval of each sample against the models (a record from an unknown state is
    compared with the best free response of the parametric part added), and their step and pulse responses. Of a
    ResponseTube: the model inside the tube that no consistent system leaves, and the records of the same input; proved at
    the samples of the tube.

    Parameters and errors as for `bode`.

    Examples
    --------
    >>> import numpy as np, robustid as rid
    >>> record = rid.TimeRecord(np.ones(4), [0.5, 0.75, 0.875, 0.94], dt=0.01, bound=0.01, outputs=["torsion [rad]"])
    >>> prior = rid.Prior(gain_bound=2.0, decay_rate=1.2)
    >>> result = rid.identify(rid.MixedProblem(time=record, prior=prior))
    >>> [axes.get_ylabel() for axes in rid.plot.time_response(result).axes]
    ['torsion [rad]', 'torsion [rad]', 'torsion [rad]']
    >>> len(rid.plot.time_response(rid.guarantee.response_tube(result, input="step", horizon=4)).axes)
    1
    """
    kinds = {
        Identification: (identified_time, ("models",)),
        ResponseTube: (tube_chart, ()),
        ControllerDesign: (step_chart, ()),
    }
    return drawn(kinds, result, {"models": models}, ax)


def schedule(result: Family, *, ax: Where = None) -> Figure:
    """Draw how band and poles of a family move with amplitude, position or load.

    At the frequencies with the widest bands the range of the magnitude of every member; natural frequency and damping of every
    parametric mode, with the pole-uncertainty box where there is one. Between the members, and beyond them, nothing is
    proved: lines are drawn for the eye, between modes that are each other's nearest.

    Parameters and errors as for `bode`.

    Examples
    --------
    >>> import numpy as np, robustid as rid
    >>> omega, prior = np.array([0.5, 1.5, 2.5]), rid.Prior(gain_bound=2.0, decay_rate=1.5)
    >>> def plant(gain):
    ...     frf = rid.FrequencyResponse(omega, gain * (1 + 0.3 * np.exp(-1j * omega)), bound=0.05, dt=1.0)
    ...     return rid.identify(rid.MixedProblem(frequency=frf, prior=prior))
    >>> two = rid.family([rid.guarantee.Member(plant(g), load=g) for g in (0.8, 1.0)], omega=omega, directions=4)
    >>> rid.plot.schedule(two).axes[0].get_xlabel()
    'load'
    """
    return drawn({Family: (schedule_chart, ())}, result, {}, ax)


def residuals(result: Identification, *, models: Models = None, ax: Where = None) -> Figure:
    r"""Draw \|residual\|/bound of every sample, with the limit 1 and the margin, and the samples that touch it.

    A panel for each entry or output, or for what shares a bound (the norm of those samples together). Samples within 1 % of
    max(1, margin) are marked; beyond a ratio of 3 the axis is logarithmic, and ratios below 1e-3 are drawn at 1e-3.

    Parameters and errors as for `bode`.

    Examples
    --------
    >>> import numpy as np, robustid as rid
    >>> record = rid.TimeRecord(np.ones(4), [0.5, 0.75, 0.875, 0.94], dt=0.01, bound=0.01)
    >>> prior = rid.Prior(gain_bound=2.0, decay_rate=1.2)
    >>> result = rid.identify(rid.MixedProblem(time=record, prior=prior))
    >>> rid.plot.residuals(result).axes[0].get_ylabel()
    '|residual| / bound'
    """
    return drawn({Identification: (identified_residuals, ("models",))}, result, {"models": models}, ax)


def poles(
    result: Identification | MatrixFraction,
    *,
    models: Models = None,
    data: FrequencyResponse | None = None,
    ax: Where = None,
) -> Figure:
    """Draw poles in their plane, and damping over frequency.

    Of an Identification in the z-plane with the unit circle and the circle 1/rho; of a MatrixFraction with one standard deviation.

    Parameters and errors as for `bode`.

    Examples
    --------
    >>> import numpy as np, robustid as rid
    >>> omega = np.linspace(1, 9, 60)
    >>> fit = rid.fit_mfd(rid.FrequencyResponse(omega, 1 / ((1j * omega) ** 2 + 0.2j * omega + 16)), order=2)
    >>> [axes.get_xlabel() for axes in rid.plot.poles(fit).axes]
    ['real part of s/2π [Hz]', 'natural frequency [Hz]']
    """
    kinds = {Identification: (pole_chart, ("models",)), MatrixFraction: (fit_poles, ("data",))}
    return drawn(kinds, result, {"models": models, "data": data}, ax)


def hankel(result: Identification, *, reduction: Reduction | None = None, ax: Where = None) -> Figure:
    """Draw the Hankel singular values of the full model, with the order that a `reduction` of it chose.

    Parameters and errors as for `bode`.

    Examples
    --------
    >>> import numpy as np, robustid as rid
    >>> record = rid.TimeRecord(np.ones(4), [0.5, 0.75, 0.875, 0.94], dt=0.01, bound=0.01)
    >>> prior = rid.Prior(gain_bound=2.0, decay_rate=1.2)
    >>> result = rid.identify(rid.MixedProblem(time=record, prior=prior))
    >>> rid.plot.hankel(result).axes[0].get_title(loc="left")
    'Hankel singular values'
    """
    return drawn({Identification: (hankel_chart, ("reduction",))}, result, {"reduction": reduction}, ax)


def convergence(result: MatrixFraction, *, ax: Where = None) -> Figure:
    """Draw the cost after every iteration, and the condition number of its normal matrix less one, not below machine epsilon.

    Source: `voorhoeve2016` figure 5.

    Parameters and errors as for `bode`.

    Examples
    --------
    >>> import numpy as np, robustid as rid
    >>> omega = np.linspace(1, 9, 60)
    >>> values = (1 + 0.1 * np.cos(9 * omega)) / ((1j * omega) ** 2 + 0.2j * omega + 16)
    >>> fit = rid.fit_mfd(rid.FrequencyResponse(omega, values), order=2)
    >>> [axes.get_ylabel() for axes in rid.plot.convergence(fit).axes]
    ['cost [–]', 'κ − 1 [–]']
    """
    return drawn({MatrixFraction: (fit_convergence, ())}, result, {}, ax)


def orders(result: OrderSweep | Reduction | ModelWorth, *, ax: Where = None) -> Figure:
    """Draw what was found at every order.

    Of an OrderSweep: singular values of the subspace estimate; cost, MDL and AIC. Of a Reduction from `reduce_within_bounds`: the
    largest error over what is allowed, at the samples and where nothing was measured. Of a ModelWorth: the misfit of the best fits
    and of the small model.

    Parameters and errors as for `bode`.

    Raises
    ------
    InputError
        If a Reduction comes from a truncation, which tried no orders.

    Examples
    --------
    >>> import numpy as np, robustid as rid
    >>> record = rid.TimeRecord(np.ones(4), [0.5, 0.75, 0.875, 0.94], dt=0.01, bound=0.01)
    >>> prior = rid.Prior(gain_bound=2.0, decay_rate=1.2)
    >>> small = rid.reduce_within_bounds(rid.identify(rid.MixedProblem(time=record, prior=prior)))
    >>> rid.plot.orders(small).axes[0].get_xlabel()
    'order [–]'
    """
    kinds = {OrderSweep: order_chart, Reduction: tried_orders, ModelWorth: worth_chart}
    return drawn({kind: (chart, ()) for kind, chart in kinds.items()}, result, {}, ax)


def stabilisation(result: OrderSweep, *, ax: Where = None) -> Figure:
    """Draw every oscillating pole of every order at its frequency, over the sum of all magnitudes.

    A physical mode keeps its frequency and damping from order to order.

    Parameters and errors as for `bode`.

    Examples
    --------
    >>> import numpy as np, robustid as rid
    >>> s = 1j * np.linspace(1, 9, 60)
    >>> noise = 0.003 * np.exp(1j * np.random.default_rng(0).uniform(0, 7, 60))
    >>> frf = rid.FrequencyResponse(s.imag, (1 + noise) / (s**2 + 0.2 * s + 16))
    >>> rid.plot.stabilisation(rid.fits.suggest_order(frf, orders=[2, 3])).axes[0].get_ylabel()
    'order [–]'
    """
    return drawn({OrderSweep: (stabilisation_chart, ())}, result, {}, ax)


explain(__name__, __all__)

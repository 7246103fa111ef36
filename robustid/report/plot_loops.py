"""Figures of loops and controllers: worst cases, open loops, stability; `robustid.plot` has them with the others."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from robustid.controllers import ControllerDesign
from robustid.guarantees import Interconnection, LoopBounds, RobustStabilityMargin, WorstCaseError
from robustid.reduction import PlantReduction
from robustid.report.design_charts import design_chart
from robustid.report.drawn import drawn
from robustid.report.loci import loci_chart
from robustid.report.loop_section import loop_chart
from robustid.report.stability import stability_chart
from robustid.report.value_sets import nyquist_chart
from robustid.report.with_matplotlib import draw

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from robustid.report.drawn import Where


def nyquist(result: WorstCaseError | Interconnection, *, ax: Where = None) -> Figure:
    """Draw at every frequency the polygon that holds every consistent value, values that are reached, and the discs of the data.

    Beside it the polygons of the largest errors around the model, to scale. Of a MIMO problem a row for every entry, at the
    frequencies at which the largest singular value of the error is largest. Of an Interconnection: eigenvalues of the product of
    both models, with discs that hold those of every pair.

    Parameters and errors as for `bode`.

    Examples
    --------
    >>> import numpy as np, robustid as rid
    >>> frf = rid.FrequencyResponse([1.0, 5.0], [1.0, 0.9 - 0.2j], bound=0.05, dt=0.1)
    >>> result = rid.identify(rid.MixedProblem(frequency=frf, prior=rid.Prior(gain_bound=1.5, decay_rate=1.4)))
    >>> figure = rid.plot.nyquist(rid.worst_case_error(result, omega=[2.0], directions=4))
    >>> [axes.get_title(loc="left") for axes in figure.axes]
    ['Values at the frequencies', 'Largest errors, around the model']
    """
    return drawn({WorstCaseError: (nyquist_chart, ()), Interconnection: (loci_chart, ())}, result, {}, ax)


def stability(result: RobustStabilityMargin | Mapping[str, RobustStabilityMargin], *, ax: Where = None) -> Figure:
    """Draw the upper bound of the structured singular value over frequency, its largest value, and the limit 1.

    Below 1 at every frequency a controller stabilises every plant of the set. The bound holds on whole arcs. Several margins, by
    the names of their controllers, are drawn in one figure.

    Parameters and errors as for `bode`.

    Examples
    --------
    >>> import control, numpy as np, robustid as rid
    >>> nominal, gain = control.ss(0.5, 1.0, 1.0, 0.0, 1.0), control.ss([], [], [], 0.25, 1.0)
    >>> margin = rid.guarantee.robust_stability_margin(nominal, gain, [0.0, 1.0, np.pi], [0.5, 0.5])
    >>> rid.plot.stability(margin).axes[0].get_ylabel()
    'upper bound [–]'
    """
    return draw(stability_chart(result), ax)


def loop(result: LoopBounds, *, plant: PlantReduction | None = None, ax: Where = None) -> Figure:
    """Draw the plant of a loop with the range of every consistent one, and the largest S and T.

    Parameters
    ----------
    result : LoopBounds
        From `loop_bounds`.
    plant : PlantReduction, optional
        From `reduce_plant`: the model that is drawn in the range. Default: its centre.
    ax : matplotlib axes, optional
        One for each panel.

    Returns
    -------
    matplotlib.figure.Figure
    """
    return drawn({LoopBounds: (loop_chart, ("plant",))}, result, {"plant": plant}, ax)


def design(result: ControllerDesign, *, ax: Where = None) -> Figure:
    """Draw the largest S, T, P S and C S of a designed controller with any consistent plant, and the limits that they keep.

    Parameters
    ----------
    result : ControllerDesign
        From `design_controller`; of one that found no controller there is nothing to draw.
    ax : matplotlib axes, optional
        One for each panel.

    Returns
    -------
    matplotlib.figure.Figure
    """
    return drawn({ControllerDesign: (design_chart, ())}, result, {}, ax)

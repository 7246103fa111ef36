"""Figures of measurements: records, two measurements beside each other, and the history of a watch."""

from __future__ import annotations

from typing import TYPE_CHECKING

from robustid.data import TimeRecord
from robustid.guarantees import Watch
from robustid.identification import Comparison
from robustid.report.comparison_page import comparison_chart
from robustid.report.drawn import drawn
from robustid.report.record_charts import record_chart
from robustid.report.watch_page import history_chart

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from robustid.report.drawn import Where


def record(result: TimeRecord, *, ax: Where = None) -> Figure:
    """Draw every input and output of a record over time, with the bounds of the outputs, and their spectra beside them.

    Spectra are the amplitudes of the sines that make up the whole record, its mean taken off.

    Parameters and errors as for `bode`.

    Examples
    --------
    >>> import numpy as np, robustid as rid
    >>> step = rid.TimeRecord(np.ones(4), [0.5, 0.75, 0.875, 0.94], dt=0.01, bound=0.01, outputs=["torsion [rad]"])
    >>> [axes.get_title(loc="left") for axes in step.plot().axes[2:]]
    ['output torsion [rad]', 'its spectrum']
    """
    return drawn({TimeRecord: (record_chart, ())}, result, {}, ax)


def comparison(result: Comparison, *, ax: Where = None) -> Figure:
    """Draw two responses, their difference, and the limit that noise alone reaches nowhere; what lies beyond is marked.

    Parameters and errors as for `bode`.

    Examples
    --------
    >>> import robustid as rid
    >>> first, second = (rid.FrequencyResponse([1.0, 2.0, 3.0], [1.0, value, 1.0], bound=0.1) for value in (1.0, 1.5))
    >>> rid.compare(first, second).plot().axes[2].get_ylabel()
    'difference'
    """
    return drawn({Comparison: (comparison_chart, ())}, result, {}, ax)


def history(result: Watch, *, ax: Where = None) -> Figure:
    """Draw the scores of the records of a watch in their order, its alarms, and the evidence of a drift.

    Parameters and errors as for `bode`.

    Examples
    --------
    >>> import robustid as rid
    >>> def record(value):
    ...     return rid.FrequencyResponse([1.0, 2.0], [1.0, value], bound=0.01)
    >>> found = rid.watch(record(0.5).with_bound(0.1), usual=[record(0.52), record(0.48)]).update(record(0.55))
    >>> [axes.get_ylabel() for axes in found.plot().axes]
    ['score [–]', 'evidence of a drift [–]']
    """
    return drawn({Watch: (history_chart, ())}, result, {}, ax)

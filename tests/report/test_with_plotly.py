"""Charts as plotly draws them."""

import numpy as np

from robustid.report.charts import Axis, Layer, Panel
from robustid.report.frequency import frequency_charts
from robustid.report.poles import pole_chart
from robustid.report.residual_charts import residual_chart
from robustid.report.with_plotly import plotly_figure


def test_plotly_accepts_and_holds_the_numbers_of_the_chart(consistent):
    import plotly.graph_objects as go

    for chart in (frequency_charts(consistent)[0], residual_chart(consistent), pole_chart(consistent)):
        figure = plotly_figure(chart.panels[:1], 400)
        go.Figure(figure)  # refuses unknown or malformed properties
        for trace, layer in zip(figure["data"], chart.panels[0].layers, strict=True):
            np.testing.assert_array_equal(np.array(trace["y"], float), layer.y)
            if layer.low is not None:
                np.testing.assert_allclose(layer.y - trace["error_y"]["arrayminus"], layer.low, atol=1e-12)


def test_ticks_of_large_numbers_have_prefixes():
    """2G in place of 2e+9; smaller ones are written in full, wider ranges as powers of ten."""
    curve = (Layer("x", np.array([1.0, 2.0]), np.array([1.0, 2.0]), "#000000"),)
    ranges = {(1e9, 5e9): "~s", (10.0, 200.0): "~g", (1.0, 1e9): None}
    for range_, wanted in ranges.items():
        panel = Panel("x", Axis("frequency [Hz]", log=True, range=range_), Axis("y"), curve)
        assert plotly_figure((panel,), 400)["layout"]["xaxis"].get("tickformat") == wanted

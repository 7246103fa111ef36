"""Charts as matplotlib draws them."""

import itertools

import matplotlib
import matplotlib._pylab_helpers as helpers
import numpy as np
import pytest

import robustid as rid
from robustid.data import FrequencyResponse
from robustid.report import plot
from robustid.report.charts import Axis, Chart, Layer, Panel
from robustid.report.frequency import frequency_charts
from robustid.report.with_matplotlib import draw as drawn
from support.cases import slow
from support.frf_records import HZ
from support.matrix_pages import measured
from support.matrix_pages import problem as matrix_problem
from support.report_pages import problem


def all_plots(result, models=None):
    plots = (plot.bode, plot.time_response, plot.residuals, plot.poles)
    return [*(draw(result, models=models) for draw in plots), plot.hankel(result)]


def test_every_axis_has_a_label_with_its_unit(consistent):
    frequency, time, residuals, _, hankel = all_plots(consistent)
    assert frequency.axes[0].get_ylabel() == "torsion [rad] / current [A]"
    assert frequency.axes[1].get_ylabel() == "phase [°] of\ntorsion / current"
    assert frequency.axes[1].get_xlabel() == residuals.axes[0].get_xlabel() == "frequency [Hz]"
    assert [ax.get_xlabel() for ax in time.axes] == ["time [s]"] * 3
    assert [ax.get_ylabel() for ax in time.axes] == ["torsion [rad]"] * 3
    assert "1 A" in time.axes[1].get_title(loc="left")
    assert "torsion [rad] / current [A]" in hankel.axes[0].get_ylabel()
    assert [ax.get_title(loc="left") for ax in residuals.axes] == [
        "torsion [rad] / current [A]: frequency samples",
        "torsion [rad]: time samples",
    ]
    for figure in (*all_plots(consistent), plot.hankel(consistent)):
        figure.canvas.draw()
        assert all(ax.get_ylabel() for ax in figure.axes)
        assert figure.axes[-1].get_xlabel()


def test_matplotlib_draws_the_numbers_of_the_chart(consistent):
    figure, chart = plot.bode(consistent), frequency_charts(consistent)[0]
    for ax, panel in zip(figure.axes, chart.panels, strict=True):
        lines = {line.get_color(): line for line in ax.lines if line.get_linestyle() == "-"}
        for layer in panel.layers:
            if layer.dash:
                np.testing.assert_array_equal(lines[layer.colour].get_ydata(), layer.y)
        bars = ax.containers[0].lines[2][0].get_segments()
        data = panel.layers[-1]
        np.testing.assert_allclose([s[:, 1] for s in bars], np.stack([data.low, data.high], axis=1))


def test_the_legend_covers_no_data(inconsistent):
    for figure in all_plots(inconsistent, {"plant": rid.datasets.flexible_structure().truth}):
        figure.canvas.draw()
        legend = figure.legends[0].get_window_extent()
        assert not any(legend.overlaps(ax.get_window_extent()) for ax in figure.axes)
        assert legend.x1 <= figure.bbox.x1


def test_plots_leave_no_global_state(simple):
    open_figures = len(helpers.Gcf.figs)
    with matplotlib.rc_context({"font.size": 5.0, "axes.grid": False}):
        all_plots(simple)
        assert matplotlib.rcParams["font.size"] == 5.0
        assert not matplotlib.rcParams["axes.grid"]
    assert len(helpers.Gcf.figs) == open_figures


def test_text_of_the_user_is_not_mathematics():
    names = {"inputs": [("cost $a$ and $\\bad{", "$")], "outputs": [("y_1^2", "<b>m</b>")]}
    result = rid.identify(problem(**names))
    figure = plot.bode(result, models={"$\\nothing": rid.datasets.flexible_structure().truth})
    figure.canvas.draw()
    assert "a" in figure.axes[0].get_ylabel()


@pytest.mark.parametrize("fitted", [False, slow(True)])
def test_labels_of_narrow_columns_do_not_overlap(fitted):
    """Four columns of logarithmic frequency."""
    omega = HZ * np.geomspace(4, 1200, 60)
    values = np.array([[1, 2, 1, 0.5]]) / (1j * omega / 300 + 1)[:, None, None] ** 2
    frf = FrequencyResponse(omega, values, bound=1e-3)
    figure = plot.bode(rid.fit_mfd(frf.select(slice(None, None, 2)), order=2) if fitted else frf)
    renderer = figure.canvas.get_renderer() if hasattr(figure.canvas, "get_renderer") else None
    figure.draw_without_rendering()
    for axes in figure.axes:
        for axis, side in ((axes.xaxis, 0), (axes.yaxis, 1)):
            boxes = [
                label.get_window_extent(renderer)
                for label in axis.get_majorticklabels()
                if label.get_visible() and label.get_text()
            ]
            spans = sorted((box.min[side], box.max[side]) for box in boxes)
            assert all(end < start for (_, end), (start, _) in itertools.pairwise(spans))
            assert spans or not axis.get_tick_params().get("labelbottom", True)


def test_figures_hold_the_grid_and_a_blank_place_leaves_its_column_logarithmic(matrix_result):
    axes = plot.bode(matrix_result).axes
    assert len(axes) == 10
    assert [ax.get_visible() for ax in axes] == [True] * 9 + [False]
    assert {ax.get_xscale() for ax in axes} == {"log"}
    assert [ax.get_title(loc="left") for ax in axes[:2]] == ["y1 / u1", "y1 / u2"]
    assert sum(ax.get_visible() for ax in plot.time_response(matrix_result).axes) == 2 + 8
    assert sum(ax.get_visible() for ax in plot.residuals(matrix_result).axes) == 6


def test_long_names_stay_inside_their_column():
    motors = [f"force of the left-hand voice-coil motor {k} [N]" for k in range(3)]
    data = measured(1, 3, lines=4, outputs=["acceleration of the measuring beam at its tip [mm/s²]"], inputs=motors)
    figure = plot.bode(rid.identify(matrix_problem(data)))
    figure.draw_without_rendering()
    titles = [ax._left_title.get_window_extent() for ax in figure.axes[:3]]
    ends = [*(title.x0 for title in titles[1:]), figure.bbox.x1]
    assert all(title.x1 < end for title, end in zip(titles, ends, strict=True))


def test_an_axis_of_which_all_is_infinite_or_zero_is_drawn_without_logarithms():
    x = np.array([1.0, 10.0])
    for y in (np.full(2, np.inf), np.zeros(2)):
        panel = Panel("", Axis("frequency [Hz]", log=True), Axis("error", log=True), [Layer("bound", x, y, "black")])
        figure = drawn(Chart("error", [panel]))
        figure.canvas.draw()
        assert figure.axes[0].get_yscale() == "linear"

"""Public figures: one name for every kind of result, and axes of the user."""

import control
import numpy as np
import pytest
from matplotlib.figure import Figure

import robustid as rid
from robustid.report.words import HZ

pytestmark = pytest.mark.quick


def test_the_names_are_found_by_completion():
    assert dir(rid.plot) == sorted(rid.plot.__all__)
    assert {"bode", "nyquist", "poles", "residuals", "time_response"} <= set(dir(rid.plot))


def test_one_panel_is_drawn_on_axes_of_the_user(consistent):
    figure = Figure(figsize=(6, 4))
    first, second = figure.subplots(2, 1)
    assert rid.plot.hankel(consistent, ax=first) is figure
    assert first.get_title() == "Hankel singular values"
    assert [text.get_text() for text in first.get_legend().get_texts()] == ["of the nominal model"]
    assert first.get_yscale() == "log"
    assert not second.lines
    figure.canvas.draw()


def test_several_panels_take_as_many_axes(consistent):
    figure = Figure()
    axes = figure.subplots(2, 1)
    rid.plot.bode(consistent, ax=axes)
    own = rid.plot.bode(consistent).axes
    assert [ax.get_ylabel() for ax in axes] == [ax.get_ylabel() for ax in own]
    for one, other in zip(axes, own, strict=True):
        for line, expected in zip(one.lines, other.lines, strict=True):
            np.testing.assert_array_equal(line.get_ydata(), expected.get_ydata())
    with pytest.raises(rid.InputError, match="each of the 2 panels of this figure; got 1"):
        rid.plot.bode(consistent, ax=axes[0])
    with pytest.raises(rid.errors.InputTypeError, match="`ax` must be matplotlib axes, or a sequence of them; got str"):
        rid.plot.bode(consistent, ax="here")


@pytest.mark.parametrize("dt", [0, 0.01])
def test_a_model_alone_is_resolved_at_its_light_mode(dt):
    model = control.ss([[0, 1], [-(HZ**2), -0.004 * HZ]], [[0], [1]], [[1, 0]], 0)
    model = control.sample_system(model, dt) if dt else model
    magnitude, phase = rid.plot.bode(model).axes
    (line,) = magnitude.lines
    hz, size = line.get_xdata(), line.get_ydata()
    at = np.exp(1j * HZ * hz * dt) if dt else 1j * HZ * hz
    np.testing.assert_allclose(size, np.abs(model(at)), rtol=1e-8)
    peak = np.abs(model(np.exp(1j * HZ * dt) if dt else 1j * HZ))
    assert size.max() > 0.99 * peak
    assert phase.get_ylabel() == "phase [°]"
    assert hz[-1] <= (50.0 if dt else np.inf)


def test_a_model_with_several_entries_and_without_a_mode():
    static = control.ss([], [], [], [[1.0, 2.0], [3.0, 4.0]], 0.1)
    figure = rid.plot.bode(static)
    assert [ax.get_title(loc="left") for ax in figure.axes[:2]] == ["y[0] / u[0]", "y[0] / u[1]"]
    with pytest.raises(rid.InputError, match="without a sample time"):
        rid.plot.bode(control.ss(0.5, 1, 1, 0, True))


def test_an_option_of_another_kind_of_result_is_refused(consistent):
    with pytest.raises(rid.errors.InputTypeError, match="`records` doesn't belong to a Identification; leave it out"):
        rid.plot.bode(consistent, records=consistent.problem.time[0])
    with pytest.raises(
        rid.errors.InputTypeError, match="`result` must be of class Identification or MatrixFraction; got int"
    ):
        rid.plot.poles(1)


def test_results_draw_themselves(consistent, error, fit, sweep):
    labels = {
        consistent: "torsion [rad] / current [A]",
        error: "displacement [mm] / force [N]",
        fit: "magnitude",
        sweep: "singular value [–]",
    }
    for result, label in labels.items():
        assert result.plot().axes[0].get_ylabel().startswith(label)
    figure = Figure()
    assert consistent.plot(ax=figure.subplots(2, 1)) is figure
    with pytest.raises(rid.InputError, match="tries no orders"):
        rid.balanced_truncation(consistent.model, order=4).plot()

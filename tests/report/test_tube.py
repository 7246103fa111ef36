"""Tubes in time: real ones, against their own arrays and against records of the same input."""

import dataclasses

import numpy as np
import pytest

import robustid as rid
from robustid.core import simulate
from robustid.guarantees import response_tube
from robustid.report import at_least, at_most, plot, render_report
from robustid.report.charts import REACHED
from robustid.report.time_response import tube_chart, tube_rows, tube_sentence
from support.report_pages import NASTY, NASTY_NAMES, Page, check_escaped, named

STEP = np.ones(5)


def identified(*inputs, **names):
    """g_k = 0.5^(k + 1) from records of these inputs; the last sample of each isn't used."""
    records = []
    for u in map(np.asarray, inputs):
        y = np.convolve(u, 0.5 ** np.arange(1, u.size + 1))[: u.size]
        bound = np.append(np.full(u.size - 1, 0.02 * np.abs(u).max()), np.inf)
        records.append(
            rid.TimeRecord(u, y, dt=0.1, bound=bound, **({"inputs": ["force [N]"], "outputs": ["x [mm]"]} | names))
        )
    return rid.identify(rid.MixedProblem(time=tuple(records), prior=rid.Prior(gain_bound=2.5, decay_rate=1.5)))


@pytest.fixture(scope="module")
def result():
    return identified(STEP, -4 * STEP, [1.0, 0.0, 1.0, 1.0])


@pytest.fixture(scope="module")
def step(result):
    return response_tube(result, input="step", horizon=8)


def test_range_model_and_reached_values_are_those_of_the_tube(step):
    (panel,) = tube_chart(step).panels
    assert panel.title == "Step response: force rises by 1 N at 0 s"
    assert (panel.x.label, panel.y.label) == ("time [s]", "x [mm]")
    area = named(panel, "guaranteed range (8 samples)")
    np.testing.assert_allclose(area.x, 0.1 * np.arange(8))
    np.testing.assert_allclose([area.low, area.high], [step.lower, step.upper], atol=1e-12)
    curve = named(panel, f"model, order {step.model.nstates}")
    np.testing.assert_allclose(curve.y, step.nominal, atol=1e-12)
    reached = named(panel, REACHED)
    np.testing.assert_array_equal(reached.x, np.tile(step.times, 2))
    np.testing.assert_array_equal(reached.y, [*step.attained[:, 0], *step.attained[:, 1]])


def test_records_of_the_same_input_are_shown_and_scaled(result, step):
    layers = {layer.name: layer for layer in tube_chart(step).panels[0].layers}
    own, scaled = layers["record 1 with its intervals"], layers["record 2 with its intervals, divided by −4"]
    assert not any(name.startswith("record 3") for name in layers)  # another input
    for layer in (own, scaled):
        np.testing.assert_allclose(layer.y, 1 - 0.5 ** np.arange(1, 5))
        np.testing.assert_allclose([layer.y - layer.low, layer.high - layer.y], 0.02)
    # The first sample of any input from zero initial conditions is that of a pulse, and of a given input all those that agree.
    pulse = tube_chart(response_tube(result, input="impulse", horizon=1)).panels[0]
    assert sum(layer.name.startswith("record") for layer in pulse.layers) == 3
    given = tube_chart(response_tube(result, input=[1.0, 0.0, 1.0, 1.0])).panels[0]
    assert given.title == "Response to the given force"
    assert [layer.name for layer in given.layers if layer.name.startswith("record")] == ["record 3 with its intervals"]


def test_a_record_that_does_not_start_with_zero_initial_conditions_is_no_response(step):
    problem = step.identification.problem
    free = dataclasses.replace(problem.time[0], initial="free", past_input_bound=1.0)
    other = rid.identify(dataclasses.replace(problem, time=free))
    layers = tube_chart(response_tube(other, input="step", horizon=3)).panels[0].layers
    assert not any(layer.name.startswith("record") for layer in layers)


def test_between_the_samples_the_model_leads(result):
    some = response_tube(result, input="step", horizon=9, times=[0.1, 0.3, 0.7])
    (panel,) = tube_chart(some).panels
    area, curve = named(panel, "guaranteed range (3 samples)"), named(panel, f"model, order {some.model.nstates}")
    np.testing.assert_allclose(curve.y, simulate(some.model, np.ones((9, 1)))[0][:, 0])
    np.testing.assert_allclose(area.x, 0.1 * np.arange(1, 8))
    np.testing.assert_allclose(area.low[[0, 2, 6]], some.lower, atol=1e-12)
    np.testing.assert_allclose(area.high[[0, 2, 6]], some.upper, atol=1e-12)
    offset = some.upper - some.nominal
    np.testing.assert_allclose(area.high[1] - curve.y[2], (offset[0] + offset[1]) / 2)
    assert "at 3 of the 9 samples until 0.8 s" in tube_sentence(some)


def test_matplotlib_draws_these_numbers(step):
    figure = plot.time_response(step)
    figure.canvas.draw()
    (ax,) = figure.axes
    corners = ax.collections[0].get_paths()[0].vertices
    for x, *ends in zip(step.times, step.lower, step.upper, strict=True):
        assert all(np.any(np.all(np.isclose(corners, [x, end], atol=1e-12), axis=1)) for end in ends)
    assert any(np.array_equal(line.get_ydata(), step.attained.T.ravel()) for line in ax.lines)
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("time [s]", "x [mm]")
    with pytest.raises(
        rid.errors.InputTypeError,
        match="`result` must be of class Identification, ResponseTube or ControllerDesign; got",
    ):
        plot.time_response(step.model)


def test_page_says_what_is_guaranteed_in_time(step):
    page = Page(render_report(step.identification, tube=step))
    wanted = [
        "a step of force by 1 N",
        f"within {at_most(step.error_upper.max())} mm of the model",
        f"one of {at_least(step.error_lower[np.argmax(step.error_upper)])} mm is reached there",
        f"stays below {at_most(step.peak)} mm, that of its error below {at_most(step.error_peak)} mm",
        "All 16 certificates",
        "Proved",
    ]
    assert [text for text in wanted if text not in page.text] == []
    assert "Over all time" not in page.text
    area = next(trace for trace in page.figures["tube-0"]["data"] if trace["name"].startswith("guaranteed range"))
    np.testing.assert_allclose(area["y"], [*step.upper, *step.lower[::-1]], atol=1e-12)


def test_page_of_a_pulse_bounds_the_gain_of_the_error(result):
    pulse = response_tube(result, horizon=6)
    text = Page(render_report(result, tube=pulse)).text
    assert f"at most {at_most(pulse.error_l1)} mm/N: the peak-to-peak gain" in text
    assert "Pulse response: force is 1 N during the first sample" in text
    uncertain = dict(tube_rows(dataclasses.replace(pulse, upper=np.full(6, np.inf))))
    assert "No bound" in uncertain["Over all time"]


def test_a_tube_below_its_certificates_is_not_called_proved(step):
    false = dataclasses.replace(step, upper=step.upper - 1e-3)
    page = Page(render_report(step.identification, tube=false))
    assert ("section", {"class": "verdict failed", "id": "tube-certificates"}) in page.tags
    assert "Not proved" in page.text


def test_text_of_strangers_is_escaped():
    result = identified(STEP, **NASTY_NAMES)
    for signal in ("step", "impulse", STEP):
        page = Page(
            render_report(result, tube=response_tube(result, input=signal, horizon=None if signal is STEP else 5))
        )
        check_escaped(page)
        assert NASTY in page.text


def test_misuse_is_named(step, tmp_path):
    with pytest.raises(rid.InputError, match="`tube` is about another identification"):
        rid.write_report(identified(STEP), tmp_path / "a.html", tube=step)
    assert list(tmp_path.iterdir()) == []

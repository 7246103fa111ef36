"""Records and the answers to a step and a pulse, against python-control."""

import control
import numpy as np

import robustid as rid
from robustid.report import plot, render_report
from robustid.report.identified import started
from robustid.report.time_response import answer_charts, time_chart
from support.report_pages import Page, layers


def test_records_and_step_response(consistent):
    chart = time_chart(consistent, {"plant": rid.datasets.flexible_structure().truth})
    record, bound = consistent.problem.time[0], consistent.problem.time[0].bound[:, 0]
    data, model = (
        layers(chart, 0)["data with their bounds"],
        layers(chart, 0)[f"nominal model, order {consistent.order}"],
    )
    np.testing.assert_allclose((data.y, data.low, data.high), [record.y[:, 0] + s * bound for s in (0, -1, 1)])
    simulated = control.forced_response(consistent.model, record.time, record.u[:, 0]).outputs
    np.testing.assert_allclose(model.y, simulated, atol=1e-9)
    assert np.all(np.abs(data.y - model.y) <= bound)
    step, pulse = (layers(chart, k)["plant"] for k in (1, 2))
    exact = control.step_response(rid.datasets.flexible_structure().truth, step.x)
    np.testing.assert_allclose(step.y, exact.outputs, atol=1e-10)
    np.testing.assert_allclose(np.cumsum(pulse.y), step.y, atol=1e-10)


def test_free_and_periodic_records_and_unused_samples():
    rng = np.random.default_rng(1)
    truth = rid.datasets.flexible_structure().truth
    parametric = rid.kautz(2 * np.pi * 17.67, 0.004, dt=0.01, delay=1)
    prior = rid.Prior(gain_bound=20.0, decay_rate=1.05)

    period = rng.standard_normal(16)
    y = control.forced_response(truth, None, np.tile(period, 200)).outputs
    bound = np.full(16, 0.05)
    bound[:4] = np.inf
    for initial in ("free", "periodic"):
        record = rid.TimeRecord(period, y[-16:], dt=0.01, bound=bound, initial=initial)
        result = rid.identify(rid.MixedProblem(time=record, prior=prior, parametric=parametric))
        assert result.consistent
        panel = time_chart(result).panels[0]
        drawn = {layer.name: layer for layer in panel.layers}
        data = drawn["data with their bounds"]
        assert drawn["not used"].x.size == 4
        assert np.all(np.abs(data.y - drawn[f"nominal model, order {result.order}"].y) <= data.high - data.y)
        assert started(record) in panel.title
        assert ("widened" in panel.title) == (initial == "free")
        assert started(record) in Page(render_report(result)).text
        assert plot.time_response(result).axes[0].get_title(loc="left") == panel.title


def test_every_output_of_a_record_has_its_panel(matrix_result):
    time, found = matrix_result.problem.time[0], time_chart(matrix_result).panels
    assert [panel.title for panel in found] == [
        "Record from zero initial conditions: y1",
        "Record from zero initial conditions: y2",
    ]
    _, answer = control.forced_response(matrix_result.model, U=time.u.T)[:2]
    for i, panel in enumerate(found):
        drawn = {layer.name: layer for layer in panel.layers}
        used = np.isfinite(time.bound[:, i])
        np.testing.assert_allclose(drawn[f"nominal model, order {matrix_result.order}"].y, answer[i, used], atol=1e-9)
        np.testing.assert_allclose(drawn["data with their bounds"].y, time.y[used, i])
        assert ("not used" in drawn) == (i == 0)


def test_step_and_pulse_responses_of_every_entry(matrix_result):
    for chart, (i, j) in zip(answer_charts(matrix_result), np.ndindex(2, 2), strict=True):
        step, pulse = (panel.layers[0] for panel in chart.panels)
        _, expected = control.step_response(matrix_result.model, T=step.x, input=j, output=i)
        np.testing.assert_allclose(step.y, np.squeeze(expected), atol=1e-9)
        np.testing.assert_allclose(np.cumsum(pulse.y), step.y, atol=1e-9)


def test_answers_of_a_matrix_in_continuous_time():
    """Two inputs and one output, another number than of outputs: all of them come from one exponential."""
    plant = control.ss([[-0.2, 4.0], [-4.0, -0.2]], [[1.0, 0.3], [0.0, 2.0]], [[1.0, 0.5]], np.zeros((1, 2)))
    omega = np.geomspace(0.5, 20.0, 12)
    values = np.moveaxis(plant(1j * omega, squeeze=False), 2, 0)
    frf = rid.FrequencyResponse(omega, values, bound=0.02)
    basis = rid.kautz([4.0], [0.05], dt=0)
    result = rid.identify(rid.MixedProblem(frequency=frf, prior=rid.Prior(gain_bound=0.5, decay=0.5), parametric=basis))
    for chart, j in zip(answer_charts(result, {"plant": plant}), range(2), strict=True):
        step, pulse = (layers(chart, k)["plant"] for k in range(2))
        for drawn, expected in ((step, control.step_response), (pulse, control.impulse_response)):
            np.testing.assert_allclose(
                drawn.y, np.squeeze(expected(plant, T=drawn.x, input=j, output=0).outputs), atol=1e-9
            )

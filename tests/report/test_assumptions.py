"""What was assumed and measured, in words."""

import control
import numpy as np

import robustid as rid
from robustid.data import FrequencyResponse, TimeRecord
from robustid.report.assumptions import assumptions, bound_source, experiments
from robustid.report.frequency import bars_words
from robustid.report.residual_charts import residual_chart
from robustid.report.response_charts import ResponseView
from robustid.report.response_page import summary_rows
from support.matrix_pages import DT, measured, problem, record, response_of, with_values
from support.report_pages import printed


def test_poles_at_zero_are_called_a_delay():
    frf = rid.datasets.flexible_structure().frequency
    prior = rid.Prior(gain_bound=20.0, decay_rate=1.04)
    for delay, words in ((1, None), (2, "delay, 2 samples"), (3, "delay, 3 samples")):
        pairs = rid.kautz(2 * np.pi * np.array([9.0, 17.67]), [0.1, 0.004], dt=0.01, delay=delay)
        result = rid.identify(rid.MixedProblem(frequency=frf, prior=prior, parametric=pairs))
        said = dict(assumptions(result))["Parametric part"]
        assert "time constant" not in said
        assert said.endswith(f"{words or 'damping 0.004'}.")
        assert said.count("delay") == (words is not None)
    twice = rid.kautz(2 * np.pi * 17.67, 0.004, dt=0.01, delay=1, repeat=2)
    result = rid.identify(rid.MixedProblem(frequency=frf, prior=prior, parametric=twice))
    said = dict(assumptions(result))["Parametric part"]
    assert said.count("17.67 Hz") == said.count("(2 times)") == 1

    taps = control.ss(np.eye(3, k=-1), np.eye(3, 1), np.eye(3), 0, 0.01)
    result = rid.identify(rid.MixedProblem(frequency=frf, prior=prior, parametric=taps))
    assert dict(assumptions(result))["Parametric part"].endswith("poles: none but delays, 1 to 3 samples.")
    assert "delay" in printed(result, rid.balanced_truncation(taps[0, 0], order=1))


def test_the_identification_report_states_the_kind_of_bound():
    for kind, probability, note, words in (
        ("hard", None, "", "hard bound: source not stated"),
        ("hard", None, "data sheet", "hard bound: data sheet"),
        ("noise_floor", None, "largest of 500 samples", "bound from the noise floor: largest of 500 samples"),
        ("confidence", 0.95, "3 periods", "confidence bound, 95 % jointly: 3 periods"),
    ):
        bound = rid.Bound(0.1, kind=kind, probability=probability)
        assert bound_source(FrequencyResponse([1.0, 2.0], [1.0, 2.0], bound=bound, note=note)) == words
    record = TimeRecord(
        np.ones(4), [0.5, 0.75, 0.875, 0.94], dt=0.01, bound=rid.Bound(0.01, kind="noise_floor"), note="a pause"
    )
    result = rid.identify(rid.MixedProblem(time=record, prior=rid.Prior(gain_bound=2.0, decay_rate=1.2)))
    assert experiments(result)[0].source == "bound from the noise floor: a pause"


def test_the_class_is_said_as_it_is_meant():
    frf = measured(lines=6, outputs=["x [mm]", "angle [rad]"], inputs=["force [N]", "torque [Nm]"])
    said = dict(assumptions(rid.identify(problem(frf))))
    assert "σmax(G) ≤ K = 0.5 (largest singular value, in the different units of the entries)" in said["Prior"]
    assert "4 functions with free matrices as coefficients" in said["Parametric part"]
    assert set(said) == {"Prior", "Parametric part", "Bounds"}
    prior = rid.Prior(gain_bound=0.5, decay_rate=1.15, scaling=[[1.0, 2.0], [3.0, 6.0]])
    said = dict(assumptions(rid.identify(problem(frf, prior=prior))))
    assert "σmax(G ./ S) ≤ K = 0.5 (" in said["Prior"]
    assert said["Scaling"].endswith("for force, torque: x: 1, 2; angle: 3, 6.")
    same = measured(lines=6, outputs=["x [mm]", "y [mm]"], inputs=["one [N]", "two [N]"])
    result = rid.identify(problem(same, symmetric=True, prior=rid.Prior(gain_bound=5.0, decay_rate=1.15)))
    said = dict(assumptions(result))
    assert "σmax(G) ≤ K = 5 mm/N (largest singular value)" in said["Prior"]
    assert "symmetric matrix" in said["Symmetry"]


def test_shared_bounds_are_said_in_words():
    frf = measured(lines=6)
    column = rid.FrequencyResponse(frf.omega, frf.values, bound=rid.Bound(0.1, joint="column"), dt=DT)
    ellipsoid = np.broadcast_to(np.diag([0.01, 0.04, 0.04, 0.01]).astype(complex), (6, 4, 4))
    whole = rid.FrequencyResponse(frf.omega, frf.values, bound=rid.Bound(joint="matrix", ellipsoid=ellipsoid), dt=DT)
    for data, words, bounds in (
        (column, "The entries of a column share one bound", ["± 0.1 for one alone"] * 2),
        (whole, "All entries at a frequency point share one bound", ["± 0.1 … 0.2 for one alone"]),
    ):
        result = rid.identify(problem(data))
        rows = experiments(result)
        assert [row.bound for row in rows] == bounds
        assert sum(row.samples for row in rows) == result.problem.samples == 24
        assert words in dict(assumptions(result))["Bounds"]
        assert words in " ".join(printed(result).split())
        assert words in dict(summary_rows(ResponseView(data)))["Bound"]


def test_experiments_are_listed_together_where_they_are_alike():
    frf = with_values(measured(lines=6), (2, 0, 1), np.nan, np.inf)
    rows = experiments(rid.identify(problem(frf, record())))
    assert [(row.of, row.samples) for row in rows] == [
        ("each of 3 entries: y1 / u1; y2 / u1; y2 / u2", 6),
        ("y1 / u2", 5),
        ("y1, from zero initial conditions", 10),
        ("y2, from zero initial conditions", 20),
    ]


def test_samples_of_combinations_of_signals_are_told_from_entries():
    frf = measured(lines=6)
    both = frf.tangential(right=[[1.0, 1.0], [1.0, -1.0]])
    result = rid.identify(problem([frf.select(slice(0, 3)), both]))
    rows = experiments(result)
    assert [row.samples for row in rows] == [3, 24]
    assert rows[1].of == "combinations of outputs / combinations of inputs"
    assert "aren’t drawn here" in bars_words(result)
    panel = residual_chart(result).panels[-1]
    error = np.abs(both.values - response_of(result.model, frf.omega) @ [[1.0, 1.0], [1.0, -1.0]]) / both.bound
    np.testing.assert_allclose(np.sort(panel.layers[0].y), np.sort(error.ravel()), rtol=1e-5, atol=1e-9)

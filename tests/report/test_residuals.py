"""Residuals against their bounds, and the active constraints."""

import dataclasses

import numpy as np
import pytest

import robustid as rid
from robustid.report.frequency import frequency_charts
from robustid.report.residual_charts import active_constraints, residual_chart
from robustid.report.words import number
from support.matrix_pages import measured, problem, record, response_of, with_values
from support.report_pages import layers, printed


def test_residual_chart_marks_exactly_who_touches(inconsistent):
    chart = residual_chart(inconsistent)
    ratios = [r.ratio for r in inconsistent.residuals]
    margin = inconsistent.margin
    assert margin > 10
    for k, ratio in enumerate(ratios):
        drawn = layers(chart, k)
        np.testing.assert_allclose(drawn[f"nominal model, order {inconsistent.order}"].y, ratio)
        touching = ratio >= 0.99 * margin
        assert drawn["touches margin × bound"].x.size == touching.sum() > 0
        assert drawn["outside its bound"].x.size == ((ratio > 1) & ~touching).sum()
        assert np.all(drawn["limit: residual = bound"].y == 1)
        assert np.all(drawn[f"smallest reachable: {number(margin)}"].y == margin)
        assert chart.panels[k].y.log


def test_residual_chart_of_consistent_data(simple, consistent):
    # |1.5 - x0| = s 0.2 with |x0| <= 1 at best: margin 2.5.
    assert simple.margin == pytest.approx(2.5, rel=1e-3)
    drawn = layers(residual_chart(simple), 0)
    np.testing.assert_allclose(drawn["touches margin × bound"].x[0], 0.0)
    assert not residual_chart(simple).panels[0].y.log
    assert active_constraints(simple)[0].place == "0 s"
    assert active_constraints(simple)[0].weight > 0.9
    assert not any("touches" in name or "outside" in name for name in layers(residual_chart(consistent), 0))
    assert active_constraints(consistent) == []


def test_residuals_stand_row_by_row_against_their_bounds(matrix_result):
    found = residual_chart(matrix_result).panels
    assert [panel.title for panel in found] == ["y1 / u1", "y1 / u2", "y2 / u1", "y2 / u2", "y1", "y2"]
    frf = matrix_result.problem.frequency[0]
    error = np.abs(frf.values - response_of(matrix_result.model, frf.omega)) / 0.05
    for panel, (i, j) in zip(found, np.ndindex(2, 2), strict=False):
        used = np.isfinite(frf.bound[:, i, j])
        np.testing.assert_allclose(panel.layers[0].y, error[used, i, j], rtol=1e-5)
    assert len({panel.y.range for panel in found[:4]}) == 1  # one scale: they are compared


def test_samples_that_share_a_bound_are_measured_together(shared_bound):
    frf, found = shared_bound.problem.frequency[0], residual_chart(shared_bound).panels
    assert [panel.title for panel in found] == [f"all outputs / u{j}, one bound" for j in (1, 2)]
    error = frf.values - response_of(shared_bound.model, frf.omega)
    for j, panel in enumerate(found):
        np.testing.assert_allclose(panel.layers[0].y, np.linalg.norm(error[:, :, j], axis=1) / 0.1, rtol=1e-5)
    samples = layers(frequency_charts(shared_bound)[1], 0)["data with their bounds (shared bound)"]
    np.testing.assert_allclose(samples.high - samples.y, 0.1)


def test_a_contradicting_sample_is_named_with_its_entry():
    frf = measured(lines=8)
    spiked = with_values(frf, (4, 1, 0), frf.values[4, 1, 0] + 3)
    result = rid.identify(problem(spiked))
    assert not result.consistent
    first = active_constraints(result)[0]
    assert (first.experiment, first.of) == ("response", "y2 / u1")
    assert first.place == f"{frf.freq_hz[4]:.5g} Hz"
    assert first.ratio == pytest.approx(abs(spiked.values - response_of(result.model, frf.omega))[4, 1, 0] / 0.05)
    assert "y2 / u1" in printed(result)


def test_a_contradicting_sample_of_a_record_is_named_with_its_output():
    time = record()
    y = np.array(time.y)
    y[5, 1] += 3
    result = rid.identify(problem(measured(lines=6), dataclasses.replace(time, y=y)))
    first = active_constraints(result)[0]
    assert (first.experiment, first.of, first.place) == ("record", "y2", "0.05 s")

"""Poles and modes, against the plant and against residues that are known."""

import control
import numpy as np
import pytest

import robustid as rid
from robustid.report import pole_table
from robustid.report.poles import modes_table, pole_chart
from robustid.report.words import number
from support.matrix_pages import DT, HZ, measured, plant, problem
from support.report_pages import layers

pytestmark = pytest.mark.quick


def test_pole_table_against_the_plant():
    plant = rid.datasets.flexible_structure().truth
    rows = pole_table(plant)
    np.testing.assert_allclose([row.hz for row in rows], [9.0, 17.67], rtol=1e-9)
    np.testing.assert_allclose([row.damping for row in rows], [0.1, 0.004], rtol=1e-8)
    tau = [1 / (2 * np.pi * 9 * 0.1), 1 / (2 * np.pi * 17.67 * 0.004)]
    np.testing.assert_allclose([row.time_constant for row in rows], tau, rtol=1e-8)
    np.testing.assert_allclose([row.modulus for row in rows], np.exp(-0.01 / np.array(tau)), rtol=1e-9)
    assert sum(row.count for row in rows) == plant.nstates


def test_pole_table_of_special_poles():
    model = control.ss(np.diag([1.0, 0.0, -0.5, 0.5]), np.ones((4, 1)), np.ones((1, 4)), 0, 0.1)
    rows = {row.pole: row for row in pole_table(model)}
    assert rows[1.0].hz == 0
    assert np.isinf(rows[1.0].time_constant)
    assert np.isnan(rows[0.0].hz)
    assert rows[0.0].time_constant == 0
    assert rows[0.5].time_constant == pytest.approx(0.1 / np.log(2))
    assert rows[0.5].damping == pytest.approx(1)
    assert rows[-0.5].hz == pytest.approx(abs(complex(-np.log(2), np.pi)) / 0.1 / (2 * np.pi))
    continuous = pole_table(control.ss([[0, 1], [-4, 0]], [[0], [1]], [[1, 0]], 0))
    assert [(row.hz, row.damping) for row in continuous] == [(pytest.approx(1 / np.pi), pytest.approx(0))]


def test_pole_table_refuses_a_model_without_sample_time():
    with pytest.raises(rid.InputError, match="without a sample time"):
        pole_table(control.ss(0.5, 1, 1, 0, True))


def test_pole_chart(consistent):
    chart = pole_chart(consistent)
    drawn = layers(chart, 0)
    circle = drawn["|z| = 1/ρ = 0.9615"]
    np.testing.assert_allclose(np.hypot(circle.x, circle.y), 1 / 1.04)
    poles = drawn[f"nominal model, order {consistent.order}"]
    np.testing.assert_allclose(np.sort_complex(poles.x + 1j * poles.y), np.sort_complex(consistent.model.poles()))
    damping = layers(chart, 1)[f"nominal model, order {consistent.order}"]
    assert damping.y.min() == pytest.approx(0.004, rel=1e-6)
    assert damping.x[np.argmin(damping.y)] == pytest.approx(17.67, rel=1e-9)


def test_modes_are_listed_with_the_height_of_their_resonance_and_their_rank():
    frf = measured(lines=12, noise=1e-3)
    result = rid.identify(problem(frf))
    basis, residues, _ = plant(2, 2)
    peaks = np.linalg.norm(np.tensordot(basis.response(HZ * np.array([6.0, 17.0]) * DT), residues, 1), 2, axis=(1, 2))
    rows = modes_table(result).rows
    assert [row[0] for row in rows] == ["6", "17"]
    np.testing.assert_allclose([float(row[2]) for row in rows], peaks, rtol=0.1)
    ratios = [mode.rank_ratio for mode in result.modes]
    assert max(ratios) < 0.05  # each of the true residues has rank one
    assert [row[4] for row in rows] == [number(ratio, 2) for ratio in ratios]
    largest = np.unravel_index(np.argmax(np.abs(residues[:2]).max(axis=0)), (2, 2))
    assert rows[0][3] == f"y{largest[0] + 1} / u{largest[1] + 1}"

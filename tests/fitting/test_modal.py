"""Modal form and mode table: systems of known modes behind a random change of coordinates."""

import control
import numpy as np
import pytest
import scipy.linalg

import robustid as rid
from robustid.fitting import Weight, fit_covariance, fit_mfd, modal_form, mode_table
from support.mfd_systems import by_control, noisy, random_modal_system
from support.pairwise import every_one
from support.refusals import refused


def hidden(rng, A, B, C, D, dt=None, spread=30.0):
    """The same system in coordinates of condition number `spread`."""
    n = len(A)
    U, V = (np.linalg.qr(rng.standard_normal((n, n)))[0] for _ in range(2))
    T = U * np.geomspace(1, spread, n) @ V
    return control.ss(np.linalg.solve(T, A @ T), np.linalg.solve(T, B), C @ T, D, dt or 0)


def with_rigid_body(seed, count, dt=None):
    """Five modes and `count` chains 1/s^2 driven by `count` of four inputs; or its zero-order-hold equivalent."""
    rng = np.random.default_rng(seed)
    A, B, C, D = random_modal_system(seed, 4, 4, 5).arrays()
    drive, shape = np.zeros((2 * count, 4)), np.zeros((4, 2 * count))
    drive[count:, :count], shape[:, :count] = rng.standard_normal((count, count)), rng.standard_normal((4, count))
    A = scipy.linalg.block_diag(A, np.eye(2 * count, k=count))
    model = control.ss(A, np.vstack([B, drive]), np.hstack([C, shape]), D, 0)
    model = model if dt is None else model.sample(dt)
    return hidden(rng, model.A, model.B, model.C, model.D, dt)


def assert_same_response(model, other, omega, tolerance):
    one, two = (by_control(m, omega) for m in (model, other))
    assert np.max(np.linalg.norm(one - two, axis=(1, 2)) / np.linalg.norm(one, axis=(1, 2))) <= tolerance


def assert_blocks(form):
    outside = form.model.A.copy()
    for block in form.blocks:
        outside[block, block] = 0.0
    assert not np.any(outside)
    assert form.blocks[-1].stop == form.model.nstates


@pytest.mark.parametrize("seeds", [1, pytest.param(5, marks=pytest.mark.slow)])
@pytest.mark.parametrize(("modes", "dt"), every_one([6, 41], [None, 2e-4]))
def test_modes_come_back_from_a_random_change_of_coordinates(modes, dt, seeds):
    """All seeds: frequency (relative) and damping to 1e-9, the response to 1e-8, one block of 2 a mode."""
    for seed in range(seeds):
        system = random_modal_system(seed, 3, 2, modes, dt=dt, feedthrough=True)
        model = hidden(np.random.default_rng(seed), *system.arrays(), dt)
        form, rows = modal_form(model), mode_table(model)
        assert len(rows) == len(form.blocks) == modes
        assert_blocks(form)
        for row, w, damping in zip(rows, system.frequency, system.damping, strict=True):  # both by frequency
            assert row.hz == pytest.approx(w / 2 / np.pi, rel=1e-9)
            assert row.damping == pytest.approx(damping, abs=1e-9)
            assert (row.count, row.multiplicity, row.rigid) == (2, 2, False)
        for block in form.blocks:
            part = form.model.A[block, block]
            assert part[0, 0] == part[1, 1]
            assert part[0, 1] == -part[1, 0] > 0
        assert form.error <= 1e-8
        assert_same_response(model, form.model, 2 * np.pi * np.geomspace(3, 1500, 200), 1e-8)
        T = form.transformation
        np.testing.assert_allclose(model.A @ T, T @ form.model.A, atol=1e-10 * np.linalg.norm(model.A))
        assert form.condition == pytest.approx(np.linalg.cond(T), rel=1e-6)


@pytest.mark.parametrize(("count", "dt"), every_one([1, 3], [None, 2e-4]))
def test_rigid_body_modes_are_exact_chains(count, dt):
    """5 seeds of 5, in s and as zero-order-hold equivalent in z."""
    for seed in range(5):
        model = with_rigid_body(seed, count, dt)
        form = modal_form(model)
        block = form.blocks[0]
        assert form.rigid == 2 * count == block.stop
        want = (0.0 if dt is None else 1.0) * np.eye(2 * count) + np.eye(2 * count, k=count)
        np.testing.assert_array_equal(form.model.A[block, block], want)
        assert_blocks(form)
        assert len(form.blocks) == 6
        assert_same_response(model, form.model, 2 * np.pi * np.geomspace(0.5, 1500, 200), 1e-8)
        assert form.error <= 1e-8
        rows = mode_table(model)
        assert (rows[0].rigid, rows[0].count, rows[0].hz) == (True, 2 * count, 0.0)
        assert rows[0].input < count
        assert not any(row.rigid for row in rows[1:])


def test_single_integrators_and_slow_modes_are_told_apart():
    A = np.array([[0.0, 0, 0, 0], [0, 0, 1, 0], [0, -1e-4, -1e-4, 0], [0, 0, 0, -50.0]])
    B, C = np.ones((4, 1)), np.ones((1, 4))
    model = hidden(np.random.default_rng(0), A, B, C, np.zeros((1, 1)), spread=3.0)
    form, rows = modal_form(model), mode_table(model)
    assert form.rigid == 1
    assert form.model.A[0, 0] == 0.0
    assert [row.count for row in rows] == [1, 2, 1]
    assert rows[1].hz == pytest.approx(0.01 / 2 / np.pi, rel=1e-6)
    assert rows[1].damping == pytest.approx(0.005, rel=1e-6)
    assert rows[2].hz == pytest.approx(50 / 2 / np.pi)
    assert rows[2].damping == pytest.approx(1.0)


def test_poles_too_close_to_be_told_apart_share_a_block():
    """A double pair in one Jordan block, and an ordinary mode."""
    pair = np.array([[-1.0, 20.0], [-20.0, -1.0]])
    A = scipy.linalg.block_diag(np.block([[pair, np.eye(2)], [np.zeros((2, 2)), pair]]), [[-2.0, 90.0], [-90.0, -2.0]])
    rng = np.random.default_rng(3)
    model = hidden(rng, A, rng.standard_normal((6, 2)), rng.standard_normal((2, 6)), np.zeros((2, 2)), spread=3.0)
    form, rows = modal_form(model), mode_table(model)
    assert sorted(block.stop - block.start for block in form.blocks) == [2, 4]
    assert [row.multiplicity for row in rows] == [4, 4, 2]
    assert form.condition <= 100
    assert form.error <= 1e-10
    assert_blocks(form)


def test_equal_modes_without_a_chain_are_separated():
    """Twice the same pole with two eigenvectors is no reason for a larger block."""
    pair = np.array([[-1.0, 20.0], [-20.0, -1.0]])
    form = modal_form(control.ss(scipy.linalg.block_diag(pair, pair), np.ones((4, 1)), np.ones((1, 4)), 0, 0))
    assert form.error <= 1e-12


def test_participation_is_free_of_units():
    """The peak r/(2 zeta w) of each mode; scaling a channel by 2^k changes nothing."""
    system = random_modal_system(2, 2, 2, 4, spread_db=40)
    A, B, C, D = system.arrays()
    rows = mode_table(control.ss(A, B, C, D, 0))
    peaks = np.array([np.abs(np.outer(system.shape[:, m], system.drive[m])) / 2 / system.damping[m] for m in range(4)])
    share = np.linalg.norm(peaks / peaks.max(axis=0), axis=(1, 2))
    np.testing.assert_allclose([row.participation for row in rows], share / share.max(), rtol=1e-3)
    scaled = mode_table(control.ss(A, B * [2.0**-20, 1.0], C * [[1.0], [2.0**30]], D, 0))
    np.testing.assert_allclose([row.participation for row in scaled], [row.participation for row in rows], rtol=1e-9)
    assert [(row.output, row.input) for row in scaled] == [(row.output, row.input) for row in rows]


def test_standard_deviations_come_from_the_covariance():
    omega = 2 * np.pi * np.geomspace(4, 400, 120)
    truth = random_modal_system(1, 2, 2, 4, band_hz=(5, 300)).response(1j * omega)
    frf = rid.FrequencyResponse(omega, noisy(np.random.default_rng(0), truth))
    fit = fit_mfd(frf, order=8, weight=Weight(100 / np.abs(truth)))
    found = fit_covariance(fit, noise=1.0)
    for row in mode_table(fit.model, found):
        k = np.argmin(np.abs(found.hz - row.hz))
        assert row.hz == pytest.approx(found.hz[k], rel=1e-9)
        assert row.hz_std == pytest.approx(found.hz_std[k])
        assert row.damping_std == pytest.approx(found.damping_std[k])
    assert all(np.isnan(row.hz_std) for row in mode_table(fit.model))


def test_channels_keep_their_names_and_a_static_gain_has_no_mode():
    model = control.ss([[-1.0]], [[1.0]], [[1.0]], 0, 0, inputs=["force"], outputs=["position"])
    assert modal_form(model).model.input_labels == ["force"]
    assert modal_form(model).model.output_labels == ["position"]
    gain = control.ss([], [], [], [[2.0]], 0)
    assert modal_form(gain).blocks == ()
    assert mode_table(gain) == ()


def test_bad_input():
    model = control.ss([[-0.5]], [[1.0]], [[1.0]], 0, True)
    refused("sample time", modal_form, model)
    refused("model", mode_table, np.eye(2), error=rid.errors.InputTypeError)
    refused("covariance", mode_table, control.ss([[-0.5]], [[1.0]], [[1.0]], 0, 0), 3, error=rid.errors.InputTypeError)

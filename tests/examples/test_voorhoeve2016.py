"""The wafer-stage example: its plant in closed form, the paper's problem on exact data, and what the run claims."""

import importlib

import control
import numpy as np
import pytest
import scipy.linalg

import robustid as rid
from robustid.fitting import RollOff, fit_fraction, into_form
from support.example_runs import FOLDER


@pytest.fixture
def example(monkeypatch):
    monkeypatch.syspath_prepend(FOLDER)
    return importlib.import_module("voorhoeve2016")


def test_the_rigid_body_reaches_the_gauge_from_no_force(example):
    """s^2 P far below the first mode: masses and arms in closed form, rank 3, every force but not the gauge."""
    stage = importlib.import_module("wafer_stage")
    omega = np.array([1e-3])
    P = -(omega[0] ** 2) * stage.stage(9, piezo=False)[0](omega)[0]
    forces = np.vstack([stage.FORCES, stage.PIEZO])
    inertia = stage.MASS * np.array([1, *(stage.SIDES**2 / 12)])
    arms = [np.column_stack([np.ones(len(points)), points]) for points in (stage.SENSORS, forces)]
    np.testing.assert_allclose(P[:3], 1e6 * arms[0] / inertia @ arms[1].T, rtol=1e-6)
    assert np.all(np.abs(P[3]) < 1e-9 * np.abs(P[0]))
    assert np.linalg.matrix_rank(P, tol=1e-6 * np.abs(P).max()) == 3
    assert np.all(np.abs(stage.stage(9)[0](omega)[0, :, 3]) < 1e-9 * np.abs(stage.stage(9)[0](omega)[0, 0, 0]))


def test_the_papers_problem_is_the_transposed_one_times_the_integrators(example):
    """Exact data: two SK steps from D = I give the truth; with noise the cost is that of the fraction divided again."""
    frf, weight, truth, _, _ = example.experiment(3, 120, piezo=False)
    order, omega = 12, frf.omega
    factor = np.column_stack([(1j * omega) ** 2] * 3 + [np.ones(omega.size)])
    exact = example.rigid_factored(rid.FrequencyResponse(omega, truth), order, weight)
    start = np.broadcast_to(np.eye(4), (120, 4, 4))
    _, _, best = example.iterate(exact, start, "orthonormal", 3)
    found = (best.response / factor[:, None, :]).transpose(0, 2, 1)
    assert np.max(np.linalg.norm(found - truth, axis=(1, 2)) / np.linalg.norm(truth, axis=(1, 2))) < 1e-8
    noisy = example.rigid_factored(frf, order, weight)
    assert noisy.cost(best) == pytest.approx(np.linalg.norm(weight.apply(frf.values - found)) ** 2, rel=1e-8)


def test_the_constraint_is_the_papers_factor(example):
    """Noisy data: a model of the constrained fit has the same cost there; only what the paper leaves to the gauge differs.

    The paper's D^{-1} N is proper, so that the positions fall like 1/s^2 and the gauge needn't: 8 parameters more.
    """
    frf, weight, *_ = example.experiment(3, 120, piezo=False)
    body = rid.RigidBody(3, side="output", directions=example.SENSED)
    fit = rid.fit_mfd(frf, order=12, weight=weight, rigid_body=body, constraints=[RollOff(2)])
    problem = example.rigid_factored(frf, 12, weight)
    factor = np.column_stack([-(frf.omega**2)] * 3 + [np.ones(frf.omega.size)])[:, None, :]
    start = into_form(problem, fit.fraction.response(frf.omega).transpose(0, 2, 1) * factor)
    assert problem.cost(start) == pytest.approx(fit.cost, rel=1e-8)
    other = fit_fraction(problem, start=start, method="lm")
    assert other.status.converged
    assert 0.99 * fit.cost < other.cost < fit.cost
    assert np.sum(fit.fraction.poles == 0) == 6
    assert example.zero_blocks(np.asarray(fit.model.A)) == {2: 3}


@pytest.mark.parametrize("sizes", [{}, {1: 2}, {2: 3}, {1: 1, 3: 1}, {2: 1, 4: 1}])
def test_zero_blocks(example, sizes):
    """In coordinates turned at random, beside flexible modes at 600 and 20000 rad/s."""
    blocks = [np.eye(size, k=1) for size, count in sizes.items() for _ in range(count)]
    blocks += [[[0, w], [-w, -0.01 * w]] for w in (600.0, 2e4)]
    A = scipy.linalg.block_diag(*blocks)
    turn = np.linalg.qr(np.random.default_rng(0).standard_normal(A.shape))[0]
    assert example.zero_blocks(A) == sizes
    A[: len(A) - 4] *= 600  # chains of the size of the modes: rounding leaves 1e-16 of the largest
    assert example.zero_blocks(turn @ A @ turn.T) == sizes


def test_the_single_channel_is_the_plant_behind_a_hold(example):
    """Step response at the samples, mode by mode in closed form."""
    frequency, damping, drive, look = example.modal(9)
    t = example.SAMPLE * np.arange(60)
    gains = drive[0] * look[0]
    expected = gains[:3].sum() * t**2 / 2
    for w, d, g in zip(frequency[3:], damping[3:], gains[3:], strict=True):
        wd = w * np.sqrt(1 - d**2)
        decay = np.exp(-d * w * t) * (np.cos(wd * t) + d * w / wd * np.sin(wd * t))
        expected = expected + g / w**2 * (1 - decay)
    found = control.forced_response(example.single_channel(), t, np.ones(t.size)).outputs
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())


@pytest.mark.slow  # the example itself, which always runs, prints these ends
def test_handing_over(example):
    """From the truncated central model the fit begins beside its end, and no other start ends lower."""
    ends, consistent = example.hand_over(example.single_channel(), *example.CASES[0], 0)
    assert consistent
    end = ends["central model, truncated"]
    assert end.cost <= end.start < 1.1 * end.cost
    assert end.cost <= (1 + example.SAME) * min(other.cost for other in ends.values())
    assert end.steps < ends["cold, D = I"].steps


@pytest.mark.slow
def test_run(example, run, undrawn, monkeypatch, tmp_path):
    monkeypatch.setattr(example, "CASES", ())  # that part has its own test
    monkeypatch.setattr(example, "SIZE", (9, 150, 4, 0))
    printed = run(example, ["figure_4.png", "figure_5.png"])
    assert len(list(tmp_path.iterdir())) == 2
    assert "slowest |pole|: 0, 0, 0, 0, 0, 0, 628." in printed
    assert "size and number: {2: 3}" in printed
    lines = [(name, line) for line in printed.splitlines() for name in example.BASES if line.startswith(name)]
    least = {name: [float(value) for value in line.split()[-3:]] for name, line in lines}
    assert least["data-dependent orthonormal"][1] < 1e-12
    assert least["monomial"][0] > 1e20 * least["scaled monomial"][1] > 1e24

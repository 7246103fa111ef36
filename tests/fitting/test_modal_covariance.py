"""Mode shapes and their standard deviations: derivatives by brute force, deviations against what noise does."""

import functools

import control
import numpy as np
import pytest
from scipy.signal import cont2discrete

import robustid as rid
from robustid.fitting.modal.mode_gains import blocks_in, gain_changes, gains, real_modes_in
from robustid.fitting.state_space.block_model import BlockModel
from robustid.fitting.state_space.real_modes import RealModes
from support.cases import slow
from support.mechanics import BETWEEN, OMEGA, check_tangent, measured, mechanical, unscaled
from support.pairwise import every_two

LEVEL = 0.01
STRUCTURES = {
    "proportional": (3, 2, None, {}),
    "accelerations": (2, 3, 1e-3, {"power": 2}),
    "symmetric, rigid": (3, 3, 1e-3, {"symmetric": True, "rigid": 1}),
    "general": (2, 3, 1e-3, {"general": True}),
    "general, symmetric": (3, 3, None, {"general": True, "symmetric": True}),
}


def model_of(kind, discrete):
    """Two complex pairs (and a real one of real modes) with a rigid-body direction, and outputs tied to the inputs."""
    rng = np.random.default_rng(0)
    directions = rng.standard_normal((1, 3))
    free = np.array([[False, True, True]])
    if kind == "real":
        centre, square = np.array([-0.02, -0.1, -0.5]), np.array([1.1, 0.3, -0.1])
        inputs = rng.standard_normal((3, 3))
        model = RealModes(centre, square, inputs, directions, free, discrete=discrete, power=0).normalised()
    else:
        A = np.array([[-0.02, 1.05, 0, 0], [-1.05, -0.02, 0, 0], [0, 0, -0.1, 0.5], [0, 0, -0.6, -0.1]])
        B = rng.standard_normal((4, 3))
        if discrete:
            A, B, *_ = cont2discrete((A, B, np.eye(4), np.zeros((4, 3))), 1.0)
        model = BlockModel.of(A, B, discrete=discrete, directions=directions, free=free)
    coefficients = rng.standard_normal(len(model.tied_outputs()))
    return model, coefficients


@pytest.mark.parametrize(("kind", "tied", "discrete"), every_two(["real", "blocks"], [False, True], [False, True]))
def test_changes_of_gains_are_derivatives(kind, tied, discrete):
    model, coefficients = model_of(kind, discrete)
    fixed = np.tensordot(coefficients, model.tied_outputs(), 1)
    changes = gain_changes(model, fixed, 1, tied=tied)

    def moved(step):
        there = unscaled(model, step)
        return gains(there, np.tensordot(coefficients, there.tied_outputs(), 1) if tied else fixed, 1)

    assert changes.shape[3] == len(model.reach(np.exp(0.5j) * np.ones(1)))
    check_tangent(changes, moved)


@pytest.mark.parametrize("discrete", [False, True])
def test_models_are_read_back_from_their_state_space(discrete):
    for kind in ("real", "blocks"):
        model, coefficients = model_of(kind, discrete)
        C = np.tensordot(coefficients, model.tied_outputs(), 1)
        found = model.realised(C, np.zeros((3, 3)))
        read, more = (real_modes_in, {"power": 0}) if kind == "real" else (blocks_in, {})
        again = read(found, model.directions, model.free, discrete=discrete, **more)
        xi = np.exp(1j * np.linspace(0.2, 3, 7)) if discrete else 1j * np.linspace(0.2, 3, 7)
        assert np.allclose(again.states(xi), model.states(xi), rtol=1e-9)


@functools.cache
def fitted(name, seed):
    ny, nu, dt, options = STRUCTURES[name]
    system = mechanical(0, ny, nu, 4, dt=dt, **options)
    modal = rid.fits.Modal(
        "general" if options.get("general") else "proportional",
        symmetric=options.get("symmetric", False),
        quantity=("position", "velocity", "acceleration")[system.power],
    )
    weight = rid.fits.Weight(1 / (LEVEL * np.abs(system.response(OMEGA))))
    frf = measured(system, seed, LEVEL)
    fit = rid.fit_mfd(frf, order=system.order, modal=modal, rigid_body=options.get("rigid", 0), weight=weight)
    return system, fit, rid.fits.fit_covariance(fit, noise=1.0)


@pytest.mark.parametrize(
    ("name", "seeds"),
    [
        ("proportional", 2),
        ("symmetric, rigid", 3),
        ("general", 2),
        *(slow(name, 3) for name in STRUCTURES if name != "symmetric, rigid"),
    ],
)
def test_errors_are_as_large_as_their_deviations(name, seeds):
    """Three seeds of noise: frequencies, damping, shapes, drives and response, root mean square over the deviations."""
    numbers, shapes, response = [], [], []
    for seed in range(seeds):
        system, fit, covariance = fitted(name, seed)
        rows = [row for row in rid.fits.mode_table(fit, covariance) if not row.rigid]
        assert len(rows) == 4
        for k, row in enumerate(rows):
            M = np.outer(system.shapes[:, k], system.drives[k])
            i, j = np.unravel_index(np.argmax(np.abs(np.outer(row.shape, row.drive))), M.shape)
            numbers.append((row.hz - system.frequency[k] / (2 * np.pi)) / row.hz_std)
            numbers.append((row.damping - system.damping[k]) / row.damping_std)
            others = np.arange(len(M)) != i  # the largest entry is 1
            assert abs(row.shape[i] - 1) < 1e-12
            shapes.extend(np.abs(row.shape - M[:, j] / M[i, j])[others] / row.shape_std[others])
            shapes.extend(np.abs(row.drive - M[i]) / row.drive_std)
        error = np.abs(fit.fraction.response(BETWEEN) - system.response(BETWEEN))
        response.append(np.sqrt(np.mean((error / covariance.response_std(BETWEEN)) ** 2)))
    for z in (numbers, shapes, response):
        assert 0.7 < np.sqrt(np.mean(np.square(z))) < 1.4


ALWAYS = "proportional", "symmetric, rigid", "general"


@pytest.mark.parametrize("name", [one if one in ALWAYS else slow(one) for one in STRUCTURES])
def test_the_structure_leaves_its_own_number_of_parameters_free(name):
    system, fit, covariance = fitted(name, 0)
    ny, nu, _, options = STRUCTURES[name]
    shapes = nu if options.get("symmetric") else ny + nu - 1
    wanted = 4 * (2 + (2 * shapes if options.get("general") else shapes))
    wanted += 3 * bool(options.get("rigid"))  # a gain and two free entries of the direction
    wanted += ny * nu * (system.power == 2)
    assert covariance.parameters == wanted
    options = {"order": system.order, "weight": fit.problem.weight, "feedthrough": system.power == 2}
    free = rid.fit_mfd(measured(system, 0, LEVEL), **options)
    ratio = covariance.response_std(BETWEEN) / rid.fits.fit_covariance(free, noise=1.0).response_std(BETWEEN)
    assert np.median(ratio) < (1.01 if name == "general" else 0.9)


@pytest.mark.parametrize("dt", [None, 1e-3])
def test_shapes_of_any_state_space(dt):
    """Two modes of known shapes and a rigid body, in other coordinates."""
    omega, zeta = np.array([40.0, 90.0]), np.array([0.01, 0.02])
    shapes, drives = np.array([[1.0, -0.5], [0.3, 1.0], [-0.2, 0.6]]), np.array([[2.0, 3.0], [-1.0, 4.0]])
    A = np.block([[np.zeros((2, 2)), np.eye(2)], [-np.diag(omega**2), -np.diag(2 * zeta * omega)]])
    B, C = np.vstack([np.zeros((2, 2)), drives]), np.hstack([shapes, np.zeros((3, 2))])
    if dt is not None:
        A, B, *_ = cont2discrete((A, B, C, np.zeros((3, 2))), dt)
    T = np.random.default_rng(0).standard_normal((4, 4))
    rows = rid.fits.mode_table(control.ss(T @ A @ np.linalg.inv(T), T @ B, C @ np.linalg.inv(T), 0, dt or 0))
    for k, row in enumerate(rows):
        M = np.outer(shapes[:, k], drives[k])
        assert np.allclose(np.outer(row.shape, row.drive), M, rtol=1e-8, atol=1e-8)
        assert np.isclose(np.abs(row.shape).max(), 1)
        assert row.shape_std is None
    (rigid,) = rid.fits.mode_table(control.ss([[0, 1], [0, 0]], [[0, 0], [1, 2]], [[3, 0], [1, 0]], 0))
    assert np.allclose(rigid.shape @ rigid.drive, [[3, 6], [1, 2]])
    assert "shape" not in repr(rows[0])
    (real,) = rid.fits.mode_table(control.ss([[-1.0]], [[1.0]], [[1.0]], 0))
    assert real.shape is None


def test_shapes_of_a_left_fraction_are_those_of_the_data():
    system = mechanical(0, 3, 2, 4, rigid=1)
    body = rid.RigidBody(1, side="output")
    fit = rid.fit_mfd(measured(system, 0, LEVEL), order=10, modal=rid.fits.Modal("proportional"), rigid_body=body)
    for k, row in enumerate(rid.fits.mode_table(fit, rid.fits.fit_covariance(fit))[1:]):
        M = np.outer(system.shapes[:, k], system.drives[k])
        assert np.allclose(np.outer(row.shape, row.drive), M, atol=0.02 * np.abs(M).max())
        assert np.isclose(row.shape_std.min(), 0, atol=1e-12)
        assert row.drive_std.shape == (2,)

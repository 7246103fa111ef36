"""Covariance of a fit: against brute force in other coordinates, finite differences and simulated noise."""

import pickle

import numpy as np
import pytest
from scipy.stats import binom, chi2

import robustid as rid
from robustid.fitting import (
    FitStatus,
    FractionProblem,
    MatrixFraction,
    RigidBody,
    Weight,
    fit_covariance,
    fit_fraction,
    fit_mfd,
    retract,
)
from robustid.fitting.fraction.coordinates import pole_changes, response_changes
from robustid.fitting.fraction.fraction_model import realise
from robustid.fitting.fraction.fraction_steps import gauss_newton_direction
from support.mfd_systems import identity, noisy, random_modal_system

OMEGA = 2 * np.pi * np.geomspace(4, 400, 120)


def system_of(seed, ny=2, nu=2, modes=3, **options):
    return random_modal_system(seed, ny, nu, modes, band_hz=(5, 300), damping=(0.005, 0.05), **options)


def fitted(values, order, weight, near, omega=OMEGA):
    """The optimum next to a response, without the search for a start."""
    problem = FractionProblem(omega, values, order, weight, pairs=True)
    fit = fit_fraction(problem, start=retract(problem, near, identity(problem), steps=8), method="lm")
    gradient = gauss_newton_direction(problem, fit.fraction).slope * np.sqrt(fit.cost)
    # Less than 1/30 of a standard deviation from the optimum, all coefficients together; noise-free it is rounding.
    assert gradient**2 <= max(1e-3 * fit.cost / (2 * values.size), 1e-6)
    found = realise(problem, fit.fraction)
    return MatrixFraction(problem, fit.fraction, found, fit.cost, np.nan, fit.status, fit.history)


def modal_judge(model, weight, points):
    """Variances per unit of v by QR of the Jacobian in poles, residues' factors and D: no polynomial, no fraction.

    P = sum_i c_i b_i/(xi - pole_i) + D; the largest entry of b_i is fixed. Returns (pole, factor of Cov(Re, Im)) of
    every real pole and upper pole, and the standard deviation of the response.
    """
    poles, vectors = np.linalg.eig(model.A)
    b, c = np.linalg.solve(vectors, model.B.astype(complex)), model.C @ vectors
    (ny, nu), columns, where = model.D.shape, [], []
    for i, pole in enumerate(poles):
        if pole.imag < 0:
            continue
        where.append((pole, len(columns)))
        terms = [(np.outer(c[:, i], b[i]), 2)]
        terms += [(np.outer(np.eye(ny)[k], b[i]), 1) for k in range(ny)]
        terms += [(np.outer(c[:, i], np.eye(nu)[k]), 1) for k in range(nu) if k != np.argmax(np.abs(b[i]))]
        for matrix, power in terms:
            for factor in (1, 1j) if pole.imag else (1,):
                part = factor * matrix / (points[:, None, None] - pole) ** power
                other = (factor * matrix).conj() / (points[:, None, None] - pole.conj()) ** power
                columns.append(part + other if pole.imag else part)
    if np.any(model.D):
        columns += [np.broadcast_to(np.eye(ny * nu)[k].reshape(ny, nu), columns[0].shape) for k in range(ny * nu)]
    J = np.stack([weight.apply(column).ravel() for column in columns], axis=1)
    J = np.concatenate([J.real, J.imag])
    size = np.linalg.norm(J, axis=0)
    root = np.linalg.inv(np.linalg.qr(J / size, mode="r")) / size[:, None]
    std = np.linalg.norm(np.stack([column.ravel() for column in columns], axis=1) @ root, axis=1)
    return [(p, root[k : k + 1 + (p.imag > 0)]) for p, k in where], std.reshape(points.size, ny, nu)


def assert_agrees(fit, weight, omega, tolerance):
    dt = fit.fraction.dt
    points = 1j * omega if dt is None else np.exp(1j * omega * dt)
    found = fit_covariance(fit, noise=2.0)
    poles, std = modal_judge(fit.model, weight, points)
    for pole, root in poles:
        k = np.argmin(np.abs(found.poles - pole))
        assert found.pole_std[k] == pytest.approx(np.linalg.norm(root), rel=tolerance)
        s = pole if dt is None else np.log(pole) / dt
        ds = (root[0] + 1j * root[-1] * (pole.imag > 0)) / (1 if dt is None else pole * dt)
        hz = np.linalg.norm(np.real(ds * s.conjugate())) / abs(s) / 2 / np.pi
        e = 1e-7 * abs(s) / np.abs(ds).max()
        up, down = (-np.real(s + change) / np.abs(s + change) for change in (e * ds, -e * ds))
        damping = np.linalg.norm(up - down) / (2 * e)
        assert found.hz[k] == pytest.approx(abs(s) / 2 / np.pi, rel=1e-6)
        assert found.hz_std[k] == pytest.approx(hz, rel=tolerance)
        assert found.damping_std[k] == pytest.approx(damping, rel=max(tolerance, 1e-5))
    np.testing.assert_allclose(found.response_std(), std, rtol=tolerance)
    np.testing.assert_allclose(found.response_std(omega), std, rtol=tolerance)


@pytest.mark.parametrize(
    ("form", "shape", "options"),
    [
        ("right", (1, 1), {}),
        ("right", (2, 3), {}),
        ("left", (2, 3), {}),
        ("left", (3, 2), {"feedthrough": True}),
        ("right", (3, 1), {"feedthrough": True}),
        ("right", (2, 2), {"dt": 1e-3}),
    ],
)
def test_against_the_jacobian_in_modal_coordinates(form, shape, options):
    system = system_of(4, *shape, 3, **options)
    dt = options.get("dt")
    truth = system.response(1j * OMEGA if dt is None else np.exp(1j * OMEGA * dt))
    weight = Weight(100 / np.abs(truth))
    frf = rid.FrequencyResponse(OMEGA, noisy(np.random.default_rng(1), truth), dt=dt)
    fit = fit_mfd(frf, order=6, weight=weight, form=form, feedthrough=bool(options.get("feedthrough")))
    assert_agrees(fit, weight, OMEGA, 1e-5)


@pytest.mark.slow
@pytest.mark.parametrize("modes", [20, 41])
def test_against_the_jacobian_in_modal_coordinates_at_full_size(modes):
    omega = 2 * np.pi * np.geomspace(4, 1200, 300)
    truth = random_modal_system(0, 4, 4, modes).response(1j * omega)
    weight = Weight(100 / np.abs(truth))
    problem = FractionProblem(omega, truth, 2 * modes, weight)
    nodes = retract(problem, truth, identity(problem), steps=4)
    fit = MatrixFraction(problem, nodes, realise(problem, nodes), problem.cost(nodes), np.nan, FitStatus.EXACT, ())
    assert_agrees(fit, weight, omega, 1e-5)


@pytest.mark.parametrize("seeds", [1, pytest.param(3, marks=pytest.mark.slow)])
@pytest.mark.parametrize("case", ["right", "left", "rigid"])
def test_first_order_motion_of_poles_and_response_under_a_change_of_the_data(case, seeds):
    """3 seeds of 3: central differences of refits, data moved by ±1e-3 (less drowns in the rounding of the fits)."""
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        # An even number of modes per channel: with 3 in 2 the rounding of D, of condition 1e11, shows.
        values = system_of(seed, modes=4).response(1j * OMEGA)
        options, order = {"form": "left" if case == "left" else "right"}, 8
        if case == "rigid":
            values, order = values - np.outer([1.0, 0.3], [0.5, 1.0]) * 1e4 / OMEGA[:, None, None] ** 2, 10
            options["rigid_body"] = RigidBody(1)
        weight = Weight(100 / np.abs(values))
        change = noisy(rng, values, 1e-3) - values
        options |= {"order": order, "weight": weight}
        fit = fit_mfd(rid.FrequencyResponse(OMEGA, values), **options)
        ends = [fit_mfd(rid.FrequencyResponse(OMEGA, values + e * change), **options, start=fit.model) for e in (1, -1)]
        problem = fit.problem
        basis = problem.basis(fit.nodes.denominators, fit.nodes.response)
        forbidden = problem.forbidden(basis, fit.nodes)
        moved = change.transpose(0, 2, 1) if case == "left" else change
        c = -basis.project(problem.weight.apply(moved))
        c = c - forbidden.T @ (forbidden @ c)
        changes = response_changes(basis, problem.xi, fit.nodes.denominators, fit.nodes.response)
        motion = (changes @ c).reshape(len(OMEGA), *problem.values.shape[:0:-1]).transpose(0, 2, 1)
        want = (ends[0].nodes.response - ends[1].nodes.response) / 2
        error, size = (np.linalg.norm(problem.weight.apply(part)) for part in (motion - want, want))
        assert error <= 1e-3 * size
        poles, changes = pole_changes(fit, basis)
        flexible = np.flatnonzero(poles.imag > 1.0)
        for k in flexible:
            one, two = (f.fraction.poles[np.argmin(np.abs(f.fraction.poles - poles[k]))] for f in ends)
            assert abs(changes[k] @ c - (one - two) / 2) <= 1e-3 * abs(one - two)
        assert flexible.size == 4
        found = fit_covariance(fit)
        if case == "rigid":
            assert np.all(found.poles[-2:] == 0)
            assert np.all(found.pole_std[-2:] == 0)
            assert np.all(found.hz_std[-2:] == 0)
            assert len(found.coordinates.forbidden) > 0
        assert np.all(found.pole_std[:8] > 0)
        assert found.parameters == basis.size - len(forbidden)


def realisations(seed, count):
    """Fits of the same system with 1 % noise, and the fit of the truth."""
    system = system_of(seed)
    truth = system.response(1j * OMEGA)
    weight = Weight(100 / np.abs(truth))
    rng = np.random.default_rng([seed, 7])
    fits = [fitted(noisy(rng, truth), 6, weight, truth) for _ in range(count)]
    return system, truth, fitted(truth, 6, weight, truth), fits


@pytest.mark.parametrize("count", [8, pytest.param(60, marks=pytest.mark.slow)])
def test_standard_deviations_of_poles_are_those_of_simulated_noise(count):
    """So many realisations, 2x2 order 6: the chi-square of frequency and damping of 3 modes within its 99.8 % interval, 6 of 6."""
    system, _, exact, fits = realisations(0, count)
    found = fit_covariance(exact, noise=1.0)
    low, high = chi2.ppf([1e-3, 1 - 1e-3], count)
    held = 0
    for m, pole in enumerate(system.poles[::2]):
        k = np.argmin(np.abs(found.poles - pole))
        near = np.array([f.fraction.poles[np.argmin(np.abs(f.fraction.poles - pole))] for f in fits])
        hz = (np.abs(near) - system.frequency[m]) / 2 / np.pi
        damping = -near.real / np.abs(near) - system.damping[m]
        for error, std in ((hz, found.hz_std[k]), (damping, found.damping_std[k])):
            held += bool(low <= np.sum((error / std) ** 2) <= high)
    assert held == 6


@pytest.mark.parametrize("seeds", [5, pytest.param(20, marks=pytest.mark.slow)])
def test_coverage_of_the_true_response_with_estimated_noise(seeds):
    """Over seeds: |P - truth| <= 2 std in 1 - exp(-4) = 98.2 % of lines and entries (complex normal) of every size."""
    inside, variances, poles = [], [], []
    for seed in range(seeds):
        system, truth, _, (fit,) = realisations(seed, 1)
        found = fit_covariance(fit)
        inside.append(np.mean(np.abs(fit.nodes.response - truth) <= 2 * found.response_std()))
        variances.append(found.variance)
        for m, pole in enumerate(system.poles[::2]):
            k = np.argmin(np.abs(found.poles - pole))
            poles.append(abs(found.hz[k] - system.frequency[m] / 2 / np.pi) <= 2 * found.hz_std[k])
    # 24 coefficients make the lines of a fit move together: a single seed may lie far below the mean.
    assert np.mean(inside) >= 0.96
    assert np.sum(np.array(inside) >= 0.9) >= 0.9 * seeds
    # v = 1/2 with 936 degrees of freedom each
    assert np.abs(np.mean(variances) - 0.5) <= 4 * 0.5 * np.sqrt(2 / 936 / seeds)
    assert binom.ppf(1e-3, 3 * seeds, 0.954) <= np.sum(poles) <= binom.ppf(1 - 1e-3, 3 * seeds, 0.954)


def test_variance_scales_and_weights_cancel():
    """A weight twice as large is noise half as large: with the noise estimated nothing changes."""
    truth = system_of(1).response(1j * OMEGA)
    values = noisy(np.random.default_rng(0), truth)
    one, two = (fit_covariance(fitted(values, 6, Weight(f / np.abs(truth)), truth)) for f in (1.0, 2.0**20))
    np.testing.assert_allclose(one.hz_std, two.hz_std, rtol=1e-6)
    np.testing.assert_allclose(one.response_std(), two.response_std(), rtol=1e-6)
    assert two.variance == pytest.approx(2.0**40 * one.variance)


def test_masked_entries_are_no_equations():
    truth = system_of(2).response(1j * OMEGA)
    weight = 100 / np.abs(truth)
    weight[::2, 0, 1] = 0.0
    fit = fitted(noisy(np.random.default_rng(0), truth), 6, Weight(weight), truth)
    found = fit_covariance(fit)
    assert found.variance == pytest.approx(fit.cost / (2 * (480 - 60) - 24))
    assert np.all(np.isfinite(found.response_std()))


def test_pickle_and_read_only():
    truth = system_of(3).response(1j * OMEGA)
    found = fit_covariance(fitted(noisy(np.random.default_rng(0), truth), 6, Weight.relative(truth), truth))
    copy = pickle.loads(pickle.dumps(found))
    np.testing.assert_array_equal(copy.response_std(OMEGA[:5]), found.response_std(OMEGA[:5]))
    with pytest.raises(ValueError, match="read-only"):
        found.hz_std[0] = 0.0


def test_bad_input():
    truth = system_of(0, 1, 1, 1).response(1j * OMEGA[::60])
    fit = fitted(truth, 2, Weight.relative(truth), truth, OMEGA[::60])
    with pytest.raises(rid.InputError, match="`fit` has 4 free coefficients"):
        fit_covariance(fit)
    assert np.all(np.isfinite(fit_covariance(fit, noise=1.0).hz_std))
    with pytest.raises(rid.InputError, match="noise"):
        fit_covariance(fit, noise=0.0)
    with pytest.raises(rid.errors.InputTypeError, match="fit"):
        fit_covariance(truth)

"""Small models of matrices: fits of the responses they start from, steps without similarities, joint bounds, budgets."""

import dataclasses

import control
import numpy as np
import pytest

import robustid as rid
from robustid.core import Budget, responses
from robustid.fitting import FitStatus
from robustid.identification import largest_ratio
from robustid.reduction import balanced, hankel_singular_values
from robustid.reduction.best_models import ResponseFits
from robustid.reduction.pole_starts import of_model, statespace
from robustid.reduction.sample_fits import least_squares, levelled, moves
from robustid.reduction.sample_map import sample_map
from support.matrix_lines import DT, found_at, keeps, lines, plant

PRIOR = rid.Prior(gain_bound=0.1, decay_rate=1.2)


@pytest.fixture(scope="module")
def two_modes():
    """Its truth of order 4, its problem and the identification."""
    rng = np.random.default_rng(3)
    truth, basis = plant(rng, 2)
    problem = rid.MixedProblem(frequency=lines(rng, truth, count=16), prior=PRIOR, parametric=basis)
    return truth, problem, rid.identify(problem)


def test_moves_are_those_that_neither_numerators_nor_coordinates_undo():
    """Of n poles n (p + q) + p q dimensions: a step that changes no response is in no set of moves."""
    for seed, (outputs, inputs) in enumerate([(2, 2), (3, 3), (2, 3), (4, 2)]):
        rng = np.random.default_rng(seed)
        truth, _ = plant(rng, 2, outputs, inputs)
        samples = sample_map(rid.MixedProblem(frequency=lines(rng, truth, count=20), prior=PRIOR), 0)
        fit = least_squares(samples, of_model(truth.A, truth.B, truth.C, samples))
        linear = samples.real(fit.functions.normal.numerators)
        ways = moves(fit, 0.9999, np.zeros(0, complex))
        columns = np.hstack([linear, samples.real(ways.columns)])
        assert columns.shape[1] == 4 * (outputs + inputs) + outputs * inputs
        assert np.linalg.matrix_rank(columns / np.linalg.norm(columns, axis=0), tol=1e-10) == columns.shape[1]
        d = 1e-6 * rng.standard_normal(ways.size.size)
        U = np.linalg.qr(linear)[0]

        def beside(error, U=U, samples=samples):
            return samples.real(error) - U @ (U.T @ samples.real(error))

        ahead, back = (least_squares(samples, ways.step(s * d)).error for s in (1, -1))
        slope, expected = beside(back - ahead) / 2, beside(ways.columns @ d)
        np.testing.assert_allclose(slope, expected, atol=1e-4 * np.abs(expected).max())


@pytest.mark.parametrize("seed", [pytest.param(k, marks=pytest.mark.slow) if k else k for k in range(5)])
def test_the_largest_residual_falls_when_poles_move_too(seed):
    """At every seed: a region of trust that held the numerators would leave it where they alone bring it."""
    truth, _ = plant(rng := np.random.default_rng(seed), 3)
    problem = rid.MixedProblem(frequency=lines(rng, truth, count=24), prior=PRIOR)
    samples = sample_map(problem, 0)
    start = ResponseFits(problem, np.zeros((0, 2, 2))).model(6, Budget())
    fit = least_squares(samples, of_model(start.A, start.B, start.C, samples))
    alone = levelled(fit, 0.99999, 0.0, 0)
    both = levelled(fit, 0.99999, 0.0, 8)
    assert both.worst < 0.985 * alone.worst < 0.985 * fit.worst
    assert both.worst == pytest.approx(largest_ratio(problem, statespace(samples, both, truth)), rel=1e-9)


def test_responses_are_fitted_without_their_integrators_and_what_is_missing():
    """Noise-free data of two experiments: the fit of the true order is the truth less its integrators."""
    rng = np.random.default_rng(1)
    truth, _ = plant(rng, 2)
    gains = rng.standard_normal((1, 2, 2))
    sides = []
    for omega in (2 * np.pi * np.linspace(1, 20, 15), 2 * np.pi * np.linspace(3, 20, 18)):  # one point in common
        values = responses(truth, omega * DT) + gains / (np.exp(1j * omega * DT) - 1)[:, None, None]
        bound = np.full(values.shape, 1e-3)
        bound[::6, 0, 1] = np.inf
        sides.append(rid.FrequencyResponse(omega, np.where(np.isinf(bound), 9.0, values), bound=bound, dt=DT))
    fits = ResponseFits(rid.MixedProblem(frequency=sides, prior=PRIOR), gains)
    found, at = fits.model(4, Budget()), np.linspace(0.1, 3, 40)
    np.testing.assert_allclose(responses(found, at), responses(truth, at), atol=1e-6)
    assert fits.alone
    assert fits.model(0, Budget()) is None
    assert fits.model(4000, Budget()) is None
    assert fits.model(4, Budget(1e-9)) is None


def test_control_c_in_a_fit_ends_the_search(two_modes, monkeypatch):
    """A fit that is interrupted gives what it has; the search gives the smallest order that it has found before, by truncation."""
    _, problem, result = two_modes
    fit_mfd, asked = rid.fit_mfd, []

    def interrupted(frf, *, order, **options):
        asked.append(order)
        fit = fit_mfd(frf, order=order, **options)
        return fit if order < 3 else dataclasses.replace(fit, status=FitStatus.INTERRUPTED)

    monkeypatch.setattr("robustid.reduction.best_models.fit_mfd", interrupted)
    small = rid.reduce_within_bounds(result)
    assert small.stopped.startswith("interrupted")
    assert asked[-1] == 3
    keeps(problem, small, result.order - 1)


def test_without_time_a_truncated_matrix_is_inside(two_modes):
    _, problem, result = two_modes
    told = []
    whole = rid.reduce_within_bounds(result, progress=lambda text, done, count: told.append((done, count)))
    keeps(problem, whole, 4)
    assert all(0 <= done <= count for done, count in told)
    assert [done for done, _ in told] == sorted(done for done, _ in told)
    short = rid.reduce_within_bounds(result, time_limit=1e-9)
    assert short.stopped.startswith("stopped at the time limit")
    keeps(problem, short, result.order - 1)
    assert whole.order <= short.order


def joint(kind, frf):
    """Bounds in which the truth stays: ellipses or ellipsoids around the discs of the entries."""
    if kind == "tilted":
        tilt = 0.3 * np.exp(1j * np.arange(frf.omega.size))
        return frf.with_bound(rid.Bound(1.3 * frf.bound.radius, tilt=tilt))
    size = frf.values[0].size
    rng = np.random.default_rng(9)
    root = rng.standard_normal((frf.omega.size, size, size))
    turn = np.linalg.qr(root)[0]
    axes = np.linspace(1.0, 1.5, size) ** 2 * frf.bound.radius.max() ** 2 * size
    return frf.with_bound(rid.Bound(joint="matrix", ellipsoid=(turn * axes) @ turn.swapaxes(1, 2)))


@pytest.mark.parametrize("kind", [pytest.param("tilted", marks=pytest.mark.slow), "ellipsoid"])
def test_truth_of_known_order_bounds_the_order_found_in_joint_bounds(kind):
    rng = np.random.default_rng(4)
    truth, basis = plant(rng, 2)
    problem = rid.MixedProblem(frequency=joint(kind, lines(rng, truth, count=10)), prior=PRIOR, parametric=basis)
    found_at(problem, truth, 4)


@pytest.mark.slow
def test_rigid_body_of_a_matrix_is_exact():
    """Two modes with two poles at z = 1 each, asked for by name; one flexible mode beside them."""
    rng = np.random.default_rng(8)
    flexible, basis = plant(rng, 1)
    chain = np.kron([[1.0, 1.0], [0.0, 1.0]], np.eye(2))
    B = np.vstack([1e-4 * np.eye(2), 2e-4 * np.eye(2)]) @ rng.standard_normal((2, 2))
    truth = control.ss(flexible + control.ss(chain, B, np.eye(2, 4), 0, DT), dt=DT)
    double = control.ss([[1.0, 1.0], [0.0, 1.0]], [[0.0], [1.0]], np.eye(2), 0, DT)
    frf = lines(rng, truth, bound=0.03, count=10)
    problem = rid.MixedProblem(frequency=frf, prior=PRIOR, parametric=[basis, double])
    small = found_at(problem, truth, 6, rigid_body=rid.RigidBody(2))
    assert np.sum(small.model.poles() == 1) == 4


def test_gramians_of_the_identified_model_are_computed_once_a_search(two_modes, monkeypatch):
    """Its truncation is the same one at every order that is asked for."""
    result = two_modes[2]
    factored, plain = list[int](), balanced.gramian_factors

    def counted(parts, **time):
        factored.append(len(parts.a))
        return plain(parts, **time)

    monkeypatch.setattr(balanced, "gramian_factors", counted)
    small = rid.reduce_within_bounds(result)
    assert factored.count(result.order) == 1
    assert small.order < result.order
    np.testing.assert_allclose(small.hankel, hankel_singular_values(result.model), atol=1e-12 * small.hankel[0])

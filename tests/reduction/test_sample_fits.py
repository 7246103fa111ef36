"""The parts of the search for the smallest model, against closed forms, finite differences and another solver."""

import dataclasses

import control
import cvxpy as cp
import numpy as np
import pytest

import robustid as rid
from robustid.core import response
from robustid.identification import model_residuals
from robustid.reduction import best_models, sample_fits
from robustid.reduction.pole_starts import sanathanan_koerner, statespace
from robustid.reduction.sample_map import sample_map
from robustid.reduction.smallest_maximum import orthonormal_columns, smallest_maximum
from support.cases import slow
from support.pairwise import every_one
from support.paper_plant import mixed, structure

pytestmark = pytest.mark.quick
POLES = np.array([0.8 + 0.5j, 0.8 - 0.5j, 0.3, 0.44 + 0.89j, 0.44 - 0.89j])


@pytest.mark.parametrize(("kind", "integrators"), every_one(["rest", "free", "periodic"], [0, 2]))
def test_residuals_of_the_map_are_those_of_the_judge(kind, integrators):
    if kind == "periodic" and integrators:
        return
    problem, rng = mixed(kind), np.random.default_rng(5)
    samples = sample_map(problem, integrators)
    v = rng.standard_normal(5 + samples.fixed.shape[1])
    v[5 + 1 + integrators :] = 0  # no free response: the judge takes the best one
    fit = sample_fits.evaluated(sample_fits.Functions(samples, sample_fits.pole_functions(POLES)), v)
    model = statespace(samples, fit, rid.datasets.flexible_structure().truth)
    assert np.sum(model.poles() == 1) == integrators
    found = model_residuals(problem, model)
    for r, start in zip(found, (0, 11), strict=True):
        tilted = r.error if r.tilt is None else r.error + r.tilt * r.error.conj()
        mine = fit.error[start : start + r.error.size]
        if r.kind == "time" and kind == "free":  # up to a free response
            U, _ = orthonormal_columns(samples.tracks[1].free)
            mine, tilted = (e - U @ (U.T @ e) for e in (mine.real, tilted / r.bound))
            np.testing.assert_allclose(mine, tilted, atol=1e-9 * np.abs(tilted).max())
        else:
            np.testing.assert_allclose(mine, tilted / r.bound, atol=1e-9 * np.abs(fit.error).max())


def test_functions_are_orthonormal_also_for_close_poles_near_the_circle():
    angles = 2 * np.pi * np.arange(400000) / 400000
    close = 0.9995 * np.exp(1j * np.array([0.5, 0.5002]))
    A, C, _ = sample_fits.pole_functions(np.concatenate([close, close.conj(), [0.9]]))
    z = np.exp(1j * angles[:, None])
    T, values = np.eye(5), np.empty((angles.size, 5), complex)
    values = np.linalg.solve((z[::10, :, None] * T - A).transpose(0, 2, 1), C[0, None, :, None])[..., 0]
    np.testing.assert_allclose(values.conj().T @ values / values.shape[0], np.eye(5), atol=1e-6)


def test_columns_of_the_poles_are_the_derivatives():
    samples = sample_map(mixed("rest"), 0)
    pair = sample_fits.pole_functions(POLES)
    v = np.random.default_rng(0).standard_normal(6)
    fit, step = sample_fits.evaluated(sample_fits.Functions(samples, pair), v), 1e-6
    J = sample_fits.pole_columns(samples, pair, fit.outputs)
    for k in range(5):
        d = step * np.eye(5)[:, k : k + 1]
        plus, minus = (
            sample_fits.evaluated(sample_fits.Functions(samples, sample_fits.moved(pair, s * d)), v).error
            for s in (1, -1)
        )
        np.testing.assert_allclose((plus - minus) / (2 * step), -J[:, k], atol=1e-7 * np.abs(J).max())


@pytest.mark.parametrize("seeds", [5, slow(12)])
def test_smallest_maximum_is_that_of_another_solver(seeds):
    """12 random programs with complex and real samples, free and bounded unknowns, one with dependent columns."""
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        F, T, n, held = rng.integers(3, 30), rng.integers(0, 30), rng.integers(1, 5), 2
        G = rng.standard_normal((F + T, n + held)) + 0j
        G[:F] += 1j * rng.standard_normal((F, n + held))
        if seed == 3:
            G[:, 0] = 2 * G[:, n - 1]
        y = rng.standard_normal(F + T) * 30 + 0j
        y[:F] += 30j * rng.standard_normal(F)
        reach = np.concatenate([np.full(n, np.inf), rng.uniform(0.1, 3, held)])
        v, value = smallest_maximum(G, y, F, np.zeros(n + held), reach)
        x = cp.Variable(n + held)
        worst = cp.max(cp.abs(y - G @ x))
        best = cp.Problem(cp.Minimize(worst), [cp.abs(x[n:]) <= reach[n:]]).solve(solver=cp.CLARABEL)
        assert np.abs(y - G @ v).max() == pytest.approx(value, rel=1e-9)
        assert np.all(np.abs(v[n:]) <= reach[n:] * (1 + 1e-9))
        assert best * (1 - 1e-7) <= value <= best * (1 + 2e-4)


def test_noise_free_samples_give_the_poles_back_from_a_cold_start():
    for seed in range(5):
        data = rid.datasets.flexible_structure(seed=seed, bound=1e-9)
        problem = dataclasses.replace(structure(seed), frequency=data.frequency, time=data.time)
        samples = sample_map(problem, 0)
        exact = np.linalg.eigvals(data.truth.A)
        rich = sample_fits.least_squares(samples, sample_fits.pole_functions(np.concatenate([exact, [0.1, 0.2]])))
        fit = sample_fits.descended(sample_fits.least_squares(samples, sanathanan_koerner(samples, rich, 4)), 0.99999)
        assert np.sort_complex(fit.poles) == pytest.approx(np.sort_complex(exact), abs=1e-6)


def test_minimax_model_is_a_local_optimum_with_equal_extremes():
    """No direction of poles and numerators lowers all the largest residuals: by linear programming, at 2 seeds."""
    for seed in range(2):
        problem = structure(seed)
        samples = sample_map(problem, 0)
        start = sample_fits.least_squares(
            samples, sample_fits.pole_functions(rid.datasets.flexible_structure().truth.poles())
        )
        start = sample_fits.descended(start, 0.9999)
        fit = sample_fits.levelled(start, 0.9999, 1e-3, 60)  # a limit out of reach: to the end
        assert fit.worst < sample_fits.numerators_levelled(start).worst
        pair = sample_fits.pole_functions(fit.poles)
        G = np.hstack(
            [sample_fits.Functions(samples, pair).numerators, sample_fits.pole_columns(samples, pair, fit.outputs)]
        )
        extreme = np.abs(fit.error) > 0.999 * fit.worst
        turn = (fit.error / np.abs(fit.error)).conj()
        slopes = np.real(turn[:, None] * G)[extreme]
        x = cp.Variable(9)
        reach = np.concatenate([np.full(5, np.inf), 0.01 * pair.size])
        norms = np.linalg.norm(G, axis=0)
        limits = [cp.abs(x[5:]) <= (reach * norms)[5:], cp.norm(x, "inf") <= 100]
        gain = cp.Problem(cp.Maximize(cp.min(slopes / norms @ x)), limits).solve(solver=cp.CLARABEL)
        assert gain < 0.02 * fit.worst


def test_response_of_a_model_is_that_of_its_states():
    """`response` and the map agree on an ill-conditioned basis: two pairs 1e-7 apart, 1e-6 from the circle."""
    pair = (1 - 1e-6) * np.exp(1j * np.array([0.5, 0.5 + 1e-7]))
    A, C, _ = sample_fits.pole_functions(np.concatenate([pair, pair.conj()]))
    samples = sample_map(structure(0), 0)
    model = control.ss(A, np.ones((4, 1)), C, 0, 0.01)
    (frf,) = structure(0).frequency
    mine = samples.states(A, C)[0][0, 0, :, 0] @ np.ones(4)
    np.testing.assert_allclose(mine, response(model, frf.omega * 0.01), rtol=1e-9)


@pytest.mark.parametrize("size", [1e-300, 1e-200, 1.0, 1e200, 1e307])
def test_columns_of_any_size_are_orthonormalised(size):
    """Norms of such columns overflow or vanish, one by one; what is too small to be divided by has no part."""
    G = np.random.default_rng(0).standard_normal((40, 5)) * np.array([1, 1, size, 1, 1])
    U, V = orthonormal_columns(G)
    assert U.shape == (40, 5 if size > 1e-280 else 4)
    np.testing.assert_allclose(U.T @ U, np.eye(U.shape[1]), atol=1e-13)
    np.testing.assert_allclose(G @ V, U, atol=1e-13)


@pytest.mark.parametrize("bad", [np.inf, -np.inf, np.nan])
def test_columns_that_overflow_have_no_part(bad):
    G = np.random.default_rng(0).standard_normal((40, 5))
    wanted, _ = orthonormal_columns(G[:, [0, 1, 3, 4]])
    G[7, 2] = bad
    U, V = orthonormal_columns(G)
    np.testing.assert_allclose(U @ U.T, wanted @ wanted.T, atol=1e-13)
    assert not V[2].any()


def test_a_start_whose_factorisation_fails_leaves_the_others(monkeypatch):
    """The smallest order, that of the plant, is found as without it."""
    identification = rid.identify(mixed("rest", samples=12))

    def fails(*_):
        raise np.linalg.LinAlgError("SVD did not converge")

    monkeypatch.setattr(best_models.pole_starts, "sanathanan_koerner", fails)
    assert rid.reduce_within_bounds(identification).order == 4

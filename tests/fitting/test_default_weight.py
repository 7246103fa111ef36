"""The weight without a given one: exact covariances as they are, estimated ones shrunk, with room for what a model misses."""

import dataclasses

import numpy as np
import pytest

import robustid as rid
from robustid.errors import InputError
from robustid.fitting import Weight, fit_mfd
from support.mfd_systems import gaussian, random_modal_system

OMEGA = 2 * np.pi * np.geomspace(4, 1200, 100)
TRUTH = random_modal_system(3, 2, 2, 4, band_hz=(5, 1000), damping=(0.005, 0.02)).response(1j * OMEGA)


def errors(rng, covariance, count):
    """Samples (count, F, n) of circular errors of this covariance."""
    root = np.linalg.cholesky(covariance)
    return (root @ gaussian(rng, count, len(covariance), covariance.shape[1], 1))[..., 0]


def sampled(rng, truth, covariance, experiments):
    """The mean of some experiments as FrequencyResponse, with the covariance that their scatter shows."""
    e = errors(rng, covariance, experiments)
    mean, away = e.mean(axis=0), e - e.mean(axis=0)
    estimate = np.einsum("rfi,rfj->fij", away, away.conj()) / (experiments - 1) / experiments
    values = truth + mean.reshape(len(truth), *truth.shape[:0:-1]).transpose(0, 2, 1)
    return rid.FrequencyResponse(OMEGA, values, covariance=estimate, dof=experiments - 1.0)


def noise(size=0.05):
    """Correlated, the size follows the response."""
    level = size * np.abs(TRUTH.transpose(0, 2, 1).reshape(-1, 4))
    return (0.5 * np.eye(4) + 0.5) * level[:, :, None] * level[:, None, :]


def weight_of(frf, **options):
    return fit_mfd(frf, order=2, restart=False, method="sk", **options).problem.weight


def same_criterion(one, other, rtol):
    residual = gaussian(np.random.default_rng(5), *one.shape)
    sizes = [np.linalg.norm(weight.apply(residual), axis=1) for weight in (one, other)]
    np.testing.assert_allclose(sizes[0], sizes[1], rtol=rtol)


def test_an_exact_covariance_is_taken_as_it_is():
    frf = rid.FrequencyResponse(OMEGA, TRUTH, covariance=noise())
    weight = weight_of(frf)
    np.testing.assert_array_equal(weight.matrix, Weight.from_covariance(noise(), 2, 2).matrix)
    assert "taken as exact" in weight.note


def test_endless_degrees_of_freedom_make_an_estimate_exact():
    exact = weight_of(rid.FrequencyResponse(OMEGA, TRUTH, covariance=noise()))
    known = weight_of(rid.FrequencyResponse(OMEGA, TRUTH, covariance=noise(), dof=1e18))
    same_criterion(known, exact, rtol=1e-6)
    few = weight_of(rid.FrequencyResponse(OMEGA, TRUTH, covariance=noise(), dof=10))
    assert "10 degrees of freedom" in few.note
    with pytest.raises(AssertionError):
        same_criterion(few, exact, rtol=0.1)


def test_without_a_covariance_the_weight_is_relative():
    weight = weight_of(rid.FrequencyResponse(OMEGA, TRUTH))
    np.testing.assert_array_equal(weight.entries, 1 / np.abs(TRUTH))
    assert weight.note.startswith("relative")
    fit = fit_mfd(rid.FrequencyResponse(OMEGA, TRUTH), order=2, weight=np.ones(TRUTH.shape), restart=False, method="sk")
    assert fit.weight_choice == "as given"


@pytest.mark.parametrize("dof", [None, pytest.param(1.0, marks=pytest.mark.slow)])
def test_a_singular_covariance_is_shrunk_and_not_refused(dof):
    """Two experiments of a 2 x 2 response: of rank one."""
    frf = dataclasses.replace(sampled(np.random.default_rng(0), TRUTH, noise(), 2), dof=dof)
    assert np.all(np.linalg.matrix_rank(frf.covariance, hermitian=True) == 1)
    with pytest.raises(InputError, match="leave the weight of a fit out"):
        Weight.from_covariance(frf.covariance, 2, 2)
    weight = weight_of(frf)
    assert "1 degrees of freedom" in weight.note
    ratio = np.linalg.cond(weight.matrix)
    assert ratio.max() < 100
    assert rid.fits.suggest_order(frf, orders=[2], method="sk").noise_known is False


def test_no_weight_stands_out_where_the_scatter_happens_to_vanish():
    """What one variance of few degrees of freedom says is bounded by those beside it and by the level of the response."""
    frf = sampled(np.random.default_rng(1), TRUTH, noise(), 8)
    covariance = frf.covariance.copy()
    covariance[70] *= 1e-12
    frf = dataclasses.replace(frf, covariance=covariance)
    size, raw = weight_of(frf).size, Weight.from_covariance(covariance, 2, 2).size
    assert raw[70] > 1e5 * np.sqrt(raw[69] * raw[71])
    assert 0.2 < size[70] / np.sqrt(size[69] * size[71]) < 5


def test_a_response_without_scatter_is_fitted():
    """A covariance of zeros, of which nothing can be learnt, and an entry that is zero throughout."""
    values = TRUTH * np.array([[1, 1], [1, 0]])
    for covariance in (np.zeros((len(OMEGA), 4, 4)), np.zeros((len(OMEGA), 4, 4)) + np.diag([1e-6, 0, 0, 0])):
        weight = weight_of(rid.FrequencyResponse(OMEGA, values, covariance=covariance))
        assert np.all(np.isfinite(weight.matrix))


@pytest.mark.parametrize("power", [-60, pytest.param(60, marks=pytest.mark.slow)])
def test_units_change_nothing_but_the_unit(power):
    frf = sampled(np.random.default_rng(2), TRUTH, noise(), 6)
    unit = np.array([[1.0], [2.0**power]])
    scale = np.tile(unit.ravel(), 2)
    covariance = frf.covariance * scale[:, None] * scale
    other = dataclasses.replace(frf, values=unit * frf.values, covariance=covariance)
    residual = gaussian(np.random.default_rng(5), *TRUTH.shape)
    sizes = [np.linalg.norm(weight_of(f).apply(r)) for f, r in ((frf, residual), (other, unit * residual))]
    assert sizes[1] == pytest.approx(sizes[0], rel=1e-9)


def withheld(weight_for, experiments, seed, order):
    """Root mean square error on every other frequency point, per entry, of a fit to the others."""
    frf = sampled(np.random.default_rng(seed), TRUTH, noise(), experiments)
    train, test = frf.select(slice(0, None, 2)), frf.select(slice(1, None, 2))
    fit = fit_mfd(train, order=order, weight=weight_for(train), restart=False)
    error = np.abs(fit.fraction.response(test.omega) - test.values) ** 2
    return np.sqrt(np.mean(error.sum(axis=0) / (np.abs(test.values) ** 2).sum(axis=0)))


def test_few_degrees_of_freedom_and_too_low_an_order_do_little_harm():
    """4 experiments of 4 entries, half of the modes: the default is at most 5 % worse than the best of the others."""
    weights = {
        "default": lambda frf: None,
        "unit": lambda frf: np.ones(frf.values.shape),
        "relative": lambda frf: 1 / np.abs(frf.values),
        "diagonal": lambda frf: (
            1 / np.sqrt(np.einsum("fii->fi", frf.covariance).real.reshape(-1, 2, 2).transpose(0, 2, 1))
        ),
    }
    found = {name: np.mean([withheld(w, 4, seed, 6) for seed in range(1)]) for name, w in weights.items()}
    best = min(found.values())
    assert found["default"] <= 1.05 * best, found
    assert found["diagonal"] > 1.2 * best, found

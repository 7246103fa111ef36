"""The weight that residuals ask for: a level where there is one, relative where the noise is, and where the model errs."""

import numpy as np
import pytest

import robustid as rid
from robustid.fitting import FractionProblem, Weight, fit_mfd, suggest_order
from robustid.fitting.fraction.weight_choice import gaussian, level_weight, white
from support.cases import slow
from support.mfd_systems import random_modal_system

OMEGA = 2 * np.pi * np.geomspace(4, 1200, 150)


def measured(seed, *, level=0.0, relative=0.0, modes=5):
    """True response of some modes, and a FrequencyResponse without covariance."""
    truth = random_modal_system(seed, 2, 2, modes).response(1j * OMEGA)
    e = np.random.default_rng(seed).standard_normal((2, *truth.shape)) / np.sqrt(2)
    size = level * np.sqrt(np.mean(np.abs(truth) ** 2)) + relative * np.abs(truth)
    return truth, rid.FrequencyResponse(OMEGA, truth + size * (e[0] + 1j * e[1]))


def error(fit, truth):
    return np.linalg.norm(fit.fraction.response(OMEGA) - truth) / np.linalg.norm(truth)


@pytest.mark.parametrize(("seed", "modes"), [(0, 3), *(slow(k, 5) for k in range(3))])
def test_noise_of_a_level_is_seen(seed, modes):
    """Three seeds of three: within 20 % of the fit that is told, at most a tenth of the error of relative weights."""
    truth, frf = measured(seed, level=0.01, modes=modes)
    fit = fit_mfd(frf, order=2 * modes)
    told = fit_mfd(frf, order=2 * modes, weight=Weight(np.ones(truth.shape)))
    relative = fit_mfd(frf, order=2 * modes, weight=Weight.relative(frf.values))
    assert "level" in fit.weight_choice
    assert error(fit, truth) <= 1.2 * error(told, truth)
    assert error(fit, truth) <= 0.1 * error(relative, truth)
    assert fit.stable
    assert fit.cost <= fit.start_cost
    first = [step for step in fit.history if step.former == "in weight 1"]
    assert [step.cost for step in first] == [step.cost for step in relative.history]


@pytest.mark.parametrize(("seed", "modes"), [(0, 3), slow(0, 5), slow(1, 5)])
@pytest.mark.parametrize(("missing", "form"), [(0, "right"), (2, "left")])
def test_relative_noise_and_too_small_an_order_stay_relative(missing, form, seed, modes):
    order = 2 * (modes - missing)
    for noise in ({"relative": 0.05}, {"level": 0.01} if missing else {"relative": 0.01}):
        _, frf = measured(seed, modes=modes, **noise)
        fit = fit_mfd(frf, order=order, form=form)
        assert fit.weight_choice.startswith("relative")
        assert fit.cost == fit_mfd(frf, order=order, form=form, weight=Weight.relative(frf.values)).cost


def test_level_and_relative_part_are_those_of_the_noise():
    """Every entry its own, within 15 %, from 2000 residuals each."""
    rng = np.random.default_rng(0)
    omega = np.geomspace(1, 100, 2000)
    size = np.geomspace(1e-2, 1e2, 2000)[rng.permutation(2000)][:, None, None] * np.ones((1, 2, 1))
    deviation = np.sqrt(np.array([[0.3], [0.05]]) ** 2 + (0.02 * size) ** 2)
    noise = rng.standard_normal((2, *size.shape)) / np.sqrt(2)
    values = size + deviation * (noise[0] + 1j * noise[1])
    problem = FractionProblem(omega, values, 2, Weight.relative(values))
    found = level_weight(problem, size.astype(complex))
    assert found is not None
    assert np.allclose(found.entries * deviation, 1, atol=0.15)
    assert white(found.apply(values - size))
    assert level_weight(problem, values * (1 + 1e-9)) is None  # nothing is left
    assert level_weight(problem, values * 0.9) is None  # a model error: neighbours err alike


def test_orders_are_compared_in_one_weight():
    frf = measured(0, level=0.01, modes=2)[1].select(slice(None, None, 2))
    assert "level" in fit_mfd(frf, order=4).weight_choice
    sweep = suggest_order(frf, orders=[3, 4])
    assert all(fit.weight_choice.startswith("relative") for fit in sweep.fits.values())


def test_what_a_model_misses_has_heavy_tails():
    """Gaussian residuals of any size an entry pass, 10 seeds of 10; with one resonance among them they don't."""
    for seed in range(10):
        e = np.random.default_rng(seed).standard_normal((2, 200, 3)) * np.array([1.0, 1e-3, 50.0])
        noise = e[0] + 1j * e[1]
        assert gaussian(noise)
        noise[90:95] *= 6
        assert not gaussian(noise)
    assert gaussian(np.zeros((5, 2)))

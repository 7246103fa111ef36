"""The model worth having: inside every bound, and about as good as the best fit."""

import numpy as np
import pytest

import robustid as rid
from robustid.identification import largest_ratio
from robustid.reduction import model_worth_having, reduce_within_bounds


def measured(seed, wide=40.0, lines=80, noise=0.02):
    """Two modes with noise, and bounds many times as wide."""
    rng = np.random.default_rng(seed)
    omega = np.linspace(2.0, 120.0, lines)
    basis = rid.kautz([30.0, 75.0], [0.05, 0.02], dt=0.01, delay=1)
    values = basis.response(omega * 0.01) @ np.array([0.5, 0.3, 0.1, 0.2])
    level = noise * np.median(np.abs(values))
    values = values + level * (rng.standard_normal(lines) + 1j * rng.standard_normal(lines))
    return rid.FrequencyResponse(omega, values, bound=wide * 4 * level, dt=0.01), basis


def small(frf, basis):
    prior = rid.Prior(gain_bound=2 * float(frf.bound.max()), decay_rate=1.3)
    found = rid.identify(rid.MixedProblem(frequency=frf, prior=prior, parametric=basis))
    return found, reduce_within_bounds(found)


@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.slow)])
def test_wide_bounds_do_not_make_a_poor_model_the_recommended_one(seed):
    frf, basis = measured(seed)
    found, reduction = small(frf, basis)
    assert reduction.order < 4  # the bounds hold a model that has lost a mode
    worth = model_worth_having(found, reduction, frf)
    assert worth.carried == 4
    assert worth.reduction.order == 4
    assert largest_ratio(found.problem, worth.reduction.model) <= 1
    assert worth.misfit <= 1.05 * worth.best
    assert worth.smallest_misfit > 1.5 * worth.best
    assert not worth.worse
    assert "smallest is not best" in worth.summary()


def test_a_small_model_that_fits_as_well_stays():
    frf, basis = measured(0, wide=1.0)
    found, reduction = small(frf, basis)
    assert reduction.order == 4
    worth = model_worth_having(found, reduction, frf)
    assert worth.reduction.order == 4
    assert worth.misfit <= worth.smallest_misfit
    assert not worth.worse


def test_models_with_integrators_are_left_as_they_are():
    omega = np.linspace(2.0, 120.0, 30)
    basis = rid.integrators(dt=0.01)
    values = basis.response(omega * 0.01) @ [0.01]
    frf = rid.FrequencyResponse(omega, values, bound=0.01, dt=0.01)
    found, reduction = small(frf, basis)
    assert model_worth_having(found, reduction, frf) is None

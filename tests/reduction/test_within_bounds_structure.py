"""The smallest model of a light structure within its bounds, from every objective, and with integrators."""

import dataclasses

import numpy as np
import pytest

import robustid as rid
from robustid.identification import model_residuals
from support.problems import rigid_structure


def problem(seed, **prior):
    data = rid.flexible_structure(seed=seed)
    basis = rid.kautz(data.modes[:, 0], data.modes[:, 1], dt=0.01, delay=1)
    prior = rid.Prior(**({"gain_bound": 0.2, "decay_rate": 1.1} | prior))
    return rid.MixedProblem(frequency=data.frequency, time=data.time, prior=prior, parametric=basis)


@pytest.mark.parametrize("seeds", [1, pytest.param(4, marks=pytest.mark.slow)])
def test_reduced_models_keep_every_sample(seeds):
    """All seeds: every sample inside, the margins reported are those of the samples, and no smaller order was skipped."""
    for seed in range(seeds):
        result = rid.identify(problem(seed), objective="gain")
        reduction = rid.reduce_within_bounds(result)
        worst = max(r.ratio.max() for r in model_residuals(result.problem, reduction.model))
        assert worst == pytest.approx(reduction.margin, rel=1e-12)
        assert worst <= 1 + 1e-5
        assert reduction.order == reduction.model.nstates == 4  # as the truth
        assert [order for order, _ in reduction.tried] == list(range(5))
        assert all(margin > 1 for _, margin in reduction.tried[:-1])
        omega = np.linspace(1, 314, 500)
        z = np.exp(1j * omega * 0.01)
        assert np.abs(result.model(z) - reduction.model(z)).max() <= reduction.bound + 1e-9 * 7  # of the peak: rounding


def test_the_smallest_order_over_the_objectives_is_taken():
    result = rid.identify(problem(0))
    best = rid.reduce_within_bounds(result)
    assert best.order == 4 < result.order
    assert max(r.ratio.max() for r in model_residuals(result.problem, best.model)) <= 1 + 1e-5


def test_inconsistent_data_are_reduced_to_the_level_of_the_margin():
    data = rid.flexible_structure(seed=0)
    wrong = rid.kautz(2 * np.pi * np.array([9.0, 17.2]), [0.1, 0.004], dt=0.01, delay=1)
    result = rid.identify(dataclasses.replace(problem(0), parametric=wrong, time=data.time))
    reduction = rid.reduce_within_bounds(result)
    assert not result.consistent
    assert reduction.margin <= result.margin * (1 + 2e-5)
    assert "contradict" in reduction.status.value


def test_integrators_survive_the_reduction():
    rigid, truth = rigid_structure()
    omega = 2 * np.pi * np.linspace(1, 40, 10)
    F = truth(np.exp(1j * omega * 0.01))
    frf = rid.FrequencyResponse(omega, F, bound=1e-2 * np.abs(F), dt=0.01)
    basis = [rigid, rid.kautz(2 * np.pi * np.array([9.0, 17.67]), [0.1, 0.004], dt=0.01, delay=1)]
    prior = rid.Prior(gain_bound=0.1, decay_rate=1.2)
    result = rid.identify(rid.MixedProblem(frequency=frf, prior=prior, parametric=basis), objective="gain")
    reduction = rid.reduce_within_bounds(result)
    assert reduction.order < result.order
    assert np.sum(np.abs(reduction.model.poles() - 1) < 1e-6) == 2
    assert reduction.margin <= 1 + 1e-5


def test_reduce_within_bounds_wants_an_identification():
    with pytest.raises(rid.errors.InputTypeError, match="identify"):
        rid.reduce_within_bounds(rid.flexible_structure().truth)

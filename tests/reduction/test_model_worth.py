"""The model worth having: inside every bound, and about as good as the best fit."""

import dataclasses

import control
import numpy as np
import pytest

import robustid as rid
from robustid.identification import largest_ratio
from robustid.reduction import model_worth_having, reduce_within_bounds, why_not_compared
from robustid.reduction.record_simulations import with_transients
from support.two_mode_models import rigid_body


def measured(seed, wide=40.0, lines=32, noise=0.02):
    """Two modes with noise, and bounds many times as wide."""
    rng = np.random.default_rng(seed)
    omega = np.linspace(2.0, 120.0, lines)
    basis = rid.kautz([30.0, 75.0], [0.05, 0.02], dt=0.01, delay=1)
    values = basis.response(omega * 0.01) @ np.array([0.5, 0.3, 0.1, 0.2])
    level = noise * np.median(np.abs(values))
    values = values + level * (rng.standard_normal(lines) + 1j * rng.standard_normal(lines))
    return rid.FrequencyResponse(omega, values, bound=wide * 4 * level, dt=0.01), basis


# Of the fits that are looked at.
ORDERS = pytest.mark.parametrize("most", [6, pytest.param(12, marks=pytest.mark.slow)])


def try_orders_up_to(most, monkeypatch):
    for part in ("response_comparison", "model_worth"):
        monkeypatch.setattr(f"robustid.reduction.{part}.MOST", most)


def small(frf, basis):
    prior = rid.Prior(gain_bound=2 * float(frf.bound.max()), decay_rate=1.3)
    found = rid.identify(rid.MixedProblem(frequency=frf, prior=prior, parametric=basis))
    return found, reduce_within_bounds(found)


@pytest.mark.parametrize(("seed", "most"), [(0, 6), *(pytest.param(k, 12, marks=pytest.mark.slow) for k in (0, 1))])
def test_wide_bounds_do_not_make_a_poor_model_the_recommended_one(monkeypatch, seed, most):
    try_orders_up_to(most, monkeypatch)
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


@ORDERS
def test_a_small_model_that_fits_as_well_stays(monkeypatch, most):
    try_orders_up_to(most, monkeypatch)
    frf, basis = measured(0, wide=1.0)
    found, reduction = small(frf, basis)
    assert reduction.order == 4
    worth = model_worth_having(found, reduction, frf)
    assert worth.reduction.order == 4
    assert worth.misfit <= worth.smallest_misfit
    assert not worth.worse


def test_a_single_integrator_is_not_compared():
    omega = np.linspace(2.0, 120.0, 30)
    basis = rid.integrators(dt=0.01)
    values = basis.response(omega * 0.01) @ [0.01]
    frf = rid.FrequencyResponse(omega, values, bound=0.01, dt=0.01)
    found, reduction = small(frf, basis)
    assert model_worth_having(found, reduction, frf) is None
    assert "integrators that are no rigid-body modes" in why_not_compared(found, reduction, frf)


@ORDERS
def test_rigid_body_models_are_compared_with_fits_that_keep_them(monkeypatch, most):
    try_orders_up_to(most, monkeypatch)
    frf, basis = rigid_body(0.2)
    found, reduction = small(frf, basis)
    worth = model_worth_having(found, reduction, frf)
    assert worth.carried == 4
    assert worth.misfit <= 1.05 * worth.best
    assert np.sum(np.abs(worth.reduction.model.poles() - 1) < 1e-6) == 2
    assert largest_ratio(found.problem, worth.reduction.model) <= 1


def resonant(seed, samples=300, noise=0.02, dt=0.01):
    """A record of two modes from an unknown state, with white noise."""
    rng = np.random.default_rng(seed)
    basis = rid.kautz([40.0, 110.0], [0.08, 0.05], dt=dt, delay=1)
    plant = control.ss(basis.A, basis.B, np.array([[0.5, 0.3, 0.2, 0.3]]) @ basis.C, 0, dt)
    u = rng.standard_normal(samples)
    clean = control.forced_response(plant, U=u, X0=3 * rng.standard_normal(4)).outputs
    y = clean + noise * clean.std() * rng.standard_normal(samples)
    return rid.TimeRecord(u, y, dt=dt, initial="free"), basis, clean


@pytest.mark.parametrize(("most", "samples"), [(5, 150), pytest.param(12, 300, marks=pytest.mark.slow)])
def test_a_model_that_simulates_the_record_well_is_preferred(monkeypatch, most, samples):
    """The bounds of a short record's response hold models of its order that miss most of the output."""
    try_orders_up_to(most, monkeypatch)
    record, basis, _ = resonant(0, samples=samples)
    frf = rid.estimate_frf(record, method="local")
    frf = frf.with_bound(2 * frf.bound.outer_radius)
    found, reduction = small(frf, basis)
    alone = model_worth_having(found, reduction, frf)
    both = model_worth_having(found, reduction, frf, records=[record])
    assert alone.simulated is None
    assert both.simulated.fits[0] >= both.simulated.best[0] - 2
    assert both.simulated.fits[0] >= rid.validate(alone.reduction.model, record).fit[0] * 100 - 1e-9
    assert largest_ratio(found.problem, both.reduction.model) <= 1
    assert both.simulated.samples == samples
    assert f"Simulated over the {samples} samples" in both.summary()


@ORDERS
def test_records_alone_are_enough(monkeypatch, most):
    try_orders_up_to(most, monkeypatch)
    record, basis, clean = resonant(1, samples=80)
    bounded = dataclasses.replace(record, bound=0.3 * clean.std())
    problem = rid.MixedProblem(time=bounded, parametric=basis, prior=rid.Prior(gain_bound=0.5, decay_rate=1.2))
    found = rid.identify(problem)
    reduction = reduce_within_bounds(found)
    assert why_not_compared(found, reduction, None)
    assert model_worth_having(found, reduction, None) is None
    worth = model_worth_having(found, reduction, None, records=[bounded])
    assert worth.carried == 4
    assert worth.misfit <= 1.05 * worth.best
    assert worth.best < 0.03
    assert not worth.of_response
    assert largest_ratio(problem, worth.reduction.model) <= 1
    assert "simulation error" in worth.summary()


def test_records_in_steady_state_or_too_long_say_no_more_than_their_spectrum():
    record, _, _ = resonant(0, samples=100)
    steady = dataclasses.replace(record, initial="periodic")
    long = rid.TimeRecord(np.zeros(30000), np.zeros(30000), dt=0.01)
    assert with_transients([record, steady]) == [record]
    assert with_transients([record, long]) == []

"""The model worth having: inside every bound, and about as good as the best fit."""

import dataclasses

import control
import numpy as np
import pytest

import robustid as rid
from robustid.core import Budget, points_of
from robustid.identification import largest_ratio
from robustid.reduction import model_worth_having, reduce_within_bounds, why_not_compared, without_doubtful_modes
from robustid.reduction.drawn_inside import Bounds, drawn_fits
from robustid.reduction.record_simulations import Simulations, with_transients
from support.cases import slow
from support.two_mode_models import rigid_body


def measured(seed, wide=40.0, lines=32, noise=0.02, modes=2):
    """Modes with noise, and bounds many times as wide."""
    rng = np.random.default_rng(seed)
    omega = np.linspace(2.0, 120.0, lines)
    basis = rid.kautz([30.0, 75.0][:modes], [0.05, 0.02][:modes], dt=0.01, delay=1)
    values = basis.response(omega * 0.01) @ np.array([0.5, 0.3, 0.1, 0.2])[: 2 * modes]
    level = noise * np.median(np.abs(values))
    values = values + level * (rng.standard_normal(lines) + 1j * rng.standard_normal(lines))
    return rid.FrequencyResponse(omega, values, bound=wide * 4 * level, dt=0.01), basis


# Of the fits that are looked at.
ORDERS = pytest.mark.parametrize("most", [5, pytest.param(12, marks=pytest.mark.slow)])


def try_orders_up_to(most, monkeypatch):
    for part in ("response_comparison", "model_worth"):
        monkeypatch.setattr(f"robustid.reduction.{part}.MOST", most)


def small(frf, basis):
    prior = rid.Prior(gain_bound=2 * float(frf.bound.max()), decay_rate=1.3)
    found = rid.identify(rid.MixedProblem(frequency=frf, prior=prior, parametric=basis))
    return found, reduce_within_bounds(found)


@pytest.mark.parametrize(("seed", "most"), [(0, 5), slow(0, 12), slow(1, 12)])
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


@pytest.mark.parametrize(("modes", "most"), [(1, 3), slow(2, 5), slow(2, 12)])
def test_a_small_model_that_fits_as_well_stays(monkeypatch, modes, most):
    try_orders_up_to(most, monkeypatch)
    frf, basis = measured(0, wide=1.0, modes=modes)
    found, reduction = small(frf, basis)
    assert reduction.order == 2 * modes
    worth = model_worth_having(found, reduction, frf)
    assert worth.reduction.order == 2 * modes
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


@pytest.mark.parametrize(("most", "samples"), [(4, 110), pytest.param(12, 300, marks=pytest.mark.slow)])
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


def heating(start, ambient=22.0, samples=360, seed=0):
    """A record of a heating plate, said to begin at rest, its plant, and the fit that noise leaves to the plant in per cent."""
    rng = np.random.default_rng(seed)
    plant = control.ss([[0.98, 0.0], [0.2, 0.8]], [[0.016], [0.0]], [[0.0, 1.0]], 0, 5.0)
    u = np.repeat(rng.choice([30.0, 60.0], samples // 60), 60)
    clean = ambient + control.forced_response(plant, U=u, X0=start * np.array([0.8, 0.8])).outputs
    y = clean + 0.3 * rng.standard_normal(samples)
    left = 100 * (1 - np.linalg.norm(y - clean) / np.linalg.norm(y - y.mean()))
    return rid.TimeRecord(u, y, dt=5.0), plant, left


@pytest.mark.parametrize(("start", "ambient"), [(45.0, 22.0), slow(45.0, 0.0), slow(0.0, 22.0)])
def test_a_process_is_judged_around_its_operating_point(start, ambient):
    """From its state there, and but for a constant: the plant itself fits all but the noise, and so does the fit of its order."""
    record, plant, noise = heating(start, ambient)
    assert rid.validate(plant, record).fit[0] < 0.5
    records = with_transients([record])
    assert [one.initial for one in records] == ["free"]
    found = Simulations(records, None, range(1, 4), feedthrough=False, budget=Budget(None))
    assert found.quality(plant)[0] == pytest.approx(noise, abs=1.0)
    assert found.quality(found.fits[2].model)[0] == pytest.approx(noise, abs=1.0)
    assert found.carried() == 2
    wrong = control.ss(plant.A, plant.B * 0.2, plant.C, 0, plant.dt)
    assert found.quality(wrong)[0] < 60


@pytest.mark.parametrize(("carried", "last"), [(0, 6), (7, 7)])
def test_no_order_is_fitted_far_above_that_which_the_records_carry(carried, last):
    rng = np.random.default_rng(0)
    u, plant = rng.standard_normal(100), control.ss([[0.9, 0.4], [-0.4, 0.9]], [[0], [1]], [[1, 0]], [[0]], 0.1)
    y = control.forced_response(plant, U=u).outputs
    record = rid.TimeRecord(u, y + 0.05 * y.std() * rng.standard_normal(100), dt=0.1)
    found = Simulations([record], None, range(1, 9), feedthrough=False, budget=Budget(None), carried=carried)
    assert list(found.fits) == list(range(1, last + 1))
    assert found.carried() == 2


def test_a_record_that_begins_at_rest_stays_one_and_a_bound_too():
    record, plant, noise = heating(0.0, 0.0)
    assert with_transients([record]) == [record]
    bounded = dataclasses.replace(heating(45.0)[0], bound=1.0)
    assert with_transients([bounded]) == [bounded]
    late = dataclasses.replace(record, y=record.y + np.where(np.arange(360) > 0, 5.0, 0.0)[:, None])
    found = Simulations([late], None, range(1, 2), feedthrough=False, budget=Budget(None))
    assert late.initial == "rest"
    assert found.quality(plant)[0] == pytest.approx(noise, abs=3.0)  # the sensor's constant is no error of the model


# --- modes that the data hardly show


def structure(extra):
    """A resonance at 10 Hz, and what is said to be beside it: data, identification, model."""
    dt, omega = 0.01, 2 * np.pi * np.arange(1.0, 31.0)
    basis = rid.kautz(2 * np.pi * 10.0, 0.05, dt=dt, delay=1)
    values = basis.response(omega * dt) @ [1.0, 0.5]
    frf = rid.FrequencyResponse(omega, values, bound=0.02, dt=dt)
    prior = rid.Prior(gain_bound=0.05, decay_rate=1.3)
    found = rid.identify(rid.MixedProblem(frequency=frf, prior=prior, parametric=basis))
    own = control.ss(basis.A, basis.B, np.array([[1.0, 0.5]]) @ basis.C, np.array([[1.0, 0.5]]) @ basis.D, dt)
    hz, damping, size = extra
    other = rid.kautz(2 * np.pi * hz, damping, dt=dt, delay=1)
    more = control.ss(other.A, other.B, np.array([[size, 0.0]]) @ other.C, np.zeros((1, 1)), dt)
    return found, control.parallel(own, more)


def test_a_mode_that_a_zero_almost_cancels_is_left_out():
    found, model = structure((9.7, 0.03, 0.003))
    assert largest_ratio(found.problem, model) < 1
    smaller, modes = without_doubtful_modes(found, model)
    assert smaller.nstates == 2
    (mode,) = modes
    assert mode.removed
    np.testing.assert_allclose([mode.hz, mode.damping], [9.7, 0.03], rtol=1e-6)
    assert "a zero almost cancels" in mode.summary()
    assert largest_ratio(found.problem, smaller) <= 1


def test_a_mode_between_the_points_and_one_at_the_limit_of_damping_are_named():
    for extra, words in (((20.5, 0.001, 0.002), "narrower"), ((20.5, 1e-5, 1e-4), "limit of damping")):
        found, model = structure(extra)
        smaller, modes = without_doubtful_modes(found, model)
        assert [words in mode.why for mode in modes] == [True]
        assert smaller.nstates == 2


def test_points_that_were_not_used_and_samples_that_need_a_mode_keep_it():
    found, model = structure((20.5, 0.001, 0.002))
    unused = 2 * np.pi * np.array([20.5])
    shown = rid.FrequencyResponse(unused, model(np.exp(1j * unused * 0.01)), bound=0.01, dt=0.01)
    kept, modes = without_doubtful_modes(found, model, [shown])
    assert kept is model
    assert [mode.removed for mode in modes] == [False]
    assert "measure more points" in modes[0].summary()


def test_a_mode_that_the_data_show_is_not_doubtful():
    found, _ = structure((20.0, 0.05, 0.0))
    plain, modes = without_doubtful_modes(found, found.model)
    assert plain is found.model
    assert modes == ()


# --- fits drawn inside the bounds


def data(dt, seed):
    """Two modes, a well-damped third one that fits of order 4 have no place for, and errors; bounds that one value of it breaks."""
    rng = np.random.default_rng(seed)
    omega = np.linspace(2.0, 25.0, 120)
    s = points_of(omega, dt)
    modes = ((20.0, 0.2, 25.0), (30.0, 0.4, 144.0), (15.0, 12.0, 324.0))
    plant = sum(control.tf([gain], [1, twice, square]) for gain, twice, square in modes)
    plant = control.sample_system(plant, dt) if dt else plant
    deviation = 1e-3
    noise = deviation * (rng.normal(size=120) + 1j * rng.normal(size=120)) / np.sqrt(2)
    values = np.asarray(plant(s)) + noise
    frf = rid.FrequencyResponse(omega, values, dt=dt, bound=1.0, covariance=np.full((120, 1, 1), deviation**2))
    fit = rid.fit_mfd(frf, order=4, domain="z" if dt else "s", feedthrough=True)
    left = np.abs(frf.values - np.asarray(fit.to_control()(s)).reshape(-1, 1, 1))
    bound = np.full(120, 2.0 * left.max())
    worst = int(np.argmax(left))
    bound[worst] = 0.85 * left.max()
    return frf.with_bound(bound[:, None, None]), fit


@pytest.mark.parametrize("dt", [pytest.param(None, marks=pytest.mark.slow), 0.05])
@pytest.mark.parametrize("seed", [pytest.param(k, marks=pytest.mark.slow) if k else k for k in range(3)])
def test_a_fit_outside_at_one_point_ends_inside_and_hardly_worse(dt, seed):
    frf, fit = data(dt, seed)

    def ratio(model):
        return rid.validate(model, frf).ratio

    def misfit(model):
        return np.linalg.norm(rid.validate(model, frf).residuals)

    bounds = Bounds(ratio, lambda _: None)
    found = list(drawn_fits(frf, fit, bounds, Budget(), domain="z" if dt else "s", feedthrough=True))
    assert ratio(found[0]) > 1.1
    assert ratio(found[-1]) <= 1
    assert misfit(found[-1]) < 1.3 * misfit(found[0])
    assert found[-1].nstates == 4


def test_a_sequence_that_goes_astray_is_ended():
    frf, fit = data(0.05, 0)
    ratios = iter([1.5, 1.4, 1.4, 1.4, 9.0, 9.0, 9.0, 9.0])
    bounds = Bounds(lambda _: next(ratios, 9.0), lambda _: None)
    assert len(list(drawn_fits(frf, fit, bounds, Budget(), feedthrough=True))) <= 4

"""Advice: modes, prior and diagnosis against plants, closed forms and solvers that the advice doesn't know."""

import dataclasses

import control
import cvxpy as cp
import numpy as np
import pytest

import robustid as rid
from robustid.advice import diagnose, suggest_kautz, suggest_prior
from robustid.data.io import datasets
from robustid.errors import DatasetNotFoundError, InputError, InputTypeError, RobustIdError, SizeError

FINE = np.linspace(17.2, 18.1, 10)
ANY = rid.Prior(gain_bound=1.0, decay_rate=1.5)


def structure_problem(which, **options):
    data = rid.flexible_structure(**options)
    modes = data.modes[which]
    basis = rid.kautz(modes[:, 0], modes[:, 1], dt=0.01, delay=1) if len(modes) else None
    return rid.MixedProblem(frequency=data.frequency, time=data.time, prior=ANY, parametric=basis)


# --- modes


@pytest.mark.parametrize("seeds", [3, pytest.param(12, marks=pytest.mark.slow)])
@pytest.mark.parametrize(("extra", "determined"), [((), False), (FINE, True)])
def test_modes_of_the_structure_lie_in_their_intervals(extra, determined, seeds):
    held = 0
    for seed in range(seeds):
        data = rid.flexible_structure(seed=seed, extra_hz=extra)
        found = suggest_kautz(data.frequency)
        assert found.omega.size == 2
        assert found.delay == 1  # a zero-order-hold mode without feed-through
        np.testing.assert_allclose(found.omega, data.modes[:, 0], rtol=0.01)
        inside = [
            (interval[:, 0] <= truth) & (truth <= interval[:, 1])
            for interval, truth in (
                (found.omega_interval, data.modes[:, 0]),
                (found.damping_interval, data.modes[:, 1]),
            )
        ]
        held += np.all(inside)
        # 11 lines 2 Hz apart can't tell the light mode's damping; ten more around it can.
        assert found.undetermined[1] != determined
        assert not found.undetermined[0]
        assert ("measure more of them" in found.summary()) != determined
    assert held == seeds  # errors are within the bounds, so the true poles may not be left out


def smallest_margin(data, pole, other):
    """By a conic solver: pair at `pole`, double pair at `other`, three smooth terms."""
    angle = data.omega * data.dt
    columns = np.hstack(
        [
            rid.kautz(*pole, dt=data.dt).response(angle),
            rid.kautz(*other, dt=data.dt, repeat=2).response(angle),
            np.exp(-1j * np.outer(angle, [0, 1, 2])),
        ]
    )
    weights = cp.Variable(columns.shape[1])
    residual = cp.multiply(1 / data.bound[:, 0, 0], data.values[:, 0, 0] - columns @ weights)
    return cp.Problem(cp.Minimize(cp.max(cp.abs(residual)))).solve(solver="CLARABEL")


def test_poles_outside_the_interval_are_refuted_by_a_conic_solver():
    data = rid.flexible_structure().frequency
    found = suggest_kautz(data)
    other = found.omega[0], found.damping[0]
    low, high = found.omega_interval[1]
    for omega in (low - 0.05 * (high - low), high + 0.05 * (high - low)):
        margins = [smallest_margin(data, (omega, zeta), other) for zeta in np.geomspace(1e-5, 0.1, 15)]
        assert min(margins) > 1
    heaviest = found.damping_interval[1, 1]
    for omega in np.linspace(low, high, 15):
        assert smallest_margin(data, (omega, 1.1 * heaviest), other) > 1
    assert smallest_margin(data, (found.omega[1], found.damping[1]), other) <= 1


@pytest.mark.parametrize("power", [60, -60])
def test_modes_do_not_depend_on_units(power):
    frf, factor = rid.flexible_structure(extra_hz=FINE).frequency, 2.0**power
    scaled = rid.FrequencyResponse(
        frf.omega * factor, frf.values / factor, bound=frf.bound / factor, dt=frf.dt / factor
    )
    one, two = suggest_kautz(frf), suggest_kautz(scaled)
    np.testing.assert_allclose(two.omega, one.omega * factor, rtol=1e-9)
    np.testing.assert_allclose(two.damping, one.damping, rtol=1e-9)
    np.testing.assert_allclose(two.omega_interval, one.omega_interval * factor, rtol=1e-9)
    np.testing.assert_allclose(two.damping_interval, one.damping_interval, rtol=1e-9)


def test_exact_data_give_exact_poles():
    omega, zeta, dt = np.array([40.0, 90.0, 130.0]), np.array([0.02, 0.005, 0.01]), 0.01
    line = np.linspace(5, 180, 120)
    basis = rid.kautz(omega, zeta, dt=dt, delay=1)
    values = basis.response(line * dt) @ np.array([1, 0.5, -0.3, 0.2, 0.1, 0.4])
    found = suggest_kautz(rid.FrequencyResponse(line, values, bound=1e-6, dt=dt))
    np.testing.assert_allclose(found.omega, omega, rtol=1e-6)
    np.testing.assert_allclose(found.damping, zeta, rtol=1e-4)
    problem = rid.MixedProblem(
        frequency=rid.FrequencyResponse(line[::12], values[::12], bound=1e-3, dt=dt),
        prior=ANY,
        parametric=found.basis,
    )
    assert suggest_prior(problem, decay_rates=[1.2]).gains[0] == 0


def test_smooth_data_have_no_mode():
    frf = rid.FrequencyResponse(np.linspace(1, 100, 20), np.full(20, 0.3), bound=0.01, dt=0.01)
    found = suggest_kautz(frf)
    assert found.omega.shape == (0,)
    assert found.omega_interval.shape == (0, 2)
    assert found.basis is None
    assert found.summary().startswith("0 modes")


def test_options_of_suggest_kautz():
    frf = rid.flexible_structure(extra_hz=FINE).frequency
    found = suggest_kautz(frf, modes=1, delay=2, repeat=2)
    assert found.omega.size == 1
    assert (found.basis.size, found.delay) == (4, 2)
    continuous = rid.FrequencyResponse(frf.omega, frf.values, bound=frf.bound)
    np.testing.assert_array_equal(suggest_kautz(continuous, dt=frf.dt).omega, suggest_kautz(frf).omega)
    without = rid.FrequencyResponse(frf.omega, frf.values, dt=frf.dt)
    np.testing.assert_allclose(suggest_kautz(without).omega[1], 2 * np.pi * 17.67, rtol=1e-3)


LINES = np.arange(1.0, 9.0)


@pytest.mark.parametrize(
    ("frf", "options", "error", "sentence"),
    [
        ("frf", {}, InputTypeError, "`frf` must be a FrequencyResponse; got str"),
        (rid.FrequencyResponse(LINES, np.ones(8)), {}, InputError, "`dt` is needed"),
        (rid.FrequencyResponse(LINES, np.ones(8)), {"dt": 1.0}, InputError, "`dt` = 1 s allows frequencies up to 3.14"),
        (rid.FrequencyResponse(LINES, np.ones(8)), {"dt": -1.0}, InputError, "`dt` must be positive"),
        (rid.FrequencyResponse(LINES, np.zeros(8), dt=0.1), {}, InputError, "`frf` is zero at all lines"),
        (rid.FrequencyResponse(LINES[:3], np.ones(3), dt=0.1), {}, InputError, "`frf` has 3 lines; at least 4"),
        (rid.FrequencyResponse(LINES, np.ones(8), dt=0.1), {"modes": 4}, InputError, "can't tell more than 3 modes"),
        (rid.FrequencyResponse(LINES, np.ones(8), dt=0.1), {"modes": 0}, InputError, "`modes` must be at least 1"),
        (rid.FrequencyResponse(LINES, np.ones(8), dt=0.1), {"repeat": 0}, InputError, "`repeat` must be at least 1"),
        (
            rid.FrequencyResponse(LINES, np.ones(8), dt=0.1),
            {"delay": 0.5},
            InputTypeError,
            "`delay` must be an integer",
        ),
    ],
)
def test_suggest_kautz_refuses(frf, options, error, sentence):
    with pytest.raises(error, match=sentence) as caught:
        suggest_kautz(frf, **options)
    assert isinstance(caught.value, RobustIdError)


def dataset(name):
    try:
        return datasets.find(name)
    except DatasetNotFoundError as missing:
        pytest.skip(str(missing))


def torsion():
    dataset("two_mass/MultisineTypeA.mat")
    bench = datasets.load("two_mass/MultisineTypeA.mat")
    record = rid.TimeRecord(bench.u, bench.y.sum(axis=1), dt=bench.dt, initial="periodic", reference=bench.reference)
    return rid.estimate_frf(record, period=2500)


@pytest.mark.realdata
def test_measured_torsion_shows_one_mode():
    found = suggest_kautz(torsion())
    assert found.omega.size == 1
    assert 75.5 < found.omega[0] / (2 * np.pi) < 77.5
    assert 0.01 < found.damping[0] < 0.03
    assert found.level[0] > 1  # the bench isn't linear down to its noise
    assert "with bounds times" in found.summary()


@pytest.mark.realdata
def test_measured_mirror_shows_its_eight_modes():
    # the first block of three orthogonal experiments, averaged over its two periods; (8192, 3, 6, 2) arrays
    signals = [np.load(dataset(f"fsm_cubespec/{s}_300mV_train.npy")) for s in "uy"]
    U, Y = (np.fft.rfft(s[:, :, :3].mean(axis=3), axis=0)[800:3400:2] for s in signals)
    lines = np.arange(800, 3400, 2)
    full = np.all(np.linalg.svd(U, compute_uv=False)[:, -1:] > 1e-3 * np.abs(U).max(), axis=1)
    values = np.linalg.solve(U[full].transpose(0, 2, 1), Y[full].transpose(0, 2, 1)).transpose(0, 2, 1)[:, 0, 0]
    frf = rid.FrequencyResponse(2 * np.pi * 6400 / 8192 * lines[full], values, bound=0.06 * np.abs(values), dt=1 / 6400)
    found = suggest_kautz(frf).omega / (2 * np.pi)
    for hz in (635, 806, 921, 1315, 1674, 2124, 2310, 2544):
        assert np.abs(found / hz - 1).min() < 0.02, hz


# --- prior


def test_smallest_gain_of_two_taylor_coefficients():
    # |g1| rho <= K (1 - (g0/K)^2): with g0 free in +-0.1 around 0 the best is g0 = 0, K = rho (0.7 - 0.1).
    record = rid.TimeRecord([1.0, 0.0], [0.0, 0.7], dt=1.0, bound=0.1)
    rates = np.array([1.01, 1.2, 1.5, 3.0])
    found = suggest_prior(rid.MixedProblem(time=record, prior=ANY), decay_rates=rates)
    np.testing.assert_allclose(found.gains, 0.6 * rates, rtol=1.1e-3)
    assert np.all(found.gains >= 0.6 * rates * (1 - 1e-9))
    # K rho/(rho^2 - 1) = 0.6 rho^2/(rho^2 - 1) falls all the way
    assert found.prior.decay_rate == 3.0
    assert found.prior.gain_bound == pytest.approx(found.safety * found.gains[-1])


@pytest.mark.parametrize(("which", "rho"), [(slice(0, 0), 1.05), (slice(1, 2), 1.09), (slice(0, 1), 1.05)])
def test_smallest_gain_is_the_threshold_of_identify(which, rho):
    problem = structure_problem(which)
    gain = float(suggest_prior(problem, decay_rates=[rho]).gains[0])
    above, below = (rid.identify(problem.with_prior(gain_bound=f * gain, decay_rate=rho)) for f in (1.0001, 0.99))
    assert above.consistent
    assert below.margin_lower > 1  # with its certificate


def test_curve_rises_and_the_knee_is_inside():
    found = suggest_prior(structure_problem(slice(0, 0)))
    assert np.all(np.diff(found.gains) > 0)
    assert found.decay_rates[0] < found.prior.decay_rate < found.decay_rates[-1]
    assert "exceeds the largest response" in found.reason  # the light mode can't be a smooth rest
    assert found.summary().count("<- recommended") == 1


def test_placeholder_prior_is_not_used():
    problem = structure_problem(slice(0, 1))
    one = suggest_prior(problem, decay_rates=[1.05, 1.1])
    two = suggest_prior(problem.with_prior(gain_bound=1e-9, decay_rate=7.0), decay_rates=[1.1, 1.05])
    np.testing.assert_array_equal(one.gains, two.gains)
    assert one.prior == two.prior


@pytest.mark.parametrize("power", [60, -60])
def test_prior_does_not_depend_on_units(power):
    factor, data = 2.0**power, rid.flexible_structure()
    frequency = rid.FrequencyResponse(
        data.frequency.omega * factor,
        data.frequency.values * factor,
        bound=data.frequency.bound * factor,
        dt=0.01 / factor,
    )
    time = rid.TimeRecord(data.time.u, data.time.y * factor, bound=data.time.bound * factor, dt=0.01 / factor)
    one = suggest_prior(structure_problem(slice(0, 0)), decay_rates=[1.05, 1.1])
    two = suggest_prior(rid.MixedProblem(frequency=frequency, time=time, prior=ANY), decay_rates=[1.05, 1.1])
    np.testing.assert_allclose(two.gains, one.gains * factor, rtol=1e-9)
    assert two.prior.decay_rate == one.prior.decay_rate


def test_parametric_part_alone_gives_a_small_multiple_of_the_bounds():
    held = sum(
        np.all(found.gains == 0) and found.prior.gain_bound == pytest.approx(2 * 0.03)
        for found in (suggest_prior(structure_problem(slice(0, 2), seed=k), decay_rates=[1.1, 1.3]) for k in range(10))
    )
    assert held == 10  # of 10: the truth is in the span of the two pairs


def test_contradictory_samples_have_no_prior():
    frf = rid.FrequencyResponse([1.0, 1.0, 2.0], [1.0, 2.0, 1.0], bound=0.1, dt=0.1)
    found = suggest_prior(rid.MixedProblem(frequency=frf, prior=ANY))
    assert found.prior is None
    assert np.all(np.isinf(found.gains))
    assert "samples contradict each other" in found.summary()


@pytest.mark.parametrize(
    ("problem", "rates", "error", "sentence"),
    [
        (None, None, InputTypeError, "`problem` must be a MixedProblem; got NoneType"),
        (structure_problem(slice(0, 0)), [1.0, 1.1], InputError, "`decay_rates` must hold numbers above 1"),
        (structure_problem(slice(0, 0)), [], InputError, "`decay_rates` must hold numbers above 1"),
        (structure_problem(slice(0, 0)), [np.nan], InputError, "`decay_rates` must be finite"),
        (structure_problem(slice(0, 0)), 1.1, InputError, "`decay_rates` must have 1 dimension"),
        (structure_problem(slice(0, 0), samples=300), [1.0005], SizeError, "has 322 coefficients"),
    ],
)
def test_suggest_prior_refuses(problem, rates, error, sentence):
    with pytest.raises(error, match=sentence) as caught:
        suggest_prior(problem, decay_rates=rates)
    assert isinstance(caught.value, RobustIdError)


# --- diagnosis


def test_diagnosis_finds_the_missing_mode():
    problem = structure_problem(slice(1, 2)).with_prior(gain_bound=0.2, decay_rate=1.1)
    result = rid.identify(problem)
    found = diagnose(result)
    assert found.inflation == result.margin > 1
    assert found.active == tuple(result.conflicting_samples())
    best = found.best()
    assert "one more pair, at 9.0" in best.change
    assert best.margin < 1
    margins = {trial.change: trial.margin for trial in found.trials}
    assert margins["K times 10"] <= margins["K times 2"] <= found.inflation * 1.001
    assert margins["each pair repeated once more"] <= found.inflation * 1.001
    assert "consistent" in found.summary()
    for trial in found.trials:
        proved = rid.identify(trial.problem)
        assert proved.margin_lower - 1e-9 <= trial.margin <= proved.margin + 2e-3 * max(1, proved.margin)
    inflated = dataclasses.replace(
        problem,
        frequency=problem.frequency[0].with_bound(found.inflation * problem.frequency[0].bound),
        time=problem.time[0].with_bound(found.inflation * problem.time[0].bound),
    )
    assert rid.identify(inflated).margin == pytest.approx(1, abs=1e-3)


def test_diagnosis_sees_that_repetition_absorbs_a_wrong_pole():
    data = rid.flexible_structure(extra_hz=FINE)
    wrong = rid.kautz(data.modes[:, 0] * [1, 1.001], data.modes[:, 1], dt=0.01, delay=1)
    problem = rid.MixedProblem(
        frequency=data.frequency, prior=rid.Prior(gain_bound=0.2, decay_rate=1.1), parametric=wrong
    )
    found = diagnose(rid.identify(problem))
    repeated = next(t for t in found.trials if "repeated" in t.change)
    assert repeated.margin < 0.2 * found.inflation
    assert repeated.problem.parametric.size == 8
    again = diagnose(rid.identify(repeated.problem))
    assert again.trials[0].problem.parametric.size == 12


def test_diagnosis_of_consistent_time_data_without_pairs():
    record = rid.TimeRecord([1.0, 0.0], [0.5, 0.2], dt=1.0, bound=0.1)
    found = diagnose(rid.identify(rid.MixedProblem(time=record, prior=rid.Prior(gain_bound=1.0, decay_rate=1.1))))
    assert found.inflation <= 1
    assert found.summary().startswith("The data are consistent")
    assert [t.change for t in found.trials] == ["K times 2", "K times 10", "rho - 1 halved"]


def test_diagnosis_of_a_basis_with_real_poles_only():
    data = rid.flexible_structure()
    low_pass = control.ss(0.5, 1, 1, 0, 0.01)
    problem = rid.MixedProblem(
        frequency=data.frequency, prior=rid.Prior(gain_bound=0.2, decay_rate=1.1), parametric=low_pass
    )
    changes = [t.change for t in diagnose(rid.identify(problem)).trials]
    assert len(changes) == 4
    assert changes[0].startswith("one more pair")


def test_diagnose_refuses_other_things():
    with pytest.raises(InputTypeError, match="`identification` must be an Identification; got int"):
        diagnose(3)

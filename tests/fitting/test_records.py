"""Fits of records against brute force in the time domain, against fits of responses, on measured data; bad input."""

import dataclasses
import pickle

import control
import numpy as np
import pytest
import scipy.optimize

import robustid as rid
from robustid.errors import InputTypeError
from robustid.fitting import FitStatus, Weight, subspace_estimate
from support.cases import slow
from support.measured import realdata
from support.refusals import refusals

DT = 0.1
A = 0.98 * np.array([[0.9, 0.3, 0], [-0.3, 0.9, 0], [0, 0, 0.7]])
NOISE = np.array([0.3, 1.5])


def plant(ny=2, nu=2, seed=0, feedthrough=True):
    rng = np.random.default_rng(seed)
    B, C, D = rng.standard_normal((3, nu)), rng.standard_normal((ny, 3)), rng.standard_normal((ny, nu))
    return A, B, C, D * feedthrough


def simulated(system, u, state):
    a, b, c, d = system
    y = []
    for sample in u:
        y.append(c @ state + d @ sample)
        state = a @ state + b @ sample
    return np.array(y)


def experiment(initial, samples, seed=0, *, ny=2, nu=2, noise=1.0, feedthrough=True, system=None):
    rng = np.random.default_rng([seed, samples])
    system = plant(ny, nu, feedthrough=feedthrough) if system is None else system
    u, state = rng.standard_normal((samples, nu)), np.array([3.0, -2.0, 1.0])
    if initial == "rest":
        state = np.zeros(3)
    if initial == "periodic":
        ended = simulated((system[0], system[1], np.eye(3), np.zeros((3, nu))), np.vstack([u, u[:1]]), np.zeros(3))[-1]
        state = np.linalg.solve(np.eye(3) - np.linalg.matrix_power(system[0], samples), ended)
    y = simulated(system, u, state) + noise * NOISE[:ny] * rng.standard_normal((samples, ny))
    return rid.TimeRecord(u, y, dt=DT, initial=initial)


def brute_force(records, fit, *, feedthrough, offset=False):
    """The lowest cost that least squares over all matrices and initial states finds from the fit and from the truth."""
    n, (ny, nu) = 3, fit.D.shape
    shapes = [(n, n), (n, nu), (ny, n), (ny, nu)]
    free = [record.initial == "free" for record in records]

    def residuals(x):
        system, at = [], 0
        for shape in shapes:
            system.append(x[at : at + shape[0] * shape[1]].reshape(shape))
            at += shape[0] * shape[1]
        if not feedthrough:
            system[3] = np.zeros((ny, nu))
        out = []
        for record, own in zip(records, free, strict=True):
            state = x[at : at + n] if own else np.zeros(n)
            at += n * own
            level = x[at : at + ny] if offset else np.zeros(ny)
            at += ny * offset
            out.append((record.y - simulated(system, record.u, state) - level) * fit.weight)
        return np.concatenate(out).ravel()

    def unknowns(system, states):
        own = [
            [*(state if was_free else []), *np.zeros(ny * offset)] for state, was_free in zip(states, free, strict=True)
        ]
        return np.concatenate([np.ravel(M) for M in system] + own)

    truth = unknowns(plant(ny, nu), [np.array([3.0, -2, 1])] * len(records))
    options = {"xtol": 1e-14, "ftol": 1e-14, "x_scale": "jac"}
    starts = (unknowns(fit.matrices, fit.initial_states), truth)
    return min(2 * scipy.optimize.least_squares(residuals, start, **options).cost for start in starts)


@pytest.mark.parametrize(
    ("initial", "samples", "feedthrough"),
    [
        (["free", "rest"], [20, 25], False),
        *(
            slow(*case, feedthrough)
            for case in [(["free"], [71]), (["free"], [60]), (["rest"], [80]), (["free", "rest", "free"], [25, 41, 30])]
            for feedthrough in (False, True)
        ),
    ],
)
def test_the_optimum_of_the_output_error(initial, samples, feedthrough):
    """The criterion is the sum over all samples, to rounding, and brute force in the time domain finds nothing lower."""
    records = [experiment(*pair, feedthrough=feedthrough) for pair in zip(initial, samples, strict=True)]
    fit = rid.fit_records(records, order=3, feedthrough=feedthrough)
    assert fit.status.converged
    assert fit.stable
    squares = sum(np.sum(((r.y - y) * fit.weight) ** 2) for r, y in zip(records, fit.simulated, strict=True))
    assert squares == pytest.approx(fit.cost, rel=1e-9)
    assert fit.cost <= brute_force(records, fit, feedthrough=feedthrough) * (1 + 1e-5)
    np.testing.assert_allclose(1 / fit.weight, NOISE, rtol=0.25)
    assert all(np.all(state == 0) for r, state in zip(records, fit.initial_states, strict=True) if r.initial == "rest")


def test_an_offset_is_fitted_exactly():
    record = experiment("free", 40)
    record = rid.TimeRecord(record.u, record.y + np.array([5.0, -70.0]), dt=DT, initial="free")
    fit = rid.fit_records(record, order=3, feedthrough=True, offset=True)
    squares = np.sum(((record.y - fit.simulated[0]) * fit.weight) ** 2)
    assert squares == pytest.approx(fit.cost, rel=1e-9)
    assert fit.cost <= brute_force([record], fit, feedthrough=True, offset=True) * (1 + 1e-5)
    np.testing.assert_allclose(fit.offsets[0], [5, -70], atol=1.0)


@pytest.mark.parametrize("initial", ["free", "rest", "periodic"])
def test_exact_data_give_the_plant_and_the_initial_state(initial):
    record = experiment(initial, 70, noise=0.0)
    fit = rid.fit_records(record, order=3, feedthrough=True)
    assert fit.status is FitStatus.EXACT
    np.testing.assert_allclose(np.sort_complex(fit.poles), np.sort_complex(np.linalg.eigvals(A)), atol=1e-8)
    assert fit.fit_percent.min() > 100 - 1e-5
    np.testing.assert_allclose(rid.validate(fit, record).fit, 1.0, atol=1e-7)


def test_periodic_records_are_the_frequency_response_weighted_by_the_input():
    """One input, one period: the criterion is that of Y/U with the weight |U|, and so are cost and poles."""
    record = experiment("periodic", 128, ny=1, nu=1, noise=0.1, feedthrough=False)
    fit = rid.fit_records(record, order=3, offset=True)
    U, Y = (np.fft.rfft(x[:, 0], norm="ortho") for x in (record.u, record.y))
    lines = np.arange(1, 65)  # to Nyquist, which is real and counts once
    factor = np.where(lines == 64, 1, np.sqrt(2)) * fit.weight[0]
    frf = rid.FrequencyResponse(2 * np.pi * lines / (128 * DT), Y[lines] / U[lines], dt=DT)
    weight = Weight((factor * np.abs(U[lines]))[:, None, None])
    other = rid.fit_mfd(frf, order=3, weight=weight)
    assert other.cost == pytest.approx(fit.cost, rel=1e-6)
    np.testing.assert_allclose(np.sort_complex(other.poles), np.sort_complex(fit.poles), atol=1e-4)


def response_of(system, omega, deviation, seed=0):
    a, b, c, d = system
    z = np.exp(1j * omega * DT)
    truth = np.array([c @ np.linalg.solve(point * np.eye(3) - a, b) + d for point in z])
    rng = np.random.default_rng(seed)
    error = deviation * (rng.standard_normal(truth.shape) + 1j * rng.standard_normal(truth.shape)) / np.sqrt(2)
    count = truth[0].size
    covariance = np.broadcast_to(deviation**2 * np.eye(count), (omega.size, count, count))
    return rid.FrequencyResponse(omega, truth + error, covariance=covariance, dt=DT)


@pytest.mark.parametrize("seeds", [2, slow(8)])
def test_records_and_a_response_each_by_its_noise(seeds):
    """Poles from both are nearer to the truth than from either, in the mean over seeds, and the cost counts equations."""
    system, errors = plant(), []
    omega = np.linspace(1.0, 30.0, 60)
    truth = np.sort_complex(np.linalg.eigvals(A))
    for seed in range(seeds):
        record, frf = experiment("free", 90, seed, noise=0.5), response_of(system, omega, 0.35, seed)
        both, alone = (rid.fit_records(record, order=3, feedthrough=True, frf=given) for given in (frf, None))
        fits = both, alone, rid.fit_mfd(frf, order=3, feedthrough=True)
        errors.append([np.linalg.norm(np.sort_complex(fit.poles) - truth) for fit in fits])
        assert both.record_cost == pytest.approx(2 * 90, rel=0.05)
        assert both.cost - both.record_cost == pytest.approx(2 * 4 * 60, rel=0.25)
    both, alone, response = np.sqrt(np.mean(np.square(errors), axis=0))
    assert both < min(alone, response)


def test_units_change_nothing():
    record = experiment("free", 40)
    fit = rid.fit_records(record, order=3, feedthrough=True)
    scaled = rid.TimeRecord(record.u * 2.0**40, record.y * 2.0**-30, dt=DT * 8, initial="free")
    other = rid.fit_records(scaled, order=3, feedthrough=True)
    assert other.cost == fit.cost
    np.testing.assert_array_equal(other.poles, fit.poles)
    np.testing.assert_array_equal(other.simulated[0], fit.simulated[0] * 2.0**-30)


def test_a_delay_is_taken_out():
    late = experiment("free", 90, ny=1, nu=1, noise=0.01, feedthrough=False)
    record = rid.TimeRecord(np.roll(late.u, -2, axis=0)[:-2], late.y[:-2], dt=DT, initial="free")
    fit = rid.fit_records(record, order=3, delay=2 * DT)
    assert fit.delay == 2 * DT
    np.testing.assert_allclose(np.sort_complex(fit.poles), np.sort_complex(np.linalg.eigvals(A)), atol=0.01)


def test_what_a_fit_is_and_that_it_comes_back(tmp_path):
    steps = []
    records = [experiment("free", 40), experiment("rest", 30)]
    fit = rid.fit_records(records, order=3, feedthrough=True, progress=lambda *step: steps.append(step))
    assert isinstance(fit.to_control(), control.StateSpace)
    assert fit.to_control().dt == DT
    assert (fit.order, len(fit.history) >= len(steps)) == (3, True)
    assert len(repr(fit)) < 200
    fit.save(tmp_path / "fit")
    again = rid.load(tmp_path / "fit")
    for other in (again, pickle.loads(pickle.dumps(fit))):
        assert repr(other) == repr(fit)
        assert other.cost == fit.cost
        np.testing.assert_array_equal(other.simulated[1], fit.simulated[1])


def test_a_start_and_a_time_limit():
    record = experiment("free", 60)
    fit = rid.fit_records(record, order=3, feedthrough=True)
    again = rid.fit_records(record, order=3, feedthrough=True, start=fit.model)
    assert again.cost == pytest.approx(fit.cost, rel=1e-3)
    short = rid.fit_records(record, order=3, feedthrough=True, time_limit=1e-9)
    assert short.status is FitStatus.TIME
    assert short.stable
    weighted = rid.fit_records(record, order=3, feedthrough=True, weight=[1.0, 2.0])
    np.testing.assert_array_equal(weighted.weight, [1, 2])


GOOD = experiment("free", 60)


def other(**changes):
    return dataclasses.replace(GOOD, **changes)


test_bad_input = refusals(
    ({"records": [GOOD, other(dt=0.2)]}, "one sample time"),
    ({"records": [GOOD, other(u=GOOD.u[:, :1], inputs=None)]}, "the same inputs"),
    ({"records": [GOOD, other(outputs=["a", "b"])]}, "the same outputs"),
    ({"records": other(u=GOOD.u[:3], y=GOOD.y[:3])}, "3 samples at position 0"),
    ({"records": other(u=GOOD.u[:6], y=GOOD.y[:6], initial="rest")}, "unknowns"),
    ({"records": other(bound=np.where(np.arange(60) < 9, np.inf, 1.0))}, "not used"),
    ({"records": other(u=GOOD.u * [1, 0])}, "`u` = 0 throughout in signal u2"),
    ({"frf": rid.FrequencyResponse([1.0], np.ones((1, 2, 2)))}, "`frf` must have the sample time"),
    ({"frf": rid.FrequencyResponse([1.0, 2.0], [1, 1], dt=DT)}, "2 inputs"),
    ({"weight": [1.0]}, "each of the 2 outputs"),
    ({"start": control.ss(0.5, 1, 1, 0, DT)}, "`start` must be a discrete model"),
    ({"time_limit": 0}, "`time_limit`"),
    ({"records": []}, "`records` must be a TimeRecord", InputTypeError),
    ({"records": [GOOD, GOOD.y]}, "ndarray at position 1", InputTypeError),
    of=lambda **changes: rid.fit_records(**{"records": GOOD, "order": 3, **changes}),
)


def measured(name, dt):
    """Halves of a measured record, means of the first taken off."""
    record = rid.datasets.load(name)
    half = len(record.u) // 2
    u, y = record.u - record.u[:half].mean(axis=0), record.y - record.y[:half].mean(axis=0)
    return [rid.TimeRecord(u[k:][:half], y[k:][:half], dt=dt, initial="free") for k in (0, half)]


def difference_equation(record, order):
    """Least squares on one-step predictions, of `order` states in all."""
    ny, nu = record.y.shape[1], record.u.shape[1]
    length = order // ny
    columns = [-record.y[length - i : len(record.u) - i] for i in range(1, length + 1)]
    columns += [record.u[length - i : len(record.u) - i] for i in range(1, length + 1)]
    theta = np.linalg.lstsq(np.hstack(columns), record.y[length:], rcond=None)[0]
    a, b = np.eye(order, k=ny), theta[order:].reshape(length, nu, ny).transpose(0, 2, 1).reshape(order, nu)
    a[:, :ny] = -theta[:order].reshape(length, ny, ny).transpose(0, 2, 1).reshape(order, ny)
    return control.ss(a, b, np.eye(ny, order), np.zeros((ny, nu)), record.dt)


class TestMeasured:
    pytestmark = realdata

    @pytest.mark.parametrize(("name", "dt", "order"), [("hairdryer", 0.08, 5), slow("cdplayer", 1.0, 8)])
    def test_the_second_half_from_the_first(self, name, dt, order):
        """Simulated from the initial state that fits best, at least as well as all others of the same order."""
        first, second = measured(name, dt)
        fit = rid.fit_records(first, order=order)
        frf = rid.estimate_frf(first)
        found = subspace_estimate(frf.values, np.exp(1j * frf.omega * dt), order, domain="z")
        subspace = control.ss(found.A, found.B, found.C, found.D, dt)
        own = rid.validate(fit, second).fit
        for other in (difference_equation(first, order), subspace, rid.fit_mfd(frf, order=order)):
            assert np.all(own >= rid.validate(other, second).fit)
        if name == "hairdryer":
            assert own[0] > 0.868


def test_a_fit_says_nothing_of_what_the_user_knows_of_the_records(caplog):
    u = np.tile(np.random.default_rng(0).standard_normal(50), 4)
    record = rid.TimeRecord(u, 0.5 * u, dt=DT)
    assert "repeats every 50 samples" in str(rid.prepare.record_faults(record)[0])
    rid.fit_records(record, order=1, feedthrough=True)
    assert caplog.text == ""

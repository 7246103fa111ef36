"""Delays: found in responses whose delay is known, taken out of data exactly, and put back into models."""

import control
import numpy as np
import pytest
import scipy.linalg

import robustid as rid
from robustid.core import simulate
from robustid.errors import InputTypeError
from robustid.estimation import delay_fault, estimate_delay
from support.cases import slow
from support.mfd_systems import noisy
from support.mimo_data import real_poles
from support.refusals import refusals

DT = 1e-3
OMEGA = 2 * np.pi * np.linspace(2, 350, 250)


def modes(rng, count):
    """Frequencies, dampings of 0.3 to 2 % and residues of either sign: resonances, antiresonances and zeros outside."""
    w = 2 * np.pi * np.exp(rng.uniform(np.log(10), np.log(300), count))
    return w, rng.uniform(0.003, 0.02, count), rng.choice([-1, 1], count) * rng.uniform(0.3, 1, count)


def continuous(plant, tau):
    s = 1j * OMEGA
    return np.exp(-s * tau) * sum(g * w**2 / (s**2 + 2 * z * w * s + w**2) for w, z, g in zip(*plant, strict=True))


def held(plant, tau):
    """The sampled plant behind a zero-order hold, from matrix exponentials over the two parts of a sample."""
    A = scipy.linalg.block_diag(*[[[0, w], [-w, -2 * z * w]] for w, z, _ in zip(*plant, strict=True)])
    n = len(A)
    B, C = np.zeros((n, 1)), np.zeros((1, n))
    B[1::2, 0], C[0, ::2] = plant[0], plant[2]
    whole = int(tau // DT)

    def over(time):
        both = scipy.linalg.expm(np.block([[A, B], [np.zeros((1, n + 1))]]) * time)
        return both[:n, :n], both[:n, n:]

    rest = tau - whole * DT
    (a, _), (early, now), (_, late) = over(DT), over(DT - rest), over(rest)
    z = np.exp(1j * OMEGA * DT)
    return np.array([(C @ np.linalg.solve(q * np.eye(n) - a, now + early @ late / q))[0, 0] * q**-whole for q in z])


# --- the estimate


@pytest.mark.parametrize("seeds", [1, slow(3)])
@pytest.mark.parametrize(("respond", "dt"), [slow(continuous, None), (held, DT)])
def test_delays_without_noise_are_found_exactly(respond, dt, seeds):
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        plant, tau = modes(rng, 2), rng.uniform(0, 10) * DT
        found = estimate_delay(rid.FrequencyResponse(OMEGA, respond(plant, tau), dt=dt), order=4)
        assert abs(found.seconds - tau) < 1e-5 * DT
        assert found.misfit < 1e-5


@pytest.mark.parametrize(("seeds", "most"), [(1, 3.3), slow(2, 2.6), slow(8, 1.9)])
@pytest.mark.parametrize(("respond", "dt"), [slow(continuous, None), (held, DT)])
def test_delays_of_random_plants_are_found_within_a_tenth_of_a_sample(respond, dt, seeds, most):
    """Order unknown for the first of the continuous plants (slow: of the others, too), known for the others."""
    errors, scaled = [], []
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        count = int(rng.integers(1, 4))
        plant, tau = modes(rng, count), rng.uniform(0, 10) * DT
        frf = rid.FrequencyResponse(OMEGA, noisy(rng, respond(plant, tau)), dt=dt)
        found = estimate_delay(frf, order=None if seed == 0 and (dt is None or seeds > 2) else 2 * count)
        assert 0.008 < found.misfit < 0.012
        errors.append(abs(found.seconds - tau) / DT)
        scaled.append((found.seconds - tau) / found.deviation)
    assert max(errors) < 0.1
    assert np.sqrt(np.mean(np.square(scaled))) < most  # chi with as many degrees of freedom: 99.9 %


@pytest.mark.parametrize(("seeds", "least", "most"), [(4, 0.126, 2.24), slow(40, 0.65, 1.37)])
def test_the_stated_deviation_is_that_of_many_seeds(seeds, least, most):
    """Speeds: one pole more than zeros, where the cost is a parabola in the delay."""
    plant, tau = modes(np.random.default_rng(1), 2), 3.3 * DT
    clean = 1j * OMEGA / 1000 * continuous(plant, tau)
    deviation = 0.02 * np.sqrt(np.mean(np.abs(clean) ** 2))
    ratios = []
    for seed in range(seeds):
        e = np.random.default_rng(seed).standard_normal((2, clean.size)) * deviation / np.sqrt(2)
        covariance = np.full((clean.size, 1, 1), deviation**2)
        frf = rid.FrequencyResponse(OMEGA, clean + e[0] + 1j * e[1], covariance=covariance)
        found = estimate_delay(frf, order=4, longest=6 * DT)
        ratios.append((found.seconds - tau) / found.deviation)
    assert least < np.sqrt(np.mean(np.square(ratios))) < most  # chi with as many degrees of freedom: 99.9 %


def test_several_entries_share_their_poles_and_feed_through_is_allowed():
    rng = np.random.default_rng(4)
    s, tau = 1j * OMEGA, 2.4 * DT
    poles = [2 * np.pi * f * (1j - 0.01) for f in (40.0, 130.0)]
    values = np.zeros((OMEGA.size, 2, 2), complex)
    for p in poles:
        gain = np.abs(p) * rng.standard_normal((2, 2))
        values += gain * (1 / (s - p) + 1 / (s - np.conj(p)))[:, None, None]
    frf = rid.FrequencyResponse(OMEGA, noisy(rng, (values + 1.0) * np.exp(-s * tau)[:, None, None]))
    frf = frf.select(slice(None, None, 3))
    assert abs(estimate_delay(frf, order=4, longest=5 * DT, feedthrough=True).seconds - tau) < 0.02 * DT


def test_units_scale_exactly():
    rng = np.random.default_rng(2)
    values, omega = noisy(rng, continuous(modes(rng, 2), 2 * DT))[::3], OMEGA[::3]
    plain = estimate_delay(rid.FrequencyResponse(omega, values), order=4, longest=4 * DT)
    fast = rid.FrequencyResponse(omega * 2.0**60, values * 2.0**-60)
    scaled = estimate_delay(fast, order=4, longest=4 * DT * 2.0**-60)
    assert scaled.seconds == pytest.approx(plain.seconds * 2.0**-60, rel=1e-9)
    assert scaled.misfit == pytest.approx(plain.misfit, rel=1e-9)


@pytest.mark.realdata
@pytest.mark.parametrize("side", ["m", slow("a")])
def test_measured_speeds_are_low_passed_angles_without_a_delay(side):
    """speed/(j omega angle) of the motor bench is 1/(1 + s tau): it looks like a delay of 20 samples at low frequencies."""
    angle, speed = {"m": ("theta_mx", "omega_max"), "a": ("theta_my", "omega_may")}[side]
    path = rid.datasets.find("two_mass/MultisineTypeA.mat")
    record = rid.load(path, fields={"u": angle, "y": speed}, dt=1 / 2500, initial="periodic")
    lines = np.arange(11, 151)
    frf = rid.estimate_frf(record, period=2500, lines=lines)
    s = 1j * frf.omega
    covariance = frf.covariance / np.abs(s[:, None, None]) ** 2
    ratio = rid.FrequencyResponse(frf.omega, frf.values / s[:, None, None], covariance=covariance)
    found = estimate_delay(ratio, order=1)
    assert abs(found.seconds) < 0.1 / 2500
    low_pass = 1 / (1 + s / (2 * np.pi * 20.38))
    np.testing.assert_allclose(ratio.values[:30, 0, 0], low_pass[:30], rtol=0.01)  # below the antiresonance


TWO = rid.FrequencyResponse([1.0, 2.0], [1.0, 1.0])


test_estimate_delay_refuses = refusals(
    (lambda: estimate_delay(np.ones(3)), "`frf` must be a FrequencyResponse; got ndarray", InputTypeError),
    (lambda: estimate_delay(rid.TimeRecord([1.0], [1.0], dt=1.0)), "call estimate_frf first", InputTypeError),
    (lambda: estimate_delay(TWO.select([0])), "1 frequency point; a delay needs several frequencies"),
    (lambda: estimate_delay(TWO, order=3), "too few for a delay and 3 poles"),
    (lambda: estimate_delay(rid.FrequencyResponse([1.0, 2.0], [0, 0])), "`frf` is zero at every frequency point"),
    (lambda: estimate_delay(TWO, longest=7.0), "can't tell delays from those"),
    (lambda: estimate_delay(TWO, longest=-1.0), "`longest` must be positive"),
    (lambda: estimate_delay(TWO, order=0), "`order` must be at least 1"),
)


# --- taken out of data


def test_a_response_without_its_delay_keeps_errors_inside_their_ellipses():
    rng = np.random.default_rng(0)
    omega, tau = np.array([10.0, 20.0, 31.0]), 0.07
    clean = rng.standard_normal(3) + 1j * rng.standard_normal(3)
    root = rng.standard_normal((3, 2, 2))
    covariance = root @ root.swapaxes(1, 2) + 0.1 * np.eye(2)
    frf = rid.FrequencyResponse(omega, clean * np.exp(-1j * omega * tau)).with_ellipses(covariance, deviations=2)
    back = frf.without_delay(tau)
    np.testing.assert_allclose(back.values[:, 0, 0], clean, rtol=1e-12)
    error = rng.standard_normal((3, 1, 1)) + 1j * rng.standard_normal((3, 1, 1))
    turned = error * np.exp(1j * omega * tau)[:, None, None]
    before, after = (np.abs(e + f.bound.tilt * e.conj()) / f.bound for e, f in ((error, frf), (turned, back)))
    np.testing.assert_allclose(after, before, rtol=1e-12)
    np.testing.assert_allclose(back.without_delay(-tau).values, frf.values, rtol=1e-12)


PLANT = control.ss(0.5, 1.0, 1.0, 0.0, DT)


@pytest.mark.parametrize("initial", ["rest", "free"])
def test_a_record_without_whole_samples_of_delay_is_that_of_the_plant_alone(initial):
    rng = np.random.default_rng(1)
    u = rng.standard_normal(50)
    alone = simulate(PLANT, u[:, None])[0][:, 0]
    bound = rng.uniform(1, 2, 50)
    y = np.concatenate([np.zeros(3), alone[:-3]])
    late = rid.TimeRecord(u, y, dt=DT, bound=bound, initial=initial, reference=2 * u)
    record = late.without_delay(3 * DT)
    np.testing.assert_array_equal(record.u[:, 0], u[:47])
    np.testing.assert_array_equal(record.y[:, 0], alone[:47])
    np.testing.assert_array_equal(record.reference, 2 * record.u)
    np.testing.assert_array_equal(record.bound[:, 0], bound[3:])
    assert record.past_input_bound == (np.abs(u).max() if initial == "free" else None)


@pytest.mark.parametrize(("samples", "length"), [(2, 40), (2.37, 41), (-0.6, 40)])
def test_a_periodic_record_loses_any_delay_exactly(samples, length):
    rng = np.random.default_rng(2)
    spectrum = np.fft.rfft(rng.standard_normal(length))
    if length % 2 == 0 and samples != 2:
        spectrum[-1] = 0
    omega = 2 * np.pi * np.arange(spectrum.size) / (length * DT)
    plant = np.array([PLANT(np.exp(1j * w * DT)) for w in omega])
    u = np.fft.irfft(spectrum, length)
    y = np.fft.irfft(spectrum * plant * np.exp(-1j * omega * samples * DT), length)
    late = rid.TimeRecord(u, y, dt=DT, initial="periodic", bound=0.1, reference=u)
    record = late.without_delay(samples * DT)
    np.testing.assert_array_equal(record.y, late.y)
    np.testing.assert_array_equal(record.reference, record.u)
    np.testing.assert_allclose(np.fft.irfft(np.fft.rfft(record.u[:, 0]) * plant, length), y, atol=1e-12)


def without_delay(seconds, initial):
    return rid.TimeRecord((-1.0) ** np.arange(10), np.ones(10), dt=DT, initial=initial).without_delay(seconds)


test_a_record_without_delay_refuses = refusals(
    ((0.5 * DT, "rest"), "is 0.5 samples of 0.001 s: a record that isn't periodic can be moved by whole samples only"),
    ((10 * DT, "rest"), "must be from 0 to less than the record's 0.01 s"),
    ((-DT, "free"), "must be from 0 to less"),
    ((0.5 * DT, "periodic"), "the input has power at pi/dt"),
    ((np.nan, "rest"), "`seconds` must be finite"),
    of=without_delay,
)


# --- put back into models


@pytest.mark.parametrize("samples", [0, 1, 5])
def test_whole_samples_are_exact(samples):
    model = real_poles(3, 2, 2, (0.9, 0.5, -0.3), DT)
    delayed = rid.prepare.with_delay(model, samples * DT)
    assert (delayed.all_pass, delayed.model.nstates) == (0, 3 + 2 * samples)
    assert np.all(delayed.error(OMEGA) == 0)
    for w in OMEGA[::50]:
        z = np.exp(1j * w * DT)
        np.testing.assert_allclose(delayed.model(z), model(z) * z**-samples, rtol=1e-12)


@pytest.mark.parametrize("samples", [0.3, 0.8, 2.5, 3.3, 7.9, 12.6])
def test_a_fraction_costs_the_error_that_is_stated(samples):
    model = real_poles(3, 2, 2, (0.9, 0.5, -0.3), DT)
    delayed = rid.prepare.with_delay(model, samples * DT)
    assert np.all(np.abs(delayed.model.poles()) < 1)
    assert delayed.all_pass == min(max(round(samples), 1), 8)
    stated = delayed.error(OMEGA)
    for k in range(0, OMEGA.size, 40):
        z = np.exp(1j * OMEGA[k] * DT)
        there = model(z) * np.exp(-1j * OMEGA[k] * samples * DT)
        np.testing.assert_allclose(np.abs(delayed.model(z) - there), stated[k] * np.abs(there), atol=1e-9)
    low = OMEGA[:20]
    assert delayed.error(low).max() < (2e-3 if samples < 1 else 1e-4)
    # All-pass: the size is right at every frequency, and the order of the error is that of a maximally flat filter.
    slope = np.log2(delayed.error(np.array([400.0])) / delayed.error(np.array([200.0])))
    assert delayed.all_pass > 3 or abs(slope[0] - (2 * delayed.all_pass + 1)) < 0.3


def test_a_found_delay_is_taken_out_and_put_back():
    plant, tau = modes(np.random.default_rng(5), 2), 4 * DT
    frf = rid.FrequencyResponse(OMEGA, held(plant, tau), dt=DT)
    found = estimate_delay(frf, order=4)
    fit = rid.fit_mfd(frf.without_delay(found.seconds), order=4)
    model = rid.prepare.with_delay(fit.model, round(found.seconds / DT) * DT).model
    values = np.array([model(np.exp(1j * w * DT)) for w in OMEGA])
    np.testing.assert_allclose(values, frf.values[:, 0, 0], atol=1e-4 * np.abs(frf.values).max())


test_with_delay_refuses = refusals(
    (("plant", DT), "`model` must be a control.StateSpace; got str", InputTypeError),
    ((control.ss(-1.0, 1.0, 1.0, 0.0), DT), "of a continuous one take control.pade"),
    ((control.ss(0.5, 1.0, 1.0, 0.0, True), DT), "discrete with its sample time"),
    ((PLANT, -DT), "must be from 0 to 1000 samples"),
    ((PLANT, 2.0), "must be from 0 to 1000 samples"),
    of=rid.prepare.with_delay,
)


def short_record(seed, samples, lead):
    """A mode of damping .1, moved by noise, from an unknown state; its output so many samples early, with 2 % of noise."""
    rng = np.random.default_rng([seed, samples])
    w, dt = 2 * np.pi * rng.uniform(0.4, 1.5), 0.1
    plant = control.c2d(control.ss([[0, 1], [-w * w, -0.2 * w]], [[0], [1]], [[w * w, 0]], [[0]]), dt)
    u = rng.standard_normal(samples + lead)
    y = control.forced_response(plant, U=u).outputs
    y = y + 0.02 * y.std() * rng.standard_normal(y.size)
    return rid.TimeRecord(u[:samples], y[lead:], dt=dt, initial="free")


@pytest.mark.parametrize("samples", [100, 250])
def test_errors_that_are_alike_at_neighbouring_points_are_no_lead(samples):
    """A response of so few samples comes from wide windows: its errors too have an answer before the input; 83 of 108 were told."""
    assert delay_fault(rid.estimate_frf(short_record(0, samples, 0)), False, True) is None
    assert delay_fault(rid.estimate_frf(short_record(0, samples, 3)), False, True).kind == "late"

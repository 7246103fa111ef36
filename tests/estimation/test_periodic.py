"""estimate_frf against known plants, and the probability of its bound against simulation."""

import functools

import numpy as np
import pytest

from robustid.core import simulate
from robustid.data import TimeRecord
from robustid.errors import InputTypeError
from robustid.estimation import estimate_frf, response_alone
from support.cases import slow
from support.fault_plants import recipes
from support.fault_plants import records as excited_records
from support.mfd_systems import by_control as truth
from support.mimo_data import real_poles
from support.refusals import refusals

PERIOD, DT = 64, 0.01
LINES = np.array([2, 3, 7, 12, 20])


def multisine(rng, lines=LINES, period=PERIOD):
    phase = rng.uniform(0, 2 * np.pi, len(lines))
    return np.cos(2 * np.pi * np.outer(np.arange(period), lines) / period + phase).sum(axis=1)


# Poles of modulus up to 0.5: after 3 periods of 64 samples nothing of a transient is left (0.5^192).
plant = functools.partial(real_poles, 5)


def steady_record(model, u, periods, **options):
    """Simulated from rest; the first three periods dropped."""
    u = np.tile(u, (periods + 3, 1))
    start = 3 * PERIOD
    return TimeRecord(u[start:], simulate(model, u)[0][start:], dt=DT, initial="periodic", **options)


def noisy(record, rng, *, output=0.0, input=0.0):
    u = record.u + input * rng.standard_normal(record.u.shape)
    return TimeRecord(u, record.y + output * rng.standard_normal(record.y.shape), dt=record.dt, initial="periodic")


def test_noise_free_single_channel_is_exact():
    model = plant(1, 1)
    record = steady_record(model, multisine(np.random.default_rng(0))[:, None], 4, inputs=["force [N]"])
    frf = estimate_frf(record, period=PERIOD)
    np.testing.assert_allclose(frf.freq_hz, LINES / (PERIOD * DT), rtol=1e-15)
    np.testing.assert_allclose(frf.values, truth(model, frf.omega), rtol=1e-12)
    assert np.all(np.abs(frf.values - truth(model, frf.omega)) <= frf.bound)
    assert np.all(frf.bound < 1e-12)
    assert (frf.dt, str(frf.inputs[0])) == (DT, "force [N]")
    assert frf.bound.words(frf.note) == (
        "confidence bound of the mean response, 95 % jointly, from one excitation: 5 frequency points, scatter over 4 periods,"
        " pooled over up to 5 neighbouring spectral lines; no distortion above the noise on 26 unexcited spectral lines, 14 of"
        " them in the band"
    )


def test_noise_free_two_outputs_three_inputs():
    model, rng = plant(2, 3), np.random.default_rng(1)
    records = [steady_record(model, np.column_stack([multisine(rng) for _ in range(3)]), 2) for _ in range(3)]
    frf = estimate_frf(records, period=PERIOD)
    assert frf.values.shape == (5, 2, 3)
    np.testing.assert_allclose(frf.values, truth(model, frf.omega), atol=1e-12)
    assert np.all(frf.bound < 1e-11)
    # one input at a time is an experiment too
    records = [steady_record(model, multisine(rng)[:, None] * np.eye(3)[k], 2) for k in range(3)]
    np.testing.assert_allclose(estimate_frf(records, period=PERIOD).values, frf.values, atol=1e-12)


def test_further_realisations_are_averaged_and_need_no_second_period():
    model, rng = plant(2, 2), np.random.default_rng(2)
    records = [steady_record(model, np.column_stack([multisine(rng), multisine(rng)]), 1) for _ in range(8)]
    frf = estimate_frf(records)
    np.testing.assert_allclose(frf.values, truth(model, frf.omega), atol=1e-12)
    assert frf.bound.words(frf.note).endswith(
        "from 4 independent excitations: 5 frequency points, scatter over 4 blocks of experiments (1 period each), pooled"
        " over up to 5 neighbouring spectral lines"
    )


def test_plain_formula_at_one_line():
    """The mean, variance and radius of one channel, written out as in a textbook."""
    rng = np.random.default_rng(3)
    record = noisy(steady_record(plant(1, 1), multisine(rng)[:, None], 6), rng, output=0.1, input=0.1)
    frf = estimate_frf(record, period=PERIOD, lines=[7], probability=0.9)
    k = np.exp(-2j * np.pi * 7 * np.arange(PERIOD) / PERIOD)
    u, y = (signal.reshape(6, PERIOD) @ k for signal in (record.u, record.y))
    value = y.mean() / u.mean()
    variance = np.sum(np.abs((y - value * u) / u.mean()) ** 2) / (6 * 5)
    assert frf.values[0, 0, 0] == pytest.approx(value, rel=1e-12)
    assert frf.covariance[0, 0, 0].real == pytest.approx(variance, rel=1e-12)
    assert frf.bound[0, 0, 0] == pytest.approx(np.sqrt(variance * 5 * (0.1 ** (-1 / 5) - 1)), rel=1e-12)


def measure(model, rng, *, periods, output, input=0.0, distortion=0.0, offset=0.0):
    """One experiment in steady state, by the DFT (quick; the tests above simulate)."""
    u = np.column_stack([multisine(rng) for _ in range(model.ninputs)])
    u += offset * (1 + np.cos(np.pi * np.arange(PERIOD)))[:, None]
    spectrum = np.fft.rfft(u, axis=0)
    response = np.einsum("fij,fj->fi", truth(model, 2 * np.pi * np.arange(PERIOD // 2 + 1) / (PERIOD * DT)), spectrum)
    # What a nonlinear plant adds depends on the realisation and not on the period.
    extra = rng.standard_normal(response.shape) + 1j * rng.standard_normal(response.shape)
    y = np.fft.irfft(response + distortion * np.abs(spectrum[:, :1]) * extra, PERIOD, axis=0)
    clean = TimeRecord(np.tile(u, (periods, 1)), np.tile(y, (periods, 1)), dt=DT)
    return noisy(clean, rng, output=output, input=input)


SCENARIOS = {
    "one line at 50 %": (1, 1, 1, {"periods": 5, "output": 0.3}, {"lines": [7], "probability": 0.5}),
    "output noise": (1, 1, 1, {"periods": 6, "output": 0.3}, {}),
    "output and input noise": (1, 1, 1, {"periods": 6, "output": 0.1, "input": 0.1}, {}),
    "two periods": (1, 1, 1, {"periods": 2, "output": 0.01}, {}),
    "2 x 3": (2, 3, 3, {"periods": 5, "output": 0.1}, {}),
    "real lines": (1, 1, 1, {"periods": 5, "output": 0.3, "offset": 1.0}, {"lines": [0, PERIOD // 2]}),
    "four distorted realisations": (1, 1, 4, {"periods": 3, "output": 0.05, "distortion": 0.3}, {}),
}


@pytest.mark.parametrize("seeds", [30, slow(300)])
@pytest.mark.parametrize(
    "name", [slow(k) if k in ("output noise", "output and input noise", "real lines") else k for k in SCENARIOS]
)
def test_probability_of_the_bound(name, seeds):
    """All errors lie within the bound as often as stated, and not much more often.

    30 simulated measurements each (slow: 300). Allowed: from the stated probability less 3.3 binomial sigma (missed with
    a probability of 5e-4 where the coverage is exactly as stated) to 3.3 sigma above that of independent
    entries, which Bonferroni's inequality makes a little larger than stated. Held of 300, in the order of
    SCENARIOS: 141, 286, 283, 293, 284, 287, 288.
    """
    ny, nu, experiments, noise, options = SCENARIOS[name]
    model, probability = plant(ny, nu), options.get("probability", 0.95)
    held = 0
    for seed in range(seeds):
        rng = np.random.default_rng([seed, 99])
        records = [measure(model, rng, **noise) for _ in range(experiments)]
        frf = response_alone(records, period=PERIOD, **options)
        held += bool(np.all(np.abs(frf.values - truth(model, frf.omega)) <= frf.bound))
    entries = frf.values.size
    independent = (1 - (1 - probability) / entries) ** entries
    sigma = np.sqrt(probability * (1 - probability) / seeds)
    assert probability - 3.3 * sigma <= held / seeds <= independent + 3.3 * sigma, held


@pytest.mark.parametrize("seeds", [8, slow(100)])
def test_probability_of_the_bound_where_experiments_are_driven_unlike(seeds):
    """Of two inputs of random phases, which are almost dependent at some lines; the first experiment three times as strong.

    Allowed as above, without the upper end. Held of 100: 98.
    """
    recipe, held = recipes()["matrix"], 0
    for seed in range(seeds):
        one, two = excited_records(recipe, np.random.default_rng([seed, 98]))
        frf = response_alone([TimeRecord(3 * one.u, 3 * one.y, dt=one.dt), two], period=recipe.period)
        held += bool(np.all(np.abs(frf.values - truth(recipe.plant, frf.omega)) <= frf.bound))
    assert held / seeds >= 0.95 - 3.3 * np.sqrt(0.95 * 0.05 / seeds), held


def test_within_one_realisation_distortion_is_invisible():
    """Why several blocks use the scatter between them: periods alone don't show this distortion."""
    model, held = plant(1, 1), 0
    for seed in range(50):
        rng = np.random.default_rng(seed)
        frf = response_alone(measure(model, rng, periods=12, output=0.05, distortion=0.3), period=PERIOD)
        held += bool(np.all(np.abs(frf.values - truth(model, frf.omega)) <= frf.bound))
    assert held == 0


@pytest.mark.parametrize("count", [60, slow(400)])
def test_covariance_is_that_of_the_estimate(count):
    """Mean of the estimated covariance against that of many estimates: 2 x 2, off-diagonal entries too."""
    model, rng = plant(2, 2), np.random.default_rng(7)
    records = [measure(model, rng, periods=4, output=0) for _ in range(2)]
    # common noise on both outputs: correlated entries
    mix = np.array([[1.0, 0.8], [0.0, 0.6]])
    estimates, covariances = [], []
    for _ in range(count):
        disturbed = [
            TimeRecord(r.u, r.y + 0.1 * rng.standard_normal(r.y.shape) @ mix, dt=DT, initial="periodic")
            for r in records
        ]
        frf = response_alone(disturbed, period=PERIOD, lines=[7])
        estimates.append(frf.values[0].ravel(order="F"))
        covariances.append(frf.covariance[0])
    errors = np.array(estimates) - truth(model, frf.omega)[0].ravel(order="F")
    seen, stated = errors.T @ errors.conj() / count, np.mean(covariances, axis=0)
    scale = np.sqrt(np.outer(np.diag(stated).real, np.diag(stated).real))
    # A correlation is known to 1/sqrt(count) (one sigma): four of these.
    assert np.max(np.abs(seen - stated) / scale) < 4 / np.sqrt(count)
    assert np.abs(stated[0, 1]) / scale[0, 1] > 0.5


@pytest.mark.parametrize("power", [-60, slow(60)])
def test_units_do_not_matter(power):
    scale, model, rng = 2.0**power, plant(2, 2), np.random.default_rng(8)
    records = [measure(model, rng, periods=4, output=0.1, input=0.05) for _ in range(2)]
    frf = response_alone(records, period=PERIOD)
    for u, y, t in ((scale, 1, 1), (1, scale, 1), (1, 1, scale), (scale, scale, scale)):
        scaled = response_alone([TimeRecord(r.u * u, r.y * y, dt=r.dt * t) for r in records], period=PERIOD)
        np.testing.assert_array_equal(scaled.omega * t, frf.omega)
        np.testing.assert_array_equal(scaled.values * u / y, frf.values)
        np.testing.assert_array_equal(scaled.bound * u / y, frf.bound)
        np.testing.assert_array_equal(scaled.covariance * (u / y) ** 2, frf.covariance)


def test_one_input_in_other_units_than_its_neighbour():
    model, rng = plant(2, 2), np.random.default_rng(9)
    records = [measure(model, rng, periods=4, output=0.1) for _ in range(2)]
    frf = estimate_frf(records, period=PERIOD)
    factor = np.array([1.0, 2.0**40])
    scaled = estimate_frf([TimeRecord(r.u * factor, r.y, dt=DT) for r in records], period=PERIOD)
    np.testing.assert_allclose(scaled.values * factor, frf.values, rtol=1e-9)
    np.testing.assert_allclose(scaled.bound * factor, frf.bound, rtol=1e-9)


def test_lines_are_found_in_the_reference_where_there_is_one():
    rng = np.random.default_rng(10)
    record = measure(plant(1, 1), rng, periods=4, output=0.01)
    hum = np.cos(2 * np.pi * 9 * np.arange(4 * PERIOD) / PERIOD)[:, None]
    options = {"dt": DT, "initial": "periodic"}
    assert 9 / (PERIOD * DT) in estimate_frf(TimeRecord(record.u + hum, record.y, **options), period=PERIOD).freq_hz
    closed = TimeRecord(record.u + hum, record.y, reference=record.u, **options)
    np.testing.assert_allclose(estimate_frf(closed, period=PERIOD).freq_hz, LINES / (PERIOD * DT))


def test_lines_below_a_fifth_of_the_largest_are_disturbances():
    rng = np.random.default_rng(13)
    u = multisine(rng) + 0.24 * multisine(rng, [15]) + 0.16 * multisine(rng, [16])
    frf = estimate_frf(TimeRecord(np.tile(u, 3), np.tile(u, 3), dt=DT), period=PERIOD)
    np.testing.assert_allclose(frf.freq_hz * PERIOD * DT, [2, 3, 7, 12, 15, 20])


def test_offsets_are_no_excitation_unless_asked_for():
    record = measure(plant(1, 1), np.random.default_rng(11), periods=4, output=0.01, offset=5.0)
    assert len(estimate_frf(record, period=PERIOD).omega) == len(LINES)
    asked = estimate_frf(record, period=PERIOD, lines=[0, 2])
    assert asked.omega[0] == 0
    assert asked.values[0, 0, 0].imag == 0


def good(**changes):
    rng = np.random.default_rng(12)
    record = measure(plant(1, 1), rng, periods=4, output=0.01)
    return TimeRecord(**{"u": record.u, "y": record.y, "dt": DT, **changes})


def pair(second):
    first = np.outer(good().u, [1.0, 2.0])
    return [good(u=first), good(u=second(first))]


TWO_INPUTS, RECORD = np.tile(np.arange(64.0)[:, None], (4, 2)), "`record` must be a TimeRecord or a sequence of them"

test_estimate_frf_refuses = refusals(
    ({"method": "fft"}, "`method` must be one of"),
    ({"period": None, "method": "periodic"}, "holds one period of 256 samples .* at least two periods"),
    ({"period": 100}, "256 samples, not a whole number of periods of 100; cut it to 200"),
    ({"period": 256}, "one period of 256 samples"),
    ({"period": 64.0}, "`period` must be an integer", InputTypeError),
    ({"period": 1}, "`period` must be at least 2; got 1"),
    ({"probability": 1}, "`probability` must be between 0 and 1; got 1"),
    ({"probability": 0}, "`probability` must be between 0 and 1; got 0"),
    ({"lines": [33]}, r"`lines` must be whole numbers from 0 to period//2 = 32"),
    ({"lines": [1.5]}, "`lines` must be whole numbers"),
    ({"lines": []}, "`lines` must be whole numbers"),
    ({"lines": [2, 2]}, "`lines` must be all different"),
    ({"record": good(u=np.zeros(256))}, "input u is constant .0.: it excites nothing"),
    ({"record": good(u=np.tile([1.0, 0.0, -1.0, 0.0], 64)), "lines": [3]}, "an input is zero at a spectral line"),
    ({"record": good(y=np.full(256, 3.0))}, r"output y is constant \(3\): a sensor that is not connected"),
    ({"record": []}, f"{RECORD}; got list", InputTypeError),
    ({"record": "record"}, f"{RECORD}; got str", InputTypeError),
    ({"record": [good(), good(dt=0.02)]}, r"same sample time; got 0\.01 and 0\.02 \(number 1\)"),
    ({"record": [good(), good(u=TWO_INPUTS)]}, "same shape of u"),
    ({"record": [good(), good(y=TWO_INPUTS)]}, "same shape of y"),
    ({"record": good(u=TWO_INPUTS)}, "not independent in any window"),
    ({"record": pair(lambda first: first)}, r"not independent at .* Hz"),
    ({"record": pair(lambda first: 0 * first)}, r"not independent at .* Hz"),
    of=lambda **options: estimate_frf(**{"record": good(), "period": PERIOD, **options}),
)


def test_a_saturated_output_is_said(caplog):
    record = good()
    estimate_frf(good(y=np.clip(record.y, -0.5 * record.y.max(), 0.5 * record.y.max())), period=PERIOD)
    assert "looks saturated" in caplog.text

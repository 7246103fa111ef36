"""Models held against records and frequency responses: residuals, initial states, whiteness, refusals."""

import control
import numpy as np
import pytest

from robustid.data import FrequencyResponse, TimeRecord
from robustid.errors import InputError, InputTypeError
from robustid.identification import validate
from support.cases import slow

pytestmark = pytest.mark.quick


DT = 0.01


def random_model(rng, *, ny=2, nu=3, dt=DT, zeta=0.003):
    """Two light modes and a real pole, discrete, in random coordinates."""
    a = np.zeros((5, 5))
    for i, angle in enumerate(rng.uniform(0.1, 3.0, 2)):
        turn = np.exp(-zeta * angle) * np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
        a[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] = turn
    a[4, 4] = 0.8
    t = rng.standard_normal((5, 5))
    b, c, d = rng.standard_normal((5, nu)), rng.standard_normal((ny, 5)), rng.standard_normal((ny, nu))
    return control.StateSpace(t @ a @ np.linalg.inv(t), t @ b, c @ np.linalg.inv(t), d, dt)


def simulate(model, u, start=None):
    """Judge of its own: the impulse response, convolved, plus the free response."""
    samples, (ny, n) = u.shape[0], model.C.shape
    y, power = u @ model.D.T, np.eye(n)
    start = np.zeros(n) if start is None else start
    for k in range(samples):
        y[k] += model.C @ power @ start
        y[k + 1 :] += u[: samples - k - 1] @ (model.C @ power @ model.B).T
        power = model.A @ power
    assert y.shape == (samples, ny)
    return y


def values_at(model, points):
    return np.array([model.D + model.C @ np.linalg.solve(z * np.eye(model.nstates) - model.A, model.B) for z in points])


def test_record_from_rest():
    for seed in range(20):
        rng = np.random.default_rng(seed)
        model, u = random_model(rng), rng.standard_normal((300, 3))
        noise = 0.1 * rng.standard_normal((300, 2))
        y = simulate(model, u) + noise
        result = validate(model, TimeRecord(u, y, dt=DT, bound=0.2))
        np.testing.assert_allclose(result.residuals, noise, atol=1e-10 * np.max(np.abs(y)))
        size = np.linalg.norm(y - y.mean(axis=0), axis=0)
        np.testing.assert_allclose(result.fit, 1 - np.linalg.norm(noise, axis=0) / size, rtol=1e-9)
        assert result.ratio == pytest.approx(np.max(np.abs(noise)) / 0.2)
        assert result.worst == np.unravel_index(np.argmax(np.abs(noise)), noise.shape)
        assert result.outside == np.sum(np.abs(noise) > 0.2)


@pytest.mark.parametrize("seeds", [5, slow(20)])
def test_free_record_finds_the_initial_state(seeds):
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        model, u = random_model(rng), rng.standard_normal((400, 3))
        y = simulate(model, u, start=100 * rng.standard_normal(5))
        size = np.max(np.abs(y))
        assert np.max(np.abs(validate(model, TimeRecord(u, y, dt=DT, initial="free")).residuals)) < 1e-10 * size
        assert np.max(np.abs(validate(model, TimeRecord(u, y, dt=DT)).residuals)) > 1e-2 * size


def test_free_record_is_blind_to_unused_samples_and_to_units():
    rng = np.random.default_rng(5)
    model, u = random_model(rng), rng.standard_normal((200, 3))
    y = simulate(model, u, start=rng.standard_normal(5)) + 0.01 * rng.standard_normal((200, 2))
    bound = np.full((200, 2), 0.02)
    bound[50:60, 1] = np.inf
    plain = validate(model, TimeRecord(u, y, dt=DT, bound=bound, initial="free"))
    spoiled = y.copy()
    spoiled[50:60, 1] += 1e3
    other = validate(model, TimeRecord(u, spoiled, dt=DT, bound=bound, initial="free"))
    np.testing.assert_allclose(other.predicted, plain.predicted, rtol=1e-10)
    np.testing.assert_allclose(other.fit, plain.fit, rtol=1e-9)
    assert other.ratio == pytest.approx(plain.ratio)
    scale = np.array([2.0**-60, 2.0**60])
    scaled = control.StateSpace(model.A, model.B, model.C * scale[:, None], model.D * scale[:, None], DT)
    for limits in (bound * scale, None):
        reference = None if limits is None else bound
        one = validate(model, TimeRecord(u, y, dt=DT, bound=reference, initial="free"))
        two = validate(scaled, TimeRecord(u, y * scale, dt=DT, bound=limits, initial="free"))
        np.testing.assert_allclose(two.residuals / scale, one.residuals, atol=1e-9 * np.max(np.abs(y)))
        np.testing.assert_allclose(two.fit, one.fit, rtol=1e-9)


@pytest.mark.parametrize("seeds", [1, slow(10)])
def test_periodic_record_is_the_end_of_a_long_one(seeds):
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        model, u = random_model(rng, zeta=0.02), rng.standard_normal((250, 3))
        y = simulate(model, np.tile(u, (40, 1)))[-250:]
        result = validate(model, TimeRecord(u, y, dt=DT, initial="periodic"))
        assert np.max(np.abs(result.residuals)) < 1e-9 * np.max(np.abs(y))


def test_periodic_record_agrees_with_the_lines_of_its_spectrum():
    # Poles 1e-6 from the circle: no transient would have died out.
    rng = np.random.default_rng(1)
    model, u = random_model(rng, zeta=1e-6), rng.standard_normal((512, 3))
    lines = values_at(model, np.exp(2j * np.pi * np.arange(257) / 512)) @ np.fft.rfft(u, axis=0)[..., None]
    y = np.fft.irfft(lines[..., 0], 512, axis=0)
    result = validate(model, TimeRecord(u, y, dt=DT, initial="periodic"))
    assert np.max(np.abs(result.residuals)) < 1e-8 * np.max(np.abs(y))


@pytest.mark.parametrize("dt", [None, DT])
def test_frequency_response(dt):
    for seed in range(8):
        rng = np.random.default_rng(seed)
        B, C, D = (rng.standard_normal(shape) for shape in ((2, 3), (2, 2), (2, 3)))
        model = random_model(rng) if dt else control.StateSpace(np.diag([-1.0, -20.0]), B, C, D, 0)
        omega = np.linspace(1, 300, 50)
        values = values_at(model, np.exp(1j * omega * dt) if dt else 1j * omega)
        noise = 0.1 * (rng.standard_normal(values.shape) + 1j * rng.standard_normal(values.shape))
        result = validate(model, FrequencyResponse(omega, values + noise, bound=0.25, dt=dt))
        np.testing.assert_allclose(result.residuals, noise, atol=1e-9 * np.max(np.abs(values)))
        assert result.predicted.shape == (50, 2, 3)
        assert result.ratio == pytest.approx(np.max(np.abs(noise)) / 0.25, rel=1e-6)
        assert result.outside == np.sum(np.abs(noise) > 0.25)
        measured = values + noise
        expected = 1 - np.linalg.norm(noise, axis=0) / np.linalg.norm(measured - measured.mean(axis=0), axis=0)
        np.testing.assert_allclose(result.fit, expected, atol=1e-8)
        assert result.whiteness is None


def test_whiteness_errs_as_often_as_it_says():
    # 2000 white residuals, limit 99 %: 28 were called coloured; residuals with correlation 0.3 all were.
    rng = np.random.default_rng(0)
    static = control.StateSpace([], [], [], np.zeros((200, 1)))
    called = 0
    for _ in range(10):
        white = rng.standard_normal((1000, 200))
        called += np.sum(validate(static, TimeRecord(np.ones(1000), white, dt=DT)).whiteness < 0.01)
        coloured = white[1:] + 0.35 * white[:-1]
        assert np.all(validate(static, TimeRecord(np.ones(999), coloured, dt=DT)).whiteness < 0.01)
    assert 8 <= called <= 36  # 20 expected, sigma 4.4


def test_lines_that_nothing_excited_have_no_part_in_the_fit():
    omega, truth = np.linspace(1, 10, 30), control.ss([[0.9]], [[1.0]], [[0.1]], 0, 0.1)
    values = np.array([truth(np.exp(0.1j * w)) for w in omega])
    bound = np.full(30, 1e-3)
    values[-3:], bound[-3:] = [1e3, -2e3, 5e2j], 1e4
    assert validate(truth, FrequencyResponse(omega, values, bound=bound, dt=0.1)).fit[0, 0] > 0.999
    assert validate(truth, FrequencyResponse(omega, values, bound=1e-3, dt=0.1)).fit[0, 0] < 0.1
    assert np.isfinite(validate(truth, FrequencyResponse(omega, values, bound=1e5, dt=0.1)).fit[0, 0])  # all are noise


def test_what_cannot_be_tested_is_nan_and_a_constant_signal_has_a_defined_fit():
    static = control.StateSpace([], [], [], [[1.0]])
    assert np.isnan(validate(static, TimeRecord(np.ones(4), np.arange(4.0), dt=DT)).whiteness[0])
    constant = validate(static, RECORD)
    assert np.isnan(constant.whiteness[0])
    assert constant.fit[0] == 1
    assert validate(static, TimeRecord(np.ones(10), 2 * np.ones(10), dt=DT)).fit[0] == -np.inf


def test_integrator_from_rest_and_free():
    integrator = control.ss([[1.0]], [[DT]], [[1.0]], 0, DT)
    u = np.random.default_rng(0).standard_normal(500)
    y = DT * np.concatenate([[0], np.cumsum(u)[:-1]])
    assert np.max(np.abs(validate(integrator, TimeRecord(u, y, dt=DT)).residuals)) < 1e-13
    free = validate(integrator, TimeRecord(u, y + 3, dt=DT, initial="free"))
    assert np.max(np.abs(free.residuals)) < 1e-12


def test_summary_names_channels_units_and_the_worst_sample():
    y = np.array([0.0, 1.0, 1.5, 1.8])
    record = TimeRecord(np.ones(4), y, dt=DT, bound=0.1, inputs=["current [A]"], outputs=["torsion [rad]"])
    text = validate(ONE, record).summary()
    assert "torsion [rad]" in text
    assert "0.5 at 0.03 s" in text
    assert "all inside" in text
    assert "1 outside" in validate(ONE, record.with_bound(0.04)).summary()
    assert "no bound" in validate(ONE, TimeRecord(np.ones(4), y, dt=DT)).summary()
    frf = FrequencyResponse([10.0, 20.0], [1.0, 2.0], bound=0.1, dt=DT, inputs=["current [A]"])
    text = validate(ONE, frf).summary()
    assert "current [A] -> y" in text
    assert "Hz" in text


def test_results_are_read_only():
    with pytest.raises(ValueError, match="read-only"):
        validate(ONE, RECORD).residuals[0] = 0


ONE = control.ss([[0.5]], [[1.0]], [[1.0]], 0, DT)
RECORD = TimeRecord(np.ones(400), np.ones(400), dt=DT)
PERIODIC = TimeRecord(np.ones(400), np.ones(400), dt=DT, initial="periodic")
FREE = TimeRecord(np.ones(4000), np.ones(4000), dt=DT, initial="free")
SAMPLED = FrequencyResponse([0.0, 1.0], [1.0, 1.0], dt=DT)
CONTINUOUS = FrequencyResponse([0.0, 1.0], [1.0, 1.0])


@pytest.mark.parametrize(
    ("model", "data", "says"),
    [
        (ONE, np.ones(4), "TimeRecord, FrequencyResponse or TangentialResponse"),
        ("plant", RECORD, "control.StateSpace or TransferFunction"),
        (control.StateSpace([[0.5]], [[1]], [[1]], 0, None), RECORD, "dt = None"),
        (control.StateSpace([[0.5]], [[np.nan]], [[1]], 0, DT), RECORD, "matrix B"),
        (control.ss([[0.5]], [[1.0]], [[1.0]], 0, 0.02), RECORD, "dt = 0.02 s.*dt = 0.01 s"),
        (control.ss([[0.5]], [[1.0]], [[1.0]], 0, 0.02), SAMPLED, "dt = 0.02 s.*dt = 0.01 s"),
        (control.ss([[-0.5]], [[1.0]], [[1.0]], 0), RECORD, "sample_system"),
        (control.ss([[-0.5]], [[1.0]], [[1.0]], 0), SAMPLED, "sample_system"),
        (ONE, CONTINUOUS, "`dt`"),
        (control.ss([[0.5]], [[1.0, 1.0]], [[1.0]], [[0, 0]], DT), RECORD, "1 inputs.*got 1 and 2"),
        (control.ss([[0.5]], [[1.0]], [[1.0], [1.0]], [[0], [0]], DT), SAMPLED, "1 outputs.*got 2 and 1"),
        (control.ss([[1.0]], [[1.0]], [[1.0]], 0, DT), PERIODIC, r'steady state.*\|z\| = 1.*"free"'),
        (control.ss([[1.1]], [[1.0]], [[1.0]], 0, DT), PERIODIC, r"steady state.*\|z\| = 1.1"),
        (control.ss([[9.0]], [[1.0]], [[1.0]], 0, DT), RECORD, "unstable.*overflows"),
        (control.ss([[2.0]], [[1.0]], [[1.0]], 0, DT), FREE, "unstable.*overflows"),
        (control.ss([[1.0]], [[1.0]], [[1.0]], 0, DT), SAMPLED, "pole at the frequency 0 Hz"),
        (control.ss([[0.0, 1], [0, 0]], [[0], [1.0]], [[1.0, 0]], 0), CONTINUOUS, "pole at the frequency 0 Hz"),
    ],
)
def test_bad_input_is_named(model, data, says):
    with pytest.raises((InputError, InputTypeError), match=says):
        validate(model, data)

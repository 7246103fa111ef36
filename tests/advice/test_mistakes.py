"""Common mistakes: the first line of help names the cause, and the change it gives leads to a consistent, verified result."""

import dataclasses
import functools

import control
import numpy as np
import pytest
import scipy.signal

import robustid as rid
from robustid.errors import InputError
from robustid.estimation import correct

LINES, SAMPLES, DT = 16, 8, 0.01
DATA = rid.datasets.flexible_structure(lines=LINES, samples=SAMPLES)
FRF, RECORD = DATA.frequency, DATA.time
CLASS = rid.Prior(gain_bound=0.2, decay_rate=1.1)


def modes(scale=1.0, damping=DATA.modes[:, 1], which=slice(None)):
    return rid.kautz((scale * DATA.modes[:, 0])[which], np.asarray(damping)[which], dt=DT, delay=1)


def problem(frf=FRF, record=RECORD, basis=None, prior=CLASS):
    return rid.MixedProblem(frequency=frf, time=record, prior=prior, parametric=basis or modes())


def stretched(factor, frf=FRF):
    return dataclasses.replace(frf, omega=frf.omega * factor)


def as_degrees(frf):
    return dataclasses.replace(frf, values=np.abs(frf.values) * np.exp(1j * np.angle(frf.values) * np.pi / 180))


def inverse(frf):
    return dataclasses.replace(frf, values=1 / frf.values, bound=None)


def as_decibels(frf):
    return dataclasses.replace(frf, values=10 ** (np.abs(frf.values) / 20) * np.exp(1j * np.angle(frf.values)))


def cut(record, first):
    parts = {"u": record.u[first:], "y": record.y[first:], "bound": record.bound.select(slice(first, None))}
    return dataclasses.replace(record, **parts)


def periodic_data():
    """The response and 20 samples of periodic steady state of one lightly damped mode, with a class it is in."""
    plant = control.ss(*_mode(2 * np.pi * 12, 0.02), 0.0, DT)
    u = np.tile(np.random.default_rng(3).standard_normal(20), 60)
    y = control.forced_response(plant, inputs=u, return_x=False).outputs[-20:]
    record = rid.TimeRecord(u[-20:], y, dt=DT, bound=1e-3, initial="periodic")
    return _with_response(plant, record, 12.0, 0.02)


def percent_data():
    """A response of one mode with 0.4 % of damping."""
    plant = control.ss(*_mode(2 * np.pi * 12, 0.004), 0.0, DT)
    return _with_response(plant, None, 12.0, 0.004)


def corrected(right, correction):
    return dataclasses.replace(right, frequency=correct(right.frequency[0], correction))


def _mode(omega, damping):
    pole = np.exp(omega * DT * (-damping + 1j * np.sqrt(1 - damping**2)))
    A = np.array([[pole.real, pole.imag], [-pole.imag, pole.real]])
    return A, np.array([[0.0], [0.3]]), np.array([[1.0, 0.0]])


def _with_response(plant, record, hz, damping):
    omega = 2 * np.pi * np.linspace(2, 30, LINES)
    values = plant(np.exp(1j * omega * DT))
    frf = rid.FrequencyResponse(omega, values, bound=2e-4, dt=DT)
    basis = rid.kautz(2 * np.pi * hz, damping, dt=DT, delay=1)
    prior = rid.Prior(gain_bound=0.1, decay_rate=1.2)
    return rid.MixedProblem(frequency=frf, time=record, prior=prior, parametric=basis)


@functools.cache
def matrix_data():
    """A 2x2 response and a record of it."""
    rng = np.random.default_rng(1)
    A, B, C = _mode(2 * np.pi * 12, 0.03)
    plant = control.ss(A, np.hstack([B, 0 * B]), np.vstack([C, 0.5 * C]), np.array([[0.0, 0.05], [0.0, 0.0]]), DT)
    omega = 2 * np.pi * np.linspace(3, 25, 10)
    values = plant(np.exp(1j * omega * DT)).transpose(2, 0, 1)
    u = rng.standard_normal((10, 2))
    y = control.forced_response(plant, inputs=u.T, return_x=False).outputs.T
    frf = rid.FrequencyResponse(omega, values, bound=1e-2, dt=DT)
    record = rid.TimeRecord(u, y, dt=DT, bound=1e-2)
    basis = rid.kautz(2 * np.pi * 12, 0.03, dt=DT, delay=1)
    prior = rid.Prior(gain_bound=0.2, decay_rate=1.2)
    return rid.MixedProblem(frequency=frf, time=record, prior=prior, parametric=basis)


# --- mistakes that a class shows ------------------------------------------------------------------------------------------------

SHOWN = {
    "Hz as rad/s": (lambda: problem(stretched(1 / (2 * np.pi))), "frequencies are in Hz"),
    "rad/s as Hz": (lambda: problem(stretched(2 * np.pi, FRF.band(0, 7))), "frequencies are in rad/s"),
    "conjugated": (lambda: problem(correct(FRF, "conjugate")), "the phase has the wrong sign"),
    "wrong sign": (lambda: problem(correct(FRF, "negate")), "the response has the opposite sign"),
    "mm for m": (lambda: problem(correct(FRF, "times 1000")), "unit 1000 times smaller"),
    "one-sided spectrum": (lambda: problem(correct(FRF, "times 2")), "twice too large (a one-sided"),
    "one sample late": (lambda: problem(correct(FRF, "delay 1")), "one sample of delay too much"),
    "one sample early": (lambda: problem(correct(FRF, "advance 1")), "delay was taken out of the response"),
    "velocity for position": (lambda: problem(correct(FRF, "differentiate")), "velocity for position"),
    "radians as degrees": (lambda: problem(as_degrees(FRF)), "phase is in radians"),
    "linear as dB": (lambda: problem(as_decibels(FRF)), "plain number and was taken as decibels"),
    "inverse": (lambda: corrected(percent_data(), "exchange"), "are exchanged"),
    "transposed": (lambda: corrected(matrix_data(), "transpose"), "the matrices are transposed"),
    "modes in Hz": (lambda: problem(basis=modes(1 / (2 * np.pi))), "frequencies of the modes are in Hz"),
    "damping in per cent": (
        lambda: dataclasses.replace(percent_data(), parametric=rid.kautz(2 * np.pi * 12, 0.4, dt=DT, delay=1)),
        "damping of the modes is in per cent",
    ),
    "bounds ten times too small": (
        lambda: problem(*(correct(data, "bound times 0.1") for data in (FRF, RECORD))),
        "bounds on the errors are too small",
    ),
    "missing mode": (lambda: problem(basis=modes(which=slice(1, None))), "a mode is missing, at 9"),
    "not at rest": (lambda: problem(record=cut(RECORD, 4)), "doesn't start at rest"),
    "periodic, not at rest": (
        lambda: dataclasses.replace(periodic_data(), time=dataclasses.replace(periodic_data().time[0], initial="rest")),
        "periodic steady state",
    ),
}


# Mistakes with the correction of others, the other way or by another factor, and those that the data below show by themselves.
LIKE_OTHERS = (
    *("rad/s as Hz", "one-sided spectrum", "one sample early"),
    *("conjugated", "radians as degrees", "linear as dB", "inverse", "bounds ten times too small"),
)


@pytest.mark.parametrize("mistake", [pytest.param(k, marks=pytest.mark.slow) if k in LIKE_OTHERS else k for k in SHOWN])
def test_the_first_line_names_the_mistake_and_its_change_makes_the_data_consistent(mistake):
    build, words = SHOWN[mistake]
    wrong = rid.identify(build(), accuracy=1e-3)
    found = rid.diagnose(wrong)
    first, *_, last = found.summary().splitlines()
    assert words in first, first
    cause = found.causes[0]
    assert last == f"Change to make: {cause.sentence}."
    right = rid.identify(cause.problem, accuracy=1e-3)
    assert right.consistent
    assert right.verification.passed


def test_a_class_of_data_that_are_right_has_no_cause():
    found = rid.diagnose(rid.identify(problem()))
    assert found.causes == ()
    assert found.summary().startswith("The data are consistent")


def test_a_mode_that_is_missing_comes_before_a_unit_that_would_shrink_everything():
    posed = rid.MixedProblem(frequency=FRF, prior=CLASS, parametric=control.ss(0.5, 1, 1, 0, DT))
    found = rid.diagnose(rid.identify(posed))
    assert "a mode is missing, at 9.0" in found.causes[0].cause
    assert not found.causes[0].solves
    assert any(cause.unsure for cause in found.causes)


def test_modes_that_are_others_than_stated_are_found_together():
    frf = rid.datasets.flexible_structure(lines=11, extra_hz=[17.4, 17.6, 17.67, 17.75, 17.9]).frequency
    wrong = rid.kautz(2 * np.pi * 17.3, 0.004, dt=DT, delay=1)
    found = rid.diagnose(rid.identify(rid.MixedProblem(frequency=frf, prior=CLASS, parametric=wrong)))
    assert found.causes[0].solves
    assert "the modes are others than stated: 9.0" in found.causes[0].cause
    assert "--mode 17.6" in found.causes[0].option


# --- mistakes that the data show by themselves ----------------------------------------------------------------------------------

TONES = 2 * np.pi * np.arange(1, 200) / (500 * DT)
PLANT = control.ss(*_mode(2 * np.pi * 12, 0.02), 0.0, DT)
RESPONSE = rid.FrequencyResponse(TONES, PLANT(np.exp(1j * TONES * DT)), bound=1e-3, dt=DT)


@functools.cache
def said_of_the_right_response():
    return rid.prepare.response_faults(RESPONSE)


@pytest.mark.parametrize(
    ("wrong", "words", "correction"),
    [
        (lambda r: stretched(1 / (2 * np.pi), r), "in Hz and were taken as rad/s", "frequency in Hz"),
        (lambda r: stretched(2 * np.pi, r.band(0, 5)), "in rad/s and were taken as Hz", "frequency in rad/s"),
        (lambda r: correct(r, "conjugate"), "the phase has the wrong sign", "conjugate"),
        (as_degrees, "the phase is in radians and was taken as degrees", "phase in radians"),
        (as_decibels, "a plain number and was taken as decibels", "magnitude linear"),
        (inverse, "input and output of the response are exchanged", "exchange"),
    ],
)
def test_responses_show_mistakes_without_a_class(wrong, words, correction):
    assert said_of_the_right_response() == ()
    bad = wrong(RESPONSE)
    (fault,) = rid.prepare.response_faults(bad)
    assert words in fault.words
    assert fault.correction == correction
    assert str(fault).endswith(f'after the correction "{correction}"')
    right = correct(bad, correction)
    wanted = RESPONSE.select(slice(len(right.omega)))
    np.testing.assert_allclose(right.omega, wanted.omega, rtol=1e-12)
    np.testing.assert_allclose(right.values, wanted.values, rtol=1e-9, atol=1e-12)
    assert rid.prepare.response_faults(right) == ()


def test_a_conjugated_response_is_named_where_a_chosen_class_is_consistent_with_it():
    bad = correct(RESPONSE.select(slice(None, None, 10)), "conjugate")
    result = rid.identify(rid.MixedProblem(frequency=bad, prior=rid.Prior(gain_bound=1e3, decay_rate=1.0001)))
    assert result.consistent
    found = rid.diagnose(result)
    assert found.summary().startswith("Most likely cause: the phase has the wrong sign")
    assert any(fault.kind == "phase sign" for fault in result.problem.data_faults)


@pytest.mark.parametrize("seed", [pytest.param(k, marks=pytest.mark.slow) if k else k for k in range(6)])
def test_bounds_below_the_noise_are_named_without_a_class_and_covered_by_the_correction(seed):
    frf = rid.datasets.flexible_structure(lines=50, seed=seed, extra_hz=np.linspace(17.2, 18.1, 10)).frequency
    assert rid.prepare.response_faults(frf) == ()
    (fault,) = rid.prepare.response_faults(correct(frf, "bound times 0.1"))
    assert fault.words == "the bounds are smaller than the noise of the response"
    right = correct(frf, "bound times 0.1", fault.correction)
    assert 5 < (right.bound.radius / frf.bound.radius).max() * 10 < 20


def test_degrees_taken_as_radians_are_named():
    turned = np.exp(1j * np.angle(RESPONSE.values, deg=True))
    bad = dataclasses.replace(RESPONSE, values=np.abs(RESPONSE.values) * turned)
    (said,) = rid.prepare.response_faults(bad)
    assert str(said).startswith("the phase is in degrees and was taken as radians")


def test_decibels_taken_as_plain_numbers_are_refused_and_then_read(tmp_path):
    decibels, phase = 20 * np.log10(np.abs(RESPONSE.values.ravel())), np.angle(RESPONSE.values.ravel())
    table = np.column_stack([TONES / (2 * np.pi), decibels, phase])
    np.savetxt(tmp_path / "db.csv", table, "%.17g", ",", header="f_hz,magnitude,phase_rad", comments="")
    with pytest.raises(InputError, match="is it in dB"):
        rid.load(tmp_path / "db.csv", dt=DT)
    frf = rid.load(tmp_path / "db.csv", dt=DT, fields={"freq_hz": "f_hz", "magnitude_db": "magnitude"})
    np.testing.assert_allclose(frf.values, RESPONSE.values, rtol=1e-9)


def test_another_order_of_axes_is_refused_with_the_right_one():
    values = np.zeros((2, 3, TONES.size))
    with pytest.raises(InputError, match=r"np\.moveaxis\(values, 2, 0\)"):
        rid.FrequencyResponse(TONES, values)
    assert rid.FrequencyResponse(TONES, np.moveaxis(values, 2, 0)).values.shape == (TONES.size, 2, 3)


def loop(r, noise, gain):
    """Input and output of y[k] = y[k - 1]/2 + u[k - 1]/2 + noise under u[k] = r[k] - gain y[k - 1]."""
    u, y = np.zeros(r.size), np.zeros(r.size)
    for k in range(1, r.size):
        y[k] = 0.5 * y[k - 1] + 0.5 * u[k - 1] + noise[k]
        u[k] = r[k] - gain * y[k - 1]
    return u, y


@pytest.mark.parametrize("seed", [pytest.param(k, marks=pytest.mark.slow) if k > 1 else k for k in range(4)])
def test_records_show_closed_loops_and_exchanged_signals_and_nothing_where_all_is_right(seed):
    rng = np.random.default_rng(seed)
    u, noise = rng.standard_normal(2000), 0.3 * rng.standard_normal(2000)
    if seed % 2:
        u = scipy.signal.lfilter([1], [1, -0.9], u)
    transfer = control.ss2tf(PLANT)
    y = scipy.signal.lfilter(transfer.num[0][0], transfer.den[0][0], u) + noise
    assert rid.prepare.record_faults(rid.TimeRecord(u, y, dt=DT)) == ()
    (said,) = rid.prepare.record_faults(rid.TimeRecord(y, u, dt=DT))
    assert "the two are exchanged" in str(said)
    driven, answer = loop(u, 4 * noise, 0.8)
    (said,) = rid.prepare.record_faults(rid.TimeRecord(driven, answer, dt=DT))
    assert "the loop is closed" in str(said)
    assert rid.prepare.record_faults(rid.TimeRecord(driven, answer, dt=DT, reference=u)) == ()
    (said,) = rid.prepare.record_faults(rid.TimeRecord(*loop(0 * u, noise, 0.8), dt=DT))
    assert "a controller computes it" in str(said)


def test_a_period_that_is_missing_or_wrong_is_given():
    u = np.tile(np.random.default_rng(0).standard_normal(50), 6)
    record = rid.TimeRecord(u, np.convolve(u, [0, 1, 0.5])[:300], dt=DT)
    for period in (None, 49):
        (said,) = rid.prepare.record_faults(record, period=period)
        assert "50" in str(said)
    assert rid.prepare.record_faults(record, period=50) == ()

"""Faults inside single records: each is found where it is, of its size; and sound records are told of none."""

import dataclasses

import numpy as np
import pytest
import scipy.signal

import robustid as rid
from robustid.estimation.events import examined
from robustid.estimation.innovations import Predictors, gain_of_inputs

DT, PERIOD, SAMPLES = 0.01, 400, 2400
BAND = scipy.signal.butter(4, (0.02, 0.6), "bandpass")
PLANT = [0, 0.05, 0.04], [1, -1.7, 0.95]
NOISE = 0.01


def record(*, seed=0, periodic=False, samples=SAMPLES, noise="normal", initial="free"):
    """Random or periodic input, a resonance, and noise of 1 % of the rms of the output."""
    rng = np.random.default_rng(seed)
    u = rng.standard_normal(PERIOD if periodic else 2 * samples)
    u = np.tile(u, 2 * samples // PERIOD) if periodic else scipy.signal.lfilter(*BAND, u)
    y = scipy.signal.lfilter(*PLANT, u)[samples:]
    e = {
        "normal": rng.standard_normal,
        "heavy": lambda n: rng.laplace(size=n) / np.sqrt(2),
        "coloured": lambda n: scipy.signal.lfilter([0.3], [1, -0.95], rng.standard_normal(n)),
    }[noise](samples)
    u, y = u[samples:], y + NOISE * y.std() * e
    return rid.TimeRecord(u, y, dt=DT, initial="periodic" if periodic else initial)


def changed(one, y, **more):
    return dataclasses.replace(one, y=y, **more)


def faults(one):
    return rid.prepare.record_faults(one, period=PERIOD if one.initial == "periodic" else None)


@pytest.fixture(params=[False, True], ids=["random", "periodic"])
def one(request):
    return record(periodic=request.param)


@pytest.mark.parametrize("seeds", [1, pytest.param(10, marks=pytest.mark.slow)])
def test_sound_records_are_told_of_no_fault(seeds):
    for seed in range(seeds):
        for periodic in (False, True):
            for noise in ("normal", "heavy", "coloured"):
                assert faults(record(seed=seed, periodic=periodic, noise=noise)) == ()


@pytest.mark.parametrize("height", [0.3, 20.0])
def test_a_spike_is_named_with_its_place_and_size(one, height):
    rms = float(one.y.std())
    (fault,) = faults(changed(one, one.y[:, 0] + height * rms * (np.arange(SAMPLES) == 1234)))
    assert (fault.kind, fault.where) == ("spike", "output y")
    assert "at sample 1234" in str(fault)
    assert ("(period 4)" in str(fault)) == (one.initial == "periodic")
    assert fault.size == pytest.approx(height, abs=5 * NOISE)


def test_several_spikes_are_counted(one):
    at = np.array([333, 711, 1100, 1555, 2005])
    y = one.y[:, 0].copy()
    y[at] += 2 * y.std() * np.array([1, -1, 1, 1, -1])
    (fault,) = faults(changed(one, y))
    assert fault.kind == "spike"
    assert "spikes: 5 samples are off" in str(fault)


def test_a_jump_of_the_level_is_named_with_its_place_and_size(one):
    rms = float(one.y.std())
    (fault,) = faults(changed(one, one.y[:, 0] + 0.5 * rms * (np.arange(SAMPLES) >= 1300)))
    assert fault.kind == "jump"
    assert "at sample 1300" in str(fault)
    assert fault.size == pytest.approx(0.5, abs=0.05)


def test_samples_that_wrapped_around_are_counted(one):
    y = one.y[:, 0]
    end = 0.6 * np.abs(y).max()
    wrapped = (y + end) % (2 * end) - end
    (fault,) = faults(changed(one, wrapped))
    assert fault.kind == "wrapped"
    assert fault.size == np.sum(np.abs(wrapped - y) > end)


def test_a_range_that_a_few_samples_pass_is_named(one):
    y = one.y[:, 0]
    end = np.sort(np.abs(y))[-3] * 0.999
    (fault,) = faults(changed(one, np.where(np.abs(y) > end, y - 2 * end * np.sign(y), y)))
    assert (fault.kind, fault.size) == ("wrapped", 3)


def test_lost_samples_are_counted_whatever_filled_them(one):
    starts = np.array([150, 420, 960, 1380, 1800])
    for fill, how in (("zero", "is exactly 0"), ("held", "keeps its last value")):
        y = one.y[:, 0] + 5 * one.y.std()
        for start in starts:
            y[start : start + 8] = 0.0 if fill == "zero" else y[start - 1]
        found = faults(changed(one, y))
        assert found[0].kind == "lost samples"
        assert how in str(found[0])
        assert found[0].size == 5 * (8 if fill == "zero" else 9)


@pytest.mark.parametrize("every", [2, 5])
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("periodic", [False, True])
def test_an_output_that_is_held_is_named_unless_its_input_is_held_too(every, seed, periodic):
    one = record(seed=seed, periodic=periodic)

    def taken(signal):
        first = np.arange(SAMPLES) + every - seed % every
        return signal[np.maximum(first // every * every - every + seed % every, 0)]

    (fault,) = faults(changed(one, taken(one.y)))
    assert (fault.kind, fault.where) == ("held", "output y")
    assert not faults(one)
    for u, y in ((one.u, np.round(one.y / one.y.std())), (taken(one.u), one.y), (taken(one.u), taken(one.y))):
        assert all(fault.kind != "held" for fault in faults(changed(one, y, u=u)))


@pytest.mark.parametrize("missing", [2, 25])
def test_samples_that_are_missing_are_named_by_their_number(one, missing):
    y, at = one.y[:, 0], 1111
    short = np.concatenate([y[:at], y[at + missing :], y[at : at + missing]])
    found = faults(changed(one, short))
    assert found[0].kind == "lost samples"
    assert found[0].size == missing
    assert abs(int(str(found[0]).split("about sample ")[1].split(":")[0]) - at) < 30


def test_a_coarse_quantiser_is_named_and_a_fine_one_is_not(one):
    y = one.y[:, 0]
    for steps in (8, 40):
        step = np.ptp(y) / steps
        (fault,) = faults(changed(one, np.round(y / step) * step))
        assert fault.kind == "quantised"
        assert fault.size == pytest.approx(step / np.sqrt(12) / y.std(), rel=0.05)
    assert faults(changed(one, np.round(y / np.ptp(y) * 4000))) == ()


def test_an_output_that_no_input_moves_is_named(one):
    noise = np.random.default_rng(5).standard_normal(SAMPLES)
    (fault,) = faults(changed(one, noise))
    assert fault.kind == "no response"
    assert faults(changed(one, one.y[:, 0] / one.y.std() + 3 * noise)) == ()  # noisy, but it answers


def test_a_late_answer_is_an_answer():
    one = record()
    assert [fault.kind for fault in faults(changed(one, np.roll(one.y[:, 0], 150)))].count("no response") == 0


def test_hum_is_named_with_its_frequencies_and_size(one):
    t = DT * np.arange(SAMPLES)
    y = one.y[:, 0]
    hum = sum(a * np.sin(2 * np.pi * hz * t) for hz, a in ((7.07, 0.2), (21.21, 0.1)))
    (fault,) = faults(changed(one, y + y.std() * hum))
    assert fault.kind == "tone"
    heard = [float(one) for one in str(fault).split("tones at ")[1].split(" Hz")[0].split(", ")]
    assert heard == pytest.approx([7.07, 21.21], abs=0.5 / (SAMPLES * DT))
    assert fault.size == pytest.approx(0.2, rel=0.15)


def test_hum_that_repeats_with_the_excitation_is_named():
    """At an excited line, where one response stands out; and at one that nothing drives."""
    one = record(periodic=True)
    u = scipy.signal.lfilter(*scipy.signal.butter(8, 0.5), np.tile(one.u[:PERIOD, 0], 10))[4 * PERIOD :]
    spectrum = np.fft.rfft(np.random.default_rng(1).standard_normal(PERIOD))
    spectrum /= np.abs(spectrum)
    spectrum[100:] = 0
    u = np.tile(np.fft.irfft(spectrum, PERIOD), 10)
    y = scipy.signal.lfilter(*PLANT, u)[4 * PERIOD :]
    y += NOISE * y.std() * np.random.default_rng(2).standard_normal(SAMPLES)
    t = DT * np.arange(SAMPLES)
    for line in (60, 130):
        hz = line / (PERIOD * DT)
        made = rid.TimeRecord(u[:SAMPLES], y + 0.3 * y.std() * np.sin(2 * np.pi * hz * t), dt=DT, initial="periodic")
        (fault,) = faults(made)
        assert fault.kind == "tone"
        assert f"a tone at {hz:g} Hz" in str(fault)
    assert faults(changed(made, y)) == ()


def test_a_drift_is_named_and_undone():
    one = record()
    y = one.y[:, 0]
    drifting = changed(one, y + 2 * y.std() * np.linspace(-1, 1, SAMPLES))
    (fault,) = faults(drifting)
    assert (fault.kind, fault.correction) == ("drift", "detrend linear")
    assert not fault.undone
    assert fault.size * drifting.y.std() == pytest.approx(4 * y.std(), rel=0.1)
    assert faults(rid.prepare.correct(drifting, fault.correction)) == ()


def test_a_point_of_operation_is_named_and_counted_from():
    one = record(initial="rest")
    assert faults(one) == ()
    about = dataclasses.replace(one, u=one.u + 5, y=one.y + 3)
    (fault,) = faults(about)
    assert (fault.kind, fault.correction) == ("offset", "detrend")
    right = rid.prepare.correct(about, fault.correction)
    assert right.initial == "free"
    assert np.abs([right.u.mean(), right.y.mean()]).max() < 1e-12
    assert faults(right) == ()


def test_an_offset_before_a_step_is_named_and_undone():
    u = (np.arange(60) >= 5).astype(float)
    y = scipy.signal.lfilter(*PLANT, u)
    sound = rid.TimeRecord(u, y, dt=DT, bound=0.01)
    assert faults(sound) == ()
    off = changed(sound, y + 3.0)
    (fault,) = faults(off)
    assert (fault.kind, fault.correction) == ("offset", "detrend")
    right = rid.prepare.correct(off, fault.correction)
    assert np.allclose(right.y[:, 0], y, atol=1e-12)
    assert np.all(right.bound.radius >= 0.01)
    assert faults(right) == ()


def test_a_transient_in_a_record_that_is_called_periodic_is_named():
    one = record(periodic=True)
    begun = scipy.signal.lfilter([1.0], [1, -1.98, 0.985], np.eye(1, SAMPLES)[0])
    y = one.y[:, 0]
    (fault,) = faults(changed(one, y + 2 * y.std() * begun / np.abs(begun).max()))
    assert fault.kind == "transient"
    assert faults(changed(one, one.y)) == ()


def test_a_period_beside_the_right_one_is_wrong():
    one = dataclasses.replace(record(periodic=True), initial="free")
    smooth = scipy.signal.lfilter([0.02], [1, -0.98], np.tile(one.u[:, 0], 2))[SAMPLES:]
    found = rid.prepare.record_faults(rid.TimeRecord(smooth, one.y, dt=DT), period=PERIOD - 1)
    assert found[0].kind == "wrong period"
    assert f"it repeats every {PERIOD} samples" in str(found[0])


def test_what_all_records_have_is_said_once():
    records = [record(seed=k) for k in range(3)]
    t = DT * np.arange(SAMPLES)
    hum = [changed(r, r.y[:, 0] + 0.2 * r.y.std() * np.sin(2 * np.pi * 7.07 * t)) for r in records]
    (fault,) = rid.prepare.record_faults(hum)
    assert (fault.kind, fault.record) == ("tone", 0)


@pytest.mark.parametrize("power", [-60, pytest.param(60, marks=pytest.mark.slow)])
def test_units_do_not_matter(one, power):
    t = DT * np.arange(SAMPLES)
    y = one.y[:, 0] + one.y.std() * (0.2 * np.sin(2 * np.pi * 7.07 * t) + 3 * (np.arange(SAMPLES) == 500))
    faulty = changed(one, y)
    found = faults(faulty)
    assert {fault.kind for fault in found} == {"spike", "tone"}
    assert faults(dataclasses.replace(faulty, u=faulty.u * 2.0**-power, y=faulty.y * 2.0**power)) == found


@pytest.mark.parametrize("samples", [2, 3, 7, 30, 61])
def test_short_records_are_no_trouble(samples):
    rng = np.random.default_rng(samples)
    u = rng.standard_normal((samples, 2))
    found = rid.prepare.record_faults(
        rid.TimeRecord(u, u @ [[1.0], [2.0]] + 0.1 * rng.standard_normal((samples, 1)), dt=DT)
    )
    assert not {fault.kind for fault in found} - {"constant"}


def test_the_predictor_is_that_of_the_plant():
    """A regression with known coefficients, and a spike of known height in it."""
    rng = np.random.default_rng(0)
    u, e = rng.standard_normal((2, 8000))
    y = scipy.signal.lfilter([0, 1.0], [1, -1.5, 0.9], u) + scipy.signal.lfilter([0.1], [1, -1.5, 0.9], e)
    predictors = Predictors(u[:, None])
    found = predictors.of(y)
    assert np.abs(found.a[:3] - [1, -1.5, 0.9]).max() < 0.02
    assert np.abs(found.b[0, :3] - [0, 1.0, 0]).max() < 0.02
    assert found.noise == pytest.approx(0.1, rel=0.05)
    assert gain_of_inputs(y, u[:, None]) > 1e4
    gains = [gain_of_inputs(y, rng.standard_normal((8000, 1))) for _ in range(20)]
    assert np.mean(gains) == pytest.approx(31, abs=4 * np.sqrt(2 * 31 / 20))  # chi-squared of 31 where they do nothing
    w = found.innovations(y, u[:, None])
    assert w.std() == pytest.approx(found.noise, rel=0.02)
    y[4000] += 3.0
    seen = examined(y, predictors, u[:, None], None)
    assert [(event.at, event.jump) for event in seen.events] == [(4000, False)]
    assert seen.events[0].height == pytest.approx(3.0, abs=0.3)

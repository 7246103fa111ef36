"""Faults of records: each fault alone, and none where there is none."""

import control
import numpy as np
import pytest
import scipy.signal

import robustid as rid
from robustid.data import FaultKind
from robustid.estimation.repetition import found_period
from support.cases import seeds, slow
from support.fault_plants import recipes, step
from support.pairwise import every_one

DT, PERIOD = 0.01, 100


def record(*, seed=0, periods=6, noise=0.01, input_noise=0.0, level=1.0, **options):
    rng = np.random.default_rng(seed)
    play = rid.prepare.multisine(band_hz=(1, 30), period=PERIOD, dt=DT, minimise_crest=False, rms=level, seed=seed)
    u = np.tile(play.u[0], (periods, 1))
    y = 2 * u + noise * rng.standard_normal(u.shape)
    return rid.TimeRecord(u + input_noise * rng.standard_normal(u.shape), y, dt=DT, **options)


def sentences(*records, period=PERIOD):
    return tuple(map(str, rid.prepare.record_faults(records[0] if len(records) == 1 else records, period=period)))


def changed(one, **signals):
    return rid.TimeRecord(**{"u": one.u, "y": one.y, "dt": DT} | signals)


def test_sound_records_have_none():
    assert sentences(record()) == ()
    assert sentences(*(record(seed=k) for k in range(5))) == ()


def test_a_noisy_record_among_others_is_named():
    """Two of six differ between their periods ten times more than the others."""
    records = [record(seed=k, noise=0.1 if k in (1, 4) else 0.01) for k in range(6)]
    found = sentences(*records)
    assert len(found) == 2
    for words, number in zip(found, (2, 5), strict=True):
        assert words.startswith(f"record {number}: output y differs from period to period ")
        assert 9 < float(words.split("period to period ")[1].split()[0]) < 11


def test_noise_from_one_period_to_the_next_needs_two_periods():
    assert sentences(*(record(seed=k, periods=1, noise=0.1 if k == 1 else 0.01) for k in range(4)), period=PERIOD) == ()


@pytest.mark.parametrize("level", [0.4, 3.0])
def test_unequal_excitation_is_no_fault(level):
    """A linear plant answers in proportion; a record in another unit does not (`_unlike`)."""
    assert sentences(*(record(seed=k, level=level if k == 2 else 1.0) for k in range(4))) == ()


def test_one_input_at_a_time_is_no_fault():
    one, other = record(seed=0), record(seed=1)
    first, second = np.column_stack([one.u, 0 * one.u]), np.column_stack([0 * other.u, other.u])
    assert sentences(changed(one, u=first), changed(other, u=second)) == ()


def test_drift_is_named():
    one = record()
    (words,) = sentences(changed(one, y=one.y + 2 * np.linspace(0, 1, len(one.y))[:, None]))
    assert words.startswith("output y drifts by ")
    assert words.endswith("% of its rms; the drift over whole periods is removed")


def test_noise_of_the_input_is_named():
    (words,) = sentences(record(input_noise=0.3))
    assert words.startswith("input u is measured with noise: ")
    assert "give a reference" in words


@pytest.mark.parametrize(
    ("periods", "extra", "said"), [(6, 0, "(6 periods)"), (3, 17, "(3 periods)"), (2, 0, "(2 periods)")]
)
def test_a_period_is_found(periods, extra, said):
    one = record(periods=periods + 1, input_noise=0.05)
    cut = slice(0, periods * PERIOD + extra)
    (words,) = sentences(changed(one, u=one.u[cut], y=one.y[cut]), period=None)
    assert words.startswith(f"the input repeats every 100 samples {said}, and nothing says so: give --period 100")
    assert ("cut the record to" in words) == bool(extra)


def test_a_wrong_period_is_named():
    (words,) = sentences(record(), period=120)
    assert words.endswith("from one period of 120 samples to the next; it repeats every 100 samples")


@pytest.mark.parametrize("cycles", [4.0, 6.0])
def test_a_slow_sweep_does_not_repeat(cycles):
    """Its last cycle is a twentieth shorter than the first; a sine of as many cycles repeats."""
    time = np.arange(1000) / 1000
    sine, sweep = (np.sin(2 * np.pi * cycles * (time + part * time**2 / 2)) for part in (0.0, 0.05))
    assert found_period(rid.TimeRecord(sine, sine, dt=DT)) == pytest.approx(1000 / cycles, abs=1)
    assert found_period(rid.TimeRecord(sweep, sweep, dt=DT)) is None


@pytest.mark.parametrize("kind", ["noise", "sweep", "step", "ramp", "one period"])
def test_no_period_is_found_where_there_is_none(kind):
    rng, t = np.random.default_rng(3), np.arange(2000) / 2000
    u = {
        "noise": rng.standard_normal(2000),
        "sweep": np.sin(2 * np.pi * 60 * t**2),
        "step": (t > 0.1).astype(float),
        "ramp": t,
        "one period": record(periods=1).u[:, 0],
    }[kind]
    assert found_period(rid.TimeRecord(u, u, dt=DT)) is None


@pytest.mark.parametrize("power", [-60, 60])
def test_units_do_not_matter(power):
    one = record(input_noise=0.3, noise=0.2)
    scaled = changed(one, u=one.u * 2.0**power, y=one.y * 2.0**-power)
    assert sentences(scaled) == sentences(one)
    assert found_period(scaled) == found_period(one) == PERIOD


def test_a_stuck_sensor_is_named():
    one = record()
    y = one.y.copy()
    y[200:260] = y[200]
    (words,) = sentences(changed(one, y=y), period=None)[:1]
    assert (
        words
        == f"output y keeps the value {y[200, 0]:.6g} for 60 samples from sample 200 on: it was stuck, the sensor or the machine"
    )
    still = one.u.copy()
    still[200:260] = still[200]
    assert not any("stuck" in words for words in sentences(changed(one, u=still, y=y), period=None))


def test_a_measured_input_that_clips_is_named():
    one = record()
    u = np.clip(one.u, -0.7, 0.7)
    assert sentences(changed(one, u=u)) == ()  # as played
    found = sentences(changed(one, u=u, reference=one.u))
    assert [words.split(",")[0] for words in found] == [f"input u is at its {s}est value" for s in ("larg", "small")]


def test_faults_stand_in_the_response_and_are_kept(caplog):
    records = [record(seed=k, noise=0.1 if k == 1 else 0.01) for k in range(6)]
    frf = rid.estimate_frf(records, period=PERIOD)
    (fault,) = frf.faults
    assert (fault.kind, fault.record, fault.where) == ("disturbed", 2, "output y")
    assert 9 < fault.size < 11
    assert str(fault).startswith("record 2: output y differs from period to period")
    assert str(fault) in caplog.text
    assert frf.entry().faults == frf.faults
    with pytest.raises(rid.errors.InputTypeError, match="`faults` must be a sequence of Fault"):
        rid.FrequencyResponse([1.0], [1.0], faults="dead")


def test_whatever_is_no_record_is_refused():
    for wrong in ("record", [], [1.0], None):
        with pytest.raises(rid.errors.InputTypeError, match="`record` must be a TimeRecord or a sequence of them"):
            rid.prepare.record_faults(wrong)
    with pytest.raises(rid.errors.InputError, match="`period` must be at least 2; got 1"):
        rid.prepare.record_faults(record(), period=1)


@pytest.mark.parametrize("seeds", [range(4), slow(range(4, 20))])
def test_sweeps_of_an_open_loop_are_no_feedback(seeds):
    """Pairs of sweeps: in step or a quarter of a turn apart, with and without noise of their measurement."""
    for seed in seeds:
        rng = np.random.default_rng(seed)
        time = np.arange(3000) * 1e-3
        phase = 2 * np.pi * (1.0 + 40 / time[-1] * time) * time
        noise = 1e-3 * (seed % 2) * rng.standard_normal((time.size, 2))
        u = np.stack([np.sin(phase), np.cos(phase) if seed % 4 < 2 else np.sin(phase)], axis=1) + noise
        first = scipy.signal.lfilter([0, 0.01, 0.02], [1, -1.9, 0.95], u @ [1, 0.5])
        second = scipy.signal.lfilter([0, 0.02], [1, -1.8, 0.9], u @ [0.3, 1])
        y = np.stack([first, second], axis=1) + 0.01 * rng.standard_normal((time.size, 2))
        faults = rid.prepare.record_faults(rid.TimeRecord(u, y, dt=1e-3))
        assert "feedback" not in [fault.kind for fault in faults]


@pytest.mark.parametrize("seed", [0, *map(slow, range(1, 8))])
def test_lines_of_a_multisine_that_a_slow_plant_answers_are_no_feedback(seed):
    """They are related over more lags than short autoregressions see, and so are later inputs to what earlier ones made."""
    play = rid.prepare.multisine(band_hz=(11, 250), period=2500, dt=4e-4, minimise_crest=False, seed=seed)
    rng, u = np.random.default_rng(seed), np.tile(play.u[0], (8, 1))
    u = u + 0.05 * u.std() * rng.standard_normal(u.shape)
    y = scipy.signal.lfilter([0, 1e-2], [1, -1.995, 0.9951], u, axis=0)[-4900:]
    u, y = u[-4900:], y + 0.02 * y.std() * rng.standard_normal(y.shape)
    faults = rid.prepare.record_faults(rid.TimeRecord(u, y, dt=4e-4, initial="free"))
    assert "feedback" not in [fault.kind for fault in faults]


@pytest.mark.realdata
def test_the_loop_of_the_cd_player_is_found():
    faults = rid.prepare.record_faults(rid.datasets.load("cdplayer"))
    assert any("follows earlier outputs" in str(fault) for fault in faults)


@pytest.mark.parametrize(("name", "samples"), every_one(["stage", "arm", "heater"], [60, 200, 500]))
def test_an_answer_to_one_step_is_told_nothing(name, samples):
    """It looks like a drift, a tone, a point of operation, or exchanged columns."""
    recipe = recipes()[name]
    for seed in range(6):
        one = step(recipe, np.random.default_rng([seed, *map(ord, name)]), samples=samples).with_bound(None)
        assert rid.prepare.record_faults(one) == ()


def test_an_excitation_on_every_third_line_repeats_between_two_samples_and_its_whole_period_is_found():
    rng, spectrum = np.random.default_rng(3), np.zeros(251, complex)
    spectrum[3:200:3] = np.exp(2j * np.pi * rng.random(66))
    drive = np.tile(np.fft.irfft(spectrum, 500), 6)
    noisy = drive + 0.05 * drive.std() * rng.standard_normal(drive.size)
    assert [found_period(rid.TimeRecord(u, u, dt=1.0)) for u in (drive, noisy)] == [500, 500]
    narrow = scipy.signal.lfilter([1.0], [1, -1.9, 0.98], rng.standard_normal(3000))
    assert found_period(rid.TimeRecord(narrow, narrow, dt=1.0)) is None


def test_the_output_of_an_unstable_plant_in_its_loop_is_not_early():
    """Stable models have it from later inputs: with the reference, and under the controller that ran, nothing is to be undone."""
    dt, rng = 0.001, np.random.default_rng(0)
    plant, controller = (
        control.ss(control.c2d(control.tf([2e4], [1, 10, -2.5e3]), dt)),
        control.tf([5.61, -5.39], [1, -0.6], dt),
    )
    r, noise = np.tile(rng.standard_normal(1024), 4), 0.002 * rng.standard_normal(4096)
    closed, seen = control.feedback(plant, controller), control.feedback(1, plant * controller)
    y = control.forced_response(closed, inputs=r).outputs + control.forced_response(seen, inputs=noise).outputs
    u = r - control.forced_response(controller, inputs=y).outputs
    record = rid.TimeRecord(u, y, dt=dt, reference=r)
    assert not rid.prepare.record_faults(record, period=1024)
    without = rid.TimeRecord(u, y, dt=dt)
    assert {one.kind for one in rid.prepare.record_faults(without, period=1024)} & {FaultKind.LATE, FaultKind.FEEDBACK}
    assert not rid.prepare.loop_response(without, rid.Loop(controller), period=1024).faults


@pytest.mark.parametrize("b", [[1.0, -1.2, 0.5], [0.3], [1.0, -2.0, 1.0]])
def test_a_simulated_plant_with_a_direct_term_is_no_feedback(b):
    """Without noise its input follows from its output, as that of a controller does; the last one gives an acceleration."""
    rng, a = np.random.default_rng(5), [1.0, -1.6, 0.9]
    white, steps = rng.standard_normal(2000), np.repeat(rng.standard_normal(50), 40)
    for u in (white, scipy.signal.lfilter([1.0], [1, -0.8], white), steps + 0.5):
        y = np.stack([scipy.signal.lfilter(one, a, u) for one in (b, [2.0, 0.1])], axis=1)
        assert "feedback" not in [fault.kind for fault in rid.prepare.record_faults(rid.TimeRecord(u, y, dt=0.01))]


@pytest.mark.parametrize(("num", "den"), [([2.0, -1.9], [1.0, -1.0]), ([0.4], [1.0]), ([2.0, -1.8], [1.0, -0.5])])
def test_an_input_that_only_a_controller_moves_is_told(num, den):
    """From zero initial conditions too: a controller with an integrator, a gain, and a lead."""
    rng, d, y, u = np.random.default_rng(6), np.zeros(2000), np.zeros(2000), np.zeros(2000)
    d = scipy.signal.lfilter([1.0], [1, -0.9], rng.standard_normal(2000))
    for k in range(2000):  # y = 0.1/(z - 0.5) u + d
        y[k] = d[k] - 0.5 * d[k - 1] + 0.5 * y[k - 1] + 0.1 * u[k - 1] if k else d[0]
        past = sum(n * y[k - i] for i, n in enumerate(num) if k >= i)
        u[k] = -past - sum(m * u[k - i] for i, m in enumerate(den) if k >= i > 0)
    faults = rid.prepare.record_faults(rid.TimeRecord(u, y, dt=0.01))
    assert "feedback" in [fault.kind for fault in faults]


@pytest.mark.parametrize("seed", seeds(3, 30))
def test_sweeps_in_a_loop_have_lost_no_samples(seed):
    """What the first third foretells of frequencies that did not move it is no delay, put in or lost."""
    rng, samples, dt = np.random.default_rng(seed), 12000, 2e-3
    plant = control.c2d(control.ss(control.tf([rng.uniform(20, 60)], [1, 6, 0]) * control.tf([1], [0.02, 1])), dt)
    gain, time = rng.uniform(0.3, 0.9), np.arange(samples) * dt
    sensitivity = control.feedback(control.ss([], [], [], [[1.0]], dt), gain * plant)
    r = 0.5 * scipy.signal.chirp(time, 0.2, time[-1], 30)
    noise = 0.002 * rng.standard_normal(samples)
    y = control.forced_response(gain * plant * sensitivity, time, r).outputs
    y = y + control.forced_response(sensitivity, time, noise).outputs
    given = rid.TimeRecord(gain * (r - y), y, dt=dt, reference=r)
    assert FaultKind.LOST not in {fault.kind for fault in rid.prepare.record_faults(given)}


@pytest.mark.parametrize("seed", seeds(3, 30))
def test_sweeps_beyond_a_mode_have_lost_no_samples(seed):
    rng, samples, dt = np.random.default_rng(seed), 20000, 2e-3
    w = 2 * np.pi * 8
    plant = control.c2d(control.ss(control.tf([2000], [1, 0.04 * w, w**2])), dt)
    time = np.arange(samples) * dt
    u = 0.5 * scipy.signal.chirp(time, 0.2, time[-1], 30)
    y = control.forced_response(plant, time, u).outputs + 0.002 * rng.standard_normal(samples)
    assert FaultKind.LOST not in {fault.kind for fault in rid.prepare.record_faults(rid.TimeRecord(u, y, dt=dt))}

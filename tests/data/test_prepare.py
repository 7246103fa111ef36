"""Windows, offsets, drifts and sample rates: the relation of input and output stays, and a hard bound stays hard."""

import control
import numpy as np
import pytest

import robustid as rid
from robustid.core import simulate
from robustid.errors import InputError, InputTypeError
from robustid.identification import model_residuals
from support.refusals import refusals

pytestmark = pytest.mark.quick
DT = 0.01
PLANT = control.ss(control.c2d(control.tf([900.0], [1, 6, 900]), DT))  # 30 rad/s, damping 0.1: e^-3 a second
PRIOR = rid.Prior(gain_bound=100.0, decay_rate=1.02)


def truth(model, omega):
    return np.array([model(np.exp(1j * w * DT)) for w in omega])


def record_of(u, *, errors=0.0, **options):
    u = np.asarray(u, float)
    return rid.TimeRecord(u, simulate(PLANT, u[:, None])[0][:, 0] + errors, dt=DT, **options)


def steady(period, periods, rng):
    """Whole periods of a random input, after a hundred seconds of it."""
    u = np.tile(rng.standard_normal(period), periods + -(-10000 // period))
    record = record_of(u)
    return record.window((u.size - periods * period) * DT, past="periodic")


def ratios(record):
    """|y - model|/bound of the true plant at the used samples, by the identification's own residuals."""
    problem = rid.MixedProblem(time=record, prior=PRIOR)
    return np.concatenate([r.ratio for r in model_residuals(problem, PLANT)])


# --- windows


def test_a_window_from_rest_knows_what_the_input_did_before():
    rng = np.random.default_rng(3)
    errors = rng.uniform(-0.01, 0.01, 300)
    record = record_of(np.where(np.arange(300) < 100, 1.0, 0.0), errors=errors, bound=0.01)
    window = record.window(1.2, 2.0)
    assert window.u.shape == (200, 1)
    used = np.isfinite(window.bound[:, 0])
    np.testing.assert_array_equal(np.flatnonzero(used), np.arange(120, 200))
    assert ratios(window).size == 80
    assert ratios(window).max() <= 1 + 1e-9
    # The same window cut off: the input is zero in it, and without the past nothing explains the ringing output.
    alone = rid.TimeRecord(record.u[120:200], record.y[120:200], dt=DT, bound=0.01)
    assert ratios(alone).max() > 5
    # With the past unknown the prior allows for it.
    unknown = record.window(1.2, 2.0, past="unknown")
    assert (unknown.initial, unknown.past_input_bound, len(unknown.u)) == ("free", 1.0, 80)
    assert ratios(unknown).max() <= 1


def test_a_window_of_a_periodic_record_keeps_the_period():
    record = steady(64, 1, np.random.default_rng(1)).with_bound(1e-6)
    window = record.window(0.1, 0.3)
    assert window.initial == "periodic"
    np.testing.assert_array_equal(window.u, record.u)
    np.testing.assert_array_equal(np.flatnonzero(np.isfinite(window.bound[:, 0])), np.arange(10, 30))
    assert ratios(window).max() <= 1
    assert record.window(0.0, 0.1, past="unknown").past_input_bound == np.abs(record.u[10:]).max()


def test_a_window_from_an_unknown_state_keeps_the_bound_on_its_past():
    record = rid.TimeRecord(np.arange(5.0), np.ones(5), dt=0.1, bound=1.0, initial="free")
    assert record.window(0.0, 0.3).past_input_bound == 4.0
    assert record.window(0.2, 0.3, past="unknown").past_input_bound == 4.0
    assert record.window(0.3, 0.5).initial == "free"
    named = rid.TimeRecord(np.arange(5.0), np.ones(5), dt=0.1, initial="free", past_input_bound=0.5)
    assert named.window(0.2, past="unknown").past_input_bound == 1.0


@pytest.mark.parametrize("k", [1, 3, 7, 29, 57, 300])
def test_instants_are_not_missed_by_rounding(k):
    record = rid.TimeRecord(np.arange(400.0), np.zeros(400), dt=0.1, bound=1.0)
    assert record.window(k * 0.1, past="unknown").u[0, 0] == k
    assert record.window(record.time[k], past="unknown").u[0, 0] == k
    assert record.window(0, k / 10).u[-1, 0] == k - 1
    assert record.window((k - 0.5) * 0.1, past="unknown").u[0, 0] == k


FIVE = rid.TimeRecord(np.ones(5), np.ones(5), dt=0.1, bound=1.0)

test_window_refuses = refusals(
    (lambda: FIVE.window(0.3, 0.3), "must enclose samples of the record, which lasts from 0 to 0.5 s"),
    (lambda: FIVE.window(-0.1, 0.3), "must enclose samples"),
    (lambda: FIVE.window(0.1, 0.7), "must enclose samples"),
    (lambda: FIVE.window(0.1, 0.2, past="zero"), "`past` must be one of"),
    (lambda: FIVE.window(np.nan, 0.2), "`start` must be finite"),
    (lambda: rid.TimeRecord(np.ones(5), np.ones(5), dt=0.1).window(0.1), "call with_bound"),
    (lambda: FIVE.with_bound([1, 1, 1, np.inf, np.inf]).window(0.3), "no sample from `start` = 0.3 s on is used"),
)


# --- offsets and drifts


def test_an_offset_of_a_periodic_record_goes_and_every_other_line_stays():
    rng = np.random.default_rng(0)
    record = steady(50, 4, rng)
    offset = rid.TimeRecord(record.u + 3, record.y + 7, dt=DT, initial="periodic", reference=record.u + 1)
    level = rid.prepare.detrend(offset)
    for name in ("u", "y", "reference"):
        old, new = (np.fft.rfft(getattr(r, name), axis=0) for r in (offset, level))
        np.testing.assert_allclose(new[1:], old[1:], atol=1e-10)
        np.testing.assert_allclose(new[0], 0, atol=1e-10)


def test_the_bound_of_a_detrended_record_holds_and_is_attained():
    """Worst errors: one sample up and all others down, in a mean; by the signs of the weights, in a line."""
    rng = np.random.default_rng(0)
    bound, T, fitted = rng.uniform(0.5, 1.5, 40), 40, 15
    u = np.where(np.arange(T) < fitted, 0.0, 1.0)
    clean = record_of(u).y[:, 0]
    for kind, degree in (("mean", 0), ("linear", 1)):
        largest = np.zeros(T)
        fits = np.array([np.polyval(np.polyfit(np.arange(fitted), e, degree), np.arange(T)) for e in np.eye(fitted)])
        for k in range(T):
            weights = np.eye(T)[k].copy()
            weights[:fitted] -= fits[:, k]
            errors = np.sign(weights) * bound
            record = rid.TimeRecord(
                u, clean + errors + 4.0 + (kind == "linear") * 0.1 * np.arange(T), dt=DT, bound=bound
            )
            level = rid.prepare.detrend(record, kind=kind, until=fitted * DT)
            np.testing.assert_array_equal(level.u, record.u)
            largest[k] = abs(level.y[k, 0] - clean[k])
            assert np.all(np.abs(level.y[:, 0] - clean) <= level.bound[:, 0] * (1 + 1e-12))
        tightest = largest / level.bound[:, 0]
        # Outside the fitted stretch the mean's bound is attained; elsewhere the sample itself is in the fit.
        assert tightest.min() > 0.5
        if kind == "mean":
            np.testing.assert_allclose(tightest[fitted:], 1, rtol=1e-12)


def test_a_mean_of_a_periodic_record_keeps_the_bound_hard():
    rng = np.random.default_rng(5)
    record = steady(30, 1, rng)
    centred = record.y - record.y.mean()
    bound = rng.uniform(0.1, 1.0, 30)
    for k in range(30):
        errors = np.where(np.arange(30) == k, 1.0, -1.0) * bound
        level = rid.prepare.detrend(
            rid.TimeRecord(record.u, record.y[:, 0] + errors + 9, dt=DT, bound=bound, initial="periodic")
        )
        error = np.abs(level.y - centred)
        assert np.all(error <= level.bound)
        assert error[k] > 0.9 * level.bound[k]


def test_a_line_is_taken_from_every_signal_of_a_record_from_an_unknown_state():
    time = np.arange(30.0)
    record = rid.TimeRecord(2 + time, 5 - 3 * time, dt=DT, initial="free", past_input_bound=10.0)
    level = rid.prepare.detrend(record, kind="linear")
    np.testing.assert_allclose(np.concatenate([level.u, level.y]), 0, atol=1e-12)
    assert level.past_input_bound >= 10 + np.abs(record.u).max() - 1e-9


RISING = {"u": [0.0, 0.0, 1.0, 2.0], "y": np.ones(4), "dt": DT}

test_detrend_refuses = refusals(
    (({}, {}), "`until` is needed for a record from zero initial conditions"),
    (({}, {"until": 0.03}), "`until` = 0.03 s: the input acts from 0.02 s on"),
    (({}, {"until": 0.01}), "holds 1 sample; give at least two"),
    (({}, {"kind": "cubic"}), '`kind` must be "mean" or "linear"'),
    (({"initial": "periodic"}, {"kind": "linear"}), "a drift can't be told from the response"),
    (({"initial": "periodic"}, {"until": 0.02}), "`until` is for records from zero initial conditions"),
    (({"initial": "free", "bound": 1.0}, {}), "a bound and an unknown initial state"),
    (({"bound": [np.inf, 1, 1, 1]}, {"until": 0.02}), "has unused samples"),
    of=lambda options, how: rid.prepare.detrend(rid.TimeRecord(**RISING, **options), **how),
)


# --- decimation


@pytest.mark.parametrize("factor", [2, 3, 5])
def test_decimation_keeps_the_response_in_the_pass_band(factor):
    period = 1200
    record = steady(period, 2, np.random.default_rng(factor))
    slow = rid.prepare.decimate(record, factor)
    assert (record.held, slow.held) == (True, False)
    assert (slow.u.shape[0], slow.initial) == (2 * period // factor, "periodic")
    lines = np.arange(1, int(0.8 * period / factor / 2) + 1)
    fast_u, fast_y = (np.fft.rfft(s[:period, 0])[lines] / period for s in (record.u, record.y))
    slow_u, slow_y = (np.fft.rfft(s[: period // factor, 0])[lines] / (period // factor) for s in (slow.u, slow.y))
    np.testing.assert_allclose(slow_u, fast_u, atol=5e-4 * np.abs(fast_u).max())
    omega = 2 * np.pi * lines / (period * DT)
    np.testing.assert_allclose(slow_y / slow_u, truth(PLANT, omega), atol=2e-3 * np.abs(truth(PLANT, omega)).max())
    np.testing.assert_allclose(slow_y, fast_y, atol=5e-4 * np.abs(fast_y).max())


@pytest.mark.parametrize("initial", ["periodic", "rest"])
def test_the_bound_of_a_decimated_record_is_attained_by_the_worst_errors(initial):
    rng = np.random.default_rng(2)
    bound, T, factor = rng.uniform(0.5, 1.5, 600), 600, 2
    slow = rid.prepare.decimate(rid.TimeRecord(np.ones(T), np.zeros(T), dt=DT, bound=bound, initial=initial), factor)
    columns = []
    for block in np.split(np.eye(T), 4, axis=1):  # what one unit of every sample does
        columns.append(rid.prepare.decimate(rid.TimeRecord(np.ones(T), block, dt=DT, initial=initial), factor).y)
    matrix = np.hstack(columns)
    largest = np.abs(matrix) @ bound
    np.testing.assert_allclose(slow.bound[:, 0], largest, rtol=1e-12)


def test_samples_whose_filter_reaches_outside_are_dropped():
    T, factor = 1000, 4
    time = np.arange(T)
    record = rid.TimeRecord(np.ones(T), 1.0 * time, dt=DT)
    slow = rid.prepare.decimate(record, factor)
    # A symmetric filter of gain 1 leaves a straight line alone: the samples that are left are known in advance.
    np.testing.assert_allclose(slow.y[:, 0], time[26 * factor : T - 26 * factor : factor], rtol=1e-12)
    np.testing.assert_allclose(slow.u, 1, rtol=1e-12)
    assert (slow.dt, slow.initial) == (factor * DT, "free")
    assert slow.past_input_bound > 1


def test_what_would_alias_is_blocked():
    T, factor = 2000, 4
    fast = np.cos(2 * np.pi * 390 * np.arange(T) / T)  # above the new Nyquist line, 250
    record = rid.TimeRecord(fast, fast, dt=DT, initial="periodic")
    assert np.abs(rid.prepare.decimate(record, factor).y).max() < 1.1e-4


def test_unused_samples_stay_unused():
    bound = np.ones(1000)
    bound[500] = np.inf
    slow = rid.prepare.decimate(rid.TimeRecord(np.ones(1000), np.ones(1000), dt=DT, bound=bound), 2)
    touched = np.abs(2 * np.arange(len(slow.u)) + 52 - 500) <= 52
    np.testing.assert_array_equal(np.isinf(slow.bound[:, 0]), touched)


test_decimate_refuses = refusals(
    ((np.ones(1001), 2, "periodic"), "`factor` = 2 must divide the 1001 samples"),
    ((np.ones(100), 2, "rest"), "`record` has 100 samples, fewer than the filter of `factor` = 2, which has 105"),
    ((np.ones(1000), 1, "rest"), "`factor` must be at least 2"),
    of=lambda u, factor, initial: rid.prepare.decimate(rid.TimeRecord(u, u, dt=DT, initial=initial), factor),
)


# --- what is wrong with a record


def test_faults_are_named():
    rng = np.random.default_rng(0)
    u = rng.standard_normal((500, 2))
    u[:, 1] = 0.5
    y = np.stack([np.clip(u[:, 0], -10, 0.8), np.full(500, 3.0), u[:, 0]], axis=1)
    record = rid.TimeRecord(u, y, dt=DT, inputs=["force", "valve"], outputs=["x", "y", "z"])
    count = int(np.sum(u[:, 0] >= 0.8))
    assert tuple(map(str, rid.prepare.record_faults(record))) == (
        "input valve is constant (0.5): it excites nothing",
        "output y is constant (3): a sensor that is not connected, or saturated",
        f"output x is at its largest value, 0.8, in {count} of 500 samples: it looks saturated, and no linear model gives"
        " such samples",
    )


def test_sound_records_have_no_faults():
    rng = np.random.default_rng(0)
    time = np.arange(5000)
    wave = np.sin(2 * np.pi * time / 100)
    for y in (wave, np.round(20 * wave), rng.standard_normal(5000), np.round(3 * rng.standard_normal(5000))):
        assert rid.prepare.record_faults(rid.TimeRecord(np.sign(wave + 0.01), y, dt=DT), period=100) == ()


def test_a_time_vector_has_its_step():
    assert rid.prepare.sample_time(0.25 * np.arange(9)) == 0.25


test_what_is_no_record_is_refused = refusals(
    (lambda: rid.prepare.sample_time([0.0, 1.0, 2.0, 4.0, 5.0]), "the time is not uniform: from 2 s"),
    (lambda: rid.prepare.decimate(np.ones(3), 2), "TimeRecord", InputTypeError),
)


def test_of_instants_with_a_gap_the_longest_part_without_one_is_told():
    time = np.delete(np.arange(500) / 7, slice(120, 140))
    with pytest.raises(InputError, match=r"longest part without a gap are the samples 120 to 479: .* u\[120:480\]"):
        rid.prepare.sample_time(time)
    assert rid.prepare.sample_time(time[120:480]) == pytest.approx(1 / 7)
    time[130:] += 1e-3 * np.sin(np.arange(350))  # jitter in what is left: no part is uniform
    with pytest.raises(InputError, match="s; resample the record"):
        rid.prepare.sample_time(time)

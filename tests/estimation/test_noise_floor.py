"""Bounds from a record without excitation: the levels by hand, and the probabilities that are stated by simulation."""

import numpy as np
import pytest

import robustid as rid
from robustid.errors import InputTypeError
from robustid.estimation import response_alone
from support.cases import slow
from support.refusals import refusals

DT, PERIOD = 0.01, 64


def at_rest(y, inputs=1, **options):
    return rid.TimeRecord(np.zeros((len(y), inputs)), y, dt=DT, **options)


def periodic(u, y):
    return rid.TimeRecord(u, y, dt=DT, initial="periodic")


def multisine(rng, periods=1, lines=range(1, 31)):
    phase = rng.uniform(0, 2 * np.pi, len(lines))
    return np.tile(np.cos(2 * np.pi * np.outer(np.arange(PERIOD), lines) / PERIOD + phase).sum(axis=1), periods)


# --- samples


def test_the_level_is_the_factor_times_the_largest_deviation_of_each_output():
    y = np.array([[1.0, -5.0], [3.0, -5.5], [2.0, -3.0], [2.0, -6.5]])
    noise = rid.prepare.bounds_from_noise_floor(at_rest(y), factor=2.0)
    np.testing.assert_allclose(noise.mean, [2, -5])
    np.testing.assert_allclose(noise.level, [2, 4])
    record = noise.bound_record(rid.TimeRecord(np.ones(3), np.ones((3, 2)), dt=DT, bound=[1.0, np.inf, 1.0]))
    np.testing.assert_array_equal(record.bound, [[2, 4], [np.inf, np.inf], [2, 4]])
    np.testing.assert_allclose(record.y, np.tile([-1.0, 6.0], (3, 1)))
    assert record.bound.kind == "noise_floor"
    assert record.bound.words(record.note).startswith(
        "bound from the noise floor: 2 times the largest deviation in 4 samples without excitation"
    )
    own = record.with_bound(0.5, note="calibration")
    assert (own.bound.kind, own.note, own.bound[0, 0]) == ("hard", "calibration", 0.5)


def test_a_stretch_of_a_record_will_do():
    rng = np.random.default_rng(0)
    noise = 0.01 * rng.standard_normal(400)
    u = np.where(np.arange(400) < 300, 0.0, 1.0)
    record = rid.TimeRecord(u, 3 + u + noise, dt=DT)
    found = rid.prepare.bounds_from_noise_floor(record.window(0.0, 3.0, past="unknown"))
    np.testing.assert_allclose(found.level, 1.5 * np.abs(noise[:300] - noise[:300].mean()).max(), rtol=1e-9)
    bounded = found.bound_record(record).window(3.0)
    assert np.isfinite(bounded.bound).sum() == 100
    assert np.abs(bounded.y[300:] - 1).max() < found.level[0]


@pytest.mark.parametrize("distribution", ["laplace", *(slow(k) for k in ("uniform", "normal"))])
def test_the_probability_of_the_order_statistics_holds_in_simulation(distribution):
    T, N, trials = 100, 40, 3000
    samples = getattr(np.random.default_rng(7), distribution)(size=(trials, T + N))
    inside = 0
    for row in samples:
        noise = rid.prepare.bounds_from_noise_floor(at_rest(row[:T]), factor=1.0)
        inside += np.abs(row[T:] - noise.mean).max() <= noise.level[0]
    stated = noise.probability(N)
    assert stated == pytest.approx(T / (T + N), rel=1e-12)
    # The mean of the rest is a little nearer to the rest than to other samples.
    assert abs(inside / trials - stated) < 3 * np.sqrt(stated * (1 - stated) / trials) + 0.01


@pytest.mark.parametrize(("factor", "low", "high"), [(1.0, 0.42, 0.58), (1.5, 0.99, 1.0)])
def test_normal_noise_stays_within_the_default_factor(factor, low, high):
    rng = np.random.default_rng(1)
    rows = rng.standard_normal((500, 2000))
    floors = [rid.prepare.bounds_from_noise_floor(at_rest(row[:1000]), factor=factor) for row in rows]
    inside = [np.abs(row[1000:] - floor.mean).max() <= floor.level[0] for row, floor in zip(rows, floors, strict=True)]
    assert low <= np.mean(inside) <= high


# --- frequency responses


def test_one_tone_at_rest_gives_the_bound_by_hand():
    """Amplitude a at a line is |DFT| = a/2; U = [[1, 1], [1, -2]]/2: the columns of |U^-1| sum to 2 and 4/3."""
    rng = np.random.default_rng(3)
    one = multisine(rng, 16)
    experiments = [np.stack([one, one], axis=1), np.stack([one, -2 * one], axis=1)]
    tone = 0.1 * np.cos(2 * np.pi * 7 * np.arange(16 * PERIOD) / PERIOD)
    outputs = np.stack([tone, 3 * tone], axis=1)
    records = [periodic(u, u @ np.array([[1.0, 2.0], [0.0, 1.0]])) for u in experiments]
    played = [periodic(r.u, r.y + 1e-6 * rng.standard_normal(r.y.shape)) for r in records]
    frf = rid.estimate_frf(played, period=PERIOD, lines=range(1, 31))
    noise = rid.prepare.bounds_from_noise_floor(at_rest(outputs, inputs=2), factor=1.25)
    bounded = noise.bound_response(frf, records, period=PERIOD)
    by_hand = 1.25 * np.outer([0.05, 0.15], [2, 4 / 3])
    np.testing.assert_allclose(bounded.bound[6], by_hand, rtol=1e-9)
    assert np.all(bounded.bound[25] < 1e-12)  # 304 bins away from the tone
    assert bounded.bound.kind == "noise_floor"
    assert "in windows of 16 of the 16 periods" in bounded.note


def simulate_bounds(seeds, factor, rest_periods, periods, lines=range(1, 31)):
    """Errors of the estimate over the bound from rest, (seeds, lines), and the note."""
    out = []
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        u = multisine(rng, periods)
        record = periodic(u, 2 * u + 0.1 * rng.standard_normal(u.size))
        frf = response_alone(record, period=PERIOD, lines=lines)
        rest = at_rest(0.1 * rng.standard_normal(rest_periods * PERIOD))
        noise = rid.prepare.bounds_from_noise_floor(rest, factor=factor)
        bounded = noise.bound_response(frf, record, period=PERIOD)
        out.append(np.abs(bounded.values - 2)[:, 0, 0] / bounded.bound[:, 0, 0])
    return np.array(out), bounded.note


@pytest.mark.parametrize("seeds", [40, slow(300)])
def test_a_line_goes_beyond_as_often_as_the_formula_says(seeds):
    """Factor 1: prod i/(i + 1) = 1/(m + 1), m = 100."""
    ratio, _ = simulate_bounds(seeds, 1.0, 32, 8)
    expected = ratio.size / 101
    assert abs(np.sum(ratio > 1) - expected) < 5 * np.sqrt(expected)


@pytest.mark.parametrize(("seeds", "slack"), [(60, 0.03), slow(200, 0.01)])
def test_the_default_factor_holds_on_all_lines_as_often_as_stated(seeds, slack):
    """Up to two more than stated in either version."""
    ratio, note = simulate_bounds(seeds, 1.5, 32, 8)
    stated = float(note.rsplit(" ", 1)[1])
    assert 0.99 < stated < 1
    assert np.mean(np.all(ratio <= 1, axis=1)) >= stated - slack
    # and not by being useless: the typical error is a quarter of it
    assert np.median(ratio) > 0.15


@pytest.mark.parametrize("seeds", [25, slow(60)])
def test_a_short_rest_does_not_count_on_the_averaging(seeds):
    ratio, note = simulate_bounds(seeds, 1.5, 2, 8)
    assert "in windows of 2 of the 8 periods" in note
    assert np.all(ratio < 1)
    longer, _ = simulate_bounds(seeds, 1.5, 32, 8)
    assert 1.6 < np.median(longer) / np.median(ratio) < 2.4  # sqrt(8/2), and the pool of 62 values is smaller


def test_blocks_add_up():
    rng = np.random.default_rng(5)
    u = [multisine(rng), 2 * multisine(rng)]
    records = [periodic(x, x + 0.01 * rng.standard_normal(PERIOD)) for x in u]
    frf = rid.estimate_frf(records, lines=range(1, 31))
    noise = rid.prepare.bounds_from_noise_floor(at_rest(rng.standard_normal(256)))
    both = noise.bound_response(frf, records).bound
    np.testing.assert_allclose(both, sum(noise.bound_response(frf, [r]).bound for r in records) / 2, rtol=1e-12)


def test_units_scale_exactly():
    rng = np.random.default_rng(6)
    u, rest = multisine(rng, 2), rng.standard_normal(512)
    y = 2 * u + rng.standard_normal(u.size)
    frf = rid.estimate_frf(periodic(u, y), period=PERIOD)
    plain = rid.prepare.bounds_from_noise_floor(at_rest(rest)).bound_response(frf, periodic(u, y), period=PERIOD)
    s = 2.0**-60
    noise = rid.prepare.bounds_from_noise_floor(at_rest(s * rest))
    scaled = noise.bound_response(frf, periodic(u, s * y), period=PERIOD)
    np.testing.assert_array_equal(scaled.bound, s * plain.bound)


# --- misuse

U = multisine(np.random.default_rng(0), 2)
FRF = rid.estimate_frf(periodic(U, U + 0.1 * np.random.default_rng(1).standard_normal(U.size)), period=PERIOD)
TWO = rid.FrequencyResponse(FRF.omega, np.ones((FRF.omega.size, 2, 1)), dt=DT)
NOISE = np.random.default_rng(2).standard_normal(200)


test_bounds_from_rest_refuses = refusals(
    ((np.ones(4),), "`record` must be a TimeRecord", InputTypeError),
    ({"record": at_rest(NOISE), "factor": 0.9}, "`factor` must be at least 1"),
    ((at_rest(np.ones(9)),), "output y is exactly constant"),
    ((at_rest(NOISE, bound=np.where(np.arange(200) == 5, 1.0, np.inf)),), "has 1 used sample"),
    of=rid.prepare.bounds_from_noise_floor,
)


def bounded(rest, frf=FRF, records=periodic(U, U), period=PERIOD):  # noqa: B008
    return rid.prepare.bounds_from_noise_floor(rest).bound_response(frf, records, period=period)


test_bound_response_refuses = refusals(
    ({"rest": at_rest(NOISE[:60])}, "has 60 samples, fewer than one period of 64"),
    ({"rest": at_rest(NOISE), "period": 50}, "`period` = 50 must divide the 128 samples"),
    ({"rest": at_rest(NOISE), "period": 32}, "frequency points between the spectral lines of `period` = 32"),
    ({"rest": at_rest(NOISE), "records": rid.TimeRecord(U, U, dt=0.02)}, "dt = 0.02 s, the noise-floor record 0.01 s"),
    ({"rest": at_rest(NOISE[:, None] * [1, 1])}, "1 output and 1 input, the noise-floor record 2 and 1"),
    ({"rest": rid.TimeRecord(U[:100], NOISE[:100], dt=DT)}, "it was not still"),
    ({"rest": at_rest(NOISE), "frf": TWO}, "the records 1 output and 1 input"),
    ({"rest": at_rest(NOISE), "frf": periodic(U, U)}, "`frf` must be a FrequencyResponse", InputTypeError),
    of=bounded,
)

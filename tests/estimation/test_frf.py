"""Calibration of estimate_frf on a lightly damped 2x2 plant in a feedback loop: periodic and random excitation."""

import dataclasses

import control
import numpy as np
import pytest
from scipy.signal import lfilter

from robustid.data import TimeRecord
from robustid.estimation import estimate_frf, response_alone
from support.cases import slow
from support.refusals import refused

DT, PERIOD = 1e-3, 2048
LINES = np.arange(10, 800, 4)
MODES_HZ, DAMPING = np.array([37.3, 118.9, 262.4]), np.array([0.002, 0.005, 0.01])


def plant():
    """Three modes behind a zero-order hold, damping ratios 0.2 to 1 %, each seen by both channels."""
    w, blocks, b, c = 2 * np.pi * MODES_HZ, [], [], []
    shapes = np.array([[1.0, 0.6], [0.8, -1.0], [0.5, 0.9]])
    for wi, di, shape in zip(w, DAMPING, shapes, strict=True):
        blocks.append([[0, wi], [-wi, -2 * di * wi]])
        b += [np.zeros(2), wi * shape]
        c.append(np.column_stack([shape, np.zeros(2)]))
    a = np.zeros((6, 6))
    for k, block in enumerate(blocks):
        a[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = block
    return control.sample_system(control.ss(a, np.array(b), np.hstack(c), 0), DT)


def feedback(gain=0.02):
    """``u = r - C y`` with C(z) = gain (1 - z^-1): damps the modes."""
    return control.ss(np.zeros((2, 2)), np.eye(2), -gain * np.eye(2), gain * np.eye(2), DT)


def simulate(model, inputs):
    """(T, ny) output from rest, one filter for every pole and its conjugate."""
    poles, vectors = np.linalg.eig(model.A)
    drive = np.linalg.solve(vectors, model.B.astype(complex)) * np.where(poles.imag > 0, 2, 1)[:, None]
    upper = poles.imag >= 0
    poles, vectors, drive = poles[upper], vectors[:, upper], inputs @ drive[upper].T
    states = np.stack([lfilter([0, 1], [1, -p], drive[:, k]) for k, p in enumerate(poles)], axis=1)
    return (states @ (model.C @ vectors).T).real + inputs @ model.D.T


class Loop:
    """Responses from (reference, output noise) to (u, y)."""

    def __init__(self, gain=0.02):
        g, c = plant(), feedback(gain)
        n, m = g.nstates, c.nstates
        # y = G u + v; u = r - C y, G strictly proper.
        a = np.block([[g.A - g.B @ c.D @ g.C, -g.B @ c.C], [c.B @ g.C, c.A]])
        b = np.block([[g.B, -g.B @ c.D], [np.zeros((m, 2)), c.B]])
        rows = np.block([[-c.D @ g.C, -c.C], [g.C, np.zeros((2, m))]])
        d = np.block([[np.eye(2), -c.D], [np.zeros((2, 2)), np.eye(2)]])
        self.system = control.ss(a, b, rows, d, DT)
        assert n + m == len(a)
        assert np.abs(np.linalg.eigvals(a)).max() < 1
        self.decay = np.log(1e-7) / np.log(np.abs(np.linalg.eigvals(a)).max())

    def record(self, r, rng, noise, lead):
        """The record after `lead` samples: noise is this part of the rms of y, in the loop, and of u where it is read."""
        clean = simulate(self.system, np.hstack([r, np.zeros_like(r)]))[:, 2:]
        size = noise * clean[lead:].std(axis=0)
        out = simulate(self.system, np.hstack([r, size * rng.standard_normal(r.shape)]))[lead:]
        u = out[:, :2] + noise * out[:, :2].std(axis=0) * rng.standard_normal((len(out), 2))
        return TimeRecord(u, out[:, 2:], dt=DT, reference=r[lead:], initial="periodic")


def truth(omega):
    return np.moveaxis(plant()(np.exp(1j * omega * DT)), -1, 0)


def multisines(rng, realisations, periods):
    """Orthogonal pairs of multisines, two experiments a realisation."""
    out = []
    for _ in range(realisations):
        spectra = np.zeros((2, PERIOD // 2 + 1), complex)
        spectra[:, LINES] = np.exp(2j * np.pi * rng.uniform(size=(2, LINES.size))) * PERIOD / 2
        first, second = np.fft.irfft(spectra, axis=1)
        for sign in (1, -1):
            out.append(np.tile(np.column_stack([first, sign * second]), (periods, 1)))
    return out


NOISE = 0.01
SAMPLES = 20_000


def deviations(frf):
    lines, ny, nu = frf.values.shape
    return np.sqrt(np.einsum("fii->fi", frf.covariance).real).reshape(lines, nu, ny).transpose(0, 2, 1)


def periodic(loop, rng, periods=8, realisations=4):
    """Steady multisines: eight periods of two experiments in each of four realisations."""
    lead = int(-(-loop.decay // PERIOD)) * PERIOD
    signals = multisines(rng, realisations, periods + lead // PERIOD)
    return response_alone([loop.record(r, rng, NOISE, lead) for r in signals], period=PERIOD)


def random_closed(loop, rng):
    lead = int(loop.decay)
    record = loop.record(rng.standard_normal((SAMPLES + lead, 2)), rng, NOISE, lead)
    return response_alone(dataclasses.replace(record, initial="free"), lines=local_lines())


def random_open(loop, rng):
    u = rng.standard_normal((SAMPLES, 2))
    y = simulate(plant(), u)
    record = TimeRecord(u, y + NOISE * y.std(axis=0) * rng.standard_normal(y.shape), dt=DT)
    return response_alone(record, lines=local_lines())


def local_lines():
    """250 lines from 20 to 390 Hz, and all around the peaks."""
    around = np.round(MODES_HZ * SAMPLES * DT)[:, None] + np.arange(-3, 4)
    return np.unique(np.concatenate([np.round(np.geomspace(20, 390, 250) * SAMPLES * DT), around.ravel()])).astype(int)


def calibration(measure, seeds):
    """Seeds in which the joint bound holds, mean square of error over standard deviation, largest bias over its own deviation."""
    loop, held, squares, errors, spreads = Loop(), 0, [], [], []
    for seed in seeds:
        frf = measure(loop, np.random.default_rng(seed))
        error, spread = frf.values - truth(frf.omega), deviations(frf)
        held += bool(np.all(np.abs(error) <= frf.bound))
        squares.append(np.mean(np.abs(error / spread) ** 2))
        errors.append(error)
        spreads.append(spread**2)
    own = np.sqrt(np.mean(spreads, axis=0) / len(errors))
    return held, float(np.mean(squares)), float(np.max(np.abs(np.mean(errors, axis=0)) / own))


def fewer_periodic(loop, rng):
    """Two realisations."""
    return periodic(loop, rng, realisations=2)


SLOW = [(periodic, 3.7), (random_open, 3.7), (random_closed, 0.5 * 200**0.5)]


@pytest.mark.parametrize(
    ("measure", "most", "seeds", "held_in"),
    [
        (random_closed, 4, 4, (2, 4)),
        *(slow(measure, 4, 12, (9, 12)) for measure in (fewer_periodic, random_open, random_closed)),
        *(slow(*each, 200, (180, 198)) for each in SLOW),
    ],
)
def test_calibrated(measure, most, seeds, held_in):
    """Joint bound of 95 % in 90 to 99 % of the seeds, mean square of error over standard deviation 0.9 to 1.1.

    The small version: 4 seeds, so that the mean square is known to about 4 %; 3.5 deviations bound 800 normal biases, and a bound
    of 95 % fails in more than 2 of 4 once in 2000.

    The mean error of a line over its own deviation: 800 complex numbers that are normal stay below sqrt(log(800/0.001)) =
    3.7 with a probability of 0.999. In closed loop the local model itself errs by a third of the standard deviation of one
    estimate at the flank of the lightest mode: less than a half.
    """
    held, square, bias = calibration(measure, range(seeds))
    assert 0.9 <= square <= 1.1
    assert held_in[0] <= held <= held_in[1]
    assert bias < most


@pytest.mark.slow
@pytest.mark.parametrize(("seeds", "apart"), [(3, 0.15), slow(30, 0.05)])
def test_one_record_of_a_loop_needs_its_reference(seeds, apart):
    """Without the reference, the noise that the loop feeds back biases the local method; with it, not.

    Mean square of errors over their deviations, mean of the seeds: 1 with it; without it 1.87 (1.5 to 2.4 in 30 seeds), where
    the joint bound of 95 % holds in none.
    """
    loop, lead, misses, held = Loop(gain=0.05), 20_000, ([], []), [0, 0]
    lines = np.round(np.linspace(30, 300, 120) * 60_000 * DT).astype(int)
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        record = loop.record(0.1 * rng.standard_normal((60_000 + lead, 2)), rng, 0.3, lead)
        for k, reference in enumerate((record.reference, None)):
            frf = response_alone(dataclasses.replace(record, reference=reference, initial="free"), lines=lines)
            error = np.abs(frf.values - truth(frf.omega))
            misses[k].append(np.mean((error / deviations(frf)) ** 2))
            held[k] += bool(np.all(error <= frf.bound))
    assert np.mean(misses[0]) == pytest.approx(1, abs=apart)
    assert np.mean(misses[1]) == pytest.approx(1.87, abs=2 * apart)
    assert held[0] >= 0.6 * seeds
    assert held[1] == 0


@pytest.mark.parametrize("seeds", [1, slow(10)])
def test_peak_of_a_lightly_damped_mode_against_welch(seeds):
    """0.5 % damping, 20 s of noise: local within 2 % for all seeds, Hann windows miss it by 7 % in the median."""
    found, smeared = [], []
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        u = rng.standard_normal((SAMPLES, 2))
        y = simulate(model := plant(), u)
        record = TimeRecord(u, y + NOISE * y.std(axis=0) * rng.standard_normal(y.shape), dt=DT)
        line = round(MODES_HZ[1] * SAMPLES * DT)
        local, welch = response_alone(record, lines=[line]), response_alone(record, method="welch")
        peak = abs(model(np.exp(1j * local.omega[0] * DT))[0, 0])
        nearest = np.argmin(np.abs(welch.omega - local.omega[0]))
        found.append(abs(abs(local.values[0, 0, 0]) / peak - 1))
        smeared.append(abs(abs(welch.values[nearest, 0, 0]) / peak - 1))
    assert max(found) < 0.02
    assert np.median(smeared) > 0.05 > 10 * max(found)
    assert "smeared" in welch.note


def test_the_start_of_a_record_from_rest_is_left_out():
    """Five periods from rest: the first ones hold the transient of the lightly damped modes."""
    loop, rng = Loop(), np.random.default_rng(4)
    records = [loop.record(r, rng, 1e-3, 0) for r in multisines(rng, 1, 12)]
    found = estimate_frf([dataclasses.replace(r, initial="rest") for r in records], period=PERIOD)
    assert "left out (transient)" in found.note
    trusting = estimate_frf(records, period=PERIOD)
    error, spread = [np.median(np.abs(f.values - truth(f.omega)) / np.abs(truth(f.omega))) for f in (found, trusting)]
    assert error < 0.5 * spread


def test_exact_without_noise():
    """A single mode and its transient are rational of order 2: the local method has no error but rounding."""
    model = control.sample_system(control.tf([1.0], [1, 2 * 0.005 * 300, 300**2]), 0.001)
    state = control.ss(model)
    u = np.random.default_rng(0).standard_normal((4000, 1))
    y = simulate(state, u)
    frf = estimate_frf(TimeRecord(u, y, dt=0.001), lines=np.arange(150, 240))
    expected = np.array([model(np.exp(1j * w * 0.001)) for w in frf.omega])
    assert np.max(np.abs(frf.values[:, 0, 0] / expected - 1)) < 1e-3
    at_peak = np.argmax(np.abs(expected))
    assert abs(frf.values[at_peak, 0, 0] / expected[at_peak] - 1) < 1e-5


def test_without_a_method_the_records_decide():
    rng = np.random.default_rng(5)
    record = TimeRecord(u := rng.standard_normal(600), u, dt=0.01)
    assert "local rational" in estimate_frf(record).note
    twice = np.tile(u[:300], 2)
    assert "2 periods" in estimate_frf(TimeRecord(twice, twice, dt=0.01), period=300).note
    refused('`period` belongs to method="periodic"', estimate_frf, record, method="local", period=300)
    refused("the local method needs", estimate_frf, TimeRecord(u[:40], u[:40], dt=0.01))


@pytest.mark.parametrize(("method", "power"), [("local", 60), ("welch", -60), slow("local", -60), slow("welch", 60)])
def test_units_do_not_matter(method, power):
    rng, scale = np.random.default_rng(6), 2.0**power
    u = rng.standard_normal((800, 2))
    y = simulate(plant(), u) + 0.01 * rng.standard_normal(u.shape)
    plain = response_alone(TimeRecord(u, y, dt=DT), method=method)
    for a, b in ((scale, 1), (1, scale)):
        scaled = response_alone(TimeRecord(u * a, y * b, dt=DT), method=method)
        np.testing.assert_allclose(scaled.values * a / b, plain.values, rtol=1e-12)
        np.testing.assert_allclose(scaled.bound * a / b, plain.bound, rtol=1e-9)


@pytest.mark.parametrize("jitter", [0.0, 1e-9])
def test_a_transient_shows_whether_the_input_repeats_exactly_or_almost(jitter):
    rng, time = np.random.default_rng(0), np.arange(1600)
    u = np.tile(rng.standard_normal(100), 16)
    y = u + 10 * np.exp(-3 * time / 100) * np.cos(time) + 0.01 * rng.standard_normal(1600)
    frf = estimate_frf(TimeRecord(u + jitter * rng.standard_normal(1600), y, dt=0.01), period=100)
    assert "the first 2 left out (transient)" in frf.note
    assert np.max(frf.bound) < 0.1


@pytest.mark.parametrize(("records", "most"), [(25, 1), slow(200, 2)])
def test_steady_periods_stay(records, most):
    """White noise on a steady record, an exact input: hardly one of a hundred loses a period."""
    lost = 0
    for seed in range(records):
        rng = np.random.default_rng(seed)
        u = np.tile(rng.standard_normal(64), 8)
        lost += "left out" in response_alone(TimeRecord(u, u + 0.1 * rng.standard_normal(512), dt=0.01), period=64).note
    assert lost <= most

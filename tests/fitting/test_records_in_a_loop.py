"""Records of a plant in a loop: R by least squares, every frequency weighted by the noise that the loop makes of that of y."""

import control
import numpy as np
import pytest
from scipy.signal import lfilter

import robustid as rid
from robustid.core import StateMatrices, response_at
from robustid.fitting.records.record_statement import Lines, whitening
from robustid.identification import loop_noise
from support.loops import as_model, pair_of

POLE, DT = 1.1, 0.01
ANGLES = np.linspace(0.1, 3.0, 7)


def lines_of(samples):
    angles = 2 * np.pi * np.arange(samples // 2 + 1) / samples
    return Lines(
        angles, np.zeros((angles.size, 1)), np.zeros((angles.size, 1)), np.ones(angles.size), samples, "free", None
    )


@pytest.mark.parametrize("seed", range(4))
def test_the_noise_of_the_opened_record_is_what_the_plant_leaves_of_its_output(seed):
    """``z - R x = (D~_x - R N~_c) (y - P u)`` of any u and y: 1x1 to 3x3, plants of any poles."""
    plant, controller = pair_of(seed, DT)
    loop = rid.Loop(as_model(controller, DT), as_model(plant, DT))
    R = StateMatrices.of(loop.residual_of(as_model(StateMatrices(1.01 * plant.A, *plant[1:]), DT)))
    P = StateMatrices.of(loop.plant_of(R.model(DT)))
    points, (nu, ny) = np.exp(1j * ANGLES), loop.shape
    back = response_at(loop.back, points)
    opened = back[:, nu:] - response_at(R, points) @ back[:, :nu]  # from [u; y] to z - R x
    left = np.concatenate([-response_at(P, points), np.broadcast_to(np.eye(ny), (7, ny, ny))], axis=2)
    assert np.allclose(opened, loop_noise(loop, R, ANGLES) @ left, rtol=1e-8, atol=1e-8 * np.abs(opened).max())


def test_whitening_has_the_leakage_of_a_short_record():
    """Expected periodogram of a moving average by hand; the notch of 1 - 1/z at frequency zero has what leaks into it."""
    lines, level = lines_of(20), 3.0
    white = whitening(lambda angles: (1 - np.exp(-1j * angles))[:, None, None], lines, np.array([level]))
    periodogram = level**2 * (2 - 2 * (1 - 1 / 20) * np.cos(lines.angles))
    assert np.allclose(np.abs(white[:, 0, 0]) ** 2 * periodogram, level**2, rtol=1e-10)


def test_whitening_of_two_outputs_gives_their_sources():
    """Covariance of a DFT line by sums over samples; white for the levels, and the inverse filter where nothing leaks."""
    taps, levels = np.array([[[1.0, 0.3], [0.0, 1.0]], [[-0.5, 0.1], [0.7, 0.4]]]), np.array([0.2, 5.0])

    def filters(angles):
        return taps[0] + taps[1] * np.exp(-1j * angles)[:, None, None]

    samples = 12
    white = whitening(filters, lines_of(samples), levels)
    block = np.zeros((samples, 2, samples + 1, 2))  # from sources to samples
    for t in range(samples):
        block[t, :, t + 1], block[t, :, t] = taps[0] * levels, taps[1] * levels
    for k, turn in enumerate(white):
        row = np.exp(-2j * np.pi * k * np.arange(samples) / samples) / np.sqrt(samples)
        line = np.einsum("t,taub->aub", row, block).reshape(2, -1)
        assert np.allclose(turn @ line @ line.conj().T @ turn.conj().T, np.diag(levels**2), atol=1e-9)
    lines = lines_of(4000)
    long = whitening(filters, lines, levels)
    assert np.abs(long @ filters(lines.angles) - np.eye(2)).max() < 0.05


def opened_pair(seed, *, gain=0.9, colour=0.5, sigma=0.3, samples=300):
    """Errors of b and a of R = b/(z - a), with the noise of the loop in the fit, and without."""
    rng, a = np.random.default_rng(seed), POLE - gain
    r, v = lfilter([1], [1, -colour], rng.standard_normal(samples)), sigma * rng.standard_normal(samples)
    y = lfilter([0, 1], [1, -a], r) + lfilter([1, -POLE], [1, -a], v)
    record, loop = rid.TimeRecord(r - gain * y, y, dt=DT), rid.Loop(control.ss([], [], [], gain, DT))
    fits = rid.fit_records(record, order=1, loop=loop), rid.fit_records(loop.opened(record), order=1)
    return fits, np.array([[(fit.C @ fit.B).item() - 1, fit.A.item() - a] for fit in fits])


def predicted(*, gain=0.9, colour=0.5, sigma=0.3, samples=300):
    """Deviations of b and a: least squares with the noise's own weight (Gauss and Markov), and without a weight."""
    z = np.exp(2j * np.pi * np.arange(samples) / samples)
    slopes = np.stack([1 / (z - POLE + gain), 1 / (z - POLE + gain) ** 2], axis=1)
    noise, power = (sigma * np.abs((z - POLE) / (z - POLE + gain))) ** 2, np.abs(1 - colour / z) ** -2

    def information(weight):
        return np.real(slopes.conj().T * (weight * power) @ slopes)

    plain = np.linalg.inv(information(1))
    covariances = np.linalg.inv(information(1 / noise)), plain @ information(noise) @ plain
    return np.sqrt([np.diag(one) for one in covariances])


def test_a_fit_in_a_loop_tells_the_noise_of_the_output():
    """White of level sigma at the output of the plant, whatever the loop makes of it."""
    (fit, plain), errors = opened_pair(0)
    assert np.all(np.abs(errors[0]) < 4 * predicted()[0])
    assert 1 / fit.weight[0] == pytest.approx(0.3, rel=0.12)  # three deviations of 300 samples
    assert 1 / plain.weight[0] > 0.36  # of z: the loop amplifies


@pytest.mark.slow
def test_a_fit_in_a_loop_scatters_as_weighted_least_squares_of_known_noise():
    """Scatter of 60 records against the bound of Gauss and Markov; without the loop's noise it is 1.4 times as wide."""
    errors = np.sqrt(np.mean([opened_pair(seed)[1] ** 2 for seed in range(60)], axis=0))
    ratios = errors / predicted()
    assert np.all(ratios > 0.73), ratios  # three deviations of 60 numbers
    assert np.all(ratios < 1.28), ratios
    assert np.all(errors[1] > 1.25 * errors[0]), errors


def test_a_delay_is_none_of_a_system_that_a_loop_opens():
    record = rid.TimeRecord(np.ones(20), np.arange(20.0), dt=DT)
    with pytest.raises(rid.InputError, match="`delay` must be left out with a `loop`"):
        rid.fit_records(record, order=1, delay=0.02, loop=rid.Loop(control.ss([], [], [], 0.1, DT)))

"""Several inputs in one periodic experiment: told apart over neighbouring lines, with bounds that hold."""

import numpy as np
import pytest
from scipy.signal import lfilter

from robustid import TimeRecord, estimate_frf
from robustid.data import Caveat
from robustid.estimation import bounds_from_noise_floor, response_alone
from support.cases import slow
from tests.support.refusals import refusals

PERIOD, DT = 256, 0.01
PEAKS = ((0.5, 0.01), (0.53, 0.02), (1.7, 0.005))  # rad a sample, damping: the first two within a window


def modes(rng):
    """Poles and residues (2, 2) of three modes."""
    poles = [np.exp((-zeta + 1j * np.sqrt(1 - zeta**2)) * w) for w, zeta in PEAKS]
    return [(p, (1 - abs(p)) * np.outer(*rng.standard_normal((2, 2)))) for p in poles]


def truth(plant, omega):
    z = np.exp(1j * omega * DT)[:, None, None]
    return sum(r / (z - p) + r / (z - p.conj()) for p, r in plant)


def played(plant, u):
    y = np.zeros(u.shape)
    for p, r in plant:
        for i, j in np.ndindex(2, 2):
            y[:, i] += r[i, j] * lfilter([0, 2, -2 * p.real], [1, -2 * p.real, abs(p) ** 2], u[:, j])
    return y


def excitation(rng, how):
    """One period of two inputs: at lines in turn, or both at all lines."""
    spectrum = np.exp(2j * np.pi * rng.random((PERIOD // 2 + 1, 2)))
    spectrum[[0, -1]] = 0
    if how == "in turn":
        spectrum[::2, 0] = spectrum[1::2, 1] = 0
    return np.fft.irfft(spectrum, axis=0)


def measured(rng, how, periods, change=1.0, references=False):
    """A plant and a record of it from rest, with coloured noise."""
    plant, u = modes(rng), np.tile(excitation(rng, how), (periods, 1))
    y = played(plant, u)
    y[len(y) // 2 :] *= change
    noise = lfilter([1], [1, -0.7], rng.standard_normal(y.shape), axis=0)
    y = y + 0.02 * y.std(axis=0) * noise
    return plant, TimeRecord(u, y, dt=DT, reference=u if references else None)


@pytest.mark.parametrize(("count", "most"), [(6, 1), slow(24, 3)])  # at 5 %: more with a chance of 3 %
@pytest.mark.parametrize("how", ["in turn", "random phases"])
def test_the_bound_of_one_experiment_holds(how, count, most):
    outside = 0
    for seed in range(count):
        plant, record = measured(np.random.default_rng(seed), how, 2)
        frf = response_alone(record, period=PERIOD)
        away = np.abs(frf.values - truth(plant, frf.omega))
        outside += bool(np.any(away > frf.bound.radius))
        assert frf.omega.size > 110
        assert np.median(frf.bound.radius) < 0.02 * np.abs(frf.values).max()
    assert outside <= most


def test_a_known_response_is_found_without_noise():
    rng = np.random.default_rng(3)
    u = np.tile(excitation(rng, "in turn"), (2, 1))
    gain = np.array([[1.0, -2.0], [0.5, 3.0]])
    frf = estimate_frf(TimeRecord(u, u @ gain.T, dt=DT, initial="periodic"), period=PERIOD)
    np.testing.assert_allclose(frf.values, np.broadcast_to(gain, frf.values.shape), atol=1e-9)
    assert "mean of 2 periods" in frf.note


def test_the_reference_of_a_loop_is_the_excitation():
    _, record = measured(np.random.default_rng(0), "in turn", 2)
    _, loop = measured(np.random.default_rng(0), "in turn", 2, references=True)
    plain, closed = (response_alone(one, period=PERIOD) for one in (record, loop))
    assert "by the reference" in closed.note
    assert np.all(np.abs(closed.values - plain.values) <= closed.bound.radius + plain.bound.radius)


def test_two_realisations_of_lines_in_turn_are_told_apart():
    rng = np.random.default_rng(5)
    records = [measured(np.random.default_rng(5), "in turn", 2)[1]]
    plant = modes(np.random.default_rng(5))
    u = np.tile(excitation(rng, "in turn"), (2, 1))
    y = played(plant, u)
    records.append(TimeRecord(u, y + 0.02 * y.std(axis=0) * rng.standard_normal(y.shape), dt=DT))
    frf = response_alone(records, period=PERIOD)
    assert np.all(np.abs(frf.values - truth(plant, frf.omega)) <= frf.bound.radius)


def test_a_plant_that_changes_is_told():
    _, record = measured(np.random.default_rng(1), "in turn", 6, change=1.1)
    _, same = measured(np.random.default_rng(1), "in turn", 6)
    changed, steady = (response_alone(one, period=PERIOD) for one in (record, same))
    assert Caveat.CHANGING in changed.bound.caveats
    assert steady.changed is None


IN_TURN = measured(np.random.default_rng(2), "in turn", 2)[1]
TWO = np.tile(np.random.default_rng(7).standard_normal((32, 2)), (32, 1))


def test_one_experiment_has_no_noise_floor():
    frf = response_alone(IN_TURN, period=PERIOD)
    rest = TimeRecord(0 * IN_TURN.u, np.random.default_rng(0).standard_normal(IN_TURN.y.shape), dt=DT)
    with pytest.raises(ValueError, match="2 inputs hold in 2 experiments"):
        bounds_from_noise_floor(rest).bound_response(frf, IN_TURN, period=PERIOD)


def refused(u=TWO, period=256):
    y = u[:, :1] + 0.1 * np.random.default_rng(0).standard_normal((len(u), 1))
    return response_alone(TimeRecord(u, y, dt=DT), period=period)


test_refuses = refusals(
    ({"u": IN_TURN.u[:, :1] @ [[1.0, 2.0]]}, "not independent in any window of 31 spectral lines"),
    ({"period": 32}, "takes a period of 63 samples; got 32"),
    ({"u": np.cos(2 * np.pi * np.outer(np.arange(1024), [3, 5]) / 256)}, "single spectral lines, .* hold 6"),
    of=refused,
)

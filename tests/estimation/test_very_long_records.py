"""Records longer than the stretch in which faults of the whole are sought: what is found, where, and with how much work."""

import numpy as np
import pytest
import scipy.signal

import robustid as rid
from robustid.estimation.repetition import found_period
from robustid.estimation.stretch import LONG, liveliest, pieces, stretch_length
from support.fault_plants import recipes, record

SAMPLES = 3 * LONG + 12_345
AT = 2 * LONG + 1712  # a place far from the beginning, in no piece that is the liveliest
DT = 1e-3


def machine(rng, u, noise=0.01):
    """Answer of a lightly damped mode at 35 Hz, with noise."""
    r, w = np.exp(-0.01 * 0.22), 0.22
    y = scipy.signal.lfilter([0, 1.0, 0.3], [1, -2 * r * np.cos(w), r * r], u)
    return y / y.std() + noise * rng.standard_normal(u.size)


def spike(y, at=AT):
    y[at] += 1.0
    return y


def jump(y, at=AT):
    y[at:] += 0.5
    return y


def lost(y, at=AT):
    return np.concatenate([y[:at], y[at + 7 :], y[-7:]])


def hum(y, at=None):
    return y + 0.05 * np.sin(2 * np.pi * 50 * DT * np.arange(y.size))


@pytest.fixture(scope="module")
def clean():
    rng = np.random.default_rng(0)
    u = rng.standard_normal(SAMPLES)
    return u, machine(rng, u)


@pytest.mark.parametrize(
    ("fault", "kind", "place"),
    [
        (spike, "spike", f"sample {AT}"),
        (jump, "jump", f"sample {AT}"),
        (lost, "lost samples", f"about sample {AT // 100}"),
        (hum, "tone", "50 Hz"),
    ],
)
def test_faults_of_a_very_long_record_are_named_with_their_place(clean, fault, kind, place):
    u, y = clean
    (found,) = rid.prepare.record_faults(rid.TimeRecord(u, fault(y.copy()), dt=DT))
    assert found.kind == kind
    assert place in found.words


def test_a_late_channel_of_a_very_long_record_is_named():
    arm = recipes()["arm"]
    one = record(arm, np.random.default_rng(0), kind="random", periods=SAMPLES // arm.period)
    (found,) = rid.prepare.record_faults(rid.TimeRecord(one.u[40:], one.y[:-40], dt=one.dt, initial="free"))
    assert found.kind == "late"
    assert found.size in (39, 40)  # one sample may be the hold's


def test_a_very_long_record_of_the_wrong_sign_is_told_from_the_other(clean):
    u, y = clean
    other = rid.TimeRecord(u[::-1], machine(np.random.default_rng(1), u[::-1]), dt=DT)
    (found,) = rid.prepare.record_faults([other, rid.TimeRecord(u, -y, dt=DT)])
    assert (found.kind, found.correction) == ("sign", "negate")


def test_a_very_long_sound_record_is_told_of_nothing(clean):
    assert rid.prepare.record_faults(rid.TimeRecord(*clean, dt=DT)) == ()


@pytest.fixture(scope="module")
def matrix():
    """Inputs and outputs of two channels each, of a few stretches of four pairs of signals."""
    rng = np.random.default_rng(5)
    u = rng.standard_normal((SAMPLES // 4, 2))
    return u, np.stack([machine(rng, u @ gains) for gains in ([1.0, 0.4], [-0.3, 0.8])], axis=1)


@pytest.mark.parametrize(("fault", "kind"), [(spike, "spike"), (jump, "jump"), (lost, "lost samples"), (hum, "tone")])
def test_stretches_of_matrices_are_shorter_and_find_the_same(matrix, fault, kind):
    u, y = matrix
    assert len(u) > 3 * stretch_length(2, 2)
    y = np.stack([y[:, 0], fault(y[:, 1].copy(), AT // 4)], axis=1)
    (found,) = rid.prepare.record_faults(rid.TimeRecord(u, y, dt=DT))
    assert (found.kind, found.where) == (kind, "output y2")


def test_a_very_long_sound_matrix_is_told_of_nothing(matrix):
    assert rid.prepare.record_faults(rid.TimeRecord(*matrix, dt=DT)) == ()


def test_a_spike_in_a_very_long_periodic_record_is_found_in_its_period():
    rng, period = np.random.default_rng(2), 4096
    u = np.resize(rng.standard_normal(period), SAMPLES)
    y = spike(machine(rng, u))
    found = {fault.kind: fault for fault in rid.prepare.record_faults(rid.TimeRecord(u, y, dt=DT))}
    assert set(found) == {"spike", "unstated period"}
    assert f"sample {AT} (period {AT // period + 1})" in found["spike"].words
    assert found["unstated period"].size == period


@pytest.mark.parametrize("period", [50, 4096, LONG // 2 + 5, SAMPLES // 2])
@pytest.mark.parametrize("noise", [0.0, 0.2])
def test_periods_of_very_long_records_are_found(period, noise):
    rng = np.random.default_rng(3)
    u = np.resize(rng.standard_normal(period), SAMPLES) + noise * rng.standard_normal(SAMPLES)
    assert found_period(rid.TimeRecord(u, u, dt=DT)) == period


def test_no_period_is_found_in_what_repeats_in_half_of_a_record_or_not_at_all():
    rng, time = np.random.default_rng(4), np.arange(SAMPLES)
    half = np.resize(rng.standard_normal(1000), SAMPLES)
    half[SAMPLES // 2 :] = rng.standard_normal(SAMPLES - SAMPLES // 2)
    sweep = np.sin(np.pi * (0.001 + 0.2 * time / SAMPLES) * time)
    assert [found_period(rid.TimeRecord(u, u, dt=DT)) for u in (half, sweep, rng.standard_normal(SAMPLES))] == [
        None
    ] * 3


def test_pieces_are_all_of_a_record_and_of_whole_periods():
    for period in (None, 4096, 3 * LONG // 5):
        parts = pieces(SAMPLES, period)
        own = np.concatenate([np.arange(SAMPLES)[one] for one, _ in parts])
        assert np.array_equal(own, np.arange(SAMPLES))
        for one, wide in parts:
            assert wide.start <= one.start
            assert one.stop <= wide.stop <= SAMPLES
            assert period is None or wide.start % period == one.start % period == 0


def test_the_liveliest_stretch_is_where_the_input_is_largest():
    u = np.ones((SAMPLES, 1))
    u[AT : AT + 100] = 9.0
    part = liveliest(u)
    assert part.start <= AT
    assert AT + 99 <= part.stop == part.start + LONG


def test_no_transform_is_of_a_whole_very_long_record(clean, monkeypatch):
    """Transforms are as long as a stretch, or as two of them; and their samples together are a few times those of the record."""
    lengths = []

    def counted(transform):
        def call(x, n=None, **options):
            length = np.shape(x)[options.get("axis", -1)] if n is None else n
            lengths.append(length * (np.size(x) // np.shape(x)[options.get("axis", -1)]))
            return transform(x, n, **options)

        return call

    monkeypatch.setattr(np.fft, "rfft", counted(np.fft.rfft))
    assert rid.prepare.record_faults(rid.TimeRecord(*clean, dt=DT)) == ()
    assert max(lengths) <= 2 * LONG
    assert sum(lengths) < 12 * SAMPLES

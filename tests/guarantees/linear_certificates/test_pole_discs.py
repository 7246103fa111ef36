"""Modes with poles anywhere in a box, against the modes themselves: values, responses, bends, and coefficients by interpolation."""

import mpmath
import numpy as np
import pytest

from robustid.core import SPlane, ZPlane
from robustid.guarantees.linear.functions import Functions
from robustid.guarantees.linear.in_time import tails_of_modes
from robustid.guarantees.linear.pole_discs import discs_of, groups_of, hull, told_apart_of
from support.cases import seeds
from support.pairwise import every_one

PLANES = {
    "delay 0": (ZPlane(0.01), 0),
    "delay 1": (ZPlane(0.01), 1),
    "delay 2": (ZPlane(0.01), 2),
    "continuous": (SPlane(80.0), -1),
}
WIDTHS = {"narrow": 0.05, "wide": 0.6, "to the circle": 20.0}  # of the largest damping times the frequency
SEEDS = seeds(1, 30)


def problem_of(place, width, seed):
    """Series of two modes in one box each, and for both modes some poles a of the box: in its corners, and inside."""
    plane, delay = PLANES[place]
    rng = np.random.default_rng([seed, delay + 1, list(WIDTHS).index(width)])
    middle, damping = np.array([rng.uniform(30, 60), rng.uniform(90, 150)]), rng.uniform(0.005, 0.05, 2)
    ratio = 1 + min(WIDTHS[width], 1.0) * rng.uniform(0.1, 1, 2)
    dampings = damping[:, None] * ratio[:, None] ** [-0.5, 0.5]
    half = np.minimum(WIDTHS[width] * dampings[:, 1] * rng.uniform(0.5, 1, 2), 0.2)
    omega = middle[:, None] * (1 + half[:, None] * [-1, 1])
    series = discs_of(plane, omega, dampings, delay, 10 ** rng.uniform(-7, -2, 2))
    share = np.concatenate([[[0, 0], [0, 1], [1, 0], [1, 1]], rng.random((4, 2))])
    return series, poles_at(plane, omega, dampings, share[:, [0]], share[:, [1]]), rng


def poles_at(plane, omega, damping, *shares):
    """Poles a at these parts of the intervals (M, 2) of frequencies and of damping ratios."""
    w, d = (
        ends[:, 0] + part * np.diff(ends, axis=1)[:, 0] for ends, part in zip((omega, damping), shares, strict=True)
    )
    s = (-d + 1j * np.sqrt(1 - d**2)) * w
    return np.exp(s * plane.dt) if plane.dt else (plane.corner + s) / (plane.corner - s)


def mode(series, a, angles):
    """n(x)/(1 - a x) at x = exp(-j angle)."""
    x = np.exp(-1j * angles)
    return (1 + x if series.delay < 0 else x**series.delay) / (1 - a * x)


def pair(series, a, c, angles):
    """The mode with a factor, and its conjugate."""
    return c * mode(series, a, angles) + (c * mode(series, a, -angles)).conj()


def coefficients(series, k, a):
    """Of 1/(1 - a x) in the functions of mode number k, from its values where later ones vanish: at the conjugates of the poles.

    About the middle of a box that reaches the circle it is the geometric series.
    """
    if series.reach[k]:
        return np.array([(a - series.middle[k]) ** j for j in range(len(series.poles[k]))])
    found = []
    with mpmath.workdps(80):
        poles = [mpmath.mpc(p) for p in series.poles[k]]
        for own in poles:
            x, product = mpmath.conj(own), mpmath.mpf(1)
            left = 1 / (1 - mpmath.mpc(a) * x)
            for pole, c in zip(poles, found, strict=False):
                left -= c * product / (1 - pole * x)
                product *= (x - mpmath.conj(pole)) / (1 - pole * x)
            found.append(left * (1 - own * x) / product)
        return np.array([complex(c) for c in found])


def columns_of(series, k):
    return [number for number, (own, *_) in enumerate(series.columns) if own == k]


def both(first, conjugate):
    return np.stack([first, conjugate], axis=1).ravel()


CASES = every_one(list(PLANES), list(WIDTHS))


@pytest.mark.parametrize(("place", "width"), CASES)
@pytest.mark.parametrize("seed", SEEDS)
def test_a_series_leaves_no_more_than_it_says_and_has_coefficients_of_bounded_size(place, width, seed):
    series, poles, rng = problem_of(place, width, seed)
    for k in range(2):
        a_1, spread = series.middle[k], 1 - abs(series.middle[k])
        near = np.angle(a_1) + spread * rng.standard_normal(40)
        angles = np.concatenate([near, -near, rng.uniform(-np.pi, np.pi, 40)])
        values, columns = series.values(angles), columns_of(series, k)
        sizes = np.array([series.columns[n][1] for n in columns])
        assert np.all(sizes[:2] == 1)
        for a in poles[:, k]:
            C = coefficients(series, k, a)
            assert np.all(np.abs(C / C[0]) <= sizes[::2] * (1 + 1e-9))
            c = np.exp(2j * np.pi * rng.random()) / C[0]  # |c C_1| = 1
            whole = pair(series, a, c, angles)
            approached = values[:, columns] @ both(c * C, (c * C).conj())
            size = np.abs(mode(series, a, angles)) + np.abs(mode(series, a, -angles))
            assert np.all(np.abs(whole - approached) <= series.left_out(angles)[:, k] + 1e-10 * abs(c) * size)


@pytest.mark.parametrize(("place", "width"), [case for case in CASES if case.values[0] != "continuous"])
@pytest.mark.parametrize("seed", SEEDS)
def test_responses_are_those_of_the_functions_and_of_the_modes_but_for_what_is_left_out(place, width, seed):
    series, poles, rng = problem_of(place, width, seed)
    samples, size = 60, 2**15
    angles = 2 * np.pi * np.arange(size) / size
    impulse = np.eye(1, samples)[0]
    values = series.values(angles)
    off = series.responses(impulse) - np.fft.ifft(values, axis=0)[:samples]
    assert np.all(np.abs(off) <= 1e-13 * np.abs(values).max(axis=0))  # the rounding of the transform
    u = rng.standard_normal(samples)
    found, left = series.responses(u), series.left_out_in_time(u)
    for k in range(2):
        columns = columns_of(series, k)
        for a in poles[:, k]:
            C = coefficients(series, k, a)
            c = np.exp(2j * np.pi * rng.random()) / C[0]
            h = np.concatenate([np.zeros(series.delay), 2 * (c * a ** np.arange(samples)).real])[:samples]
            off = np.convolve(h, u)[:samples] - found[:, columns] @ both(c * C, (c * C).conj())
            assert np.all(np.abs(off) <= left[:, k] + 1e-10 * abs(c) * samples)


@pytest.mark.parametrize(("place", "width"), CASES)
@pytest.mark.parametrize("seed", SEEDS)
def test_modes_and_their_second_derivatives_stay_below_their_bounds_on_arcs(place, width, seed):
    series, poles, rng = problem_of(place, width, seed)
    lengths = 10 ** rng.uniform(-3, -0.5, 12)
    near = np.angle(series.middle)[np.arange(6) % 2] - lengths[:6] * rng.random(6)
    low = np.concatenate([near, rng.uniform(0, 2.8, 6)])
    high, step = low + lengths, 1e-5
    most, bends = series.largest_on(low, high), series.bends(low, high)
    angles = (low[:, None] + lengths[:, None] * np.linspace(0, 1, 60))[..., None] + step * np.arange(-1, 2)
    seen = np.zeros((2, 12, 2))
    for k in range(2):
        for a in poles[:, k]:
            c = np.exp(2j * np.pi * rng.random()) / coefficients(series, k, a)[0]
            whole = pair(series, a, c, angles)
            bent = np.abs(whole[..., 0] - 2 * whole[..., 1] + whole[..., 2]).max(axis=1) / step**2
            rounding = 1e-15 * np.abs(whole).max(axis=(1, 2)) / step**2 * 10
            seen[:, :, k] = np.maximum(seen[:, :, k], [np.abs(whole[..., 1]).max(axis=1), bent - rounding])
    assert np.all(seen[0] <= most * (1 + 1e-12))
    assert np.all(seen[1] <= bends * (1 + 1e-3))
    if width == "narrow":  # near the resonance, where they decide, the bounds are of use
        assert np.all(most[:6].max(axis=1) <= 4 * seen[0, :6].max(axis=1))
        assert np.all(bends[:6].max(axis=1) <= 40 * seen[1, :6].max(axis=1))


def group_of(place, count, seed):
    """Series of modes whose boxes overlap, as one group; their poles and amplitudes that nearly cancel, (8, count) each."""
    plane, delay = PLANES[place]
    rng = np.random.default_rng([seed, delay + 1, count])
    damping = rng.uniform(0.005, 0.05) * np.array([0.8, 1.2]) * rng.uniform(0.9, 1.1, (count, 1))
    omega = rng.uniform(30, 120) * (1 + damping.mean() * (np.arange(count)[:, None] * 0.3 + [-0.3, 0.3]))
    series = discs_of(plane, omega, damping, delay, 10 ** rng.uniform(-5, -2, count))
    poles = poles_at(plane, omega, damping, *rng.choice([0.0, 1.0, 0.3, 0.8], (2, 8, count)))
    c = 10 ** rng.uniform(0, 2, (8, 1)) * np.exp(2j * np.pi * rng.random((8, count)))
    c[:, -1] = -c[:, :-1].sum(axis=1) + np.exp(2j * np.pi * rng.random(8))
    return series, poles, c, rng


def parts_of_group(series, a, c, terms):
    """The coefficients of sum c_i/(1 - a_i x) in the functions of the group, as far as asked."""
    middle = series.middle[0]
    first = c * (1 - abs(middle) ** 2) / (1 - np.conj(middle) * a)
    return np.array([np.sum(first * ((a - middle) / (1 - np.conj(middle) * a)) ** n) for n in range(terms)])


@pytest.mark.parametrize("place", PLANES)
@pytest.mark.parametrize("count", [2, 3])
@pytest.mark.parametrize("seed", SEEDS)
def test_modes_whose_boxes_overlap_are_bounded_by_amplitudes_that_the_data_tell(place, count, seed):
    series, poles, cs, rng = group_of(place, count, seed)
    assert len(series.poles) == 1
    assert series.middle.size == count
    away = 10 ** rng.uniform(-1, 1, 60) * rng.choice([-1, 1], 60)
    angles = np.angle(series.middle[0]) + (1 - abs(series.middle[0])) * away
    low, step = angles[:8], 1e-5
    high = low + 10 ** rng.uniform(-3, -1, 8)
    most, bends = series.largest_on(low, high), series.bends(low, high)
    fine = (low[:, None] + (high - low)[:, None] * np.linspace(0, 1, 60))[..., None] + step * np.arange(-1, 2)
    values, columns = series.values(angles), series.columns
    for a, c in zip(poles, cs, strict=True):
        size = (np.abs(c) * np.abs([mode(series, one, angles) for one in a]).T).sum(axis=1)
        parts = parts_of_group(series, a, c, len(series.poles[0]))
        largest = np.abs(parts[:count])
        assert np.all(np.abs(parts[count:]) <= series.sizes[0][count:] @ largest + 1e-11 * np.abs(c).sum())
        approached, used = 0, [row[0] for row in (np.flatnonzero(row) for row in series.sizes[0])]
        numbers = iter(range(0, len(columns), 2))
        for n, row in enumerate(series.sizes[0]):
            for m in np.flatnonzero(row):
                k = next(numbers)
                assert columns[k][0] == m
                if m == used[n]:
                    approached = approached + values[:, [k, k + 1]] @ [parts[n], parts[n].conj()]
        near, whole = (sum(pair(series, *one, at) for one in zip(a, c, strict=True)) for at in (angles, fine))
        off = near - approached
        assert np.all(np.abs(off) <= series.left_out(angles) @ largest + 1e-10 * size)
        rounding = 1e-13 * np.abs(c).max() * np.abs(mode(series, a[0], fine)).max() / step**2
        bent = np.abs(whole[..., 0] - 2 * whole[..., 1] + whole[..., 2]).max(axis=1) / step**2
        assert np.all(np.abs(whole[..., 1]).max(axis=1) <= (most @ largest) * (1 + 1e-9))
        assert np.all(bent <= (bends @ largest) * (1 + 1e-3) + rounding)


@pytest.mark.parametrize("seed", range(3))
def test_tails_of_steps_of_a_group_are_bounded(seed):
    series, poles, cs, _ = group_of("delay 1", 2, seed)
    found = tails_of_modes(Functions(None, series, ()), 60)
    n = np.arange(61)[:, None]
    for a, c in zip(poles, cs, strict=True):
        tail = 2 * np.abs(((c * a**n) / (1 - a)).sum(axis=1).real)
        worst = np.maximum.accumulate(tail[::-1])[::-1]
        assert np.all(
            worst <= found @ np.abs(parts_of_group(series, a, c, 2)) + 1e-11 * np.abs(c).sum() / np.abs(1 - a).min()
        )


def test_the_heavier_mode_of_two_that_no_points_tell_apart_is_left_out():
    """Boxes of the mirror at 1382, 1446 and 1680 Hz: the first two may be of one pole, each over a factor of five in damping."""
    hz = np.array([[1365.2, 1400.3], [1405.4, 1480.3], [1674.1, 1685.0]])
    damping = np.array([[0.003, 0.0221], [0.0148, 0.0744], [0.0109, 0.016]])
    assert told_apart_of(2 * np.pi * hz, damping).tolist() == [0, 2]
    assert told_apart_of(2 * np.pi * hz[[0, 2]], damping[[0, 2]]).tolist() == [0, 1]
    close = np.array([[0.0148, 0.0221], [0.0148, 0.0221]])  # close, and a group that one series serves
    assert told_apart_of(2 * np.pi * np.array([[1365, 1400], [1405, 1430]]), close).tolist() == [0, 1]


@pytest.mark.parametrize("seed", SEEDS)
def test_modes_that_are_told_apart_stay_so_and_hold_every_group_to_its_width(seed):
    rng = np.random.default_rng(seed)
    omega = np.sort(rng.uniform(80, 160, 6))[:, None] * (1 + rng.uniform(0, 0.1, (6, 1)) * [-1, 1])
    damping = rng.uniform(0.005, 0.05, (6, 1)) * rng.uniform(1, 3, (6, 1)) ** [-1, 1]
    kept = told_apart_of(omega, damping)
    assert told_apart_of(omega[kept], damping[kept]).tolist() == list(range(kept.size))
    series = discs_of(ZPlane(0.005), omega[kept], damping[kept], 1, np.full(kept.size, 1e-3))
    shared = [sizes.shape[1] for sizes in series.sizes]  # amplitudes of a series
    assert len(shared) == len(groups_of(hull(omega[kept], damping[kept])))
    assert sum(shared) == kept.size

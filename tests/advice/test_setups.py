"""Modes of one machine in several setups: joint intervals hold the truth, a changed setup is named, nothing is averaged."""

import dataclasses
import itertools

import control
import numpy as np
import pytest
import scipy.special

import robustid as rid
from robustid.advice import suggest_kautz
from robustid.advice.pole_fit import line_data
from robustid.advice.pole_interval import _linear_estimate, _local_fit
from robustid.advice.setups import _between, _Box, _matched
from robustid.core import plane_of
from robustid.errors import InputError, InputTypeError

MASSES, SETUPS = 5, 4


class Chain:
    """Masses between springs, modal damping .5 to 2 %; the first mode near 10 Hz, response to a force on the third mass."""

    def __init__(self, rng, lines, more=(0, 0.0)):
        self.mass, self.spring = rng.uniform(0.7, 1.3, MASSES), rng.uniform(0.7, 1.3, MASSES + 1)
        self.damping = rng.uniform(0.005, 0.02, MASSES)
        unloaded = self.modes()[0]
        self.dt = np.pi / unloaded[-1] / 3
        self.lines = np.linspace(0.5 * unloaded[0], 1.2 * unloaded[-1], lines)
        self.mass[more[0]] += more[1]

    def modes(self):
        k = self.spring
        stiffness = np.diag(k[:-1] + k[1:]) - np.diag(k[1:-1], 1) - np.diag(k[1:-1], -1)
        root = 1 / np.sqrt(self.mass)
        squares, shapes = np.linalg.eigh(root[:, None] * stiffness * root)
        return 2 * np.pi * 20 * np.sqrt(squares), root[:, None] * shapes

    def setup(self, rng, outputs, noise=0.01):
        """Response of two masses, errors of one hundredth of its root mean square, circular normal of known variance."""
        omega, shapes = self.modes()
        A, B, C = np.zeros((2 * MASSES, 2 * MASSES)), np.zeros((2 * MASSES, 1)), np.zeros((len(outputs), 2 * MASSES))
        for k, (w, zeta) in enumerate(zip(omega, self.damping, strict=True)):
            A[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = [[0, w], [-w, -2 * zeta * w]]
            B[2 * k + 1], C[:, 2 * k] = shapes[2, k] / w, shapes[outputs, k]
        plant = control.c2d(control.ss(A, B, C, 0), self.dt)
        values = np.moveaxis(plant(np.exp(1j * self.lines * self.dt), squeeze=False), -1, 0)
        size = noise * np.sqrt(np.mean(np.abs(values) ** 2, axis=0))
        errors = size * (rng.standard_normal(values.shape) + 1j * rng.standard_normal(values.shape)) / np.sqrt(2)
        covariance = np.broadcast_to(np.diag(size[:, 0] ** 2), (len(values), len(outputs), len(outputs)))
        return rid.FrequencyResponse(self.lines, values + errors, covariance=covariance, dt=self.dt)


def measured(seed, mass=0.0, lines=200):
    """A machine in four setups of two outputs each, in one of which a mass was added; its number."""
    rng = np.random.default_rng(seed)
    changed, at = int(rng.integers(SETUPS)), int(rng.integers(MASSES))
    machine, loaded = (Chain(np.random.default_rng(seed + 1), lines, (at, more)) for more in (0.0, mass))
    setups = [(loaded if s == changed else machine).setup(rng, [s, s + 1]) for s in range(SETUPS)]
    return machine, setups, f"setup {changed + 1}"


def held(found, machine):
    """Of every mode with a joint interval: does it hold the nearest true mode."""
    omega = machine.modes()[0]
    hold = []
    for (low, high), (light, heavy) in zip(found.omega_interval, found.damping_interval, strict=True):
        if not np.isnan(low):
            k = int(np.argmin(np.abs(np.log(omega / np.sqrt(low * high)))))
            hold.append(low <= omega[k] <= high and light <= machine.damping[k] <= heavy)
    return hold


@pytest.mark.parametrize(("count", "lines"), [(3, 60), pytest.param(SETUPS, 100, marks=pytest.mark.slow)])
def test_joint_intervals_hold_the_truth_within_every_box(count, lines):
    machine, setups, _ = measured(0, lines=lines)
    setups = setups[:count]
    found = rid.advise.common_modes(setups)
    assert not found.disagreements
    assert found.compared >= 4
    assert all(held(found, machine))
    assert found.probability.min() >= 0.95 - 1e-12  # the boxes and the mean of them have equal parts of the rest
    for joint, boxes in (
        (found.omega_interval, found.omega_intervals),
        (found.damping_interval, found.damping_intervals),
    ):
        for (mode, setup), used in np.ndenumerate(found.used):
            if used:
                assert boxes[mode, setup, 0] <= joint[mode, 0] < joint[mode, 1] <= boxes[mode, setup, 1]
    single = suggest_kautz(setups[0].with_joint_bound(0.95))  # boxes are those that one setup gives alone
    mine = found.omega_intervals[found.used[:, 0], 0]
    assert {tuple(one) for one in mine} <= {tuple(one) for one in single.omega_interval}


@pytest.mark.parametrize("lines", [45, pytest.param(100, marks=pytest.mark.slow)])
def test_a_setup_with_a_mass_is_named_with_two_disjoint_intervals_and_no_average(tmp_path, lines):
    _, setups, changed = measured(1, mass=0.05, lines=lines)
    found = rid.advise.common_modes(setups)
    assert found.odd == changed
    for one in found.disagreements:
        assert one.intervals[0][1] < one.intervals[1][0]
        assert changed in one.setups
        assert one.level == 1
        assert np.isnan(found.omega_interval[one.mode]).all()
        assert np.isnan(found.damping_interval[one.mode]).all()
    assert not found.without(changed).disagreements
    moved = [one for one in found.moved(changed) if one.shown and one.quantity == "frequency"]
    assert moved
    assert all(one.change[1] < 0 for one in moved)  # a mass lowers
    assert "% lower" in moved[0].words
    found.save(tmp_path / "modes")
    again = rid.load(tmp_path / "modes")
    assert again.disagreements == found.disagreements
    assert again.summary() == found.summary()
    assert again.to_dataframe().shape[0] == len(found.used)


LINES = np.linspace(40.0, 90.0, 60)


def simple(*modes, bound: float | np.ndarray | None = 1e-5, **more):
    """Two modes or fewer, exact, with a hard bound."""
    values = sum(1 / (w**2 - LINES**2 + 0.02j * w * LINES) for w in modes)
    return rid.FrequencyResponse(LINES, values, bound=bound, **more)


def test_two_setups_contradict_each_other_and_neither_is_named():
    found = rid.advise.common_modes({"a": simple(50.0, 70.0), "b": simple(49.5, 70.0)})
    assert found.odd is None
    assert [(one.mode, one.quantity, one.setups) for one in found.disagreements] == [(0, "frequency", ("b", "a"))]
    assert found.false_alarm == 0  # hard bounds
    assert "a and b" in found.verdict


def test_a_mode_of_one_setup_keeps_its_interval_and_is_no_contradiction():
    found = rid.advise.common_modes([simple(50.0), simple(70.0), simple(50.0, 70.0)])
    assert not found.disagreements
    assert found.used.tolist() == [[True, False, True], [False, True, True]]
    alone = rid.advise.common_modes([simple(50.0), simple(70.0)])  # two fifths apart: two modes
    assert not alone.compared
    assert "nothing is compared" in alone.verdict
    assert np.isfinite(alone.omega_interval).all()


def box(setup, low, high):
    return _Box(setup, (low + high) / 2, low, high, np.zeros((2, 2)), True, 1.0, 0.0, np.zeros((2, 2)))


def test_a_box_over_two_modes_of_another_setup_stands_alone():
    boxes = [box(0, 4.00, 4.02), box(0, 4.05, 4.07), box(1, 4.01, 4.06), box(2, 4.01, 4.03)]
    assert [_between(one, boxes) for one in boxes] == [False, False, True, False]
    assert _matched(boxes) == [[0, 3], [1], [2]]


def test_without_an_overlap_the_nearest_is_the_same_mode_if_it_is_near_beside_the_next():
    assert _matched([box(0, 4.00, 4.01), box(0, 4.20, 4.21), box(1, 4.05, 4.06)]) == [[0, 2], [1]]
    assert _matched([box(0, 4.00, 4.01), box(0, 4.08, 4.09), box(1, 4.04, 4.05)]) == [[0], [1], [2]]
    assert _matched([box(0, 4.00, 4.01), box(1, 4.30, 4.31)]) == [[0], [1]]  # a third apart


@pytest.mark.parametrize(
    ("call", "error", "says"),
    [
        (lambda: rid.advise.common_modes([simple(50.0)]), InputError, "two at least"),
        (lambda: rid.advise.common_modes(simple(50.0)), InputTypeError, "sequence of FrequencyResponse"),
        (lambda: rid.advise.common_modes([simple(50.0), 3]), InputTypeError, "setups"),
        (lambda: rid.advise.common_modes([simple(50.0), simple(50.0, bound=None)]), InputError, "setup 2 has neither"),
        (lambda: rid.advise.common_modes(2 * [simple(50.0)], probability=2), InputError, "probability"),
        (lambda: rid.advise.common_modes(2 * [simple(50.0)]).moved("x"), InputError, "must be one of setup 1, setup 2"),
    ],
)
def test_what_is_refused(call, error, says):
    with pytest.raises(error, match=says):
        call()


@pytest.mark.slow
def test_fifty_structures():
    """Truths held, by mode and by structure; the width of joint intervals beside the narrowest and the median single one."""
    hold, whole, shares, contradicted = [], 0, [], 0
    for seed in range(50):
        machine, setups, _ = measured(100 * seed)
        found = rid.advise.common_modes(setups)
        contradicted += bool(found.disagreements)
        mine = held(found, machine)
        hold, whole = hold + mine, whole + all(mine)
        for mode in np.flatnonzero(found.used.sum(axis=1) > 1):
            for joint, boxes in (
                (found.omega_interval, found.omega_intervals),
                (found.damping_interval, found.damping_intervals),
            ):
                widths = np.diff(boxes[mode, found.used[mode]]).ravel()
                shares.append(np.diff(joint[mode])[0] / np.array([widths.min(), np.median(widths), widths.max()]))
    shares = np.array(shares)
    print(
        f"{sum(hold)} of {len(hold)} modes and {whole} of 50 structures held, {contradicted} contradicted; joint widths over the"
        f" narrowest, median and widest box, medians {np.median(shares, axis=0).round(3)}, largest {shares.max(axis=0).round(3)};"
        f" narrower than every box {np.mean(shares[:, 0] < 1):.2f}"
    )
    assert sum(hold) >= 0.95 * len(hold)
    assert whole >= 48
    assert shares[:, 0].max() <= 1 + 1e-12
    assert np.mean(shares[:, 0] < 1) >= 0.95


@pytest.mark.slow
@pytest.mark.parametrize("mass", [0.02, 0.05])
def test_twenty_masses(mass):
    named = 0
    for seed in range(20):
        _, setups, changed = measured(100 * seed + 50, mass=mass)
        named += rid.advise.common_modes(setups).odd == changed
    print(f"mass of {mass} beside masses of .7 to 1.3: named in {named} of 20")
    assert named >= (19 if mass == 0.05 else 10)


def joint(ends, level=1.0):
    """One mode by as many setups as there are boxes, (S, 2, 2)."""
    one = np.full((1, len(ends)), level)
    return rid.advise.CommonModes(
        names=tuple("abcdefgh"[: len(ends)]),
        omega_intervals=ends[None, :, 0],
        damping_intervals=ends[None, :, 1],
        used=one > 0,
        level=one,
        fails=np.where(one > 1, np.nan, 0.0),
        estimates=np.full((1, len(ends), 2, 2), np.nan),
    )


def test_boxes_of_wider_bounds_are_evidence_and_no_proof():
    found = joint(np.array([[[1.0, 1.1], [0.01, 0.02]], [[1.2, 1.3], [0.01, 0.02]]]), level=3.0)
    assert found.disagreements[0].level == 3
    assert np.isnan(found.probability[0])
    assert np.isnan(found.false_alarm)
    assert "with bounds times 3" in found.summary()
    assert "evidence, no proof" in found.summary()


def test_pairs_of_setups_agree_as_all_of_them_do():
    """Boxes of one mode: all have a point in common where every two of them have one."""
    rng = np.random.default_rng(3)
    for _ in range(200):
        low = rng.uniform(0, 1, (4, 2))
        ends = np.stack([low, low + rng.uniform(0.2, 1.2, (4, 2))], axis=-1)
        found = joint(ends)
        pairs = itertools.combinations(ends, 2)
        meet = all(np.all((a[:, 0] <= b[:, 1]) & (b[:, 0] <= a[:, 1])) for a, b in pairs)
        assert meet == (not found.disagreements) == bool(np.isfinite(found.omega_interval).all())


def of_normal_estimates(rng, modes, chance, scatter=1.0):
    """Setups whose estimates are normal about 0, with half-widths that fail with a probability; boxes are left out of it."""
    half = rng.uniform(0.01, 0.1, (modes, SETUPS, 2))
    limit = scipy.special.ndtri(1 - chance / 4)
    place = scatter * half / limit * rng.standard_normal(half.shape)
    wide = np.broadcast_to([np.exp(-1.0), np.exp(1.0)], (modes, SETUPS, 2))
    found = rid.advise.CommonModes(
        names=tuple("abcd"),
        omega_intervals=wide,
        damping_intervals=wide,
        used=np.ones((modes, SETUPS), bool),
        level=np.ones((modes, SETUPS)),
        fails=np.full((modes, SETUPS), chance),
        estimates=np.stack([place, half], axis=-1),
    )
    return found, half


def test_the_mean_of_normal_estimates_holds_the_truth_as_often_as_is_known():
    found, half = of_normal_estimates(np.random.default_rng(7), 20000, 0.08)
    missed, all_of_them = 0, 0
    for quantity, (low, high) in enumerate((found.omega_interval.T, found.damping_interval.T)):
        taken = found.averaged[:, :, quantity].all(axis=1)
        np.testing.assert_allclose(
            np.log(high / low)[taken] / 2, np.sum(half[taken, :, quantity] ** -2.0, axis=1) ** -0.5, rtol=1e-9
        )
        missed, all_of_them = missed + np.sum((low > 1) | (high < 1)), all_of_them + taken.sum()
    assert all_of_them > 0.85 * 40000  # each of the others has an estimate beyond its own half-width of the mean
    expected = 0.04 * all_of_them  # mean and scatter about it are independent
    assert abs(missed - expected) < 4 * np.sqrt(expected)
    assert np.mean(missed / all_of_them) <= 1 - found.probability.max()


def test_estimates_that_scatter_more_than_they_may_are_not_averaged():
    found, _ = of_normal_estimates(np.random.default_rng(8), 500, 0.02, scatter=20.0)
    none = ~found.averaged.any(axis=(1, 2))
    assert np.mean(none) > 0.9
    np.testing.assert_allclose(found.omega_interval[none, 1], np.exp(1.0))
    np.testing.assert_allclose(found.probability[none], 1 - 4 * 0.02)


@pytest.mark.parametrize("dt", [None, 0.02])
def test_the_most_that_errors_move_an_estimate_is_that_of_all_of_them_at_once(dt):
    """Errors one by one, by differences: their largest effects add up."""
    bounds, plane = np.linspace(0.5e-5, 2e-5, LINES.size), plane_of(dt, LINES)
    (one,) = line_data([simple(50.0, 70.0, bound=bounds, dt=dt)], plane).each
    poles = np.log(np.stack(plane.turned(np.array([50.0, 70.0]), np.array([0.01, 0.01])), axis=1))
    local, _ = _local_fit(one, poles, 0)

    def estimate(k=0, error=0.0):
        values = local.data.value.copy()
        values[k] += error
        moved = dataclasses.replace(local, data=dataclasses.replace(local.data, value=values))
        return _linear_estimate([moved], poles[0], plane)

    step, start = 1e-3, estimate()
    whole = np.zeros(2)
    for k, bound in enumerate(local.data.bound):
        moves = [estimate(k, turn * step * bound)[:, 0] - start[:, 0] for turn in (1, 1j)]
        whole += np.hypot(*moves) / step
    np.testing.assert_allclose(whole, start[:, 1], rtol=1e-3)
    np.testing.assert_allclose(start[:, 0], np.log([50.0, 0.01]), atol=1e-3)


@pytest.mark.slow
def test_the_mean_holds_modes_of_responses_whose_lines_depend_on_each_other():
    """Records of three modes by the local method: neighbouring lines share their windows."""
    hold, averaged = [], []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        omega = 2 * np.pi * np.array([5.0, 9.0, 14.0]) * rng.uniform(0.95, 1.05, 3)
        damping = rng.uniform(0.008, 0.02, 3)
        A, B = np.zeros((6, 6)), np.zeros((6, 1))
        for k, (w, zeta) in enumerate(zip(omega, damping, strict=True)):
            A[2 * k : 2 * k + 2, 2 * k : 2 * k + 2], B[2 * k + 1] = [[0, w], [-w, -2 * zeta * w]], 1
        setups = []
        for _ in range(3):
            C = np.zeros((1, 6))
            C[0, ::2] = rng.uniform(0.5, 1, 3) * rng.choice([-1, 1], 3)
            u = rng.standard_normal(4096)
            y = control.forced_response(control.c2d(control.ss(A, B, C, 0), 0.01), U=u).outputs.ravel()
            y = y + 0.03 * y.std() * rng.standard_normal(y.size)
            record = rid.TimeRecord(u, y, dt=0.01, initial="free")
            setups.append(rid.estimate_frf(record, method="local").band(2.0, 20.0))
        found = rid.advise.common_modes(setups)
        for mode in np.flatnonzero(found.used.sum(axis=1) > 1):
            (low, high), (light, heavy) = found.omega_interval[mode], found.damping_interval[mode]
            k = int(np.argmin(np.abs(np.log(omega / np.sqrt(low * high)))))
            hold.append(low <= omega[k] <= high and light <= damping[k] <= heavy)
            averaged.append(found.averaged[mode].any())
    print(f"{sum(hold)} of {len(hold)} modes held, {sum(averaged)} by a mean")
    assert sum(hold) >= 0.95 * len(hold)
    assert np.mean(averaged) > 0.9

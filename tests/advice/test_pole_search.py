"""improve_kautz: the slope of the margin against differences, and wrong poles that are found again."""

import dataclasses

import control
import numpy as np
import pytest

import robustid as rid
from robustid.advice.moving_pairs import taken_apart
from robustid.advice.smallest_gain import smallest_gain
from robustid.bases import as_basis
from robustid.core import ZPlane
from robustid.errors import InputTypeError
from support.bounds import rebound
from support.cases import slow
from support.refusals import refusals
from support.structure import about_structure

FINE = np.linspace(17.2, 18.1, 10)
FEWER = {"lines": 6, "samples": 8}  # 30 coefficients with every other fine line, for 62: an eighth of the time
DT = 0.01


def structure(factors, extra=FINE[::2], seed=0, K=0.2, rho=1.1, repeat=1, data=None):
    """The simulated structure with natural frequencies and dampings off by these factors, (2, 2)."""
    data = data or rid.datasets.flexible_structure(extra_hz=extra, seed=seed, **FEWER)
    return about_structure(data, K, rho, time=True, modes=data.modes * np.asarray(factors), repeat=repeat)


def one_percent(seed):
    """Frequencies off by up to 1 %, dampings by a factor of 2 up or down."""
    rng = np.random.default_rng(seed)
    return np.stack([1 + rng.uniform(-0.01, 0.01, 2), 2.0 ** rng.choice([-1, 1], 2)], axis=1)


def records(kind):
    """A structure problem measured in another way."""
    data, rng = rid.datasets.flexible_structure(), np.random.default_rng(1)
    prior, modes = rid.Prior(gain_bound=0.05, decay_rate=1.1), data.modes * [[1.003, 1.2], [0.99, 0.7]]
    if kind == "lines":
        return {"frequency": data.frequency, "prior": prior}, modes
    if kind == "ellipses":
        tilt = 0.4 * np.exp(1j * np.arange(data.frequency.omega.size))
        return {"frequency": rebound(data.frequency, tilt=tilt), "prior": prior}, modes
    u = rng.choice([-1.0, 1.0], 30)
    drive = np.tile(u, 200) if kind == "periodic" else u
    y = np.ravel(control.forced_response(data.truth, np.arange(drive.size) * DT, drive).y)[-u.size :]
    y = y + rng.uniform(-0.05, 0.05, u.size)
    if kind == "free":
        u, y = u[6:], y[6:]
    return {"time": rid.TimeRecord(u, y, dt=DT, bound=0.05, initial=kind), "prior": prior}, modes


@pytest.mark.parametrize(
    ("kind", "repeat"),
    [
        ("ellipses", 1),
        ("periodic", 2),
        *(slow(*each) for each in (("rest", 1), ("lines", 1), ("lines", 2), ("free", 1))),
    ],
)
def test_slope_of_the_margin_is_that_of_differences(kind, repeat):
    given, modes = records(kind)

    def margin(logs):
        omega, damping = np.exp(logs).T
        basis = rid.kautz(omega, damping, dt=DT, delay=1, repeat=repeat)
        result = rid.identify(rid.MixedProblem(**given, parametric=basis), accuracy=1e-6, solver="structured")
        return (result.margin + result.margin_lower) / 2

    basis = rid.kautz(*modes.T, dt=DT, delay=1, repeat=repeat)
    found = rid.advise.improve_kautz(rid.MixedProblem(**given, parametric=basis), target=1e9)
    assert not found.moved
    assert not found.repeated
    logs, differences = np.log(modes), np.zeros((2, 2))
    for place in np.ndindex(2, 2):
        step = np.zeros((2, 2))
        step[place] = 1e-3 * (modes[place[0], 1] if place[1] == 0 else 1.0)
        differences[place] = (margin(logs + step) - margin(logs - step)) / (2 * step[place])
    scale = np.stack([modes[:, 1], np.ones(2)], axis=1)  # of a half-width, and of a factor e
    assert np.abs(scale * differences).max() > 0.01
    np.testing.assert_allclose(scale * found.slope, scale * differences, rtol=2e-3, atol=1e-4)


def test_wrong_pole_contradicts_the_data_or_needs_a_large_rest():
    """1 % in the frequency of the light mode: with lines around it no K helps, without them only a large one."""
    off = [[1, 1], [1.01, 1]]
    assert rid.identify(structure(off)).margin_lower > 100
    assert np.isinf(smallest_gain(structure(off), 1.1))
    assert rid.identify(structure(off, repeat=2)).margin_lower > 50
    data = rid.datasets.flexible_structure()
    right, wrong = (smallest_gain(structure(factors, data=data), 1.1) for factors in (np.ones((2, 2)), off))
    assert right == 0
    assert wrong > 0.1
    assert rid.identify(structure(off, data=data, K=0.05)).margin_lower > 1


@pytest.mark.parametrize(
    ("lines", "K", "seeds", "size"),
    [
        ("around the mode", 0.2, [0], FEWER),
        ("far apart", 0.05, [0], {}),
        *(slow(lines, K, range(20), {}) for lines in ("around the mode", "far apart") for K in (0.2, 0.05)),
    ],
)
def test_wrong_poles_are_moved_back(lines, K, seeds, size):
    extra = FINE if lines == "around the mode" else ()
    for number in seeds:
        data = rid.datasets.flexible_structure(extra_hz=extra, seed=number, **size)
        found = rid.advise.improve_kautz(structure(one_percent(number), K=K, data=data))
        assert found.trials[0].margin_lower > 10
        assert found.margin <= 1
        assert found.moved
        assert not found.repeated
        assert len(found.trials) <= 15
        assert np.all(np.diff(found.margins) < 0)
        for trial in found.trials:
            assert trial.margin_lower <= trial.margin <= trial.margin_lower + 1e-3 * max(1, trial.margin)
        # The poles of the truth, with which the data are consistent by construction, are among those that the box leaves.
        for ends, true in zip((found.box.omega_interval, found.box.damping_interval), data.modes.T, strict=True):
            assert np.all((ends[:, 0] <= true) & (true <= ends[:, 1]))
        if len(extra):
            np.testing.assert_allclose(found.omega[1], data.modes[1, 0], rtol=1e-4)
            np.testing.assert_allclose(found.damping[1], data.modes[1, 1], rtol=0.02)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(5))
def test_light_pole_is_found_from_twenty_five_half_widths_away(seed):
    factors = np.random.default_rng(seed).choice([0.9, 1.1], 2), one_percent(seed)[:, 1]
    data = rid.datasets.flexible_structure(extra_hz=FINE, seed=seed)
    assert rid.advise.improve_kautz(structure(np.stack(factors, axis=1), data=data), repeat=False).margin <= 1


def test_poles_moved_by_time_data_have_no_box():
    given, modes = records("rest")
    problem = rid.MixedProblem(**given, parametric=rid.kautz(*(modes * [[1, 1], [0.97, 1]]).T, dt=DT, delay=1))
    found = rid.advise.improve_kautz(problem, repeat=False)
    assert found.trials[0].margin_lower > 1 >= found.margin
    assert found.moved
    assert found.box is None
    assert "too few to say which" in found.note


def test_result_says_where_its_poles_come_from():
    found = rid.advise.improve_kautz(structure([[1, 1], [0.99, 1]]))
    result = found.identify().require()
    assert result.notes == (found.note,)
    assert found.note.startswith("Modes taken from the data")
    assert "mode 2: 17.67 Hz" in found.note
    assert "poles were taken from these data" in rid.worst_case_error(result, omega=[30.0], directions=3).summary()
    # The box is in the form that the guarantee over all its poles takes.
    lines = dataclasses.replace(found.problem, frequency=found.problem.frequency[0].select(slice(0, None, 3)), time=())
    box = found.box.omega_interval, found.box.damping_interval
    band = rid.guarantee.worst_case_over_poles(rid.identify(lines), *box, omega=[30.0], directions=3, cells=1)
    assert np.isfinite(band.upper).all()
    summary = found.summary()
    assert "pair 2: 17.493 Hz, damping 0.004 -> 17.67 Hz" in summary
    assert found.reason in summary


def test_repeated_pairs_absorb_a_small_error_and_keep_the_poles():
    problem = structure([[1, 1], [1.0005, 1]])
    found = rid.advise.improve_kautz(problem)
    assert found.trials[0].margin_lower > 1
    assert found.repeated
    assert not found.moved
    assert len(found.trials) == 2
    assert found.box is None
    assert found.problem.parametric.size == 8
    np.testing.assert_array_equal(found.omega, found.omega_before)
    assert rid.identify(found.problem).margin == pytest.approx(found.margin, abs=1e-3)
    assert "repeated once more" in found.note
    assert not found.note.startswith("Modes taken")
    moved = rid.advise.improve_kautz(problem, repeat=False)
    assert moved.moved
    assert moved.problem.parametric.size == 4
    assert moved.margin <= 1


def test_the_time_ends_the_search_with_the_best_pairs_so_far():
    """At once: the given ones with what is proved of their margin; in a step: it says in which."""
    problem, told = structure([[1, 1], [1.01, 1]]), []
    found = rid.advise.improve_kautz(problem, time_limit=1e-6)
    assert "stopped at the time limit" in found.reason
    assert not found.moved
    assert found.margin_lower <= found.trials[0].margin == found.margin
    assert len(found.trials) == 1
    found = rid.advise.improve_kautz(problem, repeat=False, progress=lambda text, *at: told.append(at))
    assert told == [(step, 40) for step in range(1, len(told) + 1)]
    assert found.margin <= 1


def test_consistent_pairs_stay_as_they_are():
    problem = structure(np.ones((2, 2)))
    found = rid.advise.improve_kautz(problem)
    assert found.problem is problem
    assert len(found.trials) == 1
    assert found.note == ""
    assert found.identify().notes == ()
    # Asked for less than the truth reaches, the search ends where no step is worth it, and says so.
    further = rid.advise.improve_kautz(problem, target=0.01)
    assert 0.01 < further.margin <= found.margin
    assert "promises 0.2 % less" in further.reason


def test_exact_data_give_exact_poles_in_few_steps():
    truth = rid.datasets.flexible_structure()
    w = 2 * np.pi * np.concatenate([np.linspace(1, 21, 6), FINE[::2]])
    exact = rid.FrequencyResponse(w, truth.truth(np.exp(1j * w * DT)), bound=0.03, dt=DT)
    wrong = truth.modes * [[1.005, 1.5], [0.99, 0.5]]
    problem = dataclasses.replace(about_structure(truth, 1e-4, 1.1, modes=wrong), frequency=exact)
    found = rid.advise.improve_kautz(problem, target=1e-3, repeat=False)
    np.testing.assert_allclose(found.omega, truth.modes[:, 0], rtol=1e-4)
    np.testing.assert_allclose(found.damping, truth.modes[:, 1], rtol=1e-3)
    errors = np.array([abs(t.omega[1] / truth.modes[1, 0] - 1) for t in found.trials if t.kept]) / 0.004
    # In half-widths: from 2.5, and at the end each about the square of the one before.
    assert errors[0] > 2
    assert errors[-2] < 0.1
    assert errors[-1] < 3 * errors[-2] ** 2


def test_diagnosis_offers_moved_poles():
    found = rid.diagnose(rid.identify(structure([[1, 1], [1.01, 1]], extra=FINE, K=0.05)))
    moved = next(t for t in found.corrections if "moved" in t.name)
    assert "poles moved, to 9.0" in moved.name
    assert ", 17.67 Hz with damping 0.00" in moved.name
    assert moved.margin <= 1
    assert rid.identify(moved.problem).consistent
    assert "Poles that were moved" in found.summary()
    consistent = rid.identify(structure(np.ones((2, 2)), extra=()))
    assert not any("moved" in t.name for t in rid.diagnose(consistent).corrections)


def test_class_without_a_mode_is_not_repaired():
    problem = structure(np.ones((2, 2)))
    light = rid.kautz(2 * np.pi * 17.67, 0.004, dt=DT, delay=1)
    problem = rid.MixedProblem(frequency=problem.frequency, prior=problem.prior, parametric=light)
    found = rid.advise.improve_kautz(problem)
    assert found.margin_lower > 1
    assert found.margin == min(trial.margin for trial in found.trials)
    assert "promises 0.2 % less" in found.reason or "no further step" in found.reason


def test_units_of_the_output_do_not_matter():
    unit, off = 2.0**60, [[1, 1], [0.995, 1.5]]
    problem = structure(off, extra=(), K=0.05)
    frf, record = problem.frequency[0], problem.time[0]
    scaled = rid.MixedProblem(
        frequency=rid.FrequencyResponse(frf.omega, unit * frf.values, bound=unit * frf.bound, dt=DT),
        time=rid.TimeRecord(record.u, unit * record.y, dt=DT, bound=unit * record.bound),
        prior=rid.Prior(gain_bound=unit * 0.05, decay_rate=1.1),
        parametric=problem.parametric,
    )
    first, second = rid.advise.improve_kautz(problem), rid.advise.improve_kautz(scaled)
    np.testing.assert_array_equal(first.omega, second.omega)
    np.testing.assert_array_equal(first.damping, second.damping)
    assert first.margin == second.margin


@pytest.mark.parametrize(("repeat", "delay"), [(1, 0), (1, 1), (2, 1), (3, 0), (2, 3)])
def test_pairs_are_found_among_other_functions(repeat, delay):
    pairs = rid.kautz([30.0, 157.07963267948966], [0.02, 1e-4], dt=DT, repeat=repeat, delay=delay)
    others = control.ss([[0.5, 0.1], [-0.1, 0.5]], [[1], [0]], np.eye(2), 0, DT), control.ss([], [], [], 1, DT)
    basis = as_basis([others[0], pairs, control.ss(1, 1, 1, 0, DT), others[1]], ZPlane(DT))
    found = taken_apart(basis)
    assert [(p.repeat, p.delay) for p in found.pairs] == [(repeat, delay)] * 2
    np.testing.assert_allclose(np.exp(found.start), [[30, 0.02], [157.07963267948966, 1e-4]], rtol=1e-9)
    same, angles = found.at(found.start), np.linspace(0.1, 3.1, 40)
    np.testing.assert_allclose(same.response(angles), basis.response(angles), rtol=1e-7, atol=1e-9)
    assert same.labels == basis.labels
    np.testing.assert_allclose(np.sort_complex(same.poles), np.sort_complex(basis.poles), atol=1e-9)
    moved = found.at(found.start + np.array([[0, 0.1], [0.01, 0]]))
    omega, damping = [30.0, 157.07963267948966 * np.exp(0.01)], [0.02 * np.exp(0.1), 1e-4]
    expected = rid.kautz(omega, damping, dt=DT, repeat=repeat, delay=delay)
    np.testing.assert_allclose(moved.response(angles)[:, 2:-2], expected.response(angles), rtol=1e-7, atol=1e-9)
    np.testing.assert_allclose(moved.response(angles)[:, :2], basis.response(angles)[:, :2], rtol=1e-12)


def improved(target=1.0, time_limit=None, **changes):
    problem = dataclasses.replace(structure(np.ones((2, 2))), **changes)
    return rid.advise.improve_kautz(problem, target=target, time_limit=time_limit)


test_improve_kautz_refuses = refusals(
    (lambda: improved(target=0), "`target`"),
    (lambda: improved(time_limit=0.0), "`time_limit` must be positive"),
    (lambda: improved(parametric=None), "must have pairs made by `kautz`"),
    (lambda: improved(parametric=control.ss(0.5, 1, 1, 0, DT)), "must have pairs made by"),
    (lambda: improved(parameter_bounds=[[-1, 1]] * 4), "intervals of coefficients mean other functions"),
    (lambda: rid.advise.improve_kautz(3), "`problem` must be a MixedProblem; got int", InputTypeError),
)

"""Modes that a run chooses never end it: those that the data cannot tell apart are left out, the least important first."""

import dataclasses

import numpy as np
import pytest

import robustid as rid
from robustid.app.run.fewer_modes import INTEGRATOR, superfluous, without_mode
from robustid.app.run.measurements import Measured
from robustid.app.run.modes import basis_of
from robustid.app.run.posing import posed
from robustid.app.run.run_file import read_run_file
from robustid.app.run.run_folder import RunFolder, Surroundings
from robustid.app.run.settings import Modes
from robustid.core import Budget
from robustid.identification import any_prior
from support.cases import seeds, slow

DT = 0.005


def record_of(seed):
    """A plant of two pairs of close modes, from an unknown state, moved by a step."""
    rng = np.random.default_rng([seed, 5])
    hz = rng.uniform(5, 60, 2)
    basis = rid.kautz(
        2 * np.pi * np.concatenate([hz, hz * rng.uniform(1.0005, 1.02)]), rng.uniform(0.001, 0.05, 4), dt=DT
    )
    u = np.ones(80)
    y = np.convolve(u, basis.impulse(80) @ rng.standard_normal(basis.size))[:80]
    noise = 1e-3 * y.std()
    return rid.TimeRecord(u, y + noise * rng.uniform(-1, 1, 80), dt=DT, initial="free", bound=2 * noise)


def of_data(data, **sections):
    return posed(read_run_file(sections, "a test", sources=False), data, Surroundings(), reference=False)


@pytest.mark.parametrize("seed", seeds(1, 3))
def test_steps_from_an_unknown_state_never_end_a_run(seed):
    """What a step adds to free responses is one constant, whatever the modes: no mode can be told from its transient."""
    data = Measured((), (record_of(seed),))
    run, problem, _ = of_data(data, modes={"count": 1}, prior={"gain_bound": 10.0, "decay_rate": 1.05})
    assert "\nLeft out, because the data cannot tell it apart from the others: " in run.modes.note
    assert rid.identify(problem).margin < np.inf


def test_modes_that_are_stated_are_refused():
    data = Measured((), (record_of(0),))
    with pytest.raises(rid.InputError, match="the data cannot tell its 4 functions"):
        of_data(data, modes={"hz": [20.0], "damping": [0.01], "delay": 0})


def test_few_points_never_end_a_run_that_looks_for_its_modes():
    """Twelve real numbers for 14 functions: what was stated of repeats and integrators is kept."""
    asked = {"count": 2, "repeat": 3, "integrators": 2}
    omega = np.linspace(20.0, 300.0, 6)
    frf = rid.FrequencyResponse(omega, 1 / (100.0**2 - omega**2 + 2j * omega), bound=1e-6, dt=DT)
    run, problem, _ = of_data(Measured((frf,), ()), modes=asked)
    assert (run.modes.repeat, run.modes.integrators) == (3, 2)
    assert len(run.modes.hz) < 2
    assert rid.identify(problem).margin < np.inf


def problem_of(modes, y_of):
    """Exact lines of a sum of the functions of the modes."""
    basis = basis_of(modes, DT)
    omega = np.linspace(10.0, 500.0, 40)
    frf = rid.FrequencyResponse(omega, basis.response(omega * DT) @ np.asarray(y_of), bound=1e-3, dt=DT)
    return rid.MixedProblem(frequency=frf, prior=any_prior(DT), parametric=basis)


OPEN = Modes()


def test_the_least_important_of_those_that_depend_on_each_other_is_left_out():
    """Neither the smallest of all, which the data tell from the others, nor the larger of the two that are one."""
    near = 20.0 * (1 + 1e-13)
    modes = Modes(hz=(5.0, 20.0, near), damping=(0.1, 0.01, 0.01), delay=0, note="Modes.")
    problem = problem_of(modes, [1e-3, 0, 1, 0, 1, 0])
    number = superfluous(modes, OPEN, problem)
    assert number in (1, 2)
    fewer = without_mode(modes, number)
    assert len(fewer.hz) == 2
    assert fewer.hz[0] == 5.0
    assert (
        fewer.note
        == f"{modes.note}\nLeft out, because the data cannot tell it apart from the others: 20 Hz, damping 0.01."
    )
    assert superfluous(fewer, OPEN, problem_of(fewer, [1e-3, 0, 1, 0])) is None


def test_integrators_that_the_program_chose_go_too_and_stated_ones_stay():
    """At few points of a rigid body alone, beside one mode that is most of the response."""
    modes = Modes(hz=(20.0,), damping=(0.01,), integrators=2, delay=0, note="")
    basis = basis_of(modes, DT)
    omega = np.array([90.0])
    frf = rid.FrequencyResponse(omega, basis.response(omega * DT) @ [1e-9, 1e-9, 1, 1], bound=1e-3, dt=DT)
    problem = rid.MixedProblem(frequency=frf, prior=any_prior(DT), parametric=basis)
    assert superfluous(modes, OPEN, problem) == INTEGRATOR
    assert without_mode(modes, INTEGRATOR).integrators == 1
    assert superfluous(modes, Modes(integrators=2), problem) == 0
    assert superfluous(modes, Modes(hz=(20.0,), damping=(0.01,)), problem) is None


def test_more_points_than_any_form_takes_never_end_a_run_that_chooses_its_class(monkeypatch):
    """Of 24 points six are taken: every fourth is used, the others test, those too that were to be kept out anyway."""

    def step_to_6(problem, **_):
        return -(-problem.frequency[0].omega.size // 6)

    monkeypatch.setattr("robustid.app.run.posing.computable_step", step_to_6)
    omega = np.linspace(20.0, 300.0, 24)
    data = Measured((rid.FrequencyResponse(omega, 1e4 / (100.0**2 - omega**2 + 2j * omega), bound=0.05, dt=DT),), ())
    run, problem, left = of_data(data, modes={"hz": [100 / (2 * np.pi)], "damping": [0.01]})
    assert run.frequency_points.every == 4
    assert "One of 4 frequency points is used" in run.prior.note
    np.testing.assert_array_equal(problem.frequency[0].omega, omega[::4])
    np.testing.assert_array_equal(np.sort([*omega[::4], *left.points[0].omega]), omega)
    assert problem.prior == run.prior.stated(DT)
    assert rid.identify(problem).margin < np.inf


def two_outputs(count=24, **how):
    omega = np.linspace(20.0, 300.0, count)
    values = 1e4 / (100.0**2 - omega**2 + 2j * omega)
    return rid.FrequencyResponse(omega, np.stack([values, 2 * values], 1)[:, :, None], dt=DT, **how)


def in_a_second(data, monkeypatch, **sections):
    """What is posed of data of which a quarter is all that there is time for."""
    monkeypatch.setattr(
        "robustid.app.run.posing.computable_step", lambda problem, seconds=None, **_: 1 if seconds is None else 4
    )
    around = Surroundings(budget=Budget(60.0))
    stated = {"modes": {"hz": [100 / (2 * np.pi)], "damping": [0.01], "delay": 0}} | sections
    return *posed(read_run_file(stated, "a test", sources=False), data, around, reference=False), around


def test_a_matrix_is_decided_at_as_many_points_as_there_is_time_for(monkeypatch):
    """That is said first, the class stays, and the others are tests; faults are those of all points."""
    frf = two_outputs(bound=0.05)
    run, problem, left, around = in_a_second(Measured((frf,), ()), monkeypatch)
    assert run.frequency_points.every == 4
    assert "all of them take longer than the time limit leaves" in run.prior.note
    assert "one of 4 is used, the others test the result" in around.unfinished.sentence
    np.testing.assert_array_equal(problem.frequency[0].omega, frf.omega[::4])
    np.testing.assert_array_equal(np.sort([*frf.omega[::4], *left.points[0].omega]), frf.omega)
    assert run.prior.is_from_data
    assert problem.prior == run.prior.stated(DT)
    assert problem.frequency[0].judged


@pytest.mark.parametrize("count", [25, slow(97)])
def test_where_no_class_holds_all_points_one_is_chosen_for_those_that_there_is_time_for(monkeypatch, count):
    """Every fourth point is that of the plant, and between them each is wrong by ten times its bound, this way and that."""
    frf = two_outputs(count)
    off = np.where(np.arange(count) % 4, 10.0, 0.0) * np.where(np.arange(count) % 8 > 4, 1, -1)
    wrong = dataclasses.replace(frf, values=frf.values + 0.05 * off[:, None, None], bound=0.05)
    run, problem, left, around = in_a_second(Measured((wrong,), ()), monkeypatch)
    assert run.frequency_points.every == 4
    assert run.prior.is_from_data
    assert rid.identify(problem).consistent
    assert left.points[0].omega.size == count // 4 * 3
    assert "one of 4 is used" in around.unfinished.sentence


def test_no_points_are_left_out_of_a_class_that_was_not_looked_for_to_the_end(monkeypatch):
    run, _, _, _ = in_a_second(
        Measured((two_outputs(bound=0.05),), ()), monkeypatch, prior={"gain_bound": 5.0, "decay_rate": 1.1}
    )
    assert run.frequency_points.every == 1
    monkeypatch.setattr("robustid.app.run.run_folder._NO_TIME", 1e-9)
    monkeypatch.setattr("robustid.app.run.class_choice._PRIOR", 1e-9)
    run, _, _, _ = in_a_second(Measured((two_outputs(bound=0.05),), ()), monkeypatch)
    assert run.prior.source == "stopped"
    assert run.frequency_points.every == 1


def test_a_run_of_fewer_points_is_gone_on_with(tmp_path, monkeypatch):
    """It asked for all of them: with more time it takes them."""
    asked = read_run_file(
        {"frequency": [{"file": "response.npz"}], "modes": {"hz": [15.9], "damping": [0.01], "delay": 0}}
    )
    data = Measured((two_outputs(bound=0.05),), ())
    run, *_ = in_a_second(
        data, monkeypatch, frequency=[{"file": "response.npz"}], modes={"hz": [15.9], "damping": [0.01], "delay": 0}
    )
    folder = RunFolder(tmp_path, resume=True)
    folder.choices(run)
    again = folder.asked(asked)
    assert again.modes == run.modes
    assert (again.frequency_points, again.prior, again.withheld) == (
        asked.frequency_points,
        asked.prior,
        asked.withheld,
    )


@pytest.mark.parametrize("points", [1, 3])
def test_of_few_frequency_points_no_mode_is_chosen(points):
    omega = np.linspace(10.0, 40.0, points)
    frf = rid.FrequencyResponse(omega, 1 / (2 - np.exp(-1j * omega * DT)), bound=0.05, dt=DT)
    found = of_data(Measured((frf,), ()))[1]
    assert found.parametric is None
    assert rid.identify(found).consistent

"""Modes that rest on one frequency point, and those that several ask for."""

import dataclasses

import numpy as np
import pytest

import robustid as rid
from robustid.advice import suggest_kautz, suspect_modes
from robustid.app.run.measurements import Measured
from robustid.app.run.modes import with_faults, with_modes
from robustid.app.run.run_file import RunFile
from robustid.app.run.run_folder import Surroundings

DT, HZ = 2e-3, 2 * np.pi
OMEGA = HZ * np.arange(2.0, 62.0, 0.5)


def response(half_width, seed=0):
    """A mode at 17.67 Hz and a small one at 40 Hz, which is that narrow in line spacings."""
    rng, s = np.random.default_rng(seed), 1j * OMEGA
    w, v, d = HZ * 17.67, HZ * 40.0, half_width * HZ * 0.5
    values = w**2 / (s**2 + 0.02 * w * s + w**2) + 0.5 * d * v / (s**2 + 2 * d * s + v**2 + d**2)
    noise = rng.standard_normal(s.size) + 1j * rng.standard_normal(s.size)
    return rid.FrequencyResponse(OMEGA, values + 5e-3 * noise, bound=0.03, dt=DT)


@pytest.mark.parametrize("seed", range(3))
def test_a_mode_of_one_line_is_suspect_and_leaving_the_line_out_leaves_no_such_mode(seed):
    frf = response(0.002, seed)
    found = suggest_kautz(frf)
    assert np.abs(found.omega / HZ - 40).min() < 0.5
    (fault,) = suspect_modes(frf, found.omega, found.damping)
    assert fault.kind == "outlier"
    rest = rid.prepare.correct(frf, fault.correction)
    assert np.array_equal(rest.omega, np.delete(OMEGA, np.argmin(np.abs(OMEGA - HZ * 40))))
    again = suggest_kautz(rest)
    assert again.omega / HZ == pytest.approx([17.67], rel=1e-3)
    assert suspect_modes(rest, again.omega, again.damping) == ()


@pytest.mark.parametrize("half_width", [0.3, 1.0])
def test_a_mode_that_neighbours_ask_for_is_none(half_width):
    frf = response(half_width)
    found = suggest_kautz(frf)
    assert suspect_modes(frf, found.omega, found.damping) == ()


def test_a_mode_below_the_lines_is_the_slope_there_and_no_line():
    omega = HZ * np.geomspace(40, 400, 30)
    values = HZ * 300 / (1j * omega + HZ * 3)  # a slow real pole, which light modes below the lines follow too
    frf = rid.FrequencyResponse(omega, values, bound=0.05 * np.abs(values))
    assert suspect_modes(frf, HZ * np.array([2.2, 2.3, 4.2]), np.array([0.03, 0.03, 0.5])) == ()


def test_a_run_keeps_it_among_the_faults_of_its_data_once():
    frf = response(0.002)
    around, data = Surroundings(lambda *_: None), Measured((frf,), ())
    run = with_modes(RunFile(), data, around)
    problem = rid.MixedProblem(
        frequency=with_faults(run, data, around).responses, prior=rid.Prior(gain_bound=1.0, decay_rate=1.1)
    )
    assert [fault.kind for fault in problem.data_faults] == ["outlier"]
    stated = dataclasses.replace(run.modes, source="stated")
    assert len(with_faults(dataclasses.replace(run, modes=stated), data, around).responses[0].faults) <= 1

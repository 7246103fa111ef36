"""Runs of records alone: their poles come from a fit of them, and the class says something between the samples."""

from pathlib import Path

import control
import numpy as np
import pytest
from typer.testing import CliRunner

import robustid as rid
from robustid.advice import possible_rates
from robustid.app.cli.main import app
from robustid.app.run.class_settings import PriorChoice
from robustid.app.run.measurements import _detrended
from robustid.app.run.modes import modes_of_records
from robustid.app.run.sources import RecordSource
from robustid.core import responses, simulate
from support.posed import proposed

DATA = rid.datasets.flexible_structure(lines=5, samples=150)
SHORT = rid.datasets.flexible_structure(lines=5, samples=60)


def test_the_modes_of_a_structure_are_those_of_its_record():
    """The smallest order inside the bounds is the true one."""
    rows, words = modes_of_records([DATA.time])
    assert "order 4, the smallest that keeps every sample within" in words
    np.testing.assert_allclose([row.hz for row in rows], [9.0, 17.67], rtol=0.01)
    np.testing.assert_allclose([row.damping for row in rows], [0.1, 0.004], rtol=0.3)


def run_of_a_record():
    rid.save("record.npz", SHORT.time)
    text = '[[record]]\nfile = "record.npz"\nuse = "samples"\n[worst_case]\nat_hz = [12.0, 16.0]\ndirections = 3\n'
    Path("run.toml").write_text(text)
    return rid.run("run.toml", "out")


@pytest.mark.usefixtures("unreduced", "unsharpened", "unpaged")
def test_a_run_of_a_record_alone_is_consistent_and_holds_the_plant(tmp_path, monkeypatch):
    """Without poles the default class contradicted the same record."""
    monkeypatch.chdir(tmp_path)
    found = run_of_a_record()
    assert found.consistent
    assert found.run_file.modes.note.startswith("Modes taken from a fit of the records:")
    assert len(found.run_file.modes.hz) == 2
    away = np.abs(responses(SHORT.truth, found.error.omega * 0.01)[:, 0, 0] - found.error.nominal)
    assert np.all(away <= found.error.upper[:, 0, 0])
    assert found.error.upper.max() < 0.2 * np.abs(found.error.nominal).max()
    assert "not for the box." in found.summary()


@pytest.mark.slow
@pytest.mark.usefixtures("unreduced")
def test_a_run_of_a_record_alone_is_that_of_its_run_file_and_of_the_command(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    found = run_of_a_record()
    again = rid.run("out/run.toml", "again")
    assert again.identification.margin == found.identification.margin
    line = ["identify", "--time", "record.npz", "--no-reduce", "-o", "result"]
    assert CliRunner().invoke(app, line).exit_code == 0
    poles = [r.problem.parametric.poles for r in (rid.load("result"), found.identification)]
    np.testing.assert_allclose(*poles, rtol=1e-9)


def test_modes_are_as_many_as_asked_for_and_none_where_nothing_is_known():
    assert len(modes_of_records([DATA.time], count=1)[0]) <= 1
    rows, words = modes_of_records([DATA.time.window(0.0, 0.05)])
    assert rows == ()
    assert words == "No parametric part: the records have too few samples for a fit."
    short = rid.TimeRecord(np.eye(1, 6)[0], 0.5 ** np.arange(6.0), dt=1.0, bound=1e-3)
    problem, _ = proposed(time=[short], prior=PriorChoice(passive="bounded real", decay_rate=1.1))
    assert problem.parametric is None


def test_poles_that_a_record_cannot_tell_are_left_out():
    """A pole that hardly moves within the record, and one that is gone after a sample."""
    plant = control.tf([1.0, 0.0], [1.0, -0.9998], 1.0) + control.tf([2.0, 0.0], [1.0, -0.2], 1.0)
    plant += control.tf([1.0, 0.0], [1.0, -0.9], 1.0)
    u = np.random.default_rng(3).normal(size=120)
    record = rid.TimeRecord(u, simulate(control.ss(plant), u[:, None])[0][:, 0], dt=1.0, bound=1e-3)
    rows, _ = modes_of_records([record])
    assert [round(np.exp(-2 * np.pi * row.hz), 3) for row in rows] == [pytest.approx(0.9, abs=0.01)]


def test_classes_for_unknown_initial_states_forget_them_within_the_record():
    """A class that hardly decays over the record holds any data: the free response takes it all."""
    record = rid.TimeRecord(DATA.time.u, DATA.time.y, dt=0.01, bound=0.1, initial="free")
    problem = rid.MixedProblem(time=record, prior=rid.Prior(gain_bound=1.0, decay_rate=1.1))
    assert possible_rates(problem)[0] ** -len(record.u) < 0.05
    rest = rid.MixedProblem(time=DATA.time, prior=problem.prior)
    assert possible_rates(rest)[0] < possible_rates(problem)[0]


def test_a_bound_beside_detrend_is_about_what_is_left():
    record = rid.TimeRecord(DATA.time.u, DATA.time.y + 5.0, dt=0.01, bound=0.1, initial="free")
    found = _detrended(record, RecordSource(file="record.npz", detrend="mean"))
    assert np.abs(found.y.mean()) < 1e-12
    assert np.array_equal(found.bound, record.bound)
    assert found.note.endswith("of what is left by detrend")

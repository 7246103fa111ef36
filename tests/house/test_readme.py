"""The README as its readers follow it: the snippet and the command lines, on files like those that the demo writes."""

import re
import shlex
from pathlib import Path

import numpy as np
import pytest

import robustid as rid
from robustid.app.cli import main as cli

README = Path(__file__).parents[2] / "README.md"


AS_THE_DEMO = {"extra_hz": np.linspace(17.2, 18.1, 10)}
FEWER = {"lines": 5, "samples": 3, "extra_hz": [17.5, 17.67, 17.8]}  # coefficients: 19 for 62


@pytest.fixture(params=[FEWER, pytest.param(AS_THE_DEMO, marks=pytest.mark.slow)], ids=["fewer samples", "the demo's"])
def demo_files(tmp_path, monkeypatch, request):
    folder = tmp_path / "robustid-demo"
    folder.mkdir()
    data = rid.datasets.flexible_structure(seed=0, **request.param)
    rid.save(folder / "frequency.csv", data.frequency)
    rid.save(folder / "step.csv", data.time)
    monkeypatch.chdir(tmp_path)
    return tmp_path


TEXT = README.read_text(encoding="utf-8")
PYTHON = re.findall(r"```python\n(.*?)```", TEXT, re.S)


def commands(comment):
    """The words of the command lines below a comment."""
    found = re.search(rf"<!-- {comment} -->\n```sh\n(.*?)```", TEXT, re.S)[1]
    return [shlex.split(line) for line in found.splitlines()]


def names_of(number, names=None):
    """What is defined once a block of Python has run, after others."""
    names = {} if names is None else names
    exec(compile(PYTHON[number], "README.md", "exec"), names)
    return names


def test_the_python_snippet_and_then_the_command_lines_run_as_printed(demo_files, capsys, monkeypatch):
    names = names_of(0)
    assert names["result"].consistent
    assert names["result"].warnings == ()
    assert names["small"].order < names["result"].order
    assert "consistent" in capsys.readouterr().out
    assert rid.load("result").consistent
    assert "<html" in Path("report.html").read_text(encoding="utf-8")
    names_of(1, names)
    assert names["error"].certified
    assert np.all(names["tube"].lower <= names["tube"].upper)
    assert rid.load("bounds").certified
    lines = commands("command line")
    assert [words[1] for words in lines] == ["identify", "reduce", "report", "bounds", "verify", "fit"]
    for words in lines:
        faster = ["--directions", "3", "--points", "4"] if words[1] == "bounds" else []  # as printed half a minute
        run([*words, *faster], capsys, monkeypatch)
    for name in ("mine.npz", "mine.json", "mine.html", "small.mat", "again.html", "fitted.npz", "fitted.html"):
        assert Path(name).stat().st_size > 0


def test_the_snippet_with_several_channels_runs_as_printed(capsys):
    names = names_of(2)
    assert names["plate"].consistent
    assert names["plate"].verification.passed
    assert (names["plate"].model.noutputs, names["plate"].model.ninputs) == (2, 2)
    assert len(names["plate"].modes) == 2
    assert "2 inputs (left [V], right [V]), symmetric" in capsys.readouterr().out


def run(words, capsys, monkeypatch):
    monkeypatch.setattr("sys.argv", words)
    with pytest.raises(SystemExit) as stop:
        cli.main()
    assert not stop.value.code, capsys.readouterr().err


def test_signals_are_played_and_their_records_read_as_printed(tmp_path, capsys, monkeypatch):
    """Between the two commands, somebody measures."""
    monkeypatch.chdir(tmp_path)
    excite, frf = commands("from signals")
    assert (excite[1], frf[1]) == ("excite", "frf")
    run(excite, capsys, monkeypatch)
    play, rng = rid.load("play.csv"), np.random.default_rng(0)
    for k, u in enumerate(play.u):
        u = np.tile(u, (play.periods, 1))
        y = u @ [[1.0, 2.0], [0.5, -1.0]] + 0.01 * rng.standard_normal(u.shape)
        rows = np.column_stack([play.dt * np.arange(len(u)), u, y])
        np.savetxt(f"run{k + 1}.csv", rows, delimiter=",", header="time,u1,u2,y1,y2", comments="")
    run(frf, capsys, monkeypatch)
    frf = rid.load("frf.npz")
    assert frf.omega.size == 79
    assert np.all(np.abs(frf.values - np.array([[1.0, 0.5], [2.0, -1.0]])) <= frf.bound)
    assert Path("frf.html").stat().st_size > 0


def test_the_fraction_of_the_readme_is_fitted_as_printed(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    names = names_of(4)
    assert names["fit"].status.converged
    assert names["fit"].model.nstates == 6
    assert capsys.readouterr().out.count("ModeRow") == 2
    assert Path("fit.html").stat().st_size > 0


def test_the_records_of_the_readme_give_a_response_as_printed(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    frf = names_of(3)["frf"]
    delay = np.exp(-1j * frf.omega * frf.dt)[:, None, None]
    truth = delay * [[0.8, 0], [0, 0]] + [[0, 0.1], [0, 0.5]]
    assert np.all(np.abs(frf.values - truth) <= frf.bound)
    assert "95 % jointly" in capsys.readouterr().out
    assert rid.load("frf.npz").dof == frf.dof
    assert "Spectra of the records" in Path("frf.html").read_text(encoding="utf-8")

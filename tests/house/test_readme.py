"""The README as its readers follow it: the block of Python and the command lines, on files like those of the demo."""

import re
import shlex
from pathlib import Path

import numpy as np
import pytest

import robustid as rid
from robustid.app.cli import main as cli
from support.run_files import search_nothing

README = Path(__file__).parents[2] / "README.md"
HOWTO = README.parent / "docs" / "howto" / "command_line.rst"
CLASS = ["--mode", "9:0.1", "--mode", "17.67:0.004", "--gain", "0.2", "--decay-rate", "1.1"]

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
    if request.param is FEWER:
        search_nothing(monkeypatch)
    return tmp_path


TEXT = README.read_text(encoding="utf-8")
PYTHON = re.findall(r"```python\n(.*?)```", TEXT, re.S)


def commands(comment):
    """The words of the command lines below a comment."""
    found = re.search(rf"<!-- {comment} -->\n```sh\n(.*?)```", TEXT, re.S)[1]
    return [shlex.split(line) for line in found.splitlines()]


def test_it_is_short():
    assert len(TEXT.splitlines()) <= 120
    assert len(PYTHON) == 1


def test_the_python_block_runs_as_printed(demo_files, capsys):
    names = {}
    exec(compile(PYTHON[0], "README.md", "exec"), names)
    assert names["result"].consistent
    assert names["result"].warnings == ()
    assert names["small"].order < names["result"].order
    assert "consistent" in capsys.readouterr().out
    assert rid.load("result").consistent
    assert "<html" in Path("report.html").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("where", "names", "written"),
    [
        (
            "README.md",
            ["look", "identify", "bounds", "reduce", "export"],
            ["mine.npz", "mine.json", "mine.html", "mine-bounds.html", "small.npz", "small.h"],
        ),
        pytest.param(
            "docs/howto/command_line.rst",
            ["identify", "reduce", "report", "bounds", "verify", "fit"],
            ["by-hand.npz", "by-hand.html", "small.mat", "again.html", "fitted.npz", "fitted.html"],
            marks=pytest.mark.slow,  # each of them is tested elsewhere
        ),
    ],
)
def test_the_command_lines_run_as_printed(demo_files, capsys, monkeypatch, where, names, written):
    page = re.search(r"\.\. commands: .*?code-block:: sh\n\n(.*?)\n\n", HOWTO.read_text(encoding="utf-8"), re.S)
    lines = [shlex.split(line) for line in page[1].splitlines()] if "docs" in where else commands("command line")
    assert [words[1] for words in lines] == names
    for words in lines:
        faster = {"bounds": ["--directions", "3", "--points", "4"], "identify": CLASS}.get(words[1], [])
        run([*words, *faster], capsys, monkeypatch)  # as printed half a minute
    for name in written:
        assert Path(name).stat().st_size > 0


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

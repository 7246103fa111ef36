"""The command line as a user meets it: real files, exit codes, sentences."""

import control
import numpy as np
import pytest
from typer.testing import CliRunner

import robustid as rid
from robustid import cli

runner = CliRunner()


@pytest.fixture
def files(tmp_path, monkeypatch):
    data = rid.flexible_structure(seed=0)
    rid.save(tmp_path / "frf.csv", data.frequency)
    rid.save(tmp_path / "step.csv", data.time)
    monkeypatch.chdir(tmp_path)
    return tmp_path


COMMAND = ["identify", "--frequency", "frf.csv", "--time", "step.csv"]
CLASS = ["--mode", "9:0.1", "--mode", "17.67:0.004", "--gain", "0.2", "--decay", "1.1"]


def run(arguments, capsys, monkeypatch):
    """Through `main`, as the installed command does; returns (exit code, stdout, stderr)."""
    monkeypatch.setattr("sys.argv", ["robustid", *arguments])
    monkeypatch.setenv("COLUMNS", "200")
    with pytest.raises(SystemExit) as stop:
        cli.main()
    out = capsys.readouterr()
    return stop.value.code or 0, out.out, out.err


def test_identify_reduce_and_report_on_files(files, capsys, monkeypatch):
    code, out, _ = run([*COMMAND, *CLASS, "-o", "first", "--report", "first.html"], capsys, monkeypatch)
    assert code == 0
    assert "onsistent" in out
    result = rid.load_identification("first")
    assert result.consistent
    assert "<html" in (files / "first.html").read_text(encoding="utf-8")
    code, out, _ = run(["reduce", "first", "-o", "small.mat"], capsys, monkeypatch)
    assert code == 0
    assert "order 4" in out
    code, _, _ = run(["reduce", "small.mat", "--order", "2", "-o", "smaller.npz"], capsys, monkeypatch)
    assert code == 0
    from robustid.reduction.model_files import load_model

    assert load_model("smaller.npz").nstates == 2
    assert load_model("small.mat").dt == 0.01
    code, out, _ = run(["report", "first.json", "-o", "again.html"], capsys, monkeypatch)
    assert code == 0
    assert (files / "again.html").exists()


def test_inconsistent_data_exit_with_3_and_say_what_would_help(files, capsys, monkeypatch):
    wrong = ["--mode", "9:0.1", "--mode", "17.4:0.004", "--gain", "0.2", "--decay", "1.1", "--no-reduce"]
    code, out, _ = run([*COMMAND, *wrong], capsys, monkeypatch)
    assert code == 3
    assert "nconsistent" in out
    assert "margin" in out.lower()
    assert not rid.load_identification(files / "result").consistent


def test_column_names_and_units_are_given_by_options(files, capsys, monkeypatch):
    frf = rid.flexible_structure(seed=0).frequency
    rows = np.column_stack([frf.freq_hz, frf.values[:, 0, 0].real, frf.values[:, 0, 0].imag])
    np.savetxt("odd.csv", rows, delimiter=",", header="where,x,y", comments="")
    fields = ["--frequency-field", "omega=where", "--frequency-field", "real=x", "--frequency-field", "imag=y"]
    options = ["--frequency-unit", "Hz", "--dt", "0.01", "--frequency-bound", "0.03", "--no-reduce"]
    code, _, err = run(["identify", "--frequency", "odd.csv", *fields, *options, *CLASS], capsys, monkeypatch)
    assert code == 0, err
    assert np.allclose(rid.load_identification("result").problem.frequency[0].omega, frf.omega)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["identify"], "--frequency"),
        (["identify", "--frequency", "nothing.csv"], "nothing.csv"),
        ([*COMMAND, "--gain", "0.2"], "--decay"),
        ([*COMMAND, "--mode", "17"], "HZ:DAMPING"),
        ([*COMMAND, "--mode", "9:2"], "damping"),
        ([*COMMAND, "--channel", "0"], "OUTPUT,INPUT"),
        ([*COMMAND, "--time-field", "u"], "ROLE=NAME"),
        ([*COMMAND, *CLASS, "--objective", "best"], "objective"),
        ([*COMMAND, *CLASS, "--solver", "NONE"], "solver"),
        ([*COMMAND, "-o", "no/such/folder/x"], "folder"),
        (["identify", "--frequency", "bad.mat", "--dt", "0.01", "--frequency-bound", "1"], "bad.mat"),
        (["reduce", "nothing.npz"], "nothing.npz"),
        (["reduce", "bad.mat"], "bad.mat"),
        (["report", "nothing"], "missing"),
    ],
)
def test_misuse_exits_with_2_and_one_sentence(files, capsys, monkeypatch, arguments, words):
    (files / "bad.mat").write_bytes(b"\x89PNG\r\n\x1a\n" + bytes(300))
    before = sorted(files.iterdir())
    code, _, err = run(arguments, capsys, monkeypatch)
    assert code == 2
    assert words in " ".join(err.split())
    assert "Traceback" not in err
    assert sorted(files.iterdir()) == before


def test_existing_results_are_not_replaced_unasked(files, capsys, monkeypatch):
    (files / "result.npz").write_text("precious")
    code, _, err = run([*COMMAND, *CLASS], capsys, monkeypatch)
    assert code == 2
    assert "--force" in err
    assert (files / "result.npz").read_text() == "precious"


def test_an_unstable_model_is_refused_or_kept(files, capsys, monkeypatch):
    from robustid.reduction.model_files import load_model, save_model

    save_model(control.ss([[1.0, 0], [0, 0.5]], [[1], [1]], [[1, 1]], [[0]], 0.1), "integrator.npz")
    code, _, err = run(["reduce", "integrator.npz", "--order", "1"], capsys, monkeypatch)
    assert code == 2
    assert "stab" in err
    code, _, _ = run(["reduce", "integrator.npz", "--order", "1", "--keep-unstable"], capsys, monkeypatch)
    assert code == 0
    assert load_model("reduced.npz").poles() == pytest.approx([1.0])


@pytest.mark.parametrize("command", [[], ["identify"], ["reduce"], ["report"], ["demo"]])
def test_help_teaches(command):
    text = runner.invoke(cli.app, [*command, "--help"]).output
    assert len(text) > 400
    assert "Usage" in text

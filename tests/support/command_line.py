"""The command line as tests call it."""

import pytest

from robustid.app.cli import main as cli

COMMAND = ["identify", "--frequency", "frf.csv", "--time", "step.csv"]
CLASS = ["--mode", "9:0.1", "--mode", "17.67:0.004", "--gain", "0.2", "--decay-rate", "1.1"]
SHORT = [*CLASS, "--no-reduce"]


def main(arguments, capsys, monkeypatch):
    """Through `main`, as the installed command does; returns (exit code, stdout, stderr)."""
    monkeypatch.setattr("sys.argv", ["robustid", *arguments])
    monkeypatch.setenv("COLUMNS", "200")
    with pytest.raises(SystemExit) as stop:
        cli.main()
    out = capsys.readouterr()
    return stop.value.code or 0, out.out, out.err


def words(arguments, capsys, monkeypatch):
    """The same with every white space as one blank."""
    code, out, err = main(arguments, capsys, monkeypatch)
    return code, " ".join(out.split()), " ".join(err.split())

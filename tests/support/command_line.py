"""The command line as tests call it."""

import contextlib
import shlex
from pathlib import Path

import pytest

from robustid.app.cli import main as cli
from support.interrupts import ctrl_c

COMMAND = ["identify", "--frequency", "frf.csv", "--time", "step.csv"]
CLASS = ["--mode", "9:0.1", "--mode", "17.67:0.004", "--gain", "0.2", "--decay-rate", "1.1"]
SHORT = [*CLASS, "--no-reduce"]


def main(arguments, capsys, monkeypatch, columns=200):
    """Through `main`, as the installed command does; returns (exit code, stdout, stderr)."""
    monkeypatch.setattr("sys.argv", ["robustid", *arguments])
    monkeypatch.setenv("COLUMNS", str(columns))
    with pytest.raises(SystemExit) as stop:
        cli.main()
    out = capsys.readouterr()
    return stop.value.code or 0, out.out, out.err


def words(arguments, capsys, monkeypatch):
    """The same with every white space as one blank."""
    code, out, err = main(arguments, capsys, monkeypatch)
    return code, " ".join(out.split()), " ".join(err.split())


def refused(outcome, sentence):
    """A command that ended with exit code 2 and this sentence, in the words of its options."""
    code, _, err = outcome
    assert code == 2, err
    assert sentence in " ".join(err.split())
    assert "`" not in err
    assert "Traceback" not in err


@contextlib.contextmanager
def nothing_written():
    """The folder in which the commands run holds the same bytes afterwards."""

    def held():
        return {path: path.is_file() and path.read_bytes() for path in Path().iterdir()}

    before = held()
    yield
    assert held() == before


def interrupted(run, arguments, monkeypatch):
    """Ctrl-C after the long part of a command, before anything is written: a word, an exit code and no files."""
    monkeypatch.setattr("robustid.report.render_report", ctrl_c)
    with nothing_written():
        code, _, err = run([*arguments, "--report", "page.html"])
    assert code == 130
    assert "interrupted" in err


def one_screen(out):
    """Assert that a result fits a terminal of 24 lines and 80 columns, without the steps, which a terminal replaces."""
    lines = [line for line in out.splitlines() if not line.endswith(" …")]
    assert sum(max(1, -(-len(line) // 80)) for line in lines) <= 24, out
    unbroken = "  robustid ", "read ", "written: ", "next: "  # by a terminal alone, the first by none: it is pasted
    assert all(len(line) <= 80 or line.startswith(unbroken) for line in lines)


def to_paste(out):
    """The command lines that an output offers, as a shell takes them, without the name of the program."""
    return [shlex.split(line)[1:] for line in out.splitlines() if line.startswith("  robustid ")]

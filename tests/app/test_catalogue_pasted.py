"""Every fault of the catalogue that a correction undoes: the command that is printed runs as pasted, and the fault is gone."""

import itertools
import re
import shlex

import pytest
from typer.testing import CliRunner

import robustid as rid
from robustid.app.cli.main import app
from support.fault_judge import CATALOGUE, faulty_of
from support.fault_plants import simulated
from support.faulty_files import CLASS
from support.run_files import only_identify

PLANT = "arm"
QUICK = ("early channel (periodic)",)  # others: test_undoing
UNDOABLE = [name for name, fault in CATALOGUE.items() if fault.corrections]
EACH = [name if name in QUICK else pytest.param(name, marks=pytest.mark.slow) for name in UNDOABLE]


def called(faulty):
    """The command of a user who has these measurements, which are written here."""
    if faulty.records:
        names = [f"record {k}.npz" for k in range(len(faulty.records))]
        for name, one in zip(names, faulty.records, strict=True):
            rid.save(name, one)
        return ["frf", *names, *(["--period", str(faulty.period)] if faulty.period else [])]
    rid.save("a response.npz", faulty.response)
    if faulty.step is None:
        return ["fit", "a response.npz", "--order", "2"]
    rid.save("step.npz", faulty.step)
    return ["identify", "--frequency", "a response.npz", "--time", "step.npz", *CLASS]


def ran(arguments):
    """Output of a command, which ends with a verdict."""
    done = CliRunner().invoke(app, arguments)
    assert done.exit_code in (0, 1, 3, 4), done.output + str(done.exception)
    return done.output


def pasted(output):
    """The line below the one that says that it undoes the fault, as a shell takes it; None without one."""
    lines = output.splitlines()
    places = [k for k, line in enumerate(lines) if line.startswith("next: undo the fault of the data")]
    return shlex.split(lines[places[0] + 1])[1:] if places else None


def verdict(output):
    """Beginning of the words on the first fault that nothing has undone; None without one."""
    found = re.search(r"^Fault of the data  (.{30})", output, re.MULTILINE)
    return found and found[1]


def corrections(command):
    """What a command undoes."""
    return [value for flag, value in itertools.pairwise(command) if re.fullmatch("--(frequency|time)-correct", flag)]


@pytest.mark.parametrize("name", EACH)
def test_the_printed_command_undoes_the_fault(name, tmp_path, monkeypatch):
    fault, clean = CATALOGUE[name], simulated(PLANT)
    faulty = faulty_of(fault, clean, "clear")
    if faulty is None:
        pytest.skip("the plant has nothing of the kind")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "300")  # what is pasted is not wrapped
    only_identify(monkeypatch)
    output = ran(called(faulty))
    told, again = verdict(output), pasted(output)
    assert (again is not None) == (told is not None), output  # what the estimate has removed needs no command
    if again is None:
        return
    (said,) = corrections(again)
    assert any(word in said for word in fault.corrections), said
    assert verdict(ran(again)) != told

"""What the tests of run files share: data, files that ask, the command."""

from pathlib import Path

import pytest

import robustid as rid
from robustid.app import sequence
from robustid.app.cli import main as cli
from robustid.app.toml import write_toml

EXAMPLES = Path(__file__).parents[2] / "examples"
DATA = {"frequency": [{"file": "frf.csv"}], "record": [{"file": "step.csv", "use": "samples"}]}
CLASS = {
    "modes": {"hz": [9.0, 17.67], "damping": [0.1, 0.004]},
    "prior": {"gain_bound": 0.2, "decay_rate": 1.1},
}
QUICK = {"worst_case": {"compute": False}}
SHORT = {"worst_case": {"at_hz": [5.0, 17.0], "directions": 4}}


@pytest.fixture
def folder(tmp_path, monkeypatch):
    data = rid.flexible_structure(seed=0, lines=5, samples=4, extra_hz=[17.4, 17.6, 17.8])
    rid.save(tmp_path / "frf.csv", data.frequency)
    rid.save(tmp_path / "step.csv", data.time)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def unreduced(monkeypatch):
    """For tests of other steps: the identified model in place of a search for a smaller one."""

    def whole(identification, rigid_body):
        return rid.balanced_truncation(identification.model, order=identification.order)

    monkeypatch.setattr(sequence, "reduce_within_bounds", whole)


def ask(folder, *parts, name="ask.toml"):
    content = {}
    for part in parts:
        content |= part
    (folder / name).write_text(write_toml(content), encoding="utf-8")
    return folder / name


def command(arguments, capsys, monkeypatch):
    """Through `main`, as the installed command does; returns (exit code, stdout, stderr)."""
    monkeypatch.setattr("sys.argv", ["robustid", "run", *map(str, arguments)])
    monkeypatch.setenv("COLUMNS", "200")
    with pytest.raises(SystemExit) as stop:
        cli.main()
    out = capsys.readouterr()
    return stop.value.code or 0, out.out, out.err

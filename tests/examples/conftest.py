"""Fixtures of the tests of the examples."""

import pytest
from matplotlib.figure import Figure

from support.example_runs import FOLDER, check_files


@pytest.fixture
def undrawn(monkeypatch):
    """Pictures get their names only: half a second each to draw."""
    monkeypatch.setattr(Figure, "savefig", lambda figure, path, **_: path.write_bytes(b"\x89PNG"))


@pytest.fixture
def run(tmp_path, capsys, monkeypatch):
    """An example in this process: run(example, pictures, *options) gives what it printed, and the pictures are there."""
    monkeypatch.syspath_prepend(FOLDER)

    def ran(example, pictures, *options):
        example.main(["--out", str(tmp_path), *options])
        check_files(tmp_path, pictures)
        return capsys.readouterr().out

    return ran

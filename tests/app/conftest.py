"""Fixtures of the tests of the application: the command line in this process, folders with data."""

import io
import shutil
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from matplotlib.figure import Figure
from PIL import Image

import robustid as rid
from robustid.app.run import fleet
from robustid.core import Workers
from support import command_line
from support.run_files import keep_discs, keep_whole, only_identify, search_nothing


@pytest.fixture
def run(capsys, monkeypatch):
    """The command line: run(arguments) gives (exit code, stdout, stderr)."""
    return lambda arguments: command_line.main([str(part) for part in arguments], capsys, monkeypatch)


@pytest.fixture
def threads(monkeypatch):
    """Processes of the command replaced by a thread of this one."""
    monkeypatch.setattr(fleet, "Workers", lambda executor, most: Workers(ThreadPoolExecutor(1), most))


@pytest.fixture
def stand_in(tmp_path, monkeypatch):
    """Copies of the files of a folder to stand among: stand_in(folder) is where they are."""

    def copied(folder):
        place = tmp_path / "here"
        shutil.copytree(folder, place)
        monkeypatch.chdir(place)
        return place

    return copied


@pytest.fixture
def folder(tmp_path, monkeypatch):
    data = rid.datasets.flexible_structure(seed=0, lines=5, samples=4, extra_hz=[17.4, 17.6, 17.8])
    rid.save(tmp_path / "frf.csv", data.frequency)
    rid.save(tmp_path / "step.csv", data.time)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def unreduced(monkeypatch):
    """For tests of other steps: see `keep_whole`."""
    keep_whole(monkeypatch)


@pytest.fixture
def unproved(monkeypatch):
    """For tests of what is read: see `only_identify`."""
    only_identify(monkeypatch)


@pytest.fixture
def unsharpened(monkeypatch):
    """For tests of other steps: see `keep_discs`."""
    keep_discs(monkeypatch)


@pytest.fixture
def unsearched(monkeypatch):
    """For tests of other steps, a second sooner: see `search_nothing`."""
    search_nothing(monkeypatch)


@pytest.fixture(autouse=True)
def _quick(request):
    """Tests in the suite are about other steps: those that are slow, or ask for `searched`, have sums of one direction each."""
    if "searched" not in request.fixturenames and request.node.get_closest_marker("slow") is None:
        request.getfixturevalue("unsearched")


@pytest.fixture
def searched():
    """For tests of the whole: a band with sums of one direction each."""


@pytest.fixture
def unpaged(monkeypatch):
    """Runs whose page nobody reads write an empty one: a real one takes as long as a small run."""
    monkeypatch.setattr("robustid.report.write_report", lambda found, path, **_: Path(path).write_text(""))


@pytest.fixture
def undrawn(monkeypatch):
    """Pictures of a page without scripts are one pixel: drawing them takes seconds."""
    picture = io.BytesIO()
    Image.new("RGB", (1, 1)).save(picture, format="png")
    monkeypatch.setattr(Figure, "savefig", lambda figure, file, **_: file.write(picture.getvalue()))


@pytest.fixture
def files(tmp_path, monkeypatch):
    """A folder to stand in, with a response and a step of the simulated structure."""
    data = rid.datasets.flexible_structure(seed=0)
    rid.save(tmp_path / "frf.csv", data.frequency)
    rid.save(tmp_path / "step.csv", data.time)
    monkeypatch.chdir(tmp_path)
    return tmp_path

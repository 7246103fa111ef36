"""Run files and data at an address: copies of what is named, fetched again where it was changed; nothing outside their folder."""

import sys
import zipfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

import robustid as rid
from robustid.app.run.fetched import _words, fetched
from robustid.app.run.fleet import items_of
from robustid.core import Workers
from robustid.errors import InputError
from support.fleets import machines, numbers
from support.refusals import refused
from support.run_files import ask

fsspec = pytest.importorskip("fsspec", reason="fsspec is not installed: robustid[remote]")


@pytest.fixture
def store():
    """A store in memory, empty before and after."""
    found = fsspec.filesystem("memory")
    found.store.clear()
    yield found
    found.store.clear()


@pytest.fixture
def opened(store, monkeypatch):
    """Places of the files that are read from the store."""
    places, original = [], store.open

    def counted(place, mode="rb", **options):
        places.extend([place] * (mode == "rb"))
        return original(place, mode, **options)

    monkeypatch.setattr(store, "open", counted)
    return places


def fetch(url, place):
    return fetched(url, place, lambda *_: None)


def fill(store, **files):
    for name, text in files.items():
        store.pipe_file("/plant/runs/" + name.replace("__", "/").replace("_", "."), text.encode())


def content(folder):
    return {
        path.relative_to(folder).as_posix(): path.read_text()
        for path in Path(folder).rglob("*")
        if path.is_file() and path.name != ".fetched.json"
    }


RUN = '[[frequency]]\nfile = "{}"\n'


def test_a_folder_comes_with_what_its_run_files_name_and_nothing_else(tmp_path, store):
    fill(store, a_toml=RUN.format("a.csv"), b_toml=RUN.format("../common/b.csv"), odd_toml="][", a_csv="1", c_csv="3")
    store.pipe_file("/plant/common/b.csv", b"2")
    store.pipe_file("/plant/runs/deeper/d.toml", b"")
    found = fetch("memory://plant/runs", tmp_path)
    assert found == tmp_path / "memory" / "plant" / "runs"
    assert [Path(item.path).name for item in items_of([found], tmp_path)] == ["a.toml", "b.toml", "odd.toml"]
    texts = content(tmp_path / "memory" / "plant")
    assert set(texts) == {"runs/a.toml", "runs/b.toml", "runs/odd.toml", "runs/a.csv", "common/b.csv"}
    assert (texts["runs/a.csv"], texts["common/b.csv"]) == ("1", "2")
    assert (found / "../common/b.csv").read_text() == "2"


def test_only_what_was_changed_is_fetched_again_and_what_is_gone_is_removed(tmp_path, store, opened):
    fill(store, a_toml=RUN.format("a.csv"), b_toml=RUN.format("b.csv"), a_csv="1", b_csv="2")
    found = fetch("memory://plant/runs", tmp_path)
    assert sorted(opened) == [f"/plant/runs/{name}" for name in ("a.csv", "a.toml", "b.csv", "b.toml")]
    opened.clear()
    assert fetch("memory://plant/runs", tmp_path) == found
    assert opened == []
    fill(store, a_csv="5")  # as long as before
    store.rm("/plant/runs/b.csv")
    fetch("memory://plant/runs", tmp_path)
    assert opened == ["/plant/runs/a.csv"]
    assert content(found) == {"a.toml": RUN.format("a.csv"), "b.toml": RUN.format("b.csv"), "a.csv": "5"}
    store.rm("/plant/runs/b.toml")
    fetch("memory://plant/runs", tmp_path)
    assert sorted(content(found)) == ["a.csv", "a.toml"]


def test_a_file_that_several_name_is_fetched_once(tmp_path, store, opened):
    fill(store, a_toml=RUN.format("c.csv"), b_toml=RUN.format("c.csv"), c_csv="3")
    fetch("memory://plant/runs", tmp_path)
    assert opened.count("/plant/runs/c.csv") == 1


def test_a_store_that_tells_no_version_is_asked_for_everything_each_time(tmp_path, store, opened, monkeypatch):
    fill(store, a_toml=RUN.format("a.csv"), a_csv="1")
    original = store.info
    monkeypatch.setattr(store, "info", lambda place: {**original(place), "created": None})
    for _ in range(2):
        fetch("memory://plant/runs/a.toml", tmp_path)
    assert len(opened) == 4


@pytest.mark.parametrize("name", ["../../../../outside.csv", "/outside.csv", "../../../../../etc/outside.csv"])
def test_nothing_is_written_outside_of_the_folder_of_copies(tmp_path, store, name):
    fill(store, a_toml=RUN.format(name))
    for place in ("/outside.csv", "/etc/outside.csv", "/../outside.csv"):
        store.pipe_file(place, b"1")
    place = tmp_path / "copies"
    fetch("memory://plant/runs", place)
    assert all(path.is_relative_to(place / "memory") for path in tmp_path.rglob("*") if path.is_file())


def test_what_stops_while_it_is_fetched_leaves_what_was_there(tmp_path, store, monkeypatch):
    fill(store, a_toml=RUN.format("a.csv"), a_csv="1")
    found = fetch("memory://plant/runs", tmp_path)
    before = content(tmp_path)
    fill(store, a_csv="2", a_toml=RUN.format("a.csv"))

    def torn(*_, **__):
        raise ConnectionError("the line is dead")

    with monkeypatch.context() as patched:
        patched.setattr("robustid.app.run.fetched.shutil.copyfileobj", torn)
        refused(r"can't be read \(the line is dead\)", fetch, "memory://plant/runs", tmp_path)
    assert content(tmp_path) == before
    fetch("memory://plant/runs", tmp_path)
    assert (found / "a.csv").read_text() == "2"


def test_stores_do_not_mix_and_who_asks_is_not_written(tmp_path):
    for k in range(2):
        place = tmp_path / str(k)
        place.mkdir()
        (place / "a.toml").write_text(str(k), encoding="utf-8")
        with zipfile.ZipFile(tmp_path / f"{k}.zip", "w") as file:
            file.writestr("a.toml", str(k))
    found = [fetch(f"zip://a.toml::file://{tmp_path}/{k}.zip", tmp_path / "copies") for k in range(2)]
    found += [fetch(f"file://{tmp_path}/{k}", tmp_path / "copies") / "a.toml" for k in range(2)]
    assert [path.read_text(encoding="utf-8") for path in found] == ["0", "1", "0", "1"]
    assert _words("sftp://me:secret@there/runs", "/runs") == "sftp-there"


def test_addresses_that_do_not_open_are_named(tmp_path, store, monkeypatch):
    refused("there is no such file or folder", fetch, "memory://nowhere", tmp_path)
    fill(store, a_csv="1")
    refused("a folder without run files", fetch, "memory://plant/runs", tmp_path)
    refused(r"can't be opened \(Protocol not known: nonsense\)", fetch, "nonsense://runs", tmp_path)
    monkeypatch.setitem(sys.modules, "fsspec.core", None)
    refused(r"pip install 'robustid\[remote\]'", fetch, "memory://plant", tmp_path)
    assert not list(tmp_path.iterdir())


@pytest.mark.usefixtures("unproved", "unreduced")
def test_the_command_takes_an_address_for_a_file_or_a_folder(tmp_path, store, monkeypatch, run):
    (path,) = machines(tmp_path / "there", 1)
    ask(path.parent, {"frequency": [{"file": "late.csv"}]}, name="m001.toml")
    store.put(str(path.parent), "/plant/runs", recursive=True)
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    code, out, _ = run(["run", "memory://plant/runs/m000.toml"])
    assert code == 0
    assert "written: m000/" in out
    assert sorted(path.name for path in Path().iterdir()) == ["m000", "m000-inputs"]
    assert run(["run", "m000/run.toml", "-o", "again"])[0] == 0
    monkeypatch.setattr("robustid.app.run.fleet.Workers", lambda executor, most: Workers(ThreadPoolExecutor(1), most))
    code, out, _ = run(["run", "memory://plant/runs", "-o", "out"])
    assert code == 1
    assert "1 of 2 consistent" in " ".join(out.split())
    assert "1 waiting" in out
    assert sorted(path.name for path in Path().glob("out*")) == ["out", "out-inputs"]
    code, _, err = run(["run", "memory://plant/nothing"])
    assert code == 2
    assert "there is no such file or folder" in " ".join(err.split())


@pytest.mark.usefixtures("unreduced")
def test_an_address_is_run_from_python_as_on_the_command_line(store, tmp_path):
    (path,) = machines(tmp_path / "here", 1)
    for one in path.parent.iterdir():
        store.pipe_file(f"/plant/{one.name}", one.read_bytes())
    found = rid.run("memory://plant/m000.toml", tmp_path / "out")
    assert found.consistent
    assert (tmp_path / "out-inputs" / "memory" / "plant" / "m000.csv").is_file()
    rid.run(path, tmp_path / "local")
    assert numbers(tmp_path / "out") == numbers(tmp_path / "local")
    with pytest.raises(InputError, match="is a folder, of several runs"):
        rid.run("memory://plant", tmp_path / "all")

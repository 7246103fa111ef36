"""Many run files as one fleet: workers and drivers that die, failures that are rows, and calls that go on."""

import csv
import html
import json
import logging
import multiprocessing
import os
import signal
import subprocess
import sys
import time
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

import robustid as rid
from robustid.app.run import fleet, fleet_item, reading
from robustid.errors import InputError
from robustid.guarantees import FleetState
from support.fleets import machines, numbers, written
from support.refusals import refused


def run_them(paths, folder, executor=None, *, force=False, **options):
    """The fleet in threads of this process, if nothing else is said."""
    items = fleet.items_of(paths, folder, force=force)
    with ThreadPoolExecutor(1) as own:
        return fleet.run_fleet(items, folder, executor or own, folder / fleet.TABLE, **options)


def table(folder):
    with (folder / fleet.TABLE).open(encoding="utf-8", newline="") as file:
        return {row["name"]: row for row in csv.DictReader(file)}


@pytest.fixture
def computed(monkeypatch):
    """Names of the machines that are run, in this process."""
    names, original = [], fleet_item.run

    def counted(path, folder, **options):
        names.append(Path(path).stem)
        return original(path, folder, **options)

    monkeypatch.setattr(fleet_item, "run", counted)
    return names


@pytest.mark.slow  # three processes that import everything; threads and processes that do little always run
def test_workers_that_are_killed_cost_nothing_but_the_runs_in_flight(tmp_path, caplog, computed):
    files, folder, kept, told = machines(tmp_path / "runs", 3), tmp_path / "out", {}, []

    def kill_all(text, done, count):
        told.append((done, count))
        if told == [(1, 3)]:
            kept.update(written(folder))
            for process in multiprocessing.active_children():
                os.kill(process.pid, signal.SIGKILL)

    with caplog.at_level(logging.WARNING, "robustid"):
        found = run_them(files, folder, 2, progress=kill_all)
    assert "failed and is tried again" in caplog.text
    assert found.states == {FleetState.CONSISTENT: 3}
    assert told[:3] == [(1, 3), (2, 3), (3, 3)]  # what follows is the page that is drawn
    assert kept
    assert kept.items() <= written(folder).items()
    single = rid.run(files[2], tmp_path / "single", resume=True)
    assert numbers(folder / "m002") == numbers(tmp_path / "single")
    assert table(folder)["m002"]["margin"] == repr(single.identification.margin)
    before = written(folder)
    again = run_them(files, folder)
    assert (again.states, written(folder), computed) == (found.states, before, [])


@pytest.mark.usefixtures("unreduced", "unpaged")
def test_one_failure_is_one_row_and_who_waits_for_data_is_named(tmp_path, computed):
    good, odd, late = machines(tmp_path / "runs", 3)
    odd.write_text("[prior]\ngain = 3\n", encoding="utf-8")
    data = (tmp_path / "runs" / "m002.csv").rename(tmp_path / "elsewhere.csv")
    found = run_them([good, odd, late], tmp_path / "out")
    assert found.states == {FleetState.CONSISTENT: 1, FleetState.FAILED: 1, FleetState.WAITING: 1}
    rows = table(tmp_path / "out")
    assert "[prior] has no key 'gain'" in rows["m001"]["sentence"]
    assert rows["m002"]["waits"] == "m002.csv is not there yet"
    assert [row.name for row in found.waiting] == ["m002"]
    page = html.unescape((tmp_path / "out" / fleet.PAGE).read_text(encoding="utf-8"))
    assert all(row["sentence"] in page for row in (rows["m001"], rows["m002"]))
    data.rename(tmp_path / "runs" / "m002.csv")
    assert run_them([good, odd, late], tmp_path / "out").states[FleetState.CONSISTENT] == 2
    assert computed == ["m000", "m001", "m002"]


@pytest.mark.usefixtures("unreduced", "unpaged")
def test_force_runs_what_failed_or_was_asked_something_else_and_nothing_more(tmp_path, computed):
    same, changed, wrong = machines(tmp_path / "runs", 3)
    text = wrong.read_text(encoding="utf-8")
    wrong.write_text(text.replace("hz = [9.0", "hz = [-9.0"), encoding="utf-8")
    run_them([same, changed, wrong], tmp_path / "out")
    changed.write_text(changed.read_text(encoding="utf-8").replace("0.2", "0.3"), encoding="utf-8")
    found = run_them([same, changed, wrong], tmp_path / "out")
    assert found.states[FleetState.FAILED] == 2
    assert "asked something else" in table(tmp_path / "out")["m001"]["sentence"]
    computed.clear()
    wrong.write_text(text, encoding="utf-8")
    assert run_them([same, changed, wrong], tmp_path / "out", force=True).states == {FleetState.CONSISTENT: 3}
    assert set(computed) == {"m001", "m002"}
    assert rid.load(tmp_path / "out" / "m001" / "identification").prior.gain_bound == 0.3


@pytest.fixture
def parsed(monkeypatch):
    """Names of the files that are parsed, in a process that has parsed none yet."""
    names, original = [], reading.read_table

    def counted(path, decimal=None):
        names.append(path.name)
        return original(path, decimal)

    monkeypatch.setattr(reading, "read_table", counted)
    monkeypatch.setattr(reading, "_LAST", reading._Last())
    return names


@pytest.mark.usefixtures("unproved", "unreduced", "unpaged")
def test_a_file_of_several_machines_is_parsed_once_and_again_when_it_was_changed(tmp_path, parsed):
    common = [{"file": "common.csv"}]
    files = machines(tmp_path / "runs", 2, frequency=common)
    shared, other = tmp_path / "runs" / "common.csv", tmp_path / "runs" / "m001.csv"
    (tmp_path / "runs" / "m000.csv").rename(shared)
    assert run_them(files, tmp_path / "out").states == {FleetState.CONSISTENT: 2}
    assert parsed == ["common.csv"]
    assert numbers(tmp_path / "out" / "m000") == numbers(tmp_path / "out" / "m001")
    first = rid.load(tmp_path / "out" / "m001" / "identification").problem.frequency[0]
    times = shared.stat()
    shared.write_bytes(other.read_bytes())
    os.utime(shared, ns=(times.st_atime_ns, times.st_mtime_ns))
    rid.run(files[1], tmp_path / "changed")
    changed = rid.load(tmp_path / "changed" / "identification").problem.frequency[0]
    assert parsed == ["common.csv"] * 2
    assert (changed.values != first.values).any()


def test_a_process_keeps_few_tables_and_none_that_is_large(tmp_path, parsed, monkeypatch):
    paths = [tmp_path / f"{k}.npy" for k in range(6)]
    for k, path in enumerate(paths):
        np.save(path, np.full((9, 2), k))
    for path in [*paths, paths[5], paths[2], paths[1]]:  # the last four are there, the one before them no longer
        assert reading.Tables().of(path).numbers("")[0, 0] == int(path.stem)
    assert parsed == [path.name for path in [*paths, paths[1]]]
    monkeypatch.setattr(reading, "_BYTES", 100)  # a table has 144
    parsed.clear()
    for _ in range(2):
        reading.Tables().of(paths[0])
    assert parsed == ["0.npy"] * 2


class Deadly(ThreadPoolExecutor):
    """An executor whose workers die of one machine."""

    def submit(self, function, item):
        if item.name != "m001":
            return super().submit(function, item)
        future = Future()
        future.set_exception(RuntimeError("the worker is gone"))
        return future


@pytest.mark.usefixtures("unreduced", "unpaged")
def test_a_machine_of_which_every_worker_dies_is_a_row_that_is_tried_again(tmp_path):
    files = machines(tmp_path / "runs", 2)
    with Deadly(1) as executor:
        found = run_them(files, tmp_path / "out", executor)
    assert [row.sentence for row in found.failed] == [
        "the run of m001 failed 3 times; at last: RuntimeError: the worker is gone"
    ]
    assert run_them(files, tmp_path / "out").states == {FleetState.CONSISTENT: 2}


@pytest.mark.usefixtures("unreduced", "unpaged")
def test_an_error_of_the_program_is_tried_again_by_the_next_call(tmp_path, monkeypatch):
    files, original = machines(tmp_path / "runs", 1), fleet_item.run

    def broken(*_, **__):
        raise MemoryError("no room")

    monkeypatch.setattr(fleet_item, "run", broken)
    assert run_them(files, tmp_path / "out").failed[0].sentence == "MemoryError: no room"
    monkeypatch.setattr(fleet_item, "run", original)
    assert run_them(files, tmp_path / "out").states == {FleetState.CONSISTENT: 1}


@pytest.mark.usefixtures("unreduced", "unpaged")
def test_a_second_call_computes_nothing_but_a_row_that_was_torn(tmp_path, computed):
    files = machines(tmp_path / "runs", 1)
    found = run_them(files, tmp_path / "out")
    before = written(tmp_path / "out")
    again = run_them(files, tmp_path / "out")
    assert (again.states, written(tmp_path / "out")) == (found.states, before)
    assert computed == ["m000"]
    row = tmp_path / "out" / "m000" / fleet_item.ROW
    row.write_text(row.read_text(encoding="utf-8")[:40], encoding="utf-8")
    assert run_them(files, tmp_path / "out").states == {FleetState.CONSISTENT: 1}
    assert len(computed) == 2


@pytest.mark.parametrize("names", [("a/run", "b/run"), ("one", "two")])
def test_machines_are_named_by_their_run_files(tmp_path, names):
    paths = [tmp_path / f"{name}.toml" for name in names]
    for path in paths:
        path.parent.mkdir(exist_ok=True)
        path.write_text("")
    items = fleet.items_of([*paths, paths[0]], tmp_path / "out")
    assert [item.name for item in items] == [name.replace("/", "-") for name in names]
    assert [Path(item.path) for item in items] == paths
    if "/" not in names[0]:
        assert fleet.items_of([tmp_path], tmp_path / "out") == items


def test_run_files_that_are_not_there_are_named(tmp_path):
    refused("there is no such file", fleet.items_of, [tmp_path / "no.toml"], tmp_path)
    refused("a folder without run files", fleet.items_of, [tmp_path], tmp_path)
    paths = [tmp_path / "a-b.toml", tmp_path / "a" / "b.toml", tmp_path / "c" / "b.toml"]
    for path in paths:
        path.parent.mkdir(exist_ok=True)
        path.write_text("")
    refused("would both write to", fleet.items_of, paths, tmp_path / "out")


def test_a_worker_that_does_not_see_the_folder_says_so(tmp_path):
    (item,) = fleet.items_of(machines(tmp_path / "runs", 1), tmp_path / "nowhere")
    refused("does not see the folder", fleet_item.run_item, item)


@pytest.mark.usefixtures("threads", "unreduced", "unpaged")
def test_the_command_writes_table_and_page_and_its_code_is_that_of_the_worst(tmp_path, monkeypatch, run):
    machines(tmp_path / "runs", 2)
    monkeypatch.chdir(tmp_path)
    code, out, _ = run(["run", "runs/m000.toml", "runs/m001.toml", "-o", "out"])
    assert code == 0
    assert "All consistent" in out
    assert "written: out/table.csv, out/report.html" in out
    (tmp_path / "runs" / "m001.csv").unlink()
    code, out, _ = run(["run", "runs", "-o", "out"])
    assert code == 1
    assert "1 of 2 consistent" in out
    assert "1 waiting" in out


@pytest.mark.usefixtures("threads", "unreduced", "unpaged")
def test_ctrl_c_keeps_what_is_finished_and_the_next_call_goes_on(tmp_path, monkeypatch, run):
    machines(tmp_path / "runs", 2)
    monkeypatch.chdir(tmp_path)
    original = fleet_item.run

    def stopped(path, *arguments, **options):
        if Path(path).stem == "m001":
            raise KeyboardInterrupt
        return original(path, *arguments, **options)

    with monkeypatch.context() as patched:
        patched.setattr(fleet_item, "run", stopped)
        code, out, err = run(["run", "runs", "-o", "out"])
    assert code == 130
    assert "what was found by then is written" in err
    assert "1 not run yet" in out
    assert list(table(tmp_path / "out")) == ["m000"]
    code, out, _ = run(["run", "runs", "-o", "out"])
    assert code == 0


def test_options_that_do_not_go_together_are_refused(tmp_path, monkeypatch, run):
    machines(tmp_path / "runs", 1)
    monkeypatch.chdir(tmp_path)
    for arguments, words in (
        (["runs/m000.toml", "--table", "t.csv"], "--table is of several machines"),
        (["runs", "--table", "t.xlsx"], "--table t.xlsx must end in .csv or .parquet"),
        (["runs", "--workers", "2", "--cluster", "tcp://here:1"], "give one of them"),
    ):
        code, _, err = run(["run", *arguments, "-o", "out"])
        assert code == 2
        assert words in " ".join(err.split())
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("missing", ["distributed", "pyarrow"])
def test_what_is_not_installed_is_named_with_the_line_that_installs_it(tmp_path, monkeypatch, run, missing):
    machines(tmp_path / "runs", 1)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(sys.modules, missing, None)
    option = {"distributed": ["--cluster", "tcp://here:1"], "pyarrow": ["--table", "t.parquet"]}[missing]
    code, _, err = run(["run", "runs", *option])
    assert code == 2
    assert "which is not installed: pip install 'robustid[" in " ".join(err.split())


@pytest.mark.usefixtures("unreduced", "unpaged")
def test_a_table_in_parquet_has_the_same_rows(tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet", reason="pyarrow is not installed: robustid[parquet]")
    files = machines(tmp_path / "runs", 1)
    run_them(files, tmp_path / "out")
    items = fleet.items_of(files, tmp_path / "out")
    with ThreadPoolExecutor(1) as executor:
        fleet.run_fleet(items, tmp_path / "out", executor, tmp_path / "t.parquet")
    found = parquet.read_table(tmp_path / "t.parquet").to_pylist()
    kept = json.loads((tmp_path / "out" / "m000" / fleet_item.ROW).read_text(encoding="utf-8"))["row"]
    assert found == [kept]


def test_a_scheduler_that_does_not_answer_is_named(monkeypatch):
    pytest.importorskip("distributed", reason="Dask is not installed: robustid[distributed]")
    monkeypatch.setattr(fleet, "_CONNECT", 0.2)
    with (
        pytest.raises(InputError, match=r"no scheduler answers at tcp://127\.0\.0\.1:9"),
        fleet.cluster("tcp://127.0.0.1:9"),
    ):
        pass


@pytest.mark.usefixtures("unreduced", "unpaged")
def test_a_cluster_gives_the_same(tmp_path):
    distributed = pytest.importorskip("distributed", reason="Dask is not installed: robustid[distributed]")
    files = machines(tmp_path / "runs", 2)
    options = {"processes": False, "dashboard_address": None, "silence_logs": logging.CRITICAL}
    with (
        distributed.LocalCluster(n_workers=1, threads_per_worker=2, **options) as workers,
        fleet.cluster(workers.scheduler_address) as executor,
    ):
        assert run_them(files, tmp_path / "out", executor).states == {FleetState.CONSISTENT: 2}
    rid.run(files[1], tmp_path / "single")
    assert numbers(tmp_path / "out" / "m001") == numbers(tmp_path / "single")


def _children(parent):
    """Worker processes of a command, whose work is done by a child of its own, by what Linux says of all processes."""
    parents, spawned = {}, []
    for place in Path("/proc").glob("[0-9]*"):
        try:
            status = dict(line.split(":", 1) for line in (place / "status").read_text().splitlines())
            worker = b"spawn_main" in (place / "cmdline").read_bytes()
        except OSError:  # ended meanwhile
            continue
        parents[int(place.name)] = int(status["PPid"])
        spawned += [int(place.name)] * worker
    return [pid for pid in spawned if parents.get(parents[pid]) == parent]


def _until(condition, seconds=600):
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.05)


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc").is_dir(), reason="finds the workers in /proc")
def test_two_hundred_machines_with_a_killed_worker_and_a_killed_driver(tmp_path):
    """All results are those of single runs, and nothing is computed twice but what was in flight."""
    files, folder = machines(tmp_path / "runs", 200), tmp_path / "out"
    command = [sys.executable, "-m", "robustid", "run", *map(str, files), "-o", str(folder), "--workers", "2"]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL) as driver:
        try:
            _until(lambda: len(written(folder)) >= 30)
            os.kill(_children(driver.pid)[0], signal.SIGKILL)
            _until(lambda: len(written(folder)) >= 100)
            workers = _children(driver.pid)
        finally:
            driver.kill()
    assert len(workers) == 2
    _until(lambda: not any(Path(f"/proc/{pid}").exists() for pid in workers), 30)  # nobody computes for nobody
    before, started = written(folder), [place for place in folder.iterdir() if place.is_dir()]
    assert len(started) - len(before) <= 3  # in flight when the driver was killed, or yet to be tried again
    assert subprocess.run(command, check=False).returncode == 0
    assert before.items() <= written(folder).items()
    assert len(table(folder)) == 200
    for file in files:
        rid.run(file, tmp_path / "single" / file.stem)
        assert numbers(folder / file.stem) == numbers(tmp_path / "single" / file.stem)

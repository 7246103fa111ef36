"""Processes of our own: what one that dies takes with it, and that none outlives the process that started it."""

import asyncio
import concurrent.futures
import os
import subprocess
import sys
import threading
import time

import pytest

from robustid.core import Workers, worker_pool
from robustid.errors import SolverError
from support.dying import attempted

_WAITS = """
import time
from robustid.core import worker_pool
if __name__ == "__main__":
    with worker_pool(1) as pool:
        future = pool.submit(time.sleep, 60)
        while not pool._processes[0]._processes:
            time.sleep(0.01)
        print(*pool._processes[0]._processes, flush=True)
        future.result()
"""


def attempts(folder, item):
    return len((folder / item).read_text(encoding="utf-8").splitlines())


def test_a_process_that_dies_takes_its_own_item_only(tmp_path):
    items = ["long", "dies", "deadly", "other"]
    with Workers(2) as workers:
        found = dict(workers.run(attempted, (tmp_path,), iter(items), str, lambda item, error: str(error)))
    assert {name: found[name] for name in ("long", "dies", "other")} == {
        "long": "LONG",
        "dies": "DIES",
        "other": "OTHER",
    }
    assert found["deadly"].startswith("deadly failed 3 times; at last: BrokenProcessPool")
    assert {name: attempts(tmp_path, name) for name in items} == {"long": 1, "dies": 2, "deadly": 3, "other": 1}


@pytest.mark.slow  # the same without `lost`, once more three processes
def test_an_item_that_ends_every_process_ends_the_work(tmp_path):
    with Workers(1) as workers, pytest.raises(SolverError, match="deadly failed 3 times"):
        dict(workers.run(attempted, (tmp_path,), ["deadly"], str))


def test_what_nobody_waits_for_ends_with_the_pool():
    with worker_pool(1) as pool:
        future = pool.submit(time.sleep, 600)
        while not future.running():
            time.sleep(0.01)
        pool.end()
    assert isinstance(future.exception(), concurrent.futures.BrokenExecutor)


@pytest.mark.skipif(not hasattr(os, "kill") or sys.platform == "win32", reason="needs signals")
def test_no_process_outlives_the_one_that_started_it(tmp_path):
    script = tmp_path / "waits.py"
    script.write_text(_WAITS, encoding="utf-8")
    with subprocess.Popen([sys.executable, str(script)], stdout=subprocess.PIPE, text=True) as parent:
        child = int(parent.stdout.readline())
        parent.kill()
    deadline = time.monotonic() + 60
    while _alive(child):
        assert time.monotonic() < deadline
        time.sleep(0.02)


def _alive(pid):
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    state = subprocess.run(["ps", "-o", "stat=", "-p", str(pid)], capture_output=True, text=True, check=False)
    if state.stdout.startswith("Z"):  # ended; nobody has asked for its exit code yet
        return False
    return bool(state.stdout.strip())


class Lost:
    """A call that ended on a worker that died with its result; then the scheduler died."""

    status = "finished"

    def __init__(self, error):
        self.error = error

    def result(self):
        if self.error is not None:
            raise self.error
        return "made again"

    def _result(self, raiseit=True):
        found = concurrent.futures.Future()
        if self.error is None:
            found.set_result(self.result())
        else:
            found.set_exception(self.error)
        return found

    def add_done_callback(self, told):
        threading.Thread(target=told, args=(self,)).start()


class Cluster:
    """A client of which the first call is lost, with a loop of events in a thread of its own."""

    def __init__(self):
        self.loop, self.calls, self.events = self, 0, asyncio.new_event_loop()
        threading.Thread(target=self.events.run_forever, daemon=True).start()

    def submit(self, function, *arguments, **options):
        self.calls += 1
        return Lost(concurrent.futures.CancelledError("scheduler-connection-lost") if self.calls == 1 else None)

    def add_callback(self, function, *arguments):
        self.events.call_soon_threadsafe(function, *arguments)


def test_a_call_that_a_cluster_loses_twice_is_made_again():
    distributed = pytest.importorskip("distributed.cfexecutor", reason="Dask is not installed: robustid[distributed]")
    cluster, found = Cluster(), []
    with Workers(distributed.ClientExecutor(cluster, pure=False), 10) as workers:
        calls = threading.Thread(target=lambda: found.extend(workers.run(print, (), ["a"], str)), daemon=True)
        calls.start()
        calls.join(20)
    cluster.events.call_soon_threadsafe(cluster.events.stop)
    assert found == [("a", "made again")]
    assert cluster.calls == 2

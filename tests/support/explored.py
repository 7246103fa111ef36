"""Shared by the tests: a small plant that is explored."""

import contextlib
import threading
import time

import robustid as rid
from robustid.app.explore.server import Server
from robustid.app.explore.views import views
from robustid.app.run.run_file import read_run_file

CLASS = "[modes]\nhz = [{hz}, 17.67]\ndamping = [0.1, 0.004]\n[prior]\ngain_bound = 0.2\ndecay_rate = 1.1\n"
DATA = """[[frequency]]
file = "frf.csv"
[[record]]
file = "step.csv"
use = "samples"
[identify]
solver = "structured"
[small_model]
time_limit = 0.1
[worst_case]
compute = false
"""


def run_file(folder, hz=9.0, more=""):
    """A run file of eight frequency points and four samples; its first mode is at 9 Hz in truth."""
    data = rid.datasets.flexible_structure(seed=0, lines=5, samples=4, extra_hz=[17.4, 17.6, 17.8])
    rid.save(folder / "frf.csv", data.frequency)
    rid.save(folder / "step.csv", data.time)
    path = folder / "ask.toml"
    path.write_text(DATA + CLASS.format(hz=hz) + more)
    return path


def session(folder, hz=9.0, more=""):
    return opened(run_file(folder, hz, more))


def opened(path):
    """The first page of a run file."""
    return pages(path)[0].open(quiet)


def pages(path):
    """The pages of a run file."""
    return views(read_run_file(path), path.parent, quiet)


def quiet(*_):
    """Say nothing."""


@contextlib.contextmanager
def served(one, views=()):
    """Its page, as long as the block lasts, with those beside it."""
    server = Server(one, "Test plant", views=views)
    thread = threading.Thread(target=server.serve)
    thread.start()
    try:
        yield server
    finally:
        server.close()
        thread.join()
        server.end()


def until(holds, seconds=30.0):
    """Wait until something holds."""
    end = time.monotonic() + seconds
    while not holds():
        assert time.monotonic() < end
        time.sleep(0.01)

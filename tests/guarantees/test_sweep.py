"""Sweeps over frequencies: spread, interrupted, resumed, on workers that die."""

import errno
import logging
import multiprocessing
import os
import pickle
import shutil
import signal
import threading
from concurrent.futures import Executor, Future, ThreadPoolExecutor

import numpy as np
import pytest

import robustid as rid
from robustid.core import Workers
from robustid.guarantees import sweep
from robustid.guarantees.consistent_set import consistent_set
from support.cases import slow
from support.interrupts import ctrl_c, ctrl_c_when
from support.problems import random_problem
from support.refusals import refused

OMEGA = [10.0, 60.0, 110.0, 200.0]


@pytest.fixture(scope="module")
def result():
    return rid.identify(random_problem(2, "mixed", 8))


@pytest.fixture(scope="module")
def expected(result):
    return rid.worst_case_error(result, omega=OMEGA, directions=4)


def run(result, **options):
    return rid.worst_case_error(result, omega=OMEGA, directions=4, **options)


def same(error, expected):
    assert error.certified
    assert np.allclose(error.upper, expected.upper, rtol=1e-9)


@pytest.mark.parametrize("form", ["orthonormal", "taylor"])
def test_what_workers_get_survives_its_packing(result, form):
    posed = rid.identify(result.problem, form=form)
    found = rid.worst_case_error(posed, omega=[60.0], directions=3)
    copy = pickle.loads(pickle.dumps(found.consistent_set))
    assert type(copy.data.sarason) is type(found.consistent_set.data.sarason)
    assert np.array_equal(copy.data.sarason.pair.A, found.consistent_set.data.sarason.pair.A)


def test_any_executor_gives_the_same(result, expected):
    with ThreadPoolExecutor(2) as executor:
        same(run(result, executor=executor), expected)


@pytest.mark.parametrize("processes", [slow(1), slow(2)])
def test_a_process_that_is_killed_loses_nothing(result, expected, caplog, processes):
    counts = []

    def kill_one(text, done, count):
        counts.append((done, count))
        if done == 1:
            victims = multiprocessing.active_children()
            assert victims
            os.kill(victims[0].pid, signal.SIGKILL)

    with caplog.at_level(logging.WARNING, "robustid"):
        same(run(result, executor=processes, progress=kill_one), expected)
    assert counts[-1] == (4, 4)
    assert "tried again" in caplog.text
    assert not multiprocessing.active_children()


def test_ctrl_c_ends_the_processes_at_once(result, tmp_path):
    with pytest.raises(KeyboardInterrupt):
        run(result, executor=1, progress=ctrl_c, resume=tmp_path)
    assert not multiprocessing.active_children()
    assert len(list(tmp_path.iterdir())) == 1


class Failing(Executor):
    """Runs in this process; some items fail so many times before they work."""

    def __init__(self, failures, error=None):
        self.failures, self.error = dict(failures), error or RuntimeError("the worker is gone")
        self.running, self.attempts = 0, []
        self.lock, self.pool = threading.Lock(), ThreadPoolExecutor(4)

    def submit(self, function, *arguments):
        return self.pool.submit(self._run, function, arguments)

    def _run(self, function, arguments):
        item = arguments[-1]
        with self.lock:
            self.running += 1
            self.attempts.append((item, self.running))
            fails = self.failures.get(item, 0) > 0
            self.failures[item] = self.failures.get(item, 0) - 1
        try:
            if fails:
                raise self.error
            return function(*arguments)
        finally:
            with self.lock:
                self.running -= 1


def test_an_item_that_fails_twice_is_found_in_the_end(result, expected):
    executor = Failing({60.0: 2, 200.0: 1})
    same(run(result, executor=executor), expected)
    assert [item for item, _ in executor.attempts].count(60.0) == 3
    again = [running for k, (item, running) in enumerate(executor.attempts) if k >= 4]
    assert again == [1] * 3  # alone: whatever one does to a pool, no other is blamed for it


def test_an_item_that_always_fails_is_named_and_the_others_are_kept(result, expected, tmp_path):
    executor = Failing({60.0: 99})
    with pytest.raises(
        rid.errors.SolverError, match=r"60 rad/s failed 3 times; at last: RuntimeError: the worker is gone"
    ) as stop:
        run(result, executor=executor, resume=tmp_path)
    assert "3 of 4" in str(stop.value)
    assert len(list(tmp_path.glob("*.npz"))) == 3
    executor = Failing({})
    same(run(result, executor=executor, resume=tmp_path), expected)
    assert [item for item, _ in executor.attempts] == [60.0]


def test_without_a_folder_the_sentence_says_how_to_keep_what_is_finished(result):
    refused("`resume`", lambda: run(result, executor=Failing({60.0: 99})), error=rid.errors.SolverError)


def test_what_the_library_says_on_purpose_is_not_tried_again(result):
    executor = Failing({60.0: 99}, rid.InputError("`omega` is odd"))
    refused("odd", run, result, executor=executor)
    assert [item for item, _ in executor.attempts].count(60.0) == 1


def test_a_cancelled_item_is_tried_again(result):
    class Cancelling(Executor):
        attempts = 0

        def submit(self, function, *arguments):
            self.attempts += 1
            future = Future()
            if self.attempts == 1:
                future.cancel()
                future.set_running_or_notify_cancel()
            else:
                future.set_result(function(*arguments))
            return future

    with Workers(Cancelling()) as workers:
        assert dict(workers.run(lambda a, b: a + b, (1.0,), [2.0, 3.0], str)) == {2.0: 3.0, 3.0: 4.0}


@pytest.mark.parametrize("executor", [0, -1, 2.0, "all", True])
def test_a_wrong_executor_is_named(result, executor):
    refused("`executor`", run, result, error=rid.errors.InputTypeError, executor=executor)


def none_left(*_):
    raise AssertionError("computed again")


def test_a_finished_folder_answers_everything(result, expected, tmp_path, monkeypatch):
    run(result, resume=tmp_path)
    monkeypatch.setattr(sweep, "value_sets_at", none_left)
    calls = []
    again = run(result, resume=tmp_path, progress=lambda text, *count: calls.append(count))
    assert np.array_equal(again.upper, expected.upper)
    assert again.certified
    assert calls == [(4, 4)]


def test_polygons_with_fewer_sides_than_asked_for_are_taken_from_the_folder(tmp_path, monkeypatch):
    frf = rid.FrequencyResponse(np.array([0.4, 1.0, 1.9]), np.full((3, 2, 2), 0.1), bound=0.1, dt=1.0)
    matrix = rid.identify(rid.MixedProblem(frequency=frf, prior=rid.Prior(gain_bound=1.0, decay_rate=1.2)))
    ask = np.array([0.7]), 8, 1.0, sweep.Means(resume=tmp_path)  # of so wide a gap the first four sides are enough
    here = consistent_set(matrix)
    first = sweep.value_sets(here, *ask)
    monkeypatch.setattr(sweep, "value_sets_at", none_left)
    again = sweep.value_sets(here, *ask)
    assert [v.directions.size for v in again] == [4, 4, 4, 4]
    assert [v.support.tolist() for v in again] == [v.support.tolist() for v in first]


def test_an_interrupted_sweep_goes_on(result, expected, tmp_path, monkeypatch):
    with pytest.raises(KeyboardInterrupt):
        run(result, resume=tmp_path, progress=ctrl_c_when(lambda text, done, count: done == 3))
    computed, original = [], sweep.value_sets_at
    monkeypatch.setattr(sweep, "value_sets_at", lambda *a: computed.append(a[1]) or original(*a))
    same(run(result, resume=tmp_path), expected)
    assert computed == [200.0]


def test_torn_and_foreign_files_are_computed_again(result, expected, tmp_path, monkeypatch, caplog):
    run(result, resume=tmp_path)
    files = {float(p.stem.rsplit("-", 1)[1]): p for p in tmp_path.iterdir()}
    files[10.0].write_bytes(files[10.0].read_bytes()[:-100])
    shutil.copy(files[110.0], files[60.0])
    flipped = bytearray(files[200.0].read_bytes())
    flipped[len(flipped) // 2] ^= 1
    files[200.0].write_bytes(flipped)
    computed, original = [], sweep.value_sets_at
    monkeypatch.setattr(sweep, "value_sets_at", lambda *a: computed.append(a[1]) or original(*a))
    with caplog.at_level(logging.WARNING, "robustid"):
        same(run(result, resume=tmp_path), expected)
    assert sorted(computed) == [10.0, 60.0, 200.0]
    assert caplog.text.count("computed again") == 3
    assert "of other data or settings" in caplog.text


def test_other_data_and_other_settings_share_a_folder(result, expected, tmp_path, caplog):
    run(result, resume=tmp_path)
    coarse = rid.worst_case_error(result, omega=OMEGA, directions=3, resume=tmp_path)
    assert coarse.directions == 3
    assert "other data" not in caplog.text
    with caplog.at_level(logging.WARNING, "robustid"):
        other = rid.identify(result.problem.with_prior(gain_bound=1.1))
        wider = run(other, resume=tmp_path)
    assert "8 results there are of other data" in caplog.text
    assert np.all(wider.upper > expected.upper * 0.9)
    assert not np.allclose(wider.upper, expected.upper, rtol=1e-3)


def test_a_full_disk_ends_the_sweep_and_keeps_what_is_finished(result, tmp_path, monkeypatch):
    original, written = np.savez, []

    def full(file, **arrays):
        if len(written) == 2:
            file.write(b"half of it")
            raise OSError(errno.ENOSPC, "No space left on device")
        written.append(1)
        original(file, **arrays)

    monkeypatch.setattr(np, "savez", full)
    refused(r"No space left on device.*make room, and run the same again", run, result, resume=tmp_path)
    assert len(list(tmp_path.iterdir())) == 2


def test_a_folder_that_is_a_file_is_named(result, tmp_path):
    (tmp_path / "file").write_text("")
    refused("`resume`", run, result, resume=tmp_path / "file")


def test_a_cluster_in_this_process_gives_the_same(result, expected):
    distributed = pytest.importorskip("distributed", reason="Dask is not installed: robustid[distributed]")
    options = {"processes": False, "dashboard_address": None, "silence_logs": logging.CRITICAL}
    with distributed.Client(n_workers=1, threads_per_worker=1, **options) as client:
        same(run(result, executor=client.get_executor()), expected)


@pytest.mark.slow  # three processes that import everything; a killed process of a pool, above, always runs
def test_a_cluster_that_loses_a_worker_loses_nothing(result):
    distributed = pytest.importorskip("distributed", reason="Dask is not installed: robustid[distributed]")
    omega = np.linspace(5.0, 300.0, 12)
    killed = []
    with (
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, silence_logs=logging.CRITICAL
        ) as cluster,
        distributed.Client(cluster) as client,
    ):
        before = {worker.pid for worker in cluster.workers.values()}

        def kill_one(text, done, count):
            if not killed:
                assert done < count
                killed.append(next(iter(before)))
                os.kill(killed[0], signal.SIGKILL)

        error = rid.worst_case_error(
            result, omega=omega, directions=6, executor=client.get_executor(), progress=kill_one
        )
    assert killed
    assert np.array_equal(error.omega, omega)
    assert error.certified

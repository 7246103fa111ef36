"""The number of threads of the linear algebra library inside and outside of what limits it."""

import subprocess
import sys
import time

import numpy as np
import pytest
import scipy.linalg
import threadpoolctl

import robustid as rid
from robustid.core import one_thread, threads, threads_for
from support.structure import about_structure


def number():
    """The number of threads of those libraries that can be told one."""
    return max(pool["num_threads"] for pool in threadpoolctl.threadpool_info() if pool["user_api"] == "blas")


@pytest.fixture(autouse=True)
def two():
    with threadpoolctl.threadpool_limits(limits=2, user_api="blas"):
        yield


@pytest.fixture
def idle(monkeypatch):
    """Say how many cores are idle."""

    def say(cores):
        monkeypatch.setattr(threads, "idle_cores", lambda: cores)

    say(8)
    return say


def test_small_work_has_one_thread_and_large_work_those_that_were_set(idle):
    with one_thread():
        assert number() == 1
        with threads_for(10):
            assert number() == 1
        with threads_for(1000):
            assert number() == 2
            with one_thread():
                assert number() == 1
            assert number() == 2
        assert number() == 1
    assert number() == 2


def test_large_work_has_no_more_threads_than_cores_are_idle(idle):
    idle(1)
    with threads_for(1000):
        assert number() == 1
    with one_thread(), threads_for(1000):
        assert number() == 1
    assert number() == 2


def test_an_error_inside_gives_the_threads_back(idle):
    with pytest.raises(ZeroDivisionError), threads_for(10):
        _ = 1 / 0
    assert number() == 2
    with threads_for(1000):
        assert number() == 2


@pytest.mark.skipif(not threads._counters(), reason="the platform does not count what its cores do")
def test_cores_that_spin_are_not_idle():
    processes = [subprocess.Popen([sys.executable, "-S", "-c", "while True: pass"]) for _ in threads._counters()]
    try:
        time.sleep(0.3)
        assert threads._look() < 1.5
    finally:
        for one in processes:
            one.kill()
            one.wait()


def test_cores_are_looked_at_once_in_a_while(monkeypatch):
    looks = []
    monkeypatch.setattr(threads, "_look", lambda: looks.append(1) or 3.4)
    monkeypatch.setattr(threads._State, "seen", -np.inf)
    assert [threads.idle_cores() for _ in range(5)] == [3] * 5
    assert len(looks) == 1


@pytest.mark.parametrize("load", [lambda: (1.0, 0.0, 0.0), None])
def test_platforms_that_count_nothing_are_safe(monkeypatch, load):
    monkeypatch.setattr(threads, "_counters", lambda: None)
    monkeypatch.setattr(threads.os, "cpu_count", lambda: 4)
    if load is None:
        monkeypatch.delattr(threads.os, "getloadavg")
        assert threads._look() == 1
    else:
        monkeypatch.setattr(threads.os, "getloadavg", load)
        assert int(threads._look()) == 3


PLANT = rid.datasets.flexible_structure(lines=8)
PROBLEM, OTHER = about_structure(PLANT, 0.2, 1.1), about_structure(rid.datasets.flexible_structure(lines=9), 0.2, 1.1)
INPUT = np.cos(np.arange(200.0) ** 2)
RECORD = rid.TimeRecord(INPUT, np.convolve(INPUT, 0.8 ** np.arange(200.0))[:200], dt=0.1, bound=0.1)
SMOOTH = rid.FrequencyResponse(np.linspace(1, 20, 60), 1 / (100 - np.linspace(1, 20, 60) ** 2 + 1j))
CALLS = {
    "band": lambda r: rid.band(PROBLEM, knots=60).verify(),
    "contradiction": lambda r: rid.guarantee.contradiction(PROBLEM),
    "diagnose": lambda r: rid.diagnose(r, time_limit=0.2),
    "estimate_bound": lambda r: rid.estimate_bound(SMOOTH),
    "estimate_frf": lambda r: rid.estimate_frf(RECORD, method="local"),
    "family": lambda r: rid.family({"a": r, "b": rid.identify(OTHER)}, time_limit=1.0),
    "fit_mfd": lambda r: rid.fit_mfd(PLANT.frequency, order=4),
    "fit_records": lambda r: rid.fit_records(RECORD, order=2),
    "identify": lambda r: rid.identify(PROBLEM),
    "identify_reduced": lambda r: rid.identify_reduced(PROBLEM, worst_case=False),
    "reduce": lambda r: rid.reduce_within_bounds(r),
    "refute": lambda r: rid.refute(r, PLANT.frequency),
    "suggest_kautz": lambda r: rid.suggest_kautz(PLANT.frequency),
    "suggest_next": lambda r: rid.suggest_next(r, time_limit=0.2),
    "suggest_prior": lambda r: rid.suggest_prior(PROBLEM, decay_rates=[1.1]),
    "suggest_order": lambda r: rid.fits.suggest_order(PLANT.frequency, orders=[2, 4]),
    "truncate": lambda r: rid.balanced_truncation(r.model, order=2),
    "tube": lambda r: rid.guarantee.response_tube(r, horizon=2, times=[0.0]).verify(),
    "validate": lambda r: rid.validate(r.model, PLANT.frequency),
    "worst_case_error": lambda r: rid.worst_case_error(r, omega=[50.0], directions=4),
}
DECOMPOSITIONS = ("cholesky", "svd", "qr", "eigvals", "eig", "eigh", "eigvalsh", "lstsq", "inv", "solve", "norm")


@pytest.fixture(scope="module")
def result():
    return rid.identify(PROBLEM)


SLOW = "family", "identify_reduced"


@pytest.mark.parametrize("name", [pytest.param(k, marks=pytest.mark.slow) if k in SLOW else k for k in CALLS])
def test_small_matrices_have_one_thread_in_every_call(name, result, monkeypatch):
    seen = []

    def watched(function):
        def call(*arguments, **options):
            seen.append(number_now())
            return function(*arguments, **options)

        return call

    blas = threads._libraries().lib_controllers

    def number_now():
        return max(one.num_threads for one in blas)

    for library in (np.linalg, scipy.linalg):
        for one in DECOMPOSITIONS:
            if hasattr(library, one):
                monkeypatch.setattr(library, one, watched(getattr(library, one)))
    CALLS[name](result)
    assert seen
    assert set(seen) == {1}, f"{np.mean(np.array(seen) > 1):.0%} of {len(seen)} with several threads"

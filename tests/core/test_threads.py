"""The number of threads of the linear algebra library inside and outside of what limits it."""

import pytest
import threadpoolctl

import robustid as rid
from robustid.core import one_thread, threads_for
from support.structure import about_structure


def threads():
    """The number of threads of those libraries that can be told one."""
    return max(pool["num_threads"] for pool in threadpoolctl.threadpool_info() if pool["user_api"] == "blas")


@pytest.fixture(autouse=True)
def two():
    with threadpoolctl.threadpool_limits(limits=2, user_api="blas"):
        yield


def test_small_work_has_one_thread_and_large_work_those_that_were_set():
    with one_thread():
        assert threads() == 1
        with threads_for(10):
            assert threads() == 1
        with threads_for(1000):
            assert threads() == 2
            with one_thread():
                assert threads() == 1
        assert threads() == 1
    assert threads() == 2


def test_an_error_inside_gives_the_threads_back():
    with pytest.raises(ZeroDivisionError), threads_for(10):
        _ = 1 / 0
    assert threads() == 2
    with threads_for(1000):
        assert threads() == 2


def test_long_calls_of_small_matrices_have_one_thread():
    plant, seen = rid.datasets.flexible_structure(lines=6), []

    def look(*_):
        seen.append(threads())

    problem = about_structure(plant, 1.0, 1.1)
    rid.suggest_prior(problem, decay_rates=[1.1], progress=look)
    result = rid.identify(problem.with_prior(gain_bound=0.2))
    rid.guarantee.response_tube(result, horizon=2, times=[0.0], progress=look)
    assert seen == [1, 1]

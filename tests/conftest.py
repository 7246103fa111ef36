import gc
import os
import pathlib
import sys

import pytest

os.environ.setdefault("MPLBACKEND", "Agg")
# The matrices of the tests are small: threads only wait for each other, many times longer on a busy machine.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# Recorded numbers are compared: processors with wider instructions sum in another order, in kernels of their own.
os.environ.setdefault("OPENBLAS_CORETYPE", "Haswell")
# These colour what is captured and compared, on a terminal's word or on a server's.
for _name in ("FORCE_COLOR", "TTY_COMPATIBLE", "TTY_INTERACTIVE", "PY_COLORS", "GITHUB_ACTIONS"):
    os.environ.pop(_name, None)
sys.path.insert(0, str(pathlib.Path(__file__).parent))  # `support`, also where a test runs alone


gc.disable()  # while tests are collected: all that is made stays


def pytest_collection_finish():
    """Collections of garbage don't go through the collected tests each time, and are rarer: they took a tenth of the time."""
    gc.freeze()
    gc.set_threshold(50_000, 20, 20)
    gc.enable()


def pytest_collection_modifyitems(items):
    if os.environ.get("ROBUSTID_DATA"):
        return
    missing = pytest.mark.skip(reason="ROBUSTID_DATA is not set: measured data are not part of this repository")
    for item in items:
        if "realdata" in item.keywords:
            item.add_marker(missing)


@pytest.fixture(autouse=True, scope="session")
def _no_downloads(tmp_path_factory):
    """No test touches the network, nor what a user has downloaded before."""
    import pooch

    def refuse(self, url, output_file, pooch, check_only=False):
        raise ConnectionError("tests don't download")

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(pooch.HTTPDownloader, "__call__", refuse)
        patch.setattr(pooch, "os_cache", lambda project: tmp_path_factory.mktemp("cache") / project)
        yield


@pytest.fixture(scope="session")
def consistent():
    """The identification that most pages are about."""
    from support.report_pages import consistent_result

    return consistent_result()


@pytest.fixture(scope="session")
def inconsistent():
    from support.report_pages import inconsistent_result

    return inconsistent_result()


@pytest.fixture(scope="session")
def simple():
    from support.report_pages import simple_result

    return simple_result()


@pytest.fixture(scope="session")
def reduction(consistent):
    from robustid.reduction import balanced_truncation

    return balanced_truncation(consistent.model, tol=0.02)

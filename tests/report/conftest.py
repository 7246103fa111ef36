"""Results that several files of these tests are about: each is computed once a process."""

import dataclasses

import numpy as np
import pytest

import robustid as rid
from robustid.fitting import OrderSweep, fit_mfd
from robustid.report import render_report
from support import fits, frf_records, matrix_pages
from support.report_pages import NASTY, identified
from support.run_files import search_nothing

HZ = 2 * np.pi


@pytest.fixture(autouse=True, scope="module")
def _quick():
    """Bands are drawn, not sharpened."""
    with pytest.MonkeyPatch.context() as patch:
        search_nothing(patch)
        yield


@pytest.fixture(scope="session")
def error():
    """The guaranteed error of a SISO identification, at 0 Hz too."""
    hz = np.array([0.0, 4.0, 9.0, 17.0, 17.6, 30.0, 50.0])
    return rid.worst_case_error(identified(), omega=HZ * hz, directions=6)


@pytest.fixture(scope="session")
def strong(consistent):
    """The same data in a class of both modes, which says something: its verdict alone is a good one."""
    pairs = rid.kautz(HZ * np.array([9.0, 17.67]), [0.1, 0.004], dt=0.01, delay=1)
    prior = rid.Prior(gain_bound=0.2, decay_rate=1.1)
    return rid.identify(dataclasses.replace(consistent.problem, prior=prior, parametric=pairs))


@pytest.fixture(scope="session")
def consistent_page(consistent):
    """What is written of it by default."""
    return render_report(consistent)


@pytest.fixture(scope="session")
def error_page(error):
    """What is written of it with the identification."""
    return render_report(error.identification, worst_case=error)


@pytest.fixture(scope="session")
def static_page(consistent, tmp_path_factory):
    """What is written where pages are to have no script; its pictures take seconds."""
    path = tmp_path_factory.mktemp("static") / "page.html"
    rid.write_report(consistent, path, static=True)
    return path.read_text(encoding="utf-8")


@pytest.fixture(scope="session")
def matrix_result():
    """A 2 x 2 identification of a response with a missing value, and a record with two inputs."""
    frf = matrix_pages.with_values(matrix_pages.measured(lines=10), (3, 1, 0), np.nan, np.inf)
    return rid.identify(matrix_pages.problem(frf, matrix_pages.record()))


@pytest.fixture(scope="session")
def shared_bound():
    """A 2 x 2 identification with a bound on the errors of each column."""
    frf = matrix_pages.measured(lines=8)
    frf = rid.FrequencyResponse(frf.omega, frf.values, bound=rid.Bound(0.1, joint="column"), dt=matrix_pages.DT)
    return rid.identify(matrix_pages.problem(frf))


@pytest.fixture(scope="session")
def matrix_error():
    """The guaranteed error of a 2 x 2 identification."""
    frf = matrix_pages.measured(lines=5, modes=1, inputs=["force [N]", "torque [Nm]"])
    prior = rid.Prior(gain_bound=0.4, decay_rate=1.5)
    result = rid.identify(matrix_pages.problem(frf, modes=1, prior=prior))
    return rid.worst_case_error(result, omega=HZ * np.array([10.0, 30.0]), directions=3, rtol=0.3)


@pytest.fixture(scope="session")
def data():
    """A noisy 2 x 2 response."""
    return fits.measured(fits.SYSTEM, fits.OMEGA, inputs=["force [N]", "torque [Nm]"], outputs=["x [mm]", NASTY])


@pytest.fixture(scope="session")
def fit(data):
    return fit_mfd(data, order=8)


@pytest.fixture(scope="session")
def left(data):
    return fit_mfd(data, order=8, form="left")


@pytest.fixture(scope="session")
def body():
    """A fit with 2 inputs, 2 outputs, one rigid-body mode and two flexible ones."""
    s = 1j * fits.OMEGA
    flexible = fits.random_modal_system(3, 2, 2, 2).response(s)
    rigid = np.array([[1.0], [-0.3]]) @ np.array([[2.0, 1.0]]) * 1e4 / (s**2)[:, None, None]
    return fit_mfd(rid.FrequencyResponse(fits.OMEGA, flexible + rigid), order=6, rigid_body=rid.RigidBody(1))


@pytest.fixture(scope="session")
def sweep():
    """Fits of a SISO response, without the search for the orders."""
    found = {order: fit_mfd(fits.measured(fits.SMALL, fits.OMEGA), order=order) for order in (4, 5)}
    values = np.geomspace(100, 1, 12)
    parameters = np.array([2 * order for order in found])
    equations, unknown = 2 * fits.OMEGA.size, np.full(len(found), np.nan)
    failures = {12: "InputError: <b>no</b>"}
    unresolved = np.zeros(len(found), dtype=int)
    return OrderSweep(found, failures, parameters, equations, False, values, 20.0, unknown, unknown, unresolved)


@pytest.fixture(scope="session")
def recordings():
    """A periodic excitation and the records of it."""
    return frf_records.measured()


@pytest.fixture(scope="session")
def play(recordings):
    return recordings[0]


@pytest.fixture(scope="session")
def records(recordings):
    return recordings[1]


@pytest.fixture(scope="session")
def frf(play, records):
    return rid.estimate_frf(records, period=frf_records.PERIOD, lines=play.lines)

"""A plant in a loop, from its files to the page: run file, command line, refusals."""

import control
import numpy as np
import pytest

import robustid as rid
from robustid.app.run.run_file import read_run_file
from robustid.core import StateMatrices, closed_loop, response_at, simulate
from robustid.errors import InputError
from support.command_line import refused, words

DT = 0.001
PLANT = control.ss(control.c2d(control.tf([2e4], [1, 10, -2.5e3]), DT))  # a levitated mass
CONTROLLER = control.tf([5.61, -5.39], [1, -0.6], DT)
ASK = """
[[record]]
file = "record.csv"
[loop]
numerator = [5.61, -5.39]
denominator = [1, -0.6]
[frequency_points]
every = 12
[modes]
hz = []
damping = []
[prior]
gain_bound = 0.01
decay_rate = 1.3
[worst_case]
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A record of the loop, its response from r to y with a bound, and the controller."""
    place, rng = tmp_path_factory.mktemp("loop"), np.random.default_rng(0)
    r, v = rng.standard_normal((1000, 1)), 0.002 * rng.standard_normal((1000, 1))
    loop = closed_loop(StateMatrices.of(PLANT), StateMatrices.of(control.ss(CONTROLLER)))
    found = simulate(loop, np.hstack([r, v]))[0]
    rid.save(place / "record.csv", rid.TimeRecord(found[:, 0], found[:, 1], dt=DT, reference=r[:, 0]))
    omega = np.linspace(20, 3000, 30)
    closed = response_at(StateMatrices.of(control.ss(control.feedback(PLANT, CONTROLLER))), np.exp(1j * omega * DT))
    bound = 0.02 * np.abs(closed).max()
    error = bound * np.sqrt(rng.random(closed.shape)) * np.exp(2j * np.pi * rng.random(closed.shape))
    rid.save(place / "closed.csv", rid.FrequencyResponse(omega, closed + error, bound=bound, dt=DT))
    rid.save(place / "controller.npz", control.ss(CONTROLLER))
    return place


@pytest.mark.parametrize("every", [48, pytest.param(12, marks=pytest.mark.slow)])
def test_a_run_gives_the_unstable_plant_and_what_holds_of_its_loop(folder, every, request):
    if every == 48:
        request.getfixturevalue("unsearched")
    text = ASK.replace("every = 12", f"every = {every}")
    (folder / "ask.toml").write_text(text + "at_hz = [20.0, 100.0]\n")
    result = rid.run(folder / "ask.toml", folder / f"out-{every}")
    plant = result.plant.model
    assert np.abs(plant.poles()).max() == pytest.approx(np.abs(PLANT.poles()).max(), rel=5e-3)
    assert result.plant.order <= 3  # the plant itself: 2
    assert np.abs(control.feedback(plant, CONTROLLER).poles()).max() < 1
    omega = np.linspace(1, 3000, 500)
    true = 1 / (1 + response_at(StateMatrices.of(control.ss(PLANT * CONTROLLER)), np.exp(1j * omega * DT)))
    assert np.abs(true).max() < result.loop.peaks["sensitivity"].value < 2
    page = (folder / f"out-{every}" / "report.html").read_text()
    assert "Stable with every consistent plant" in page
    assert "ISO 14839-3" in page
    again = rid.load(folder / f"out-{every}" / "plant.npz")
    np.testing.assert_allclose(sorted(again.poles()), sorted(plant.poles()))
    assert "with 1 unstable pole, which the controller" in result.summary()


def test_a_controller_that_is_not_what_ran_is_a_fault_of_the_data(folder):
    text = ASK.replace("5.61, -5.39", "6.171, -5.929").replace("every = 12", "every = 60") + "compute = false\n"
    (folder / "wrong.toml").write_text(text)
    result = rid.run(folder / "wrong.toml", folder / "wrong")
    kinds = {str(one.kind) for one in result.identification.problem.open_faults}
    assert kinds & {"controller", "unit"}, kinds
    assert "times the stated gain" in (folder / "wrong" / "report.html").read_text()


@pytest.mark.slow
def test_the_response_of_the_closed_loop_has_polygons_where_discs_would_limit_the_loop(folder, capsys, monkeypatch):
    monkeypatch.chdir(folder)
    asked = ["identify", "--frequency", "closed.csv", "--loop", "controller.npz", "-o", "sharp"]
    code, out, err = words(asked, capsys, monkeypatch)
    assert code == 0, (out, err)
    kept = rid.load("sharp-loop")
    plain = rid.loop_bounds(rid.band(rid.load("sharp"), model=kept.band.model), kept.loop)
    assert kept.band.polygons is not None
    part = {name: kept.peaks[name].value / peak.value for name, peak in plain.peaks.items()}
    assert max(part.values()) < 1.002, part  # to the tolerance of peaks
    assert min(part.values()) < 0.97, part


STATED = "--mode", "none", "--gain", "0.01", "--decay-rate", "1.3"


@pytest.mark.usefixtures("unsharpened")
def test_the_response_of_the_closed_loop_and_a_controller_in_a_file(folder, capsys, monkeypatch):
    monkeypatch.chdir(folder)
    asked = ["identify", "--frequency", "closed.csv", "--loop", "controller.npz", *STATED]
    code, out, err = words([*asked, "--report", "page.html"], capsys, monkeypatch)
    assert code == 0, (out, err)
    assert "Stable with every consistent plant" in (folder / "page.html").read_text()
    kept = rid.load("result-loop")
    code, out, err = words(["loop", "result", "-v"], capsys, monkeypatch)  # the controller need not be named again
    assert code == 0, (out, err)
    assert f"at most {kept.peaks['sensitivity'].value:.4g}" in out
    omega = np.linspace(20, 3000, 12)
    other = rid.FrequencyResponse(omega, 0.01 / (1 - 0.2 * np.exp(-1j * omega * DT)), bound=1e-3, dt=DT)
    rid.identify(rid.MixedProblem(frequency=other, prior=rid.Prior(gain_bound=0.1, decay_rate=1.3))).save("result")
    refused(words(["loop", "result"], capsys, monkeypatch), "--controller is missing")  # of these the loop is none


def test_a_response_with_another_sample_time_than_the_controller_is_refused(folder, capsys, monkeypatch):
    monkeypatch.chdir(folder)
    frf = rid.load(folder / "closed.csv", kind="frequency")
    rid.save("slow.csv", rid.FrequencyResponse(frf.omega / 2, frf.values, bound=frf.bound, dt=2 * DT))
    asked = ["identify", "--frequency", "slow.csv", "--loop", "controller.npz", "-o", "slow"]
    refused(words(asked, capsys, monkeypatch), "sample time of the loop")


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("[loop]\nnumerator = [1.0]\n", "numerator and denominator make one controller"),
        ('[loop]\ncontroller = "c.npz"\nnumerator = [1]\ndenominator = [1]\n', "the same controller again"),
        ('[loop]\nauxiliary = "p.npz"\n', "needs the controller that ran"),
        ('[loop]\ncontroller = "c.npz"\n[delay]\nseconds = 0.1\n', "does not go with \\[loop\\]"),
        ('[loop]\ncontroller = "c.npz"\n[[record]]\nfile = "r.csv"\nuse = "samples"\n', "does not go with \\[loop\\]"),
    ],
)
def test_contradictions_are_refused_before_any_file_is_opened(tmp_path, text, sentence):
    (tmp_path / "ask.toml").write_text(text)
    with pytest.raises(InputError, match=sentence):
        read_run_file(tmp_path / "ask.toml", sources=False)


def test_a_controller_that_is_missing_is_named(folder):
    (folder / "missing.toml").write_text('[[record]]\nfile = "record.csv"\n[loop]\ncontroller = "none.npz"\n')
    with pytest.raises(InputError, match=r"there is no file .*none\.npz"):
        rid.run(folder / "missing.toml", folder / "missing")

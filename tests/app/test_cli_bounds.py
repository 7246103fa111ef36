"""robustid bounds and robustid verify on real files: exit codes, sentences, interruption."""

import dataclasses
import importlib.util
import pathlib
import signal
import subprocess
import sys
import time

import control
import numpy as np
import pytest

import robustid as rid
from robustid.core import rounded_up
from robustid.guarantees import WorstCaseOverPoles
from support import command_line
from support.cases import slow
from support.forging import arrays_of, forge, lower
from support.problems import random_problem
from support.report_pages import Page


@pytest.fixture(scope="module")
def stored(tmp_path_factory):
    folder = tmp_path_factory.mktemp("stored")
    rid.identify(random_problem(2, "parametric", 8)).save(folder / "good")
    rid.identify(random_problem(2, "parametric", 14, spread=0.1, noise=9.0)).save(folder / "refuted")
    return folder


@pytest.fixture
def files(stored, stand_in):
    return stand_in(stored)


@pytest.fixture
def run(capsys, monkeypatch):
    return lambda *arguments: command_line.main(arguments, capsys, monkeypatch)


@pytest.fixture(scope="module")
def structure(stored):
    """Poles that are suggested by a response, and the identification with them, which is stored as `own`."""
    data = rid.datasets.flexible_structure(lines=5, samples=3, extra_hz=[17.4, 17.6, 17.7, 17.9])
    suggested, prior = rid.suggest_kautz(data.frequency), rid.Prior(gain_bound=0.1, decay_rate=1.3)
    result = rid.identify(rid.MixedProblem(frequency=data.frequency, prior=prior, parametric=suggested.basis))
    result.save(stored / "own")
    return data, suggested, result


GRID = ["--omega", "60", "--omega", "110", "--directions", "4"]


@pytest.mark.usefixtures("unsearched")
def test_bounds_are_computed_saved_and_verified_and_forged_ones_are_named(files, run):
    command_line.refused(run("bounds", "good", *GRID, "-o", "band", "--static"), "--report FILE.html")
    code, out, err = run("bounds", "good", *GRID, "-o", "band", "--report", "band.html", "-v")
    assert (code, err) == (0, "")
    assert "every consistent system is within" in out
    assert "written: band.npz, band.json" in out
    assert "band.html" in out.split("written:")[1]
    saved = rid.load("band")
    page = Page(pathlib.Path("band.html").read_text(encoding="utf-8"))
    assert f"guaranteed error, order {saved.model.nstates}" in page.text
    assert "What is guaranteed" in page.text
    assert saved.omega.tolist() == [60.0, 110.0]
    assert f"{saved.upper.max():.4g}" in out
    for extra in ([], ["--exact"]):
        if extra:
            pytest.importorskip("flint", reason="python-flint is not installed: robustid[exact]")
        code, out, _ = run("verify", "band.json", *extra)
        assert code == 0
        assert "12 of 12 certificates hold" in out
        assert "what was attained: as the computation found it" in out
        assert ("ball arithmetic" in out) == bool(extra)
        assert "never prove them" in out
        assert out.splitlines()[-1] == "verified"
    forge(files / "band", lower("values/support"))
    code, out, _ = run("verify", "band")
    assert code == 1
    assert "FAILED     4 of 12 certificates hold" in out
    assert "FAILED     60 rad/s, direction 1 of 4" in out
    assert out.splitlines()[-1] == "not verified"


@pytest.mark.usefixtures("unsearched")
def test_the_circle_is_bounded_where_asked(files, run):
    code, out, _ = run("bounds", "good", "--points", "3", "--directions", "4", "--rtol", "2", "--circle", "-v")
    assert code == 0
    saved = rid.load("bounds")
    assert saved.omega.size == 3
    assert f"<= {saved.hinf:.4g} at every frequency" in out
    code, out, _ = run("verify", "bounds")
    assert code == 0
    assert f"<= {saved.hinf:.4g} at every frequency" in out
    assert "pi/dt" in out


@pytest.mark.usefixtures("unsearched")
def test_a_controller_is_judged_against_every_consistent_system(files, run):
    """As `robust_stability_margin` does of what was saved; without the circle, or a file, a sentence."""
    controller = control.ss([[0.9]], [[0.1]], [[1e-3]], [[0.0]], rid.load("good").problem.dt)
    rid.save("low.npz", controller)
    grid = ["--points", "3", "--directions", "4", "--rtol", "2"]
    command_line.refused(run("bounds", "good", *grid, "--controller", "low.npz"), "add --circle")
    command_line.refused(
        run("bounds", "good", *grid, "--circle", "--controller", "none.npz"),
        "--controller none.npz: there is no such file",
    )
    code, out, _ = run(
        "bounds", "good", *grid, "--circle", "--controller", "low.npz", "--report", "loop.html", "-o", "loop", "-v"
    )
    assert code == 0
    margin = rid.load("loop").robust_stability_margin(controller)
    assert margin.guaranteed
    assert "controller low:" in out
    assert f"{margin.margin:.4g}"[:4] in out
    assert "low" in pathlib.Path("loop.html").read_text(encoding="utf-8")


@pytest.mark.usefixtures("unsearched")
def test_a_band_over_the_poles_from_the_data_is_narrowed_by_cells(structure, files, run):
    """Where the error is largest, or at the frequencies that are stated; what is kept holds, and is narrower."""
    _, suggested, result = structure
    plain = rid.band(result, box=(suggested.omega_interval, suggested.damping_interval), omega=[30.0])
    code, out, _ = run("bounds", "own", "--omega", "30", "--directions", "3", "-v")
    assert code == 0
    whole = rid.load("bounds-band")
    assert isinstance(whole.polygons, WorstCaseOverPoles)
    assert whole.polygons.omega.tolist() == [30.0]
    assert whole.verify()
    assert whole.narrowing_words in out
    assert np.all(whole.error_at([30.0]) <= plain.with_model(result.model).error_at([30.0]))


@pytest.mark.parametrize("workers", ["1", pytest.param("2", marks=pytest.mark.slow)])
@pytest.mark.usefixtures("unsearched")
def test_poles_from_the_data_are_covered_where_asked(structure, files, run, workers):
    data, _, result = structure
    given = rid.kautz(*data.modes.T, dt=0.01, delay=1)
    rid.identify(dataclasses.replace(result.problem, parametric=given)).save("given")
    few = ("--omega", "30", "--directions", "3", "--poles")
    code, out, _ = run("bounds", "own", *few, "--workers", workers, "--resume", "part", "-v")
    assert code == 0
    assert "with every pole in the pole-uncertainty box" in out
    assert "mode 2" in out
    assert "written: bounds.npz, bounds.json" in out
    assert "bounds-poles.npz, bounds-poles.json" in out
    assert list((files / "part" / "cell-1").glob("values-*.npz"))
    band = rid.load("bounds-poles")
    assert f"within {rounded_up(band.upper.max()):.4g} of the model" in out
    whole = rid.load("bounds-band")
    assert whole.polygons.claim_count == band.claim_count
    assert whole.narrowing_words in out
    assert np.all(whole.error_at(band.omega) <= band.upper)
    before = (files / "bounds-poles.npz").read_bytes()
    (files / "bounds.npz").unlink()
    (files / "bounds.json").unlink()
    command_line.refused(run("bounds", "own", *few), "bounds-poles.npz exists")
    assert not (files / "bounds.npz").exists()
    assert (files / "bounds-poles.npz").read_bytes() == before
    code, out, _ = run("verify", "bounds-poles")
    assert code == 0
    count = band.claim_count
    assert f"{count} of {count} certificates hold" in out
    assert "the box:" in out
    assert "poles inside the box" in out
    assert out.splitlines()[-1] == "verified"
    code, out, _ = run("bounds", "given", *few, "-o", "others", "-v")
    assert code == 0
    assert "these poles were given otherwise" in out
    assert not (files / "others-poles.npz").exists()
    own = (files / "bounds-poles.npz").read_bytes()
    forge(files / "bounds-poles", lambda a: {"omega": 0.99 * a["omega"]})
    command_line.refused(run("verify", "bounds-poles.json"), "bounded at other frequencies")
    (files / "bounds-poles.npz").write_bytes(own)
    forge(files / "bounds-poles", lambda a: {"box/ends/1": a["box/ends/1"] * [0.99, 1.01]})
    code, out, _ = run("verify", "bounds-poles.json")
    assert code == 1
    assert "FAILED     cells of poles: they leave out a part of the pole-uncertainty box" in out


def test_consistency_and_refutation_are_verified(files, run):
    code, out, _ = run("verify", "good")
    assert code == 0
    assert "reached by a system of the class" in out
    for exact in ([], ["--exact"]) if importlib.util.find_spec("flint") else ([],):
        code, out, _ = run("verify", "refuted", *exact)
        assert code == 0
        least = rid.load("refuted").margin_lower
        assert f"no system of the class keeps every |residual| below {least:.6g} times its bound" in out
        assert ("ball arithmetic" in out) == bool(exact)


@pytest.mark.usefixtures("unsearched")
def test_no_command_ends_with_0_where_the_identification_is_not_verified(files, run):
    """Neither what reads one whose certificate is forged, nor `verify`."""
    forge(files / "good", text=lambda record: record["claim"]["certificate"].update(value=record["claim"]["margin"]))
    assert rid.load("good").status is rid.Status.CONSISTENT
    assert rid.load("good").verified_status is rid.Status.FAILED
    for command in (["bounds", "good", *GRID], ["reduce", "good"], ["report", "good"], ["verify", "good"]):
        code, out, err = run(*command)
        assert code == 1, command
        assert "erif" in out + err, command
    assert "FAILED     certificate: stated minus recomputed" in out  # of the last, `verify`
    assert out.splitlines()[-1] == "not verified"


def test_changed_data_are_refused(files, run):
    arrays = arrays_of(files / "good")
    np.savez("good.npz", **arrays | {"problem/time/0/y": arrays["problem/time/0/y"] * 1.01})
    command_line.refused(run("verify", "good"), "digest")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["bounds", "nothing"], "nothing.json is missing"),
        (["verify", "nothing"], "nothing.json is missing"),
        (["bounds", "refuted"], "there is no consistent system"),
        (["bounds", "good", "--omega", "1", "--points", "3"], "give one of them"),
        (["bounds", "good", "--omega", "1e9"], "--omega must lie between"),
        (["bounds", "good", "--directions", "2"], "--directions must be at least 3"),
        (["bounds", "good", "--rtol", "0"], "--rtol must be positive"),
        (["bounds", "good", "-o", "good"], "good.npz is one of the files to be read"),
        (["bounds", "good", "--resume", "good.npz", *GRID], "--resume = 'good.npz' can't be a folder"),
    ],
)
def test_misuse_ends_with_one_sentence(files, run, arguments, words):
    outcome = run(*arguments)
    command_line.refused(outcome, words)
    assert len(outcome[2].strip().splitlines()) == 1


def test_without_the_library_exact_says_what_to_install(files, run, monkeypatch):
    monkeypatch.setitem(sys.modules, "flint", None)
    command_line.refused(run("verify", "good", "--exact"), "--exact needs python-flint")


@pytest.mark.parametrize(("workers", "count"), [("1", 8), slow("1", 16), slow("2", 16)])
def test_an_interrupted_run_goes_on_from_its_folder(files, run, workers, count):
    """Ctrl-C in a real process, that may have workers of its own; the second run computes the rest only."""
    directions = "3" if count == 8 else "4"
    arguments = ["bounds", "good", "--points", str(count), "--directions", directions, "--resume", "part"]
    command = [sys.executable, "-m", "robustid", *arguments, "--workers", workers]
    # A suite that runs in the background of a shell ignores Ctrl-C, and its children would inherit that.
    process = subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    deadline = time.monotonic() + 60
    while len(list((files / "part").glob("*.npz"))) < 2 and process.poll() is None and time.monotonic() < deadline:
        time.sleep(0.02)
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=60)
    assert process.returncode == 130, err
    assert "next, the rest, from what is finished:" in out
    assert "interrupted: what was found by then is written" in err
    done = {p: p.stat().st_mtime_ns for p in (files / "part").iterdir()}
    assert 2 <= len(done) < count
    part = rid.load("bounds")
    assert part.omega.size + part.missing.size == count
    assert len(done) == part.omega.size
    assert part.certified
    code, out, _ = run(*arguments, "--force")
    assert code == 0
    assert rid.load("bounds").omega.size == count
    assert len(list((files / "part").iterdir())) == count
    assert {p: p.stat().st_mtime_ns for p in done} == done

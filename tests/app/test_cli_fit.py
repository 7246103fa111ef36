"""robustid fit on real files: a model on disk, sentences, exit codes."""

import dataclasses
import re
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import scipy.io

import robustid as rid
from robustid.fitting import FitStatus
from robustid.formats import load_model
from support import command_line
from support.interrupts import ctrl_c
from support.mfd_systems import noisy, random_modal_system

HZ = 2 * np.pi
OMEGA = HZ * np.geomspace(4, 1200, 100)
SYSTEM = random_modal_system(1, 2, 2, 4)
VALUES = noisy(np.random.default_rng(0), SYSTEM.response(1j * OMEGA))
SMALL = random_modal_system(4, 2, 1, 2)  # order 4: what doesn't need more is quicker with it
FEW = noisy(np.random.default_rng(0), SMALL.response(1j * OMEGA))


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """2x2 of order 8 and 2x1 of order 4: as robustid writes them, and as others do."""
    folder = tmp_path_factory.mktemp("files")
    names = {"inputs": ["force [N]", "torque [Nm]"], "outputs": ["x [mm]", ("[red]phi[/red]", "")]}
    rid.save(folder / "frf.csv", rid.FrequencyResponse(OMEGA, VALUES, **names))
    variance = (0.01 * np.abs(FEW[:, :, 0])) ** 2
    known = rid.FrequencyResponse(OMEGA, FEW, covariance=np.eye(2) * variance[:, None, :])
    rid.save(folder / "known.npz", known)
    np.savez(folder / "hertz.npz", omega=OMEGA / HZ, values=FEW)
    scipy.io.savemat(folder / "odd.mat", {"where": OMEGA, "P": FEW})
    broken = VALUES.copy()
    broken[3, 0, 1] = np.nan
    np.savez(folder / "nan.npz", omega=OMEGA, values=broken)
    np.savez(folder / "zero.npz", omega=OMEGA, values=0 * FEW)
    np.savez(folder / "twice.npz", omega=OMEGA[[0, 1, 1]], values=FEW[:3])
    rid.save(folder / "step.csv", rid.datasets.flexible_structure().time)
    return folder


@pytest.fixture
def files(made, stand_in):
    return stand_in(made)


@pytest.fixture
def run(capsys, monkeypatch):
    return lambda arguments: command_line.main(["fit", *arguments], capsys, monkeypatch)


def poles_hz(name):
    return np.sort(np.abs(load_model(name).poles()))[::2] / HZ


def test_fit_writes_model_and_report_and_says_what_it_does(files, run):
    code, out, err = run(["frf.csv", "--order", "8", "-o", "model", "--report", "page.html", "-v"])
    assert code == 0, err
    fit = rid.load("model")
    np.testing.assert_allclose([row.hz for row in fit.modes], np.sort(SYSTEM.frequency) / HZ, rtol=1e-3)
    text = " ".join(out.split())
    for words in (
        "all of 2 outputs and 2 inputs, continuous time",
        "Converged",
        "McMillan degree 8",
        "[red]phi[/red] /",
        "written: model.npz, model.json, page.html",
    ):
        assert words in text
    assert "iteration 1" not in text  # a line for each is for a terminal, where it replaces the one before
    assert "robustid" in (files / "page.html").read_text(encoding="utf-8")


def test_units_fields_band_and_form(files, run):
    options = ["--frequency-unit", "Hz", "--form", "left", "-o", "hz.mat"]
    code, out, err = run(["hertz.npz", "--order", "4", "-v", *options])
    assert code == 0, err
    assert "omega read as Hz" in out
    assert "D⁻¹ N" in out
    np.testing.assert_allclose(poles_hz("hz.mat"), np.sort(SMALL.frequency) / HZ, rtol=1e-3)
    fields = ["--frequency-field", "omega=where", "--frequency-field", "values=P", "--band", "4.5:1100"]
    code, out, err = run(["odd.mat", "--order", "4", *fields, "-o", "part.npz", "-v"])
    assert code in (0, 1), err
    assert "omega read as rad/s (--frequency-unit Hz if the file has Hz)" in out
    kept = np.sum((OMEGA >= 4.5 * HZ) & (OMEGA <= 1100 * HZ))
    assert f"read odd.mat: frequency response, {kept} frequency points" in out
    assert load_model("part.npz").nstates == 4


def test_the_covariance_is_the_weight_unless_asked_otherwise(files, run):
    costs = {}
    for option in ("", "--relative"):
        arguments = ["known.npz", "--order", "4", "--force", "-v", *[option] * bool(option)]
        code, out, err = run(arguments)
        assert code == 0, err
        costs[option] = float(out.split("Cost")[1].split()[0])
    assert costs["--relative"] == pytest.approx(1e-4 * costs[""], rel=0.05)


def test_the_structure_of_the_modes_is_asked_for(files, run):
    code, out, err = run(["known.npz", "--order", "4", "--modal", "general", "-v"])
    assert code == 0, err
    assert "complex shapes" in out


def test_rigid_body_and_roll_off(files, run):
    s = 1j * OMEGA[:, None, None]
    rid.save("rigid.npz", rid.FrequencyResponse(OMEGA, FEW + 1e5 * np.array([[1.0], [0.5]]) / s**2))
    options = ["--order", "6", "--rigid-body", "1", "--roll-off", "2"]
    code, out, err = run(["rigid.npz", *options, "-v"])
    assert code in (0, 1), err
    assert "rigid body" in out
    model = load_model("fit.npz")
    assert int(np.sum(np.abs(np.diag(model.A)) == 0)) >= 2
    gain = np.abs(model(1j * HZ * np.array([1e5, 1e6]), squeeze=False))
    np.testing.assert_allclose(gain[..., 0] / gain[..., 1], 100, rtol=0.01)


def test_next_steps_of_the_page_are_commands_with_ones_own_names(files, run):
    code, out, _ = run(["hertz.npz", "--frequency-unit", "Hz", "--order", "1", "-o", "low.npz", "--report", "low.html"])
    compared = "robustid fit hertz.npz --frequency-unit Hz --order auto -o low.npz --report low.html --force"
    assert code == 1
    assert compared in out
    page = (files / "low.html").read_text(encoding="utf-8")
    assert compared in re.sub(r"<[^>]+>", "", page)
    assert "--frequency FILE" not in re.sub(r"<[^>]+>", "", page)


def test_order_auto_takes_the_smallest_description_length(files, run, monkeypatch):
    """The sweep itself and its processes, which import everything, are tested elsewhere: here the progress and the choice."""
    monkeypatch.setattr("robustid.core.worker_pool", lambda: ThreadPoolExecutor(1))
    system = random_modal_system(0, 1, 1, 1)
    omega = OMEGA[::2]
    values = noisy(np.random.default_rng(1), system.response(1j * omega))
    rid.save("one.npz", rid.FrequencyResponse(omega, values))
    monkeypatch.setattr("robustid.fitting.order_choice._AROUND", (-1, 0, 1))
    arguments = ["one.npz", "--order", "auto", "--report", "page.html", "-v"]
    code, out, err = run(arguments)
    assert code in (0, 1), err
    assert "fitting a range of orders …" in out
    assert "poles by order: o as in the order before" in out
    assert "so far order 2" in out
    assert "has the smallest MDL" in out
    assert "Stabilisation" in (files / "page.html").read_text(encoding="utf-8")
    assert load_model("fit.npz").nstates == 2


def test_not_converged_exits_with_1_and_still_writes(files, run, monkeypatch):
    import robustid.fitting

    real = robustid.fitting.fit_mfd
    monkeypatch.setattr(
        "robustid.fitting.fit_mfd", lambda *a, **k: dataclasses.replace(real(*a, **k), status=FitStatus.LIMIT)
    )
    code, out, _ = run(["hertz.npz", "--frequency-unit", "Hz", "--order", "4"])
    assert code == 1
    assert "Not converged" in out
    assert (files / "fit.npz").exists()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["missing.npz", "--order", "8"], "error: missing.npz: there is no such file; check the name and the folder"),
        (["it's.npz", "--order", "8"], "error: it's.npz: there is no such file"),
        ([".", "--order", "8"], "error: . is a folder; give the name of a file in it"),
        (["zero.npz", "--order", "8"], "error: zero.npz is zero everywhere; there is nothing to fit"),
        (["twice.npz", "--order", "8"], "error: twice.npz has 2 frequency points at"),
        (["nan.npz", "--order", "8"], "nan.npz: values must be finite; got (nan+0j) at index (3, 0, 1)"),
        (["step.csv", "--order", "8"], "step.csv holds time data"),
        (["frf.csv", "--order", "400"], "--order = 400 has 1600 free coefficients, but the 100 frequency points"),
        (["frf.csv", "--order", "8x"], "--order must be a positive whole number"),
        (["frf.csv", "--order", "0"], "--order must be a positive whole number"),
        (
            ["hertz.npz", "--order", "8", "--frequency-unit", "rpm"],
            "--frequency-unit must be one of rad/s, Hz, kHz; got 'rpm'",
        ),
        (["hertz.npz", "--order", "8", "--dt", "0.01"], "lies above the Nyquist frequency of 50 Hz"),
        (["frf.csv", "--order", "8", "--band", "5"], "LOW:HIGH"),
        (
            ["frf.csv", "--order", "8", "--band", "5000:6000"],
            "no frequency point lies between 5000 and 6000 Hz; they go",
        ),
        (["frf.csv", "--order", "8", "--form", "middle"], "--form must be"),
        (["frf.csv", "--order", "8", "--domain", "z"], "--domain must be"),
        (["frf.csv", "--order", "8", "--method", "foo"], "--method must be one of"),
        (["frf.csv", "--order", "8", "--covariance"], "frf.csv holds no covariance"),
        (
            ["frf.csv", "--order", "8", "--rigid-body", "3"],
            "--rigid-body asks for 3 modes, more than there are inputs (2); each needs",
        ),
        (["frf.csv", "--order", "2", "--rigid-body", "2"], "--order = 2 has no room for 2 rigid-body modes"),
        (
            ["frf.csv", "--order", "8", "--roll-off", "9"],
            "--roll-off = 9 is more roll-off than an order of 8 allows (at most 4)",
        ),
        (["frf.csv", "--order", "8", "-o", "fit.csv"], "must end in .npz or .mat"),
        (["frf.csv", "--order", "8", "--report", "frf.csv", "--force"], "is one of the files to be read"),
        (["frf.csv", "--order", "8", "-o", "known.npz"], "--force"),
        (["odd.mat", "--order", "8"], "--frequency-field omega=NAME"),
        (
            ["known.npz", "--order", "4", "--symmetric", "--force"],
            "--symmetric belongs to a structure of the modes: give --modal too",
        ),
        (["frf.csv", "--order", "7", "--modal", "proportional", "--force"], "--order must be even with --modal"),
    ],
)
def test_misuse_exits_with_2_and_one_sentence(files, run, arguments, words):
    with command_line.nothing_written():
        command_line.refused(run(arguments), words)


def test_ctrl_c_while_the_page_is_drawn_leaves_the_model(files, run, monkeypatch):
    monkeypatch.setattr("robustid.report.render_report", ctrl_c)
    code, out, _ = run(
        ["hertz.npz", "--frequency-unit", "Hz", "--order", "4", "-o", "alone.mat", "--report", "no.html"]
    )
    assert code == 130
    assert "written: alone.mat" in out
    assert load_model("alone.mat").nstates == 4
    assert not (files / "no.html").exists()

"""robustid reduce: what is said, what is refused, and how."""

import control
import numpy as np
import pytest

import robustid as rid
from robustid.formats import load_model, save_model
from support.command_line import nothing_written, refused
from support.reduction_models import random_model
from support.two_mode_models import two_modes

pytestmark = pytest.mark.quick


@pytest.fixture
def model(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    made = two_modes(0.01)
    save_model(made, "model.npz")
    return made


def numbers_of(out):
    words = {line.split(":")[0]: line for line in out.splitlines()}
    return float(words["largest error over all frequencies"].split(": ")[1].split(",")[0])


def test_error_stands_beside_its_bound(model, run):
    code, out, _ = run(["reduce", "model.npz", "--order", "2"])
    assert code == 0
    bound = float(next(line for line in out.splitlines() if "error at most" in line).split()[3].rstrip(","))
    assert 0.1 * bound < numbers_of(out) <= bound
    assert load_model("reduced.npz").nstates == 2


@pytest.mark.parametrize("options", [["--band", "0.8:1.2"], ["--horizon", "0.1"], ["--weight", "weight.npz"]])
def test_limits_reach_the_truncation(model, run, options):
    weight = control.ss([[0.9]], [[1.0]], [[0.1]], [[0.0]], 0.01)
    save_model(weight, "weight.npz")
    code, out, _ = run(["reduce", "model.npz", "--order", "2", *options])
    assert code == 0
    assert "no a-priori bound" in " ".join(out.split())
    asked = {"--band": {"band_hz": (0.8, 1.2)}, "--horizon": {"horizon": 0.1}, "--weight": {"weight": weight}}[
        options[0]
    ]
    expected = rid.balanced_truncation(model, order=2, **asked).model
    np.testing.assert_allclose(load_model("reduced.npz").poles(), expected.poles(), atol=1e-12)


def test_static_gain_is_kept(model, run):
    code, _, _ = run(["reduce", "model.npz", "--order", "1", "--static-gain"])
    assert code == 0
    assert load_model("reduced.npz").dcgain() == pytest.approx(model.dcgain(), rel=1e-10)


def test_an_unstable_outcome_exits_with_1(tmp_path, run, monkeypatch):
    monkeypatch.chdir(tmp_path)

    for seed in range(60):
        given = random_model(np.random.default_rng(seed), discrete=False)
        for order in range(1, given.nstates):
            if rid.balanced_truncation(given, order=order, band_hz=(0.3, 0.4)).model.poles().real.max() >= 0:
                save_model(given, "given.npz")
                command = ["reduce", "given.npz", "--order", str(order), "--band", "0.3:0.4"]
                code, out, _ = run(command)
                assert code == 1
                assert "unstable" in out
                return
    pytest.fail("no unstable outcome among 60 models")


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (["--band", "1-2", "--order", "1"], "LOW:HIGH"),
        (["--band", "1:2"], "--order is needed with --band"),
        (["--band", "1:2", "--horizon", "1", "--order", "1"], "got --band and --horizon"),
        (["--band", "1:60", "--order", "1"], "Nyquist frequency, 50 Hz"),
        (["--weight", "nothing.npz", "--order", "1"], "nothing.npz"),
        (["--horizon", "-1", "--order", "1"], "--horizon must be positive"),
        (["--order", "1", "-o", "small.txt"], "must end in .npz, .mat, .m, .json, .h, .sos or .zpk"),
        (["--order", "1", "-o", "model.npz", "--force"], "one of the files to be read"),
    ],
)
def test_misuse_is_one_sentence_in_options(model, run, options, says):
    with nothing_written():
        refused(run(["reduce", "model.npz", *options]), says)


def test_an_identification_is_truncated_where_an_option_says_how(tmp_path, run, monkeypatch):
    monkeypatch.chdir(tmp_path)
    data = rid.datasets.flexible_structure(seed=0)
    basis = rid.kautz(data.modes[:, 0], data.modes[:, 1], dt=0.01, delay=1)
    prior = rid.Prior(gain_bound=0.2, decay_rate=1.1)
    rid.identify(rid.MixedProblem(frequency=data.frequency, time=data.time, prior=prior, parametric=basis)).save("mine")
    code, out, _ = run(["reduce", "mine", "--order", "6", "--static-gain"])
    assert code == 0
    assert "largest |residual|/bound" in out
    assert load_model("reduced.npz").nstates == 6


def test_an_unstable_model_is_refused_or_kept(files, run):
    save_model(control.ss([[1.0, 0], [0, 0.5]], [[1], [1]], [[1, 1]], [[0]], 0.1), "integrator.npz")
    refused(run(["reduce", "integrator.npz", "--order", "1"]), "stab")
    code, _, _ = run(["reduce", "integrator.npz", "--order", "1", "--keep-unstable"])
    assert code == 0
    assert load_model("reduced.npz").poles() == pytest.approx([1.0])


def test_names_are_looked_at_before_the_files_are(files, run):
    refused(run(["reduce", "whatever", "-o", "small.txt"]), "must end in .npz, .mat, .m, .json, .h, .sos or .zpk")
    refused(run(["reduce", "small.npz", "-o", "small.npz", "--force"]), "one of the files to be read")


def test_a_small_model_keeps_names_and_units_of_the_signals(tmp_path, monkeypatch, run):
    monkeypatch.chdir(tmp_path)
    made = two_modes(0.01)
    labels = {"inputs": ["force [N]"], "outputs": ["position [mm]"]}
    save_model(control.ss(made.A, made.B, made.C, made.D, made.dt, **labels), "model.npz")
    assert run(["reduce", "model.npz", "--order", "2", "-o", "small.mat"])[0] == 0
    assert run(["export", "small.mat", "-o", "small.npz"])[0] == 0
    small = load_model("small.npz")
    assert (small.nstates, small.input_labels, small.output_labels) == (2, *labels.values())

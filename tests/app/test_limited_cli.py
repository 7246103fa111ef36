"""robustid reduce, and models in files: what is said, what is refused, and how."""

import control
import numpy as np
import pytest
import scipy.io

import robustid as rid
from robustid.data.io.model_files import load_model, save_model
from robustid.errors import FileFormatError
from support.cli_runs import run
from support.two_mode_models import two_modes


@pytest.fixture
def model(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    made = two_modes(0.01)
    save_model(made, "model.npz")
    return made


def numbers_of(out):
    words = {line.split(":")[0]: line for line in out.splitlines()}
    return float(words["largest error over all frequencies"].split(": ")[1].split(",")[0])


def test_error_stands_beside_its_bound(model, capsys, monkeypatch):
    code, out, _ = run(["reduce", "model.npz", "--order", "2"], capsys, monkeypatch)
    assert code == 0
    bound = float(next(line for line in out.splitlines() if "error at most" in line).split()[3].rstrip(","))
    assert 0.1 * bound < numbers_of(out) <= bound
    assert load_model("reduced.npz").nstates == 2


@pytest.mark.parametrize("options", [["--band", "0.8:1.2"], ["--horizon", "0.1"], ["--weight", "weight.npz"]])
def test_limits_reach_the_truncation(model, capsys, monkeypatch, options):
    weight = control.ss([[0.9]], [[1.0]], [[0.1]], [[0.0]], 0.01)
    save_model(weight, "weight.npz")
    code, out, _ = run(["reduce", "model.npz", "--order", "2", *options], capsys, monkeypatch)
    assert code == 0
    assert "no a-priori bound" in " ".join(out.split())
    asked = {"--band": {"band_hz": (0.8, 1.2)}, "--horizon": {"horizon": 0.1}, "--weight": {"weight": weight}}[
        options[0]
    ]
    expected = rid.balanced_truncation(model, order=2, **asked).model
    np.testing.assert_allclose(load_model("reduced.npz").poles(), expected.poles(), atol=1e-12)


def test_static_gain_is_kept(model, capsys, monkeypatch):
    code, _, _ = run(["reduce", "model.npz", "--order", "1", "--static-gain"], capsys, monkeypatch)
    assert code == 0
    assert load_model("reduced.npz").dcgain() == pytest.approx(model.dcgain(), rel=1e-10)


def test_an_unstable_outcome_exits_with_1(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    from support.reduction_models import random_model

    for seed in range(60):
        given = random_model(np.random.default_rng(seed), discrete=False)
        for order in range(1, given.nstates):
            if rid.balanced_truncation(given, order=order, band_hz=(0.3, 0.4)).model.poles().real.max() >= 0:
                save_model(given, "given.npz")
                command = ["reduce", "given.npz", "--order", str(order), "--band", "0.3:0.4"]
                code, out, _ = run(command, capsys, monkeypatch)
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
        (["--order", "1", "-o", "small.txt"], ".npz or .mat"),
    ],
)
def test_misuse_is_one_sentence_in_options(model, tmp_path, capsys, monkeypatch, options, says):
    code, _, err = run(["reduce", "model.npz", *options], capsys, monkeypatch)
    assert code == 2
    assert says in " ".join(err.split())
    assert "`" not in err
    assert [path.name for path in tmp_path.iterdir()] == ["model.npz"]


def test_an_identification_is_truncated_where_an_option_says_how(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    data = rid.flexible_structure(seed=0)
    basis = rid.kautz(data.modes[:, 0], data.modes[:, 1], dt=0.01, delay=1)
    prior = rid.Prior(gain_bound=0.2, decay_rate=1.1)
    rid.identify(rid.MixedProblem(frequency=data.frequency, time=data.time, prior=prior, parametric=basis)).save("mine")
    code, out, _ = run(["reduce", "mine", "--order", "6", "--static-gain"], capsys, monkeypatch)
    assert code == 0
    assert "largest |residual|/bound" in out
    assert load_model("reduced.npz").nstates == 6


A, B, C = np.array([[-1.0]]), np.ones((1, 1)), np.ones((1, 1))


@pytest.mark.parametrize(
    ("content", "says"),
    [
        ({"A": np.array([object()]), "B": B, "C": C}, "pickled Python objects"),
        ({"A": A, "B": B}, "no matrix C"),
        ({"A": A, "B": B, "C": np.array([["x"]])}, "no matrix C"),
        ({"A": A, "B": np.ones((2, 1)), "C": C}, "matrix B of m.npz must be 1 x 1; got 2 x 1"),
        ({"A": np.ones((1, 2)), "B": B, "C": C}, "matrix A of m.npz must be 1 x 1; got 1 x 2"),
        ({"A": A, "B": B, "C": C, "D": np.ones((1, 3))}, "matrix D"),
        ({"A": A * np.nan, "B": B, "C": C}, "`A` must be finite"),
        ({"A": A * 1j, "B": B, "C": C}, "`A` must be real"),
        ({"A": A[0], "B": B, "C": C}, "2 dimensions"),
        ({"A": A, "B": B, "C": C, "dt": np.ones(2)}, "`dt` must be one number"),
        ({"A": A, "B": B, "C": C, "dt": -0.1}, "`dt` must be >= 0"),
    ],
)
def test_foreign_archives_are_refused_in_our_own_words(tmp_path, content, says):
    np.savez(tmp_path / "m.npz", **content)
    with pytest.raises(FileFormatError, match=says) as caught:
        load_model(tmp_path / "m.npz")
    assert "allow_pickle" not in str(caught.value)


def test_damaged_and_foreign_files_are_refused(tmp_path):
    for name in ("m.npz", "m.mat"):
        (tmp_path / name).write_bytes(b"PK\x03\x04" + bytes(200))
        with pytest.raises(FileFormatError, match=name):
            load_model(tmp_path / name)
    (tmp_path / "m.csv").write_text("A,B\n1,2\n")
    with pytest.raises(FileFormatError, match=r"\.npz or \.mat"):
        load_model(tmp_path / "m.csv")


@pytest.mark.parametrize("name", ["m.npz", "m.mat"])
def test_models_come_back_as_they_were(tmp_path, name):
    for dt in (0, 0.01):
        given = control.StateSpace([[0.5, 0.1], [0, 0.2]], [[1.0], [2]], [[1.0, 0], [3, 4]], [[0.0], [5]], dt)
        save_model(given, tmp_path / name)
        again = load_model(tmp_path / name)
        assert again.dt == dt
        for letter in "ABCD":
            np.testing.assert_array_equal(getattr(again, letter), getattr(given, letter))


def test_sparse_matrices_of_matlab_are_read(tmp_path):
    scipy.io.savemat(tmp_path / "m.mat", {"A": scipy.sparse.csc_array(A), "B": B, "C": C})
    np.testing.assert_array_equal(load_model(tmp_path / "m.mat").A, A)

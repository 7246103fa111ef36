"""robustid.load and robustid.save: whatever the library writes goes through one door and comes back."""

import control
import numpy as np
import pytest
import scipy.sparse

import robustid as rid
from robustid.errors import InputError
from support.problems import random_problem

pytestmark = pytest.mark.quick


@pytest.fixture(scope="module")
def result():
    return rid.identify(random_problem(2, "parametric", 8))


def test_the_folder_of_a_run_stands_for_its_result(result, tmp_path, monkeypatch):
    folder = tmp_path / "run"
    folder.mkdir()
    with pytest.raises(InputError, match="is a folder"):
        rid.load(folder)
    result.save(folder / "identification")
    monkeypatch.chdir(folder)
    for name in (folder, ".", "../run"):
        assert rid.load(name).margin == result.margin
    other = rid.identify(random_problem(2, "parametric", 6))
    other.save(folder)  # run.npz and run.json, beside the folder: files go first
    assert rid.load(folder).margin == other.margin != result.margin


def model(order=2, dt=0.1):
    rng = np.random.default_rng(order)
    return control.ss(0.5 * np.eye(order), rng.normal(size=(order, 2)), rng.normal(size=(1, order)), [[0.0, 1.0]], dt)


THINGS = {
    "response.csv": lambda: rid.FrequencyResponse([1.0, 2.0], [0.1 + 0.2j, 0.3j], bound=0.01, dt=0.1),
    "record.npz": lambda: rid.TimeRecord([1.0, 0.0], [0.5, 0.7], dt=1.0, bound=1e-3, initial="free"),
    "record.mat": lambda: rid.TimeRecord([1.0, 0.0], [0.5, 0.7], dt=1.0, bound=1e-3),
    "play.csv": lambda: rid.prepare.multisine(lines=[1, 3], period=10, dt=0.5, inputs=2, periods=2),
    "play.npz": lambda: rid.prepare.multisine(lines=[1, 3], period=10, dt=0.5),
}


@pytest.mark.parametrize("name", THINGS)
def test_what_is_measured_or_played_comes_back(name, tmp_path):
    thing = THINGS[name]()
    rid.save(tmp_path / name, thing)
    (tmp_path / "own").mkdir()
    thing.save(tmp_path / "own" / name)
    assert type(rid.load(tmp_path / "own" / name)) is type(thing)
    again = rid.load(tmp_path / name)
    assert type(again) is type(thing)
    for field in set(vars(thing)) & {"u", "y", "values", "omega", "bound", "lines"}:
        np.testing.assert_array_equal(getattr(again, field), getattr(thing, field))


@pytest.mark.parametrize(("order", "dt"), [(0, 0.1), (2, 0.1), (2, 0)])
@pytest.mark.parametrize("ending", ["npz", "mat"])
def test_models_come_back(order, dt, ending, tmp_path):
    given = model(order, dt)
    rid.save(tmp_path / f"model.{ending}", given)
    again = rid.load(tmp_path / f"model.{ending}")
    for name in "ABCD":
        np.testing.assert_array_equal(getattr(again, name), getattr(given, name))
    assert again.dt == dt
    assert rid.load(tmp_path / f"model.{ending}", dt=0.2).dt == 0.2


def test_a_model_beside_measurements_is_asked_for(tmp_path):
    signals = {"u": np.ones(3), "y": np.arange(3.0), "dt": 0.1}
    np.savez(tmp_path / "both.npz", **{name: getattr(model(), name) for name in "ABCD"}, **signals)
    assert rid.load(tmp_path / "both.npz").y.shape == (3, 1)
    assert rid.load(tmp_path / "both.npz", kind="model").nstates == 2


@pytest.mark.parametrize("complex_part", [0.0, 2.0j])
def test_sparse_matrices_of_matlab_are_written_out(complex_part, tmp_path):
    A = scipy.sparse.diags([0.5, 0.25, 0.0]).tocsc()
    A[0, 2] = 0.125
    numbers = {"A": A.tocsc(), "B": np.ones((3, 1)), "C": np.ones((1, 3)), "dt": 0.1}
    scipy.io.savemat(tmp_path / "sparse.mat", numbers)
    np.testing.assert_array_equal(rid.load(tmp_path / "sparse.mat").A, A.toarray())
    scipy.io.savemat(
        tmp_path / "odd.mat", {"omega": [1.0, 2.0], "values": scipy.sparse.csc_matrix([[1 + complex_part, 1]])}
    )
    values = rid.load(tmp_path / "odd.mat", fields={"values": "values", "omega": "omega"}, dt=0.1).values
    np.testing.assert_array_equal(values.ravel(), [1 + complex_part, 1])


def test_damaged_sparse_matrices_are_refused_in_a_sentence(tmp_path):
    numbers = {"A": scipy.sparse.diags([0.5, 0.25, 0.1]).tocsc(), "B": np.ones((3, 1)), "C": np.ones((1, 3)), "dt": 0.1}
    scipy.io.savemat(tmp_path / "sparse.mat", numbers)
    rng, raw = np.random.default_rng(0), (tmp_path / "sparse.mat").read_bytes()
    refused = 0
    for _ in range(300):
        bytes_ = bytearray(raw)
        for place in rng.integers(128, len(raw), rng.integers(1, 4)):
            bytes_[place] = rng.integers(256)
        (tmp_path / "damaged.mat").write_bytes(bytes_)
        try:
            rid.load(tmp_path / "damaged.mat")
        except (rid.errors.FileFormatError, rid.InputError):
            refused += 1
    assert refused > 100


@pytest.mark.parametrize("suffix", ["", ".npz", ".json"])
def test_a_result_is_opened_by_any_of_its_names(result, suffix, tmp_path):
    rid.save(tmp_path / "result", result)
    again = rid.load(tmp_path / f"result{suffix}")
    assert again.margin == result.margin
    assert again.verification.passed


def test_a_result_without_its_text_is_still_known_as_one(result, tmp_path):
    result.save(tmp_path / "result")
    (tmp_path / "result.json").write_text('{"format": ')
    for name in ("result", "result.npz"):
        with pytest.raises(rid.errors.FileFormatError, match="not a saved result"):
            rid.load(tmp_path / name)
    (tmp_path / "result.json").unlink()
    with pytest.raises(
        rid.errors.FileFormatError, match=r"result\.json is missing; a saved result is a \.npz and a \.json file"
    ):
        rid.load(tmp_path / "result.npz")


def test_arguments_about_measurements_are_refused_elsewhere(result, tmp_path):
    result.save(tmp_path / "result")
    with pytest.raises(rid.InputError, match=r"`bound` is about measurements, and .* is a saved result"):
        rid.load(tmp_path / "result", bound=0.1)
    rid.save(tmp_path / "play.csv", THINGS["play.csv"]())
    with pytest.raises(rid.InputError, match="`dt` is about measurements, and the file holds an excitation"):
        rid.load(tmp_path / "play.csv", dt=0.1)
    rid.save(tmp_path / "model.npz", model())
    with pytest.raises(rid.InputError, match="`initial` is about measurements, and the file holds a model"):
        rid.load(tmp_path / "model.npz", initial="rest")
    with pytest.raises(rid.InputError, match='`kind` must be "frequency", "time", "model" or None'):
        rid.load(tmp_path / "model.npz", kind="plant")


def test_what_is_nothing_of_ours_is_refused_by_name(tmp_path):
    with pytest.raises(
        rid.errors.InputTypeError, match=r"`thing` must be one of .*WorstCaseError.* or a control\.StateSpace; got dict"
    ):
        rid.save(tmp_path / "x", {})
    with pytest.raises(rid.InputError, match="there is no such file"):
        rid.load(tmp_path / "nothing")
    assert not list(tmp_path.iterdir())


def test_a_stranger_s_text_beside_data_does_no_harm(tmp_path):
    rid.save(tmp_path / "plain.npz", THINGS["record.npz"]())
    for text in ('{"format": "another 1"}', "[" * 100_000, '{"format": "robustid"}', "not JSON"):
        (tmp_path / "plain.json").write_text(text)
        assert rid.load(tmp_path / "plain.npz").y.shape == (2, 1)
    (tmp_path / "plain.json").write_text('{"format": "robustid identification 2"}')
    with pytest.raises(rid.errors.FileFormatError, match="their format is 'robustid identification 2'"):
        rid.load(tmp_path / "plain.npz")

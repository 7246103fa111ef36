"""State-space models in files: they come back as they were, and what is no model is refused in our own words."""

import control
import numpy as np
import pytest
import scipy.io

from robustid.data.io import load_model, save_model
from robustid.errors import FileFormatError

pytestmark = pytest.mark.quick


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

"""State-space models in files of others, and what is no model, which is refused in our own words."""

import control
import numpy as np
import pytest
import scipy.io
import scipy.signal

import robustid as rid
from robustid.errors import FileFormatError
from robustid.formats import load_model, save_model
from robustid.formats.model_files import of_polynomials, of_roots
from support.foreign_files import matlab5
from support.matlab_files import write73

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


POLES = np.array([-0.5 + 40j, -0.5 - 40j, -2.0, -0.1 + 90j, -0.1 - 90j, -7.0, -11.0])
ZEROS = np.array([-0.2 + 60j, -0.2 - 60j, -5.0])


def matlab_structure(form, dt=None):
    """The fields that a user stores of a MATLAB model."""
    fields = {
        "zpk": {"z": ZEROS[:, None], "p": POLES[:, None], "k": 3.0},
        "zpk, capitals": {"Z": ZEROS[:, None], "P": POLES[:, None], "K": 3.0},
        "tf": {"num": 3 * np.poly(ZEROS).real, "den": np.poly(POLES).real},
        "tf, long names": {"Numerator": 3 * np.poly(ZEROS).real, "Denominator": np.poly(POLES).real},
        "ss": dict(zip("abcd", scipy.signal.zpk2ss(ZEROS, POLES, 3.0), strict=True)),
    }[form]
    return fields | ({} if dt is None else {"Ts": dt})


@pytest.mark.parametrize("form", ["zpk", "zpk, capitals", "tf", "tf, long names", "ss"])
@pytest.mark.parametrize("version", ["v5", "v7.3", "top level"])
def test_models_of_matlab_as_plain_numbers(tmp_path, form, version):
    path, fields = tmp_path / "g.mat", matlab_structure(form)
    if version == "v7.3":
        write73(path, fields)
    else:
        matlab5(path, fields if version == "top level" else {"G": fields})
    model = rid.load(path)
    s = 1j * np.array([0.3, 30.0, 39.9, 60.1, 90.0, 400.0])
    expected = 3 * np.prod(s[:, None] - ZEROS, axis=1) / np.prod(s[:, None] - POLES, axis=1)
    np.testing.assert_allclose(model(s), expected, rtol=1e-8 if form != "zpk" else 1e-12)
    assert (model.nstates, model.dt) == (7, 0)


def test_a_cascade_keeps_many_light_modes():
    """The polynomial of 30 modes has coefficients up to 1e150: its roots are lost, those of the sections are not."""
    rng = np.random.default_rng(2)
    upper = np.exp(rng.uniform(0, 7, 30)) * np.exp(1j * (np.pi / 2 + rng.uniform(1e-4, 1e-2, 30)))
    poles = np.concatenate([upper, upper.conj()])
    zeros = np.concatenate([1.1 * upper[:-1], 1.1 * upper[:-1].conj(), [-3.0]])
    model = of_roots(zeros, poles, 2.0).model(0)
    s = 1j * np.abs(upper)
    expected = 2 * np.prod(s[:, None] - zeros, axis=1) / np.prod(s[:, None] - poles, axis=1)
    np.testing.assert_allclose(model(s), expected, rtol=1e-9)


def test_polynomials_do_not_depend_on_units():
    model, small = (
        of_polynomials(np.array([scale, 3 * scale]), np.array([2.0, 3.0, 4.0])).model(0) for scale in (1.0, 2.0**-70)
    )
    np.testing.assert_array_equal(small.C, model.C * 2.0**-70)
    np.testing.assert_allclose(model(2j), (2j + 3) / (2 * (2j) ** 2 + 3 * 2j + 4), rtol=1e-14)
    gain = of_polynomials(np.array([6.0]), np.array([2.0])).model(0.1)
    assert (gain.nstates, gain.D.item(), gain.dt) == (0, 3.0, 0.1)


def test_discrete_models_have_their_sample_time(tmp_path):
    fields = {"z": np.zeros((0, 1)), "p": [[0.5]], "k": 2.0, "Ts": 0.1, "TimeUnit": "seconds"}
    model = rid.load(matlab5(tmp_path / "g.mat", {"G": fields}))
    assert model.dt == 0.1
    np.testing.assert_allclose(model(1j), 2 / (1j - 0.5), rtol=1e-14)
    path = matlab5(tmp_path / "g.mat", {"num": [[2.0]], "den": [[1.0, -0.5]], "Ts": -1.0})
    with pytest.raises(FileFormatError, match="`dt` must be >= 0; got -1; give `dt`"):
        rid.load(path)
    assert rid.load(path, dt=0.1).dt == 0.1


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"p": [[-1 + 1j], [-2.0]]}, "the poles of a real model come in conjugate pairs; -1[+]1j is alone"),
        ({"z": [[-1.0], [-2.0], [-3.0]]}, "3 zeros and 2 poles; a model is proper"),
        ({"p": [[np.nan], [-2.0]]}, "`p` must be finite"),
        ({"InputDelay": 0.1}, "G.InputDelay isn't zero; call absorbDelay"),
        ({"TimeUnit": "hours"}, "TimeUnit is 'hours'; call chgTimeUnit"),
    ],
)
def test_structures_that_are_no_model(tmp_path, change, sentence):
    fields = {"z": [[-1.0]], "p": [[-1.0], [-2.0]], "k": 1.0}
    with pytest.raises(FileFormatError, match=sentence):
        rid.load(matlab5(tmp_path / "g.mat", {"G": fields | change}))


def test_two_models_in_a_file(tmp_path):
    fields = {"num": [[1.0]], "den": [[1.0, 2.0]]}
    path = matlab5(tmp_path / "g.mat", {"G": fields, "K": fields})
    with pytest.raises(FileFormatError, match=r"several models \('G', 'K'\); store one a file"):
        rid.load(path, kind="model")


SIGNALS = {"inputs": ["force [N]", "moment [N·m]"], "outputs": ["x [mm]"]}


@pytest.mark.parametrize("ending", [".npz", ".mat"])
def test_names_and_units_of_the_signals_are_kept(tmp_path, ending):
    model = control.ss(A, np.ones((1, 2)), C, np.zeros((1, 2)), 0.1, **SIGNALS)
    save_model(model, tmp_path / f"m{ending}")
    again = rid.load(tmp_path / f"m{ending}")
    assert (again.input_labels, again.output_labels) == (SIGNALS["inputs"], SIGNALS["outputs"])
    assert "from force [N], moment [N·m] to x [mm]" in rid.look(tmp_path / f"m{ending}").found.words()
    save_model(control.ss(A, B, C, 0.0, 0.1), tmp_path / f"n{ending}")
    nameless = rid.load(tmp_path / f"n{ending}")
    assert (nameless.input_labels, nameless.output_labels) == (["u[0]"], ["y[0]"])


def test_names_that_a_structure_of_matlab_states(tmp_path):
    fields = {"num": [[1.0]], "den": [[1.0, 2.0]], "InputName": cells("ref. current"), "InputUnit": cells("A")}
    scipy.io.savemat(tmp_path / "g.mat", {"G": fields | {"OutputName": cells("")}})
    model = rid.load(tmp_path / "g.mat")
    assert (model.input_labels, model.output_labels) == (["ref_ current [A]"], ["y[0]"])
    scipy.io.savemat(tmp_path / "h.mat", {"G": fields | {"InputName": cells("a", "b")}})  # more than the model has
    assert rid.load(tmp_path / "h.mat").input_labels == ["u[0]"]


def cells(*texts):
    return np.array(texts, dtype=object)

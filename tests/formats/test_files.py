"""Files: exact round trips, every supported layout against known arrays."""

import cmath
import dataclasses
import math
import os

import hypothesis.extra.numpy as arrays
import numpy as np
import pytest
import scipy.io
from hypothesis import example, given, settings
from hypothesis import strategies as st

import robustid as rid
from robustid import load
from robustid.core import atomic_write
from robustid.data import Fault, FaultKind, FrequencyResponse, save
from robustid.errors import InputError, InputTypeError
from support.bounds import rebound
from support.data_files import HZ, TIME, G, U, Y, full_frf, full_record
from support.matlab_files import write73
from support.mimo_data import KINDS, response, same

pytestmark = pytest.mark.quick


# --- what save writes


@pytest.mark.parametrize("suffix", [".npz", ".csv", ".mat"])
@pytest.mark.parametrize(
    "data",
    [
        full_frf(),
        full_record(),
        full_frf().entry(1, 2),
        *(response(6, joint, missing=missing) for joint, missing in KINDS),
        rebound(response(6), tilt=0.9j * np.ones((5, 3, 2))),
        dataclasses.replace(response(6), faults=(Fault(FaultKind.DISTURBED, "noisy", record=2, size=10.0),)),
        rebound(response(6), kind="tolerance", excitations=3, caveats=("smeared", "unsteady")),
    ],
)
def test_round_trip_is_exact(tmp_path, data, suffix):
    save(str(tmp_path / f"data{suffix}"), data)
    same(load(str(tmp_path / f"data{suffix}")), data)
    assert os.listdir(tmp_path) == [f"data{suffix}"]


@pytest.mark.parametrize("suffix", [".npz", ".csv", ".mat"])
def test_a_bound_of_the_user_s_takes_the_place_of_a_stored_one(tmp_path, suffix):
    save(tmp_path / f"data{suffix}", full_frf())
    again = load(tmp_path / f"data{suffix}", bound=0.5)
    assert (again.bound.kind, again.bound.probability, again.note) == ("hard", None, "")
    assert np.all(again.bound == 0.5)


@example(values=np.full(5, complex(-0.0, 1.0)), bound=1.0, suffix=".csv")
@example(values=np.full(5, complex(1.0, -0.0)), bound=1.0, suffix=".mat")
@settings(max_examples=40, deadline=None)
@given(
    values=arrays.arrays(complex, 5, elements=st.complex_numbers(allow_nan=False, allow_infinity=False)),
    bound=st.floats(5e-324, 1e308),
    suffix=st.sampled_from([".npz", ".csv", ".mat"]),
)
def test_round_trip_of_any_numbers(tmp_path_factory, values, bound, suffix):
    path = tmp_path_factory.mktemp("any") / f"data{suffix}"
    data = FrequencyResponse(np.arange(5) / 3, values, bound=bound, dt=0.1)
    save(path, data)
    same(load(path), data)


def test_saved_text_is_readable_without_its_description(tmp_path):
    data, path = full_record(), tmp_path / "data.csv"
    save(path, data)
    path.write_text("\n".join(path.read_text().splitlines()[1:]))
    again = load(path)
    np.testing.assert_array_equal(again.u, data.u)
    np.testing.assert_array_equal(again.y, data.y)
    np.testing.assert_array_equal(again.bound, data.bound)
    assert [c.name for c in again.outputs] == ["y1", "y2", "y3"]


def test_arguments_go_before_what_is_stored(tmp_path):
    path = tmp_path / "data.npz"
    save(path, full_record())
    again = load(path, bound=7.0, initial="rest", outputs=["p", "q", "r"])
    assert np.all(again.bound == 7)
    assert again.initial == "rest"
    assert again.outputs[2].name == "r"
    assert load(path).initial == "free"


def test_contents_decide_and_not_the_ending(tmp_path):
    save(tmp_path / "data.npz", full_frf())
    (tmp_path / "data.npz").rename(tmp_path / "data.bin")
    same(load(tmp_path / "data.bin", kind="frequency"), load(tmp_path / "data.bin"))
    with pytest.raises(InputError, match="`kind` = 'time', but the file holds frequency data"):
        load(tmp_path / "data.bin", kind="time")


@pytest.mark.parametrize(
    ("name", "sentence"), [("a.txt", r"must end in \.npz, \.csv, \.mat; got"), ("no/a.csv", "can't be written")]
)
def test_save_refuses_and_leaves_nothing(tmp_path, name, sentence):
    with pytest.raises(InputError, match=sentence):
        save(tmp_path / name, full_frf())
    with pytest.raises(InputTypeError, match=r"`thing` must be one of .*FrequencyResponse.*TimeRecord.*; got ndarray"):
        save(tmp_path / "a.csv", HZ)
    assert os.listdir(tmp_path) == []


def test_atomic_write_keeps_the_old_file_when_interrupted(tmp_path):
    target = tmp_path / "page.html"
    target.write_text("old")

    def interrupted():
        with atomic_write(target) as file:
            file.write("half of the n")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert target.read_text() == "old"
    with atomic_write(target, "wb") as file:
        file.write(b"new\n")
        assert target.read_text() == "old"
    assert target.read_bytes() == b"new\n"
    assert os.listdir(tmp_path) == ["page.html"]
    with pytest.raises(InputError, match="is a folder"), atomic_write(tmp_path):
        pass


@pytest.mark.skipif(os.name != "posix", reason="file permissions as on POSIX systems")
def test_atomic_write_gives_the_usual_permissions(tmp_path):
    (tmp_path / "plain").write_text("")
    with atomic_write(tmp_path / "atomic") as file:
        file.write("")
    assert (tmp_path / "atomic").stat().st_mode == (tmp_path / "plain").stat().st_mode


# --- text files of others


@pytest.mark.parametrize("mark", [",", ";", "\t", "  "])
def test_delimiters(tmp_path, mark):
    path = tmp_path / "data.txt"
    rows = [["Time", "U", "Y"], *([f"{t:.2f}", f"{k}", f"{-k}"] for k, t in enumerate(TIME))]
    path.write_text("# bench 3\n\n" + "\r\n".join(mark.join(row) for row in rows), encoding="utf-8-sig")
    record = load(path)
    assert record.dt == pytest.approx(0.01, rel=1e-12)
    assert record.u.ravel().tolist() == [0, 1, 2, 3, 4, 5]
    assert record.y.ravel().tolist() == [0, -1, -2, -3, -4, -5]
    assert record.initial == "rest"


FREQUENCY_TEXTS = {
    "omega,real,imag": lambda g: f"{2 * np.pi},{g.real!r},{g.imag!r}",
    "freq_hz,real,imag": lambda g: f"1,{g.real!r},{g.imag!r}",
    "freq_hz,magnitude,phase_deg": lambda g: f"1,{abs(g)!r},{math.degrees(cmath.phase(g))!r}",
    "freq_hz,magnitude,phase_rad": lambda g: f"1,{abs(g)!r},{cmath.phase(g)!r}",
    "freq_hz,magnitude_db,phase_deg": lambda g: f"1,{20 * math.log10(abs(g))!r},{math.degrees(cmath.phase(g))!r}",
    "Hz;values": lambda g: f"1;{g.real!r}+{g.imag!r}i",
}


@pytest.mark.parametrize("header", FREQUENCY_TEXTS)
def test_ways_to_write_a_frequency_response(tmp_path, header):
    path = tmp_path / "frf.csv"
    path.write_text(f"{header}\n{FREQUENCY_TEXTS[header](1.5 + 0.25j)}\n")
    frf = load(path, bound=0.1, dt=0.01, inputs=["force [N]"])
    assert frf.omega[0] == pytest.approx(2 * np.pi, rel=1e-15)
    np.testing.assert_allclose(frf.values, [[[1.5 + 0.25j]]], rtol=1e-14)
    assert (frf.dt, str(frf.inputs[0])) == (0.01, "force [N]")


def test_several_channels_from_named_columns(tmp_path):
    path = tmp_path / "data.csv"
    names = ["t [s]", "force [N]", "moment [Nm]", "x", "y", "z"]
    table = np.column_stack([TIME, U, Y])
    np.savetxt(path, table, fmt="%.17g", delimiter=",", header=",".join(names), comments="")
    record = load(path, fields={"time": "t [s]", "u": ["force [N]", "moment [Nm]"], "y": ["z", "x"]})
    np.testing.assert_array_equal(record.u, U)
    np.testing.assert_array_equal(record.y, Y[:, [2, 0]])
    assert record.inputs == (("force", "N"), ("moment", "Nm"))
    assert [c.name for c in record.outputs] == ["z", "x"]


def test_a_matrix_of_columns_is_rows_of_outputs(tmp_path):
    path = tmp_path / "frf.npz"
    np.savez(path, f=HZ, a=G[:, 0, 0], b=G[:, 0, 1], c=G[:, 1, 0], d=G[:, 1, 1])
    frf = load(path, fields={"omega": "f", "values": [["a", "b"], ["c", "d"]]}, frequency_unit="Hz")
    np.testing.assert_array_equal(frf.values, G[:, :, :2])
    np.testing.assert_array_equal(frf.freq_hz, HZ)


def test_text_in_columns_that_nobody_asks_for_is_no_obstacle(tmp_path):
    path = tmp_path / "data.csv"
    path.write_text("time,u,y,remark\n0,1,2,first\n0.5,1,2,second\n")
    assert load(path).dt == 0.5


# --- MATLAB


def write_matlab5(path, variables):
    structure = {name[5:]: value for name, value in variables.items() if name.startswith("data.")}
    others = {name: value for name, value in variables.items() if not name.startswith("data.")}
    scipy.io.savemat(path, {**others, "data": structure, "comment": "hello"}, appendmat=False)


def write_matlab73(path, variables):
    write73(path, variables | {"comment": "hello"}, "")


@pytest.mark.parametrize("write", [write_matlab5, write_matlab73], ids=["v5", "v7.3"])
def test_matlab_vectors_matrices_and_structures(tmp_path, write):
    path = tmp_path / "no_matter.dat"
    vectors = {"w": 2 * np.pi * HZ[None], "H": G[:, :1, 0], "t": TIME[:, None]}
    write(path, {**vectors, "G": G, "data.u": U, "data.y": Y})
    frf = load(path, fields={"omega": "w", "values": "H"}, bound=0.1)
    np.testing.assert_allclose(frf.freq_hz, HZ, rtol=1e-15)
    np.testing.assert_array_equal(frf.values[:, 0, 0], G[:, 0, 0])
    np.testing.assert_array_equal(load(path, fields={"omega": "w", "values": "G"}).values, G)
    record = load(path, fields={"u": "data.u", "y": "data.y"})
    np.testing.assert_array_equal(record.u, U)
    np.testing.assert_array_equal(record.y, Y)
    assert record.dt == pytest.approx(0.01)
    with pytest.raises(InputError, match=r"'data\.x' isn't in the file\. The file has .*data\.u \(6 x 2\), data\.y"):
        load(path, fields={"u": "data.x", "y": "data.y"}, dt=0.1)


def test_matlab_axis_order_is_refused_with_the_remedy(tmp_path):
    path = tmp_path / "frd.mat"
    scipy.io.savemat(path, {"omega": HZ, "values": np.moveaxis(G, 0, -1), "siso": G[:, 0, 0].reshape(1, 1, -1)})
    with pytest.raises(InputError, match=r"shape \(2, 3, 4\) with the frequency last.*permute\(G, \[3 1 2\]\)"):
        load(path)
    # one entry only: nothing to mistake
    siso = load(path, fields={"values": "siso"})
    np.testing.assert_array_equal(siso.values[:, 0, 0], G[:, 0, 0])


def test_time_rounded_in_the_file_is_uniform_enough(tmp_path):
    np.savez(tmp_path / "data.npz", t=np.round(1e4 + np.arange(500) / 3, 7), u=np.ones(500), y=np.ones(500))
    assert load(tmp_path / "data.npz").dt == pytest.approx(1 / 3, rel=1e-8)


@pytest.mark.parametrize("suffix", [".npz", ".csv", ".mat"])
def test_the_covariance_of_many_channels_is_stored_by_its_factors(tmp_path, suffix):
    """A Kronecker product of 8 x 2 entries, and one that is none; both come back."""
    rng = np.random.default_rng(0)
    root = rng.standard_normal((2, 3, 8, 8)) + 1j * rng.standard_normal((2, 3, 8, 8))
    R, C = (part @ part.conj().swapaxes(1, 2) for part in (root[0, :, :2, :2], root[1]))
    product = np.stack([np.kron(a, b) for a, b in zip(R, C, strict=True)])
    values = np.ones((3, 8, 2), complex)
    for covariance, stored in ((product, "covariance_outputs"), (product + np.eye(16), "covariance")):
        frf = rid.FrequencyResponse([1.0, 2.0, 3.0], values, covariance=covariance, dt=0.01)
        rid.save(tmp_path / f"frf{suffix}", frf)
        again = rid.load(tmp_path / f"frf{suffix}").covariance
        assert np.abs(again - covariance).max() <= 1e-13 * np.abs(covariance).max()
        if suffix == ".npz":
            assert stored in np.load(tmp_path / "frf.npz")

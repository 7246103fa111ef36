"""Columns and slices of arrays by their addresses, against NumPy's own indexing; and what is no address."""

import h5py
import numpy as np
import pytest
import scipy.io

from robustid import load
from robustid.errors import InputError
from robustid.formats import contents
from robustid.formats.addresses import Address, columns, parse, taken
from support.exchange_files import matrix
from support.exchange_files import write as write_universal
from support.refusals import refusals

X = np.arange(120.0).reshape(5, 4, 3, 2)


@pytest.mark.parametrize(
    "index",
    ["0", "-1", ":", "::2", "1:3", "-2:", "::-1", "...", "0,1,2,1", ":,0", ":,0:2,1,-1", "...,1", ":,...,0", " 1 , : ", "+1"],
)  # fmt: skip
def test_parts_are_those_of_numpy(index):
    address = parse(f"x.y [V][{index}]")
    assert address is not None
    assert address.name == "x.y [V]"
    np.testing.assert_array_equal(taken("x", address.parts, X), eval(f"X[{index}]"))


def test_texts_that_are_no_addresses():
    for part in (
        "",
        " [V]",
        "[V]",
        "[1/s]",
        "[a]",
        "[]",
        "[0,]",
        "[1:2:3:4]",
        "[1.5]",
        "[.]",
        "[0][V]",
        "[os]",
        "[--1]",
    ):
        assert parse(f"x{part}") is None, part


test_parts_that_are_not_there = refusals(
    ("9", r"there is no 9 on axis 0 of the shape \(5, 4, 3, 2\); indices count from 0 to 4"),
    (":,-5", "there is no -5 on axis 1"),
    ("0,0,0,0,0", "has 5 indices"),
    ("...,0,...", "has 3 indices"),
    ("3:3", "takes nothing from axis 0"),
    ("::0", "takes nothing from axis 0"),
    ("999999999999", "there is no 999999999999"),
    of=lambda index: taken("`fields['u']`", parse(f"[{index}]").parts, X),
)


def test_columns_of_a_slice():
    assert columns(parse("x[:,1:3]"), (9, 4)) == ["x[:,1]", "x[:,2]"]
    assert columns(parse("x[2:,0]"), (9, 4)) == ["x[2:,0]"]
    assert columns(Address("x", (0, ..., 1)), (9, 4, 2, 2)) == ["x[0,:,0,1]", "x[0,:,1,1]"]


def test_arrays_of_two_files_and_of_one_without_names(tmp_path):
    np.save(tmp_path / "u.npy", X)
    np.save(tmp_path / "y.npy", 2 * X)
    np.savez(tmp_path / "y.npz", **{"pos [m]": 3 * X[:, :, 0, 0]})
    record = load(tmp_path / "u.npy", fields={"u": "[:,0,0,0]", "y": "y.npy[:,1:3,0,0]"}, dt=0.5)
    np.testing.assert_array_equal(record.u[:, 0], X[:, 0, 0, 0])
    np.testing.assert_array_equal(record.y, 2 * X[:, 1:3, 0, 0])
    assert [signal.name for signal in (*record.inputs, *record.outputs)] == ["u[:,0,0,0]", "y[:,1,0,0]", "y[:,2,0,0]"]
    record = load(tmp_path / "u.npy", fields={"u": "[:,0,0,0]", "y": "y.npz:pos[:,3]"}, dt=0.5)
    np.testing.assert_array_equal(record.y[:, 0], 3 * X[:, 3, 0, 0])
    assert (record.outputs[0].name, record.outputs[0].unit) == ("pos[:,3]", "m")
    with pytest.raises(InputError, match=r"'y.npz:posi\[:,3\]' isn't in the file. The file has pos \[m\] \(5 x 4\)"):
        load(tmp_path / "u.npy", fields={"u": "[:,0,0,0]", "y": "y.npz:posi[:,3]"}, dt=0.5)
    with pytest.raises(InputError, match="there is no such file"):
        load(tmp_path / "u.npy", fields={"u": "[:,0,0,0]", "y": "z.npy[:,0]"}, dt=0.5)
    with pytest.raises(InputError, match=r'one array without a name \(5 x 4 x 3 x 2\), "\[:\]"'):
        load(tmp_path / "u.npy")


# --- addresses of what files hold


def found(path):
    return {item.address: (item.kind, item.shape) for item in contents(path).items}


def test_contents_of_every_format(tmp_path):
    columns = np.arange(10.0).reshape(5, 2)
    np.save(tmp_path / "a.npy", columns)
    assert contents(tmp_path / "a.npy").how == "NumPy array"
    assert found(tmp_path / "a.npy") == {"[:]": ("real", (5, 2))}
    np.save(tmp_path / "s.npy", np.zeros(4, [("t", float), ("z", complex)]))
    assert found(tmp_path / "s.npy") == {"t": ("real", (4,)), "z": ("complex", (4,))}
    np.savez(tmp_path / "a.npz", x=columns, label=np.array(["volt", "metre"]), none=np.zeros((0, 2)))
    assert found(tmp_path / "a.npz") == {"x": ("real", (5, 2)), "none": ("empty", (0, 2)), "label": ("text", ())}
    scipy.io.savemat(tmp_path / "a.mat", {"d": {"u": columns, "note": "rig 3"}, "z": np.array([[1j]])})
    assert found(tmp_path / "a.mat") == {"d.u": ("real", (5, 2)), "z": ("complex", (1, 1)), "d.note": ("text", ())}
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["g/u"] = columns
        file["g/u"].attrs["units"] = "V"
        file.attrs["fs"] = 100.0
    assert found(tmp_path / "a.h5") == {"fs": ("real", (1,)), "g.u [V]": ("real", (5, 2))}
    item = contents(tmp_path / "a.h5").items[1]
    assert (item.name, item.unit) == ("g.u", "V")
    np.testing.assert_array_equal(item.values, columns)
    (tmp_path / "a.csv").write_text("t,word\n0,zero\n1,one\n")
    assert found(tmp_path / "a.csv") == {"t": ("real", (2,)), "word": ("unreadable", ())}
    write_universal(tmp_path / "a.uff", matrix())
    assert found(tmp_path / "a.uff")["values"] == ("complex", (8, 2, 2))

"""Contents of files of every format: addresses that `fields` takes, shapes, kinds."""

import h5py
import numpy as np
import scipy.io

from robustid.formats import contents
from support.exchange_files import matrix
from support.exchange_files import write as write_universal


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

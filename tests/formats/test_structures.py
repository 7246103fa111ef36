"""Structures with the fields of MATLAB's idfrd, frd and iddata: axis order, units, sample time, names."""

import h5py
import numpy as np
import pytest
import scipy.io

from robustid import load
from robustid.data import TimeRecord, save
from robustid.errors import FileFormatError, InputError
from support.data_files import full_frf, full_record
from support.matlab_files import FRD, RNG, G, W, write5, write73

pytestmark = pytest.mark.quick
RECORD = {
    "OutputData": RNG.standard_normal((20, 2)),
    "InputData": RNG.standard_normal((20, 1)),
    "Ts": 0.5,
    "TimeUnit": "milliseconds",
    "Domain": "Time",
    "OutputName": np.array(["x", "y"], object)[:, None],
    "OutputUnit": np.array(["mm", "rad"], object)[:, None],
}
BOTH = pytest.mark.parametrize("write", [write5, write73], ids=["v5", "v7.3"])


@BOTH
@pytest.mark.parametrize("name", ["G", ""], ids=["structure", "top level"])
def test_a_frequency_response(tmp_path, write, name):
    write(tmp_path / "g.mat", FRD, name)
    frf = load(tmp_path / "g.mat")
    np.testing.assert_array_equal(frf.values, np.moveaxis(G, -1, 0))
    np.testing.assert_allclose(frf.freq_hz, W, rtol=1e-15)
    assert frf.dt == 0.01
    assert frf.inputs == (("force", "N"), ("moment", "Nm"), ("volt", "V"))
    assert frf.outputs == (("x", ""), ("y", ""))
    again = load(tmp_path / "g.mat", dt=0.02, bound=0.1, outputs=["p", "q"])
    assert (again.dt, again.outputs[1].name) == (0.02, "q")


@BOTH
def test_a_record(tmp_path, write):
    write(tmp_path / "z.mat", RECORD, "z")
    record = load(tmp_path / "z.mat", initial="periodic")
    assert isinstance(record, TimeRecord)
    np.testing.assert_array_equal(record.y, RECORD["OutputData"])
    np.testing.assert_array_equal(record.u, RECORD["InputData"])
    assert (record.dt, record.initial) == (0.0005, "periodic")
    assert record.outputs == (("x", "mm"), ("y", "rad"))


@pytest.mark.parametrize(
    ("unit", "time_unit", "scale"),
    [
        ("rad/TimeUnit", "seconds", 1.0),
        ("rad/TimeUnit", "milliseconds", 1e3),
        ("cycles/TimeUnit", "minutes", 2 * np.pi / 60),
        ("rad/s", "seconds", 1.0),
        ("kHz", "seconds", 2e3 * np.pi),
        ("rpm", "seconds", 2 * np.pi / 60),
    ],
)
def test_units_of_frequency(tmp_path, unit, time_unit, scale):
    write5(tmp_path / "g.mat", {**FRD, "Ts": 0.0, "FrequencyUnit": unit, "TimeUnit": time_unit})
    frf = load(tmp_path / "g.mat")
    np.testing.assert_allclose(frf.omega, W * scale, rtol=1e-15)
    assert frf.dt is None


def without(*names, **changes):
    return {**{name: value for name, value in FRD.items() if name not in names}, **changes}


@pytest.mark.parametrize(
    ("structure", "options", "sentence"),
    [
        (without("FrequencyUnit"), {}, "the unit of the frequencies isn't certain: G.FrequencyUnit isn't there"),
        (without("TimeUnit", FrequencyUnit="rad/TimeUnit"), {}, "is 'rad/TimeUnit' and TimeUnit isn't known"),
        (without(FrequencyUnit="furlong"), {}, "FrequencyUnit is 'furlong'"),
        (FRD, {"frequency_unit": "rad/s"}, "`frequency_unit` says rad/s, and G.FrequencyUnit says Hz"),
        (without(InputDelay=np.array([[0.0], [0.1], [0.0]])), {}, "`G.InputDelay` isn't zero; call absorbDelay"),
        (without(ResponseData=np.moveaxis(G, -1, 0)), {}, r"must have the shape \(ny, nu, F\).* got \(5, 2, 3\)"),
        (without(TimeUnit="fortnights"), {}, "TimeUnit = 'fortnights' is no unit of time"),
        ({**RECORD, "Domain": "Frequency"}, {}, "`G.Domain` is 'Frequency'"),
        ({**RECORD, "Ts": -1.0}, {}, "no 'time' found; give `dt`"),
    ],
)
def test_what_is_not_certain_is_refused(tmp_path, structure, options, sentence):
    write5(tmp_path / "g.mat", structure)
    with pytest.raises((InputError, FileFormatError), match=sentence):
        load(tmp_path / "g.mat", **options)


def test_a_stated_unit_where_the_structure_has_none(tmp_path):
    write5(tmp_path / "g.mat", without("FrequencyUnit"))
    np.testing.assert_allclose(load(tmp_path / "g.mat", frequency_unit="Hz").freq_hz, W)


def test_several_structures_are_refused_unless_the_kind_tells_them_apart(tmp_path):
    scipy.io.savemat(tmp_path / "g.mat", {"G": FRD, "H": FRD, "z": RECORD})
    with pytest.raises(InputError, match=r"several structures of measurements \('G', 'H', 'z'\); store one a file"):
        load(tmp_path / "g.mat")
    assert load(tmp_path / "g.mat", kind="time").dt == 0.0005


def test_covariance_of_real_and_imaginary_part_becomes_the_power_of_the_error(tmp_path):
    root = RNG.standard_normal((2, 3, 5, 2, 2))
    data = root @ root.swapaxes(-1, -2)
    write5(tmp_path / "g.mat", {**FRD, "CovarianceData": data})
    covariance = load(tmp_path / "g.mat").covariance
    assert covariance.shape == (5, 6, 6)
    for line, (i, j) in ((0, (1, 2)), (4, (0, 1))):
        # vec stacks columns: entry (i, j) is number i + ny j
        assert covariance[line, i + 2 * j, i + 2 * j] == pytest.approx(np.trace(data[i, j, line]))


def test_objects_say_how_to_export_them(tmp_path):
    with h5py.File(tmp_path / "g.mat", "w", userblock_size=512) as file:
        item = file.create_dataset("G", data=np.zeros((6, 1), np.uint32))
        item.attrs["MATLAB_class"] = np.bytes_("idfrd")
        item.attrs["MATLAB_object_decode"] = np.int32(3)
    sentence = (
        r"'G' is an object of the MATLAB class idfrd, .* s = struct\('ResponseData', G\.ResponseData, .*'-struct'"
    )
    with pytest.raises(FileFormatError, match=sentence):
        load(tmp_path / "g.mat")
    with h5py.File(tmp_path / "g.mat", "a") as file:
        file.create_dataset("K", data=np.zeros((2, 2))).attrs["MATLAB_class"] = np.bytes_("double")
    with pytest.raises(InputError, match=rf"The file has K \(2 x 2\). {sentence}"):
        load(tmp_path / "g.mat")


def element(kind, data):
    return np.array([kind, len(data)], np.uint32).tobytes() + data + bytes(-len(data) % 8)


def test_objects_in_v5_files_say_how_to_export_them(tmp_path):
    """A variable of the class mxOPAQUE (17): name, system and class as texts, then references."""
    flags = element(6, np.array([17, 0], np.uint32).tobytes())
    refs = element(14, element(6, np.array([13, 0], np.uint32).tobytes()) + element(5, np.array([2, 1], np.int32).tobytes())
                   + element(1, b"") + element(6, np.array([1, 2], np.uint32).tobytes()))  # fmt: skip
    body = flags + element(1, b"z") + element(1, b"MCOS") + element(1, b"iddata") + refs
    head = b"MATLAB 5.0 MAT-file".ljust(116) + bytes(8) + b"\x00\x01IM"
    (tmp_path / "z.mat").write_bytes(head + element(14, body))
    with pytest.raises(
        FileFormatError, match=r"'z' is an object of the MATLAB class iddata.*'OutputData', z\.OutputData"
    ):
        load(tmp_path / "z.mat")


@pytest.mark.parametrize("make", [full_frf, full_record])
def test_saved_files_are_pleasant_in_matlab(tmp_path, make):
    """Plain arrays and names; and readable without the description, as MATLAB may store them again."""
    data = make()
    save(tmp_path / "data.mat", data)
    content = scipy.io.loadmat(tmp_path / "data.mat")
    plain = {name: value for name, value in content.items() if not name.startswith("__") and name != "robustid"}
    first = "values" if "values" in plain else "y"
    np.testing.assert_array_equal(plain[first], getattr(data, first))
    assert plain["dt"].item() == data.dt
    assert [str(item.item()) for item in plain["inputs"].ravel()] == [str(channel) for channel in data.inputs]
    del plain["inputs"], plain["outputs"]
    scipy.io.savemat(tmp_path / "again.mat", plain)
    again = load(tmp_path / "again.mat")
    np.testing.assert_array_equal(getattr(again, first), getattr(data, first))
    np.testing.assert_array_equal(again.bound, data.bound)
    assert again.dt == data.dt

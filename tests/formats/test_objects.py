"""Tables in memory: dictionaries, arrays, pandas, objects with the interface of xarray, responses of python-control."""

import control
import numpy as np
import pytest

import robustid as rid
from robustid.errors import FileFormatError, InputError
from support.refusals import refused

pytestmark = pytest.mark.quick

U, Y = np.array([1.0, 2.0, 4.0]), np.array([[0.0, 3.0], [1.0, 4.0], [2.0, 5.0]])


def check(record, dt):
    np.testing.assert_array_equal(record.u[:, 0], U)
    np.testing.assert_array_equal(record.y, Y)
    assert record.dt == pytest.approx(dt, rel=1e-12)


def test_dictionaries_and_arrays():
    check(rid.load({"u": U, "y": Y, "dt": 0.5}), 0.5)
    check(rid.load({"u [V]": list(U), "y": Y}, rate=4.0), 0.25)
    table = np.column_stack([U, Y])
    check(rid.load(table, fields={"u": "[:,0]", "y": "[:,1:]"}, dt=0.5), 0.5)
    check(rid.load(table.astype([("a", float)]).view(float), fields={"u": "[:,0]", "y": "[:,1:]"}, dt=0.5), 0.5)
    refused(r'As a time record, .*fields=\{"u": "a", "y": "b"\}, dt=1\.0', rid.load, {"a": [1, 5, 2], "b": [1, 2, 3]})
    refused("dict holds no numeric arrays", rid.load, {"a": ["x", "y"]}, error=FileFormatError)
    refused("no table of arrays either", rid.load, object(), error=rid.errors.InputTypeError)


def test_pandas():
    pd = pytest.importorskip("pandas")
    frame = pd.DataFrame({"u [V]": U, "y1": Y[:, 0], "y2": Y[:, 1]})
    check(rid.load(frame, dt=0.5), 0.5)
    check(rid.load(frame.set_index(pd.Index([0, 0.5, 1.0], name="time"))), 0.5)
    check(rid.load(frame.set_index(pd.date_range("2026-01-01", periods=3, freq="10ms"))), 0.01)
    check(rid.load(frame.set_index(pd.to_timedelta([0, 20, 40], unit="ms"))), 0.02)
    frame.columns = pd.MultiIndex.from_tuples([("in", "u"), ("out", "a"), ("out", "b")])
    check(rid.load(frame, fields={"u": "in u", "y": ["out a", "out b"]}, dt=0.5), 0.5)
    with pytest.raises(InputError, match=r"'y' has no value in 1 of 3 samples"):
        rid.load(pd.DataFrame({"u": U, "y": pd.array([1, None, 2], dtype="Int64")}).astype({"y": "Float64"}), dt=0.5)
    record = rid.TimeRecord(pd.DataFrame({"force [N]": U}), pd.DataFrame(Y, columns=["a", "b"]), dt=0.5)
    assert [str(signal) for signal in (*record.inputs, *record.outputs)] == ["force [N]", "a", "b"]


class DataArray:
    """The interface of xarray's."""

    def __init__(self, values, dims, coords=None, units=None, name=None):
        self._values, self.dims, self.coords, self.name = np.asarray(values), dims, coords or {}, name
        self.attrs = {"units": units} if units else {}

    def __array__(self, dtype=None, copy=None):
        return self._values


class Dataset:
    def __init__(self, variables, coords, attrs):
        self.data_vars, self.coords, self.attrs = variables, coords, attrs
        self.dims = ("time",)


def test_labelled_arrays():
    time = DataArray([0, 500, 1000], ("time",), units="ms")
    data = Dataset(
        {"u": DataArray(U, ("time",), units="N"), "y": DataArray(Y, ("time", "signal"))}, {"time": time}, {"rig": 3}
    )
    record = rid.load(data)
    check(record, 0.5)
    assert str(record.inputs[0]) == "u [N]"
    hz = DataArray([1.0, 2.0], ("frequency",), units="Hz")
    G = np.array([[1 + 1j, 2], [3, 4j], [5, 6]])
    array = DataArray(G, ("output", "frequency"), {"frequency": hz}, name="G")
    frf = rid.load(array, fields={"values": "G"}, axes="output,frequency")
    np.testing.assert_array_equal(frf.values[:, :, 0], G.T)
    np.testing.assert_allclose(frf.freq_hz, [1, 2], rtol=1e-15)


def test_responses_of_control():
    G = np.arange(6).reshape(2, 1, 3) + 1j
    frd = control.frd(G, [1.0, 2.0, 3.0], dt=0.1, inputs="F", outputs=["a", "b"])
    for frf in (rid.FrequencyResponse(frd, bound=0.1), rid.load(frd, bound=0.1)):
        np.testing.assert_array_equal(frf.values, np.moveaxis(G, -1, 0))
        np.testing.assert_array_equal(frf.omega, [1, 2, 3])
        assert (frf.dt, frf.bound.max(), [str(signal) for signal in frf.outputs]) == (0.1, 0.1, ["a", "b"])
    refused(r"`values` is missing: give frequencies and values, or a control\.FRD", rid.FrequencyResponse, [1.0, 2.0])
    refused(r"`frequency_unit` isn't needed: a control\.FRD says this itself", rid.load, frd, frequency_unit="Hz")

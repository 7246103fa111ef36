"""Objects of MATLAB classes in v5 files: responses and models are read, of others their class is said."""

import control
import numpy as np
import pytest

import robustid as rid
from robustid import load
from robustid.errors import FileFormatError, InputError
from support.matlab_files import G, W
from support.matlab_objects import MAGIC, Thing, write_objects

pytestmark = pytest.mark.quick
DELAY = {"Input": np.zeros((3, 1)), "Output": np.zeros((2, 1)), "IO": np.zeros((2, 3))}
DATA = {"Response": G, "Frequency": W[:, None], "FreqUnits": "Hz", "Ts": 0.01, "Delay": DELAY}
NAMES = {"InputName_": ["force", "moment", "volt"], "OutputName_": ["x", "y"]}


def frd(kind="frd", **changes):
    data = {name: value for name, value in (DATA | changes).items() if value is not None}
    return Thing(kind, {"Data_": Thing("ltipack.frddata", data), "IOSize_": np.array([[2.0, 3.0]]), **NAMES})


def tf(num, den, ts=0.0):
    return Thing("tf", {"Data_": Thing("ltipack.tfdata", {"num": [np.array(num)], "den": [np.array(den)], "Ts": ts})})


@pytest.mark.parametrize("kind", ["frd", "idfrd"])
def test_a_frequency_response(tmp_path, kind):
    path = write_objects(tmp_path / "g.mat", {"G": frd(kind), "note": "bench 3"})
    frf = load(path)
    np.testing.assert_array_equal(frf.values, np.moveaxis(G, -1, 0))
    np.testing.assert_allclose(frf.freq_hz, W, rtol=1e-15)
    assert frf.dt == 0.01
    assert [[str(signal) for signal in side] for side in (frf.inputs, frf.outputs)] == [
        ["force", "moment", "volt"],
        ["x", "y"],
    ]
    found = rid.look(path)
    assert (found.kind, found.refusal) == ("frequency", "")


def test_a_unit_that_is_not_stored_is_the_default_of_the_class(tmp_path):
    frf = load(write_objects(tmp_path / "g.mat", {"G": frd(FreqUnits=None, Ts=0.0)}))
    np.testing.assert_allclose(frf.omega, W, rtol=1e-15)
    assert frf.dt is None


def test_a_delay_is_refused_as_of_a_structure(tmp_path):
    path = write_objects(tmp_path / "g.mat", {"G": frd(Delay=DELAY | {"Input": np.ones((3, 1))})})
    with pytest.raises(InputError, match=r"`G\.InputDelay` isn't zero; call absorbDelay"):
        load(path)


def test_models(tmp_path):
    model = load(write_objects(tmp_path / "p.mat", {"P": tf([[0.0, 1.0]], [[1.0, 2.0]])}))
    assert isinstance(model, control.StateSpace)
    assert model(1j) == pytest.approx(1 / (2 + 1j))
    zpk = {"z": [np.zeros((0, 1))], "p": [np.array([[-1.0]])], "k": np.array([[3.0]]), "Ts": 0.0}
    model = load(write_objects(tmp_path / "z.mat", {"P": Thing("zpk", {"Data_": Thing("ltipack.zpkdata", zpk)})}))
    assert model(0) == pytest.approx(3)
    several = write_objects(tmp_path / "c.mat", {"C": [tf([[1.0]], [[1.0, 2.0]]), tf([[1.0]], [[1.0, 3.0]])]})
    with pytest.raises(FileFormatError, match=r"holds several models \('C\{1\}', 'C\{2\}'\); store one a file"):
        load(several)


def test_what_cannot_be_read_is_said_with_the_way_out(tmp_path):
    path = write_objects(tmp_path / "t.mat", {"T": Thing("table", {"data": [np.eye(2)]}), "x": np.eye(2)})
    assert any(row[:2] == ("T", "object") for row in rid.look(path).rows)
    with pytest.raises(InputError, match="'T' is an object of the MATLAB class table, which only MATLAB can read"):
        load(path)


def test_references_that_go_round_or_nowhere_leave_the_object_unread(tmp_path):
    path = write_objects(tmp_path / "g.mat", {"G": frd(), "x": np.eye(2)})
    content = path.read_bytes()
    word = np.array([MAGIC, 2, 1, 1], "<u4").tobytes()
    assert content.count(word) == 2
    for number in (1, 2, 77):  # the first object for both: it refers to itself
        path.write_bytes(
            b"".join(
                [part if k == 0 else word + bytes([number]) + part[1:] for k, part in enumerate(content.split(word))]
            )
        )
        if number == 2:
            assert load(path).dt == 0.01
            continue
        with pytest.raises(InputError, match=r"The file has x .*'G' is an object of the MATLAB class frd, which only"):
            load(path)

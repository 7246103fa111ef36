"""Universal files that make no matrix or record, written from the description of the format: a table of contents with addresses."""

import re

import numpy as np
import pytest

from robustid import load
from robustid.errors import FileFormatError, InputError
from support.foreign_files import Function, uff58

pytest.importorskip("pyuff")
pytestmark = pytest.mark.quick

RNG = np.random.default_rng(7)
G = RNG.standard_normal((3, 9)) + 1j * RNG.standard_normal((3, 9))
HZ = 2.0 + 0.5 * np.arange(9)
Y = RNG.standard_normal((2, 20))


@pytest.mark.parametrize(("binary", "double", "rtol"), [(0, 1, 1e-10), (1, 1, 0), (0, 0, 1e-5), (1, 0, 1e-7)])
def test_a_column_of_responses(tmp_path, binary, double, rtol):
    functions = [Function(4, (node, 3), (1, 3), 2.0, 0.5, G[k], double=bool(double)) for k, node in enumerate((1, 2))]
    frf = load(uff58(tmp_path / "frf.uff", functions, binary=bool(binary)))
    np.testing.assert_allclose(frf.values[:, :, 0].T, G[:2], rtol=rtol, atol=rtol)
    np.testing.assert_allclose(frf.freq_hz, HZ, rtol=1e-12)
    assert [signal.name for signal in frf.outputs] == ["1Z+", "2Z+"]


@pytest.mark.parametrize("binary", [False, True])
@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"reference": (2, 3)}, "are missing; store a full matrix"),
        ({"response": (1, 3)}, r"the function 1Z\+ / 1Z\+ is there twice"),
        ({"step": 0.25}, r"2Z\+ / 1Z\+ has another axis than the function 1Z\+ / 1Z\+"),
    ],
)
def test_functions_that_make_no_matrix_are_listed_and_taken_by_number(tmp_path, binary, change, sentence):
    functions = [
        Function(4, (1, 3), (1, 3), 2.0, 0.5, G[0]),
        Function(4, (2, 3), (1, 3), 2.0, 0.5, G[1])._replace(**change),
    ]
    path = uff58(tmp_path / "frf.uff", functions, binary=binary)
    with pytest.raises(
        FileFormatError, match=f"{sentence}.*The file has 1: frequency response 1Z\\+ / 1Z\\+, 9 points"
    ) as said:
        load(path)
    fields = re.search(r'fields=\{"freq_hz": "(.*?)", "values": "(.*?)"\}', str(said.value))
    frf = load(path, fields={"freq_hz": fields[1], "values": fields[2]})
    np.testing.assert_allclose(frf.values[:, 0, 0], G[0], rtol=1e-10)
    second = load(path, fields={"freq_hz": "2.x", "values": "2.y"})
    np.testing.assert_allclose(second.values[:, 0, 0], G[1], rtol=1e-10)
    np.testing.assert_allclose(second.freq_hz, 2.0 + change.get("step", 0.5) * np.arange(9), rtol=1e-12)


def test_one_signal_needs_the_other_file(tmp_path):
    path = uff58(tmp_path / "answer.uff", [Function(1, (5, 1), (0, 0), 0.0, 0.25, Y[0])])
    uff58(tmp_path / "force.uff", [Function(1, (5, 1), (0, 0), 0.0, 0.25, Y[1], quantity=13)])
    with pytest.raises(
        InputError, match=r'The file has 5X\+ \(acceleration m/s\^2\), time\. .*"u": "OTHER\.uff:NAME", "y": "5X\+"'
    ):
        load(path)
    record = load(path, fields={"time": "time", "u": "force.uff:5X+", "y": "5X+"})
    np.testing.assert_allclose(record.y[:, 0], Y[0], rtol=1e-10)
    np.testing.assert_allclose(record.u[:, 0], Y[1], rtol=1e-10)
    assert record.dt == 0.25


def test_several_records_of_one_place(tmp_path):
    path = uff58(tmp_path / "runs.uff", [Function(1, (5, 1), (0, 0), 0.0, 0.25, y) for y in Y])
    with pytest.raises(
        FileFormatError, match=r'not all different.*"u": "1\.y", "y": "2\.y".*2: time response 5X\+ / 0, 20 points'
    ):
        load(path)
    record = load(path, fields={"time": "1.x", "u": "1.y", "y": "2.y"})
    np.testing.assert_allclose(record.y[:, 0], Y[1], rtol=1e-10)

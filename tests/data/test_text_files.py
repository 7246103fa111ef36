"""Tables of text as instruments, spreadsheets and programs write them: numbers compared, or the sentence that leads on."""

import numpy as np
import pytest

from robustid import load
from robustid.errors import FileFormatError, InputError
from robustid.formats import contents

pytestmark = pytest.mark.quick

TEXTS = {
    "semicolons": ("Zeit;Kraft;Weg\n[s];[N];[mm]\n0,0;1,5;2,25\n0,1;1,5;2,5\n", ["Zeit [s]", "Kraft [N]", "Weg [mm]"]),
    "no names": ("0.0 1.5 2.25\n0.1 1.5 2.5\n", ["[:,0]", "[:,1]", "[:,2]"]),
    "remark": ("# rig 3\n# t [s],u,y\n0,1.5,2.25\n# pause\n0.1,1.5,2.5\n", ["t [s]", "u", "y"]),
    "numpy": ("# time u y\n0.0 1.5 2.25\n1e-1 1.5 2.5\n", ["time", "u", "y"]),
    "two rows": ("Ch 1,,Ch 2\nRe,Im,Re\n0,1.5,2.25\n.1,1.5,2.5\n", ["Ch 1 Re", "Ch 1 Im", "Ch 2 Re"]),
    "preamble": ("Points,2\nDate: today, noon\n\nt,u [V],y\n0,1.5,2.25\n0.1,1.5,2.5\n", ["t", "u [V]", "y"]),
    "row of units": ("t,u,y\ns,V,m/s^2\n0,1.5,2.25\n0.1,1.5,2.5\n", ["t [s]", "u [V]", "y [m/s^2]"]),
    "fortran": ("0.0D+00  1.5D+00 2.25d0\n1.0D-01 1.5D0 2.5D0\n", ["[:,0]", "[:,1]", "[:,2]"]),
    "decimal commas and spaces": ("0 1,5 2,25\n0,1 1,5 2,5\n", ["[:,0]", "[:,1]", "[:,2]"]),
    "separator at the end": ("t;u;y;\n0;1.5;2.25;\n0.1;1.5;2.5;\n", ["t", "u", "y"]),
    "quoted": ('"t (s)","u, raw",y\n"0,0","1,5","2,25"\n"0,1","1,5","2,5"\n', ["t (s)", "u, raw", "y"]),
    "tabs": ("Time\tDrive force (N)\ty\n0.0\t1.5\t2.25\n0.1\t1.5\t2.5\n", ["Time", "Drive force (N)", "y"]),
    "titles with spaces": ("Time (s)   Drive force (N)  y\n0.0 1.5 2.25\n0.1 1.5 2.5\n", ["Time (s)", "Drive force (N)", "y"]),
    "bars": ("t|u|y\n0|1.5|2.25\n0.1|1.5|2.5\n", ["t", "u", "y"]),
    "equal names": ("t,u,u\n0,1.5,2.25\n0.1,1.5,2.5\n", ["[:,0]", "[:,1]", "[:,2]"]),
    "currents": ("i,j,k\n0,1.5,2.25\n0.1,1.5,2.5\n", ["i", "j", "k"]),
}  # fmt: skip


@pytest.mark.parametrize("name", TEXTS)
def test_layouts(tmp_path, name):
    text, titles = TEXTS[name]
    path = tmp_path / "data.asc"
    path.write_text(text)
    found = contents(path)
    assert [item.address for item in found.items] == titles
    np.testing.assert_array_equal(
        np.column_stack([item.values for item in found.items]), [[0, 1.5, 2.25], [0.1, 1.5, 2.5]]
    )
    record = load(path, fields={"time": "[:,0]", "u": "[:,1]", "y": "[:,2]"})
    np.testing.assert_array_equal(record.y[:, 0], [2.25, 2.5])
    assert record.dt == 0.1


def test_the_layout_is_said(tmp_path):
    path = tmp_path / "data.txt"
    path.write_text("rig 3\nt;u\ns;V\n0,5;1\n0,6;2\n")
    assert contents(path).how == (
        "text, 2 columns separated by semicolons with decimal commas, names in line 2 and units in line 3, numbers from line 4 on"
    )


def test_complex_numbers(tmp_path):
    (tmp_path / "a.csv").write_text("omega,g\n1,1+2i\n2,(0.5 - 2.0e-1j)\n3,i2\n".replace("i2", "-3i"))
    np.testing.assert_array_equal(load(tmp_path / "a.csv").values[:, 0, 0], [1 + 2j, 0.5 - 0.2j, -3j])
    (tmp_path / "b.csv").write_text("omega;g\n1;1,5+2,5i\n2;-1,5-2,5e-1i\n")
    np.testing.assert_array_equal(load(tmp_path / "b.csv").values[:, 0, 0], [1.5 + 2.5j, -1.5 - 0.25j])
    np.savetxt(tmp_path / "c.txt", np.column_stack([[1, 2], [1 + 2j, 3 - 4j]]))
    frf = load(tmp_path / "c.txt", fields={"values": "[:,1]"}, start=1, step=1, frequency_unit="rad/s")
    np.testing.assert_array_equal(frf.values[:, 0, 0], [1 + 2j, 3 - 4j])


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "latin-1"])
def test_encodings(tmp_path, encoding):
    (tmp_path / "data.csv").write_bytes("t [s],µ [°]\n0,1\n0.5,2\n".encode(encoding))
    assert [item.address for item in contents(tmp_path / "data.csv").items] == ["t [s]", "µ [°]"]


def test_a_comma_between_two_numbers_or_in_one(tmp_path):
    path = tmp_path / "data.csv"
    path.write_text("0,5\n0,6\n")
    with pytest.raises(
        FileFormatError, match=r"'0,5' can be two numbers.*give `decimal=\"\.\"` for two or `decimal=\",\"` for one"
    ):
        load(path)
    record = load(path, decimal=".", fields={"u": "[:,0]", "y": "[:,1]"}, rate=4.0)
    np.testing.assert_array_equal(record.y[:, 0], [5, 6])
    assert record.dt == 0.25
    record = load(path, decimal=",", fields={"u": "[:,0]", "y": "[:,0]"}, dt=0.5)
    np.testing.assert_array_equal(record.y[:, 0], [0.5, 0.6])
    path.write_text("u\n0,5\n0,6\n")
    np.testing.assert_array_equal(contents(path).items[0].values, [0.5, 0.6])


def test_marks_for_thousands_are_refused(tmp_path):
    (tmp_path / "data.csv").write_text("t;u\n0,0;1.000,5\n0,1;1.001,5\n")
    with pytest.raises(FileFormatError, match=r"'1\.000,5' has marks for thousands; export the numbers without them"):
        load(tmp_path / "data.csv")


def test_decimal_commas_after_many_whole_numbers(tmp_path):
    (tmp_path / "step.csv").write_text("t;u;y\n" + "".join(f"{k};0;0\n" for k in range(600)) + "600;1,5;2\n")
    with pytest.raises(FileFormatError, match=r"line 602, column 'u': '1,5' is not a number.*give `decimal=\",\"`"):
        load(tmp_path / "step.csv")
    assert load(tmp_path / "step.csv", decimal=",").u[-1, 0] == 1.5


def test_frequencies_by_start_and_step(tmp_path):
    path = tmp_path / "frf.txt"
    path.write_text("Re Im\n1 2\n3 4\n5 6\n")
    np.testing.assert_allclose(load(path, start=10, step=0.5, frequency_unit="Hz").freq_hz, [10, 10.5, 11], rtol=1e-15)
    np.testing.assert_array_equal(load(path, start=10, step=0.5, frequency_unit="rad/s").omega, [10, 10.5, 11])
    for options, sentence in (
        ({"start": 1}, "belong together"),
        ({"start": 1, "step": 1}, "need their unit: give `frequency_unit`"),
        ({"start": 1, "step": 0, "frequency_unit": "Hz"}, "`step` must be positive"),
        ({"start": 1, "step": 1, "frequency_unit": "Hz", "fields": {"omega": "Re"}}, "give one axis"),
    ):
        with pytest.raises(InputError, match=sentence):
            load(path, **options)

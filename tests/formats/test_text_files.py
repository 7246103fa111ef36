"""Tables of text as instruments, spreadsheets and programs write them: numbers compared, or the sentence that leads on."""

import json

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


def of_day(seconds):
    seconds %= 86400
    return f"{int(seconds // 3600):02d}:{int(seconds // 60) % 60:02d}:{seconds % 60:06.3f}"


def half_days(seconds):
    hours, rest = divmod(int(seconds) % 86400, 3600)
    return f"{(hours - 1) % 12 + 1}:{rest // 60:02d}:{rest % 60:02d} {'AM' if hours < 12 else 'PM'}"


@pytest.mark.parametrize("start", [0.0, 43180.0, 86395.0])  # midnight, noon, and over midnight
@pytest.mark.parametrize(
    ("head", "line", "step", "clock"),
    [
        ("time,u,y", "2026-11-30 {},{},{}", 0.125, of_day),
        ("Timestamp;u;y", "30.11.2026 {};{},0;{},5", 0.125, lambda seconds: of_day(seconds).replace(".", ",")),
        ("Zeit;u;y", "{};{},0;{},5", 0.125, of_day),
        ("time\tu\ty", "2026-11-30T{}Z\t{}\t{}", 0.125, of_day),
        ("Date/Time,u,y", "11/30/2026 {},{},{}", 1.0, half_days),
        ("Date,time,u,y", "2026-11-30,{},{},{}", 0.125, of_day),
    ],
)
def test_times_of_day_are_seconds(tmp_path, head, line, step, clock, start):
    rows = [line.format(clock(start + step * k), k % 7, k % 5) for k in range(80)]
    (tmp_path / "log.csv").write_text("\n".join([head, *rows]))
    record = load(tmp_path / "log.csv")
    assert record.dt == pytest.approx(step, rel=1e-9)
    np.testing.assert_array_equal(record.u[:, 0], np.arange(80) % 7)
    assert "times of day as seconds" in contents(tmp_path / "log.csv").how


def test_no_part_of_another_number_is_a_time_of_day(tmp_path):
    (tmp_path / "data.csv").write_text("time,u,y\n" + "".join(f"{k},{k % 3},12.5\n" for k in range(9)) + "9,1:2:3,4\n")
    with pytest.raises(FileFormatError, match="'1:2:3' is not a number"):
        load(tmp_path / "data.csv")


@pytest.mark.parametrize("suffix", [".csv", ".npz"])
def test_of_a_record_with_gaps_the_longest_part_is_told(tmp_path, suffix):
    path, values = tmp_path / f"gap{suffix}", np.random.default_rng(0).standard_normal((2, 400))
    columns = {"t": np.arange(400) * 1e-3, "u": values[0], "y": values[1]}
    columns["y"][[30, 40]] = columns["u"][390] = np.nan
    if suffix == ".csv":
        np.savetxt(path, np.column_stack(list(columns.values())), delimiter=",", header=",".join(columns), comments="")
    else:
        np.savez(path, **columns)
    with pytest.raises(InputError, match=r"no value in 1 of 400 .* without a gap are the samples 41 to 389") as refused:
        load(path)
    record = load(path, **refused.value.remedy)
    np.testing.assert_array_equal(record.y[:, 0], columns["y"][41:390])


def test_beside_a_time_a_column_that_does_not_rise_is_no_frequency(tmp_path):
    u, y = np.random.default_rng(0).standard_normal((2, 60))
    path = tmp_path / "rig.txt"
    np.savetxt(path, np.c_[np.arange(60) * 1e-3, u, y], header="t\tF\tx", delimiter="\t", comments="")
    with pytest.raises(InputError, match="no 'u' found") as refused:
        load(path)
    assert refused.value.remedy == {"fields": {"time": "t", "u": "F", "y": "x"}}


def test_a_json_object_holds_its_lists_by_name(tmp_path):
    values = np.random.default_rng(0).standard_normal((2, 60))
    path = tmp_path / "rig.json"
    path.write_text(json.dumps({"u": values[0].tolist(), "y": values[1].tolist(), "Ts": 0.125, "note": "bench"}))
    record = load(path)
    assert record.dt == 0.125
    np.testing.assert_array_equal(record.y[:, 0], values[1])


@pytest.mark.parametrize(
    ("names", "inputs", "outputs"),
    [
        (("Fx [N]", "Fy [N]", "x [m]", "y [m]", "z [m]"), 2, 3),
        (("motor [A]", "brake [A]", "speed [rad/s]"), 2, 1),
        (("F [N]", "x [m]", "y [m]"), 1, 2),
        (("target [mm]", "place [mm]", "motor [A]"), 1, 1),
    ],
)
def test_columns_of_one_unit_of_forces_or_currents_are_the_inputs(tmp_path, names, inputs, outputs):
    values = np.random.default_rng(0).standard_normal((60, len(names)))
    header = ",".join(["t [s]", *names])
    np.savetxt(tmp_path / "rig.csv", np.c_[np.arange(60) * 1e-3, values], delimiter=",", header=header, comments="")
    with pytest.raises(InputError) as refused:
        load(tmp_path / "rig.csv")
    record = load(tmp_path / "rig.csv", **refused.value.remedy)
    assert (len(record.inputs), len(record.outputs)) == (inputs, outputs)

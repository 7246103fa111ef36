"""Broken and foreign files, and arguments that don't fit a file: each its own sentence."""

import json
import pickle
import zipfile

import h5py
import numpy as np
import pytest
import scipy.io

import robustid as rid
from robustid import load
from robustid.data import TimeRecord, save
from robustid.errors import FileFormatError, InputError, InputTypeError
from robustid.formats import read_file
from support.data_files import HZ, U, Y, full_frf, full_record
from support.matlab_files import write73
from support.refusals import refused

pytestmark = pytest.mark.quick


def text(content):
    return lambda path: path.write_text(content)


def cut(write, size, *content):
    """A file of that content without its end."""

    def made(path):
        write(path, *content)
        path.write_bytes(path.read_bytes()[:size])

    return made


def linked_hdf5(path):
    """Numbers that another file on the machine would give."""
    (path.parent / "secret.bin").write_bytes(bytes(48))
    with h5py.File(path, "w") as file:
        file.create_dataset("u", shape=(6,), dtype=float, external=[(str(path.parent / "secret.bin"), 0, 48)])


def spreadsheet(path):
    with zipfile.ZipFile(path, "w") as file:
        file.writestr("xl/workbook.xml", "<workbook/>")


def changed_lines(change):
    def write(path):
        save(path, full_frf())
        lines = path.read_text().splitlines()
        path.write_text("\n".join(change(lines)))

    return write


def other_description(**changes):
    def change(lines):
        meta = json.loads(lines[0][len("# robustid ") :])
        return [f"# robustid {json.dumps({**meta, **changes})}", *lines[1:]]

    return changed_lines(change)


def without_field(lines):
    """As a version without this field wrote it."""
    meta = json.loads(lines[0][len("# robustid ") :])
    del meta["data"]["note"]
    return [f"# robustid {json.dumps(meta)}", *lines[1:]]


def complex_cells(lines):
    return ",".join("1+2j" if name.startswith(("real", "imag")) else cell
                    for name, cell in zip(lines[1].split(","), lines[-1].split(","), strict=True))  # fmt: skip


PNG = b"\x89PNG\r\n\x1a\n" + bytes(600)
BAD_FILES = {
    "empty.csv": (text(""), "is empty"),
    "comment.csv": (text("# nothing\n"), "holds no data"),
    "header.csv": (text("time,u,y\n"), "holds no data"),
    "text.s1p": (text("# GHz S RI R 50\n1 .5 .1\n2 .5 x\n"), "line 3: 'x' is not a number"),
    "cell.csv": (
        text("freq/Hz,Re(Z)/Ohm,-Im(Z)/Ohm\n1,2,3\n2,OVL,4\n"),
        r"line 3, column 'Re\(Z\)/Ohm': 'OVL' is not a number",
    ),
    "text.zma": (text("* box\n20 80 10\n30 8x 1\n40 83 12\n"), r"line 3, column '\|Z\| \[Ohm\]': '8x' is not a number"),
    "words.csv": (text("time,u,y\n0,1,2\n1,one,2\n"), "line 3, column 'u': 'one' is not a number"),
    "cut.csv": (text("time,u,y\n0,1,2\n0.1,1,2\n0.2,1"), "line 4: 2 cells where the lines above have 3"),
    "image.csv": (lambda path: path.write_bytes(PNG), "isn't UTF-8 text"),
    "image.mat": (lambda path: path.write_bytes(PNG), "can't be read as a MATLAB file"),
    "cut.json": (lambda path: path.write_text('{"u": [1, 2'), "can't be read as JSON .* cut off"),
    "rows.json": (lambda path: path.write_text('[{"t": 0, "u": 1}]'), "is JSON, of which one object with lists"),
    "ragged.json": (lambda path: path.write_text('{"u": [[1, 2], [3]]}'), "is JSON, of which one object with lists"),
    "image.npz": (lambda path: path.write_bytes(PNG), "isn't a file that robustid reads"),
    "data.pkl": (lambda path: path.write_bytes(pickle.dumps({"u": 1})), "isn't a file that robustid reads"),
    "objects.npy": (lambda path: np.save(path, np.array([print, None])), "pickled Python objects"),
    "cut.npy": (cut(np.save, 130, np.zeros(1000)), r"array declares .* cut off"),
    "pickled.npz": (
        lambda path: np.savez(path, u=np.array([print, None]), y=np.ones(2)),
        "pickled Python objects, which can run code and are never loaded",
    ),
    "sheet.xlsx": (spreadsheet, "is a workbook of a spreadsheet; export its sheet as text"),
    "cut.npz": (cut(save, -300, full_record()), "can't be read as .npz .*cut off"),
    "cut.mat": (cut(scipy.io.savemat, -60, {"u": U, "y": Y}), "can't be read as a MATLAB file"),
    "cut73.mat": (cut(write73, 1500, {"u": U, "y": Y}, ""), "can't be read as HDF5 .*cut off"),
    "linked.h5": (linked_hdf5, "u lies in other files, which are never opened"),
    "lines.csv": (changed_lines(lambda lines: lines[:-1]), "written with 4 samples"),
    "columns.csv": (other_description(shapes={"omega": [], "values": 3}), "doesn't fit its arrays"),
    "newer.csv": (other_description(robustid=99), "written in format 99 .*newer robustid"),
    "older.csv": (
        changed_lines(without_field),
        "older.csv: it was saved by another version of robustid.* 'note' of its FrequencyResponse .* make it again",
    ),
    "complex.csv": (changed_lines(lambda lines: [*lines[:-1], complex_cells(lines)]), "hold complex numbers"),
    "facts.csv": (changed_lines(lambda lines: ["# robustid {", *lines[1:]]), "description .* is damaged"),
}


@pytest.mark.parametrize("name", BAD_FILES)
def test_broken_and_foreign_files(tmp_path, name):
    write, sentence = BAD_FILES[name]
    write(tmp_path / name)
    with pytest.raises(FileFormatError, match=sentence) as caught:
        load(tmp_path / name)
    assert name in str(caught.value)


@pytest.mark.parametrize(
    ("options", "error", "sentence"),
    [
        ({"fields": {"u": "current"}}, InputError, "'current' isn't in the file. The file has time, u, y"),
        ({"fields": {"x": "u"}}, InputError, r"knows the roles .* got \['x'\]"),
        ({"fields": ["u"]}, InputTypeError, "`fields` must map roles to names"),
        ({"fields": {"u": 3}}, InputTypeError, "must be a name or a list of names; got 3"),
        ({"fields": {"u": [3]}}, InputTypeError, "must name what is in the file; got 3"),
        ({"fields": {"u": []}}, InputTypeError, r"must be a name or a list of names; got \[\]"),
        ({"kind": "step"}, InputError, "`kind` must be"),
        ({"kind": "frequency"}, InputError, "no 'omega' found.*The file has time, u, y"),
        ({"kind": "frequency", "fields": {"omega": "time"}}, InputError, "needs 'values'"),
        ({"fields": {"freq_hz": "time", "omega": "time"}}, InputError, "both 'omega' and 'freq_hz'"),
        ({"fields": {"omega": "time", "values": ["u", "y"]}}, InputError, "list of equally long rows"),
        ({"fields": {"omega": "time", "u": "u"}}, InputError, "can't tell whether"),
        ({"fields": {"time": "time"}, "dt": 0.1}, InputError, r"`dt` and `fields\['time'\]` are both given"),
        ({"frequency_unit": "rpm"}, InputError, "`frequency_unit` must be"),
        ({"bound": -1}, InputError, "`bound` must be positive"),
        ({"initial": "hot"}, InputError, "`initial` must be one of"),
    ],
)
def test_load_refuses(tmp_path, options, error, sentence):
    path = tmp_path / "data.csv"
    path.write_text("time,u,y\n0,1,2\n0.5,1,2\n")
    with pytest.raises(error, match=sentence):
        load(path, **options)


def test_paths_that_are_no_files(tmp_path):
    refused("there is no such file", load, tmp_path / "missing.csv")
    refused("is a folder", load, tmp_path)
    refused("`path` must be the name of a file; got int", load, 3, error=InputTypeError)


def test_names_that_could_mean_either_or_neither(tmp_path):
    np.savez(tmp_path / "both.npz", omega=HZ, values=HZ, u=HZ, y=HZ)
    with pytest.raises(InputError, match="can't tell whether"):
        load(tmp_path / "both.npz")
    assert isinstance(load(tmp_path / "both.npz", kind="time", dt=0.1), TimeRecord)
    np.savez(tmp_path / "neither.npz", frequency=HZ, phase=HZ)
    with pytest.raises(InputError, match="The file has frequency, phase"):
        load(tmp_path / "neither.npz")


@pytest.mark.parametrize(
    ("time", "sentence"),
    [
        ([0, 0.1, 0.2, 0.31, 0.4], r"from 0\.2 s \(sample 2\) to 0\.31 s the step is 0\.11 s, the median step 0\.1 s"),
        ([0, 0.1, 0.2, 0.4, 0.5], r"from 0\.2 s \(sample 2\) to 0\.4 s the step is 0\.2 s"),
        ([0, 0.1, 0.2 + 8e-3, 0.3, 0.4], "resample the record, or give `dt=0.1` to take it as uniform"),
        ([0, 0.1, 0.2, 0.4, 0.5, 0.6][1:], "is 0.2 s"),
        ([0.4, 0.3, 0.2, 0.1, 0.0], "time step` must be positive"),
        ([0, 0, 0, 0, 0], "time step` must be positive"),
        ([0, np.nan, 0.2, 0.3, 0.4], r"`time` must be finite; got nan at index \(1,\)"),
        ([0, 0.1, 0.2], "shape .* where `u` has 5 samples"),
    ],
)
def test_time_that_is_not_uniform(tmp_path, time, sentence):
    np.savez(tmp_path / "data.npz", time=time, u=np.ones(5), y=np.ones(5))
    with pytest.raises(InputError, match=sentence):
        load(tmp_path / "data.npz")
    # stated by the user, the sample time needs no column
    assert load(tmp_path / "data.npz", dt=0.1).dt == 0.1


def test_one_sample_has_no_sample_time(tmp_path):
    np.savez(tmp_path / "data.npz", time=[0.0], u=[1.0], y=[1.0])
    with pytest.raises(InputError, match="one sample gives no sample time; give `dt`"):
        load(tmp_path / "data.npz")


def test_outputs_that_are_proposed_are_all_those_of_one_other_unit(tmp_path):
    names = ["t [ms]", "drive [mA]", "encoder A [um]", "encoder B [um]", "case [m/s2]"]
    rows = np.column_stack([np.arange(50), np.random.default_rng(0).standard_normal((50, 4))])
    np.savetxt(tmp_path / "log.csv", rows, delimiter=",", header=",".join(names), comments="")
    with pytest.raises(InputError, match=r'"u": "drive \[mA\]", "y": \["encoder A \[um\]", "encoder B \[um\]"\]'):
        load(tmp_path / "log.csv")


def test_a_saved_result_is_not_data(tmp_path):
    record = rid.TimeRecord(np.ones(4), [0.5, 0.75, 0.875, 0.94], dt=0.01, bound=0.01)
    result = rid.identify(rid.MixedProblem(time=record, prior=rid.Prior(gain_bound=2.0, decay_rate=1.2)))
    result.save(tmp_path / "plate")
    rid.worst_case_error(result, omega=[50.0], directions=4).save(tmp_path / "error")
    for name in ("plate", "error"):
        for suffix in (".npz", ".json"):
            with pytest.raises(FileFormatError, match=rf"{name}{suffix} belongs to a saved .*robustid\.load$"):
                read_file(tmp_path / f"{name}{suffix}")
    save(tmp_path / "plain.npz", full_record())
    (tmp_path / "plain.json").write_text('{"format": "another 1"}')
    assert load(tmp_path / "plain.npz").y.shape == full_record().y.shape


@pytest.mark.parametrize(
    ("step", "got"),
    [
        (-0.01, "-0.01"),
        (np.nan, "nan"),
        (0.01 + 1j, r"0\.01\+1j"),
        (np.array("0.01"), "the text '0.01'"),
        (np.array([0.01, 0.02]), "2 numbers"),
        (0.0, "0"),
    ],
)
def test_a_stored_sample_time_of_no_use_is_said(tmp_path, step, got):
    """Of a record it was overlooked, and the sentence said that no time was found; a response became one of continuous time."""
    sentence = rf"f\.npz: the sample time 'dt' in the file must be one positive number in s; got {got}\. Give `dt`"
    np.savez(tmp_path / "f.npz", u=np.eye(1, 40)[0], y=np.ones(40), dt=step)
    with pytest.raises(InputError, match=sentence):
        rid.load(tmp_path / "f.npz")
    assert rid.load(tmp_path / "f.npz", dt=0.1).dt == 0.1
    np.savez(tmp_path / "f.npz", omega=[1.0, 2.0, 3.0], values=[1j, 2.0, 3.0], dt=step)
    if got == "0":  # MATLAB's, of continuous time
        assert rid.load(tmp_path / "f.npz").dt is None
    else:
        with pytest.raises(InputError, match=sentence):
            rid.load(tmp_path / "f.npz")
    assert rid.load(tmp_path / "f.npz", dt=0.1).dt == 0.1

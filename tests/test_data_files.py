"""Files: exact round trips, every supported layout against known arrays, broken and foreign files."""

import cmath
import json
import math
import os
import pickle
import zipfile

import h5py
import hypothesis.extra.numpy as arrays
import numpy as np
import pytest
import scipy.io
from hypothesis import example, given, settings
from hypothesis import strategies as st

from robustid._files import atomic_write
from robustid.data import FrequencyResponse, TimeRecord, load, save
from robustid.errors import FileFormatError, InputError, InputTypeError, RobustIdError

RNG = np.random.default_rng(0)
TIME = 0.01 * np.arange(6)
U, Y = RNG.standard_normal((6, 2)), RNG.standard_normal((6, 3))
HZ = np.array([1.0, 2.0, 5.0, 7.0])
G = RNG.standard_normal((4, 2, 3)) + 1j * RNG.standard_normal((4, 2, 3))


def full_frf():
    root = RNG.standard_normal((4, 6, 6)) + 1j * RNG.standard_normal((4, 6, 6))
    return FrequencyResponse(
        HZ,
        G,
        bound=RNG.uniform(0.1, 1, G.shape),
        covariance=root @ root.conj().swapaxes(1, 2),
        dt=0.1 + 0.2,
        inputs=["a [N]", "b, with comma", "c"],
        outputs=["x [µm]", 'y "quoted"'],
        note="first line\nsecond line",
        bound_kind="statistical",
        probability=0.95,
        dof=7.5,
        coherence=RNG.uniform(0, 1, (4, 2)),
        noise=RNG.uniform(0, 1, G.shape),
        distortion=RNG.uniform(0, 1, G.shape),
    )


def full_record():
    bound = RNG.uniform(0.1, 1, Y.shape)
    bound[0] = np.inf
    return TimeRecord(
        U,
        Y,
        dt=1 / 3,
        bound=bound,
        reference=U[:, :1],
        initial="free",
        past_input_bound=np.pi,
        inputs=["a [A]", "b"],
        bound_kind="rest",
    )


def assert_same(one, two):
    assert type(one) is type(two)
    for name in set(one.__dataclass_fields__) - {"_"}:
        a, b = getattr(one, name), getattr(two, name)
        if isinstance(a, np.ndarray):
            assert a.shape == b.shape
            assert a.tobytes() == b.tobytes(), name
        else:
            assert a == b, name


def write_matlab73(path, variables):
    """As MATLAB does: user block with a text, classes as attributes, axes reversed, structures as groups."""
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, value in variables.items():
            value = np.atleast_2d(value)
            if np.iscomplexobj(value):
                pair = np.empty(value.T.shape, dtype=[("real", float), ("imag", float)])
                pair["real"], pair["imag"] = value.T.real, value.T.imag
                data = file.create_dataset(name.replace(".", "/"), data=pair)
            else:
                data = file.create_dataset(name.replace(".", "/"), data=value.T)
            data.attrs["MATLAB_class"] = np.bytes_("double")
        text = file.create_dataset("comment", data=np.frombuffer(b"hello", np.uint8))
        text.attrs["MATLAB_class"] = np.bytes_("char")
    with open(path, "r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64")


# --- what save writes


@pytest.mark.parametrize("suffix", [".npz", ".csv", ".mat"])
@pytest.mark.parametrize("make", [full_frf, full_record, lambda: full_frf().channel(1, 2)])
def test_round_trip_is_exact(tmp_path, make, suffix):
    data, path = make(), tmp_path / f"data{suffix}"
    save(path, data)
    assert_same(load(path), data)
    assert os.listdir(tmp_path) == [path.name]


@pytest.mark.parametrize("suffix", [".npz", ".csv", ".mat"])
def test_a_bound_of_the_user_s_takes_the_place_of_a_stored_one(tmp_path, suffix):
    save(tmp_path / f"data{suffix}", full_frf())
    again = load(tmp_path / f"data{suffix}", bound=0.5)
    assert (again.bound_kind, again.probability, again.note) == ("hard", None, "")
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
    assert_same(load(path), data)


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
    assert_same(load(tmp_path / "data.bin", kind="frequency"), load(tmp_path / "data.bin"))
    with pytest.raises(InputError, match="`kind` = 'time', but the file holds frequency data"):
        load(tmp_path / "data.bin", kind="time")


@pytest.mark.parametrize(
    ("name", "sentence"), [("a.txt", r"must end in \.npz, \.csv, \.mat; got"), ("no/a.csv", "can't be written")]
)
def test_save_refuses_and_leaves_nothing(tmp_path, name, sentence):
    with pytest.raises(InputError, match=sentence):
        save(tmp_path / name, full_frf())
    with pytest.raises(
        InputTypeError, match="`data` must be a FrequencyResponse, TangentialResponse or TimeRecord; got ndarray"
    ):
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
    with pytest.raises(InputError, match=r"'data\.x' isn't in the file\. The file has .*data\.u, data\.y"):
        load(path, fields={"u": "data.x", "y": "data.y"}, dt=0.1)


def test_matlab_axis_order_is_refused_with_the_remedy(tmp_path):
    path = tmp_path / "frd.mat"
    scipy.io.savemat(path, {"omega": HZ, "values": np.moveaxis(G, 0, -1), "siso": G[:, 0, 0].reshape(1, 1, -1)})
    with pytest.raises(InputError, match=r"shape \(2, 3, 4\) with the frequency last.*permute\(G, \[3 1 2\]\)"):
        load(path)
    # one entry only: nothing to mistake
    siso = load(path, fields={"values": "siso"})
    np.testing.assert_array_equal(siso.values[:, 0, 0], G[:, 0, 0])


# --- what is refused


def text(content):
    return lambda path: path.write_text(content)


def pickled(path):
    np.savez(path, u=np.array([print, None]), y=np.ones(2))


def only_pickle(path):
    path.write_bytes(pickle.dumps({"u": 1}))


def truncated_npz(path):
    save(path, full_record())
    path.write_bytes(path.read_bytes()[:-300])


def truncated_matlab(path):
    scipy.io.savemat(path, {"u": U, "y": Y})
    path.write_bytes(path.read_bytes()[:-60])


def truncated_hdf5(path):
    write_matlab73(path, {"u": U, "y": Y})
    path.write_bytes(path.read_bytes()[:1500])


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


def complex_cells(lines):
    return ",".join("1+2j" if name.startswith(("real", "imag")) else cell
                    for name, cell in zip(lines[1].split(","), lines[-1].split(","), strict=True))  # fmt: skip


PNG = b"\x89PNG\r\n\x1a\n" + bytes(600)
BAD_FILES = {
    "empty.csv": (text(""), "is empty"),
    "comment.csv": (text("# nothing\n"), "holds no data"),
    "header.csv": (text("time,u,y\n"), "holds no data"),
    "numbers.csv": (text("0,1,2\n1,1,2\n"), "no line of column names"),
    "twice.csv": (text("time,u,u\n0,1,2\n"), "not all different"),
    "words.csv": (text("time,u,y\n0,1,2\n1,one,2\n"), "line 3, column 'u': 'one' is not a number"),
    "comma.csv": (text("time;u;y\n0;1,5;2\n1;1,5;2\n"), "'1,5' is not a number.*with a point"),
    "gap.csv": (text("time,u,y\n0,,2\n1,1,2\n"), "line 2, column 'u': '' is not a number"),
    "cut.csv": (text("time,u,y\n0,1,2\n0.1,1,2\n0.2,1"), "line 4: 2 cells where the header has 3"),
    "utf16.csv": (lambda path: path.write_text("time,u,y\n0,1,2", encoding="utf-16"), "isn't UTF-8 text"),
    "image.csv": (lambda path: path.write_bytes(PNG), "isn't UTF-8 text"),
    "image.mat": (lambda path: path.write_bytes(PNG), "can't be read as a MATLAB file"),
    "image.npz": (lambda path: path.write_bytes(PNG), "isn't a file that robustid reads"),
    "data.pkl": (only_pickle, "isn't a file that robustid reads"),
    "array.npy": (lambda path: np.save(path, U), "isn't a file that robustid reads"),
    "pickled.npz": (pickled, "pickled Python objects, which can run code and are never loaded"),
    "sheet.xlsx": (spreadsheet, "holds no numeric arrays"),
    "cut.npz": (truncated_npz, "can't be read as .npz .*cut off"),
    "cut.mat": (truncated_matlab, "can't be read as a MATLAB file"),
    "cut73.mat": (truncated_hdf5, "can't be read as HDF5 .*cut off"),
    "linked.h5": (linked_hdf5, "u lies in other files, which are never opened"),
    "lines.csv": (changed_lines(lambda lines: lines[:-1]), "written with 4 samples"),
    "columns.csv": (other_description(shapes={"omega": [], "values": 3}), "doesn't fit its arrays"),
    "newer.csv": (other_description(robustid=99), "written in format 99 .*newer robustid"),
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


def test_every_truncation_of_a_file_is_an_error_or_the_same_data(tmp_path):
    """Cut at 60 places each: no other exception, and never other data."""
    record = full_record()
    for name, write in {
        "a.npz": lambda p: save(p, record),
        "a.csv": lambda p: save(p, record),
        "a.mat": lambda p: scipy.io.savemat(p, {"u": record.u, "y": record.y}),
        "b.mat": lambda p: write_matlab73(p, {"u": record.u, "y": record.y}),
    }.items():
        path = tmp_path / name
        write(path)
        content, given_dt = path.read_bytes(), {"dt": 1 / 3} if name.endswith("mat") else {}
        refused = 0
        for size in np.linspace(0, len(content) - 2, 60).astype(int):
            path.write_bytes(content[:size])
            try:
                again = load(path, **given_dt)
            except RobustIdError:
                refused += 1
            else:
                np.testing.assert_array_equal(again.u, record.u)
        assert refused >= 50, name


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
    with pytest.raises(InputError, match="there is no such file"):
        load(tmp_path / "missing.csv")
    with pytest.raises(InputError, match="is a folder"):
        load(tmp_path)
    with pytest.raises(InputTypeError, match="`path` must be the name of a file; got int"):
        load(3)


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
        (
            [0, 0.1, 0.2, 0.31, 0.4],
            r"from 0\.2 s \(sample 2\) to 0\.31 s the step is 0\.11 s, the median step 0\.1 s",
        ),
        ([0, 0.1, 0.2, 0.4, 0.5], r"from 0\.2 s \(sample 2\) to 0\.4 s the step is 0\.2 s"),
        ([0, 0.1, 0.2 + 3e-7, 0.3, 0.4], "the time is not uniform"),
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


def test_time_rounded_in_the_file_is_uniform_enough(tmp_path):
    np.savez(tmp_path / "data.npz", t=np.round(1e4 + np.arange(500) / 3, 7), u=np.ones(500), y=np.ones(500))
    assert load(tmp_path / "data.npz").dt == pytest.approx(1 / 3, rel=1e-8)


def test_one_sample_has_no_sample_time(tmp_path):
    np.savez(tmp_path / "data.npz", time=[0.0], u=[1.0], y=[1.0])
    with pytest.raises(InputError, match="one sample gives no sample time; give `dt`"):
        load(tmp_path / "data.npz")


def test_path_may_be_text(tmp_path):
    save(str(tmp_path / "data.csv"), full_frf())
    assert load(str(tmp_path / "data.csv")).omega.size == 4

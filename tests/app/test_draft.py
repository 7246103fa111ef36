"""Run files that `robustid new` proposes for small files of every kind: the signals, and the numbers that are asked for."""

import re

import numpy as np
import pytest
import scipy.io

import robustid as rid
from robustid.app.draft import drafted_run_file
from robustid.app.run.run_file import read_run_file

SAMPLES = 120
COUNT, U = np.arange(SAMPLES), np.random.default_rng(0).standard_normal(SAMPLES)
Y, MS = np.convolve(U, [0, 0.5, 0.3])[:SAMPLES], 2.0 * np.arange(SAMPLES)
PAIRS = {"u1": U, "y1": Y, "u2": U[::-1], "y2": Y[::-1]}
ONE, TWO = {"u": "u1", "y": "y1"}, {"u": "u2", "y": "y2"}


def named(pattern):
    return {role: pattern.format(role) for role in "uy"}


STRUCTURE = {"u": U, "y": Y, "Ts": 2e-3}

# Name, columns of a text or arrays of a file, expected fields of every record, and whether the sample time is asked for.
TABLE = [
    ("counter.csv", {"n": COUNT, "force": U, "position": Y}, [{"u": "force", "y": "position"}], True),
    ("from_one.csv", {"sample": COUNT + 1, "force": U, "position": Y}, [{"u": "force", "y": "position"}], True),
    (
        "counter_and_time.csv",
        {"n": COUNT, "time": MS / 1e3, "force": U, "position": Y},
        [{"time": "time", "u": "force", "y": "position"}],
        False,
    ),
    ("seconds.csv", {"t": COUNT, "force": U, "position": Y}, [{"time": "t", "u": "force", "y": "position"}], False),
    ("ms.csv", {"t_ms": MS, "force": U, "position": Y}, [{"time": "t_ms", "u": "force", "y": "position"}], False),
    ("ms_unit.csv", {"Time [ms]": MS, "force": U, "z": Y}, [{"time": "Time [ms]", "u": "force", "y": "z"}], False),
    ("ms_usual.csv", {"time_ms": MS, "u": U, "y": Y}, [None], False),
    ("no_time.csv", {"force": U, "position": Y}, [{"u": "force", "y": "position"}], True),
    ("usual.csv", {"u": U, "y": Y}, [None], True),
    ("two.npz", {"u": U, "y": Y}, [None], True),
    ("two_named.npz", {"force": U, "position": Y}, [{"u": "force", "y": "position"}], True),
    ("two_with_step.npz", {"u": U, "y": Y, "dt": 2e-3}, [None], False),
    ("four.npz", PAIRS, [ONE, TWO], True),
    ("four.mat", PAIRS, [ONE, TWO], True),
    ("four_with_step.mat", PAIRS | {"Ts": 2e-3}, [ONE, TWO], False),
    ("four_unlike.npz", {"u1": U, "u2": U[:90], "y1": Y, "y2": Y[:90]}, [ONE, TWO], True),
    ("four_joint.npz", {"u1": U, "u2": U[::-1], "y1": Y, "y2": Y[::-1]}, [None], True),
    ("four_low.npz", {"u_1": U, "y_1": Y, "u_2": U, "y_2": Y}, [{"u": f"u_{k}", "y": f"y_{k}"} for k in (1, 2)], True),
    ("uses.mat", {"uEst": U, "uVal": U, "yEst": Y, "yVal": Y}, [named("{}Est"), named("{}Val")], True),
    ("uses.csv", {"u_train": U, "y_train": Y, "u_test": U, "y_test": Y}, [named("{}_train"), named("{}_test")], True),
    ("uses_step.csv", {"uval": U, "yval": Y, "Ts": 0 * U + 2e-3}, [named("{}val")], False),
    ("one_word.mat", {"uBenchMark": U, "yBenchMark": Y, "fs": 500.0}, [named("{}BenchMark")], False),
    ("axes.mat", {"u_d": U, "u_q": U[::-1], "y_d": Y, "y_q": Y}, [{"u": ("u_d", "u_q"), "y": ("y_d", "y_q")}], True),
    ("z.mat", {"z1": Y, "u1": U, "z2": Y, "u2": U}, [{"u": "u1", "y": "z1"}, {"u": "u2", "y": "z2"}], True),
    ("structure.mat", {"run": STRUCTURE}, [None], False),
    (
        "structures.mat",
        {"a": STRUCTURE, "b": STRUCTURE},
        [{"u": f"{name}.u", "y": f"{name}.y", "dt": f"{name}.Ts"} for name in "ab"],
        False,
    ),
]


def write(path, arrays):
    if path.suffix == ".csv":
        rows = np.column_stack(list(arrays.values()))
        np.savetxt(path, rows, delimiter=",", header=",".join(arrays), comments="")
    elif path.suffix == ".mat":
        scipy.io.savemat(path, arrays)
    else:
        np.savez(path, **arrays)


@pytest.mark.parametrize(("name", "arrays", "fields", "asked"), TABLE, ids=[row[0] for row in TABLE])
def test_signals_and_sample_time_that_are_proposed(tmp_path, name, arrays, fields, asked):
    write(tmp_path / name, arrays)
    found = rid.look(tmp_path / name)
    draft = drafted_run_file([found], tmp_path)
    (tmp_path / "run.toml").write_text(draft.text)
    read = read_run_file(tmp_path / "run.toml")
    assert [source.fields for source in read.record] == fields
    assert [source.dt for source in read.record] == [None] * len(fields)
    assert bool(re.search("^# dt = .*EDIT", draft.text, re.M)) == asked
    assert any(line.startswith("# dt") for line in draft.edits) == asked
    # What is proposed reads the file, with the sample time where it is asked for.
    for source in read.record:
        record = rid.load(tmp_path / name, **{"fields": source.fields, "dt": 2e-3 if asked else None})
        assert record.dt == (1.0 if name == "seconds.csv" else pytest.approx(2e-3))
        assert np.array_equal(record.u[0], [U[0]] if record.u.shape[1] == 1 and source.fields != TWO else record.u[0])
    together = "played together" in draft.text
    assert together == (len(fields) == 2 and "unlike" not in name and "uses" not in name)


HALVES = [
    ("input.txt", "output.txt", {"u": "[:,0]", "y": "output.txt[:,0]"}),
    ("uval.mat", "yval.mat", {"u": "uval", "y": "yval.mat:yval"}),
    ("test_u.npy", "test_y.npy", {"u": "[:]", "y": "test_y.npy"}),
]


@pytest.mark.parametrize(("first", "second", "fields"), HALVES, ids=[row[0] for row in HALVES])
@pytest.mark.parametrize("turned", [False, True])
def test_input_and_output_in_two_files_are_one_record(tmp_path, first, second, fields, turned):
    for name, values in ((first, np.tile(U, 3)), (second, np.tile(Y, 3))):
        path = tmp_path / name
        if path.suffix == ".mat":
            scipy.io.savemat(path, {path.stem: values})
        else:
            np.savetxt(path, values) if path.suffix == ".txt" else np.save(path, values)
    draft = drafted_run_file([rid.look(tmp_path / name) for name in sorted([first, second], reverse=turned)], tmp_path)
    (tmp_path / "run.toml").write_text(draft.text)
    read = read_run_file(tmp_path / "run.toml")
    (source,) = read.record
    assert read.estimate.period == SAMPLES
    if not turned:
        assert source.fields == fields
    record = rid.load(tmp_path / source.file, fields=source.fields, dt=2e-3)
    assert np.array_equal(record.u[:SAMPLES, 0], U)


GUESSES = [
    (np.sqrt(MS + 1), {"freq_hz": "blorp", "real": "quux", "imag": "zing"}),
    (MS, {"time": "blorp", "u": "quux", "y": "zing"}),
]


@pytest.mark.parametrize(("axis", "fields"), GUESSES, ids=["uneven", "even"])
def test_an_axis_whose_name_says_nothing_is_asked_about_and_not_run(tmp_path, axis, fields):
    write(tmp_path / "x.csv", {"blorp": axis, "quux": U, "zing": Y})
    found = rid.look(tmp_path / "x.csv")
    assert found.next == (f"robustid new {tmp_path / 'x.csv'} -o run.toml",)
    assert "by --frequency-field ROLE=NAME or --time-field ROLE=NAME." in found.for_terminal().refusal
    draft = drafted_run_file([found], tmp_path)
    guess = ", ".join(f'"{role}" = "{name}"' for role, name in found.arguments["fields"].items())
    assert f"# fields = {{ {guess} }}  # EDIT: a guess, the names say nothing" in draft.edits
    assert found.arguments["fields"] == fields
    (tmp_path / "run.toml").write_text(draft.text)
    read = read_run_file(tmp_path / "run.toml")
    assert [source.fields for source in (*read.frequency, *read.record)] == [None]


def test_a_counter_may_be_the_frequency_axis_of_a_response(tmp_path):
    write(tmp_path / "x.csv", {"k": COUNT, "a": U, "b": Y})
    assert '"freq_hz": "k"' in rid.look(tmp_path / "x.csv").refusal


@pytest.mark.parametrize("name", ["r", "ref", "Setpoint [V]", "reference"])
def test_a_reference_beside_the_signals_is_drafted_as_a_loop(tmp_path, name):
    write(tmp_path / "loop.csv", {"t": MS / 1e3, name: U[::-1], "u": U, "y": Y})
    found = rid.look(tmp_path / "loop.csv")
    np.testing.assert_allclose(found.data.reference[:, 0], U[::-1])
    draft = drafted_run_file([found], tmp_path)
    assert "[loop]" in draft.text
    assert any("controller" in line for line in draft.edits)
    (tmp_path / "run.toml").write_text(draft.text)
    assert not read_run_file(tmp_path / "run.toml").loop.is_stated


@pytest.mark.parametrize("other", [{"rr": U}, {"r": 0 * U + 3}])
def test_what_is_no_reference_is_left_alone(tmp_path, other):
    write(tmp_path / "record.csv", {"t": MS / 1e3, **other, "u": U, "y": Y})
    found = rid.look(tmp_path / "record.csv")
    assert found.data.reference is None
    assert "[loop]" not in drafted_run_file([found], tmp_path).text


@pytest.mark.parametrize("arrays", [{"time": MS / 1e3}, {"time": MS / 1e3, "current": U}])
def test_what_is_missing_is_said_in_words_of_its_surroundings(tmp_path, arrays):
    write(tmp_path / "part.csv", arrays)
    found = rid.look(tmp_path / "part.csv")
    assert "by `fields={'u': ...}`" in found.refusal
    assert "by --time-field u=NAME." in found.for_terminal().refusal
    (edit,) = drafted_run_file([found], tmp_path).edits  # the times say the sample time
    assert 'by fields = { u = "NAME" }.' in edit
    assert found.arguments["fields"]["time"] == "time"


@pytest.mark.parametrize("second", [1e-3, 2e-3])
def test_records_of_two_sample_times_are_told_before_the_run(tmp_path, second):
    rng = np.random.default_rng(0)
    for name, dt in (("one", 1e-3), ("two", second)):
        np.savez(tmp_path / f"{name}.npz", u=rng.standard_normal(300), y=rng.standard_normal(300), dt=dt)
    draft = drafted_run_file([rid.look(tmp_path / f"{name}.npz") for name in ("one", "two")], tmp_path)
    said = "# EDIT: sample times of 0.001 and 0.002 s: all experiments of one run have the same"
    assert (said in draft.text) == any(line.startswith(said) for line in draft.edits) == (second != 1e-3)

"""robustid identify as a user meets it: real files, exit codes, sentences."""

import dataclasses
import os

import numpy as np
import pytest
import scipy.io

import robustid as rid
from robustid.identification.verification import Check
from robustid.identification.verification import verify as consistency_verify
from support.command_line import CLASS, COMMAND, SHORT, nothing_written, refused


def test_inconsistent_data_exit_with_3_and_say_what_would_help(files, run):
    wrong = ["--mode", "9:0.1", "--mode", "17.4:0.004", "--gain", "0.2", "--decay-rate", "1.1", "--no-reduce"]
    code, out, _ = run([*COMMAND, *wrong])
    assert code == 3
    assert "nconsistent" in out
    assert "margin" in out.lower()
    assert not rid.load(files / "result").consistent


@pytest.mark.usefixtures("unreduced")
@pytest.mark.parametrize("command", ["identify", "run"])
def test_a_model_that_fails_a_check_ends_with_1_and_its_page(files, run, monkeypatch, command):
    def failing(*arguments):
        found = consistency_verify(*arguments)
        return dataclasses.replace(found, checks=(*found.checks, Check("a number of the model", 2.0, 1.0)))

    monkeypatch.setattr("robustid.identification.consistency.verify", failing)
    if command == "identify":
        code, out, _ = run([*COMMAND, *CLASS, "--report", "page.html"])
        page = files / "page.html"
    else:
        bounded = "dt = 0.01\nbound = 0.03\n"
        text = f'[[frequency]]\nfile = "frf.csv"\n{bounded}[modes]\nhz = [9.0, 17.67]\ndamping = [0.1, 0.004]\n'
        (files / "asked.toml").write_text(
            text + "[prior]\ngain_bound = 0.2\ndecay_rate = 1.1\n[worst_case]\ncompute = false\n", encoding="utf-8"
        )
        code, out, _ = run(["run", "asked.toml", "-o", "out"])
        page = files / "out" / "report.html"
    assert code == 1
    assert "Not verified" in out
    assert "Not verified" in page.read_text(encoding="utf-8")


def test_column_names_and_units_are_given_by_options(files, run):
    frf = rid.datasets.flexible_structure(seed=0).frequency
    rows = np.column_stack([frf.freq_hz, frf.values[:, 0, 0].real, frf.values[:, 0, 0].imag])
    np.savetxt("odd.csv", rows, delimiter=",", header="where,x,y", comments="")
    fields = ["--frequency-field", "omega=where", "--frequency-field", "real=x", "--frequency-field", "imag=y"]
    options = ["--frequency-unit", "Hz", "--dt", "0.01", "--frequency-bound", "0.03", "--no-reduce"]
    code, _, err = run(["identify", "--frequency", "odd.csv", *fields, *options, *CLASS])
    assert code == 0, err
    assert np.allclose(rid.load("result").problem.frequency[0].omega, frf.omega)


def test_the_form_is_an_option(files, run):
    lines = ["identify", "--frequency", "frf.csv", "--no-reduce"]
    code, _, err = run([*lines, *CLASS, "--form", "sections", "--accuracy", "1e-3"])
    assert code == 0, err
    result = rid.load("result")
    assert result.verification.passed
    assert result.formulation.repeated.degree > 1
    code, _, err = run([*lines, *CLASS[:-1], "1.0001", "--form", "sections", "--force"])
    assert code == 2
    assert "coefficients (a section of degree" in " ".join(err.split())
    assert "--band" in err


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["identify"], "--frequency"),
        (["identify", "--frequency", "nothing.csv"], "nothing.csv"),
        ([*COMMAND, "--gain", "0.2"], "--decay-rate"),
        ([*COMMAND, "--mode", "17"], "HZ:DAMPING"),
        ([*COMMAND, "--mode", "9:2"], "damping"),
        ([*COMMAND, "--entry", "0"], "OUTPUT,INPUT"),
        ([*COMMAND, "--time-field", "u"], "ROLE=NAME"),
        ([*COMMAND, *CLASS, "--objective", "best"], "objective"),
        ([*COMMAND, *CLASS, "--form", "best"], "--form must be one of auto, orthonormal, classical, taylor, sections"),
        ([*COMMAND, *CLASS, "--solver", "NONE"], "solver"),
        ([*COMMAND, "-o", "no/such/folder/x"], "folder"),
        (["identify", "--frequency", "bad.mat", "--dt", "0.01", "--frequency-bound", "1"], "bad.mat"),
        (["reduce", "nothing.npz"], "nothing.npz"),
        (["reduce", "bad.mat"], "bad.mat"),
        (["report", "nothing"], "missing"),
    ],
)
def test_misuse_exits_with_2_and_one_sentence(files, run, arguments, words):
    (files / "bad.mat").write_bytes(b"\x89PNG\r\n\x1a\n" + bytes(300))
    with nothing_written():
        refused(run(arguments), words)


def test_existing_results_are_not_replaced_unasked(files, run):
    (files / "result.npz").write_text("precious")
    refused(run([*COMMAND, *CLASS]), "--force")
    assert (files / "result.npz").read_text() == "precious"


def columns(name, header, *arrays):
    np.savetxt(name, np.column_stack(arrays), delimiter=",", header=header, comments="")


@pytest.fixture
def foreign(files):
    """The same measurements in files that robustid did not write."""
    data = rid.datasets.flexible_structure(seed=0)
    omega, value = data.frequency.omega, data.frequency.values[:, 0, 0]
    t, u, y = data.time.time, data.time.u[:, 0], data.time.y[:, 0]
    columns("plain.csv", "freq_hz,real,imag", omega / (2 * np.pi), value.real, value.imag)
    columns("omega.csv", "omega,real,imag", omega, value.real, value.imag)
    columns("beyond.csv", "omega,real,imag", omega * 3, value.real, value.imag)
    columns("plain_step.csv", "time,u,y", t, u, y)
    columns("odd_step.csv", "time,current,angle", t, u, y)
    columns("long.csv", "time,u,y", 0.01 * np.arange(300), np.ones(300), np.pad(y, (0, 280), mode="edge"))
    both = np.stack([np.stack([value, 2 * value], -1), np.stack([3 * value, 4 * value], -1)], -2)
    np.savez("two.npz", omega=omega, values=both, dt=0.01)
    scipy.io.savemat("rate.mat", {"omega": omega, "G": value, "Ts": 0.01})
    np.savez("duration.npz", omega=omega, G=value, T=0.01)
    return files


LINES = ["--frequency-bound", "0.03"]
RATE = ["--dt", "0.01"]
RATED = "rate.mat", "duration.npz"  # with a sample time under another name


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (
            ["--frequency", "frf.csv", "--frequency", "frf.csv", "--time", "step.csv"],
            [
                "read frf.csv: frequency response, 11 frequency points, 1 to 21 Hz",
                "[mm] / force [N]",
                "time record, 20 samples, 0 to 0.19 s",
                "dt = 0.01 s",
                "frf.csv is given twice",
            ],
        ),
        (["--frequency", "omega.csv", *LINES, *RATE], ["read as rad/s (--frequency-unit Hz if the file has Hz)"]),
        (["--frequency", "plain.csv", *LINES, *RATE, "--frequency-unit", "Hz"], ["--frequency-unit is ignored"]),
        (["--frequency", "frf.csv", "--dt", "0.011"], ["--dt 0.011 s is used", "0.01 s (stored with the data)"]),
        (["--time", "plain_step.csv", "--time-bound", "0.05", "--dt", "0.011"], ["0.01 s (its time axis)"]),
        (["--frequency", "two.npz", *LINES, "--entry", "0,0"], ["one entry of 2 outputs and 2 inputs"]),
        (
            [part for name in RATED for part in ("--frequency", name)] + LINES,
            [f"{name}: frequency response, 11 frequency points, 1 to 21 Hz, y / u, dt = 0.01 s" for name in RATED],
        ),
    ],
)
def test_what_was_read_is_said(foreign, run, unproved, arguments, words):
    code, out, err = run(["identify", *arguments, *SHORT])
    assert code in (0, 3), err
    for part in (*words, "written: result.npz, result.json"):
        assert part in " ".join(out.split())


def test_nothing_is_warned_of_without_a_reason(foreign, run):
    arguments = ["--frequency", "plain.csv", "--time", "plain_step.csv", *LINES, "--time-bound", "0.03", *RATE]
    code, out, _ = run(["identify", *arguments, *SHORT])
    assert code == 0
    assert "warning" not in out.lower()
    assert "rad/s" not in out.split("choosing")[0]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--frequency", "plain.csv", *LINES, "--time", "step.csv"], "--dt: some experiments are of continuous time"),
        (["--frequency", "plain.csv", *RATE], "plain.csv: no error bound can be taken from the data"),
        (["--time", "plain_step.csv"], "plain_step.csv: no error bound can be taken from the data"),
        (["--time", "odd_step.csv", "--time-bound", "0.05"], "--time-field u=NAME"),
        (["--frequency", "plain_step.csv", *LINES], "plain_step.csv holds time data; use --time"),
        (["--time", "frf.csv"], "frf.csv holds frequency data; use --frequency"),
        (["--frequency", "beyond.csv", *LINES, *RATE], "63 Hz lies above the Nyquist frequency of 50 Hz"),
        (
            ["--time", "long.csv", "--time-bound", "0.05", "--mode", "none", "--gain", "1", "--decay-rate", "1.001"],
            "--band LOW:HIGH keeps",
        ),
        (["--frequency", "frf.csv", "--band", "60:70"], "frf.csv: no frequency point lies between 60 and 70 Hz"),
        (["--frequency", "frf.csv", "--band", "60"], "LOW:HIGH"),
        (["--time", "step.csv", "--first", "0"], "--first must be positive"),
        (["--time", "step.csv", "--initial", "periodic", "--first", "4"], "--initial periodic needs whole"),
        (["--time", "step.csv", "--initial", "foo"], "--initial must be one of rest, free, periodic"),
        (["--frequency", "frf.csv", "--initial", "rest"], "--initial is given without a file: add --time"),
        (["--frequency", "frf.csv", "--time-field", "u=a"], "--time-field is given without a file"),
        (["--frequency", "frf.csv", "--time-bound", "1"], "--time-bound is given without a file"),
        (["--time", "step.csv", "--band", "1:2"], "--band is given without a file: add --frequency"),
        (["--frequency", "frf.csv", "--frequency-bound", "0"], "--frequency-bound must be positive"),
        (["--frequency", "two.npz", *LINES, "--entry", "2,0"], "which has 2 outputs and 2 inputs"),
        (["--frequency", "frf.csv", "--entry", "0,1"], "which has 1 output and 1 input"),
        (["--frequency", "frf.csv", "--mode", "9:10"], "not percent (10 % is 0.1)"),
        (["--frequency", "frf.csv", "--mode", "60:0.1"], "the Nyquist frequency, 50 Hz at dt = 0.01 s; got 60 Hz"),
        (["--frequency", "frf.csv", "--gain", "-1", "--decay-rate", "1.1"], "--gain must be positive"),
        (["--frequency", "frf.csv", "-o", "res.mat"], "leave .mat out"),
        (["--frequency", "frf.csv", "--report", "folder"], "folder is a folder"),
        (["--frequency", "frf.csv", "-o", "folder"], "folder is a folder"),
        (["--frequency", "frf.csv", "--report", "frf.csv", "--force"], "is one of the files to be read"),
        (["--frequency", "frf.csv", "--report", "result.json"], "would be written twice"),
    ],
)
def test_sentences_name_the_option_and_the_file(foreign, run, arguments, words):
    (foreign / "folder").mkdir()
    own = [] if "--gain" in arguments or "--mode" in arguments else SHORT
    with nothing_written():
        refused(run(["identify", *arguments, *own]), words)


def test_band_and_first_take_a_part_and_bounds_say_where_they_come_from(foreign, run):
    arguments = ["--frequency", "frf.csv", "--band", "2:10", "--time", "step.csv", "--first", "7", *LINES]
    code, out, err = run(["identify", *arguments, *SHORT])
    assert code == 0, err
    for words in ("4 frequency points, 3 to 9 Hz", "7 samples, 0 to 0.06 s"):
        assert words in " ".join(out.split())
    result = rid.load("result")
    data = rid.datasets.flexible_structure(seed=0)
    np.testing.assert_allclose(result.problem.frequency[0].values, data.frequency.band(2, 10).values)
    np.testing.assert_array_equal(result.problem.time[0].y, data.time.y[:7])
    assert result.problem.frequency[0].note == "given on the command line"
    assert result.problem.time[0].note == data.time.note


def test_one_entry_is_picked_by_number_or_name(foreign, run, unproved):
    value = rid.datasets.flexible_structure(seed=0).frequency.values
    for entry in ("1,0", "y2,u1"):
        code, _, _ = run(["identify", "--frequency", "two.npz", "--entry", entry, *LINES, *SHORT, "--force"])
        assert code in (0, 3)
        np.testing.assert_allclose(rid.load("result").problem.frequency[0].values, 3 * value)


def test_a_folder_that_can_not_be_written_to_is_refused_first(files, run, monkeypatch):
    real = os.access
    monkeypatch.setattr("os.access", lambda path, mode: mode != os.W_OK and real(path, mode))
    refused(run([*COMMAND, *SHORT]), "can't be written to")


def test_choices_are_kept_and_an_empty_class_is_warned_of_at_the_end(files, run):
    code, out, _ = run(["identify", "--frequency", "frf.csv", "--mode", "none", "--no-reduce", "-v"])
    assert code == 0
    result = rid.load("result")
    assert any("K" in note for note in result.notes)
    assert "Chosen by the program from these data" in out
    assert "Consistent, but the class says little" in out
    said = " ".join(out.split())
    assert all(f"warning: {sentence}" in said for sentence in result.warnings)

"""robustid frf: records in, a response with its bound out, sentences, exit codes."""

import re
import shlex

import numpy as np
import pytest
import scipy.signal

import robustid as rid
from robustid.data import FrequencyResponse, TimeRecord
from robustid.estimation import estimate_frf
from support import command_line

pytestmark = pytest.mark.quick
DT, PERIOD = 0.01, 100
GAIN = np.array([[2.0, 0.5], [0.0, -1.0]])


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Two experiments of a 2 x 2 gain, their excitation, one channel of them with names of its own, and other kinds."""
    folder = tmp_path_factory.mktemp("files")
    play = rid.prepare.multisine(band_hz=(1, 20), dt=DT, period=PERIOD, inputs=2, minimise_crest=False)
    play.save(folder / "play.csv")
    rng = np.random.default_rng(0)
    for k, u in enumerate(play.u):
        u = np.tile(u, (6, 1))
        y = u @ GAIN.T + 0.01 * rng.standard_normal((600, 2))
        names = {"inputs": ["force [N]", "torque [Nm]"], "outputs": ["x [mm]", ("[red]phi[/red]", "")]}
        rid.save(folder / f"run{k + 1}.csv", TimeRecord(u, y, dt=DT, **names))
        table = np.column_stack([DT * np.arange(600), u, y])
        np.savetxt(folder / f"plain{k + 1}.csv", table, delimiter=",", header="time,iq,id,a,b", comments="")
    u = rng.standard_normal(1500)
    np.savez(folder / "random.npz", u=u, y=0.5 * u + 0.01 * rng.standard_normal(1500))
    np.savez(folder / "loop.npz", u=u, y=0.5 * u + 0.01 * rng.standard_normal(1500), reference=2 * u, dt=DT)
    np.savez(folder / "still.npz", u=np.zeros(600), y=rng.standard_normal(600), dt=DT)
    rid.save(folder / "done.npz", FrequencyResponse([1.0], [1.0], dt=DT))
    return folder


@pytest.fixture
def files(made, stand_in):
    return stand_in(made)


@pytest.fixture
def run(capsys, monkeypatch):
    return lambda arguments: command_line.words(["frf", *arguments], capsys, monkeypatch)


def same(found, wanted):
    for name in ("omega", "values", "bound", "covariance", "noise", "coherence"):
        np.testing.assert_array_equal(getattr(found, name), getattr(wanted, name), err_msg=name)
    assert (found.note, found.dof) == (wanted.note, wanted.dof)
    assert (found.bound.kind, found.bound.probability) == ("confidence", wanted.bound.probability)


def test_records_of_an_excitation_give_what_the_library_estimates(files, run):
    arguments = ["run1.csv", "run2.csv", "--lines", "play.csv", "-o", "g.npz", "--report", "g.html", "-v"]
    code, out, err = run(arguments)
    assert code == 0, err
    records = [rid.load(f"run{k}.csv") for k in (1, 2)]
    play = rid.load("play.csv")
    wanted = estimate_frf(records, period=PERIOD, lines=play.lines)
    found = rid.load("g.npz")
    same(found, wanted)
    assert np.all(np.abs(found.values - GAIN) <= found.bound)
    for words in (
        "read run1.csv: time record, 600 samples, 0 to 5.99 s, x [mm], [red]phi[/red] / force [N], torque [Nm]",
        "Confidence bound of the mean response, 95 %",
        "20 points, 1 to 20 Hz, 1 Hz apart",
        "scatter over 6 periods",
        f"lowest {found.coherence[:, 0].min():.3g} at",
        "x [mm] / force [N]",
        "written: g.npz, g.html",
        "robustid identify --frequency g.npz -o g-model --report g-model.html",
    ):
        assert words in out, words
    share = 100 * np.median(found.bound[:, 0, 0] / np.abs(found.values[:, 0, 0]))
    row = re.search(r"x \[mm\] / force \[N\] \S+ (\S+) %", out)
    assert float(row[1]) == pytest.approx(share, rel=0.05)
    page = (files / "g.html").read_text(encoding="utf-8")
    assert "Spectra of the records" in page
    assert "input force [N]" in page


def test_names_of_columns_period_and_lines_and_a_file_of_matlab(files, run):
    fields = [f"--time-field={pair}" for pair in ("u=iq", "u=id", "y=a", "y=b")]
    options = ["--period", "100", "--lines", "1:9:2, 12", "--probability", "0.9"]
    code, out, err = run(["plain1.csv", "plain2.csv", *fields, *options, "-o", "g.mat", "-v"])
    assert code == 0, err
    found = rid.load("g.mat")
    records = [rid.load(f"plain{k}.csv", fields={"u": ["iq", "id"], "y": ["a", "b"]}) for k in (1, 2)]
    same(found, estimate_frf(records, period=PERIOD, lines=[1, 3, 5, 7, 9, 12], probability=0.9))
    assert [channel.name for channel in found.inputs] == ["iq", "id"]
    assert "Confidence bound of the mean response, 90 %" in out


def test_one_signal_of_several_and_the_first_samples(files, run):
    fields = ["--time-field", "u=iq", "--time-field", "y=a"]
    code, out, err = run(["plain1.csv", *fields, "--period", "100", "--first", "400"])
    assert code == 0, err
    assert "400 samples, 0 to 3.99 s" in out
    assert "robustid identify --frequency frf.npz -o frf-model --report" in out
    assert rid.load("frf.npz").values.shape[1:] == (1, 1)


def test_other_excitation_methods_and_a_reference(files, run):
    code, out, err = run(["random.npz", "--dt", "0.01", "-o", "local.npz", "-v"])
    assert code == 0, err
    record = rid.load("random.npz", dt=DT)
    same(rid.load("local.npz"), estimate_frf(record))
    assert "local rational method" in out
    code, out, err = run(["random.npz", "--dt", "0.01", "--method", "welch", "-o", "w.npz", "-v"])
    assert code == 0, err
    assert "Warning: This is a first look by Welch's method" in out
    code, out, err = run(["loop.npz", "-o", "loop-frf.npz", "-v"])
    assert code == 0, err
    assert "; 1 reference" in out
    assert "by the reference" in out


def test_a_transient_that_is_left_out_is_said(files, run):
    rng = np.random.default_rng(1)
    u = np.tile(rng.standard_normal(PERIOD), 8) + 1e-6 * rng.standard_normal(800)
    y = u + 5 * np.exp(-np.arange(800) / 30) + 0.01 * rng.standard_normal(800)
    rid.save("start.npz", TimeRecord(u, y, dt=DT))
    code, out, err = run(["start.npz", "--period", "100", "-v"])
    assert code == 0, err
    assert re.search(r"the first \d left out \(transient\)", out)
    code, out, err = run(["start.npz", "--period", "100", "--initial", "periodic", "--force", "-v"])
    assert code == 0, err
    assert "left out" not in out


def test_nothing_is_overwritten_unless_forced(files, run):
    (files / "frf.npz").write_text("precious")
    arguments = ["random.npz", "--dt", "0.01"]
    code, _, err = run(arguments)
    assert (code, (files / "frf.npz").read_text()) == (2, "precious")
    assert "pass --force" in err
    assert run([*arguments, "--force"])[0] == 0
    assert rid.load("frf.npz").bound is not None


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["missing.csv"], "missing.csv: there is no such file"),
        (["done.npz"], "done.npz holds frequency data; a time record is needed"),
        (["random.npz"], "random.npz: no 'time' found; give --dt"),
        (["random.npz", "--dt", "-1"], "--dt must be positive; got -1"),
        (["run1.csv", "run1.csv"], "run1.csv is given twice"),
        (["run1.csv", "--period", "50"], "in fewer than 2 experiments, are told apart over 31 spectral lines"),
        (["run1.csv", "loop.npz"], "same shape of u"),
        (
            ["run1.csv", "run2.csv", "--period", "70"],
            "periods of 70; cut it to 560 samples (--first 560) or correct --period",
        ),
        (["run1.csv", "run2.csv", "--period", "1"], "--period must be at least 2; got 1"),
        (["run1.csv", "run2.csv", "--period", "600"], "give at least two periods (--period in samples)"),
        (["run1.csv", "run2.csv", "--period", "100", "--method", "local"], '--period belongs to method="periodic"'),
        (["run1.csv", "run2.csv", "--method", "fast"], "--method must be one of periodic, local, welch; got 'fast'"),
        (
            ["run1.csv", "run2.csv", "--period", "100", "--probability", "95"],
            "--probability must be between 0 and 1; got 95",
        ),
        (
            ["run1.csv", "run2.csv", "--period", "100", "--lines", "80"],
            "--lines must be whole numbers from 0 to period//2 = 50",
        ),
        (["run1.csv", "run2.csv", "--period", "100", "--lines", "1:9:0"], "--lines must be numbers such as 11:250"),
        (["run1.csv", "run2.csv", "--period", "100", "--lines", "1::9"], "--lines must be numbers such as 11:250"),
        (["run1.csv", "run2.csv", "--period", "100", "--lines", "1:99999999999"], "beyond half of the 600 samples"),
        (["run1.csv", "run2.csv", "--period", "100", "--lines", "odd"], "or a file of robustid excite; got 'odd'"),
        (["run1.csv", "run2.csv", "--period", "100", "--lines", "play.csv"], "leave --period out"),
        (["run1.csv", "run2.csv", "--method", "local", "--lines", "play.csv"], "leave --method local out"),
        (["random.npz", "--dt", "0.02", "--lines", "play.csv"], "designed for dt = 0.01 s; the records have 0.02 s"),
        (["run1.csv", "run2.csv", "--lines", "run1.csv"], "run1.csv"),
        (["plain1.csv"], "plain1.csv: no 'u' found; name it by --time-field u=NAME. The file has time, iq"),
        (["plain1.csv", "--time-field", "u=iq", "--time-field", "y=c"], "--time-field y = 'c' isn't in the file"),
        (["plain1.csv", "--time-field", "u"], "--time-field must be ROLE=NAME, such as u=current; got 'u'"),
        (["plain1.csv", "--time-field", "dt=a", "--time-field", "dt=b"], "--time-field dt is given 2 times"),
        (["still.npz", "--period", "100"], "RECORD: input u is constant (0): it excites nothing"),
        (["run1.csv", "run2.csv", "--initial", "soon"], "--initial must be one of rest, free, periodic; got 'soon'"),
        (["run1.csv", "run2.csv", "-o", "frf.uff"], "--output frf.uff must end in .npz, .csv or .mat"),
        (["run1.csv", "run2.csv", "-o", "run1.csv", "--force"], "run1.csv is one of the files to be read"),
        (["run1.csv", "run2.csv", "--report", "nowhere/a.html"], "the folder nowhere does not exist"),
    ],
)
def test_misuse_is_one_sentence_and_writes_nothing(arguments, sentence, files, run):
    with command_line.nothing_written():
        command_line.refused(run(arguments), sentence)


def test_interrupted_leaves_nothing(files, run, monkeypatch):
    command_line.interrupted(run, ["random.npz", "--dt", "0.01"], monkeypatch)


def test_arrays_are_addressed_and_their_axes_named(tmp_path, run):
    """Two files of arrays with several axes: the records of the command line are those of the library; a refusal is a command."""
    rng = np.random.default_rng(4)
    u = np.tile(rng.standard_normal((40, 1, 3, 1)), (1, 1, 1, 2))
    y = 0.5 * u + 0.01 * rng.standard_normal(u.shape)
    np.save(tmp_path / "u_rig.npy", u)
    np.save(tmp_path / "y_rig.npy", y)
    path = str(tmp_path / "u_rig.npy")
    code, _, err = run([path, "-o", str(tmp_path / "g.npz")])
    line = "--time-field 'u=[:]' --time-field y=y_rig.npy --axes time,signal,realisation,period --dt 1.0"
    assert code == 2
    assert line in err
    options = [word.strip("'") for word in line.split()]
    code, out, err = run([path, *options, "--period", "40", "-o", str(tmp_path / "g.npz")])
    assert code == 0, err
    assert "3 realisations, each time record, 80 samples" in err + out
    given = {"fields": {"u": "[:]", "y": "y_rig.npy"}, "axes": "time,signal,realisation,period", "dt": 1.0}
    same(rid.load(tmp_path / "g.npz"), estimate_frf(rid.load(path, **given), period=40))
    code, _, err = run([path, *options[:-2], "--rate", "-1", "-o", "x.npz"])
    assert code == 2
    assert "--rate must be above 0" in err or "--rate must be positive" in err


def test_a_period_that_the_input_shows_is_offered_as_a_command_that_takes_it(tmp_path, monkeypatch, run):
    """Its last, incomplete period is cut off; said with a period or with another method nothing is offered."""
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(4)
    u = np.resize(rng.standard_normal(200), 900)
    y = scipy.signal.lfilter([0.2], [1, -0.8], u) + 0.01 * rng.standard_normal(u.size)
    rid.save("run.csv", rid.TimeRecord(u, y, dt=0.01))
    code, out, _ = run(["run.csv", "-o", "frf.npz"])
    assert code == 0
    offered = out.rpartition("undo the fault of the data: ")[2].strip()
    assert offered == "robustid frf run.csv -o frf.npz --force --first 800 --period 200"
    code, out, _ = run(shlex.split(offered)[2:])
    assert code == 0
    assert "undo the fault" not in out
    frf = rid.load("frf.npz")
    np.testing.assert_allclose(frf.freq_hz, np.rint(2 * frf.freq_hz) / 2, rtol=1e-12)  # lines of the period, 2 s
    truth = 0.2 / (1 - 0.8 * np.exp(-0.01j * frf.omega))
    assert np.all(np.abs(frf.values[:, 0, 0] - truth) <= frf.bound.outer_radius[:, 0, 0])
    assert not frf.faults
    assert "undo the fault" not in run(["run.csv", "-o", "other.npz", "--method", "local"])[1]

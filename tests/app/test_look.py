"""A look into files, the run file that it writes, and keys by their meaning."""

import re

import control
import numpy as np
import pytest
import scipy.io
from typer.testing import CliRunner

import robustid as rid
from robustid.app.cli.main import app
from robustid.app.draft import drafted_run_file
from robustid.app.load_save import load_result
from robustid.app.run.run_file import read_run_file
from robustid.data import FaultKind
from robustid.errors import FileFormatError, InputError
from robustid.formats import load_model, readers
from support.command_line import words as command


@pytest.fixture(name="folder")
def _folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    data = rid.datasets.flexible_structure(lines=20, samples=12)
    rid.save("frf.csv", data.frequency)
    rid.save("wrong.csv", rid.prepare.correct(data.frequency, "conjugate"))
    rid.save("record.csv", data.time)
    np.savez("bench.npz", run=np.random.default_rng(0).standard_normal((60, 2)))
    (tmp_path / "sweep.csv").write_text("f,gain,phase\n" + "\n".join(f"{k},{-k},{-10 * k}" for k in range(1, 20)))
    return tmp_path


def test_a_look_says_what_is_there_what_is_odd_and_how_to_go_on(folder):
    found = rid.look("frf.csv")
    assert isinstance(found.data, rid.FrequencyResponse)
    assert found.faults == ()
    assert "as Hz up to 131.9 Hz; as rad/s up to 21 Hz" in str(found)
    assert found.next[0] == 'rid.load("frf.csv")'
    assert "conjugated" in rid.look("wrong.csv").faults[0].words
    told = rid.look("sweep.csv")
    assert told.data is None
    assert tuple(map(str, told.faults)) == (
        "gain has negative values: a magnitude in decibels",
        "phase goes to 190: a phase in degrees",
    )
    unclear = rid.look("bench.npz")
    assert unclear.data is None
    assert isinstance(eval(unclear.next[0]), rid.TimeRecord)  # the line to go on with works as it stands
    assert isinstance(rid.look("bench.npz", **unclear.arguments).data, rid.TimeRecord)


def test_the_run_file_of_a_look_can_be_read_as_it_is(folder):
    text = drafted_run_file([rid.look(name) for name in ("frf.csv", "record.csv", "bench.npz")], folder).text
    (folder / "run.toml").write_text(text)
    read = read_run_file("run.toml")
    assert text.count("[[record]]") == 2
    assert text.count("[[frequency]]") == 1
    assert 'use = "samples"' in text
    assert "# Check these lines: bench.npz" in text
    assert [source.file for source in read.record] == ["record.csv", "bench.npz"]
    assert read.record[1].fields == {"u": "run[:,0]", "y": "run[:,1]"}


def test_measured_periods_and_faults_stand_in_the_run_file(folder):
    u = np.tile(np.random.default_rng(0).standard_normal(50), 6)
    rid.save("periodic.csv", rid.TimeRecord(u, np.convolve(u, [0, 1, 0.5])[:300], dt=0.01))
    text = drafted_run_file([rid.look("periodic.csv"), rid.look("wrong.csv")], folder).text
    assert re.search(r"^period = 50  #", text, re.M)
    assert "# Looks odd: the phase has the wrong sign" in text


def test_a_two_sided_spectrum_and_a_bound_from_the_scatter_are_said(folder):
    rng = np.random.default_rng(0)
    np.save("spectrum.npy", np.fft.fft(rng.standard_normal(64)))
    assert str(rid.look("spectrum.npy").faults[-1]).endswith('keep rows 0 to 32, "[:33]"')
    halved = rid.load("spectrum.npy", fields={"values": "[:33]"}, start=0.0, step=1.0, frequency_unit="Hz")
    assert halved.omega.size == 33
    omega = np.linspace(1, 20, 80)
    noise = 0.001 * (rng.standard_normal(80) + 1j * rng.standard_normal(80))
    rid.save("sweep.csv", rid.FrequencyResponse(omega, 1 / (100 - omega**2 + 1j * omega) + noise))
    found = rid.look("sweep.csv")
    assert "from the scatter of the response around a smooth model" in found.summary()
    assert found.next[1] == "robustid identify --frequency sweep.csv --report report.html"
    assert re.search(r'^# bound = "5%".*from the scatter', drafted_run_file([found], folder).text, re.M)


def test_look_and_new_on_the_command_line(folder, capsys, monkeypatch):
    assert command(["look", "frf.csv", "record.csv", "sweep.csv"], capsys, monkeypatch)[0] == 0
    code, out, _ = command(["look", "frf.csv", "wrong.csv", "-v"], capsys, monkeypatch)
    assert code == 4
    assert "evenly spaced by" in out
    assert "looks odd: the phase has the wrong sign" in out
    code, out, _ = command(["new", "frf.csv", "record.csv", "-o", "mine.toml"], capsys, monkeypatch)
    assert code == 0
    assert "robustid run mine.toml -o mine" in out
    code, _, err = command(["new", "frf.csv", "-o", "mine.toml"], capsys, monkeypatch)
    assert code == 2
    assert "mine.toml exists" in err
    assert read_run_file("mine.toml").frequency[0].file == "frf.csv"


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ('[[record]]\nfile = "a.csv"\ninput = "u"', "it is called 'fields': signals are named by their roles"),
        ('[[record]]\nfile = "a.csv"\nsample_time = 0.1', "it is called 'dt'"),
        ('[[frequency]]\nfile = "a.csv"\nnoise = 0.1', "it is called 'bound'"),
        ("[prior]\nK = 2.0", "it is called 'gain_bound'"),
        ("[modes]\npoles = [3.0]", "it is called 'hz'"),
        ("[modes]\nK = 2.0", r"gain_bound, in \[prior\]"),
    ],
)
def test_unknown_keys_are_named_by_their_meaning(line, words, folder):
    (folder / "run.toml").write_text(line)
    with pytest.raises(InputError, match=words):
        rid.run("run.toml", folder / "out")


def test_a_file_that_may_be_both_begins_as_the_response_that_its_fields_name(tmp_path):
    """Analysers put record, spectra and response into one file."""
    hz, time = np.linspace(0, 500, 401, dtype=np.float32), np.arange(1024, dtype=np.float32) / np.float32(1280)
    names = {"Time_domain": time, "Time_chan_1": np.sin(time), "Time_chan_2": np.cos(time), "Freq_domain": hz}
    names |= {"PSD_chan_1": hz, "Hf_chan_2": 1 / (1 + 1j * hz), "Hf_coh_chan_2": hz / 500}
    scipy.io.savemat(tmp_path / "analyser.mat", names)
    found = rid.look(tmp_path / "analyser.mat")
    assert "can't tell" in found.refusal
    text = drafted_run_file([found], tmp_path).text
    assert "[[frequency]]" in text
    assert "[[record]]" not in text
    assert '"values" = "Hf_chan_2"' in text
    assert re.search(r'^# bound = "5%".*without it: one is taken from the data', text, re.M)


@pytest.mark.parametrize("name", ["look", "identify"])
def test_a_file_is_parsed_once(name, tmp_path, monkeypatch):
    rid.save(tmp_path / "frf.csv", rid.datasets.flexible_structure(lines=6).frequency)
    parsed, reader = [], readers._reader
    monkeypatch.setattr(readers, "_reader", lambda path, *rest: parsed.append(path.name) or reader(path, *rest))
    monkeypatch.chdir(tmp_path)
    given = ["--frequency", "frf.csv", "--mode", "none", "--gain", "1", "--decay-rate", "1.1", "--no-reduce"]
    assert CliRunner().invoke(app, ["look", "frf.csv"] if name == "look" else [name, *given]).exit_code in (0, 3)
    assert parsed == ["frf.csv"]


def test_a_large_model_is_told_by_its_size_and_modes_and_a_record_by_the_names_it_was_read_with(tmp_path):
    poles = -np.arange(1.0, 60.0)
    matrix = np.diag(poles)
    matrix[:2, :2] = [[-0.5, 40.0], [-40.0, -0.5]]
    rid.save(tmp_path / "big.npz", control.ss(matrix, np.ones((59, 2)), np.ones((3, 59)), np.zeros((3, 2))))
    said = rid.look(tmp_path / "big.npz").summary()
    assert (
        "read as a model of 59 states, 3 outputs and 2 inputs, continuous time; least damped of 1 modes: 6.3667 Hz"
        in said
    )
    assert len(said.splitlines()) < 12
    u = np.tile(np.random.default_rng(2).standard_normal(50), 8)
    rows = np.column_stack(
        [np.arange(400) * 0.01, u, np.roll(u, 1) + 1e-3 * np.random.default_rng(3).standard_normal(400)]
    )
    np.savetxt(tmp_path / "bench.csv", rows, delimiter=",", header="t,force,position", comments="")
    found = rid.look(tmp_path / "bench.csv", fields={"time": "t", "u": "force", "y": "position"})
    assert found.step[1][2:] == [
        *("--time-field", "time=t", "--time-field", "u=force", "--time-field", "y=position"),
        *("--period", "50"),
    ]


def test_a_time_of_one_sample_less_gives_its_step_and_the_speed_of_a_motor_is_no_frequency(
    tmp_path, capsys, monkeypatch
):
    """The lines of `new` are read as they stand."""
    monkeypatch.chdir(tmp_path)
    y, u = np.random.default_rng(0).standard_normal((2, 200))
    time = 0.004 * np.arange(200)
    scipy.io.savemat("beam.mat", {"times": time[:-1], "inputvalues": u[:, None], "outputvalues": y[:, None]})
    found = rid.look("beam.mat")
    assert (found.arguments, found.unknown) == ({"dt": 0.004}, ())
    assert "give `dt=0.004`, the step of that time, instead" in found.refusal
    assert rid.load("beam.mat", **found.arguments).dt == 0.004
    _, _, said = command(["frf", "beam.mat"], capsys, monkeypatch)
    assert "give --dt 0.004" in said
    table = np.column_stack([time, u, y])
    np.savetxt("motor.txt", table, header="time\tiq\tomega_m", comments="", delimiter="\t")
    found = rid.look("motor.txt")
    assert found.arguments == {"fields": {"time": "time", "u": "iq", "y": "omega_m"}}
    assert isinstance(rid.load("motor.txt", **found.arguments), rid.TimeRecord)
    for name in ("beam.mat", "motor.txt"):
        assert command(["new", name, "-o", f"{name}.toml"], capsys, monkeypatch)[0] == 0
        (source,) = read_run_file(f"{name}.toml").record
        assert source.dt == (0.004 if name == "beam.mat" else None)


def test_a_column_of_time_alone_says_that_a_file_is_a_record(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "bench.csv").write_text("time [ms],force [N],acc [g]\n0,1,0\n1,1,.5\n2,1,.75\n3,1,.8\n")
    found = rid.look("bench.csv")
    assert (found.kind, found.argument) == ("time", "fields")
    assert found.arguments["fields"] == {"time": "time [ms]", "u": "force [N]", "y": "acc [g]"}
    assert "(1000 samples per second)" in found.rows[0][2]
    assert rid.look("bench.csv", **found.arguments).data.dt == 1e-3


@pytest.mark.parametrize("read", [load_result, load_model])
def test_a_folder_without_a_result_is_called_that(tmp_path, read):
    with pytest.raises(FileFormatError, match="is a folder without a saved result"):
        read(tmp_path)


def test_a_look_shows_the_faults_of_what_a_new_run_file_reads(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    u, noise = np.random.default_rng(0).standard_normal((2, 1000))
    y = np.convolve(u, [0, 0.5, 0.3, 0.2])[:1000] + 0.01 * noise
    time = np.arange(1000) * 1e-3
    y[400] = 6
    np.savetxt("bench.csv", np.c_[time, u, y], header="time [s],motor [A],encoder", delimiter=",", comments="")
    time[600:] += 0.5
    np.savetxt("gap.csv", np.c_[time, u, y], header="time,u,y", delimiter=",", comments="")
    found = rid.look("gap.csv")
    assert (found.argument, found.unknown) == (None, ())
    assert found.arguments == {"fields": {name: f"{name}[0:600]" for name in ("time", "u", "y")}}
    assert rid.load("gap.csv", **found.arguments).time.size == 600
    for name in ("bench", "gap"):
        looked = rid.look(f"{name}.csv")
        assert (looked.found, looked.faulty) == (None, True)
        assert [fault.kind for fault in looked.faults] == [FaultKind.SPIKE]
        code, _, _ = command(["look", f"{name}.csv"], capsys, monkeypatch)
        assert code == 4
        assert command(["new", f"{name}.csv", "-o", f"{name}.toml"], capsys, monkeypatch)[0] == 0
        (source,) = read_run_file(f"{name}.toml").record
        assert source.fields == looked.arguments["fields"]

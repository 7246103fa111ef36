"""The command line as a whole: how runs end, what help teaches, what a start loads."""

import io
import subprocess
import sys
import time

import pytest

import robustid as rid
from robustid.app.cli.main import COMMANDS, main
from robustid.app.cli.screen import told
from robustid.app.cli.written_files import new_folder
from support.command_line import COMMAND, SHORT, nothing_written

pytestmark = pytest.mark.quick
TAUGHT = {
    "fit": ("--rigid-body", "--roll-off", "auto", "0 converged, verified", "Example"),
    "frf": ("RECORD...", "--period", "Period of the excitation", "robustid excite", "0 written", "Example"),
    "identify": ("freq_hz", "phase_deg", "dt, Ts or T", "smallest K", "Hankel", "3 inconsistent", "--band", "--first"),
}


@pytest.mark.parametrize("command", COMMANDS)
def test_help_teaches(run, command):
    code, out, _ = run([command, "--help"])
    assert code == 0
    assert len(out) > 400
    text = " ".join(out.replace("│", " ").split())
    for words in (f" {command} [OPTIONS]", *TAUGHT.get(command, ())):
        assert words in text


def test_version_and_the_list_of_commands(run):
    code, out, _ = run(["--version"])
    assert (code, out.strip()) == (0, f"robustid {rid.__version__}")
    code, out, _ = run(["--help"])
    assert all(f" {command} " in out for command in COMMANDS)


def test_a_start_loads_nothing_heavy():
    """The list of commands, the version and most explanations need no arrays: who asks what there is doesn't wait for them."""
    heavy = ["numpy", "scipy", "control", "cvxpy", "matplotlib", "plotly", "jinja2", "h5py"]
    code = (
        "import sys\nfrom robustid.app.cli.main import main\n"
        "for words in ['--help', '--version', 'run --help', 'bounds --help', 'reduce --help', 'excite --help']:\n"
        "    sys.argv = ['robustid', *words.split()]\n"
        "    try:\n        main()\n"
        f"    except SystemExit:\n        print(words, [m for m in {heavy} if m in sys.modules], file=sys.stderr)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    lines = done.stderr.splitlines()
    assert len(lines) == 6
    assert all(line.endswith(" []") for line in lines), lines


@pytest.mark.parametrize(
    ("called", "meant"),
    [
        ("identify frf.csv step.csv -o model", "identify --frequency frf.csv --time step.csv -o model"),
        ("identify -o frf.csv frf.csv", "identify -o frf.csv --frequency frf.csv"),
        ("refute bounds step.csv", "refute bounds --time step.csv"),
        ("report bounds bounds", "report --bounds bounds --bounds bounds"),
        ("excite", "excite --band 1:500 --dt 1e-4 --period 10000"),
        ("look", "look bench.mat"),
    ],
)
def test_files_that_stand_alone_get_their_options_and_what_is_missing_an_example(files, run, called, meant):
    """Files of measurements and of bounds, told apart by what they hold; the line is pasted as it is."""
    saved = rid.identify(rid.MixedProblem(time=rid.load("step.csv"), prior=rid.Prior(gain_bound=9.0, decay_rate=1.1)))
    rid.worst_case_error(saved, omega=[1.0], directions=3).save("bounds")
    code, _, err = run(called.split())
    assert code == 2
    assert err.splitlines()[1].startswith(f"  robustid {meant}")


def test_an_option_without_its_value_does_not_take_the_next_one(files, run):
    code, _, err = run(["identify", "--frequency", "frf.csv", "--passive", "-o", "model"])
    assert code == 2
    assert err.startswith("error: --passive needs a value, and -o is another option")


@pytest.mark.parametrize("called", ["identify nothing.csv", "verify result frf.csv", "bounds frf.csv", "fit step.csv"])
def test_a_file_that_a_command_cannot_use_is_refused_by_name(files, run, called):
    code, _, err = run(called.split())
    assert code == 2
    assert called.split()[-1] in err.splitlines()[0]


def test_an_unknown_command_is_named_with_the_nearest(run):
    code, _, err = run(["identfy"])
    assert code == 2
    assert "Did you mean 'identify'?" in err


@pytest.mark.parametrize(
    ("failure", "code", "words"),
    [
        (KeyboardInterrupt(), 130, "interrupted"),
        (rid.errors.SolverError("no solver"), 1, "no solver"),
        (PermissionError(13, "Permission denied", "result.npz"), 2, "result.npz: Permission denied"),
        (ZeroDivisionError("oops"), 70, "internal error, please report"),
    ],
)
def test_every_ending_has_its_code_and_leaves_nothing(folder, run, monkeypatch, failure, code, words):
    def fail(*_, **__):
        raise failure

    # After the long part, before anything is written; Ctrl-C leaves out the page alone there, and ends what is before.
    place = "app.run.sequence.identified" if code == 130 else "report.render_report"
    monkeypatch.setattr(f"robustid.{place}", fail)
    with nothing_written():
        got, _, err = run([*COMMAND, *SHORT, "--report", "page.html"])
    assert got == code
    assert words in err
    assert ("Traceback" in err) == (code == 70)


def test_demo_never_overwrites(tmp_path):
    names = [new_folder(tmp_path / "robustid-demo").name for _ in range(3)]
    assert names == ["robustid-demo", "robustid-demo-2", "robustid-demo-3"]
    (tmp_path / "file").write_text("")
    with pytest.raises(rid.InputError, match="can't be created"):
        new_folder(tmp_path / "file" / "demo")


@pytest.mark.usefixtures("files")
def test_a_pipe_that_is_not_utf8_gets_question_marks(monkeypatch):
    pipe = io.TextIOWrapper(io.BytesIO(), encoding="ascii")
    monkeypatch.setattr("sys.stdout", pipe)
    monkeypatch.setattr("sys.argv", ["robustid", *COMMAND, *SHORT])
    with pytest.raises(SystemExit) as stop:
        main()
    pipe.flush()
    out = pipe.buffer.getvalue()
    assert not stop.value.code
    assert b"Consistent" in out
    assert b"?" in out
    assert b"searching" not in out
    assert "margin and model" in out.decode("ascii")  # one line per long step where there is no terminal


def test_long_steps_say_every_tenth_and_what_is_left_after_two_seconds(monkeypatch):
    """A step that is over sooner says its name alone; the same step begun again goes on counting."""
    clock, lines = [0.0], []
    monkeypatch.setattr(time, "monotonic", lambda: clock[0])
    tell = told(lines.append, " …")
    tell("quick", 0, 0)
    for k in range(1, 11):
        clock[0] += 0.1
        tell("quick", k, 10)
    tell("slow", 0, 0)
    for k in range(1, 101):
        clock[0] += 1.0
        tell("slow", k, 100)
    assert lines[:2] == ["quick …", "slow …"]
    assert lines[2] == "slow: 4 of 100, about 96 s left"
    assert lines[-1] == "slow: 100 of 100"
    assert len(lines) == 2 + 11

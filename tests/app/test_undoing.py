"""What undoes a fault of the data is offered as it is pasted, and what is pasted runs: the fault is gone then."""

import dataclasses
import re
import shlex
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import robustid as rid
from robustid.app.cli import experiment
from robustid.app.cli.main import app
from robustid.app.run.measurements import Measured, Origins, Place
from robustid.app.run.run_file import read_run_file
from robustid.app.run.undoing import in_run_file, with_option
from robustid.data import Fault, PlacedFault
from support.faulty_files import CLASS, CLASS_KEYS, DT, KINDS, faulty, record, response
from support.run_files import QUICK, ask, only_identify

CALLED = ["identify", "--frequency", "a response.csv", "--time", "step.csv", *CLASS]


def ran(arguments):
    """Output of a command, whose exit code says whether a fault is left that nothing has undone."""
    done = CliRunner().invoke(app, [str(one) for one in arguments])
    assert done.exit_code in (0, 3, 4), done.output
    assert (done.exit_code == 4) == bool(
        re.search("Fault of the data|Question about the data|looks odd", done.output)
    ), done.output
    return done.output


def pasted(output):
    """The line below the one that says that it undoes the fault, as a shell takes it."""
    lines = output.splitlines()
    (place,) = (k for k, line in enumerate(lines) if line.startswith("next: undo the fault of the data"))
    words = shlex.split(lines[place + 1])
    assert words[0] == "robustid"
    return words[1:]


@pytest.fixture(name="place")
def _place(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "90")  # what is pasted is not wrapped
    only_identify(monkeypatch)
    return tmp_path


QUICK_KINDS = ("sign",)  # one of the response is undone where there are two, below
ALL_KINDS = [kind if kind in QUICK_KINDS else pytest.param(kind, marks=pytest.mark.slow) for kind in KINDS]


@pytest.mark.parametrize("kind", ALL_KINDS)
def test_the_command_that_was_called_is_offered_with_the_correction_and_runs(place, kind):
    frf, one = faulty(kind)
    rid.save("a response.csv", frf)
    rid.save("step.csv", one)
    output = ran([*CALLED, "--report", "page.html"])
    assert "Fault of the data" in output
    again = pasted(output)
    assert again[: len(CALLED)] == CALLED
    assert shlex.join(again[:3]) in (place / "page.html").read_text().replace("&#39;", "'").replace(
        "</span> <span>", " "
    )
    output = ran(again)
    assert "fault of the data" not in output.lower()
    assert rid.load("result").consistent


def test_a_clean_measurement_is_offered_nothing(place):
    frf, one = faulty("clean")
    rid.save("a response.csv", frf)
    rid.save("step.csv", one)
    assert "fault" not in ran(CALLED).lower()


def test_of_several_files_only_the_one_with_the_fault_is_corrected(place):
    rid.save("frf.csv", response())
    rid.save("good.csv", record(0))
    rid.save("bad.csv", rid.prepare.correct(record(1), "negate"))
    called = ["identify", "--frequency", "frf.csv", "--time", "good.csv", "--time", "bad.csv", *CLASS]
    again = pasted(ran(called))
    assert again == [*called, "--force", "--time-correct", "bad.csv: negate"]
    assert "fault" not in ran(again).lower()
    wrong = CliRunner().invoke(app, [*called, "--time-correct", "other.csv: negate", "--force"])
    assert "--time-correct names other.csv, which is none of the files" in str(wrong.exception)


def test_two_faults_are_undone_one_after_the_other(place):
    frf, _ = faulty("outlier")
    rid.save("a response.csv", frf)
    rid.save("step.csv", faulty("sign")[1])
    first = pasted(ran(CALLED))
    second = pasted(ran(first))
    corrections = ["--frequency-correct", "leave out 23", "--force", "--time-correct", "negate"]
    assert sorted(second[len(CALLED) :]) == sorted(corrections)
    assert "fault" not in ran(second).lower()


@pytest.mark.parametrize(
    ("given", "made"),
    [
        ([], ["--time-correct", "negate"]),
        (["--time-correct", "detrend", "-o", "x"], ["--time-correct", "detrend, negate", "-o", "x"]),
        (["--time-correct=detrend"], ["--time-correct=detrend, negate"]),
    ],
)
def test_corrections_that_were_called_stay_before_the_new_one(given, made):
    assert with_option(given, "--time-correct", "negate") == made


def put(path, line, place):
    """Paste a line where the words say: below the head of a section by its number, or of a section that may be missing."""
    lines = path.read_text().splitlines()
    head, number = re.search(r"(\[+\w+\]+)(?: (\d+))?", place).groups()
    heads = [k for k, one in enumerate(lines) if one == head]
    if not heads:
        lines += [head]
        heads = [len(lines) - 1]
    at = heads[int(number or 1) - 1]
    if "in place of" in place:
        name = line.split(" = ")[0]
        gone = next(k for k in range(at, len(lines)) if lines[k].startswith(f"{name} = "))
        del lines[gone]
    lines.insert(at + 1, line)
    path.write_text("\n".join(lines) + "\n")


def offered(output):
    """Place, line and command of the run file that is to be mended."""
    lines = output.splitlines()
    (k,) = (k for k, line in enumerate(lines) if line.startswith("next: undo the fault of the data, in "))
    assert lines[k + 2] == "then:"
    place, line, then = lines[k].removeprefix("next: undo the fault of the data, in "), lines[k + 1], lines[k + 3]
    line, then = line.strip(), then.strip()
    return place, line, shlex.split(then)[1:]


@pytest.mark.parametrize("kind", ["outlier", "sign"])
def test_the_line_of_a_run_file_is_offered_with_its_place_and_runs(place, kind, unreduced, request):
    frf, one = faulty(kind)
    rid.save("frf.csv", frf)
    rid.save("other.csv", record(1))
    rid.save("step.csv", one)
    files = [] if kind == "outlier" else ["other.csv", "step.csv"]
    records = [{"file": name, "use": "samples"} for name in files]
    ask(place, {"frequency": [{"file": "frf.csv"}], "record": records}, CLASS_KEYS, QUICK, name="bench.toml")
    output = ran(["run", "bench.toml", "-o", "out"])
    where, line, then = offered(output)
    named = "[[frequency]] 1 (frf.csv)" if kind == "outlier" else "[[record]] 2 (step.csv)"
    assert where.rstrip(":") == f"bench.toml, {named}"
    page = (place / "out" / "report.html").read_text()
    assert line.replace('"', "&#34;") in page
    put(place / "bench.toml", line, where)
    request.getfixturevalue("unpaged")
    output = ran(then)
    assert "fault" not in output.lower()


@pytest.mark.parametrize(
    ("fault", "place", "line"),
    [
        (Fault("outlier", "off", correction="leave out 23 50"), "[frequency_points]", "leave_out_hz = [23.0, 50.0]"),
        (Fault("noise only", "n", correction="leave out above 30"), "[frequency_points]", "band_hz = [0.0, 30.0]"),
        (Fault("noise only", "n", correction="leave out below 2"), "[frequency_points]", "band_hz = [2.0, 50.0]"),
        (Fault("offset", "o", correction="detrend", where="output y"), None, ""),  # of all records of two files
        (Fault("sign", "s", correction="negate", where="output y", record=3), "[[record]] 2 (b.csv)", 'correct = ["negate"]'),
        (Fault("sign", "s", correction="negate", where="output y", record=1), None, ""),  # one of two in a file
        (Fault("phase sign", "p", correction="conjugate"), None, ""),  # of an estimate
        (Fault("exchanged", "e", correction="exchange", record=3), "[[record]] 2 (b.csv)", 'correct = ["exchange"]'),
    ],
)  # fmt: skip
def test_faults_of_an_estimate_are_undone_in_the_records_or_by_leaving_points_out(fault, place, line):
    """The response of three records, two of them in one file."""
    run = read_run_file({"record": [{"file": "a.csv"}, {"file": "b.csv"}]})
    a, b = Place("record", 0), Place("record", 1)
    data = Measured((rid.FrequencyResponse([1.0], [1.0], dt=DT),), (), origins=Origins((None,), (), (a, a, b)))
    found = in_run_file(run, "x.toml", "robustid run", data, [PlacedFault(fault, "frequency", 0)])
    assert (found and found.place.removeprefix("x.toml, ")) == place
    assert not found or found.paste == line


def test_keys_that_stand_in_the_run_file_are_replaced_by_all_their_values():
    source, points = (
        {"file": "a.csv", "correct": ["negate"], "digest": "x"},
        {"leave_out_hz": [3.0], "band_hz": [1.0, 40.0]},
    )
    run = read_run_file({"frequency": [source], "frequency_points": points})
    data = Measured((), (), origins=Origins((Place("frequency", 0), None)))
    for number, correction, line in (
        (0, "leave out 5", 'correct = ["negate", "leave out 5"]'),
        (1, "leave out 5", "leave_out_hz = [3.0, 5.0]"),
    ):
        fault = PlacedFault(Fault("outlier", "off", correction=correction), "frequency", number)
        found = in_run_file(run, "x.toml", "robustid run", data, [fault])
        assert found.paste == line
        assert f"in place of its {line.split(' ')[0]} = ..." in found.place
        assert ("without its digest" in found.place) == (number == 0)


def test_look_and_new_offer_it_too(place):
    rid.save("a response.csv", faulty("conjugate")[0])
    line = next(one for one in ran(["look", "a response.csv"]).splitlines() if "robustid identify" in one)
    again = shlex.split(line)[1:]
    assert again[again.index("--frequency-correct") + 1] == "conjugate"
    assert "fault" not in ran([*again, *CLASS]).lower()
    everything = ran(["look", "a response.csv", "-v"]).splitlines()
    python = next(one for one in everything if "rid.load" in one).removeprefix("next: ")
    assert rid.prepare.response_faults(eval(python)) == ()


def test_a_fit_and_an_estimate_offer_it_too(place):
    rid.save("frf.csv", faulty("outlier")[0])
    again = pasted(ran(["fit", "frf.csv", "--order", "2"]))
    assert again == ["fit", "frf.csv", "--order", "2", "--force", "--frequency-correct", "leave out 23"]
    assert "fault of the data" not in ran(again).lower()


def test_an_estimate_is_made_again_of_corrected_records_or_its_points_are_left_out_in_the_next_command(place):
    rng = np.random.default_rng(0)
    u = 5 + rng.standard_normal(1200)
    y = np.convolve(u, [0, 0.5, 0.3, 0.1])[:1200]
    y[:5] = y[5]
    rid.save("bench.csv", rid.TimeRecord(u, y + 0.01 * rng.standard_normal(1200), dt=DT))
    called = ["frf", "bench.csv", "--initial", "rest", "-o", "g.npz"]
    told = CliRunner().invoke(app, called)
    assert told.exit_code == 0
    again = pasted(told.output)
    assert again == [*called, "--force", "--time-correct", "detrend"]
    assert "Fault of the data" not in CliRunner().invoke(app, again).output
    fault = Fault("outlier", "off", correction="leave out 23")
    off = dataclasses.replace(faulty("clean")[0], faults=(fault,))
    assert experiment._undoing(called, off, Path("g.npz"), [Path("bench.csv")]).paste == (
        "robustid identify --frequency g.npz --report report.html --frequency-correct 'leave out 23'"
    )


def test_without_a_command_the_correction_is_offered_as_python_takes_it():
    frf, one = faulty("sign")
    problem = rid.MixedProblem(frequency=frf, time=one, prior=rid.Prior(gain_bound=20.0, decay_rate=1.3))
    assert 'rid.prepare.correct(record, "negate")' in rid.identify(problem, accuracy=0.5)._repr_html_().replace(
        "&#34;", '"'
    )

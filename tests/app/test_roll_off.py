"""Roll-offs and weights of the prior in run files and on the command line."""

import tomllib

import numpy as np
import pytest
from typer.testing import CliRunner

import robustid as rid
from robustid.app.cli.main import app
from robustid.app.run.class_settings import PriorChoice
from robustid.app.run.run_file import RunFile, read_run_file
from robustid.app.run.settings import Modes
from support.cases import slow
from support.posed import proposed
from support.run_files import QUICK, ask

FEW = {"frequency": [{"file": "frf.npz"}], "modes": {"hz": [], "damping": []}} | QUICK


def test_a_run_file_states_the_roll_off_in_hz():
    prior = rid.Prior(gain_bound=0.2, decay=3.0, roll_off=2, corner=2 * np.pi * 40.0)
    stated = PriorChoice.of(prior, "a note")
    assert (stated.roll_off, stated.corner_hz) == (2, pytest.approx(40.0))
    again = stated.stated(0.01)
    assert again.corner == pytest.approx(prior.corner, rel=1e-15)
    assert (again.gain_bound, again.decay, again.roll_off) == (0.2, 3.0, 2)
    assert PriorChoice(roll_off=1, corner_hz=10.0).stated(None) is None
    assert PriorChoice(roll_off=1, corner_hz=10.0).shape(None) == {"roll_off": 1, "corner": pytest.approx(20 * np.pi)}


def test_half_a_roll_off_and_a_weight_are_refused():
    names = {n: f"--{n}" for n in ("gain_bound", "decay_rate", "decay", "roll_off", "corner_hz")}
    with pytest.raises(rid.InputError, match="--corner_hz is given without --roll_off"):
        PriorChoice(corner_hz=10.0).check(names)
    with pytest.raises(rid.InputError, match="--roll_off is given without --corner_hz"):
        PriorChoice(roll_off=2).check(names)
    both = PriorChoice(roll_off=2, corner_hz=1.0, weight=((1.0, 1.0), (2.0, 0.5)))
    with pytest.raises(rid.InputError, match="roll_off and --weight both say"):
        both.check(names | {"roll_off": "--roll_off", "weight": "--weight"})


@pytest.mark.parametrize("dt", [None, 0.002])
def test_a_weight_of_python_is_stated_by_its_numbers(dt):
    """Exactly the same class again, through the text of a run file."""
    weight = rid.advise.prior_weight([10.0, 60.0, 600.0], [1.0, 1.0, 0.01], dt=dt)
    prior = rid.Prior(gain_bound=0.2, weight=weight, **({"decay_rate": 1.1} if dt else {"decay": 3.0}))
    text = RunFile(prior=PriorChoice.of(prior, "a note")).text()
    again = read_run_file(tomllib.loads(text), sources=False).prior
    assert again.stated(dt) == prior
    assert again.weight_model["poles"]


@pytest.mark.usefixtures("unreduced", "unpaged")
def test_a_table_is_covered_in_the_time_of_the_data(tmp_path, monkeypatch):
    """In continuous time: the class of `prior_weight`, from a run file (which keeps the table) and from the command line."""
    monkeypatch.chdir(tmp_path)
    rows, omega = [[1.0, 1.0], [8.0, 0.1]], np.linspace(1.0, 60.0, 12)
    rid.save("frf.npz", rid.FrequencyResponse(omega, 1 / (1 + 1j * omega / 8) ** 2, bound=0.01))
    path = ask(tmp_path, FEW, {"prior": {"gain_bound": 3.0, "decay": 4.0, "weight": rows}})
    hz, level = np.array(rows).T
    prior = rid.Prior(gain_bound=3.0, decay=4.0, weight=rid.advise.prior_weight(2 * np.pi * hz, level))
    found = rid.run(path, "out")
    assert found.identification.prior == prior
    assert read_run_file("out/run.toml").prior.weight == ((1.0, 1.0), (8.0, 0.1))
    assert read_run_file("out/run.toml").prior.weight_model is None
    line = ["identify", "--frequency", "frf.npz", "--mode", "none", "--gain", "3", "--decay", "4", "--no-reduce"]
    assert CliRunner().invoke(app, [*line, "--weight", "1:1,8:0.1", "-o", "result"]).exit_code == 0
    assert rid.load("result").prior == prior


@pytest.mark.usefixtures("unreduced", "unpaged")
@pytest.mark.parametrize("points", [8, slow(12)])
def test_the_weight_stays_when_the_program_chooses_the_rest(tmp_path, monkeypatch, points):
    monkeypatch.chdir(tmp_path)
    omega = np.linspace(2.0, 60.0, points)
    rid.save("frf.npz", rid.FrequencyResponse(omega, 1 / (1 + 1j * omega / 20) ** 2, bound=0.02))
    weighted = {"prior": {"weight": [[2.0, 1.0], [20.0, 0.05]]}}
    path = ask(tmp_path, FEW, weighted)
    found = rid.run(path, "out")
    assert found.identification.prior.weight is not None
    again = rid.run("out/run.toml", "again")
    assert again.identification.prior == found.identification.prior
    assert rid.run(path, "out", resume=True).identification.margin == found.identification.margin


@pytest.mark.parametrize(
    ("prior", "words"),
    [
        ({"weight": [[1.0, 1.0]]}, "weight .rows .Hz, level..: .*two at least"),
        ({"weight": [[2.0, 1.0], [1.0, 1.0]]}, "weight .rows .Hz, level..: .*rise"),
        ({"weight": [1.0, 2.0]}, "weight, item 1, must be an array"),
        ({"weight_model": {"poles": []}}, "must be a table . zeros, poles, gain, dt"),
        ({"weight_model": {"zeros": [], "poles": [[1.0, 0.0]], "gain": 1.0, "dt": 0.0}}, "must be stable"),
        ({"roll_off": "auto", "weight": [[1.0, 1.0], [2.0, 0.5]]}, "roll_off and weight both say"),
    ],
)
def test_weights_that_are_none_are_refused(prior, words):
    with pytest.raises((rid.InputError, TypeError), match=words):
        read_run_file({"prior": {"gain_bound": 1.0, "decay": 1.0} | prior}, sources=False).prior.stated(None)


def test_the_roll_off_stays_when_the_program_chooses_the_rest():
    omega = np.linspace(2.0, 60.0, 12)
    frf = rid.FrequencyResponse(omega, 1 / (1 + 1j * omega / 20) ** 2, bound=0.02)
    asked = PriorChoice(roll_off=2, corner_hz=3.2)
    found = proposed([frf], prior=asked)[0].prior
    assert (found.roll_off, found.corner) == (2, pytest.approx(2 * np.pi * 3.2))
    assert rid.identify(rid.MixedProblem(frequency=frf, prior=found)).consistent


@pytest.mark.usefixtures("unreduced", "unpaged")
@pytest.mark.parametrize("points", [10, slow(15)])
def test_auto_takes_the_roll_off_that_the_response_shows(tmp_path, monkeypatch, points):
    """On the way of a run file and of the command line; with a stated gain bound too; a corner beside it is refused."""
    monkeypatch.chdir(tmp_path)
    omega = np.linspace(1.0, 60.0, points)
    frf = rid.FrequencyResponse(omega, 1 / (1 + 1j * omega / 8) ** 2, bound=0.002)
    asked = PriorChoice(gain_bound=1.0, decay=4.0, roll_off="auto")
    problem, chosen = proposed([frf], modes=Modes(hz=(), damping=()), prior=asked)
    assert problem.prior.roll_off == 2
    assert "falls as frequency^-2" in chosen["prior"].reason
    rid.save("frf.npz", frf)
    path = ask(tmp_path, FEW, {"prior": {"gain_bound": 1.0, "decay": 4.0, "roll_off": "auto"}})
    result = rid.run(path, "out")
    assert result.identification.problem.prior.roll_off == 2
    assert result.consistent
    with pytest.raises(rid.InputError, match="corner_hz is chosen too"):
        PriorChoice(roll_off="auto", corner_hz=3.0).check({n: n for n in ("gain_bound", "decay_rate", "decay")})

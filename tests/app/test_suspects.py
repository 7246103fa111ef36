"""A class that the program chooses is held against the experiments one by one: none that contradicts the others becomes a model."""

import tomllib

import numpy as np
import pytest

import robustid as rid
from robustid.app.run.class_settings import PriorChoice
from robustid.app.run.run_file import RunFile, read_run_file
from robustid.app.run.settings import Modes, Withheld
from robustid.errors import InputError
from robustid.report.identification_page import identification_page, identification_summary
from robustid.report.live import live_words
from support.cases import slow
from support.run_files import keep_whole
from support.suspect_data import KINDS, UNDONE, chosen, chosen_of_structure, records, responses, structure

TOLD = 0.02  # of clean data
# The modes of the stage and of the structure, which the program finds in seconds.
STATED = RunFile(modes=Modes(hz=(17.67, 140.0), damping=(0.01, 0.05)), withheld=Withheld(every=0))
OF_STRUCTURE = RunFile(modes=Modes(hz=(9.0, 17.67), damping=(0.1, 0.004), delay=1), withheld=Withheld(every=0))


def only(faults):
    (fault,) = faults
    return fault


def is_named(fault, name):
    assert fault.kind == KINDS[name]
    assert fault.correction.startswith(UNDONE[name])
    assert bool(fault.correction) == bool(UNDONE[name])


@pytest.mark.slow  # quick: the sign, by the whole below
@pytest.mark.parametrize("name", KINDS)
def test_a_record_that_the_response_contradicts_is_named_and_the_class_is_that_of_the_response(name):
    run, problem = chosen_of_structure(0, name)
    assert run.prior.without == ("time 1",)
    _, clean = chosen_of_structure(0)
    assert problem.prior.gain_bound <= 2 * clean.prior.gain_bound
    is_named(only(problem.data_faults), name)


@pytest.mark.parametrize("name", ["scale", *(slow(name) for name in ("plant", *KINDS))])
@pytest.mark.parametrize("place", [0, slow(1), slow(2)])
def test_one_response_of_three_is_named_wherever_it_stands(name, place):
    faults = ["clean"] * 3
    faults[place] = name
    run, problem = chosen(responses("stage", 0, faults), run=STATED if (name, place) == ("scale", 0) else None)
    assert run.prior.without == (f"frequency {place + 1}",)
    fault = only(problem.data_faults)
    assert fault.response == place + 1
    is_named(fault, name)


@pytest.mark.parametrize("name", ["sign", slow("late")])
def test_one_record_of_three_is_named(name):
    run, problem = chosen(records("stage", 0, [name, "clean", "clean"]), run=STATED if name == "sign" else None)
    assert run.prior.without == ("time 1",)
    is_named(only(problem.data_faults), name)
    assert only(problem.data_faults).record == 1


@pytest.mark.parametrize("samples", [12, slow(20)])
def test_what_stands_alone_against_the_others_is_named(samples):
    """Two records that agree with each other outvote the response."""
    responses_, (first,) = structure(0, "sign", samples=samples)
    _, (second,) = structure(1, "sign", samples=samples)
    run, problem = chosen((responses_, [first, second]), run=OF_STRUCTURE if samples == 12 else None)
    assert run.prior.without == ("frequency 1",)
    is_named(only(problem.data_faults), "sign")


@pytest.mark.slow
def test_records_that_agree_against_as_many_responses_are_named_together():
    (one,), (first,) = structure(0, "sign")
    (other,), (second,) = structure(1, "sign")
    run, problem = chosen(([one, other], [first, second]))
    assert run.prior.without == ("time 1", "time 2")
    assert [(fault.record, fault.correction) for fault in problem.data_faults] == [(1, "negate"), (2, "negate")]
    found = rid.diagnose(rid.identify(problem))
    assert [one.solves for one in found.causes[:2]] == [True, True]


@pytest.fixture(scope="module", params=[12, slow(20)])
def whole(request):
    """The data, with so many time samples, and the run of them."""
    data = structure(0, "sign", samples=request.param)
    with pytest.MonkeyPatch.context() as patch:
        keep_whole(patch)
        modes = [(9.0, 0.1), (17.67, 0.004)] if request.param == 12 else None  # the program finds the same in a second
        return data, rid.identify_reduced([*data[0], *data[1]], modes=modes, worst_case=False)


def test_the_whole_is_no_model_and_says_why_once(whole):
    data, whole = whole
    result = whole.identification
    assert not result.consistent
    assert whole.wider is None  # no worst case was asked for
    assert whole.run_file.prior.without == ("time 1",)
    _, clean = chosen(structure(0), run=OF_STRUCTURE) if len(data[1][0].u) == 12 else chosen_of_structure(0)
    assert result.problem.prior.gain_bound <= 2 * clean.prior.gain_bound
    is_named(only(result.problem.data_faults), "sign")
    assert sum("opposite sign" in sentence for sentence in whole.findings) == 1
    first = whole.diagnosis.causes[0]
    assert first.solves
    assert rid.identify(first.problem).consistent
    assert first.problem.data_faults == ()  # with the correction nothing is left to say
    for blocks in (identification_page(result, None, {}).head, identification_summary(result)):
        verdicts = [block for block in blocks if getattr(block, "key", None) is not None]
        assert [one.id == "data-fault" for one in verdicts] == [True] + [False] * (len(verdicts) - 1)
        assert ("undone by", '"negate"') in verdicts[0].numbers
        assert all(one.key != "consistent" for one in verdicts)
    assert live_words(result)[0] != "consistent"


def test_the_fault_is_kept_with_the_result_and_by_its_run_file(whole, tmp_path):
    data, whole = whole
    result = whole.identification
    result.save(tmp_path / "result")
    assert rid.load(tmp_path / "result.npz").problem.faults == result.problem.faults
    again = read_run_file(tomllib.loads(whole.run_file.text()), sources=False)
    assert again.prior.without == ("time 1",)
    _, problem = chosen(data, reference=True, run=again)
    assert problem.faults == result.problem.faults


@pytest.mark.parametrize("lines", [20, slow(60)])
def test_a_record_that_no_class_is_needed_for_is_named_once_and_not_chosen_from(lines):
    """`experiment_faults` contradicts it; of few lines it finds no correction, and the class does."""
    if lines == 20:
        data = structure(0, "sign", lines)
    else:
        data = responses("stage", 0, ["clean"], lines)[0], records("stage", 0, ["sign"], samples=40)[1]
    run, problem = chosen(data)
    assert run.prior.without == ("time 1",)
    assert only(problem.data_faults).correction == "negate"
    assert bool(problem.faults) == (lines == 20)
    result = rid.identify(problem)
    assert not result.consistent
    assert rid.diagnose(result).causes[0].solves


def test_one_experiment_is_held_against_nothing():
    (frf,), _ = structure(0)
    assert chosen(([frf], []))[0].prior.without is None


CLEAN = {
    "response and step": chosen_of_structure,
    "two responses": lambda seed: chosen(responses("stage", seed, ["clean"] * 2)),
    "three responses": lambda seed: chosen(responses("arm", seed, ["clean"] * 3)),
    "three records": lambda seed: chosen(records("stage", seed, ["clean"] * 3)),
}


@pytest.mark.parametrize(
    ("name", "seeds"), [("response and step", range(1))] + [slow(name, range(1000, 1200)) for name in CLEAN]
)
def test_clean_experiments_are_accused_of_nothing(name, seeds):
    accused = [seed for seed in seeds if CLEAN[name](seed)[0].prior.without]
    assert len(accused) <= TOLD * len(seeds), accused


@pytest.mark.slow
def test_a_step_that_tells_what_the_response_cannot_is_innocent():
    """A slow mode far below the lines of the response: the static gain is ten times what these show."""
    dt, rng = 0.01, np.random.default_rng(0)
    hz = np.linspace(12, 30, 15)
    z = np.exp(2j * np.pi * hz * dt)
    pole = np.exp((-0.01 + 1j) * 2 * np.pi * 20 * dt)
    plant = lambda z: 0.05 / (z - 0.95) + 0.02 * (1 - 0.9 / z) / ((1 - pole / z) * (1 - pole.conj() / z)) / z  # noqa: E731
    values = plant(z)
    frf = rid.FrequencyResponse(2 * np.pi * hz, values * (1 + 0.002 * rng.standard_normal(15)), bound=0.01, dt=dt)
    grid = np.exp(2j * np.pi * np.arange(4096) / 4096)
    pulse = np.fft.ifft(plant(grid)).real
    u = np.ones(30)
    y = np.cumsum(pulse)[:30]
    step = rid.TimeRecord(u, y + 0.004 * rng.uniform(-1, 1, 30), dt=dt, bound=0.01)
    run, problem = chosen(([frf], [step]))
    assert abs(plant(1.0)) > 3 * np.median(np.abs(values))
    assert run.prior.without is None
    assert problem.data_faults == ()


@pytest.mark.slow
@pytest.mark.parametrize("unit", [2.0**60, 2.0**-60])
def test_units_do_not_matter(unit):
    data = [structure(0, "late"), structure(0, "late")]
    (frf,), (step,) = data[1]
    scaled = [rid.prepare.correct(frf, f"times {unit!r}")], [rid.prepare.correct(step, f"times {unit!r}")]
    first, second = (only(chosen(one)[1].data_faults) for one in (data[0], scaled))
    assert first.said() == second.said()


@pytest.mark.parametrize("names", [("time 2",), ("time 1", "frequency 1"), ("frequency 3",)])
def test_experiments_that_are_not_there_are_refused(names):
    with pytest.raises(InputError, match="without"):
        chosen(structure(0), run=RunFile(prior=PriorChoice(without=names)))


def test_a_run_file_leaves_an_experiment_out_of_the_choice():
    with pytest.raises(InputError, match="frequency 2"):
        read_run_file({"prior": {"without": ["first"]}}, sources=False)
    asked = RunFile(prior=PriorChoice(without=("time 1",)))
    run, problem = chosen(structure(0), run=asked)
    assert run.prior.without == ("time 1",)
    alone, _ = chosen((structure(0)[0], []))
    assert run.prior.gain_bound == alone.prior.gain_bound
    assert problem.faults == ()  # the class holds what it was not chosen from
    assert rid.identify(problem).consistent

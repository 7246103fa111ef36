"""Answers as JSON: every field of the schema, the numbers of the files, refusals that name what is missing."""

import control
import numpy as np
import pytest

import robustid as rid
from robustid.app.answers.form import FORMAT, schema
from robustid.guarantees import largest_error
from support.answers import answered
from support.command_line import COMMAND, SHORT
from support.forging import forge

pytestmark = pytest.mark.quick

DT = 0.01
HZ = np.linspace(1.0, 21.0, 8)


def response(hz=HZ, shift=0.0, bound=0.03):
    omega = 2 * np.pi * hz
    values = 0.3 / (1.2 - np.exp(-1j * DT * omega)) + shift
    return rid.FrequencyResponse(omega, values, bound=bound, dt=DT, inputs=[("force", "N")], outputs=[("place", "mm")])


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """An identification, its band, and new data that fit it or don't."""
    place = tmp_path_factory.mktemp("results")
    found = rid.identify(rid.MixedProblem(frequency=response(), prior=rid.Prior(gain_bound=3.0, decay_rate=1.1)))
    found.save(place / "result")
    rid.band(found).save(place / "band")
    rid.save(place / "same.csv", response())
    rid.save(place / "other.csv", response(shift=0.5))
    rid.save(place / "gain.npz", control.ss([], [], [], 0.1, DT))
    rid.save(place / "wild.npz", control.ss([], [], [], 50.0, DT))
    return place


@pytest.fixture
def here(results, monkeypatch):
    monkeypatch.chdir(results)
    return results


def test_the_schema_is_one_of_2020_12_and_asks_for_every_field():
    jsonschema = pytest.importorskip("jsonschema")
    found = schema()
    jsonschema.Draft202012Validator.check_schema(found)
    assert found["required"] == list(found["properties"])
    assert found["properties"]["format"]["const"] == FORMAT


def test_identify_answers_what_it_has_written(folder, run):
    found = answered(run([*COMMAND, *SHORT, "--json"]))
    kept = rid.load("result")
    assert found["status"] == "consistent"
    assert found["margin"] == {"lower": kept.margin_lower, "upper": kept.margin}
    assert found["files"] == ["result.npz", "result.json", "result-band.npz", "result-band.json"]
    (band,) = found["guarantees"]
    again = rid.band(kept)
    assert band["at_most"] == pytest.approx(again.hinf, rel=1e-9)
    assert band["at_most"] >= again.sigma_upper.max()
    assert band["at_hz"] == pytest.approx(largest_error(again).omega / (2 * np.pi))
    assert (band["unit"], band["every_frequency"], band["over_poles"]) == ("mm/N", True, False)
    assert any("Poles other than" in words for words in found["not_covered"])
    assert found["refusal"] is None


def test_data_that_contradict_their_class_are_answered_with_causes(folder, run):
    small = ["--frequency-bound", "1e-4", "--time-bound", "1e-4"]
    found = answered(run([*COMMAND, *SHORT, *small, "--json"]))
    assert found["status"] == "inconsistent"
    assert found["margin"]["lower"] > 1
    assert found["exit_code"] in (3, 4)
    assert found["causes"]
    assert found["guarantees"] == []


@pytest.mark.usefixtures("unsearched")
def test_bounds_answer_the_bounds_of_their_file(here, run, tmp_path):
    name = str(tmp_path / "bounds")
    found = answered(run(["bounds", "result", "--omega", "20", "--directions", "4", "-o", name, "--json"]))
    rows = {row["of"]: row for row in found["guarantees"]}
    assert rows["frequencies"]["at_most"] == rid.load(name).sigma_upper.max()
    assert not rows["frequencies"]["every_frequency"]
    assert rows["band"]["every_frequency"]
    assert any("between those that were bounded" in words for words in found["not_covered"])
    assert len(found["files"]) == 4


@pytest.mark.parametrize("name", ["result", "band"])
def test_verify_answers_that_every_proof_holds(here, run, name):
    found = answered(run(["verify", name, "--json"]))
    assert found["status"] == "verified"
    assert bool(found["checks"]) == (name == "result")
    assert bool(found["guarantees"]) == (name == "band")


def test_verify_names_a_proof_that_does_not_hold(here, run, tmp_path):
    rid.load("result").save(tmp_path / "forged")
    forge(
        tmp_path / "forged", text=lambda record: record["claim"]["certificate"].update(value=record["claim"]["margin"])
    )
    found = answered(run(["verify", str(tmp_path / "forged"), "--json"]))
    assert (found["status"], found["exit_code"]) == ("failed", 1)
    assert [check["name"] for check in found["checks"] if not check["holds"]] == [
        "certificate: stated minus recomputed"
    ]
    assert "certificate: stated minus recomputed" in found["sentence"]


@pytest.mark.parametrize(
    ("known", "new", "status", "code"),
    [("result", "same.csv", "inside", 0), ("result", "other.csv", "refuted", 3), ("band", "other.csv", "refuted", 3)],
)
def test_new_data_refute_or_do_not(here, run, known, new, status, code):
    found = answered(run(["refute", known, "--frequency", new, "--json"]))
    assert (found["status"], found["exit_code"]) == (status, code)
    assert (found["samples"]["worst"]["ratio"] > 1) == (status == "refuted")
    assert HZ.min() <= found["samples"]["worst"]["at_hz"] <= HZ.max()


def test_warnings_are_part_of_the_answer(here, run):
    twice = run(["refute", "result", "--frequency", "same.csv", "--frequency", "same.csv", "--json"])
    warning = answered(twice)["warnings"][0]
    assert "twice" in warning
    assert warning in " ".join(twice[2].split())


def test_refute_says_what_it_needs(here, run):
    assert "--frequency and --time are both missing" in run(["refute", "result"])[2]
    code, _, err = run(["refute", "band", "--time", "same.csv"])
    assert code == 2
    assert "frequency" in err
    record = rid.TimeRecord(np.ones(5), np.ones(5), dt=DT, bound=0.1)
    rid.save("record.csv", record)
    found = answered(run(["refute", "band", "--time", "record.csv", "--json"]))
    assert (found["status"], found["refusal"]["argument"]) == ("refused", "time")


def test_controllers_are_answered_with_their_margin(here, run, tmp_path):
    both = ["--controller", "gain.npz", "--controller", "wild.npz"]
    found = answered(run(["loop", "band", *both, "-o", str(tmp_path / "tried"), "--json"]))
    rows = {row["name"]: row for row in found["controllers"]}
    loop = rid.load(tmp_path / "tried-gain")
    assert rows["gain"]["status"] == "stable"
    assert rows["gain"]["robust_stability_margin"] == loop.stability.margin > 1
    assert rows["gain"]["peaks"]["sensitivity"]["at_most"] == loop.peaks["sensitivity"].value
    assert rows["wild"]["status"] != "stable"
    assert found["status"] == rows["wild"]["status"]


@pytest.mark.parametrize(
    ("text", "options", "argument", "got", "remedy", "unknown"),
    [
        ("f,re,im\n1,1,2\n2,2,3\n3,3,4\n", [], "frequency_unit", None, {}, []),
        ("a,b\n0,1\n1,2\n2,3\n", ["time"], "time_field", None, {"time_field": ["u=a", "y=b"]}, ["dt"]),
        ("a,b\n0,1\n1,2\n2,3\n", ["time", "u=zz", "y=b"], "time_field", "zz", {}, []),
        ("a,b\n0,1\n1,2\n2,3\n", ["time", "u=a", "y=b"], "dt", None, {}, []),
        ("a,b\n0,1\n1,2\n2,3\n", ["time", "u=a", "y=b", "--dt", "0.1"], "time_bound", None, {}, []),
    ],
    ids=["unit", "names", "unknown column", "sample time", "no bound"],
)
def test_what_has_to_be_told_is_named(tmp_path, monkeypatch, run, text, options, argument, got, remedy, unknown):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "x.csv").write_text(text)
    kind, *rest = options or ["frequency"]
    given = [word for one in rest for word in ([f"--{kind}-field", one] if "=" in one else [one])]
    found = answered(run(["identify", f"--{kind}", "x.csv", *given, "--json"]))
    assert found["status"] == "refused"
    assert found["refusal"] == {"argument": argument, "got": got, "remedy": remedy, "unknown": unknown}
    assert list(tmp_path.iterdir()) == [tmp_path / "x.csv"]


def test_look_answers_with_the_question_that_is_open(tmp_path, monkeypatch, run):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "x.csv").write_text("f,gain,phase\n1,-3,-20\n2,-6,-100\n3,-30,-170\n")
    found = answered(run(["look", "x.csv", "--json"]))
    assert found["status"] == "unread"
    assert found["contents"][0]["read_as"] is None
    assert found["faults"][0]["kind"] == "magnitude unit"
    assert found["refusal"]["argument"].startswith("frequency_")


def test_a_command_that_ends_early_answers_too(tmp_path, monkeypatch, run):
    monkeypatch.chdir(tmp_path)
    assert answered(run(["verify", "nothing", "--json"]))["status"] == "refused"
    assert answered(run(["verify", "--json", "--nonsense"]))["status"] == "refused"
    monkeypatch.setattr("robustid.app.load_save.load_result", lambda *_, **__: 1 / 0)
    found = answered(run(["verify", "nothing", "--json"]))
    assert (found["status"], found["exit_code"]) == ("broken", 70)
    for raised in ("KeyboardInterrupt", "SystemError from KeyboardInterrupt()"):  # a library makes another error of it
        monkeypatch.setattr(
            "robustid.app.load_save.load_result", lambda *_, raised=raised, **__: exec(f"raise {raised}")
        )
        assert answered(run(["verify", "nothing", "--json"]))["status"] == "stopped"


@pytest.fixture(scope="module")
def measured(tmp_path_factory):
    """A record of a small plant, its response twice, and a model."""
    place, rng = tmp_path_factory.mktemp("measured"), np.random.default_rng(0)
    u = np.tile(rng.standard_normal(64), 6)
    plant = control.ss([[0.5, 0.2], [0.0, 0.3]], [[0.0], [1.0]], [[0.3, 0.1]], 0.0, DT)
    y = rid.core.simulate(plant, u[:, None])[0][:, 0]
    for name in ("one", "two"):
        record = rid.TimeRecord(u, y + 0.01 * rng.standard_normal(u.size), dt=DT, initial="periodic")
        rid.save(place / f"{name}.npz", record)
    rid.save(place / "plant.npz", plant)
    rid.save(place / "moved.npz", response(shift=0.5))
    rid.save(place / "here.npz", response())
    (place / "ask.toml").write_text(
        '[[frequency]]\nfile = "here.npz"\n[modes]\nhz = []\n[prior]\ngain_bound = 3.0\ndecay_rate = 1.1\n'
        "[worst_case]\nat_hz = [5.0]\ndirections = 4\n"
    )
    (place / "family.toml").write_text(
        "".join(
            f'[[members]]\nname = "{name}"\namplitude = {k}.0\n[[frequency]]\nfile = "{name}.npz"\nmember = "{name}"\n'
            for k, name in enumerate(("here", "moved"), start=1)
        )
        + "[modes]\nhz = []\n[prior]\ngain_bound = 3.0\ndecay_rate = 1.1\n[worst_case]\nat_hz = [1.0]\ndirections = 4\n"
    )
    return place


ANSWERS = {
    "frf": (["frf", "one.npz", "--period", "64", "-o", "frf.npz"], "estimated"),
    "fit": (["fit", "here.npz", "--order", "1", "--feedthrough", "-o", "fit.npz"], "fitted"),
    "run": (["run", "ask.toml", "-o", "ran"], "consistent"),
    "family": (["run", "family.toml", "-o", "ran"], "consistent"),
    "reduce": (["reduce", "plant.npz", "--order", "1", "-o", "small.npz"], "reduced"),
    "compare": (["compare", "one.npz", "two.npz", "--period", "64", "-o", "both"], "alike"),
    "differing": (["compare", "here.npz", "moved.npz"], "differ"),
    "model": (["compare", "plant.npz", "here.npz"], "refuted"),
    "connect": (["connect", "plant.npz", "gain.npz", "-o", "pair"], "stable"),
    "control": (["control", "band", "--structure", "P", "--peak", "3", "-o", "designed"], "none"),
}


@pytest.mark.parametrize("name", ANSWERS)
def test_every_command_answers_by_the_one_schema(measured, results, run, monkeypatch, tmp_path, name):
    for file in (*measured.iterdir(), *results.iterdir()):
        if file.is_file():
            (tmp_path / file.name).write_bytes(file.read_bytes())
    monkeypatch.chdir(tmp_path)
    words, status = ANSWERS[name]
    code, out, err = run([*words, "--json"])
    found = answered((code, out, err))
    assert (found["command"], found["status"]) == (words[0], status), err
    assert found["sentence"]
    assert all((tmp_path / file).is_file() for file in found["files"])
    assert bool(found["files"]) == ("-o" in words)
    if name in ("fit", "reduce", "run"):
        assert found["model"]["dt"] == DT
    if name in ("compare", "differing"):
        assert (found["difference"]["by_chance"] <= 0.05) == (status == "differ")
        assert bool(found["difference"]["places"]) == (status == "differ")
    if name == "reduce":
        small, given = rid.load("small.npz"), rid.load("plant.npz")
        assert found["model"]["order"] == small.nstates == 1
        omega = np.linspace(0.01, np.pi / DT, 200)
        error = abs(given(np.exp(1j * omega * DT)) - small(np.exp(1j * omega * DT)))
        assert error.max() <= found["model"]["error_at_most"]
    if name == "run":
        assert found["margin"]["upper"] == rid.load("ran/identification").margin
        assert found["guarantees"]
    if name == "control":
        assert (found["exit_code"], found["model"], found["controllers"]) == (3, None, [])

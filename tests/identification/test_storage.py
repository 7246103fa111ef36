import contextlib
import dataclasses
import pickle
import subprocess
import sys

import control
import numpy as np
import pytest

import robustid as rid
from robustid.bases import FunctionKind
from robustid.core import Choice, Source
from support.forging import forge, kept
from support.forms import posed_problem
from support.matrix_plants import random_matrix_problem
from support.problems import CASES, random_problem
from support.refusals import refused


@pytest.fixture(scope="module")
def result():
    return rid.identify(random_problem(2, "parametric", 14, spread=0.2, noise=4.0))


@pytest.fixture
def path(result, tmp_path):
    result.save(tmp_path / "result")
    return tmp_path / "result"


def of_class(prior):
    """1/(s + 1) at three frequencies; beside a pair, where the class is not a passive one."""
    omega = np.array([1.0, 2.0, 3.0])
    frf = rid.FrequencyResponse(omega, 1 / (1j * omega + 1), bound=0.05)
    basis = rid.kautz(2.0, 0.3, dt=0) if type(prior) is rid.Prior else None
    return rid.MixedProblem(frequency=frf, prior=prior, parametric=basis)


WEIGHT = control.zpk([-30.0], [-8.0 + 2j, -8.0 - 2j], 3.0)
MATRIX = random_matrix_problem(1, 1, 2, 5, rho=1.15, bound=0.02)[0]
KEPT = {case: (random_problem(2, case, 12), {"objective": "gain"}, "verified") for case in CASES} | {
    "taylor": (posed_problem("mixed", 1, 1.15, 0.05), {"form": "taylor", "accuracy": 1e-3}, "Taylor coefficients"),
    "matrix in sections": (MATRIX, {"form": "sections", "accuracy": 1e-3}, "of an all-pass section"),
    "continuous": (of_class(rid.Prior(gain_bound=1.0, decay=0.5)), {}, "Re s > -0.5 1/s"),
    "roll-off": (of_class(rid.Prior(gain_bound=2.0, decay=0.5, roll_off=2, corner=6.0)), {}, "continuous time"),
    "weight": (of_class(rid.Prior(gain_bound=5.0, decay=0.5, weight=WEIGHT)), {}, "times <weight of s: zeros -30"),
    "positive real, refuted": (of_class(rid.PositiveReal(decay=0.5, slack=0.2)), {}, "passive"),
    "bounded real": (of_class(rid.BoundedReal(decay=0.5)), {}, "passive"),
    "negative imaginary": (of_class(rid.NegativeImaginary(decay=0.5)), {}, "passive"),
}


@pytest.mark.parametrize("name", KEPT)
def test_round_trip_is_exact_and_verified_again(name, tmp_path):
    problem, options, words = KEPT[name]
    result = rid.identify(problem, **options)
    again = kept(result, tmp_path / "a.b")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.b.json", "a.b.npz"]
    assert np.array_equal(again.coefficients, result.coefficients)
    assert np.array_equal(again.parameters, result.parameters)
    assert np.array_equal(again.model.A, result.model.A)
    for field in ("margin", "margin_lower", "status", "prior", "summary"):
        one, other = (getattr(each, field) for each in (again, result))
        assert type(one) is type(other)
        assert (one() == other()) if field == "summary" else (one == other)
    assert (again.formulation.count, again.formulation.repeated) == (
        result.formulation.count,
        result.formulation.repeated,
    )
    assert words in again.summary()
    assert again.verification.passed
    assert again.verification.checks == result.verification.checks


@pytest.mark.parametrize("room", [pytest.param("", marks=pytest.mark.slow), ".data"])
def test_a_new_process_saves_what_it_has_made(room, tmp_path):
    """Nothing has been loaded or saved before that would have registered the parts; commands import rooms, not the front door."""
    code = f"""
import robustid as rid
import robustid{room} as made
frf = made.FrequencyResponse([1.0, 2.0], [1.0, 0.5], bound=0.1, dt=0.1)
frf.save("data.npz")
rid.identify(rid.MixedProblem(frequency=frf, prior=rid.Prior(gain_bound=1.0, decay_rate=1.1))).save("result")
"""
    subprocess.run([sys.executable, "-c", code], cwd=tmp_path, check=True)
    assert rid.load(tmp_path / "result").verification.passed
    assert rid.load(tmp_path / "data.npz").dt == 0.1


def test_channel_names_units_and_notes_survive(tmp_path):
    frf = rid.FrequencyResponse([1.0], [0.5], bound=0.1, dt=0.1, inputs="force [N]", outputs="x [m]", note="by hand")
    prior = rid.Prior(gain_bound=1.0, decay_rate=1.1)
    rid.identify(rid.MixedProblem(frequency=frf, prior=prior)).save(tmp_path / "r")
    again = rid.load(tmp_path / "r.json").problem.frequency[0]
    assert str(again.inputs[0]) == "force [N]"
    assert again.note == "by hand"


def test_choices_and_kinds_of_functions_survive(result, path):
    choices = {
        "modes": Choice({"hz": [9.0]}, Source.DATA, "by a fit", "1 2"),
        "a": Choice(None, Source.STOPPED, "late"),
    }
    dataclasses.replace(result, choices=choices).save(path)
    again = rid.load(path)
    assert again.choices == choices
    assert again.notes == ("by a fit\n1 2", "late")
    assert again.problem.parametric.functions == result.problem.parametric.functions
    assert all(function.kind is FunctionKind.MODE for function in again.problem.parametric.functions)


@pytest.mark.parametrize("suffix", [".npz", ".json"])
def test_truncated_or_missing_files_are_named(path, suffix):
    target = path.with_suffix(suffix)
    target.write_bytes(target.read_bytes()[:100])
    refused("result", rid.load, path, error=rid.errors.FileFormatError)
    target.unlink()
    refused("missing", rid.load, path, error=rid.errors.FileFormatError)


def test_files_that_do_not_belong_together_are_refused(path, tmp_path):
    rid.identify(random_problem(9, "parametric", 14)).save(tmp_path / "other")
    path.with_suffix(".npz").write_bytes((tmp_path / "other.npz").read_bytes())
    refused("digest", rid.load, path, error=rid.errors.FileFormatError)


def test_a_claim_that_the_numbers_do_not_support_is_seen(path):
    forge(path, text=lambda record: record["claim"]["certificate"].update(value=record["claim"]["margin"]))
    assert not rid.load(path).verification.passed


def test_a_pickle_inside_is_refused(path):
    np.savez(path.with_suffix(".npz"), evil=np.array([{"a": 1}], dtype=object))
    with pytest.raises(rid.errors.FileFormatError):
        rid.load(path)


def test_an_unwritable_place_leaves_nothing_behind(result, tmp_path):
    before = sorted(tmp_path.iterdir())
    refused("nowhere", result.save, tmp_path / "nowhere" / "x")
    assert sorted(tmp_path.iterdir()) == before


def test_problems_and_results_can_be_pickled_and_stay_read_only():
    problem = random_problem(1, "mixed", 10)
    copy = pickle.loads(pickle.dumps(problem))
    assert np.array_equal(copy.frequency[0].values, problem.frequency[0].values)
    assert not copy.frequency[0].values.flags.writeable
    result = pickle.loads(pickle.dumps(rid.identify(problem)))
    assert not result.coefficients.flags.writeable
    assert result.solution(0.5).nstates == problem.coefficients


@pytest.mark.parametrize(
    "edit",
    [
        {"margin": -5.0},
        {"margin": 0.0},
        {"margin": 1.5},
        {"accuracy": 1e-30},
        {"margin": "0.5"},
        {"solver": 3},
        {"certificate": None},
        {"status": "CONSISTENT"},
    ],
)
def test_edited_text_is_refused_or_fails_its_verification(path, edit):
    forge(path, text=lambda record: record["claim"].update(edit))
    with contextlib.suppress(rid.errors.FileFormatError):
        assert not rid.load(path).verification.passed


@pytest.mark.parametrize(
    ("edit", "words"),
    [
        (
            lambda record: record.update(margin_lower=0.5),
            "'margin_lower' of its Identification is unknown; make it again",
        ),
        (lambda record: record.pop("prior"), "another version of robustid.* 'prior' of its Identification is missing"),
        (lambda record: record["claim"].update({"$class": "Popen"}), "'Popen', which is no class that can be stored"),
        (lambda record: record["claim"].update({"$class": "Prior"}), "of its Prior is"),
        (lambda record: record.update(prior=record["claim"]), "'prior' of its Identification can't be a Claim"),
        (lambda record: record.update(objective=["center"]), "'objective' of its Identification can't be a tuple"),
        (
            lambda record: record.update(coefficients={"$array": "robustid.kind"}),
            "'coefficients' of its Identification",
        ),
        (lambda record: record.update(coefficients={"$array": "nothing"}), "lacks 'nothing'"),
        (lambda record: record.update(sections={"$call": "print"}), "no meaning"),
        (lambda record: record.update(timing={"all": "long"}), "'timing' of its Identification"),
    ],
)
def test_fields_are_those_of_the_class_and_of_their_types(path, edit, words):
    forge(path, text=edit)
    refused(words, rid.load, path, error=rid.errors.FileFormatError)


@pytest.mark.parametrize("name", ["coefficients", "claim/certificate/samples", "claim/p"])
@pytest.mark.parametrize("damage", ["short", "nan"])
def test_damaged_numbers_under_a_matching_digest_are_seen(path, name, damage):
    forge(path, lambda a: {name: a[name][:-1] if damage == "short" else a[name] * np.nan})
    try:
        again = rid.load(path)
    except rid.errors.FileFormatError:
        return
    assert not again.verification.passed

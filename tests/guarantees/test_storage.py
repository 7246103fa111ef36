"""Saved worst-case errors: exact, compact, verified again, and worth nothing once they are forged."""

import contextlib
import dataclasses
import errno
import json

import numpy as np
import pytest

import robustid as rid
from robustid.core import load_saved
from robustid.identification import evaluate_support
from support.forging import arrays_of, forge, kept, lower, scaled, some_sides
from support.problems import random_problem
from support.refusals import refused
from support.structure import about_structure


@pytest.fixture(scope="module")
def computed():
    result = rid.identify(random_problem(2, "parametric", 8))
    return rid.worst_case_error(result, omega=[0.0, 60.0, 110.0], directions=5)


@pytest.fixture
def saved(computed, tmp_path):
    computed.save(tmp_path / "bounds")
    return tmp_path / "bounds"


def same(error, again):
    assert np.array_equal(again.omega, error.omega)
    assert np.array_equal(again.upper, error.upper)
    assert np.array_equal(again.lower, error.lower)
    assert np.array_equal(again.parameters.lower, error.parameters.lower)
    assert np.array_equal(again.parameters.attained, error.parameters.attained)
    assert (again.directions, again.gap) == (error.directions, error.gap)
    assert again.summary() == error.summary()


@pytest.mark.parametrize(("case", "form"), [("time", "auto"), ("parametric", "auto"), ("mixed", "taylor")])
def test_round_trip_is_exact_and_verifies_again(case, form, tmp_path):
    error = rid.worst_case_error(rid.identify(random_problem(2, case, 8), form=form), omega=[0.0, 70.0], directions=4)
    error.save(tmp_path / "a.b")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.b.json", "a.b.npz"]
    again = rid.load(tmp_path / "a.b.json")
    same(error, again)
    assert again.certified
    assert again.identification.verification.passed
    assert len(list(again.claims())) == 6 + 2 * error.parameters.lower.size


@pytest.mark.slow
def test_another_nominal_and_the_bound_on_the_circle_survive(computed, tmp_path):
    small = rid.balanced_truncation(computed.identification.model, order=4).model
    error = computed.with_model(small)
    same(error, kept(error, tmp_path / "small"))
    circle = error.on_circle(2.0)
    assert error.circle is circle
    again = kept(error, tmp_path / "small")
    assert np.array_equal(again.circle.bound, circle.bound)
    assert (again.hinf, again.circle.converged) == (error.hinf, circle.converged)
    assert again.claim_count == len(list(again.claims())) > sum(v.directions.size for v in again.values) + 2
    assert again.certified
    smaller = np.where(circle.bound == circle.largest, 0.99 * circle.bound, circle.bound)
    assert not again.with_circle(dataclasses.replace(circle, bound=smaller)).certified
    lowered = np.minimum(circle.bound, 0.99 * circle.lower)
    assert not again.with_circle(dataclasses.replace(circle, bound=lowered)).certified
    assert not again.with_circle(dataclasses.replace(circle, edges=circle.edges * 1.01)).certified
    assert np.array_equal(again.model.A, small.A)


def test_files_are_no_larger_than_their_numbers(computed, saved):
    """A certificate takes N complex multipliers, and the smaller one of its two factors and Y itself."""
    numbers = 0
    for claim in computed.claims():
        n, rank = claim.certificate.left.shape
        numbers += 2 * claim.certificate.samples.size + n * min(n, 2 * rank)
    assert saved.with_suffix(".npz").stat().st_size < 8 * numbers + 25_000


def test_an_identification_is_no_worst_case_error_and_the_other_way_round(computed, saved, tmp_path):
    refused(
        "kind: worst-case error; needed is: identification",
        load_saved,
        saved,
        "identification",
        error=rid.errors.FileFormatError,
    )
    computed.identification.save(tmp_path / "result")
    with pytest.raises(rid.errors.FileFormatError, match="kind: identification; needed is: worst-case error"):
        load_saved(tmp_path / "result", "worst-case error")


def test_data_are_bound_to_the_proofs(saved):
    """Any multipliers are valid: what they prove is about the data, which must be those that were measured."""
    arrays = arrays_of(saved)
    name = "identification/problem/time/0/y"
    np.savez(saved.with_suffix(".npz"), **arrays | {name: arrays[name] * 1.01})
    refused("digest", rid.load, saved, error=rid.errors.FileFormatError)


@pytest.mark.parametrize("name", ["gain_bound", "decay_rate"])
def test_assumptions_are_bound_to_the_proofs(computed, saved, name, tmp_path):
    computed.identification.save(tmp_path / "result")
    for path in (saved, tmp_path / "result"):
        text = path.with_suffix(".json")
        record = json.loads(text.read_text())
        record.get("identification", record)["problem"]["prior"][name] *= 1.01
        text.write_text(json.dumps(record))
        refused("edited", rid.load, path, error=rid.errors.FileFormatError)


PROOFS = "values/certificates/"
FORGERIES = {
    "support": lower("values/support"),
    "stated value": lower(PROOFS + "value"),
    "support and value": lambda a: (
        lower("values/support")(a) | {PROOFS + "value": a[PROOFS + "value"] - 1e-6 * np.abs(a["values/support"]).max()}
    ),
    "multipliers": scaled(PROOFS + "samples", 1.001),
    "factors": scaled(PROOFS + "factors", 0.999),
    "bounds of the samples": scaled(PROOFS + "level", 0.5),
    "frequency": lambda a: {"values/omega": a["values/omega"] + np.array([0.0, 1.0, 0.0])},
    "sides": lambda a: {"values/sides": a["values/sides"][::-1]},
    "fewer certificates": lambda a: {PROOFS + "rank": a[PROOFS + "rank"][:-1]},
    "order": lambda a: {PROOFS + "order": a[PROOFS + "order"] + 1},
    "interval": lower("parameters/upper"),
    "fewer intervals": lambda a: {"parameters/lower": a["parameters/lower"][:1]},
    "smaller matrices": lambda a: {
        PROOFS + "order": a[PROOFS + "order"] - 1,
        PROOFS + "rank": np.zeros_like(a[PROOFS + "rank"]),
        PROOFS + "factors": np.zeros(0),
    },
    "fewer samples": lambda a: {PROOFS + "samples": a[PROOFS + "samples"][:, :-1]},
    "no multipliers": scaled(PROOFS + "samples", np.nan),
    "infinite factors": scaled(PROOFS + "factors", np.inf),
    "no frequency": scaled("values/omega", np.nan),
    "not a number": scaled("values/support", np.nan),
}


@pytest.mark.parametrize("name", FORGERIES)
def test_a_forgery_is_refused_or_does_not_verify(saved, name):
    forge(saved, FORGERIES[name])
    with contextlib.suppress(rid.errors.FileFormatError):
        again = rid.load(saved)
        assert not again.verify()
        assert not again.certified


def test_open_polygons_are_refused(computed, tmp_path):
    """Two directions close a polygon where the response is real only."""
    two = some_sides(computed.values[1], [0, 0])
    dataclasses.replace(computed, values=(two,), directions=2).save(tmp_path / "open")
    refused("sides", rid.load, tmp_path / "open", error=rid.errors.FileFormatError)


def test_polygons_of_other_directions_prove_nothing(computed):
    """The corners of a polygon are computed for even directions: the certificates alone do not make them right."""
    values = computed.values[1]
    turned = dataclasses.replace(values, directions=values.directions + 0.1)
    assert not dataclasses.replace(computed, values=(turned,)).verify()
    assert dataclasses.replace(computed, values=(values,)).verify()


def test_other_multipliers_with_an_honest_value_are_true_and_weaker(computed, saved):
    samples, values = [], []
    for claim in computed.claims():
        if "direction" in claim.name:
            proof = claim.certificate
            samples.append(0.9 * proof.samples)
            stated = claim.functional, samples[-1], proof.left @ proof.right.T, 1.0, claim.rows, claim.sarason
            values.append(evaluate_support(*stated))
    finite = np.isfinite(values)  # free parameters leave no freedom in their equation
    honest = np.where(finite, values, 1e300) + 1e-9
    forge(saved, lambda _: {PROOFS + "samples": samples, PROOFS + "value": honest, "values/support": honest})
    again = rid.load(saved)
    assert again.verify()
    assert np.all(again.upper > computed.upper)


def test_a_full_disk_leaves_what_was_there_and_says_so(computed, saved, tmp_path, monkeypatch):
    before = {p.name: p.read_bytes() for p in tmp_path.iterdir()}

    def full(file, **_):
        file.write(b"half of it")
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(np, "savez_compressed", full)
    refused("No space left", computed.save, saved)
    assert {p.name: p.read_bytes() for p in tmp_path.iterdir()} == before


def test_two_sides_are_no_polygon():
    """Directions 0 and pi of a complex value bound no area: what they leave out can be anywhere above and below."""
    problem = about_structure(rid.datasets.flexible_structure(lines=5, samples=2), 0.1, 1.3)
    error = rid.worst_case_error(rid.identify(problem), omega=[50.0], directions=4)
    assert error.certified
    assert not dataclasses.replace(error, values=(some_sides(error.values[0], [0, 2]),), directions=2).certified

"""What proof files of all kinds keep: the schema knows them, the checker proves them, and nothing that is almost a proof."""

import json

import pytest

from support.cases import slow
from support.proof_kinds import bare, factors_of_values, proofs_in_continuous_time, proofs_of, proofs_over_boxes
from support.proof_loops import small_proofs
from support.proofs import SANITIZED, SOURCE, built, survive

pytestmark = pytest.mark.quick
SCHEMA = json.loads((SOURCE.parents[1] / "docs" / "proof_format.schema.json").read_text())
KINDS = {
    "samples": lambda seed: [*proofs_of(seed), bare("3.000000000001", factors_of_values())],
    "boxes and continuous time": lambda seed: [*proofs_over_boxes(seed), *proofs_in_continuous_time(seed)],
    "arcs": lambda _: small_proofs(),
}
SAMPLES, BOXES, ARCS = KINDS


@pytest.mark.parametrize("kind", KINDS)
def test_the_schema_knows_every_proof(kind):
    schema = pytest.importorskip("jsonschema")
    for text in KINDS[kind](1):
        schema.validate(json.loads(text), SCHEMA)


def test_the_schema_knows_no_strange_number():
    schema = pytest.importorskip("jsonschema")
    with pytest.raises(schema.ValidationError):
        schema.validate(json.loads(bare("NaN", [])), SCHEMA)


@pytest.mark.parametrize(("kind", "seed"), [slow(kind, seed) for kind in (SAMPLES, BOXES) for seed in range(200)])
def test_proofs_of_two_hundred_problems_are_proved(proved, kind, seed):
    for text in KINDS[kind](seed):
        proved(text)


MANY = [slow(kind, k, first + k, 500) for kind, first in ((SAMPLES, 0), (BOXES, 100), (ARCS, 100)) for k in range(20)]


@pytest.mark.parametrize(
    ("kind", "seed", "draw", "count"), [(SAMPLES, 1, 1, 40), (BOXES, 1, 1, 20), (ARCS, 1, 1, 40), *MANY]
)
def test_no_mutant_is_accepted_that_is_not_true(program, tmp_path, kind, seed, draw, count):
    survive(program, tmp_path, KINDS[kind](seed), draw, count)


@pytest.mark.parametrize(("kind", "count"), [slow(SAMPLES, 20), slow(BOXES, 10), (ARCS, 10)])
def test_no_mutant_crashes_the_checker(tmp_path, kind, count):
    survive(built(*SANITIZED), tmp_path, KINDS[kind](1), 2, count)

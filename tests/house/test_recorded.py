"""No number has moved: the recorded problems of `benchmarks/recorded.py` give what they gave, some of them every time.

Within 1e-6 only, for other machines have other libraries of linear algebra, whose sums end in other digits. On the
machine that recorded them `python benchmarks/recorded.py compare` asks for the same bits.
"""

import pathlib
import sys

import pytest

BENCHMARKS = pathlib.Path(__file__).parents[2] / "benchmarks"
if not BENCHMARKS.exists():
    pytest.skip("benchmarks are not part of the source archive", allow_module_level=True)
sys.path.insert(0, str(BENCHMARKS))
import recorded  # noqa: E402

LIMIT = 1e-6


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=() if one.quick else pytest.mark.slow) for name, one in recorded.PROBLEMS.items()]
)
def test_a_recorded_problem_gives_the_same(name):
    assert recorded.failures(name, recorded.differences(name), LIMIT) == []


def test_every_problem_is_recorded_and_every_record_has_its_problem():
    assert {path.stem for path in recorded.FOLDER.glob("*.json")} == set(recorded.PROBLEMS)


@pytest.mark.parametrize(
    ("old", "new", "apart"),
    [
        (1.0, 1.0, 0),
        (1.0, 1.0 + 1e-8, 1e-8),
        (1, 1.0, float("inf")),  # a count is no measure
        (float("nan"), float("nan"), 0),
        (float("inf"), 1.0, float("inf")),
        ({"shape": [2], "values": [2.0, 0.0]}, {"shape": [2], "values": [2.0, 1e-3]}, 5e-4),
        ({"shape": [2], "values": [2.0, 0.0]}, {"shape": [1, 2], "values": [2.0, 0.0]}, float("inf")),
        ("0.3167 of 3", "0.3168 of 3", recorded.NEAR / 2),  # the last digit may be rounded
        ("0.3167 of 3", "0.3169 of 3", 1e-4 / 0.3167),
        ("0.3167 of 3", "0.3167 of 4", float("inf")),
        ("2.1e-14, 3×10⁻¹⁵", "7.1e-14, 1×10⁻¹⁴", recorded.NEAR / 2),  # rounding errors
        ("within", "inside", float("inf")),
    ],
)
def test_differences_are_seen(old, new, apart):
    assert recorded.difference(old, new) == pytest.approx(apart, rel=0.02)

"""Described values come back as they were; what is not registered is neither described nor made."""

import json

import numpy as np
import pytest

from robustid.core import Choice, Signal, Source, StateMatrices, described, fingerprint, made, stored
from robustid.errors import InputTypeError

MATRICES = StateMatrices(np.diag([1.0, 2.0]), np.ones((2, 1)), 2 * np.ones((1, 2)), np.zeros((1, 1)))
VALUES = [
    None,
    1.5,
    (1, 2.0, "three", 4j, np.inf, True),
    [1, (2, [3])],
    {"a": {"b": (1,)}, "c": []},
    Signal("force", "N"),
    Choice({"hz": [9.0], "pair": (1, 2)}, Source.DATA, "by a fit"),
]


@pytest.mark.parametrize("value", VALUES, ids=repr)
def test_values_come_back_through_json(value):
    arrays = {}
    text = json.loads(json.dumps(described(value, "", arrays)))
    assert not arrays
    again = made(text, arrays)
    assert again == value
    assert type(again) is type(value)
    assert fingerprint(again) == fingerprint(value)


def test_arrays_are_kept_by_their_path():
    arrays = {}
    again = made(described({"model": (np.float64(2), MATRICES)}, "", arrays), arrays)
    assert sorted(arrays) == [f"model/1/{name}" for name in "ABCD"]
    assert again["model"][0] == 2.0
    assert again["model"][1].A is arrays["model/1/A"]
    assert fingerprint(MATRICES) != fingerprint(MATRICES.transposed())


@pytest.mark.parametrize("value", [print, object(), {1: 2}, {"$class": "Signal"}, range(3), {1, 2}])
def test_what_is_not_registered_can_t_be_stored(value):
    with pytest.raises(InputTypeError, match="stored"):
        described(value, "here", {})


@pytest.mark.parametrize(
    "text",
    [
        {"$class": "print"},
        {"$class": ["Signal"]},
        {"$class": "Signal", "name": "u"},
        {"$class": "Signal", "name": "u", "unit": 3},
        {"$class": "Signal", "name": "u", "unit": "", "count": 1},
        {"$one of": ["Source", "ELSEWHERE"]},
        {"$one of": ["Signal", "name"]},
        {"$one of": 3},
        {"$complex": [1.0]},
        {"$array": "nowhere"},
        {"$list": [], "more": 1},
        {"$import": "os"},
    ],
    ids=str,
)
def test_a_text_that_describes_nothing_is_refused(text):
    with pytest.raises((ValueError, KeyError, TypeError)):
        made(text, {})


def test_two_classes_of_one_name_are_not_mixed_up():
    with pytest.raises(ValueError, match="two classes"):
        stored(type("Signal", (), {}))

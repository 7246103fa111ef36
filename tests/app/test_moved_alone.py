"""Records that move one input each make one response of all of them."""

import numpy as np
import pytest

import robustid as rid
from robustid.app.run.moved_alone import with_all_inputs

RNG = np.random.default_rng(0)


def record(inputs, outputs=("x", "y")):
    u, y = (RNG.standard_normal((50, len(names))) for names in (inputs, outputs))
    return rid.TimeRecord(u, y, dt=0.01, inputs=list(inputs), outputs=list(outputs))


def test_the_others_rest():
    first, second, third = record(["F1"]), record(["F2", "F3"]), record(["F1"])
    made, said = with_all_inputs([first, second, third])
    assert said == "the records move F1, then F2 and F3: each input is taken to rest where another is moved"
    assert [[one.name for one in item.inputs] for item in made] == [["F1", "F2", "F3"]] * 3
    for item, here, columns in zip(made, (first, second, third), ([0], [1, 2], [0]), strict=True):
        assert np.array_equal(item.u[:, columns], here.u)
        assert not np.delete(item.u, columns, axis=1).any()


@pytest.mark.parametrize(
    "records",
    [
        [record(["F1"]), record(["F1"])],
        [record(["F1"]), record(["f1"])],
        [record(["F1"], ["x1"]), record(["F2"], ["x2"])],
        [record(["u1"]), record(["u2"])],
        [record(["F1", "F2"]), record(["F2", "F3"])],
    ],
    ids=["the same", "other letters", "other outputs", "without names", "in common"],
)
def test_others_are_left_as_they_are(records):
    assert with_all_inputs(records) == (records, "")

"""Problems of several channels that cannot be meant: one thing broken per test, and a sentence that says what to do."""

import numpy as np
import pytest

import robustid as rid

pytestmark = pytest.mark.quick


PRIOR = rid.Prior(gain_bound=1.0, decay_rate=1.1)
RNG = np.random.default_rng(0)
FRF = rid.FrequencyResponse([1.0, 2.0], np.ones((2, 2, 2)), bound=0.1, dt=0.1)
WIDE = rid.FrequencyResponse([1.0, 2.0], np.ones((2, 2, 3)), bound=0.1, dt=0.1)
U, Y = RNG.standard_normal((2, 6, 2))
RECORD = rid.TimeRecord(U, Y, dt=0.1, bound=0.1)
ALIKE = rid.TimeRecord(U[:, :1] * [1.0, 2.0], Y, dt=0.1, bound=0.1)
STILL = rid.TimeRecord(U * [1.0, 0.0], Y, dt=0.1, bound=0.1)


def without(output=None, input=None):
    """The frequency response without a row or a column."""
    bound = np.full((2, 2, 2), 0.1)
    bound[:, slice(None) if output is None else output, slice(None) if input is None else input] = np.inf
    return rid.FrequencyResponse([1.0, 2.0], np.ones((2, 2, 2)), bound=bound, dt=0.1)


CASES = {
    "inputs move alike": (
        {"time": ALIKE},
        r"the 2 inputs move in 1 independent ways only .*the response to .* is never seen. Add an experiment",
    ),
    "an input at rest": ({"time": STILL}, "`inputs`: no experiment excites 'u2'; leave that signal out, or add"),
    "an input never excited": ({"frequency": without(input=1)}, "`inputs`: no experiment excites 'u2'"),
    "one direction": ({"frequency": FRF.tangential(right=[1.0, 1.0])}, "the response to .*u1 .*u2 is never seen"),
    "an empty output": ({"frequency": without(output=1)}, "`outputs`: no experiment has a sample of 'y2'; leave"),
    "an output never used": (
        {"time": rid.TimeRecord(U, Y, dt=0.1, bound=np.where([True, False], 0.1, np.inf) * np.ones((6, 2)))},
        "`outputs`: no experiment has a sample of 'y2'",
    ),
    "other numbers of inputs": ({"frequency": WIDE, "time": RECORD}, "`inputs` differ between experiments: .*All must"),
    "other names": (
        {
            "frequency": [
                rid.FrequencyResponse([1.0], np.ones((1, 2, 2)), bound=0.1, dt=0.1, inputs=["left", "right"]),
                rid.FrequencyResponse([2.0], np.ones((1, 2, 2)), bound=0.1, dt=0.1, inputs=["right", "left"]),
            ]
        },
        "`inputs` differ between experiments: .*same order and units",
    ),
    "another dt": ({"frequency": FRF, "time": rid.TimeRecord(U, Y, dt=0.2, bound=0.1)}, "`dt` .*differs|dt.*differs"),
    "a scaling of another shape": (
        {"frequency": FRF, "prior": rid.Prior(gain_bound=1.0, decay_rate=1.1, scaling=np.ones((2, 3)))},
        r"`scaling` of the prior must have shape \(ny, nu\) = \(2, 2\), as the data; got \(2, 3\)",
    ),
    "symmetric but not square": (
        {"frequency": WIDE, "symmetric": True},
        "`symmetric` needs as many outputs as inputs, in the same order; got 2 outputs and 3 inputs",
    ),
    "bounds of the residues of another shape": (
        {"frequency": FRF, "parametric": rid.kautz(1.0, 0.1, dt=0.1), "parameter_bounds": np.zeros((2, 3, 2, 2))},
        r"`parameter_bounds` must have shape \(m, 2\) .* or \(m, ny, nu, 2\) = \(2, 2, 2, 2\); got",
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_a_sentence_for_each(name):
    changes, sentence = CASES[name]
    with pytest.raises(rid.InputError, match=sentence):
        rid.MixedProblem(**({"prior": PRIOR} | changes))


def test_two_records_that_move_alike_together_move_both():
    """Rank-deficient one by one, complete together."""
    other = rid.TimeRecord(U[:, :1] * [1.0, -1.0], Y, dt=0.1, bound=0.1)
    problem = rid.MixedProblem(time=[ALIKE, other], prior=PRIOR)
    assert (len(problem.outputs), len(problem.inputs)) == (2, 2)


def test_the_form_of_the_paper_says_that_its_theorem_is_about_one_channel():
    with pytest.raises(rid.InputError, match=r"whose theorem is about one input and one output; got 2x2\. Take form"):
        rid.identify(rid.MixedProblem(frequency=FRF, prior=PRIOR), form="classical")


def test_a_mode_that_no_sample_of_an_entry_shows_is_named():
    """An entry with a single line cannot tell the three functions of a mode with feed-through apart."""
    bound = np.full((3, 2, 2), 0.1)
    bound[1:, 0, 1] = np.inf
    frf = rid.FrequencyResponse([1.0, 2.0, 3.0], np.ones((3, 2, 2)), bound=bound, dt=0.1)
    basis = [rid.kautz(1.0, 0.1, dt=0.1), rid.kautz(2.0, 0.1, dt=0.1)]
    problem = rid.MixedProblem(frequency=frf, prior=PRIOR, parametric=basis)
    with pytest.raises(rid.InputError, match=r"cannot tell .* apart.*of the entry from u2 to y1"):
        rid.identify(problem)

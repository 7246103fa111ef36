"""Tubes of the entries of matrices: truth inside, equal to those of one entry where nothing ties the entries together."""

import dataclasses

import control
import numpy as np
import pytest

import robustid as rid
from robustid.guarantees import response_tube
from support.cases import slow
from support.matrix_plants import random_matrix_problem
from support.refusals import refused

BASIS = rid.kautz([0.8], [0.1], dt=1.0, delay=1)


@pytest.mark.parametrize(
    ("shape", "options"),
    [
        *(slow(shape, {}) for shape in ((2, 2), (2, 3))),
        slow((2, 2), {"symmetric": True}),
        ((2, 1), {"parametric": BASIS}),
    ],
)
def test_the_truth_is_inside(shape, options):
    problem, truth = random_matrix_problem(1, *shape, 3, rho=1.4, **options)
    result, entry = rid.identify(problem), (1, shape[1] - 1)
    u = np.array([1.0, -0.5, 0.0, 2.0, 0.3])
    for signal in ("impulse", u):
        tube = response_tube(result, input=signal, horizon=5, entry=entry, gap=0.02)
        drive = np.zeros((shape[1], 5))
        drive[entry[1]] = tube.u
        y = control.forced_response(truth, np.arange(5.0), drive).outputs.reshape(shape[0], 5)[entry[0]]
        assert np.all((tube.lower <= y) & (y <= tube.upper))
        model = control.forced_response(tube.model, np.arange(5.0), drive).outputs.reshape(shape[0], 5)[entry[0]]
        np.testing.assert_allclose(tube.nominal, model, atol=1e-9 * np.abs(model).max())
        assert np.all(tube.error_lower <= tube.error_upper * (1 + 1e-9))
        assert tube.peak >= np.abs(y).max()
        assert tube.verify()
    narrower = dataclasses.replace(tube, upper=tube.upper - 1e-3 * np.ptp(tube.upper))
    assert not narrower.verify()
    other = dataclasses.replace(tube, entry=(0, entry[1]))
    assert not other.verify()


def test_a_scaled_entry_after_a_zero_has_the_answer_of_schwarz():
    """f_0 = 0 of every entry leaves |f_1| <= K s_ij / rho, for each entry its own."""
    scaling = np.array([[1.0, 2.0], [0.5, 1.0]])
    prior = rid.Prior(gain_bound=1.0, decay_rate=2.0, scaling=scaling)
    bound = np.array([[1e-6, 1e-6], [np.inf, np.inf]])
    records = [rid.TimeRecord([one, [0.0, 0.0]], np.zeros((2, 2)), dt=0.1, bound=bound) for one in np.eye(2)]
    result = rid.identify(rid.MixedProblem(time=records, prior=prior))
    for entry in np.ndindex(2, 2):
        tube = response_tube(result, horizon=2, entry=entry)
        assert tube.upper[1] == pytest.approx(scaling[entry] / 2, rel=1e-2)
        assert tube.upper[1] >= scaling[entry] / 2 * (1 - 1e-5)
        assert tube.error_l1 >= scaling[entry] / 2
        assert tube.verify()
        assert f"u{entry[1] + 1} to y{entry[0] + 1}" in tube.summary()


def test_an_entry_is_named():
    problem, _ = random_matrix_problem(0, 2, 2, 2, rho=1.4)
    result = rid.identify(problem)
    refused(r"`entry` is missing: .* entry=\(output, input\).*'y1', 'y2'", response_tube, result)
    refused(r"`entry` must be \(output, input\)", response_tube, result, entry=3)
    refused("output", response_tube, result, entry=(5, 0), error=rid.RobustIdError)
    assert response_tube(result, entry=("y2", "u1"), horizon=2).entry == (1, 0)

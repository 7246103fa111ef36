"""A-priori diameter: closed forms, and no data set has a wider set of consistent values."""

import dataclasses

import numpy as np
import pytest

import robustid as rid
from robustid.guarantees import diameter
from support.cases import slow
from support.problems import random_problem
from support.refusals import refused


def real_line(bound, *, K=1.0, rho=1.4, value=0.0):
    frf = rid.FrequencyResponse([0.0], [value], bound=bound, dt=0.1)
    return rid.MixedProblem(frequency=frf, prior=rid.Prior(gain_bound=K, decay_rate=rho))


@pytest.mark.parametrize(("K", "bound"), [(1.0, 0.1), (1.0, 0.9), (25.0, 5.0)])
def test_two_real_nodes_by_pick(K, bound):
    # |v - w| <= d |1 - w v| for the values at z = 1 and z = -1, scaled by K, with nodes +-1/rho; |w| <= bound/K.
    rho = 1.4
    d, w = (2 / rho) / (1 + rho**-2), bound / K
    found = diameter(real_line(bound, K=K, rho=rho), omega=[0.0, np.pi / 0.1], rtol=1e-4)
    exact = 2 * K * np.array([w, (w + d) / (1 + w * d)])
    assert np.all(found.lower.ravel() <= exact * (1 + 1e-9))
    assert np.all(exact * (1 - 1e-9) <= found.upper.ravel())
    np.testing.assert_allclose(found.upper.ravel(), exact, rtol=2e-3)
    np.testing.assert_allclose(found.lower.ravel(), exact, rtol=2e-3)
    assert found.verify()


def test_next_to_no_data_leave_the_gain_bound_twice():
    found = diameter(real_line(1e3, K=3.0), omega=[2.0], directions=32, rtol=0.01)
    assert found.lower.item() <= 6.0 <= found.upper.item() <= 6.0 * 1.01
    assert found.lower.item() == pytest.approx(6.0, rel=0.01)


@pytest.mark.parametrize("case", ["mixed", slow("parametric")])
def test_no_data_have_a_wider_set(case):
    # The same inputs, lines and bounds; data of the truth with other errors, some at their bounds.
    noises = (-1.0, 0.5)
    problems = [random_problem(4, case, 10, noise=noise) for noise in noises]
    omega = [20.0, 150.0]
    prior = diameter(problems[0], omega=omega, directions=8)
    for problem in problems:
        error = rid.worst_case_error(rid.identify(problem), omega=omega, directions=8)
        for values, upper in zip(error.values, prior.upper.ravel(), strict=True):
            width = np.abs(values.points[:, None] - values.points).max()
            assert 0 < width <= upper
    assert np.all(prior.lower <= prior.upper)


def test_values_do_not_enter_but_bounds_do():
    one, other = (diameter(real_line(0.3, value=v), omega=[10.0], directions=8) for v in (0.0, 0.8))
    np.testing.assert_array_equal(one.upper, other.upper)
    tight = diameter(real_line(0.1), omega=[10.0], directions=8)
    assert tight.upper.item() < one.lower.item()


def test_intervals_count_by_their_widths():
    # F = p at the line and everywhere (K is next to nothing): the width of the interval, or twice the bound, whichever is less.
    constant = rid.bases.ParametricBasis(
        np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), [[1.0]], 0.1, ("constant",)
    )
    tiny = dataclasses.replace(real_line(0.5, K=1e-6), parametric=constant)
    for ends, width in (((3.0, 3.4), 0.4), ((-7.0, 9.0), 1.0), ((5.0, 5.0), 0.0), ((-np.inf, np.inf), 1.0)):
        found = diameter(dataclasses.replace(tiny, parameter_bounds=[ends]), omega=[0.0], rtol=1e-3)
        assert found.upper.item() == pytest.approx(width, rel=1e-3, abs=4e-6)
        assert found.upper.item() >= width


def test_whole_circle_and_text():
    found = diameter(real_line(0.3), omega=[5.0, 31.0], directions=8)
    assert found.largest >= found.upper.max() * 0.999
    d = (2 / 1.4) / (1 + 1.4**-2)
    assert found.largest >= 2 * (0.3 + d) / (1 + 0.3 * d) * (1 - 1e-9)  # the value at pi/dt
    assert found.largest <= 2 * 1.1  # K in modulus, and the tolerance
    assert f"{found.upper.max():.4g}" in found.summary()
    assert "2 frequencies" in repr(found)


def test_forged_proof_fails():
    found = diameter(real_line(0.3), omega=[5.0], directions=8)
    values = found.error.values[0]
    forged = dataclasses.replace(values, support=values.support - 1e-3)
    assert found.verify()
    assert not dataclasses.replace(found, error=dataclasses.replace(found.error, values=(forged,))).verify()


def test_bad_input():
    problem = real_line(0.1)
    refused("`problem` must be a MixedProblem; got Prior", diameter, problem.prior, error=rid.errors.InputTypeError)
    refused("`omega` must lie between 0 and pi/dt", diameter, problem, omega=[100.0])
    refused("`directions` must be at least 3", diameter, problem, directions=2)

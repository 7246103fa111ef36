"""The fit of damped pairs beside a smooth remainder: its derivatives, and a minimum that a finer search does not lower."""

import numpy as np
import pytest
import scipy.optimize

import robustid as rid
from robustid.advice.kautz import line_data
from robustid.advice.pole_fit import pair_changes, pole_pair, refine, residual_rows, residual_slopes
from robustid.core import ZPlane

pytestmark = pytest.mark.quick

POLES = np.log([[0.56, 0.12], [1.108, 0.005]])  # angle and damping, near those of the simulated structure


@pytest.fixture(scope="module")
def data():
    frf = rid.flexible_structure(lines=40, extra_hz=np.linspace(17.2, 18.1, 10)).frequency
    return line_data([frf], ZPlane(frf.dt))


def test_pairs_change_as_their_differences_say():
    angle, step = np.linspace(0.1, 3, 50), 1e-6
    for pole in POLES:
        for e, change in zip(step * np.eye(2), pair_changes(angle, pole), strict=True):
            quotient = (pole_pair(angle, pole + e) - pole_pair(angle, pole - e)) / (2 * step)
            np.testing.assert_allclose(change, quotient, atol=1e-8 * np.abs(quotient).max())


def test_the_gradient_is_that_of_differences_and_vanishes_at_the_end(data):
    """Kaufman's Jacobian leaves out terms of the size of the residual, which the gradient J'r does not see."""

    def gradient(poles):
        return 2 * residual_slopes(poles, data).T @ residual_rows(poles, data)

    start = POLES.ravel()
    cost = [[np.sum(residual_rows(start + e, data) ** 2) for e in (step, -step)] for step in 1e-6 * np.eye(4)]
    np.testing.assert_allclose(gradient(start), np.diff(cost)[:, 0] / -2e-6, rtol=1e-5)
    end = refine(POLES, data)
    assert np.abs(gradient(end.ravel())).max() < 1e-6 * np.abs(gradient(start)).max()
    finer = scipy.optimize.least_squares(residual_rows, end.ravel(), args=(data,), method="lm", xtol=1e-15, ftol=1e-15)
    np.testing.assert_allclose(finer.x.reshape(-1, 2), end, atol=1e-7)

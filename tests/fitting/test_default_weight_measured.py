"""The default weight on measured data: the error at withheld frequency points is that of the best simple weight."""

import numpy as np
import pytest

import robustid as rid
from robustid.fitting import Weight, fit_mfd
from support.measured import realdata

pytestmark = realdata


def withheld(frf, order, weight_for, **options):
    """Root mean square error at every third point of a fit to the others, per entry; over the choices of the third."""
    squares = []
    for fold in range(3):
        hold = np.arange(frf.omega.size) % 3 == fold
        train, test = frf.select(~hold), frf.select(hold)
        fit = fit_mfd(train, order=order, weight=weight_for(train), restart=False, **options)
        error = np.abs(fit.fraction.response(test.omega) - test.values) ** 2
        squares.append(np.mean(error.sum(axis=0) / np.sum(np.abs(test.values) ** 2, axis=0)))
    return np.sqrt(np.mean(squares))


WEIGHTS = {
    "default": lambda frf: None,
    "unit": lambda frf: Weight(np.ones(frf.values.shape)),
    "relative": lambda frf: Weight.relative(frf.values),
    "covariance": lambda frf: Weight.from_covariance(frf.covariance, *frf.values.shape[1:]),
}


def errors(frf, order, names=tuple(WEIGHTS), **options):
    return {name: withheld(frf, order, WEIGHTS[name], **options) for name in names}


@pytest.mark.slow
def test_bench_of_two_masses():
    """17 degrees of freedom; 5 % at most above the best of unit, relative and covariance weights."""
    found = errors(rid.estimate_frf(rid.datasets.load("two_mass"), period=2500), 4)
    assert found["default"] <= 1.05 * min(found.values()), found


@pytest.mark.slow
def test_mirror_with_few_degrees_of_freedom():
    """9 entries, 10 degrees of freedom, every 96th line: 5 % at most above unit weights."""
    frf = rid.estimate_frf(rid.datasets.load("fsm"), period=8192).select(slice(None, None, 96))
    found = errors(frf, 10, ("default", "unit"), feedthrough=True)
    assert found["default"] <= 1.05 * found["unit"], found


@pytest.mark.slow
@pytest.mark.parametrize("order", [10, 14])
def test_mirror_on_every_eighth_line(order):
    """Against all weights; the covariance as it is makes more than 1.5 times the error."""
    frf = rid.estimate_frf(rid.datasets.load("fsm"), period=8192).select(slice(None, None, 8))
    found = errors(frf, order, feedthrough=True)
    assert found["default"] <= 1.05 * min(found.values()), found
    assert found["covariance"] > 1.5 * found["default"], found

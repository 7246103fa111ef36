"""Least-squares fits that are drawn inside the bounds: few points outside get more weight, the others keep the fit good."""

import control
import numpy as np
import pytest

import robustid as rid
from robustid.core import Budget, points_of
from robustid.reduction.drawn_inside import Bounds, drawn_fits


def data(dt, seed):
    """Two modes, a well-damped third one that fits of order 4 have no place for, and errors; bounds that one value of it breaks."""
    rng = np.random.default_rng(seed)
    omega = np.linspace(2.0, 25.0, 120)
    s = points_of(omega, dt)
    modes = ((20.0, 0.2, 25.0), (30.0, 0.4, 144.0), (15.0, 12.0, 324.0))
    plant = sum(control.tf([gain], [1, twice, square]) for gain, twice, square in modes)
    plant = control.sample_system(plant, dt) if dt else plant
    deviation = 1e-3
    noise = deviation * (rng.normal(size=120) + 1j * rng.normal(size=120)) / np.sqrt(2)
    values = np.asarray(plant(s)) + noise
    frf = rid.FrequencyResponse(omega, values, dt=dt, bound=1.0, covariance=np.full((120, 1, 1), deviation**2))
    fit = rid.fit_mfd(frf, order=4, domain="z" if dt else "s", feedthrough=True)
    left = np.abs(frf.values - np.asarray(fit.to_control()(s)).reshape(-1, 1, 1))
    bound = np.full(120, 2.0 * left.max())
    worst = int(np.argmax(left))
    bound[worst] = 0.85 * left.max()
    return frf.with_bound(bound[:, None, None]), fit


@pytest.mark.parametrize("dt", [None, 0.05])
@pytest.mark.parametrize("seed", [pytest.param(k, marks=pytest.mark.slow) if k else k for k in range(3)])
def test_a_fit_outside_at_one_point_ends_inside_and_hardly_worse(dt, seed):
    frf, fit = data(dt, seed)

    def ratio(model):
        return rid.validate(model, frf).ratio

    def misfit(model):
        return np.linalg.norm(rid.validate(model, frf).residuals)

    bounds = Bounds(ratio, lambda _: None)
    found = list(drawn_fits(frf, fit, bounds, Budget(), domain="z" if dt else "s", feedthrough=True))
    assert ratio(found[0]) > 1.1
    assert ratio(found[-1]) <= 1
    assert misfit(found[-1]) < 1.3 * misfit(found[0])
    assert found[-1].nstates == 4


def test_a_sequence_that_goes_astray_is_ended():
    frf, fit = data(0.05, 0)
    ratios = iter([1.5, 1.4, 1.4, 1.4, 9.0, 9.0, 9.0, 9.0])
    bounds = Bounds(lambda _: next(ratios, 9.0), lambda _: None)
    assert len(list(drawn_fits(frf, fit, bounds, Budget(), feedthrough=True))) <= 4

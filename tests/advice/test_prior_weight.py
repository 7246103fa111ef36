"""Weights of classes from tables: above them everywhere, near to them, and taken by a prior."""

import numpy as np
import pytest

import robustid as rid
from support.refusals import refusals


@pytest.mark.parametrize("dt", [None, 0.01])
def test_the_weight_is_above_its_table_and_near_to_it(dt):
    omega, level = np.array([0.0, 2.0, 30.0, 60.0, 300.0]), np.array([3.0, 3.0, 2.0, 0.5, 0.02])
    weight = rid.advise.prior_weight(omega, level, dt=dt)
    grid = np.geomspace(0.01, 314.0, 800)
    inside = np.maximum(grid, 2.0)
    known = np.exp(np.interp(np.log(inside), np.log(omega[1:]), np.log(level[1:])))
    ratio = np.abs(weight(np.exp(1j * grid * dt) if dt else 1j * grid)) / known
    assert ratio.min() >= 1 - 1e-9
    assert ratio.max() < 2.0
    assert weight.nstates <= 4
    prior = rid.Prior(gain_bound=1.0, decay=1.5, weight=weight)
    frf = rid.FrequencyResponse([20.0, 100.0], [1.0, 0.1], bound=0.05, dt=dt)
    found = rid.identify(rid.MixedProblem(frequency=frf, prior=prior)).require()
    # A level that the data exceed.
    far = frf.select([1])
    low = rid.advise.prior_weight(omega, level / 20, dt=dt)
    small = rid.Prior(gain_bound=1.0, decay=1.5, weight=low)
    assert not rid.identify(rid.MixedProblem(frequency=far, prior=small)).consistent
    assert found.verification.passed


test_wrong_tables_are_refused_with_a_sentence = refusals(
    (([1.0], [1.0]), "two at least; got 1 frequencies"),
    (([1.0, 2.0], [1.0]), "got 2 frequencies and 1 levels"),
    (([2.0, 1.0], [1.0, 1.0]), "must rise"),
    (([1.0, 2.0], [1.0, -20.0]), "not in dB"),
    (([1.0, 400.0], [1.0, 1.0]), "must not exceed pi/dt"),
    (([1.0, np.nan], [1.0, 1.0]), "`omega`"),
    of=lambda omega, level: rid.advise.prior_weight(omega, level, dt=0.01),
)

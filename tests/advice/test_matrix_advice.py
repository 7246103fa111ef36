"""Modes and remedies of responses with several inputs and outputs."""

import dataclasses

import numpy as np
import pytest

import robustid as rid
from robustid.advice import diagnose, suggest_kautz
from support.matrix_lines import DT, HZ, damping_of, lines, measured, plant


def test_modes_are_those_of_all_entries_together():
    """Each mode is seen in another column, at the first line of which it is missing."""
    rng = np.random.default_rng(4)
    truth, _ = plant(rng, 2)
    truth.B[:2, 1] = truth.B[2:, 0] = 0
    frf = lines(rng, truth, bound=0.002, count=40)
    for column, hz in ((0, HZ[1]), (1, HZ[0])):
        alone = suggest_kautz(frf.entry(0, column)).omega / (2 * np.pi)
        assert not np.any(np.abs(alone - hz) < 0.1)
    holes = np.array(frf.bound)
    holes[::7, 0, 0] = np.inf
    found = suggest_kautz(dataclasses.replace(frf, bound=holes, values=np.where(np.isinf(holes), np.nan, frf.values)))
    exact = truth.poles()[truth.poles().imag > 0]
    exact = exact[np.argsort(exact.imag)]
    assert found.omega == pytest.approx(np.abs(np.log(exact)) / DT, rel=1e-3)
    for k, pole in enumerate(np.log(exact)):
        low, high = found.omega_interval[k]
        assert low <= abs(pole) / DT <= high
        low, high = found.damping_interval[k]
        assert low <= -pole.real / abs(pole) <= high


def test_remedies_for_a_matrix_that_contradicts_its_class():
    """Without the second mode: a pair is proposed near it, and the data are consistent then."""
    truth, _, frf = measured(count=10)
    omega = np.abs(np.log(truth.poles()[truth.poles().imag > 0])) / DT
    basis = rid.kautz(omega.min(), damping_of(truth)[0], dt=DT, delay=1)
    problem = rid.MixedProblem(frequency=frf, prior=rid.Prior(gain_bound=0.1, decay_rate=1.2), parametric=basis)
    result = rid.identify(problem)
    assert not result.consistent
    found = {one.name: one.margin for one in diagnose(result).corrections}
    ((at, more),) = ((change.split()[4], margin) for change, margin in found.items() if "one more pair" in change)
    assert float(at) == pytest.approx(9.0, abs=0.1)
    assert more <= 1 < found["K times 2"]

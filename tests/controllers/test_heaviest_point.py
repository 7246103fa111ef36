"""The point of the data that is named is the one whose smaller bound narrows the discs most: every one is tried."""

import dataclasses

import numpy as np
import pytest

import robustid as rid
from robustid.controllers.improvements import heaviest_point
from support.design_cases import band_of


def test_what_the_points_add_is_part_of_the_radius_and_one_of_them_is_named():
    band = band_of(0)[1]
    (frf,), (one,) = band.problem.frequency, band.bands
    for omega in (20.0, 120.0, 290.0):
        angles, added = one.shares(omega * frf.dt)
        radius = band.at(omega)[1][0, 0, 0]
        assert 0 < added.sum() < radius  # the class adds the rest
        assert np.abs(angles[:, None] / frf.dt - frf.omega).min(axis=1).max() < 1e-6
        assert heaviest_point(band, omega) == angles[np.argmax(added)] / frf.dt


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "omega"), [(0, 40.0), (0, 110.0), (1, 75.0), (3, 200.0)])
def test_the_heaviest_point_narrows_the_discs_most(seed, omega):
    band = band_of(seed)[1]
    (frf,) = band.problem.frequency
    near = np.argsort(np.abs(frf.omega - omega))[:8]

    def radius(k, factor):
        bound = frf.bound.outer_radius[:, 0, 0].copy()
        bound[k] *= factor
        changed = dataclasses.replace(band.problem, frequency=frf.with_bound(bound))
        return float(rid.band(changed).at(omega)[1][0, 0, 0])

    before = radius(near[0], 1.0)
    gains = {float(frf.omega[k]): before - radius(k, 0.8) for k in near}
    named = heaviest_point(band, omega)
    assert min(abs(named - one) for one in gains) < 1e-6 * omega
    gain = gains[min(gains, key=lambda one: abs(one - named))]
    assert gain > 0
    assert gain >= 0.8 * max(gains.values())

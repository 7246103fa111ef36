"""The band of data that contradict their class: what would be proved if every bound were larger, kept apart from guarantees."""

import numpy as np
import pytest

import robustid as rid
from support.run_files import keep_whole

MODES, PRIOR = [(9.0, 0.1), (17.3, 0.004)], rid.Prior(gain_bound=0.2, decay_rate=1.1)  # a mode where there is none


@pytest.fixture(scope="module")
def refuted():
    data = rid.datasets.flexible_structure(seed=0, lines=8, samples=6)
    with pytest.MonkeyPatch.context() as patch:
        keep_whole(patch)
        return rid.identify_reduced([data.frequency, data.time], modes=MODES, prior=PRIOR)


def test_data_that_contradict_their_class_have_no_band_but_one_of_wider_bounds(refuted):
    assert not refuted.consistent
    assert refuted.band is None
    assert refuted.worst_case is None
    factor, wider = refuted.wider
    assert factor == pytest.approx(1.1 * refuted.identification.margin)
    for mine, measured in zip(
        (*wider.problem.frequency, *wider.problem.time),
        (*refuted.identification.problem.frequency, *refuted.identification.problem.time),
        strict=True,
    ):
        np.testing.assert_allclose(mine.bound.radius, factor * measured.bound.radius, rtol=1e-12)
    assert wider.certified
    assert refuted.summary().count("No guarantee, but what would be one if every bound were") == 1


def test_systems_that_keep_the_wider_bounds_are_inside_of_it(refuted):
    wider = refuted.wider.band
    result = rid.identify(wider.problem)
    assert result.consistent
    omega = np.linspace(0.5, 300.0, 400)
    centre, radius = wider.at(omega)
    upper = wider.error_at(omega)
    nominal, farthest = wider.problem.plane.values_at(refuted.model, omega), 0.0
    for E in (0.0, 0.9, -0.9):
        values = result.problem.plane.values_at(result.solution(E), omega)
        assert np.all(np.abs(values - centre) <= radius * (1 + 1e-9))
        assert np.all(np.abs(values - nominal) <= upper * (1 + 1e-9))
        farthest = max(farthest, float(np.max(np.abs(values - centre) / radius)))
    assert farthest > 0.05  # no wonder of a huge radius

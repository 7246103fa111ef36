"""Value sets of one entry by sides that start from those beside them, against each side from the centre alone."""

import numpy as np
import pytest

import robustid as rid
from robustid.guarantees.consistent_set import consistent_set
from robustid.guarantees.extremes import largest
from robustid.guarantees.polygons import bisected, value_sets_at
from robustid.guarantees.value_set import along, directions_at, gap_of, value_set_claims
from robustid.identification.formulation import ExactFormulation
from robustid.identification.formulation.sarason import PairMap
from support.cases import seeds
from support.pairwise import every_one

PI = np.pi


def random_problem(seed):
    """A Blaschke product times K and a mode, a third of them with time samples."""
    rng = np.random.default_rng(seed)
    gain, rho, lines = 0.3, rng.uniform(1.03, 1.3), rng.integers(6, 14)
    basis = rid.kautz(rng.uniform(0.3, 2), 10 ** rng.uniform(-2, -1), dt=1.0, delay=1)
    omega = np.sort(rng.uniform(0.05, 3.0, lines))
    z, a = np.exp(-1j * omega) / rho, rng.uniform(-0.9, 0.9)
    values = basis.response(omega) @ rng.standard_normal(2) + gain * (z - a) / (1 - a * z)
    bound = 0.02 * np.abs(values) + 0.01
    values = values + 0.7 * bound * np.sqrt(rng.random(lines)) * np.exp(2j * PI * rng.random(lines))
    frf = rid.FrequencyResponse(omega, values, bound=bound, dt=1.0)
    time = None
    if seed % 3 == 0:
        time = rid.TimeRecord(np.eye(1, 4)[0], np.zeros(4), dt=1.0, bound=5.0)
    prior = rid.Prior(gain_bound=1.2 * gain, decay_rate=rho)
    return rid.identify(rid.MixedProblem(frequency=frf, time=time, prior=prior, parametric=basis))


@pytest.mark.parametrize("seed", seeds(1, 40))
def test_sides_from_those_beside_them_are_those_from_the_centre(seed):
    """Supports within the gap above the exact ones, attained values below them; every certificate holds."""
    result = random_problem(seed)
    assert result.consistent
    consistent = consistent_set(result)
    omega = float(np.random.default_rng(seed).uniform(0.1, 3.0))
    gap = gap_of(0.05, 16, True)
    (found,) = value_sets_at(consistent, omega, 16, gap)
    assert all(claim.verify() for claim in value_set_claims(consistent, found))
    here = consistent.with_node(omega)
    x, p, tail = here.value_weights(omega)
    data, center = here.data, here.center
    for k, angle in enumerate(found.directions):
        functional = along(angle, x, p, tail)
        exact = largest(data, here._supports, center, here.level, functional, 1e-5)
        far = exact.upper - functional(center.x, center.p)
        assert exact.attained <= found.support[k] <= exact.upper + 1.01 * gap * far
        reached = np.real(np.exp(-1j * angle) * found.points[k])
        assert exact.upper >= reached >= exact.attained - 1.01 * gap * far


@pytest.mark.parametrize("seed", seeds(1, 40))
def test_a_sweep_by_quadrature_is_one_by_stored_matrices(seed, monkeypatch):
    """Polygons in which nothing differs but the rounding of the curvature, for which a bound is not a digit less tight."""
    consistent = consistent_set(random_problem(seed))
    assert isinstance(consistent.posed, ExactFormulation)
    (found,) = value_sets_at(consistent, 1.3, 8, 0.01)
    with monkeypatch.context() as patch:
        patch.setattr(PairMap, "_quick_map", PairMap._symmetric_map)
        (slow,) = value_sets_at(consistent_set(random_problem(seed)), 1.3, 8, 0.01)
    size = np.ptp(slow.support)
    assert np.allclose(found.support, slow.support, rtol=0, atol=1e-6 * size)
    assert np.allclose(found.points, slow.points, rtol=0, atol=1e-6 * size)


def test_directions_come_with_those_on_both_sides_before_them():
    for count in range(3, 61):
        order = bisected(count)
        assert sorted(order) == list(range(count))
        for n in range(4, count):
            there = np.array(order[:n])
            steps = (there - order[n]) % count
            assert steps.min() + (-steps % count).min() <= max(np.ceil(count / 4) + 1, 2)
    assert bisected(16)[:8] == [0, 4, 8, 12, 2, 6, 10, 14]


@pytest.mark.parametrize(("rtol", "directions"), every_one([1e-3, 0.02, 0.05, 0.3, 2.0], [3, 4, 8, 16, 24, 64]))
def test_gaps_and_corners_together_keep_the_tolerance(rtol, directions):
    """Of a disc: (1 + gap)/cos(pi/m) is what its radius may seem to be; where corners alone miss it a fifth of it is asked for."""
    gap = gap_of(rtol, directions, True)
    corner = np.cos(PI / directions)
    assert 0 < gap <= 1.5 * (1 / corner - 1)
    assert gap == pytest.approx(min(rtol / 5, 1.5 * (1 / corner - 1))) or 1 - corner / (1 + gap) <= rtol
    assert directions_at(1.0, 1.0, directions).size == directions

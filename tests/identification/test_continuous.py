"""Continuous time: frequency responses without a sample time against Pick's theorem in the half plane."""

import numpy as np
import pytest

import robustid as rid
from robustid.core import SPlane, StateMatrices, bilinear_in_s, bilinear_in_z, response_at
from robustid.identification.formulation.sarason import PairMap
from robustid.identification.region import HalfPlane
from support.cases import seeds
from support.half_plane import edge_truth, smallest_gain
from support.passive import smallest_factor
from support.problems import identified
from support.refusals import refused


def problem_of(omega, values, bound, gain, decay, **more):
    frf = rid.FrequencyResponse(omega, values, bound=bound)
    return rid.MixedProblem(frequency=frf, prior=rid.Prior(gain_bound=gain, decay=decay), **more)


def test_the_plane_keeps_values_poles_and_frequencies():
    rng = np.random.default_rng(0)
    system = StateMatrices(
        rng.standard_normal((3, 3)) - 3 * np.eye(3), *(rng.standard_normal(s) for s in ((3, 2), (1, 3), (1, 2)))
    )
    plane, omega = SPlane(2.5), np.array([0.0, 0.1, 3.0, 1e3])
    angles = plane.angles(omega)
    z = plane.in_z(system)
    assert np.allclose(response_at(z, np.exp(1j * angles)), response_at(system, 1j * omega), rtol=1e-12)
    assert np.allclose(plane.omega(angles), omega, rtol=1e-9)
    assert np.allclose(
        np.sort_complex(plane.exponents(np.linalg.eigvals(z.A))), np.sort_complex(np.linalg.eigvals(system.A))
    )
    for back in (plane.from_z(z), bilinear_in_s(bilinear_in_z(system, 0.3), 0.3)):
        assert all(np.allclose(a, b, atol=1e-12) for a, b in zip(back, system, strict=True))
    assert plane.middle(0.0, np.inf) == pytest.approx(2.5)


@pytest.mark.parametrize("corner", [0.3, 3.0, 40.0])
def test_the_map_of_the_half_plane(corner):
    decay, omega = 0.7, np.array([0.0, 0.2, 2.0, 90.0])
    region, plane = HalfPlane(decay / corner), SPlane(corner)
    angles, a = plane.angles(omega), corner + decay
    s = 1j * omega + decay
    assert np.allclose(region.points(angles), (a - s) / (a + s), atol=1e-14)
    assert np.allclose(region.inside(angles), 1 - np.abs(region.points(angles)) ** 2, rtol=1e-9)
    pole = np.array([-0.9 + 2j])  # Re s < -decay
    assert region.depth((corner + pole) / (corner - pole)) < 1
    assert region.depth((corner + pole + 0.3) / (corner - pole - 0.3)) > 1
    pair = region.pair(angles, 0, ())
    assert np.abs(pair.A.T @ pair.A + pair.c.T @ pair.c - np.eye(7)).max() < 1e-13
    nodes = np.linalg.eigvals(pair.A)
    assert np.abs(nodes[:, None] - region.points(angles)).min(axis=0).max() < 1e-7


def test_the_norm_of_the_data_does_not_depend_on_where_the_basis_is_placed():
    rng = np.random.default_rng(3)
    omega, decay = np.array([0.4, 1.1, 1.3, 5.0, 9.0]), 0.8
    values = rng.standard_normal(5) + 1j * rng.standard_normal(5)
    found = []
    for corner in (0.5, 2.0, 7.0):
        region, angles = HalfPlane(decay / corner), SPlane(corner).angles(omega)
        pair = region.pair(angles, 0, ())
        phi = pair.evaluate(region.points(angles))
        x = np.linalg.solve(np.vstack([phi.real, phi.imag]), np.concatenate([values.real, values.imag]))
        found.append(np.linalg.norm(PairMap(pair).matrix(x), 2))
    assert found == pytest.approx([smallest_gain(omega, values, decay)] * 3, rel=1e-9)


def test_one_value_at_zero_and_any_other_frequency():
    # Schwarz and Pick: K against |w|.
    for omega in (0.0, 3.0):
        assert rid.identify(problem_of([omega], [0.999], 1e-4, 1.0, 2.0)).margin < 1e-6
        refuted = rid.identify(problem_of([omega], [1.01], 1e-2, 1.0, 2.0))
        assert refuted.margin == pytest.approx(1.0, rel=1e-4)


@pytest.mark.parametrize("decay", [0.05, 1.0])
def test_the_smallest_gain_is_that_of_pick_s_theorem(decay):
    rng = np.random.default_rng(8)
    omega = np.sort(rng.uniform(0.1, 8, 6))
    values = edge_truth(rng, 1.0, decay, 9, 3.0)(1j * omega)
    least = smallest_gain(omega, values, decay)
    for factor, consistent in ((1.01, True), (0.99, False)):
        assert identified(problem_of(omega, values, 1e-4, least * factor, decay)).consistent is consistent


@pytest.mark.parametrize("size", [1, 2])
@pytest.mark.parametrize("seed", seeds(1, 60))
def test_the_margin_is_that_of_the_complex_pick_matrix(seed, size):
    rng = np.random.default_rng(seed)
    count, decay = rng.integers(2, 6 if size == 1 else 4), 10 ** rng.uniform(-1, 0.5)
    omega, shape = np.sort(rng.uniform(0.2, 6, count)), (count, size, size)
    values = rng.standard_normal(shape) + 1j * rng.standard_normal(shape)
    bounds = rng.uniform(0.1, 0.6, shape)
    found = rid.identify(problem_of(omega, values, bounds, 1.0, decay), accuracy=1e-7)
    assert found.margin == pytest.approx(
        smallest_factor(omega, values, bounds, decay, bounded=True), rel=1e-5, abs=1e-5
    )


@pytest.mark.parametrize("form", ["orthonormal", "sections"])
def test_modes_and_rest_are_found_in_continuous_time(form):
    rng = np.random.default_rng(2)
    omega = np.linspace(2.0, 60.0, 24)
    basis = rid.kautz([20.0, 41.0], [0.01, 0.02], dt=0)
    p = np.array([2.0, -1.0, 0.5, 3.0])
    rest = edge_truth(rng, 0.3, 20.0, 4, 40.0)
    s = 1j * omega
    values = response_at(basis.matrices, s)[..., 0] @ p + rest(s)
    found = rid.identify(problem_of(omega, values, 2e-3, 0.31, 20.0, parametric=basis), form=form).require()
    assert found.model.dt == 0
    assert np.abs(found.model(s) - values).max() <= 2e-3 * (1 + 1e-5)
    assert np.linalg.eigvals(found.model.A).real.max() < 0
    assert [m.omega for m in found.modes] == pytest.approx([20.0, 41.0])
    assert [m.damping for m in found.modes] == pytest.approx([0.01, 0.02])
    assert found.parameters == pytest.approx(p, abs=0.3)


def test_continuous_pairs_have_unit_norm_and_their_poles():
    basis = rid.kautz([3.0, 5.0], [0.1, 1.0], dt=0, repeat=2)
    assert basis.labels[:4] == ("Re 0.4775 Hz", "Im 0.4775 Hz", "Re 0.4775 Hz (t^1)", "Im 0.4775 Hz (t^1)")
    assert sorted(np.abs(basis.poles)) == pytest.approx([3.0] * 4 + [5.0] * 2)
    w = np.linspace(-3000, 3000, 600001)
    square = np.abs(response_at(basis.matrices, 1j * w)[..., 0]) ** 2
    assert np.trapezoid(square, w, axis=0) / 2 / np.pi == pytest.approx(np.ones(6), rel=2e-3)
    one = rid.integrators(2, dt=0)
    assert np.allclose(response_at(one.matrices, [2j])[0, :, 0], [1 / 2j, 1 / 2j**2])


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"prior": rid.Prior(gain_bound=1.0, decay_rate=1.1)}, "continuous time .*`decay` in 1/s"),
        ({"parametric": rid.kautz(1.0, 0.1, dt=0.1)}, "`parametric` is of dt = 0.1 s, the data are of continuous time"),
        ({"time": rid.TimeRecord([1.0], [0.0], dt=0.1, bound=1.0)}, "continuous time .*others are sampled"),
    ],
)
def test_two_kinds_of_time_are_not_mixed(change, words):
    frf = rid.FrequencyResponse([1.0], [0.1], bound=0.1)
    with pytest.raises(rid.InputError, match=words):
        rid.MixedProblem(**({"frequency": frf, "prior": rid.Prior(gain_bound=1.0, decay=1.0)} | change))


def test_a_decay_in_seconds_serves_discrete_data_too():
    frf = rid.FrequencyResponse([1.0], [0.1], bound=0.1, dt=0.1)
    problem = rid.MixedProblem(frequency=frf, prior=rid.Prior(gain_bound=1.0, decay=2.0))
    assert problem.prior.decay_rate == pytest.approx(np.exp(0.2))
    refused("one of the two; got both", rid.Prior, gain_bound=1.0, decay=1.0, decay_rate=1.1)
    refused("`delay` is a number of samples", rid.kautz, 1.0, 0.1, dt=0, delay=1)
    refused('"taylor" is for sampled data', rid.identify, problem_of([1.0], [0.1], 0.1, 1.0, 1.0), form="taylor")

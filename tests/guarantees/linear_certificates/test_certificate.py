"""The norm of combinations of samples against sums over the circle, and radii of exact data against closed forms."""

import dataclasses

import numpy as np
import pytest

import robustid as rid
from robustid.guarantees.linear.certificate import Amplitudes, choose, discs, targets_at
from robustid.guarantees.linear.disc_values import DiscValues
from robustid.guarantees.linear.functions import fixed_functions
from robustid.guarantees.linear.samples import samples_of
from support.cases import seeds
from support.edge_plants import inner

SEEDS = seeds(2, 50)
DT = 0.1


def poisson_norm(functionals, base):
    """Inner products of functionals (S, N) of coefficients of polynomials, in the mean over the circle as seen from `base`."""
    size, count = 2**12, functionals.shape[1]
    circle = np.exp(2j * np.pi * np.arange(size) / size)
    weight = (1 - abs(base) ** 2) / np.abs(circle - base) ** 2 / size
    powers = circle[:, None] ** np.arange(count)
    norm = powers.conj().T @ (weight[:, None] * powers)  # |p|^2 = p* norm p
    return functionals @ np.linalg.solve(norm, functionals.conj().T)


def mixed_problem(seed):
    """Points of both entries of a row, and a record that sees both; rho is 1.5."""
    rng = np.random.default_rng(seed)
    omega, gain, samples = np.sort(rng.uniform(0.1, 31, 4)), rng.uniform(0.1, 10), 9
    values = rng.standard_normal((4, 1, 2)) + 0j
    u = rng.standard_normal((samples, 2))
    return rid.MixedProblem(
        frequency=rid.FrequencyResponse(omega, values, bound=0.1, dt=DT),
        time=rid.TimeRecord(u, rng.standard_normal(samples), dt=DT, bound=0.1),
        prior=rid.Prior(gain_bound=gain, decay_rate=1.5),
    ), u, rng  # fmt: skip


@pytest.mark.parametrize("seed", SEEDS)
def test_inner_products_of_points_and_of_samples_of_records_are_those_of_sums_over_the_circle(seed):
    problem, u, rng = mixed_problem(seed)
    samples = samples_of(problem, fixed_functions(None), (0, int(rng.integers(2))))
    assert samples.components == ((0, 0), (0, 1))
    angle, count, gain, rho = rng.uniform(-3, 3), 90, problem.prior.gain_bound, 1.5
    targets = targets_at(samples, np.array([angle]))
    chosen = choose(samples, targets, np.arange(samples.angles.size)[None])
    omega = problem.frequency[0].omega
    powers = gain * (np.exp(-1j * DT * np.concatenate([omega, -omega]))[:, None] / rho) ** np.arange(count)
    nothing = np.zeros_like(powers)
    wanted = [np.block([[powers, nothing], [nothing, powers]])]
    # y_t = sum_k h_k u_(t-k), h_k = K rho^-k times the k-th coefficient.
    for t in range(len(u)):
        row = np.zeros((2, count), complex)
        row[:, : t + 1] = gain * u[t::-1].T * rho ** -np.arange(t + 1.0)
        wanted.append(row.reshape(1, -1))
    target = np.zeros((2, count), complex)
    target[samples.entry[1]] = gain * (np.exp(-1j * angle) / rho) ** np.arange(count)
    functionals = np.concatenate([*wanted, target.reshape(1, -1)])
    base = np.exp(-1j * angle) / rho
    norm = sum(poisson_norm(part, base) for part in np.split(functionals, 2, axis=1))
    order = np.concatenate([place_of(samples, omega), np.arange(samples.angles.size, len(functionals) - 1)])
    own = norm[:-1, :-1][np.ix_(order, order)]
    np.testing.assert_allclose(chosen.gram[0], own, rtol=1e-9, atol=1e-9 * np.abs(own).max())
    np.testing.assert_allclose(chosen.cross[0], norm[:-1, -1][order], rtol=1e-9, atol=1e-9 * np.abs(own).max())
    np.testing.assert_allclose(abs(targets.weight[0]) ** 2, norm[-1, -1].real, rtol=1e-9)


@pytest.mark.parametrize("modes", [0, 1])
@pytest.mark.parametrize("seed", SEEDS)
def test_discs_without_matrices_are_those_with_them_also_of_points_that_stand_twice(seed, modes):
    problem, _, rng = mixed_problem(seed)
    kautz = rid.kautz(rng.uniform(3, 25), 0.02, dt=DT) if modes else None
    problem = dataclasses.replace(problem, parametric=kautz)
    samples = samples_of(problem, fixed_functions(kautz), (0, 1))
    centre = rng.standard_normal(samples.amplitudes) + 1j * rng.standard_normal(samples.amplitudes)
    known = Amplitudes(centre, rng.random(samples.amplitudes))
    angles = rng.uniform(0, 3, 7)
    points = rng.integers(samples.angles.size, size=(7, 9))
    d = rng.standard_normal((7, 9 + samples.rows)) + 1j * rng.standard_normal((7, 9 + samples.rows))
    targets = targets_at(samples, angles)
    wanted = discs(samples, choose(samples, targets, points), targets, d, known)
    found = DiscValues(samples, known).at(angles, points, d)
    for one, other in zip(found, wanted, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-11)


def place_of(samples, omega):
    """Which of the functionals, entry after entry and angle after angle, every point is."""
    angles = DT * np.concatenate([omega, -omega])
    component = np.argmax(np.abs(samples.v), axis=1)
    at = np.abs(samples.angles[:, None] - angles).argmin(axis=1)
    return component * angles.size + at


def response_problem(seed, values, bound, count=4, **kwargs):
    rng = np.random.default_rng(seed)
    rho, gain = rng.choice([1.05, 1.2, 1.5]), 10 ** rng.uniform(-3, 3)
    omega = np.sort(rng.uniform(0.1, 31, count))
    zeta = np.exp(-1j * omega * DT) / rho
    frf = rid.FrequencyResponse(omega, gain * values(rng, zeta), bound=gain * bound, dt=DT)
    return rid.MixedProblem(frequency=frf, prior=rid.Prior(gain_bound=gain, decay_rate=rho), **kwargs)


def small(rng, zeta):
    """A function of modulus below 1/2, at the edge of nothing."""
    a, b = rng.uniform(-0.9, 0.9, 2)
    return 0.25 * (zeta - a) / (1 - a * zeta) + 0.25 * b


def factors(problem, omega):
    """Product of the distances of frequencies from all points and their conjugates, as seen in the disc |zeta| < 1."""
    rho, own = problem.prior.decay_rate, problem.frequency[0].omega
    zeta, nodes = np.exp(-1j * omega * DT) / rho, np.exp(-1j * DT * np.concatenate([own, -own])) / rho
    return np.prod(np.abs((zeta[:, None] - nodes) / (1 - nodes.conj() * zeta[:, None])), axis=1)


@pytest.mark.parametrize("seed", SEEDS)
def test_exact_data_leave_the_product_of_the_distances_from_all_points_times_the_gain(seed):
    problem = response_problem(seed, small, 1e-9)
    omega = np.random.default_rng(seed).uniform(0, np.pi / DT, 40)
    found = rid.band(problem, omega=omega)
    wanted = problem.prior.gain_bound * factors(problem, found.omega)
    away = wanted > 1e-4 * problem.prior.gain_bound  # elsewhere the bounds of the samples count
    assert away.sum() >= 20
    np.testing.assert_allclose(found.radius[away, 0, 0], wanted[away], rtol=1e-3)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_band_holds_the_disc_of_pick_and_is_as_wide_where_the_data_are_zero(seed):
    omega = np.random.default_rng(seed).uniform(0, np.pi / DT, 60)
    for values, same in ((small, False), (lambda rng, zeta: 0 * zeta, True)):
        problem = response_problem(seed, values, 1e-6)
        found = rid.band(problem)
        (centre, radius), (middle, least) = found.at(omega), rid.identify(problem).weyl_disc(omega)
        assert np.all(np.abs(centre[:, 0, 0] - middle) + least <= radius[:, 0, 0] * (1 + 1e-9))
        if same:
            at = rid.band(problem, omega=omega)
            least = rid.identify(problem).weyl_disc(at.omega)[1]
            away = least > 0.01 * problem.prior.gain_bound
            np.testing.assert_allclose(at.radius[away, 0, 0], least[away], rtol=1e-2)


@pytest.mark.parametrize(
    ("dt", "decay", "falls"),
    [
        (DT, {"decay_rate": 1.2}, {}),
        (None, {"decay": 3.0}, {}),
        (None, {"decay": 3.0}, {"roll_off": 2, "corner": 20.0}),
    ],
)
def test_data_that_say_nothing_leave_the_bound_of_the_class(dt, decay, falls):
    """K, or K |W|, whatever the values."""
    omega = np.linspace(1, 30, 12)
    frf = rid.FrequencyResponse(omega, np.exp(1j * omega), bound=1e3, dt=dt)
    found = rid.band(rid.MixedProblem(frequency=frf, prior=rid.Prior(gain_bound=2.0, **decay, **falls)))
    at = np.random.default_rng(0).uniform(0, 31, 100)
    most = 2.0 * (np.abs(1 + (1j * at + 3.0) / 20.0) ** -2 if falls else 1.0)
    np.testing.assert_allclose(found.at(at)[1][:, 0, 0], np.broadcast_to(most, at.shape), rtol=1e-6)
    assert np.all(found.at(at)[1][:, 0, 0] <= most * (1 + 1e-6))


@pytest.mark.parametrize("dt", [pytest.param(DT, marks=pytest.mark.slow), None])
@pytest.mark.parametrize("seed", seeds(1, 50))
def test_lossless_networks_are_inside_bounded_real_bands(dt, seed):
    """All singular values are 1 on the border of the class, and the errors of the samples as large as their bounds."""
    rng = np.random.default_rng(seed)
    omega, decay = np.sort(rng.uniform(1, 30, 15)), 5.0
    prior = rid.BoundedReal(decay=decay) if dt is None else rid.BoundedReal(decay_rate=1.2)

    def truth(w):
        zeta = np.exp(-1j * w * dt) / 1.2 if dt else (50 - decay - 1j * w) / (50 + decay + 1j * w)
        return inner(np.random.default_rng(seed), 2, 2, zeta)

    values = truth(omega)
    values = values + 0.02 * np.exp(2j * np.pi * rng.random(values.shape)) * (1 - 1e-9)
    frf = rid.FrequencyResponse(omega, values, bound=np.full(values.shape, 0.02), dt=dt)
    found = rid.band(rid.MixedProblem(frequency=frf, prior=prior))
    at = rng.uniform(*found.range, 200)
    centre, radius = found.at(at)
    assert np.all(np.abs(truth(at) - centre) <= radius)
    assert np.all(radius <= 1 + 1e-6)  # at most what the class says without data
    between = (omega[0] < at) & (at < omega[-1])
    assert np.median(radius[between]) < 0.5

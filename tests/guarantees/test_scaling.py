"""Diagonal scalings: against closed forms, a linear matrix inequality, and perturbations that make the loop singular."""

import cvxpy as cp
import numpy as np
import pytest

from robustid.guarantees.cells import STRUCTURES, shape_of
from robustid.guarantees.scaling import best_scaling, perron_scaling
from support.cases import slow
from support.destabilising import destabilising


def upper_bound(loop, bound, find=best_scaling):
    sizes = find(loop[None], bound[None]).gain(loop[None], bound[None])
    return float(np.prod(sizes))


def drawn(rng, nu, ny):
    """KS with channels of other units, and bounds of all entries."""
    loop = rng.normal(size=(nu, ny)) + 1j * rng.normal(size=(nu, ny))
    return loop * np.exp(2 * rng.normal(size=(nu, 1))), np.exp(rng.normal(size=(ny, nu)))


def by_inequality(loop, bound):
    """The D-scaled bound with one number for every entry of the uncertainty, by bisection over an LMI of cvxpy."""
    nu, ny = loop.shape
    total = np.kron(np.eye(ny), np.ones((1, nu)))
    through = loop @ total
    low, high = 0.0, np.linalg.norm(loop, 2) * np.linalg.norm(bound, 2) * 1.01
    scales = cp.Variable((ny, nu))
    worst = cp.Variable()
    square = cp.Parameter(nonneg=True)
    gains = [
        scales[i, j] * bound[i, j] ** 2 * np.outer(through[j].conj(), through[j]) for i in range(ny) for j in range(nu)
    ]
    form = square * sum(gains) - cp.diag(cp.reshape(scales, ny * nu, order="C"))
    real = cp.bmat([[cp.real(form), -cp.imag(form)], [cp.imag(form), cp.real(form)]])
    limits = [real << worst * np.eye(2 * ny * nu), scales >= 1e-6, cp.sum(scales) == 1]
    problem = cp.Problem(cp.Minimize(worst), limits)
    while high - low > 1e-4 * high:
        middle = (low + high) / 2
        square.value = 1 / middle**2
        problem.solve(solver="CLARABEL")
        low, high = (low, middle) if worst.value < 0 else (middle, high)
    return high


@pytest.mark.filterwarnings("ignore:Solution may be inaccurate")
@pytest.mark.parametrize(
    ("shape", "seed", "tolerance"),
    [((2, 2), 2, 3e-4), *(slow(shape, seed, 5e-4) for shape in ((2, 2), (2, 3), (3, 2)) for seed in range(4))],
)
def test_scalings_of_signals_are_as_good_as_one_for_every_entry(shape, seed, tolerance):
    loop, bound = drawn(np.random.default_rng(seed), *shape)
    assert upper_bound(loop, bound) == pytest.approx(by_inequality(loop, bound), rel=tolerance)


@pytest.mark.parametrize("shape", [(1, 1), (2, 2), (3, 2), (2, 4), (5, 5)])
def test_closed_forms(shape):
    rng = np.random.default_rng(3)
    loop, bound = drawn(rng, *shape)
    nu, ny = shape
    # Of rank one: the worst phases align.
    p, q = loop[:, 0], loop[0]
    assert upper_bound(np.outer(p, q), bound) == pytest.approx(np.abs(q) @ bound @ np.abs(p), rel=2e-3)
    # Without negative entries: the Perron root, and never more than that of the moduli.
    root = np.abs(np.linalg.eigvals(bound @ np.abs(loop))).max()
    assert upper_bound(np.abs(loop), bound) == pytest.approx(root, rel=1e-6)
    assert upper_bound(loop, bound, perron_scaling) <= root * (1 + 1e-6)
    assert upper_bound(loop, bound) <= upper_bound(loop, bound, perron_scaling) * (1 + 1e-9)
    # The whole matrix: plain small gain.
    full = np.array([[0.7]])
    assert upper_bound(loop, full) == pytest.approx(0.7 * np.linalg.norm(loop, 2), rel=1e-14)
    # Diagonal, with errors on the diagonal only.
    if nu == ny:
        little = bound * (np.eye(nu) + 1e-9)
        expected = np.abs(np.diag(loop) * np.diag(bound)).max()
        assert upper_bound(np.diag(np.diag(loop)), little) == pytest.approx(expected, rel=2e-3)


def test_two_columns_have_the_minimum_over_one_number():
    """Two blocks: min over beta in closed form, here by a fine search."""
    rng = np.random.default_rng(4)
    for _ in range(5):
        loop, _ = drawn(rng, 2, 3)
        bound = rng.uniform(0.1, 1.0, (1, 2))
        ratios = np.geomspace(1e-4, 1e4, 20001)
        weights = np.stack([np.ones(ratios.size), ratios], axis=1)
        sizes = np.linalg.norm(weights[:, :, None] * loop, 2, axis=(1, 2)) * np.linalg.norm(bound / weights, axis=1)
        assert upper_bound(loop, bound) == pytest.approx(sizes.min(), rel=2e-3)


@pytest.mark.parametrize("structure", STRUCTURES)
def test_no_perturbation_of_the_structure_is_singular_earlier(structure):
    """Lower bounds by search: never above, and equal where the theory says so (at most three blocks), in 4 of 4 draws."""
    for seed in range(4):
        rng = np.random.default_rng(seed)
        loop, _ = drawn(rng, 2, 2)
        bound = rng.uniform(0.2, 1.0, shape_of(structure, (2, 2)))
        delta, size = destabilising(loop, bound, rng, tries=8, steps=30)
        found = upper_bound(loop, bound)
        assert size >= (1 - 1e-9) / found
        assert abs(np.linalg.det(np.eye(2) + size * delta @ loop)) < 1e-9
        if structure != "entry":
            assert size == pytest.approx(1 / found, rel=2e-3)
        else:
            assert size <= 1.1 / found

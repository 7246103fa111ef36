"""Errors of two sides that close a loop at a frequency: exact conditions, eigenvalues of products, passivity on arcs."""

import control
import numpy as np
import pytest

from robustid.guarantees.loop_errors import closing_error, factor_alone, loci, passive_factors, structured_gain
from support.loop_bands import loop_of_discs, stable_model, values


def test_two_discs_are_decided_exactly():
    """Against the closed form and against values on both circles: a product is -1 iff -1/G is within b of h for some G."""
    rng, decided = np.random.default_rng(3), 0
    circle = np.exp(2j * np.pi * np.arange(4000) / 4000)
    for _ in range(300):
        g, h = rng.normal(size=2) + 1j * rng.normal(size=2)
        a, b = 10 ** rng.uniform(-1.5, 0.3, 2)
        gain = structured_gain(loop_of_discs(g, h), np.diag([a, b]))
        size = abs(1 + g * h)
        closed = size**2 + (a * b) ** 2 - (a * abs(h)) ** 2 - (b * abs(g)) ** 2 - 2 * a * b > 0 and a * b < size
        if abs(gain - 1) < 1e-3:
            continue
        decided += 1
        assert (gain < 1) == closed
        # -1/G over the disc of G is what lies within the image of its circle (outside, if the disc holds 0).
        image = -1 / (g + a * circle)
        reached = np.abs(image - h).min() <= b
        inside = abs(g) > a and np.abs(-np.conj(g) / (abs(g) ** 2 - a**2) - h) < a / (abs(g) ** 2 - a**2)
        outside = abs(g) < a and np.abs(-np.conj(g) / (abs(g) ** 2 - a**2) - h) > a / (a**2 - abs(g) ** 2)
        assert (gain < 1) == (not (reached or inside or outside))
    assert decided > 280


def test_the_least_error_that_closes_a_loop_of_two_discs_is_found():
    rng = np.random.default_rng(4)
    for _ in range(10):
        g, h = rng.normal(size=2) + 1j * rng.normal(size=2)
        bound = np.diag(10 ** rng.uniform(-2, 0, 2))
        loop = loop_of_discs(g, h)
        errors, factor, shares = closing_error(loop, bound)
        delta = factor * errors
        assert factor == pytest.approx(1 / structured_gain(loop, bound), rel=1e-4)
        assert shares.sum() == pytest.approx(1)
        np.testing.assert_allclose(np.abs(delta), factor * bound, atol=1e-12)
        assert abs(1 + (g + delta[0, 0]) * (h + delta[1, 1])) < 1e-9 * (1 + abs(g * h))


def test_one_side_alone_shrinks_to_where_the_condition_holds():
    loop, bound = loop_of_discs(0.8, 0.9), np.diag([3.0, 0.3])
    place = slice(0, 1), slice(0, 1)
    factor = factor_alone(loop, bound, place)
    a = 3.0 * factor
    size, b = 1 + 0.8 * 0.9, 0.3
    assert 0 < factor < 1
    assert size**2 + (a * b) ** 2 - (a * 0.9) ** 2 - (b * 0.8) ** 2 - 2 * a * b == pytest.approx(0, abs=1e-6)
    assert factor_alone(loop, np.diag([1.0, 9.0]), place) == 0
    assert factor_alone(loop, np.diag([0.1, 0.1]), place) == 1


def test_the_eigenvalues_of_every_product_lie_in_their_discs():
    rng = np.random.default_rng(5)
    for _ in range(200):
        G, H, dG, dH = (rng.normal(size=(2, 2)) + 1j * rng.normal(size=(2, 2)) for _ in range(4))
        first, second = 0.1 * np.abs(dG), 0.1 * np.abs(dH)
        centres, radii = loci(G[None], H[None], (first[None], second[None]))
        for value in np.linalg.eigvals((G + 0.1 * dG) @ (H + 0.1 * dH)):
            assert np.any(np.abs(value - centres[0]) <= radii[0])


def test_members_within_the_factor_of_passivity_are_passive_and_beyond_it_one_is_not():
    rng = np.random.default_rng(6)
    angles = np.linspace(0, np.pi, 30)
    for _ in range(4):
        model = stable_model(rng, 2, 2, 1.0, 1.0) + 1.5 * np.eye(2)
        entries = np.tile(rng.uniform(0.1, 0.5, (1, 2, 2)), (29, 1, 1))
        known = control.ss([], [], [], np.eye(2), 1.0)
        factors = passive_factors((model, known), angles, (entries, np.zeros_like(entries)), (False, False))
        for cell, factor in enumerate(factors):
            inside = np.linspace(angles[cell], angles[cell + 1], 9)
            at = values(model, inside)
            least = np.linalg.eigvalsh(at + at.conj().swapaxes(1, 2))[:, 0]
            worst = np.linalg.norm(entries[cell] + entries[cell].T, 2)
            assert np.all(least >= factor * worst - 1e-12)
            if factor > 1:
                assert np.any(least <= 1.1 * factor * worst)

"""Enclosures of the values of a model on cells of the circle."""

import numpy as np
import pytest

from robustid.guarantees.cells import enclose
from support.weights import random_model, values_of

pytestmark = pytest.mark.quick


@pytest.fixture
def rng():
    return np.random.default_rng(5)


def test_enclosed_values_hold_on_the_whole_piece(rng):
    model = random_model(rng, 2, 3, states=6, radius=0.99)
    angles = np.linspace(0, np.pi, 9)
    pieces = enclose(
        model, angles, lambda p: np.linalg.norm(p.radius, axis=(1, 2)) > 0.05 * np.linalg.norm(p.values, axis=(1, 2))
    )
    assert np.array_equal(np.unique(pieces.cell), np.arange(8))
    order = np.argsort(pieces.middle)
    middle = pieces.middle[order]
    for theta in rng.uniform(0, np.pi, 2000):
        # One of the two neighbouring pieces holds the point; both tell where they end by their order.
        k = np.searchsorted(middle, theta)
        F = values_of(model, np.array([theta / 0.1]))[0]
        near = [order[i] for i in (k - 1, k) if 0 <= i < middle.size]
        assert any(np.all(np.abs(F - pieces.values[i]) <= pieces.radius[i]) for i in near)

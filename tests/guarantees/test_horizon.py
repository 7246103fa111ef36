"""Bounds of impulse responses after a horizon, against closed forms and sums."""

import numpy as np
import pytest

import robustid as rid
from robustid.guarantees.outputs import tail_bounds

pytestmark = pytest.mark.quick


@pytest.mark.parametrize("start", [1, 7])
def test_tails_of_impulse_responses(start):
    for a in (0.3, -0.9, 0.9999):
        total, largest = tail_bounds(np.array([[a]]), np.array([[2.0]]), np.array([[3.0]]), start)
        assert total[0] == pytest.approx(6 * abs(a) ** (start - 1) / (1 - abs(a)), rel=1e-6)
        assert total[0] >= 6 * abs(a) ** (start - 1) / (1 - abs(a)) * (1 - 1e-12)
        assert largest[0] == pytest.approx(6 * abs(a) ** (start - 1), rel=1e-6, abs=1e-8)
    pair = rid.kautz(20.0, 0.004, dt=0.01, delay=1)
    h = np.abs(pair.impulse(100_000))[start:]
    total, largest = tail_bounds(pair.A, pair.B, pair.C, start)
    np.testing.assert_allclose(total, h.sum(axis=0), rtol=1e-5)
    np.testing.assert_allclose(largest, h.max(axis=0), rtol=1e-5)
    assert np.all(total >= h.sum(axis=0) * (1 - 1e-12))
    assert np.all(largest >= h.max(axis=0) * (1 - 1e-12))
    assert np.isinf(tail_bounds(np.eye(1), np.eye(1), np.eye(1), start)[0][0])

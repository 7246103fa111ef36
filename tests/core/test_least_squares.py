"""Lengths to divide by: norms, and 1 where there is nothing."""

import numpy as np
import pytest

from robustid.core import lengths

pytestmark = pytest.mark.quick


def test_lengths_are_norms_but_never_zero():
    matrix = np.array([[3.0, 0.0, 1j], [4.0, 0.0, 0.0]])
    assert np.array_equal(lengths(matrix), [5.0, 1.0, 1.0])
    assert np.array_equal(lengths(matrix[:, 1:2], axis=1), [1.0, 1.0])
    assert lengths(matrix, axis=1, keepdims=True).shape == (2, 1)

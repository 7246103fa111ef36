"""Exact matrices: against fractions, and definiteness at the last digit."""

from fractions import Fraction

import numpy as np
import pytest

from robustid.passivity import exact_matrices
from robustid.passivity.exact_matrices import Exact, beside, is_positive_definite, solved, symmetric_blocks

pytestmark = pytest.mark.quick


def fractions(matrix):
    return [[Fraction(int(x)) * Fraction(2) ** matrix.power for x in row] for row in matrix.digits]


def test_sums_and_products_are_those_of_fractions():
    rng = np.random.default_rng(0)
    a, b = (rng.standard_normal((3, 3)) * 10.0 ** rng.integers(-30, 30, (3, 3)) for _ in range(2))
    a[0, 1] = 0.0
    x, y = ([[Fraction(v) for v in row] for row in part.tolist()] for part in (a, b))
    want = [[sum(x[i][k] * y[k][j] for k in range(3)) - x[j][i] for j in range(3)] for i in range(3)]
    assert fractions(Exact.of(a) @ Exact.of(b) - Exact.of(a).T) == want
    corner = symmetric_blocks(Exact.of(a), Exact.of(b), Exact.of(a))
    assert fractions(corner)[0][3:] == y[0]
    assert fractions(corner)[4][:3] == [y[k][1] for k in range(3)]
    assert fractions(beside(Exact.of(a), Exact.of(b)))[2] == x[2] + y[2]


def test_equations_are_solved_without_a_remainder():
    rng = np.random.default_rng(1)
    a, b = Exact.of(rng.standard_normal((5, 5))), Exact.of(rng.standard_normal((5, 2)))
    x, factor = solved(a, b)
    assert factor != 0
    assert (a @ x - b.times(factor)).is_zero()
    assert solved(Exact.of(np.ones((2, 2))), Exact.of(np.ones((2, 1))))[1] == 0


@pytest.mark.parametrize("scale", [2.0**-300, 1.0, 2.0**300])
def test_definiteness_is_told_at_the_last_digit(scale):
    rng = np.random.default_rng(2)
    half = rng.integers(-8, 9, (6, 3)).astype(float)
    rank_three = Exact.of(half * scale) @ Exact.of(half).T
    least = 2.0**-40 * scale
    assert not is_positive_definite(rank_three)
    assert is_positive_definite(rank_three + Exact.of(least * np.eye(6)))
    assert not is_positive_definite(rank_three - Exact.of(least * np.eye(6)))
    spread = Exact.of(np.diag(10.0 ** np.array([-80, -40, 0, 30, 60, 90])))
    assert is_positive_definite(spread @ (rank_three + Exact.of(least * np.eye(6))) @ spread)


def test_large_products_are_the_same_without_the_library(monkeypatch):
    rng = np.random.default_rng(3)
    a, b = (Exact.of(rng.standard_normal((40, 40)) * 2.0**k) for k in (0, 60))
    product = (a @ b).digits
    monkeypatch.setattr(exact_matrices, "_flint", lambda: None)
    assert np.array_equal((a @ b).digits, product)
    assert all(type(x) is int for x in product.ravel())

"""The columns of a MIMO problem, of which every entry has its own: along axes they are as sparse as before."""

import numpy as np
import pytest

from robustid.identification.formulation.ball import Axes
from robustid.identification.formulation.columns import BlockColumns, ColumnPart, DenseColumns, DenseDesign


def columns(*slices, rows=7, width=6):
    """E (N, 6) with a random block of complex rows for every slice of columns."""
    rng, parts = np.random.default_rng(len(slices)), []
    for k, one in enumerate(slices):
        array = rng.standard_normal((rows, one.stop - one.start, 2)) @ [1, 1j]
        parts.append(ColumnPart(slice(rows * k, rows * (k + 1)), one, DenseColumns(array)))
    return BlockColumns(tuple(parts), (rows * len(slices), width))


@pytest.mark.parametrize(
    ("slices", "groups"),
    [
        ([slice(0, 2), slice(2, 4), slice(4, 6), slice(2, 4)], 3),  # one entry in two experiments
        ([slice(0, 2), slice(2, 6)], 1),  # of unequal widths: together
        ([slice(0, 2), slice(0, 6), slice(2, 4), slice(4, 6)], 1),  # a sample of all of them
        ([slice(0, 2), slice(4, 6)], 1),  # an entry that nothing was measured of
    ],
)
def test_columns_along_axes_are_the_product_of_the_whole(slices, groups):
    E, rng = columns(*slices), np.random.default_rng(0)
    apart = E.apart()
    assert len(apart) == groups
    np.testing.assert_allclose(sum(np.vdot(one, one) for one in apart), np.vdot(E.dense(), E.dense()))
    axes = Axes(np.linalg.qr(rng.standard_normal((groups, 6 // groups, 6 // groups)))[0])
    V = axes.away(np.eye(6))
    turned = E.turned(axes)
    np.testing.assert_allclose(turned.dense(), E.dense() @ V, atol=1e-13)
    N, Q = E.shape[0], np.zeros((E.shape[0], 1), complex)
    Q[:7, 0] = rng.standard_normal(7)
    a, b = rng.uniform(1, 2, N), rng.uniform(-0.5, 0.5, N).astype(complex)
    whole = DenseDesign(np.hstack([E.dense() @ V, Q]), N)
    np.testing.assert_allclose(turned.design(Q, N).gram(a, b), whole.gram(a, b), atol=1e-12)

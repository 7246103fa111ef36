"""Weights of matrix fractions against the Kronecker products that they stand for."""

import numpy as np
import pytest

from robustid.errors import InputError
from robustid.fitting import Weight
from support.mfd_systems import gaussian

pytestmark = pytest.mark.quick


def vec(matrix):
    return matrix.T.ravel()


def test_weight_is_the_kronecker_product_it_stands_for():
    rng = np.random.default_rng(0)
    lines, ny, nu = 4, 3, 2
    parts = {"output": ny, "input": nu, "matrix": ny * nu}
    parts = {name: gaussian(rng, lines, size, size) for name, size in parts.items()}
    weight = Weight(rng.uniform(0, 2, (lines, ny, nu)), **parts)
    residual, inverse, left = gaussian(rng, lines, ny, nu), gaussian(rng, lines, nu, nu), gaussian(rng, lines, ny, 5)
    columns = weight.linearised(inverse.transpose(0, 2, 1), left)
    for k in range(lines):
        W = weight.matrix[k] @ np.diag(vec(weight.entries[k])) @ np.kron(weight.input[k].T, weight.output[k])
        np.testing.assert_allclose(weight.apply(residual)[k], W @ vec(residual[k]), rtol=1e-12)
        np.testing.assert_allclose(columns[k], W @ np.kron(inverse[k].T, left[k]), rtol=1e-11)
        lengths = np.linalg.norm(W, axis=0)
        np.testing.assert_allclose(vec(weight.entrywise[k]), lengths, rtol=1e-13)
        assert weight.size[k] == pytest.approx(np.sqrt(np.mean(lengths**2)), rel=1e-13)
    turned = weight.transposed().apply(residual.transpose(0, 2, 1))
    np.testing.assert_allclose(np.sum(np.abs(turned) ** 2), np.sum(np.abs(weight.apply(residual)) ** 2), rtol=1e-12)


def test_covariance_gives_the_likelihood():
    rng = np.random.default_rng(1)
    root = gaussian(rng, 5, 6, 6) * 10.0 ** rng.uniform(-6, 6, (5, 6, 1))
    covariance = root @ root.conj().transpose(0, 2, 1)
    residual = gaussian(rng, 5, 3, 2)
    weighted = Weight.from_covariance(covariance, 3, 2).apply(residual)
    for k in range(5):
        wanted = np.linalg.norm(np.linalg.solve(root[k], vec(residual[k]))) ** 2
        assert np.linalg.norm(weighted[k]) ** 2 == pytest.approx(wanted, rel=1e-8)


def test_bands_and_masks_multiply():
    weight = Weight(np.ones((4, 1, 2)))
    banded = weight.banded(np.array([1.0, 2.0, 3.0, 4.0]), [(2, 3, 10.0), (3, 9, 0.5)])
    np.testing.assert_array_equal(banded.entries[:, 0, 0], [1, 10, 5, 0.5])
    masked = banded.scaled([True, False, True, True])
    np.testing.assert_array_equal(masked.entries[:, 0, 1], [1, 0, 5, 0.5])


def test_bad_weights_are_named():
    ones = np.ones((3, 2, 2))
    for arguments, message in [
        ({"entries": -ones}, "must be >= 0"),
        ({"entries": 0 * ones}, "zero everywhere"),
        ({"entries": ones, "output": np.ones((2, 2, 2))}, r"`output` must have shape \(F, 2, 2\) with F = 3"),
        ({"entries": ones, "matrix": np.full((4, 4), np.nan)}, "`matrix` must be finite"),
    ]:
        with pytest.raises(InputError, match=message):
            Weight(**arguments)
    with pytest.raises(InputError, match=r"zero at frequency point 1, entry \(0, 1\)"):
        Weight.relative(np.where(np.arange(12).reshape(3, 2, 2) == 5, 0, 1.0))
    with pytest.raises(InputError, match="positive definite; at frequency point 0"):
        Weight.from_covariance(np.ones((3, 4, 4)), 2, 2)
    with pytest.raises(InputError, match="no frequency point lies between 7 and 9"):
        Weight(ones).banded(np.arange(3.0), [(7, 9, 2.0)])
    with pytest.raises(InputError, match="`factors` must have shape"):
        Weight(ones).scaled(np.ones(2))

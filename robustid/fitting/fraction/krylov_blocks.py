"""Blocks of vector polynomials on the data: their layout, how a block grows and is made orthogonal."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy.linalg

from robustid.errors import InputError
from robustid.fitting.fraction.householder import triangle_inverse

gemm, syrk = scipy.linalg.get_blas_funcs(("gemm", "syrk"), dtype=np.float64)  # in place, unlike @
# A column that loses this much of its length when the earlier ones are taken out is a combination of them.
NULL = 1e-10
# Cholesky QR squares the condition number; below this pivot Householder takes over.
_SMALL_PIVOT = 1e-5


class Block(NamedTuple):
    """Place of a block among all columns, and its components."""

    before: slice  # columns of the block before: multiplied by xi they are the first of this one
    here: slice
    fresh: np.ndarray  # components that start here, the last columns


def block_layout(limits: np.ndarray) -> tuple[Block, ...]:
    """Blocks of all vector polynomials whose l-th component has a degree of at most ``limits[l]`` (-1: absent), by falling
    limit: components of the largest limit L start in block 0, those of L - 1 in block 1, and so on, so that all reach their
    limit in block L together and xi times a block stays in the span up to there.
    """
    order, last = np.argsort(-limits, kind="stable"), int(limits.max(initial=-1))
    blocks: list[Block] = []
    before, older = slice(0, 0), 0
    for k in range(last + 1):
        count = int(np.sum(limits >= last - k))
        here = slice(before.stop, before.stop + count)
        blocks.append(Block(before, here, order[older:count]))
        before, older = here, count
    return tuple(blocks)


def check_equations(limits: np.ndarray, columns: np.ndarray) -> tuple[int, int]:
    """Numbers of real equations that columns (F, r, b) give, and of coefficients, which must not be more."""
    rows, size = 2 * columns.shape[0] * columns.shape[1], int(np.sum(np.maximum(limits, -1) + 1))
    if not 0 < size <= rows:
        raise InputError(
            f"`limits` ask for {size} coefficients where the data give {rows} real equations;"
            " lower the order or give more frequency points"
        )
    return rows, size


def raised(xi: np.ndarray, last: np.ndarray, fresh: np.ndarray) -> np.ndarray:
    """The next block: xi times the last one (2*F*r, a), and the columns (F, r, c) of the components that start."""
    return np.concatenate([times_xi(xi, last).T, stacked(fresh).T]).T


def stacked(vector: np.ndarray) -> np.ndarray:
    """(F, r, ...) complex as (2*F*r, ...) real: real parts above imaginary parts."""
    flat = vector.reshape(vector.shape[0] * vector.shape[1], *vector.shape[2:])
    return np.concatenate([np.real(flat), np.imag(flat)])


def times_xi(xi: np.ndarray, block: np.ndarray) -> np.ndarray:
    """The nodes times the rows of stacked columns."""
    half = block.shape[0] // 2
    repeated = np.repeat(xi, half // xi.size)[:, None]
    real, imaginary = np.real(repeated), np.imag(repeated)
    out = np.empty(block.shape, order="F")
    np.multiply(-imaginary, block[half:], out=out[:half])
    np.multiply(imaginary, block[:half], out=out[half:])
    if np.any(real):
        out[:half] += real * block[:half]
        out[half:] += real * block[half:]
    return out


def without(basis: np.ndarray, tests: np.ndarray, block: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """``block - basis (tests^T block)``, in place, and the coordinates."""
    if not basis.shape[1] or not block.shape[1]:
        return block, np.zeros((basis.shape[1], block.shape[1]))
    coordinates = gemm(1.0, tests, block, trans_a=1)
    return gemm(-1.0, basis, coordinates, 1.0, block, overwrite_c=1), coordinates


def orthonormal_columns(block: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """QR: Cholesky of the Gram matrix of the normalised columns while that is safe, else Householder."""
    if not block.shape[1]:
        return block, np.zeros((0, 0))
    length = np.linalg.norm(block, axis=0)
    if np.all(length > 0):
        try:
            normalised = scipy.linalg.cholesky(syrk(1.0, block / length, trans=1))
        except np.linalg.LinAlgError:
            normalised = np.zeros((1, 1))
        if np.min(np.diag(normalised)) > _SMALL_PIVOT:
            R = normalised * length
            return gemm(1.0, block, triangle_inverse(R)), R
    return scipy.linalg.qr(block, mode="economic", check_finite=False)  # type: ignore[return-value]

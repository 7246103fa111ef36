"""Hankel matrices of Taylor coefficients: products and curvature by FFT."""

from __future__ import annotations

import numpy as np
import scipy.fft

_LONG = 300  # from here on, Hankel products by FFT are quicker than dense ones


class HankelMap:
    """H(x)_ab = x_(a+b-L+1), zero above the antidiagonal: the flipped Toeplitz matrix of L Taylor coefficients.

    The curvature is a two-dimensional convolution: tr(H_i P H_j Q) = sum over b + c = L-1+i, d + a = L-1+j of P_cd Q_ab
    = (P * Q)[L-1+i, L-1+j], hence O(L^2 log L) for the whole matrix, with the rounding of an FFT: relative to ||P|| ||Q||.
    """

    def __init__(self, size: int):
        self.size = size
        self._length = scipy.fft.next_fast_len(2 * size - 1, real=True)

    def matrix(self, x: np.ndarray) -> np.ndarray:
        """H(x)."""
        padded = np.concatenate([np.zeros(self.size - 1), x])
        return np.lib.stride_tricks.sliding_window_view(padded, self.size).copy()

    def adjoint(self, Y: np.ndarray) -> np.ndarray:
        """Inner products tr(H_j Y)."""
        n = self.size
        skewed = np.zeros((n, 2 * n))
        skewed[:, :n] = Y
        # Row a moves a places to the right, so that antidiagonals become columns.
        return skewed.ravel()[: n * (2 * n - 1)].reshape(n, 2 * n - 1).sum(axis=0)[n - 1 :]

    def times(self, x: np.ndarray, M: np.ndarray) -> np.ndarray:
        """H(x) M."""
        if self.size < _LONG:
            return self.matrix(x) @ M
        # Rows of H are windows of (0, ..., 0, x): a correlation with the columns of M.
        spectrum = scipy.fft.rfft(np.concatenate([np.zeros(self.size - 1), x]), self._length)
        turned = np.asarray(scipy.fft.rfft(M[::-1].T, self._length))
        turned *= np.asarray(spectrum)
        return np.asarray(scipy.fft.irfft(turned, self._length))[:, self.size - 1 : 2 * self.size - 1].T

    def curvature(self, pairs: list[tuple[np.ndarray, np.ndarray]]) -> np.ndarray:
        """Sum of tr(H_i P H_j Q)."""
        total = None
        for P, Q in pairs:
            product = self._transform(P)
            product *= self._transform(Q)
            total = product if total is None else total + product
        last = slice(self.size - 1, 2 * self.size - 1)
        rows = np.asarray(scipy.fft.ifft(total, axis=0, overwrite_x=True))[last]
        full = np.asarray(scipy.fft.irfft(rows, self._length))[:, last]
        return (full + full.T) / 2

    def _transform(self, P: np.ndarray) -> np.ndarray:
        """Two-dimensional transform of P with zeros around; the zero rows are left out where they can be."""
        return np.asarray(scipy.fft.fft(scipy.fft.rfft(P, self._length), self._length, axis=0, overwrite_x=True))

"""Sums of exponentials on arbitrary angles by FFT (non-uniform fast Fourier transforms of types 1 and 2)."""

from __future__ import annotations

import numpy as np
import scipy.fft
import scipy.sparse

_WIDTH = 16  # grid points under the kernel: 14 digits at twofold oversampling
_SHAPE = 2.3 * _WIDTH


class NonuniformSums:
    """Sums over angles, or over exponents 0 <= m < count, of exp(-i m theta_k).

    Spread to (or read from) a regular grid of at least twice as many points with the kernel exp(b sqrt(1 - t^2) - b), whose
    transform divides the result; the sums are those of the regular grid to about 1e-13 of the sum of the moduli. The matrix of
    the kernel is sparse: 16 entries per angle. (A permissive library would be used here; the one that is kept contains GPL code
    as it is distributed.)

    Source: `barnett2019` sections 2 and 3.

    Parameters
    ----------
    angles : (F,) array
        theta, rad, any.
    count : int
    """

    def __init__(self, angles: np.ndarray, count: int):
        self.count = count
        self._grid = int(scipy.fft.next_fast_len(max(2 * count, 2 * _WIDTH)) or 0)
        h = 2 * np.pi / self._grid
        # Exponents run around 0 on the grid, where the kernel's transform is largest.
        self._centre = count // 2
        self._phase = np.exp(-1j * self._centre * angles)
        first = np.ceil(angles / h - _WIDTH / 2).astype(int)
        places = first[:, None] + np.arange(_WIDTH)
        distance = 2 * (places - (angles / h)[:, None]) / _WIDTH
        values = np.exp(_SHAPE * (np.sqrt(np.maximum(1 - distance**2, 0.0)) - 1))
        rows = np.arange(0, places.size + 1, _WIDTH)
        shape = (angles.size, self._grid)
        self._kernel = scipy.sparse.csr_array((values.ravel(), (places % self._grid).ravel(), rows), shape=shape)
        self._spread = self._kernel.T.tocsr()
        nodes, weights = np.polynomial.legendre.leggauss(4 * _WIDTH)
        exponents = np.arange(count) - self._centre
        waves = np.cos(np.outer(exponents, nodes) * (_WIDTH * h / 2))
        self._correction = 2 / _WIDTH / (waves @ (weights * np.exp(_SHAPE * (np.sqrt(1 - nodes**2) - 1))))
        self._at = exponents % self._grid

    def over_angles(self, weights: np.ndarray) -> np.ndarray:
        """sum_k weights_k exp(-i m theta_k) for every m, (..., count), of weights (..., F)."""
        gridded = (self._spread @ (weights * self._phase).T).T
        return np.asarray(scipy.fft.fft(gridded))[..., self._at] * self._correction

    def over_exponents(self, weights: np.ndarray) -> np.ndarray:
        """sum_m weights_m exp(-i m theta_k) for every angle, (F,)."""
        gridded = np.zeros(self._grid, complex)
        gridded[self._at] = weights * self._correction
        return self._phase * (self._kernel @ np.asarray(scipy.fft.fft(gridded)))

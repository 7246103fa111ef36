"""One all-pass section repeated: the bases between the shift (B = z) and a pair with a node for every line."""

from __future__ import annotations

import dataclasses
import functools

import numpy as np

from robustid.bases.input_normal import InputNormalPair, cascade, line_section
from robustid.core import Frozen, as_count
from robustid.errors import InputError


@dataclasses.dataclass(frozen=True)
class Sections(Frozen):
    r"""The space of theta = B^M, B one real all-pass function of low degree m: n = m M coefficients.

    .. math:: K_\theta = H_2 \ominus \theta H_2 = \bigoplus_{k < M} B^k K_B, \quad
              B(\zeta) = \prod_i \frac{\zeta - a_i}{1 - \bar a_i \zeta}

    Its basis is that of one section, e(zeta) with m entries, times the powers of B: e, B e, B^2 e, ... What a function of the
    unit ball has beyond it is theta q with q = P_+(conj(theta) g), on the circle, hence in the disc at most
    |theta| (2/pi) K(|zeta|), K the complete elliptic integral. B = zeta gives the Taylor coefficients.

    Parameters
    ----------
    zeros : sequence of complex
        Of B, inside the unit disc; conjugates of those off the real axis are implied.
    repeats : int
        M.

    Raises
    ------
    InputError
        No zero, or one that isn't inside the unit disc.

    Notes
    -----
    Source: theory of orthonormal rational bases (generalised orthonormal basis functions).

    Examples
    --------
    >>> from robustid.bases import Sections
    >>> Sections([0.9, 0.8 + 0.3j], 5).order
    15
    >>> Sections.shift(3).evaluate([0.5]).real
    array([[1.  , 0.5 , 0.25]])
    """

    zeros: tuple[complex, ...]
    repeats: int

    def __post_init__(self) -> None:
        zeros = tuple(complex(a.real, abs(a.imag)) for a in map(complex, self.zeros))
        zeros = tuple(a if 0 < np.angle(a) < np.pi else complex(a.real) for a in zeros)  # real to rounding: one zero
        if not zeros or not all(abs(a) < 1 for a in zeros):  # false for NaN too
            raise InputError(f"`zeros` must be one or more numbers inside the unit disc; got {list(self.zeros)}")
        self._set(zeros=zeros, repeats=as_count("repeats", self.repeats, least=1))

    @classmethod
    def shift(cls, length: int) -> Sections:
        """The first `length` Taylor coefficients."""
        return cls((0j,), length)

    @property
    def is_shift(self) -> bool:
        """True if B = z."""
        return self.zeros == (0j,)

    @property
    def degree(self) -> int:
        """Number m of zeros of B, conjugates counted."""
        return sum(2 if a.imag else 1 for a in self.zeros)

    @property
    def order(self) -> int:
        """Number n of coefficients."""
        return self.degree * self.repeats

    @functools.cached_property
    def section(self) -> InputNormalPair:
        """The pair of B, of order m."""
        return cascade([line_section(abs(float(np.angle(a))), abs(a)) for a in self.zeros])

    @functools.cached_property
    def pair(self) -> InputNormalPair:
        """The pair of B^M, block upper triangular and Toeplitz: a on the diagonal, b d^k c on the k-th block beside it."""
        section = self.section
        a, b, c, d = section.A, section.B, section.c, section.d
        M = self.repeats
        powers = float(d[0, 0]) ** np.arange(M)
        beside = np.zeros((M, M))
        for k in range(1, M):
            beside += powers[k - 1] * np.eye(M, k=k)
        A = np.kron(np.eye(M), a) + np.kron(beside, b @ c)
        B, row = np.kron(powers[::-1, None], b), np.kron(powers[None], c)
        return InputNormalPair(A, B, row, d**M)

    def all_pass(self, zeta: np.ndarray) -> np.ndarray:
        """B(zeta), |zeta| <= 1."""
        zeta = np.asarray(zeta, dtype=complex)
        value = np.ones(zeta.shape, dtype=complex)
        for a in self.zeros:
            for zero in (a, a.conjugate())[: 2 if a.imag else 1]:
                value *= (zeta - zero) / (1 - np.conj(zero) * zeta)
        return value

    def evaluate(self, zeta: np.ndarray) -> np.ndarray:
        """The rows phi(zeta), shape (len(zeta), n), |zeta| < 1."""
        zeta = np.atleast_1d(np.asarray(zeta, dtype=complex))
        powers = np.ones((zeta.size, self.repeats), dtype=complex)
        powers[:, 1:] = np.cumprod(np.broadcast_to(self.all_pass(zeta)[:, None], (zeta.size, self.repeats - 1)), axis=1)
        return (powers[:, :, None] * self.section.evaluate(zeta)[:, None, :]).reshape(zeta.size, -1)
